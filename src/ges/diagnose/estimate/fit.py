"""Joint least squares with priors: chosen effects and nuisances, common and by flight.

Intervals are by blocks of time.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import ndtr, stdtrit

from ges.conventions import SDS_95
from ges.diagnose.design.feedback import feedback_of
from ges.diagnose.design.system import (
    System,
    build,
    nuisance_of,
    variant_of,
    with_trims_of,
)
from ges.diagnose.design.table import Indices
from ges.diagnose.design.whiten import NoiseModel, White, estimate_noise
from ges.diagnose.library.candidates import (
    Amplitude,
    Variant,
    amplitude_of,
    fit_bounds,
    reach_of,
)
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.select.evidence import (
    Gram,
    Regression,
    block_grams,
    gram_of,
    make_regression,
    marginalise_deviations,
    whiten_system,
)
from ges.diagnose.select.search import Hypothesis
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class _Equations:
    """Normal equations of n unknowns within bounds; the cost is yy - 2 xy b + b xx b."""

    xx: np.ndarray
    xy: np.ndarray
    yy: float
    room: np.ndarray

    @classmethod
    def of_nothing(cls) -> _Equations:
        """Return the equations of no unknown."""
        return cls(np.zeros((0, 0)), np.zeros(0), 0.0, np.zeros((0, 2)))

    @property
    def unit(self) -> np.ndarray:
        """Size of each unknown, (n,): they differ by many orders in their units."""
        return 1.0 / np.sqrt(np.diag(self.xx))

    @functools.cached_property
    def inverse(self) -> np.ndarray:
        """Inverse of the (n, n) matrix."""
        unit = self.unit
        scaled = self.xx * np.outer(unit, unit)
        return np.linalg.pinv(scaled, hermitian=True) * np.outer(unit, unit)

    def solution(self, room: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """Return the unknowns (n,) of least cost, and that cost.

        The first ones may have other bounds, (k, 2).
        """
        room = self.room if room is None else np.vstack([room, self.room[len(room) :]])
        beta = self.inverse @ self.xy
        # most fits stay inside, and only others pay for a search
        if np.any((beta < room[:, 0]) | (beta > room[:, 1])):
            beta = _bounded_solution(self.xx, self.xy, self.unit, room)
        # also where a bound holds it off the optimum
        return beta, self.yy - float((2.0 * self.xy - self.xx @ beta) @ beta)

    def without(self, count: int) -> _Equations:
        """Return the equations with the first unknowns at zero."""
        return _Equations(self.xx[count:, count:], self.xy[count:], self.yy, self.room[count:])


@dataclasses.dataclass(frozen=True)
class JointFit:
    """Coefficients of one fit.

    Attributes
    ----------
    chosen : (k,) coefficients of the chosen columns.
    covariance : (k, k) of them, widened for the scatter between blocks of time.
    row_covariance : (k, k) as if rows were independent.
    cost : -2 log posterior at its minimum, but for a constant.
    common : common nuisances by key, as corrections of the vehicle file.
    common_sd : their standard deviations.
    by_flight : nuisances of each flight by key.
    equations : of all unknowns, the chosen coefficients first.
    """

    chosen: np.ndarray
    covariance: np.ndarray
    row_covariance: np.ndarray
    cost: float
    common: Mapping[str, float]
    common_sd: Mapping[str, float]
    by_flight: tuple[Mapping[str, float], ...]
    equations: _Equations = dataclasses.field(default_factory=_Equations.of_nothing)

    def cost_without(self, count: int) -> float:
        """Return the cost with the first coefficients at zero, and all else at its best.

        Parameters
        ----------
        count : how many of :attr:`chosen` stay at zero.
        """
        return self.equations.without(count).solution()[1]

    def steps_within(self, room: np.ndarray) -> np.ndarray:
        """Return the first coefficients of least cost within bounds, with all else at its best.

        Parameters
        ----------
        room : (k, 2) least and greatest value of the first k of :attr:`chosen`.

        Returns
        -------
        (k,).
        """
        return self.equations.solution(room)[0][: len(room)]


def joint_fit(
    regression: Regression,
    chosen: Indices,
    prior_mean: np.ndarray | None = None,
    prior_sd: np.ndarray | None = None,
    nuisance_priors: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> JointFit:
    """Fit chosen columns and all nuisances at once.

    Parameters
    ----------
    regression : whitened rows and priors.
    chosen : columns of the system. The nuisance of a number that one of them frees is left out.
    prior_mean, prior_sd : (k,) prior of the chosen coefficients; the regression's, wide, where not
        given.
    nuisance_priors : prior mean and sd of common nuisances by key, as corrections of the vehicle
        file. Those of the file where not given.

    Notes
    -----
    Common nuisances stay within the bounds of the library's parameters.
    """
    columns, chosen = regression.system.columns, np.asarray(chosen, dtype=int)
    freed = {columns[k].key for k in chosen}
    nuisances = {int(k): nuisance_of(columns[k]) for k in regression.nuisance}
    common = np.array(
        [k for k, n in nuisances.items() if n.sd > 0 and n.key not in freed], dtype=int
    )
    varies = np.array([k for k, n in nuisances.items() if n.flight_sd > 0], dtype=int)
    # unknowns in a row: the chosen, the common nuisances, then each flight's own, flight by flight
    sizes = (len(chosen), len(common), len(varies))
    start = np.cumsum((0, *sizes[:2]))
    total = sizes[0] + sizes[1] + sizes[2] * len(regression.whites)
    mean, precision = np.zeros(total), np.zeros(total)
    mean[: sizes[0]] = 0.0 if prior_mean is None else prior_mean
    wide_sd = settings.numerics.wide_factor * regression.prior.sd[chosen]
    precision[: sizes[0]] = 1.0 / (wide_sd if prior_sd is None else prior_sd) ** 2
    # corrections count from the vehicle file, coefficients from where its numbers were moved to
    corrections, names = regression.system.model.corrections, [nuisances[k].key for k in common]
    start_at = np.array([corrections.get(name, 0.0) for name in names])
    for i, (k, name) in enumerate(zip(common, names, strict=True), start[1]):
        mean[i], sd = nuisances[k].mean, nuisances[k].sd
        if name in nuisance_priors:
            mean[i] = nuisance_priors[name][0] - start_at[i - start[1]]
            sd = nuisance_priors[name][1]
        precision[i] = 1.0 / sd**2
    precision[start[2] :] = np.tile(
        [1.0 / nuisances[k].flight_sd ** 2 for k in varies], len(regression.whites)
    )
    places = [
        np.r_[np.arange(start[2]), start[2] + f * sizes[2] + np.arange(sizes[2])]
        for f in range(len(regression.whites))
    ]
    # what varies and is not shared comes last; numbers that do both stand once
    shared = np.r_[chosen, common]
    kept = np.r_[shared, np.setdiff1d(varies, shared)]
    by_block = _by_block(regression, kept) if sizes[0] else []
    wholes = [sum(grams[1:], grams[0]) for grams in by_block] or [
        gram.take(kept) for gram in each(gram_of, regression.whites)
    ]
    order = np.array([np.flatnonzero(kept == k)[0] for k in np.r_[shared, varies]], dtype=int)
    # priors are rows too; each flight reaches the shared unknowns and its own alone (an arrow)
    xx, xy, yy = np.diag(precision), precision * mean, float(precision @ mean**2)
    for whole, at in zip(wholes, places, strict=True):
        gram = whole.take(order)
        xx[np.ix_(at, at)] += gram.xx
        xy[at] += gram.xy
        yy += gram.yy
    # only common numbers are bounded
    room = np.full((total, 2), [-math.inf, math.inf])
    for i, k in enumerate(common, start[1]):
        room[i] = correction_bounds(nuisances[k].key, regression.system.model)
    # |y - x beta|^2 and the priors' share
    equations = _Equations(xx, xy, yy, room)
    inverse, (beta, cost) = equations.inverse, equations.solution()
    row_covariance = inverse[: sizes[0], : sizes[0]]
    covariance = row_covariance
    if sizes[0]:
        flight_sd = np.array([nuisances[k].flight_sd for k in varies])
        sds = _jackknife_sds(
            by_block, mean[: start[2]], precision[: start[2]], order[start[2] :], flight_sd
        )
        # sds alone are widened, never narrowed: correlations stay those of the rows
        factor = np.maximum(1.0, sds[: sizes[0]] / np.sqrt(np.diag(row_covariance)))
        covariance = row_covariance * np.outer(factor, factor)
    flight_names = [nuisances[k].key for k in varies]
    return JointFit(
        beta[: sizes[0]],
        covariance,
        row_covariance,
        cost,
        dict(zip(names, start_at + beta[start[1] : start[2]], strict=True)),
        dict(zip(names, np.sqrt(np.diag(inverse)[start[1] : start[2]]), strict=True)),
        tuple(dict(zip(flight_names, beta[at[start[2] :]], strict=True)) for at in places),
        equations,
    )


def _bounded_solution(
    xx: np.ndarray, xy: np.ndarray, unit: np.ndarray, room: np.ndarray
) -> np.ndarray:
    """Solve normal equations within bounds.

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
    solution = lsq_linear(
        root[:, None] * axes[:, kept].T,
        axes[:, kept].T @ (xy * unit) / root,
        bounds=room.T / unit,
        method="bvls",
    )
    return np.clip(solution.x * unit, *room.T)


