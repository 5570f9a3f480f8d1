"""The smallest size of every effect that these flights would have shown, from the information
matrix alone.

The flights' noise, nuisances and rivals are those of the search itself: an effect counts as seen
when its evidence beats nothing and every rival by the odds that an acceptance takes, in nine of ten
such sets of flights, and when it is large enough to be told (see ``standing``). What is free to be
off without any finding, a motor's lag within its doubt, tells no more of itself than that doubt
leaves. Of an effect of several shapes, a load on threads of any length say, the middle one stands
for all; of an effect that was found, the shape that was found, and what was found is seen.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri

from ges.diagnose.decide.rules import lead_over
from ges.diagnose.decide.sizes import least_sizes
from ges.diagnose.design.system import DesignColumn, variant_of
from ges.diagnose.library.candidates import Variant, modifiers_of
from ges.diagnose.select.evidence import Gram, Regression, rms_of
from ges.diagnose.select.search import log_odds_against_one_of, log_rarity
from ges.diagnose.settings import settings
from ges.diagnose.types.model import block_of
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class _Shape:
    """One variant of one effect: its columns in the regression, by true column the evidence that
    they gain and what of it is ``over`` what is free without them, and the price: of their freedom,
    of being one of many shapes, of being rarely met.
    """

    name: str
    columns: tuple[int, ...]
    gain: np.ndarray
    over: np.ndarray
    cost: float


@dataclasses.dataclass(frozen=True)
class Found:
    """An effect that was found: its variant in the search, where that had one, and how far each of
    its parameters is from neutral.
    """

    variant: Variant | None
    sizes: Mapping[str, float]


@dataclasses.dataclass(frozen=True)
class _Entry:
    """What is told of one amplitude of one variant, and its size over the amplitude's usual one."""

    variant: Variant
    relative: float
    content: dict[str, Any]


def _shapes(regression: Regression, gram: Gram, leave_out: Collection[str]) -> list[_Shape]:
    found = [
        (name, columns)
        for (name, _), columns in regression.by_variant().items()
        if name not in leave_out
    ]
    many, most = Counter(name for name, _ in found), _most(regression)
    return [
        _Shape(
            name,
            tuple(columns),
            gain,
            np.minimum(gain, most),
            cost + math.log(many[name]) - log_rarity([name]),
        )
        for name, columns in found
        for gain, cost in [expected_evidence(gram, columns, regression.prior.sd)]
    ]


def _most(regression: Regression) -> np.ndarray:
    """Evidence per squared unit of every column's coefficient, (K,), that no flights exceed: a
    nuisance of its key costs no more (what columns that hold at different levels differ by would
    count as evidence without end).
    """
    # x^2 / (2 sd^2) is what the prior charges a nuisance for the same move
    doubt = {
        key: sd
        for key, k in regression.system.nuisances.items()
        if (sd := regression.prior.sd[k]) > 0
    }
    return np.array(
        [0.5 / doubt[c.key] ** 2 if c.key in doubt else np.inf for c in regression.system.columns]
    )


def expected_evidence(
    gram: Gram, columns: Sequence[int], prior_sd: np.ndarray
) -> tuple[np.ndarray, float]:
    """Log evidence of a set of columns when one column of the regression alone acts: ``gain *
    size^2 - cost``, noise left out.

    Parameters
    ----------
    columns : k columns of the set.
    prior_sd : (K,) prior sd of every column's coefficient.

    Returns
    -------
    gain, cost : (K,) per squared unit of the coefficient of every column that may be the true one,
        and the price of the set's freedom.
    """
    at = np.asarray(columns, dtype=int)
    scale = prior_sd[at]
    # equation (6) of docs/method.md for y = x_k size: b' A^-1 b / 2 = |L^-1 S X' x_k|^2 size^2 / 2,
    # and log det(L) is what the freedom costs, with L L' = I + S X'X S and S the prior sds
    chol = np.linalg.cholesky(np.eye(len(at)) + gram.xx[np.ix_(at, at)] * np.outer(scale, scale))
    half = np.linalg.solve(chol, (gram.xx[at] * scale[:, None]).T[:, :, None])[:, :, 0]
    return 0.5 * np.array([h @ h for h in half]), float(np.log(np.diag(chol)).sum())


def _size_beyond(price: float, per_square: float) -> float:
    """Size from which an evidence that grows as ``per_square size^2`` exceeds a price in most
    sets of flights, its noise growing with the size.
    """
    if per_square <= 0.0:
        return np.inf if price > 0.0 else 0.0
    weight = settings.evidence.tempering
    # the larger root of g size^2 - z sqrt(2 w g) size = price: evidence has the sd
    # sqrt(2 w g) size, and half = z sqrt(w / (2 g))
    half = ndtri(settings.advise.power) * math.sqrt(weight / (2.0 * per_square))
    square = half**2 + price / per_square
    return half + math.sqrt(square) if square >= 0.0 else 0.0


def _needed(
    shape: _Shape, truth: int, others: Sequence[_Shape], log_odds: float
) -> tuple[float, str]:
    """Size of the true coefficient at which its evidence beats nothing and every other effect; inf
    and the effect that hides it where one does.
    """
    gain, count = float(shape.gain[truth]), len({s.name for s in others} | {shape.name})
    price, rarity = log_odds + shape.cost, log_odds_against_one_of(count)
    # against nothing: there its number may move as a nuisance, at a price that the doubt sets
    shown = max(float(shape.over[truth]), settings.numerics.tiny)
    worst, hidden = _size_beyond(price + rarity, shown), ""
    for other in (s for s in others if s.name != shape.name):
        # against a rival: it takes up a part of the gain, and pays for its own freedom
        more = lead_over(shape.name, (other.name,)) - settings.statistics.acceptance_log_odds
        size = _size_beyond(price + more - other.cost, gain - float(other.gain[truth]))
        if size > worst:
            worst, hidden = size, other.name
    return worst, hidden


