"""The best that the declared numbers can do, where they are too far off for one linear step.

Residuals are linear in small corrections only: a thrust scale, a thrust curve and a top speed
multiply each other. One Gauss-Newton step from the vehicle file is taken for the answer where the
model, flown with it, gains what the linearisation predicted. Else steps are damped until each keeps
its promise, and all is linearised anew after every one (Levenberg 1944, Q. Appl. Math. 2, 164).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from ges.diagnose.design.system import build, nuisance_of, residuals_with
from ges.diagnose.design.table import table_of
from ges.diagnose.design.whiten import variance_covariate, whiten
from ges.diagnose.estimate.fit import Joint, calibrated, correction_bounds, joint_fit
from ges.diagnose.select.evidence import Regression, gram_of, whitened
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


def operating_point(regression: Regression, joint: Joint, declared: Model) -> dict[str, float]:
    """Corrections of the declared numbers about which all has to be linearised.

    Parameters
    ----------
    regression, joint : of the null fit, linearised at the vehicle file or where it was moved to.
    declared : the vehicle file's model.

    Returns
    -------
    ``effect.parameter`` to correction, in the parameter's unit; empty where the linear step does
    what it predicts.
    """
    moved = dict(regression.system.model.corrections)
    # a bound that stopped a step says nothing of where the best inside is, until that was searched
    searched = moved or not _stopped(regression, joint)
    given = _cost(regression, {})
    if searched and _holds(regression, given, joint, joint):
        return {}
    reach = math.inf
    for _ in range(settings.numerics.fit_rounds):
        damped, reach = _damped(regression, given, joint, reach)
        if damped is None:
            break
        moved = dict(damped.common)
        regression = _linearised(regression, declared, moved)
        joint = joint_fit(regression, ())
        given = _cost(regression, {})
        if given - joint.cost < settings.estimate.recalibration_tolerance * given:
            break
    return moved


def _damped(
    regression: Regression, given: float, joint: Joint, reach: float
) -> tuple[Joint | None, float]:
    """The step of all within a reach, in sds of the numbers' doubts, that is halved until the step
    keeps its promise, and the reach of the next one; None where none does.
    """
    for _ in range(settings.numerics.fit_rounds):
        tried = joint if math.isinf(reach) else _within_reach(regression, reach)
        if _holds(regression, given, joint, tried):
            return tried, 2.0 * reach
        reach = min(0.5 * reach, 1.0)
    return None, reach


def _within_reach(regression: Regression, reach: float) -> Joint:
    """The fit with every number drawn to where it stands (Levenberg 1944)."""
    moved = regression.system.model.corrections
    known = [nuisance_of(regression.system.columns[k]) for k in regression.nuisance]
    near = {n.key: (moved.get(n.key, 0.0), reach * n.sd) for n in known if n.sd > 0}
    return joint_fit(regression, (), held=near)


def at_corrections(declared: Model, moved: Mapping[str, float]) -> Model:
    """The vehicle file's model with corrections in it, where all is linearised."""
    return (
        dataclasses.replace(calibrated(declared, moved), corrections=moved) if moved else declared
    )


def _linearised(regression: Regression, declared: Model, moved: Mapping[str, float]) -> Regression:
    """Nuisances alone, linearised with these corrections, under the same noise."""
    system = regression.system
    there = at_corrections(declared, moved)
    return whitened(build(system.recordings, there, (), length_s=system.length_s), regression.noise)


def _step(regression: Regression, joint: Joint) -> dict[str, float]:
    """From where the model stands to the best of the linearisation."""
    moved = regression.system.model.corrections
    return {key: value - moved.get(key, 0.0) for key, value in joint.common.items()}


def _stopped(regression: Regression, joint: Joint) -> bool:
    """Whether a bound of the library stopped the step of some number."""
    model = regression.system.model
    bounds = {key: correction_bounds(key, model) for key in joint.common}
    return any(
        value != 0.0 and not bounds[key][0] < value < bounds[key][1]
        for key, value in _step(regression, joint).items()
    )


def _holds(regression: Regression, given: float, best: Joint, tried: Joint) -> bool:
    """Whether the model, flown with a step, gains enough of what the linearisation predicts of that
    step, whose best is known.

    Parameters
    ----------
    given : cost of standing still.
    """
    whole, step = _step(regression, best), _step(regression, tried)
    known = (nuisance_of(regression.system.columns[k]) for k in regression.nuisance)
    sd = {n.key: n.sd for n in known if n.sd > 0}
    # a parabola's fall by a part of the way to its least
    length = sum((whole[key] / sd[key]) ** 2 for key in whole)
    part = sum(step[key] * whole[key] / sd[key] ** 2 for key in whole) / length if length else 1.0
    predicted = part * (2.0 - part) * (given - best.cost)
    return given - _cost(regression, step) >= settings.numerics.gain_ratio_least * predicted


def _cost(regression: Regression, step: Mapping[str, float]) -> float:
    """Minus twice the log posterior, but for a constant, of the model a step away, flown again;
    what differs between flights at its best beside.

    Parameters
    ----------
    step : by ``effect.parameter``, from where the model stands.
    """
    system = regression.system
    known = {int(k): nuisance_of(system.columns[k]) for k in regression.nuisance}
    # what differs between flights is small: its columns stay as they were linearised
    varying = [k for k, n in known.items() if n.flight_sd > 0]
    precision = np.array([known[k].flight_sd ** -2.0 for k in varying])
    flown = residuals_with(system, calibrated(system.model, step)) if step else None
    rows = [
        dataclasses.replace(
            r,
            y=r.y if flown is None else flown[i],
            x=table_of([r.x.alone(k) for k in varying], *r.y.shape),
        )
        for i, r in enumerate(system.flights)
    ]
    cost = sum(((step.get(n.key, 0.0) - n.mean) / n.sd) ** 2 for n in known.values() if n.sd > 0)
    for white in whiten(rows, regression.noise, variance_covariate(system.flights)):
        gram = gram_of(white)
        own = np.linalg.solve(gram.xx + np.diag(precision), gram.xy)
        cost += gram.yy - float(gram.xy @ own)
    return float(cost)