def _jackknife_sds(
    by_block: Sequence[Sequence[Gram]],
    mean: np.ndarray,
    precision: np.ndarray,
    varies: np.ndarray,
    flight_sd: np.ndarray,
) -> np.ndarray:
    """Return sds of shared coefficients over fits that leave out a block of time each.

    Rows of a block depend on each other, and a coefficient that hangs on one block is not known.
    Sds are those of a Gaussian whose 95 % interval is that of Student's t.

    Parameters
    ----------
    by_block : normal equations by flight and block, with the s shared columns first.
    mean, precision : (s,) of their priors; precision is one over the variance.
    varies : (v,) places of the columns that vary from flight to flight.
    flight_sd : (v,) sds of these.

    References
    ----------
    CV3 of MacKinnon, Nielsen and Webb 2023, *Journal of Econometrics* 232, 272.
    """
    whole = [sum(grams[1:], grams[0]) for grams in by_block]
    own = [marginalise_deviations(gram, varies, flight_sd) for gram in whole]
    total = sum(own[1:], own[0])
    rests = [total] + [
        total - own[f] + marginalise_deviations(whole[f] - gram, varies, flight_sd)
        for f, grams in enumerate(by_block)
        for gram in grams
    ]
    # what varies and is not shared has no common part
    n = len(mean)
    xx = np.array([g.xx[:n, :n] for g in rests]) + np.diag(precision)
    xy = np.array([g.xy[:n] for g in rests]) + precision * mean
    # coefficients differ by many orders in their units
    unit = 1.0 / np.sqrt(np.diagonal(xx[0]))
    beta = unit * np.linalg.solve(xx * np.outer(unit, unit), (xy * unit)[..., None])[..., 0]
    freedom = len(rests) - 2
    if freedom < 1:
        return np.zeros(n)
    sds = np.sqrt(freedom / (freedom + 1) * np.square(beta[1:] - beta[0]).sum(axis=0))
    # few blocks know their own scatter badly: 95 % intervals are those of Student's t
    return sds * stdtrit(freedom, ndtr(SDS_95)) / SDS_95


