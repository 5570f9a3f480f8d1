"""How many independent rows a row is worth, from how scores over blocks of time scatter."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ges.diagnose.design.system import System, nuisance_of, variant_of
from ges.diagnose.design.table import spread
from ges.diagnose.design.whiten import Noise, White, group_of
from ges.diagnose.select.gram import Gram, gram_of, unanswered
from ges.diagnose.settings import settings
from ges.diagnose.types.model import block_of, least


def worth_of_rows(
    system: System,
    noise: Noise,
    whites: Sequence[White],
    prior_sd: np.ndarray,
    chosen: Sequence[int],
) -> np.ndarray:
    """Magnitude adjustment of the likelihood by channel, (C,), at most one.

    If whitened rows were independent, a score (a column times what is left) over a block of time
    would have the variance of the column's own square there. Where it has ``r`` times as much, on
    average over the effects, a row is worth ``1 / r`` (Pauli, Racugno and Ventura 2011, Stat.
    Sinica 21, 149). What a model is wrong by is the same in all rows of a block, and adds to ``r``
    what it makes of their mean (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63, 425).

    Parameters
    ----------
    whites : the flights, every row counted once.
    prior_sd : (K,) of candidates; 0 where nothing shows a column.
    chosen : columns that are no noise: fitted, and taken out.
    """
    columns, at = system.columns, np.asarray(chosen, dtype=int)
    own = np.array([k for k, c in enumerate(columns) if c.nuisance is not None], dtype=int)
    # blocks are compared within a flight: its nuisances are its own, whatever the others ask for
    doubts = [nuisance_of(columns[k]) for k in own]
    precision = np.diag([1.0 / (n.sd**2 + n.flight_sd**2) for n in doubts])
    grams = [gram_of(w) for w in whites]
    # by flight, what nuisances explain of every column and, last, of the residual
    explained = [
        np.linalg.solve(g.xx[np.ix_(own, own)] + precision, np.c_[g.xx[own], g.xy[own]])
        for g in grams
    ]
    rest = [_beyond(g, own, e) for g, e in zip(grams, explained, strict=True)]
    whole = sum(rest[1:], rest[0])
    wide = settings.numerics.wide_factor * prior_sd[at]
    found = np.linalg.solve(whole.xx[np.ix_(at, at)] + np.diag(1.0 / wide**2), whole.xy[at])
    strongest = _strongest(system, np.diag(whole.xx) * prior_sd**2)
    scores: dict[str, list[tuple[np.ndarray, np.ndarray]]] = defaultdict(list)
    blocks = system.blocks(settings.statistics.block_s)
    for white, block, told in zip(whites, blocks, explained, strict=True):
        beta = np.zeros(len(columns))
        beta[own], beta[at] = told[:, -1] - told[:, at] @ found, found
        of_flight = _scores(system, white, block, beta, told[:, strongest], own, strongest)
        for group, pair in of_flight.items():
            scores[group].append(pair)
    # a block is worth a row at least; windows stand half a length apart
    most = max(1.0, 2.0 * settings.statistics.block_s / system.length_s)
    scatter = {
        group: _ratio(*(np.concatenate(told) for told in zip(*pairs, strict=True)))
        for group, pairs in scores.items()
    }
    ratio = np.array(
        [min(max(1.0, scatter.get(group_of(name), 1.0)), most) for name in system.names]
    )
    return 1.0 / (ratio + most * _discrepancy(system, noise) ** 2)


def _discrepancy(system: System, noise: Noise) -> np.ndarray:
    """What no model is right to less than, in sds of the innovations, (C,): the filter leaves of
    what does not change the share one less its coefficients.
    """
    model = system.model
    size = np.array([least(block_of(name), model.whole(name)) for name in system.names])
    return size * (1.0 - noise.ar.sum(axis=1)) / noise.sd


def _beyond(gram: Gram, own: np.ndarray, explained: np.ndarray) -> Gram:
    """Normal equations of what nuisances ``own`` do not explain."""
    return Gram(
        gram.xx - gram.xx[:, own] @ explained[:, :-1],
        gram.xy - gram.xx[:, own] @ explained[:, -1],
        gram.yy,
        gram.n,
    )


def _strongest(system: System, power: np.ndarray) -> np.ndarray:
    """Of each effect the column with most ``power`` (K,): its variants are much alike."""
    best: dict[str, int] = {}
    for k, column in enumerate(system.columns):
        if column.variant is not None and power[k] > settings.numerics.tiny:
            effect = variant_of(column).effect
            best[effect] = max(best.get(effect, k), k, key=lambda i: power[i])
    return np.array(sorted(best.values()), dtype=int)


def _scores(
    system: System,
    white: White,
    block: np.ndarray,
    beta: np.ndarray,
    explained: np.ndarray,
    own: np.ndarray,
    wanted: np.ndarray,
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Of one flight by group of channels: scores of the wanted columns in every block (b, k), and
    their covariance if rows were independent, (b, k, k).

    Parameters
    ----------
    beta : (K,) coefficients that are taken out of the residual.
    explained : (n, k) coefficients of the nuisances ``own`` (n,) that are taken out of the columns.
    """
    number = np.unique(block, return_inverse=True)[1]
    count, k = number.max(initial=-1) + 1, len(wanted)
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for part in white.parts:
        x, y = unanswered(part)
        left = y - x @ beta[part.columns]
        acting = spread(x, part.columns, wanted) - spread(x, part.columns, own) @ explained
        score, covariance = found.setdefault(
            group_of(system.names[part.channel]), (np.zeros((count, k)), np.zeros((count, k, k)))
        )
        # rows come in order of time, so that a block is one run of them
        first = np.flatnonzero(np.diff(number[part.at], prepend=-1))
        for rows, b in zip(
            np.split(np.arange(len(y)), first[1:]), number[part.at[first]], strict=True
        ):
            score[b] += acting[rows].T @ left[rows]
            covariance[b] += acting[rows].T @ acting[rows]
    return found


def _ratio(scores: np.ndarray, covariance: np.ndarray) -> float:
    """How many times their covariance (b, k, k) scores (b, k) have; 1 where no column acts, endless
    where none acts in two blocks.
    """
    variance = np.einsum("bkk->bk", covariance)
    told = np.flatnonzero(variance.sum(axis=0) > settings.numerics.tiny)
    if not len(told):
        return 1.0
    variance = variance[:, told]
    total = variance.sum(axis=0)
    # scores about the column's own coefficient have the rest of the variance
    left = scores[:, told] - variance * (scores[:, told].sum(axis=0) / total)
    rest = len(told) - float(((variance / total) ** 2).sum())
    return float((left**2 / total).sum()) / rest if rest > settings.numerics.small else np.inf
