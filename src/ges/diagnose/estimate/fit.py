"""The full fit of accepted effects, linearised again in every round."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import SDS_95
from ges.diagnose.design.columns import variant_of
from ges.diagnose.design.feedback import feedback_of
from ges.diagnose.design.noise import NoiseModel, estimate_noise
from ges.diagnose.design.system import System, build, with_trims_of
from ges.diagnose.estimate.joint import JointFit, joint_fit, with_corrections
from ges.diagnose.library.candidates import (
    Amplitude,
    Variant,
    amplitude_of,
    fit_bounds,
    reach_of,
)
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.select.evidence import Regression, whiten_system
from ges.diagnose.select.search import Hypothesis
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Fitted:
    """Fitted parameters of the accepted effects.

    Attributes
    ----------
    effects : all parameters by effect.
    free : effect and parameter of the k that were fitted.
    covariance : (k, k) of them.
    joint : the fit as a vehicle flies it, with the levers of its file.
    joint_free_moments : the fit in which small moments have coefficients of their own.
    regression : the system and noise of the last linearisation, without whitened rows.
    chord_covariance : (k, k) with corrections of nominal parameters linearised along the chord to
        no correction; None where none is free.
    """

    effects: effect_table.Effects
    free: tuple[tuple[str, str], ...]
    covariance: np.ndarray
    joint: JointFit
    joint_free_moments: JointFit
    regression: Regression
    chord_covariance: np.ndarray | None = None

    def corrects_vehicle(self, system: System) -> bool:
        """Return whether a fitted parameter is also a nominal parameter of the system's vehicle.

        Parameters
        ----------
        system : of the flights, without these effects.

        Notes
        -----
        Mean winds that gusts leave in each flight are nuisances too, and do not count.
        """
        of_vehicle = set(system.nuisances) - set(system.model.flight_sds)
        return not {f"{e}.{p}" for e, p in self.free}.isdisjoint(of_vehicle)

    def sd(self, effect: str, parameter: str) -> float:
        """Return the standard deviation of a fitted parameter.

        Parameters
        ----------
        effect, parameter : names of both.

        Notes
        -----
        It includes the form error: the size of a physical effect is no better known than its form.
        """
        i = self.free.index((effect, parameter))
        return math.hypot(math.sqrt(self.covariance[i, i]), self._form_error(effect, parameter))

    def sds_beyond_bound(self, effect: str, parameter: str) -> float:
        """Return how many sds the optimum lies from the fitted value, given the shape.

        Parameters
        ----------
        effect, parameter : names of both.

        Notes
        -----
        They differ only where a bound of the parameter stops a fit that converged.
        """
        i, step = self.free.index((effect, parameter)), self.joint_free_moments.chosen
        given, slopes, sd = self._given_shape(effect, parameter, self.covariance)
        return abs(float(step[i] - slopes @ step[given])) / sd

    def sds_from_neutral(self, effect: str, parameter: str) -> float:
        """Return the distance of an amplitude from neutral in its sd, given the effect's shape.

        Parameters
        ----------
        effect, parameter : names of both.

        Notes
        -----
        A wind and the drag that it acts through are given for each other: slow flights determine
        their product alone. A correction of a nominal parameter is also shrunk by what is
        plausible. Twice the inertia give or take a third is no finding. Its sd is that of the
        chord, not of the tangent. For it may stand in a denominator, and how a number is written
        must not decide how far it is.

        References
        ----------
        Gregory and Veall 1985, *Econometrica* 53, 1465, of Wald's statistic.
        """
        covariance = self.covariance if self.chord_covariance is None else self.chord_covariance
        away = self.effects[effect][parameter] - amplitude_of(effect, parameter).neutral
        *_, sd = self._given_shape(effect, parameter, covariance)
        # posterior mean over posterior sd under N(neutral, plausible^2), which shrinks both
        descriptor = effect_table.get(effect).parameter(parameter)
        plausible = (
            descriptor.plausible if descriptor.corrects and descriptor.plausible else math.inf
        )
        return abs(away) / (sd * math.hypot(1.0, sd / plausible))

    def _given_shape(
        self, effect: str, parameter: str, covariance: np.ndarray
    ) -> tuple[list[int], np.ndarray, float]:
        """Return indices of what an amplitude is given for, its regression on them, and its sd."""
        i = self.free.index((effect, parameter))
        given = [
            k
            for k, (e, p) in enumerate(self.free)
            if (e == effect and p in effect_table.get(effect).shapes)
            or _wind_and_its_drag(e, effect)
        ]
        # Schur complement: the variance of a normal given what is held
        slopes = covariance[i, given] @ np.linalg.pinv(
            covariance[np.ix_(given, given)], hermitian=True
        )
        own = covariance[i, i] - slopes @ covariance[given, i]
        sd = math.hypot(math.sqrt(max(own, 0.0)), self._form_error(effect, parameter))
        return given, slopes, sd

    def _form_error(self, effect: str, parameter: str) -> float:
        """Return the sd of a parameter that is due to the form of its effect."""
        descriptor = effect_table.get(effect)
        if descriptor.about != "physics" or parameter in descriptor.shapes:
            return 0.0
        return settings.estimate.form_error * abs(
            self.effects[effect][parameter] - amplitude_of(effect, parameter).neutral
        )

    def correlation(self, a: tuple[str, str], b: tuple[str, str]) -> float:
        """Return the correlation of two fitted parameters.

        Parameters
        ----------
        a, b : effect and parameter of each.
        """
        i, j = self.free.index(a), self.free.index(b)
        return float(self.covariance[i, j] / np.sqrt(self.covariance[i, i] * self.covariance[j, j]))


def _wind_and_its_drag(one: str, other: str) -> bool:
    """Return whether one is a wind and the other a drag that it acts through."""
    pair = (effect_table.get(one), effect_table.get(other))
    return any(e.moves_air for e in pair) and (
        one in pair[1].prerequisites or other in pair[0].prerequisites
    )


def starting_values(regression: Regression, hypothesis: Hypothesis) -> dict[str, dict[str, float]]:
    """Return the parameters of a hypothesis as the linear search left them.

    Parameters
    ----------
    regression : of the search.
    hypothesis : with its posterior.

    Returns
    -------
    All parameters by effect.

    Notes
    -----
    The column of an effect with prerequisites was computed at their usual size. Only the product of
    both is known, so the coefficient is scaled to the sizes that were found.
    """
    values: dict[str, dict[str, float]] = {}
    given: dict[tuple[str, str], effect_table.Effects] = {}
    for k, value in zip(hypothesis.posterior.columns, hypothesis.posterior.mean, strict=True):
        column = regression.system.columns[k]
        if column.part == "moment":
            continue
        variant = variant_of(column)
        a = variant.amplitudes[column.amplitude]
        # what clips is not linear in its level: the one whose column was chosen, no multiple of it
        clips = "clips" in effect_table.get(variant.effect).hints
        value = a.level if clips else value
        nominal = regression.system.model.effects.get(variant.effect, {})
        current = values.get(variant.effect) or {**variant.parameters({}), **nominal}
        values[variant.effect] = {
            **current,
            a.parameter: float(np.clip(current[a.parameter] + value, a.low, a.high)),
        }
        # its column was made with a prerequisite of usual size: the flights determine the product
        # of both
        given |= {(variant.effect, a.parameter): variant.given} if variant.given else {}
    for (effect, parameter), usual in given.items():
        values[effect][parameter] *= _usual_over_fitted(values, usual)
    return values


def _usual_over_fitted(values: dict[str, dict[str, float]], usual: effect_table.Effects) -> float:
    """Return the usual size of the prerequisites over their size in ``values``.

    The latter is raised to a part of the usual one first.
    """
    share, least = 1.0, settings.estimate.prerequisite_share_least
    for prerequisite, sizes in usual.items():
        for parameter, value in sizes.items():
            if prerequisite in values:
                values[prerequisite][parameter] = max(
                    values[prerequisite][parameter], least * value
                )
                share *= value / values[prerequisite][parameter]
    return share


def free_parameters(
    regression: Regression, hypothesis: Hypothesis, model: Model, values: effect_table.Effects
) -> list[tuple[str, str]]:
    """Return the parameters that a fit moves.

    Parameters
    ----------
    regression : of the search.
    hypothesis : that was accepted.
    model : of the vehicle.
    values : parameters by effect to start from.

    Returns
    -------
    Effect and parameter: amplitudes of the hypothesis, all axes of its vectors, and shapes that the
    data may move.
    """
    free = []
    for k in hypothesis.posterior.columns:
        column = regression.system.columns[k]
        if column.part == "moment":
            continue
        variant = variant_of(column)
        free.append((variant.effect, variant.amplitudes[column.amplitude].parameter))
    chosen = list(dict.fromkeys(e for e, _ in free))
    vectors = {e: [p.name for p in effect_table.get(e).parameters if p.whole] for e in chosen}
    free = [f for f in free if not vectors[f[0]]]
    free += [(e, axis) for e, axes in vectors.items() for axis in axes]
    return free + [
        (effect, p.name)
        for effect in chosen
        for p in effect_table.get(effect).parameters
        if p.fitted and not _is_fixed(p, values[effect], model)
    ]


def _is_fixed(p: effect_table.Parameter, values: Mapping[str, float], model: Model) -> bool:
    """Return whether a shape has no influence at these values, or is exactly known."""
    if p.corrects and model.plane_sd_m <= 0.0:
        return True
    return p.acts_above is not None and values[p.acts_above[0]] <= p.acts_above[1]


def _deviation_prior(
    name: tuple[str, str], values: effect_table.Effects, model: Model
) -> tuple[float, float]:
    """Return the mean and sd of a free parameter's deviation from its present value.

    A place moves little in one round.
    """
    value, reach = values[name[0]][name[1]], reach_of(name, values, model)
    if reach:
        return 0.0, reach
    descriptor = effect_table.get(name[0]).parameter(name[1])
    # what corrects a nominal parameter is pulled back to no correction, -value from here
    if descriptor.fitted and descriptor.corrects:
        return -value, model.plane_sd_m
    return (
        (descriptor.usual - value, descriptor.usual_sd) if descriptor.usual_sd else (0.0, math.inf)
    )


def _chord_amplitude(name: tuple[str, str], values: effect_table.Effects) -> Amplitude | None:
    """Return a correction with the step to none, or None for what is none, or corrects nothing."""
    a, value = amplitude_of(*name), values[name[0]][name[1]]
    if not effect_table.get(name[0]).parameter(name[1]).corrects or value == a.neutral:
        return None
    return dataclasses.replace(a, step=a.neutral - value, neutral=value)


def _free_amplitude(name: tuple[str, str], values: effect_table.Effects, model: Model) -> Amplitude:
    """Return a free parameter about its present value, with the step of its column."""
    a, reach = amplitude_of(*name), reach_of(name, values, model)
    step = settings.library.step_share * reach if reach else a.step
    value = values[name[0]][name[1]]
    # the step stays within the parameter's bounds
    return dataclasses.replace(a, step=step if value + step <= a.high else -step, neutral=value)


@dataclasses.dataclass(frozen=True)
class _Point:
    """Free parameters at some values, linearised there."""

    values: effect_table.Effects
    free: tuple[tuple[str, str], ...]
    regression: Regression
    chosen: list[int]
    joint: JointFit

    @functools.cached_property
    def cost(self) -> float:
        """-2 log posterior at these values, with all nuisances at their optimum."""
        return self.joint.cost_without(len(self.free))

    @property
    def cost_of_noise(self) -> float:
        """Twice the log sd of all innovations: with it costs under several noises compare."""
        return 2.0 * sum(g.log_sd for white in self.regression.whites for g in white.groups)

    @property
    def covariance(self) -> np.ndarray:
        """Of the free parameters, (k, k)."""
        return self.joint.covariance[: len(self.free), : len(self.free)]

    @property
    def sds(self) -> np.ndarray:
        """Standard deviations of the free parameters, (k,)."""
        return np.sqrt(np.diag(self.covariance))

    def free_values(self) -> np.ndarray:
        """Return the free parameters, (k,)."""
        return np.array([self.values[e][p] for e, p in self.free])

    def values_at(self, free_values: np.ndarray) -> effect_table.Effects:
        """Return the values with the free parameters at these numbers (k,)."""
        return _values_with(self.values, self.free, free_values)

    def sds_to(self, values: effect_table.Effects) -> float:
        """Return the largest distance of a free parameter to other values, in its sd."""
        away = np.array([values[e][p] for e, p in self.free]) - self.free_values()
        return float(np.max(np.abs(away) / self.sds, initial=0.0))

    def steps_within(self, bounds: np.ndarray) -> np.ndarray:
        """Return the step of the free parameters (k,) to the least cost of the linearisation.

        The parameters stay within their bounds (2, k).
        """
        return self.joint.steps_within((bounds - self.free_values()).T)


def _secant_share(share: float, before: np.ndarray, now: np.ndarray) -> float:
    """Return the share of a step that ends it, by the share of the step before.

    Parameters
    ----------
    share : of the step before that was taken.
    before, now : both steps whole, (k,), in sds.

    References
    ----------
    Barzilai and Borwein 1988, *IMA J. Numer. Anal.* 8, 141, of Gauss-Newton steps; no more than
    twice the share.
    """
    length = float(before @ before)
    rest = float(before @ now) / length if length else 0.0
    return share / max(1.0 - rest, 0.5)


def _interpolated_share(share: float, promised: float, risen: float) -> float:
    """Return the share of a step at which a parabola through what it cost is least.

    Parameters
    ----------
    share : that was taken.
    promised : fall of the cost over the whole step, by the linearisation.
    risen : by how much the cost is higher after that share of it.

    References
    ----------
    Nocedal and Wright 2006, *Numerical Optimization*, section 3.5. Less than half of the share,
    and no less than ``numerics.shortening_most`` of it.
    """
    return max(
        promised * share**2 / (risen + 2.0 * promised * share),
        settings.numerics.shortening_most * share,
    )


@dataclasses.dataclass(frozen=True)
class _Rounds:
    """What all rounds of a fit share.

    Attributes
    ----------
    base : system of the same flights, of the model without the effects.
    free : parameters that are fitted.
    flights : along the path of the fit.
    fixed_noise : noise model of all rounds, or None.
    """

    base: System
    free: tuple[tuple[str, str], ...]
    flights: Sequence[Prepared]
    fixed_noise: NoiseModel | None

    @functools.cached_property
    def dynamic(self) -> frozenset[str]:
        """Effects whose free parameters respond to the controller."""
        return frozenset(e for e, p in self.free if feedback_of(f"{e}.{p}") == "dynamic")

    def build_at(self, values: effect_table.Effects, chords: bool = False) -> System:
        """Build the system with a column of each free parameter, or of its chord to none."""
        model = self.base.model
        amplitudes = [
            chords and _chord_amplitude(name, values) or _free_amplitude(name, values, model)
            for name in self.free
        ]
        variants = [Variant(e, {}, (a,)) for (e, _), a in zip(self.free, amplitudes, strict=True)]
        return build(self.flights, model.with_effects(values), variants, self.base)

    def linearise(
        self, values: effect_table.Effects, own: System, reuse: Regression | None
    ) -> tuple[_Point, System]:
        """Linearise under the noise and the feedback errors of a regression, or under new ones."""
        system = own.with_endogenous_parts_of(reuse.system) if reuse else own
        design = system
        if self.dynamic:
            # what a column is without, its residual is without
            without = {e: v for e, v in values.items() if e not in self.dynamic}
            design = with_trims_of(system, self.base.model.with_effects(without), self.base)
        chosen = free_columns(design)
        noise = self.fixed_noise or (reuse.noise if reuse else None)
        regression = whiten_system(
            design,
            noise or estimate_noise(design, chosen),
            reuse.whites if reuse else (),
        )
        priors = [_deviation_prior(name, values, self.base.model) for name in self.free]
        # moments have coefficients of their own, of which nothing is known before
        priors += [(0.0, math.inf)] * (len(chosen) - len(priors))
        joint = joint_fit(regression, chosen, *np.array(priors).T)
        return _Point(values, self.free, regression, chosen, joint), system


def _values_with(
    values: effect_table.Effects, free: Sequence[tuple[str, str]], numbers: np.ndarray
) -> effect_table.Effects:
    """Return values of effects with the free parameters at these numbers (k,)."""
    changed = {name: dict(v) for name, v in values.items()}
    for (e, p), number in zip(free, numbers, strict=True):
        changed[e][p] = float(number)
    return changed


def polish(
    base: System,
    values: effect_table.Effects,
    free: Sequence[tuple[str, str]],
    flights: Sequence[Prepared] | None = None,
    fixed_noise: NoiseModel | None = None,
    earlier: Fitted | None = None,
) -> Fitted:
    """Fit all free parameters by Gauss-Newton, with the effects linearised again in each round.

    Parameters
    ----------
    base : system of the same flights, of the model without these effects; its nuisance columns are
        reused.
    values, free : parameters of the effects, and which of them are fitted.
    flights : the same flights along another path; the system's own where not given.
    fixed_noise : noise model of all rounds, so that costs of several fits compare. It is estimated
        at the start where not given.
    earlier : fit of the same parameters along another path. Its noise and feedback errors are taken
        where the flights are likelier with them.

    Notes
    -----
    A step that costs more than it saves is shortened, until it promises no difference. After a far
    start the noise is estimated again, and kept where it makes the flights likelier: noise and
    parameters in turn climb one likelihood.
    """
    free, model = tuple(free), base.model
    rounds = _Rounds(base, free, flights or base.recordings, fixed_noise)
    at: _Point | None = None
    first: _Point | None = None
    ends: list[tuple[_Point, System]] = []
    flown, taken, steps = base, 1.0, np.zeros(len(free))
    bounds = np.array([fit_bounds(name, model) for name in free]).T
    # what a linear search or a balance asks for may be beyond what can be flown
    values = _values_with(values, free, np.clip([values[e][p] for e, p in free], *bounds))
    for _ in range(settings.numerics.fit_rounds):
        # one noise and one feedback for all rounds: costs under several would not compare
        fresh_or_earlier = [None, *([earlier.regression] if earlier else [])]
        reusable = [first.regression] if first else fresh_or_earlier
        own = rounds.build_at(values)
        there, system = _likeliest([rounds.linearise(values, own, reuse) for reuse in reusable])
        # a step that promised more than it kept: less of it, from the best point so far. A cost of
        # one is that of one sd, and less than columns that are secants tell
        if at and first and there.cost > at.cost + 1.0:
            promised = at.cost - at.joint.cost
            share = _interpolated_share(taken, promised, there.cost - at.cost)
            # along the step the linearisation's cost is a parabola
            if share * (2.0 - share) * promised < 1.0:
                break
        else:
            at, first, flown = there, first or there, system
            before, steps = steps, at.steps_within(bounds)
            share = _secant_share(taken, before / at.sds, steps / at.sds)
        # all by one share, so that the direction stays that of descent
        taken = share * _share_in_reach(share * steps, free, at.values, model)
        values = at.values_at(np.clip(at.free_values() + taken * steps, *bounds))
        if at.sds_to(values) < settings.estimate.converged_sds:
            at = dataclasses.replace(at, values=values)
            # far from where its noise was measured, the fit goes on with that of the new place
            ends.append((at, flown))
            if at.sds_to(first.values) < SDS_95 or at is not _likeliest(ends)[0]:
                break
            first, taken, steps = None, 1.0, np.zeros(len(free))
    if at is None:
        raise ValueError("numerics.fit_rounds is 0; set 1 or more")
    return _finished(rounds, *_likeliest([(at, flown), *ends]))


def _finished(rounds: _Rounds, at: _Point, flown: System) -> Fitted:
    """Return the fit at its last point: chords to none, and trims without separate moments."""
    free, chord = at.free, None
    if any(_chord_amplitude(name, at.values) for name in free):
        own = rounds.build_at(at.values, chords=True)
        chord = rounds.linearise(at.values, own, at.regression)[0].covariance
    regression, joint = at.regression, at.joint
    if rounds.dynamic:
        regression = whiten_system(flown, regression.noise, regression.whites)
    if rounds.dynamic or len(at.chosen) > len(free):
        joint = _refit_trims(regression, at.chosen, joint, len(free))
    # whitened rows are as large as a long flight, and nobody asks a finished fit for them
    regression = dataclasses.replace(regression, whites=())
    return Fitted(at.values, free, at.covariance, joint, at.joint, regression, chord)


def with_levers(fitted: Fitted, base: System) -> Fitted:
    """Return a fit with the levers that its moments ask for, and with trims for these.

    Parameters
    ----------
    fitted : whose small moments have coefficients of their own.
    base : system of the same flights, of the model without the effects.
    """
    values = _values_with_levers(fitted)
    if values == fitted.effects:
        return fitted
    before = fitted.regression
    rounds = _Rounds(base, fitted.free, before.system.recordings, before.noise)
    regression = whiten_system(rounds.build_at(values), before.noise)
    chosen = free_columns(regression.system)
    joint = _refit_trims(regression, chosen, fitted.joint_free_moments, len(fitted.free))
    regression = dataclasses.replace(regression, whites=())
    return dataclasses.replace(fitted, effects=values, joint=joint, regression=regression)


def _values_with_levers(fitted: Fitted) -> effect_table.Effects:
    """Return the fitted values with each lever that a moment's coefficient has over the force's.

    Coefficients of moments are deviations, as those of forces are. A lever stays as it is where it
    is not certainly another.
    """
    values, system, joint = fitted.effects, fitted.regression.system, fitted.joint_free_moments
    for i, column in enumerate(system.columns[k] for k in free_columns(system)):
        variant = variant_of(column)
        own, lever = values[variant.effect], effect_table.get(variant.effect).lever
        force = own[variant.amplitudes[column.amplitude].parameter]
        # a force of none has no lever
        if column.part != "moment" or not lever or not force:
            continue
        sds = abs(joint.chosen[i]) / math.sqrt(joint.covariance[i, i])
        if sds > settings.statistics.certain_sds:
            number = own[lever.name] * (1.0 + joint.chosen[i] / force)
            number = float(np.clip(number, lever.low, lever.high))
            values = {**values, variant.effect: {**own, lever.name: number}}
    return values


def _likeliest(ends: Sequence[tuple[_Point, System]]) -> tuple[_Point, System]:
    """Return the end of least cost, its noise included."""
    return min(ends, key=lambda end: end[0].cost + end[0].cost_of_noise)


def _refit_trims(
    regression: Regression, chosen: Sequence[int], joint: JointFit, count: int
) -> JointFit:
    """Refit the trims without the separate coefficients of small moments.

    The search gives moments coefficients of their own; a vehicle file cannot. Other nominal
    parameters are pinned at their joint estimates, so only trims absorb the difference. So it is
    with the trims that dynamic effects make.
    """
    firm = settings.estimate.converged_sds
    priors = {
        key: (value, firm * joint.common_sd[key])
        for key, value in joint.common.items()
        if not _is_trim(key)
    }
    refit = joint_fit(
        regression,
        chosen[:count],
        joint.chosen[:count],
        np.sqrt(np.diag(joint.covariance)[:count]) * firm,
        priors,
    )
    # a pin is no knowledge: what was pinned keeps the sd of the joint fit
    sds = {**refit.common_sd, **{key: joint.common_sd[key] for key in priors}}
    return dataclasses.replace(refit, common_sd=sds)


def _is_trim(key: str) -> bool:
    """Return whether a nuisance, ``effect.parameter``, trims the vehicle."""
    effect, parameter = ParameterKey.of(key)
    return effect != "vehicle" and bool(effect_table.get(effect).parameter(parameter).trim)


def free_columns(system: System) -> list[int]:
    """Return the columns of the free parameters in order, then those of their small moments.

    Parameters
    ----------
    system : with the columns of one variant for each free parameter.
    """
    columns = [k for k, c in enumerate(system.columns) if c.variant is not None]
    return sorted(columns, key=lambda k: system.columns[k].part == "moment")


def _share_in_reach(
    steps: np.ndarray, free: Sequence[tuple[str, str]], values: effect_table.Effects, model: Model
) -> float:
    """Return the share of a step that moves no place beyond its reach.

    The columns still hold there.
    """
    reaches = np.array([reach_of(name, values, model) or math.inf for name in free])
    return float(
        min(1.0, np.min(reaches / np.maximum(np.abs(steps), settings.numerics.tiny), initial=1.0))
    )


def fitted_model(model: Model, fitted: Fitted) -> Model:
    """Return the vehicle with fitted effects and nuisances.

    Parameters
    ----------
    model : of the vehicle file, or where its numbers were moved to.
    fitted : the fit, whose corrections count from the vehicle file.
    """
    steps = {k: v - model.corrections.get(k, 0.0) for k, v in fitted.joint.common.items()}
    values = {name: dict(own) for name, own in fitted.effects.items()}
    # nuisances beside what was fitted of one effect count from this model, as all do
    for effect, parameter in map(ParameterKey.of, steps):
        if effect in values:
            values[effect][parameter] = model.values_of(effect)[parameter]
    return with_corrections(model.with_effects(values), steps)