def _by_block(regression: Regression, kept: np.ndarray) -> list[list[Gram]]:
    """Return normal equations of the kept columns by flight and block of time."""
    blocks = regression.system.blocks(settings.statistics.block_s)
    return each(lambda w, b: _block_grams(w, kept, b), regression.whites, blocks)


def _block_grams(white: White, kept: np.ndarray, block: np.ndarray) -> list[Gram]:
    """Return normal equations of the kept columns by block of time of one flight."""
    number = np.unique(block, return_inverse=True)[1]
    empty = Gram(np.zeros((len(kept),) * 2), np.zeros(len(kept)), 0.0, 0.0)
    grams = [empty] * int(number.max(initial=-1) + 1)
    for part in white.parts:
        places = np.flatnonzero(np.isin(kept, part.columns))
        for i, gram in block_grams(part, kept[places], number):
            grams[i] = grams[i] + gram.spread(places, len(kept))
    return grams


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
    regression : the rows at the last linearisation.
    """

    effects: effect_table.Effects
    free: tuple[tuple[str, str], ...]
    covariance: np.ndarray
    joint: JointFit
    joint_free_moments: JointFit
    regression: Regression

    def frees_nuisance_of(self, system: System) -> bool:
        """Return whether some fitted parameter is a nuisance of the vehicle.

        Parameters
        ----------
        system : of the flights, without these effects.
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
        """Return the distance of the optimum from the fitted value, in the parameter's sd.

        Parameters
        ----------
        effect, parameter : names of both.

        Notes
        -----
        Only a bound of the parameter keeps a fit that converged from its optimum.
        """
        i = self.free.index((effect, parameter))
        return abs(float(self.joint_free_moments.chosen[i])) / self.sd(effect, parameter)

    def sds_from_neutral(self, effect: str, parameter: str) -> float:
        """Return the distance of an amplitude from neutral in its sd, given the effect's shape.

        Parameters
        ----------
        effect, parameter : names of both.

        Notes
        -----
        A wind and the drag that it acts through are given for each other: slow flights determine
        their product alone. A correction of a nominal parameter is also shrunk by what is
        plausible. Twice the inertia give or take a third is no finding.
        """
        i = self.free.index((effect, parameter))
        given = [
            k
            for k, (e, p) in enumerate(self.free)
            if (e == effect and p in effect_table.get(effect).shapes)
            or _wind_and_its_drag(e, effect)
        ]
        # Schur complement: the variance of a normal given what is held
        cross = self.covariance[i, given]
        own = (
            self.covariance[i, i]
            - cross @ np.linalg.pinv(self.covariance[np.ix_(given, given)], hermitian=True) @ cross
        )
        away = self.effects[effect][parameter] - amplitude_of(effect, parameter).neutral
        sd = math.hypot(math.sqrt(max(own, 0.0)), self._form_error(effect, parameter))
        # posterior mean over posterior sd under N(neutral, plausible^2), which shrinks both
        descriptor = effect_table.get(effect).parameter(parameter)
        plausible = (
            descriptor.plausible if descriptor.corrects and descriptor.plausible else math.inf
        )
        return abs(away) / (sd * math.hypot(1.0, sd / plausible))

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


