"""Joint least squares with priors: nuisances common and by flight, and the chosen effects;
intervals by blocks of time.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from scipy.optimize import lsq_linear

from ges.diagnose.design.system import System, build, nuisance_of, variant_of
from ges.diagnose.design.table import Indices, spread
from ges.diagnose.design.whiten import NoiseModel, White, estimate
from ges.diagnose.library.candidates import Amplitude, Variant, amplitude_of, reach_of
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.select.evidence import (
    Regression,
    gram_of,
    make_regression,
    unanswered,
    whitened,
)
from ges.diagnose.select.search import Hypothesis
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Joint:
    """Coefficients of one fit: chosen columns, common nuisances as corrections of the vehicle file,
    nuisances by flight; covariance of the chosen, by blocks and by priors, and as independent rows
    would have it; and the cost, -2 log posterior but for a constant, which is the least.
    """

    chosen: np.ndarray
    covariance: np.ndarray
    by_rows: np.ndarray
    cost: float
    common: Mapping[str, float]
    common_sd: Mapping[str, float]
    by_flight: tuple[Mapping[str, float], ...]


def joint_fit(
    regression: Regression,
    chosen: Indices,
    prior_mean: np.ndarray | None = None,
    prior_sd: np.ndarray | None = None,
    held: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> Joint:
    """Fit chosen columns and all nuisances at once, but for those whose number a chosen column
    frees; common nuisances within the bounds of what the library flies.

    Parameters
    ----------
    chosen : columns of the system.
    prior_mean, prior_sd : (k,) prior of the chosen coefficients; the regression's, wide, where not
        given.
    held : prior mean and sd of common nuisances by key, as corrections of the vehicle file; those
        of the file where not given.
    """
    columns, chosen = regression.system.columns, np.asarray(chosen, dtype=int)
    freed = {columns[k].key for k in chosen}
    known = {int(k): nuisance_of(columns[k]) for k in regression.nuisance}
    common = np.array([k for k, n in known.items() if n.sd > 0 and n.key not in freed], dtype=int)
    varies = np.array([k for k, n in known.items() if n.flight_sd > 0], dtype=int)
    # unknowns in a row: the chosen, the common nuisances, then each flight's own, flight by flight
    sizes = (len(chosen), len(common), len(varies))
    start = np.cumsum((0, *sizes[:2]))
    total = sizes[0] + sizes[1] + sizes[2] * len(regression.whites)
    mean, precision = np.zeros(total), np.zeros(total)
    mean[: sizes[0]] = 0.0 if prior_mean is None else prior_mean
    wide_sd = settings.numerics.wide_factor * regression.prior.sd[chosen]
    precision[: sizes[0]] = 1.0 / (wide_sd if prior_sd is None else prior_sd) ** 2
    # corrections count from the vehicle file, coefficients from where its numbers were moved to
    moved, names = regression.system.model.corrections, [known[k].key for k in common]
    start_at = np.array([moved.get(name, 0.0) for name in names])
    for i, (k, name) in enumerate(zip(common, names, strict=True), start[1]):
        mean[i], sd = known[k].mean, known[k].sd
        if name in held:
            mean[i], sd = held[name][0] - start_at[i - start[1]], held[name][1]
        precision[i] = 1.0 / sd**2
    precision[start[2] :] = np.tile(
        [1.0 / known[k].flight_sd ** 2 for k in varies], len(regression.whites)
    )
    places = [
        np.r_[np.arange(start[2]), start[2] + f * sizes[2] + np.arange(sizes[2])]
        for f in range(len(regression.whites))
    ]
    kept = np.r_[chosen, common, varies]
    # priors are rows too; each flight reaches the shared unknowns and its own alone (an arrow)
    xx, xy, yy = np.diag(precision), precision * mean, float(precision @ mean**2)
    for w, at in zip(regression.whites, places, strict=True):
        gram = gram_of(w).take(kept)
        xx[np.ix_(at, at)] += gram.xx
        xy[at] += gram.xy
        yy += gram.yy
    unit = 1.0 / np.sqrt(np.diag(xx))  # coefficients differ by many orders in their units
    inverse = np.linalg.pinv(xx * np.outer(unit, unit), hermitian=True) * np.outer(unit, unit)
    beta = inverse @ xy
    # only common numbers are bounded; most fits stay inside, and only others pay for a search
    room = np.full((total, 2), [-math.inf, math.inf])
    for i, k in enumerate(common, start[1]):
        room[i] = correction_bounds(known[k].key, regression.system.model)
    if np.any((beta < room[:, 0]) | (beta > room[:, 1])):
        beta = _bounded(xx, xy, unit, room)
    by_rows = inverse[: sizes[0], : sizes[0]]
    covariance = (
        np.maximum(1.0, _inflation(regression, kept, places, beta, inverse, sizes[0])) * by_rows
    )
    flight_names = [known[k].key for k in varies]
    return Joint(
        beta[: sizes[0]],
        covariance,
        by_rows,
        # |y - x beta|^2 and the priors' share, also where a bound holds beta off the optimum
        yy - float((2.0 * xy - xx @ beta) @ beta),
        dict(zip(names, start_at + beta[start[1] : start[2]], strict=True)),
        dict(zip(names, np.sqrt(np.diag(inverse)[start[1] : start[2]]), strict=True)),
        tuple(dict(zip(flight_names, beta[at[start[2] :]], strict=True)) for at in places),
    )


def _bounded(xx: np.ndarray, xy: np.ndarray, unit: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Coefficients (n,) that solve normal equations best within bounds.

    Parameters
    ----------
    xx, xy : normal equations, (n, n) and (n,).
    unit : size of each coefficient, (n,).
    room : least and greatest value of each, (n, 2).
    """
    # a square root of the normal equations gives the solver rows; directions lost to rounding go
    size, axes = np.linalg.eigh(xx * np.outer(unit, unit))
    kept = size > len(size) * np.finfo(float).eps * size[-1]
    root = np.sqrt(size[kept])
    found = lsq_linear(
        root[:, None] * axes[:, kept].T,
        axes[:, kept].T @ (xy * unit) / root,
        bounds=room.T / unit,
        method="bvls",
    )
    return np.clip(found.x * unit, *room.T)


