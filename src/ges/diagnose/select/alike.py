"""Which names these flights cannot separate, whatever the noise was.

An effect is a direction in the space of all residuals. They are whitened by their noise, and
nuisances and the other names of the set are projected out. A rival that can do nearly the same
keeps the name open, even where the evidence prefers one. That preference comes from priors and
chance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ges.diagnose.design.columns import variant_of
from ges.diagnose.select.evidence import Gram, Regression
from ges.diagnose.select.scorer import Entry
from ges.diagnose.select.search import Hypothesis
from ges.diagnose.settings import settings


@dataclasses.dataclass(frozen=True)
class Alike:
    """An effect that these flights cannot separate from a name.

    Attributes
    ----------
    name, place : the other effect, or the same at another place (``rotor 5``).
    expected_log_odds : of the name over it, if the name is true.
    """

    name: str
    place: str
    expected_log_odds: float


def alike_of(
    regression: Regression, h: Hypothesis, name: str, listed: Sequence[Entry]
) -> tuple[Alike, ...]:
    """Return what these flights cannot separate from a name, the nearest first.

    Parameters
    ----------
    regression : of the search.
    h : a set that has the name; its other names stay with every rival.
    name : of the effect.
    listed : variants of all possible rivals.
    """
    if not listed:
        return ()
    columns, posterior = regression.system.columns, h.posterior
    own = [i for i, k in enumerate(posterior.columns) if variant_of(columns[k]).effect == name]
    mine, b = [posterior.columns[i] for i in own], posterior.mean[own]
    others = np.array([k for k in posterior.columns if k not in mine], dtype=int)
    gram = regression.pool().without(others, regression.prior.sd[others])
    # log odds over nothing that the name is expected to have, but for the size that it took
    over_nothing = 0.5 * float(b @ gram.xx[np.ix_(mine, mine)] @ b)
    size = _unlikely(regression, mine, b)
    least, best = settings.statistics.acceptance_log_odds, dict[tuple[str, str], Alike]()
    here = variant_of(columns[mine[0]]).places
    for entry in listed:
        places = variant_of(columns[entry.columns[0]]).places
        if entry.name in h.names and (entry.name != name or set(places) & set(here) or not here):
            continue
        log_odds = _in_place_of(gram, regression, mine, b, entry) - size
        key = entry.name, " and ".join(places)
        # a rival that explains nothing is no rival, only a name that hardly shows
        if log_odds < least <= over_nothing - log_odds and (
            key not in best or log_odds < best[key].expected_log_odds
        ):
            best[key] = Alike(*key, log_odds)
    return tuple(sorted(best.values(), key=lambda a: (a.expected_log_odds, a.name, a.place)))


def _unlikely(regression: Regression, at: Sequence[int], values: np.ndarray) -> float:
    """Return log prior density of coefficients (k,) at their mean over that at their values."""
    prior = regression.prior.take(np.array(at))
    return 0.5 * float((((values - prior.mean) / prior.sd) ** 2).sum())


def _in_place_of(
    gram: Gram, regression: Regression, mine: Sequence[int], b: np.ndarray, entry: Entry
) -> float:
    """Return expected log odds of columns over a variant.

    The columns have coefficients b (k,).

    Minimises (8) of docs/method.md over c, between the bounds of its prior.
    """
    at, own = list(entry.columns), list(mine)
    prior, inner = regression.prior.take(np.array(at)), gram.xx[np.ix_(at, at)]
    cross, precision = gram.xx[np.ix_(at, own)] @ b, np.diag(1.0 / prior.sd**2)
    c = np.linalg.solve(inner + precision, cross + precision @ prior.mean)
    c = np.clip(c, prior.low, prior.high)
    log_odds = b @ gram.xx[np.ix_(own, own)] @ b - 2.0 * c @ cross + c @ inner @ c
    return 0.5 * float(log_odds) + _unlikely(regression, at, c)
