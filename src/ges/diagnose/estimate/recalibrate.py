"""Recalibration: nominal parameters that are too far off for one linear step.

Residuals are linear in small corrections only: a thrust scale, a thrust curve and a top speed
multiply each other. One Gauss-Newton step from the vehicle file is accepted if the model, flown
with it, gains what the linearisation predicted. Otherwise steps are damped until each does, and all
is linearised again after every one (Levenberg 1944, Q. Appl. Math. 2, 164).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from ges.diagnose.design.columns import nuisance_of
from ges.diagnose.design.noise import variance_covariate
from ges.diagnose.design.system import build, residuals_with
from ges.diagnose.design.table import table_of
from ges.diagnose.design.whiten import whiten
from ges.diagnose.estimate.joint import (
    JointFit,
    correction_bounds,
    joint_fit,
    speed_per_unit,
    with_corrections,
)
from ges.diagnose.library.candidates import fit_bounds
from ges.diagnose.prepare.channels import least_rms_in
from ges.diagnose.select.evidence import Regression, gram_of, whiten_system
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import SPEED, Model


def operating_point(regression: Regression, joint: JointFit, nominal: Model) -> dict[str, float]:
    """Return the corrections about which all has to be linearised.

    Parameters
    ----------
    regression, joint : of the null fit, linearised at the vehicle file or at an earlier point.
    nominal : the vehicle file's model.

    Returns
    -------
    ``effect.parameter`` to correction, in the parameter's unit. Empty where the linear step leads
    to the cost that it predicts.
    """
    corrections = dict(regression.system.model.corrections)
    # a bound that stopped a step says nothing of where the best inside is, until that was searched
    may_stop = corrections or not _stopped_at_bound(regression, joint)
    cost = _cost(regression, {})
    # a step may gain nearly all, and still end where quiet sensors tell the linearisation's error
    ahead, speed_rad_s = _cost_and_speed(regression, _step(regression, joint))
    error = abs(ahead - joint.cost)
    # nor may levels of each flight make up for the error of a step that all share
    is_shared = abs(speed_rad_s) < least_rms_in("drive", nominal)
    if may_stop and is_shared and error < settings.statistics.least_gain * joint.cost:
        return {}
    trust_radius, whole, mostly_linear = math.inf, joint, False
    for _ in range(settings.numerics.fit_rounds):
        fit, trust_radius = _damped_step(regression, cost, joint, trust_radius)
        if fit is None:
            break
        # only the first round can take the whole linear step
        mostly_linear |= fit is whole and is_shared
        corrections = dict(fit.common)
        regression = _relinearise(regression, nominal, corrections)
        joint = joint_fit(regression, ())
        cost = _cost(regression, {})
        if cost - joint.cost < settings.statistics.least_gain * cost:
            break
    # a number beyond its prior is no correction: the search tells what it is, from the file. Where
    # not even most of the linear step holds it multiplies others, and moves with them
    most = settings.statistics.certain_sds
    # the sd of what flights make of a number, as its prior predicts it: a prior that draws an
    # uncertain number halfway back does not put it within reach
    moved_sd = {
        key: math.sqrt(max(regression.system.prior_sd(key) ** 2 - joint.common_sd[key] ** 2, 0.0))
        for key in corrections
    }
    within = {
        key: value
        for key, value in corrections.items()
        if abs(value) <= most * moved_sd[key] or not _is_searched(key, value, nominal)
    }
    return within if mostly_linear else corrections


def _is_searched(key: str, value: float, nominal: Model) -> bool:
    """Return whether a fit of an effect reaches a correction; a motor is never searched faster."""
    if key == SPEED:
        return False
    low, high = fit_bounds(ParameterKey.of(key), nominal)
    return low <= value <= high


def checked_fit(regression: Regression, joint: JointFit) -> JointFit:
    """Return the fit, its step shortened until the model flown with it gains what is predicted.

    Parameters
    ----------
    regression, joint : of the null fit, linearised at corrections of the vehicle file.

    Notes
    -----
    A motor lag shorter than a row of the log moves nothing, and its column vanishes. Its prior
    would then draw it back to where it moves a lot.
    """
    step, _ = _damped_step(regression, _cost(regression, {}), joint, math.inf)
    return step or _fit_within(regression, settings.estimate.converged_sds)


def _damped_step(
    regression: Regression, cost: float, joint: JointFit, trust_radius: float
) -> tuple[JointFit | None, float]:
    """Return the step that gains as predicted, and the trust radius of the next one.

    The radius is in prior sds, and halved until the step gains as predicted. None where none does.
    """
    for _ in range(settings.numerics.fit_rounds):
        tried = joint if math.isinf(trust_radius) else _fit_within(regression, trust_radius)
        if _gains_as_predicted(regression, cost, joint, tried):
            return tried, 2.0 * trust_radius
        trust_radius = min(0.5 * trust_radius, 1.0)
    return None, trust_radius


def _fit_within(regression: Regression, trust_radius: float) -> JointFit:
    """Return the fit with every number drawn to its present value (Levenberg 1944).

    The trust radius is the sd of that pull, in prior sds.
    """
    corrections = regression.system.model.corrections
    nuisances = [nuisance_of(regression.system.columns[k]) for k in regression.nuisance]
    near = {
        n.key: (corrections.get(n.key, 0.0), trust_radius * n.sd) for n in nuisances if n.sd > 0
    }
    return joint_fit(regression, (), nuisance_priors=near)


def at_corrections(nominal: Model, corrections: Mapping[str, float]) -> Model:
    """Return the vehicle file's model with corrections, where all is linearised.

    Parameters
    ----------
    nominal : the vehicle file's model.
    corrections : by ``effect.parameter``.
    """
    return (
        dataclasses.replace(with_corrections(nominal, corrections), corrections=corrections)
        if corrections
        else nominal
    )


def _relinearise(
    regression: Regression, nominal: Model, corrections: Mapping[str, float]
) -> Regression:
    """Return the regression of the nuisances, linearised with these corrections.

    Noise and feedback errors stay the same: costs under several likelihoods would not compare.
    """
    system = regression.system
    there = at_corrections(nominal, corrections)
    return whiten_system(build(system.recordings, there, (), system), regression.noise)


def _step(regression: Regression, joint: JointFit) -> dict[str, float]:
    """Return the step from the present corrections to the optimum of the linearisation."""
    corrections = regression.system.model.corrections
    return {key: value - corrections.get(key, 0.0) for key, value in joint.common.items()}


def _stopped_at_bound(regression: Regression, joint: JointFit) -> bool:
    """Return whether a bound of the library stopped the step of some number."""
    model = regression.system.model
    bounds = {key: correction_bounds(key, model) for key in joint.common}
    return any(
        value != 0.0 and not bounds[key][0] < value < bounds[key][1]
        for key, value in _step(regression, joint).items()
    )


def _gains_as_predicted(
    regression: Regression, cost: float, best: JointFit, tried: JointFit
) -> bool:
    """Return whether the model, flown with a step, gains enough of what the linearisation predicts.

    Parameters
    ----------
    regression : linearised at the present corrections.
    cost : without a step.
    best : the full step.
    tried : the step to check.
    """
    full, step = _step(regression, best), _step(regression, tried)
    nuisances = (nuisance_of(regression.system.columns[k]) for k in regression.nuisance)
    sd = {n.key: n.sd for n in nuisances if n.sd > 0}
    # a parabola's fall by a part of the way to its least
    length = sum((full[key] / sd[key]) ** 2 for key in full)
    part = sum(step[key] * full[key] / sd[key] ** 2 for key in full) / length if length else 1.0
    predicted = part * (2.0 - part) * (cost - best.cost)
    return cost - _cost(regression, step) >= settings.numerics.gain_ratio_least * predicted


def _cost(regression: Regression, step: Mapping[str, float]) -> float:
    """Return the cost of :func:`_cost_and_speed`."""
    return _cost_and_speed(regression, step)[0]


def _cost_and_speed(regression: Regression, step: Mapping[str, float]) -> tuple[float, float]:
    """Return the cost of the model flown a step away, and how far its top speed is off in the mean.

    Parameters
    ----------
    regression : linearised at the present corrections.
    step : by ``effect.parameter``, from the present corrections.

    Returns
    -------
    -2 log posterior, up to a constant, and the mean effect of the flights' own numbers on the top
    speed, rad/s.

    Notes
    -----
    Each flight's own numbers are at their optimum. Their mean effect on the top speed is a nuisance
    of prior mean zero, its sd the practical significance threshold of the drive. A change that all
    flights share is one of the top speed.
    """
    system = regression.system
    nuisances = {int(k): nuisance_of(system.columns[k]) for k in regression.nuisance}
    # what differs between flights is small: its columns stay as they were linearised
    varying = [k for k, n in nuisances.items() if n.flight_sd > 0]
    precision = np.array([nuisances[k].flight_sd ** -2.0 for k in varying])
    flown = residuals_with(system, with_corrections(system.model, step)) if step else None
    rows = [
        dataclasses.replace(
            r,
            y=r.y if flown is None else flown[i],
            x=table_of(r.x.columns(varying), *r.y.shape),
        )
        for i, r in enumerate(system.flights)
    ]
    cost = sum(
        ((step.get(n.key, 0.0) - n.mean) / n.sd) ** 2 for n in nuisances.values() if n.sd > 0
    )
    keys = [nuisances[k].key for k in varying]
    per_unit = speed_per_unit(system, keys) if SPEED in keys else np.zeros((len(rows), len(keys)))
    has_drive = np.isfinite(per_unit).all(axis=1)
    per_unit = np.nan_to_num(per_unit) / max(1, has_drive.sum())
    speed_rad_s, variance = 0.0, least_rms_in("drive", system.model) ** 2
    whites = whiten(rows, regression.noise, variance_covariate(system.flights))
    for white, per_number in zip(whites, per_unit, strict=True):
        gram = gram_of(white)
        known = np.column_stack([gram.xy, per_number])
        own, per_speed = np.linalg.solve(gram.xx + np.diag(precision), known).T
        cost += gram.yy - float(gram.xy @ own)
        speed_rad_s += float(per_number @ own)
        variance += float(per_number @ per_speed)
    # the least cost of own numbers whose mean has that sd, by Sherman and Morrison
    return float(cost) + speed_rad_s**2 / variance, speed_rad_s