def _inflation(
    regression: Regression,
    kept: np.ndarray,
    places: Sequence[np.ndarray],
    beta: np.ndarray,
    inverse: np.ndarray,
    count: int,
) -> np.ndarray:
    """Factor by which blocks of time scatter more than independent rows would (sandwich over
    blocks), (k, k).
    """
    if not count:
        return np.ones((0, 0))
    # meat of the sandwich, the sum of s s' over blocks; each flight in its own places
    middle, blocks = np.zeros_like(inverse), regression.system.blocks(settings.statistics.block_s)
    for white, at, block in zip(regression.whites, places, blocks, strict=True):
        for score in _scores(white, kept, beta[at], block):
            middle[np.ix_(at, at)] += np.outer(score, score)
    # sds alone are widened, never narrowed: correlations stay those of the rows
    robust = (inverse @ middle @ inverse)[:count, :count]
    factor = np.sqrt(np.maximum(np.diag(robust) / np.diag(inverse)[:count], 1.0))
    return np.outer(factor, factor)


def _scores(white: White, kept: np.ndarray, beta: np.ndarray, block: np.ndarray) -> np.ndarray:
    """By block of time of one flight, what its residuals push the kept coefficients to, (b, k)."""
    number = np.unique(block, return_inverse=True)[1]
    scores = np.zeros((number.max(initial=-1) + 1, len(kept)))
    for part in white.parts:
        x, y = unanswered(part)
        d = spread(x, part.columns, kept)
        # rows come in order of time, so that a block is one run of them, summed at once
        first = np.flatnonzero(np.diff(number[part.at], prepend=-1))
        scores[number[part.at[first]]] += np.add.reduceat(
            d * (y - d @ beta)[:, None], first, axis=0
        )
    return scores


