"""Smallest detectable size of every effect, from the information matrix alone.

Noise, nuisances and rivals are those of the search. An effect is detectable when its evidence beats
nothing and every rival by the odds of an acceptance. It has to do so in nine of ten such sets of
flights, and to exceed the practical significance threshold.

A number that may be off without any finding, such as a motor's lag, shows no more than its prior
allows. Of an effect of several shapes the middle one counts. Of an effect that was found its own
shape counts, and the size that was found is detectable.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri

from ges.diagnose.design.columns import DesignColumn, variant_of
from ges.diagnose.library.candidates import Variant, modifiers_of
from ges.diagnose.select.evidence import Gram, Regression
from ges.diagnose.select.search import log_odds_against_one_of, log_rarity
from ges.diagnose.settings import settings
from ges.diagnose.types.model import block_of
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class _VariantEvidence:
    """One variant of an effect, with the evidence that is expected of it.

    Attributes
    ----------
    name : of the effect.
    columns : its columns in the regression.
    per_square : (K,) evidence by true column, per squared unit of its coefficient.
    over_nuisances : (K,) the same, over what nuisances can explain.
    cost : log evidence of its freedom, of its many shapes, and of its rarity.
    """

    name: str
    columns: tuple[int, ...]
    per_square: np.ndarray
    over_nuisances: np.ndarray
    cost: float


@dataclasses.dataclass(frozen=True)
class DetectedEffect:
    """An effect that was found.

    Attributes
    ----------
    variant : in the search, where it had one.
    sizes : distance of each parameter from neutral.
    """

    variant: Variant | None
    sizes: Mapping[str, float]


@dataclasses.dataclass(frozen=True)
class _Entry:
    """Result for one amplitude of one variant.

    Attributes
    ----------
    variant : it belongs to.
    relative : size over the amplitude's step.
    content : entry of ``detectable``.
    """

    variant: Variant
    relative: float
    content: dict[str, Any]


def _evidence_by_variant(
    regression: Regression, gram: Gram, leave_out: Collection[str]
) -> list[_VariantEvidence]:
    """Return the expected evidence of every variant of the effects that are not left out."""
    listed = [
        (name, columns)
        for (name, _), columns in regression.by_variant().items()
        if name not in leave_out
    ]
    variants_of, bound = Counter(name for name, _ in listed), _bound_by_nuisances(regression)
    return [
        _VariantEvidence(
            name,
            tuple(columns),
            per_square,
            np.minimum(per_square, bound),
            cost + math.log(variants_of[name]) - log_rarity([name]),
        )
        for name, columns in listed
        for per_square, cost in [expected_evidence(gram, columns, regression.prior.sd)]
    ]


def _bound_by_nuisances(regression: Regression) -> np.ndarray:
    """Return the most evidence per squared unit that nuisances leave a column, (K,).

    A nuisance with the column's key can make the same move x, and pays x^2 / (2 sd^2). Without the
    bound, differences between linearisations would count as evidence without end.
    """
    # infinite without such a nuisance
    with np.errstate(divide="ignore"):
        return 0.5 / _nuisance_sds(regression) ** 2


def _nuisance_sds(regression: Regression) -> np.ndarray:
    """Return the prior sd (K,) of the nuisance of every column's key, 0 where there is none."""
    sds = {key: regression.prior.sd[k] for key, k in regression.system.nuisances.items()}
    return np.array([sds.get(c.key, 0.0) for c in regression.system.columns])