def _free_amplitude(name: tuple[str, str], values: effect_table.Effects, model: Model) -> Amplitude:
    """Return a free parameter about its present value, with the step of its column."""
    a, reach = amplitude_of(*name), reach_of(name, values, model)
    step = settings.library.step_share * reach if reach else a.step
    return _with_inner_step(dataclasses.replace(a, step=step), values[name[0]][name[1]])


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
        values = {name: dict(v) for name, v in self.values.items()}
        for (e, p), number in zip(self.free, free_values, strict=True):
            values[e][p] = float(number)
        return values

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


def polish(
    like: System,
    values: effect_table.Effects,
    free: Sequence[tuple[str, str]],
    flights: Sequence[Prepared] | None = None,
    fixed_noise: NoiseModel | None = None,
) -> Fitted:
    """Fit all free parameters by Gauss-Newton, with the effects linearised again in each round.

    Parameters
    ----------
    like : system of the same flights, of the model without these effects; its nuisance columns are
        reused.
    values, free : parameters of the effects, and which of them are fitted.
    flights : the same flights along another path; the system's own where not given.
    fixed_noise : noise model of all rounds, so that costs of several fits compare. It is estimated
        at the start where not given.

    Notes
    -----
    A step that costs more than it saves is halved, until it promises no difference. After a far
    start the noise is estimated again.
    """
    free, model = tuple(free), like.model
    dynamic = {e for e, p in free if feedback_of(f"{e}.{p}") == "dynamic"}
    at: _Point | None = None
    first: _Point | None = None
    flown, taken, steps = like, 1.0, np.zeros(len(free))
    bounds = np.array([fit_bounds(name, model) for name in free]).T
    for _ in range(settings.numerics.fit_rounds):
        variants = [Variant(e, {}, (_free_amplitude((e, p), values, model),)) for e, p in free]
        system = build(flights or like.recordings, model.with_effects(values), variants, like)
        # one noise and one feedback for all rounds: costs under several would not compare
        if first:
            system = system.with_endogenous_parts_of(first.regression.system)
        # what a column is without, its residual is without
        others = {e: v for e, v in values.items() if e not in dynamic}
        design = with_trims_of(system, model.with_effects(others), like) if dynamic else system
        noise_so_far = fixed_noise or (first.regression.noise if first else None)
        noise = noise_so_far or estimate_noise(design, free_columns(design))
        there = _linearise(values, free, whiten_system(design, noise), model)
        # a step that promised more than it kept: half of it, from the best point so far. A cost of
        # one is that of one sd, and less than columns that are secants tell
        if at and first and there.cost > at.cost + 1.0:
            share = 0.5 * taken
            # along the step the linearisation's cost is a parabola
            if share * (2.0 - share) * (at.cost - at.joint.cost) < 1.0:
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
            if at.sds_to(first.values) < SDS_95:
                break
            first, taken, steps = None, 1.0, np.zeros(len(free))
    if at is None:
        raise ValueError("numerics.fit_rounds is 0; set 1 or more")
    if not dynamic and len(at.chosen) == len(free):
        return Fitted(at.values, free, at.covariance, at.joint, at.joint, at.regression)
    regression = whiten_system(flown, at.regression.noise) if dynamic else at.regression
    joint = _refit_trims(regression, at.chosen, at.joint, len(free))
    return Fitted(at.values, free, at.covariance, joint, at.joint, regression)