@dataclasses.dataclass(frozen=True)
class _Sizes:
    """Of every column (K,): the coefficient at which it matters in its greatest channel, and what a
    unit of it makes of weight, or of weight times arm.
    """

    least: np.ndarray
    share_of_weight: np.ndarray


def _sizes(regression: Regression) -> _Sizes:
    system, rms = regression.system, rms_of(regression.system)
    block = np.array([block_of(name) for name in system.main])
    shares = rms / least_sizes(system)[:, None]
    # a share of weight has a meaning in forces and moments alone, not in the drive or the range
    pushed = np.isin(block, ("force", "acc", "moment"))
    whole = np.array([system.model.reference_scale(name) for name in system.main])[:, None]
    with np.errstate(divide="ignore"):
        return _Sizes(
            # shares are linear in the coefficient: it matters once the greatest of them is one
            1.0 / shares.max(axis=0),
            (rms / whole)[pushed].max(axis=0, initial=0.0),
        )


def smallest_detectable(
    regression: Regression, found: Mapping[str, Found] | None = None
) -> dict[str, dict[str, Any]]:
    """Smallest size by effect.

    Parameters
    ----------
    regression : of the search, with the columns of every candidate.
    found : effects that are accepted already; beside them the others are judged, and each of them
        beside the rest.

    Returns
    -------
    by effect: ``parameter``, ``smallest`` (None where it never would), ``unit``, ``shape`` (the
    fixed parameters), and ``limited_by``, the rival that is hardest to tell from it ('' when it is
    noise).
    """
    pooled, unit, given = regression.pooled(), _sizes(regression), found or {}
    told: dict[str, dict[str, Any]] = {}
    for name, known in given.items():
        alone = _beside(regression, pooled, unit, {*given} - {name}, name)
        told |= {name: _seen(alone[name], known)} if name in alone else {}
    others = _beside(regression, pooled, unit, {*given}, None)
    return told | {name: _standing_for(entries) for name, entries in others.items()}


def _seen(entries: Sequence[_Entry], found: Found) -> dict[str, Any]:
    """The entry of the shape that was found, no larger than what was found."""
    entry = next((e for e in entries if e.variant == found.variant), entries[0]).content
    size = found.sizes.get(entry["parameter"], math.inf)
    limit = math.inf if entry["smallest"] is None else entry["smallest"]
    return {**entry, "smallest": size, "limited_by": ""} if size < limit else entry


def _beside(
    regression: Regression,
    pooled: Gram,
    unit: _Sizes,
    given: Collection[str],
    asked: str | None,
) -> dict[str, list[_Entry]]:
    """Smallest sizes of the ``asked`` effect (of all where None) by shape, those ``given`` being
    free and no rivals.
    """
    free = np.array(
        [
            k
            for k, c in enumerate(regression.system.columns)
            if c.variant is not None and c.variant.effect in given and regression.prior.sd[k] > 0
        ],
        dtype=int,
    )
    # what is given takes no side: it is integrated out with a prior that is as good as flat
    gram = pooled.without(free, settings.numerics.wide_factor * regression.prior.sd[free])
    shapes, log_odds = _shapes(regression, gram, given), settings.statistics.acceptance_log_odds
    sizes: dict[str, list[_Entry]] = {}
    for shape in (s for s in shapes if asked in (None, s.name)):
        for k in (k for k in shape.columns if _is_told(regression.system.columns[k])):
            size, hidden = _needed(shape, k, shapes, log_odds)
            size, hidden = max((size, hidden), (float(unit.least[k]), ""))
            sizes.setdefault(shape.name, []).append(_entry(regression, k, size, hidden, unit))
    return sizes


def _is_told(column: DesignColumn) -> bool:
    """Whether a size is told of it: of the main part of effects that nothing modifies."""
    return column.part != "moment" and not modifiers_of(variant_of(column))


def _standing_for(entries: Sequence[_Entry]) -> dict[str, Any]:
    """The middle of entries by their relative size."""
    return sorted(entries, key=lambda entry: entry.relative)[(len(entries) - 1) // 2].content


def _entry(regression: Regression, k: int, size: float, hidden: str, unit: _Sizes) -> _Entry:
    """What is told of a size: of what clips the level, if its whole is seen; of what is more than
    the vehicle's weight, or than the parameter's room, nothing.
    """
    column = regression.system.columns[k]
    variant = variant_of(column)
    amplitude = variant.amplitudes[column.amplitude]
    room = max(amplitude.high - amplitude.neutral, amplitude.neutral - amplitude.low)
    # what clips shows only as a whole: it is seen at its level or not at all
    if "clips" in effect_table.get(variant.effect).hints:
        size = abs(amplitude.level) if size <= abs(amplitude.level) else np.inf
    seen = np.isfinite(size) and size <= room and size * unit.share_of_weight[k] <= 1.0
    content = {
        "parameter": amplitude.parameter,
        "smallest": size if seen else None,
        "unit": effect_table.get(variant.effect).parameter(amplitude.parameter).unit,
        "shape": dict(variant.shape),
        "limited_by": hidden,
    }
    return _Entry(variant, size / abs(amplitude.step) if seen else np.inf, content)