@dataclasses.dataclass(frozen=True)
class Fitted:
    """Parameters of the accepted effects with covariance, and what the nuisances came to: ``joint``
    as a vehicle flies with them, ``apart`` where small moments have coefficients of their own.
    """

    effects: effect_table.Effects
    free: tuple[tuple[str, str], ...]
    covariance: np.ndarray
    joint: Joint
    apart: Joint
    regression: Regression

    def sd(self, effect: str, parameter: str) -> float:
        """Standard deviation of one fitted parameter; the size of a physical effect is no better
        known than its form.
        """
        i = self.free.index((effect, parameter))
        return math.hypot(math.sqrt(self.covariance[i, i]), self._form_error(effect, parameter))

    def sds_from_neutral(self, effect: str, parameter: str) -> float:
        """Distance of an amplitude from neutral in its sd, the effect's shape held: how certain it
        is that something acts.

        A wind and the drag that it acts through are held for each other: slow flights tell their
        product well and neither alone. Of a declared number, as it is with what is plausible of it:
        twice the inertia give or take a third is no finding.
        """
        i = self.free.index((effect, parameter))
        held = [
            k
            for k, (e, p) in enumerate(self.free)
            if (e == effect and p in effect_table.get(effect).shapes) or _blown(e, effect)
        ]
        # Schur complement: the variance of a normal given what is held
        tied = self.covariance[i, held]
        own = (
            self.covariance[i, i]
            - tied @ np.linalg.pinv(self.covariance[np.ix_(held, held)], hermitian=True) @ tied
        )
        away = self.effects[effect][parameter] - amplitude_of(effect, parameter).neutral
        sd = math.hypot(math.sqrt(max(own, 0.0)), self._form_error(effect, parameter))
        # posterior mean over posterior sd under N(neutral, plausible^2), which shrinks both
        known = effect_table.get(effect).parameter(parameter)
        plausible = known.plausible if known.corrects and known.plausible else math.inf
        return abs(away) / (sd * math.hypot(1.0, sd / plausible))

    def _form_error(self, effect: str, parameter: str) -> float:
        """Sd of a parameter that is due to the form of its effect."""
        known = effect_table.get(effect)
        if known.about != "physics" or parameter in known.shapes:
            return 0.0
        return settings.estimate.form_error * abs(
            self.effects[effect][parameter] - amplitude_of(effect, parameter).neutral
        )

    def correlation(self, a: tuple[str, str], b: tuple[str, str]) -> float:
        """Correlation of two fitted parameters."""
        i, j = self.free.index(a), self.free.index(b)
        return float(self.covariance[i, j] / np.sqrt(self.covariance[i, i] * self.covariance[j, j]))


def _blown(one: str, other: str) -> bool:
    """Whether one is a wind and the other a drag that it acts through."""
    pair = (effect_table.get(one), effect_table.get(other))
    return any(e.moves_air for e in pair) and (
        one in pair[1].prerequisites or other in pair[0].prerequisites
    )


def starting_values(regression: Regression, hypothesis: Hypothesis) -> dict[str, dict[str, float]]:
    """Parameters of every accepted effect as the linear search left them."""
    found: dict[str, dict[str, float]] = {}
    carriers: dict[tuple[str, str], effect_table.Effects] = {}
    for k, value in zip(hypothesis.posterior.columns, hypothesis.posterior.mean, strict=True):
        column = regression.system.columns[k]
        if column.part == "moment":
            continue
        variant = variant_of(column)
        a = variant.amplitudes[column.amplitude]
        # what clips is not linear in its level: the one whose column was chosen, no multiple of it
        clips = "clips" in effect_table.get(variant.effect).hints
        value = a.level if clips else value
        declared = regression.system.model.effects.get(variant.effect, {})
        held = found.get(variant.effect) or {**variant.parameters({}), **declared}
        found[variant.effect] = {
            **held,
            a.parameter: float(np.clip(held[a.parameter] + value, a.low, a.high)),
        }
        # its column was made beside a carrier of usual size: the flights know the product of both
        carriers |= {(variant.effect, a.parameter): variant.given} if variant.given else {}
    for (effect, parameter), beside in carriers.items():
        found[effect][parameter] *= _through(found, beside)
    return found


def _through(found: dict[str, dict[str, float]], beside: effect_table.Effects) -> float:
    """Usual size of what an effect acts through over the size that was found, which is raised to a
    part of the usual one.
    """
    share, least = 1.0, settings.statistics.large_part
    for carrier, usual in beside.items():
        for parameter, value in usual.items():
            if carrier in found:
                found[carrier][parameter] = max(found[carrier][parameter], least * value)
                share *= value / found[carrier][parameter]
    return share