def expected_evidence(
    gram: Gram, columns: Sequence[int], prior_sd: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the log evidence of a set of columns when a single column acts, without noise.

    Parameters
    ----------
    gram : normal equations of the flights.
    columns : k columns of the set.
    prior_sd : (K,) prior sd of every column's coefficient.

    Returns
    -------
    per_square, cost : the evidence is ``per_square * size^2 - cost``, with (K,) values by the
        column that acts.

    References
    ----------
    Equation (6) of docs/method.md.
    """
    at = np.asarray(columns, dtype=int)
    scale = prior_sd[at]
    # equation (6) of docs/method.md for y = x_k size: b' A^-1 b / 2 = |L^-1 S X' x_k|^2 size^2 / 2,
    # and log det(L) is what the freedom costs, with L L' = I + S X'X S and S the prior sds
    chol = np.linalg.cholesky(np.eye(len(at)) + gram.xx[np.ix_(at, at)] * np.outer(scale, scale))
    half = np.linalg.solve(chol, (gram.xx[at] * scale[:, None]).T[:, :, None])[:, :, 0]
    return 0.5 * np.array([h @ h for h in half]), float(np.log(np.diag(chol)).sum())


def _size_exceeding(price: float, per_square: float, power_sds: float, weight: float) -> float:
    """Return the size at which evidence ``per_square size^2`` exceeds a price.

    It has to do so in most sets of flights, whose share is that of a normal below ``power_sds``.
    Its noise grows with the size, and with the weight of every row.
    """
    if per_square <= 0.0:
        return np.inf if price > 0.0 else 0.0
    # the larger root of g size^2 - z sqrt(2 w g) size = price: evidence has the sd
    # sqrt(2 w g) size, and half = z sqrt(w / (2 g))
    half = power_sds * math.sqrt(weight / (2.0 * per_square))
    square = half**2 + price / per_square
    return half + math.sqrt(square) if square >= 0.0 else 0.0


def _detectable_size(
    variant: _VariantEvidence, acting: int, listed: Sequence[_VariantEvidence], log_odds: float
) -> tuple[float, str]:
    """Return the coefficient's size at which its effect is accepted, and the hardest rival.

    Parameters
    ----------
    variant : of the effect that acts.
    acting : index of the column that acts.
    listed : all variants; those of the same effect are no rivals.
    log_odds : of an acceptance.

    Returns
    -------
    The size in the unit of the parameter, infinite where a rival explains as much. The name of that
    rival, '' where noise is the limit.
    """
    power_sds, row_weight = float(ndtri(settings.advise.power)), settings.evidence.tempering
    needed = log_odds + variant.cost
    rarity = log_odds_against_one_of(len({v.name for v in listed} | {variant.name}))
    # against nothing: there its number may move as a nuisance, at a price that its prior sets
    over_nothing = max(float(variant.over_nuisances[acting]), settings.numerics.tiny)
    largest = _size_exceeding(needed + rarity, over_nothing, power_sds, row_weight)
    hardest, own = "", float(variant.per_square[acting])
    for rival in (v for v in listed if v.name != variant.name):
        # against a rival: it takes up a part of the evidence, and pays for its own freedom
        over_rival = own - float(rival.per_square[acting])
        size = _size_exceeding(needed - rival.cost, over_rival, power_sds, row_weight)
        if size > largest:
            largest, hardest = size, rival.name
    return largest, hardest


@dataclasses.dataclass(frozen=True)
class _Sizes:
    """Reference sizes of every column, (K,).

    Attributes
    ----------
    least : coefficient at the practical significance threshold of its greatest channel, and
        certainly beyond its prior.
    share_of_weight : share of weight, or of weight times arm, per unit of it.
    """

    least: np.ndarray
    share_of_weight: np.ndarray


def _sizes(regression: Regression) -> _Sizes:
    system, rms = regression.system, regression.rms
    block = np.array([block_of(name) for name in system.main])
    shares = rms / system.least_rms[:, None]
    # a share of weight has a meaning in forces and moments alone, not in the drive or the range
    is_force_or_moment = np.isin(block, ("force", "acc", "moment"))
    scale = system.reference_scales[:, None]
    with np.errstate(divide="ignore"):
        return _Sizes(
            # shares are linear in the coefficient: it matters once the greatest of them is one
            np.maximum(
                1.0 / shares.max(axis=0),
                settings.statistics.certain_sds * _nuisance_sds(regression),
            ),
            (rms / scale)[is_force_or_moment].max(axis=0, initial=0.0),
        )


def smallest_detectable(
    regression: Regression, accepted: Mapping[str, DetectedEffect] | None = None
) -> dict[str, dict[str, Any]]:
    """Return the smallest detectable size of every effect.

    Parameters
    ----------
    regression : of the search, with the columns of every candidate.
    accepted : accepted effects. Others are evaluated given them, and each of them given the rest.

    Returns
    -------
    By effect: ``parameter``, ``smallest`` (None where it never would), ``unit``, ``shape`` (the
    fixed parameters), and ``limited_by``. The last is the rival that is hardest to separate, '' for
    noise.
    """
    pooled, unit, given = regression.pool(), _sizes(regression), accepted or {}
    content: dict[str, dict[str, Any]] = {}
    for name, effect in given.items():
        alone = _sizes_given(regression, pooled, unit, {*given} - {name}, name)
        content |= {name: _entry_of_detected(alone[name], effect)} if name in alone else {}
    others = _sizes_given(regression, pooled, unit, {*given}, None)
    # of the shapes the middle one by relative size
    for name, entries in others.items():
        ranked = sorted(entries, key=lambda entry: entry.relative)
        content[name] = ranked[(len(entries) - 1) // 2].content
    return content


def _entry_of_detected(entries: Sequence[_Entry], detected: DetectedEffect) -> dict[str, Any]:
    """Return the entry of the shape that was found, no larger than the size that was found."""
    entry = next((e for e in entries if e.variant == detected.variant), entries[0]).content
    size = detected.sizes.get(entry["parameter"], math.inf)
    limit = math.inf if entry["smallest"] is None else entry["smallest"]
    return {**entry, "smallest": size, "limited_by": ""} if size < limit else entry


def _sizes_given(
    regression: Regression,
    pooled: Gram,
    unit: _Sizes,
    given: Collection[str],
    only: str | None,
) -> dict[str, list[_Entry]]:
    """Return the smallest sizes of one effect (of all where None) by shape.

    Effects that are ``given`` are free.
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
    listed = _evidence_by_variant(regression, gram, given)
    log_odds = settings.statistics.acceptance_log_odds
    sizes: dict[str, list[_Entry]] = {}
    for variant in (v for v in listed if only in (None, v.name)):
        for k in (k for k in variant.columns if _is_reported(regression.system.columns[k])):
            size, rival = _detectable_size(variant, k, listed, log_odds)
            size, rival = max((size, rival), (float(unit.least[k]), ""))
            sizes.setdefault(variant.name, []).append(_entry(regression, k, size, rival, unit))
    return sizes


def _is_reported(column: DesignColumn) -> bool:
    """Return whether a column has a size: the main part of effects that nothing modifies."""
    return column.part != "moment" and not modifiers_of(variant_of(column))


def _entry(regression: Regression, k: int, size: float, rival: str, unit: _Sizes) -> _Entry:
    """Return the result for one column.

    An effect that clips is detectable as a whole or not at all. A size beyond the vehicle's weight,
    or the parameter's bounds, is None.
    """
    column = regression.system.columns[k]
    variant = variant_of(column)
    amplitude = variant.amplitudes[column.amplitude]
    room = max(amplitude.high - amplitude.neutral, amplitude.neutral - amplitude.low)
    # what clips shows only as a whole: it is seen at its level or not at all
    if "clips" in effect_table.get(variant.effect).hints:
        size = abs(amplitude.level) if size <= abs(amplitude.level) else np.inf
    is_detectable = np.isfinite(size) and size <= room and size * unit.share_of_weight[k] <= 1.0
    content = {
        "parameter": amplitude.parameter,
        "smallest": size if is_detectable else None,
        "unit": effect_table.get(variant.effect).parameter(amplitude.parameter).unit,
        "shape": dict(variant.shape),
        "limited_by": rival,
    }
    return _Entry(variant, size / abs(amplitude.step) if is_detectable else np.inf, content)
