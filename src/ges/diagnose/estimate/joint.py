"""Joint least squares with priors: chosen columns and nuisances, common and by flight.

Intervals are by blocks of time. Nuisances are corrections of nominal parameters, within the bounds
of the library.
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
from ges.diagnose.design.columns import nuisance_of
from ges.diagnose.design.system import System
from ges.diagnose.design.table import Indices
from ges.diagnose.select.evidence import (
    Gram,
    Regression,
    block_grams,
    gram_of,
    make_regression,
    marginalise_deviations,
)
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import SPEED, Model, block_of
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
    row_covariance : (k, k) as if rows were independent; tests compare it.
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
    prior_mean, prior_sd : (k,) prior of the chosen coefficients. An sd that is infinite or not
        given is the regression's, so wide that the flights alone determine the coefficient.
    nuisance_priors : prior mean and sd of common nuisances by key, as corrections of the vehicle
        file. Those of the file where not given.

    Notes
    -----
    Common nuisances stay within the bounds of the library's parameters. What flights' own numbers
    make of the top speed is shared in the mean, see :func:`with_shared_speed`.
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
    usual_sd = np.maximum(regression.prior.sd[chosen], settings.numerics.small)
    wide_sd = settings.numerics.wide_factor * usual_sd
    chosen_sd = wide_sd if prior_sd is None else np.where(np.isinf(prior_sd), wide_sd, prior_sd)
    precision[: sizes[0]] = 1.0 / chosen_sd**2
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
    rows_of_flight = [
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
    for whole, at in zip(wholes, rows_of_flight, strict=True):
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
    joint = JointFit(
        beta[: sizes[0]],
        covariance,
        row_covariance,
        cost,
        dict(zip(names, start_at + beta[start[1] : start[2]], strict=True)),
        dict(zip(names, np.sqrt(np.diag(inverse)[start[1] : start[2]]), strict=True)),
        tuple(dict(zip(flight_names, beta[at[start[2] :]], strict=True)) for at in rows_of_flight),
        equations,
    )
    return with_shared_speed(joint, regression.system)


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
    varies : (v,) indices of the columns that vary from flight to flight.
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
    return each(lambda w, b: block_grams(w, kept, b), regression.whites, blocks)


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
        current = more.get(effect) or model.values_of(effect)
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
    current = model.values_of(effect)[parameter]
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


def speed_per_unit(system: System, keys: Sequence[str]) -> np.ndarray:
    """Return what each number adds to the top speed in the mean of each flight.

    Parameters
    ----------
    system : of the F flights.
    keys : k nuisances, ``effect.parameter``.

    Returns
    -------
    (F, k) rad/s over the unit of the parameter; NaN for a flight without commands or speeds, which
    has no drive.
    """
    drives = [c for c, name in enumerate(system.main) if block_of(name) == "drive"]
    wanted = [system.nuisances[key] for key in (SPEED, *keys)]
    means = np.array([r.mean_columns(drives, wanted).mean(axis=0) for r in system.flights])
    unit, others = means[:, :1], means[:, 1:]
    return np.divide(others, unit, out=np.full_like(others, np.nan), where=unit != 0.0)


def with_shared_speed(joint: JointFit, system: System) -> JointFit:
    """Return the fit with what flights' own numbers make of the top speed, in their mean, shared.

    Parameters
    ----------
    joint : the fit.
    system : of the flights.

    Notes
    -----
    Flights to come have no numbers of their own yet. Residuals stay the same.
    """
    keys = tuple(joint.by_flight[0])
    if SPEED not in keys:
        return joint
    numbers = np.array([[own[key] for key in keys] for own in joint.by_flight])
    shared = float(np.nanmean((speed_per_unit(system, keys) * numbers).sum(axis=1)))
    return dataclasses.replace(
        joint,
        common={**joint.common, SPEED: joint.common[SPEED] + shared},
        by_flight=tuple({**own, SPEED: own[SPEED] - shared} for own in joint.by_flight),
    )


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
        # the residual was taken where numbers were moved to: only the rest of a correction is due,
        # and none of a number that a name moves
        rest = {key: value - corrections.get(key, 0.0) for key, value in joint.common.items()}
        terms = {k: rest.get(key, 0.0) + own.get(key, 0.0) for key, k in system.nuisances.items()}
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