def free_parameters(
    regression: Regression, hypothesis: Hypothesis, model: Model, values: effect_table.Effects
) -> list[tuple[str, str]]:
    """Amplitudes of the hypothesis, all axes of its vectors, and those shapes that its variants try
    and the data may move.
    """
    found = []
    for k in hypothesis.posterior.columns:
        column = regression.system.columns[k]
        if column.part == "moment":
            continue
        variant = variant_of(column)
        found.append((variant.effect, variant.amplitudes[column.amplitude].parameter))
    chosen = list(dict.fromkeys(e for e, _ in found))
    vectors = {e: [p.name for p in effect_table.get(e).parameters if p.whole] for e in chosen}
    found = [f for f in found if not vectors[f[0]]]
    found += [(e, axis) for e, axes in vectors.items() for axis in axes]
    return found + [
        (effect, p.name)
        for effect in chosen
        for p in effect_table.get(effect).parameters
        if p.fitted and not _is_held(p, values[effect], model)
    ]


def _is_held(p: effect_table.Parameter, values: Mapping[str, float], model: Model) -> bool:
    """Whether a shape does nothing in the variant of these values, or is declared as known."""
    if p.corrects and model.plane_sd_m <= 0.0:
        return True
    return p.acts_above is not None and values[p.acts_above[0]] <= p.acts_above[1]


def _prior(
    name: tuple[str, str], values: effect_table.Effects, model: Model
) -> tuple[float, float]:
    """Mean and sd of a free parameter's deviation from its present value; a place moves little in
    one round.
    """
    value, reach = values[name[0]][name[1]], reach_of(name, values, model)
    if reach:
        return 0.0, reach
    known = effect_table.get(name[0]).parameter(name[1])
    # what corrects a declared number is pulled back to no correction, -value from here
    if known.fitted and known.corrects:
        return -value, model.plane_sd_m
    return (known.usual - value, known.usual_sd) if known.usual_sd else (0.0, math.inf)


def _moves(name: tuple[str, str], values: effect_table.Effects, model: Model) -> Amplitude:
    """A free parameter about its present value, with the step of its column; a place moves by a
    part of what it acts over.
    """
    a, reach = amplitude_of(*name), reach_of(name, values, model)
    step = settings.library.step_share * reach if reach else a.step
    return _small(dataclasses.replace(a, step=step), values[name[0]][name[1]])


@dataclasses.dataclass(frozen=True)
class _Point:
    """Free parameters at some values, linearised there."""

    values: effect_table.Effects
    free: tuple[tuple[str, str], ...]
    regression: Regression
    chosen: list[int]
    joint: Joint

    @functools.cached_property
    def cost(self) -> float:
        """-2 log posterior of these values, all else where it is best beside them."""
        # the joint cost is that of the full step; standing still costs its quadratic form more,
        # with the inverse marginal covariance as the Hessian in which all else is at its best
        k = len(self.free)
        steps = self.joint.chosen[:k]
        return self.joint.cost + float(
            steps @ np.linalg.pinv(self.joint.by_rows[:k, :k], hermitian=True) @ steps
        )

    @property
    def covariance(self) -> np.ndarray:
        """Of the free parameters, (k, k)."""
        return self.joint.covariance[: len(self.free), : len(self.free)]

    def numbers(self) -> np.ndarray:
        """The free parameters, (k,)."""
        return np.array([self.values[e][p] for e, p in self.free])

    def values_at(self, numbers: np.ndarray) -> effect_table.Effects:
        """The values with the free parameters at these numbers (k,)."""
        values = {name: dict(v) for name, v in self.values.items()}
        for (e, p), number in zip(self.free, numbers, strict=True):
            values[e][p] = float(number)
        return values

    def sds_to(self, values: effect_table.Effects) -> float:
        """Distance to other values, of the free parameter that is farthest from its own in
        its sd.
        """
        away = np.array([values[e][p] for e, p in self.free]) - self.numbers()
        return float(np.max(np.abs(away) / np.sqrt(np.diag(self.covariance)), initial=0.0))

    def best(self, model: Model) -> np.ndarray:
        """The free parameters (k,) that cost least as far as the linearisation holds, within their
        bounds.
        """
        known = [effect_table.get(e).parameter(p) for e, p in self.free]
        steps = self.joint.chosen[: len(self.free)]
        # all steps by one share, so that the direction stays that of descent
        steps = _share_in_reach(steps, self.free, self.values, model) * steps
        return _within(
            self.numbers() + steps,
            self.covariance,
            np.array([(p.fit_low, p.fit_high) for p in known]).T,
        )