def _linearise(
    values: effect_table.Effects,
    free: tuple[tuple[str, str], ...],
    regression: Regression,
    model: Model,
) -> _Point:
    """Return the free parameters at their values, fitted together with all nuisances."""
    chosen = free_columns(regression.system)
    mean, sd = np.array(
        [_deviation_prior(name, values, model) for name in free]
        + [(0.0, math.inf)] * (len(chosen) - len(free))
    ).T
    return _Point(
        values,
        free,
        regression,
        chosen,
        joint_fit(
            regression, chosen, mean, np.where(np.isinf(sd), wide_sds(regression, chosen), sd)
        ),
    )


def _refit_trims(
    regression: Regression, chosen: Sequence[int], joint: JointFit, count: int
) -> JointFit:
    """Refit the trims without the separate coefficients of small moments.

    The search gives moments coefficients of their own; a vehicle file cannot. Other nominal
    parameters are pinned at their joint estimates, so only trims absorb the difference. So it is
    with the trims that dynamic effects make.
    """
    firm, priors = settings.estimate.converged_sds, pinned_priors(joint)
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


def pinned_priors(joint: JointFit) -> dict[str, tuple[float, float]]:
    """Return narrow priors that keep all nuisances but trims at a fit.

    Parameters
    ----------
    joint : the fit.

    Returns
    -------
    Mean and sd by key.
    """
    firm = settings.estimate.converged_sds
    return {
        key: (value, firm * joint.common_sd[key])
        for key, value in joint.common.items()
        if not _is_trim(key)
    }


def _is_trim(key: str) -> bool:
    """Return whether a nuisance, ``effect.parameter``, trims the vehicle."""
    effect, parameter = ParameterKey.of(key)
    return effect != "vehicle" and bool(effect_table.get(effect).parameter(parameter).trim)


def wide_sds(regression: Regression, chosen: Sequence[int]) -> np.ndarray:
    """Return prior sds so wide that the flights alone determine the coefficients.

    Parameters
    ----------
    regression : with the prior of every column.
    chosen : k columns.

    Returns
    -------
    (k,), in the units of the coefficients.
    """
    return settings.numerics.wide_factor * np.maximum(
        regression.prior.sd[chosen], settings.numerics.small
    )


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