def polish(
    like: System,
    values: effect_table.Effects,
    free: Sequence[tuple[str, str]],
    flights: Sequence[Prepared] | None = None,
    held: NoiseModel | None = None,
) -> Fitted:
    """Gauss-Newton over all free parameters, the compiled effects linearised anew each round; a
    step that costs more than it saves is halved, and the noise that a far start left is measured
    again.

    Parameters
    ----------
    like : system of the same flights, of the model without these effects; its nuisance columns
        serve again.
    values, free : parameters of the effects, and which of them are fitted.
    flights : the same flights along another path; the system's own where not given.
    held : noise to weigh with, so that costs of several fits compare; that of a start is measured
        where it is not given.
    """
    free, model = tuple(free), like.model
    at: _Point | None = None
    first: _Point | None = None
    for _ in range(settings.numerics.fit_rounds):
        variants = [Variant(e, {}, (_moves((e, p), values, model),)) for e, p in free]
        system = build(flights or like.recordings, model.with_effects(values), variants, like)
        # one noise for all rounds: costs under several would not compare
        known = held or (first.regression.noise if first else None)
        noise = known or estimate(system, free_first(system))
        there = _linearised(values, free, whitened(system, noise), model)
        # the step promised more than it kept: half of the way back, from the best point so far
        if at and first and there.cost > at.cost + settings.estimate.same_cost:
            values = at.values_at(0.5 * (at.numbers() + there.numbers()))
            continue
        at, first = there, first or there
        values = at.values_at(at.best(model))
        if at.sds_to(values) < settings.estimate.converged_sds:
            at = dataclasses.replace(at, values=values)
            # far from where its noise was measured, the fit goes on with that of the new place
            if at.sds_to(first.values) < settings.statistics.suggestive_sds:
                break
            first = None
    if at is None:
        raise ValueError("numerics.fit_rounds is 0; set 1 or more")
    joint = _with_levers_as_they_are(at.regression, at.chosen, at.joint, len(free))
    return Fitted(at.values, free, at.covariance, joint, at.joint, at.regression)


def _linearised(
    values: effect_table.Effects,
    free: tuple[tuple[str, str], ...],
    regression: Regression,
    model: Model,
) -> _Point:
    """The free parameters at their values, fitted together with all else."""
    chosen = free_first(regression.system)
    mean, sd = np.array(
        [_prior(name, values, model) for name in free]
        + [(0.0, math.inf)] * (len(chosen) - len(free))
    ).T
    return _Point(
        values,
        free,
        regression,
        chosen,
        joint_fit(regression, chosen, mean, np.where(np.isinf(sd), wide(regression, chosen), sd)),
    )