def _with_inner_step(a: Amplitude, value: float) -> Amplitude:
    """Return the amplitude at a value, with a step that stays within its bounds."""
    step = a.step if value + a.step <= a.high else -a.step
    return dataclasses.replace(a, step=step, neutral=value)


def with_corrections(model: Model, common: Mapping[str, float]) -> Model:
    """Return the vehicle with its nuisances set, each through the effect that corrects it.

    Parameters
    ----------
    model : of the vehicle.
    common : corrections by ``effect.parameter``.
    """
    more: dict[str, dict[str, float]] = {}
    for key, value in common.items():
        effect, parameter = ParameterKey.of(key)
        if effect == "vehicle":
            model = model.with_number(parameter, model.number(parameter) + value)
            continue
        current = more.get(effect) or {
            **effect_table.get(effect).neutral(),
            **model.effects.get(effect, {}),
        }
        more[effect] = {
            **current,
            parameter: within_bounds(effect, parameter, current[parameter] + value),
        }
    return model.with_effects(more)


def correction_bounds(key: str, model: Model) -> tuple[float, float]:
    """Return the least and greatest correction within the bounds of the library.

    Parameters
    ----------
    key : ``effect.parameter``.
    model : that is corrected.
    """
    effect, parameter = ParameterKey.of(key)
    if effect == "vehicle":
        return -model.number(parameter), math.inf
    p = effect_table.get(effect).parameter(parameter)
    current = {**effect_table.get(effect).neutral(), **model.effects.get(effect, {})}[parameter]
    # a number that is corrected by as much as it is, in its own unit, is nothing: less it cannot be
    own = [
        model.number(n) for n in p.corrects if n in model.parameters and n.endswith(f"_{p.unit}")
    ]
    return max([p.low - current, *(-number for number in own)]), p.high - current


def within_bounds(effect: str, parameter: str, value: float) -> float:
    """Return a value clipped to the bounds of its parameter.

    Parameters
    ----------
    effect, parameter : names of both.
    value : in the parameter's unit.
    """
    p = effect_table.get(effect).parameter(parameter)
    return float(np.clip(value, p.low, p.high))


def fitted_model(model: Model, fitted: Fitted) -> Model:
    """Return the vehicle with fitted effects and nuisances.

    Parameters
    ----------
    model : of the vehicle file, or where its numbers were moved to.
    fitted : the fit, whose corrections count from the vehicle file.
    """
    steps = {k: v - model.corrections.get(k, 0.0) for k, v in fitted.joint.common.items()}
    return with_corrections(model.with_effects(fitted.effects), steps)


def null_fit(system: System) -> tuple[Regression, JointFit]:
    """Fit the nuisances alone: the best that the nominal parameters can do.

    Parameters
    ----------
    system : of the flights.
    """
    regression = make_regression(system)
    return regression, joint_fit(regression, ())


def raw_residuals(system: System, joint: JointFit) -> list[np.ndarray]:
    """Return residuals of the main channels after the nuisances.

    Parameters
    ----------
    system : of the flights.
    joint : the fit.

    Returns
    -------
    By flight, (m, C) in the channels' units.
    """
    count, residuals, corrections = len(system.main), [], system.model.corrections
    for rows, own in zip(system.flights, joint.by_flight, strict=True):
        # the residual was taken where numbers were moved to: only the rest of a correction is due
        terms = {
            k: joint.common.get(key, 0.0) - corrections.get(key, 0.0) + own.get(key, 0.0)
            for key, k in system.nuisances.items()
        }
        residuals.append(rows.y[:, :count] - rows.weighted_columns(terms, count))
    return residuals


def only_in_air(residuals: Sequence[np.ndarray], system: System) -> list[np.ndarray]:
    """Mask the windows on the ground.

    Parameters
    ----------
    residuals : by flight, (m, C).
    system : of the flights.

    Returns
    -------
    By flight, (m, C), NaN on the ground.
    """
    return [
        np.where(rows.air[:, None], e, np.nan)
        for rows, e in zip(system.flights, residuals, strict=True)
    ]