def _within(mean: np.ndarray, covariance: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """The mean (k,) with what leaves its bounds (2, k) held there, and the others where they are
    most probable beside that.
    """
    held = np.clip(mean, *bounds)
    out = held != mean
    if not out.any():
        return mean
    # mean of a normal given the parts that are held at their bounds
    moved = mean + covariance[:, out] @ np.linalg.solve(
        covariance[np.ix_(out, out)], (held - mean)[out]
    )
    return np.where(out, held, np.clip(moved, *bounds))


def _with_levers_as_they_are(
    regression: Regression, chosen: Sequence[int], joint: Joint, count: int
) -> Joint:
    """The nuisances as the fitted vehicle needs them, where small moments had coefficients of their
    own beside the ``count`` free ones: a vehicle flies with the levers that its file has, and trims
    make up for the rest. Declared numbers stay as they were with the moments free: a lag or an
    inertia is not what a lever is wrong by.
    """
    if len(chosen) == count:
        return joint
    firm, held = settings.estimate.converged_sds, pinned(joint)
    told = joint_fit(
        regression,
        chosen[:count],
        joint.chosen[:count],
        np.sqrt(np.diag(joint.covariance)[:count]) * firm,
        held,
    )
    # a pin is no knowledge: what was pinned keeps the doubt of the joint fit
    sds = {**told.common_sd, **{key: joint.common_sd[key] for key in held}}
    return dataclasses.replace(told, common_sd=sds)


def pinned(joint: Joint) -> dict[str, tuple[float, float]]:
    """Priors of the common nuisances of a fit that are narrow against their sds, by key, so that
    trims alone are free to follow.
    """
    firm = settings.estimate.converged_sds
    return {
        key: (value, firm * joint.common_sd[key])
        for key, value in joint.common.items()
        if not _is_trim(key)
    }


def _is_trim(key: str) -> bool:
    """Whether a nuisance, ``effect.parameter``, trims the vehicle."""
    effect, parameter = key.split(".")
    return effect != "vehicle" and bool(effect_table.get(effect).parameter(parameter).trim)


def wide(regression: Regression, chosen: Sequence[int]) -> np.ndarray:
    """Sd of k coefficients that the flights alone shall set, (k,)."""
    return settings.numerics.wide_factor * np.maximum(
        regression.prior.sd[chosen], settings.numerics.small
    )


def free_first(system: System) -> list[int]:
    """Columns of the free parameters in their order, after them the small moments that some of them
    make.
    """
    columns = [k for k, c in enumerate(system.columns) if c.variant is not None]
    return sorted(columns, key=lambda k: system.columns[k].part == "moment")


def _share_in_reach(
    steps: np.ndarray, free: Sequence[tuple[str, str]], values: effect_table.Effects, model: Model
) -> float:
    """Share of a step that moves no place further than its reach, within which the columns still
    hold.
    """
    reaches = np.array([reach_of(name, values, model) or math.inf for name in free])
    return float(
        min(1.0, np.min(reaches / np.maximum(np.abs(steps), settings.numerics.tiny), initial=1.0))
    )


def _small(a: Amplitude, value: float) -> Amplitude:
    """A step that stays within bounds on the inner side."""
    step = a.step if value + a.step <= a.high else -a.step
    return dataclasses.replace(a, step=step, neutral=value)


def calibrated(model: Model, common: Mapping[str, float]) -> Model:
    """The vehicle with its nuisances set, each through the compiled effect that corrects it."""
    more: dict[str, dict[str, float]] = {}
    for key, value in common.items():
        effect, parameter = key.split(".")
        if effect == "vehicle":
            model = model.with_number(parameter, model.number(parameter) + value)
            continue
        held = more.get(effect) or {
            **effect_table.get(effect).neutral(),
            **model.effects.get(effect, {}),
        }
        more[effect] = {
            **held,
            parameter: within_bounds(effect, parameter, held[parameter] + value),
        }
    return model.with_effects(more)


def correction_bounds(key: str, model: Model) -> tuple[float, float]:
    """Least and greatest correction of a number, ``effect.parameter``, that the library flies."""
    effect, parameter = key.split(".")
    if effect == "vehicle":
        return -model.number(parameter), math.inf
    p = effect_table.get(effect).parameter(parameter)
    held = {**effect_table.get(effect).neutral(), **model.effects.get(effect, {})}[parameter]
    # a number that is corrected by as much as it is, in its own unit, is nothing: less it cannot be
    own = [
        model.number(n) for n in p.corrects if n in model.parameters and n.endswith(f"_{p.unit}")
    ]
    return max([p.low - held, *(-number for number in own)]), p.high - held


def within_bounds(effect: str, parameter: str, value: float) -> float:
    """The value, without what rounding added to a bound."""
    p = effect_table.get(effect).parameter(parameter)
    return float(np.clip(value, p.low, p.high))


def fitted_model(model: Model, fitted: Fitted) -> Model:
    """The vehicle with what was fitted: effects, and the nuisances beside them."""
    return calibrated(model.with_effects(fitted.effects), fitted.joint.common)


def null_fit(system: System) -> tuple[Regression, Joint]:
    """Nuisances alone: the best that the declared parameters can do."""
    regression = make_regression(system)
    return regression, joint_fit(regression, ())


def raw_residuals(system: System, joint: Joint) -> list[np.ndarray]:
    """Residuals of the channels under the plain average, in their units, after the nuisances, by
    flight, (m, C).
    """
    count, out, moved = len(system.main), [], system.model.corrections
    for rows, own in zip(system.flights, joint.by_flight, strict=True):
        # the residual was taken where numbers were moved to: only the rest of a correction is due
        terms = {
            k: joint.common.get(key, 0.0) - moved.get(key, 0.0) + own.get(key, 0.0)
            for key, k in system.nuisances.items()
        }
        out.append(rows.y[:, :count] - rows.added(terms, count))
    return out


def only_in_air(left: Sequence[np.ndarray], system: System) -> list[np.ndarray]:
    """Residuals (m, C) by flight, NaN where windows are not in the air: a drive on the ground is in
    no regime of flight.
    """
    return [
        np.where(rows.air[:, None], e, np.nan) for rows, e in zip(system.flights, left, strict=True)
    ]
