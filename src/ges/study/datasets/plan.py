"""Fit of the published flight plan's free numbers to the published errors of the flat-ground
formula, on seeds that serve nothing else.

The paper does not say how its data set was flown. It does say how well the formula did on it: R^2
at 0, 100 and 500 ms, and RMSE and MAE at 100 ms. The formula learns nothing, so this fit looks at
no model and trains none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from ges import files
from ges.simulator import flight as sim
from ges.study.config import FlightPlan, SeedRange, Simulator
from ges.study.datasets.columns import CONTACT, TARGET
from ges.study.datasets.flights import data_flight
from ges.study.models.analytical import flat_ground_factor
from ges.study.stats.target import ends, misfit_of, place_of, record_of

PUBLISHED = {
    "r2_0": 0.883,
    "r2_0.1": 0.851025,
    "r2_0.5": 0.463,
    "rmse_0.1": 0.010424,
    "mae_0.1": 0.002337,
}
TOLERANCE = {
    "r2_0": 0.01,
    "r2_0.1": 0.01,
    "r2_0.5": 0.02,
    "rmse_0.1": 0.0003,
    "mae_0.1": 0.0003,
}
HORIZONS_S = (0.0, 0.1, 0.5)
FREE = {
    "cruise_m_s": (0.001, 0.1),
    "descent_m": (0.1, 0.19),
    "descent_period_s": (4.0, 60.0),
    "descent_share": (0.05, 1.0),
    "range_noise_m": (0.0002, 0.004),
}
EVALUATIONS = 60
_COLUMNS = ("range_m", TARGET, CONTACT)


def _plan_numbers(point: np.ndarray) -> dict[str, float]:
    """Numbers of the plan and the rangefinder's noise at a place within the bounds, 0 to 1."""
    low, high = ends(FREE)
    numbers = dict(zip(FREE, map(float, low + point * (high - low)), strict=True))
    # as a share of the period: nowhere within the bounds does a descent outlast it
    share = numbers.pop("descent_share")
    return {**numbers, "descent_duration_s": share * numbers["descent_period_s"]}


def _plan_point(numbers: Mapping[str, float]) -> np.ndarray:
    """Place of the numbers within the bounds, 0 to 1."""
    share = numbers["descent_duration_s"] / numbers["descent_period_s"]
    return place_of({**numbers, "descent_share": share}, FREE)


def fly_plan(
    simulator: Simulator,
    plan: FlightPlan,
    numbers: Mapping[str, float],
    seeds: Sequence[int],
    duration_s: float,
    rate_hz: float,
) -> list[sim.Record]:
    """Fly the plan with other numbers in place of its own, one flight a seed.

    Parameters
    ----------
    simulator, plan : what is not free.
    numbers : of :data:`FREE`, with ``descent_duration_s`` in place of the share.
    seeds : of the flights.
    duration_s : length of a flight.
    rate_hz : rows a second.
    """
    # the rangefinder's noise is a number of the sensors, the others are of the plan
    own = {k: v for k, v in numbers.items() if k in FlightPlan.model_fields}
    noise = {"range_noise_m": numbers["range_noise_m"]}
    world = simulator.model_copy(update={"sensors": simulator.sensors.model_copy(update=noise)})
    flown = plan.model_copy(update=own)
    return sim.fly([data_flight(s, world, flown, duration_s, rate_hz) for s in seeds], _COLUMNS)


def _pairs(
    record: sim.Record, predicted: np.ndarray, ahead: int, reserve: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return target and prediction of the rows that models are scored on.

    The rangefinder reads them, and nothing touches the ground up to the longest horizon.
    """
    # touches so far: equal counts at both ends say that there is none between
    touched = np.concatenate([[0], np.cumsum(record[CONTACT] > 0)])
    rows = np.arange(len(predicted) - reserve)
    rows = rows[np.isfinite(predicted[rows]) & (touched[rows + reserve + 1] == touched[rows])]
    return record[TARGET][rows + ahead], predicted[rows]


def formula_errors(
    records: Sequence[sim.Record], vehicle: Mapping[str, float], rate_hz: float
) -> dict[str, float]:
    """Return the errors of the flat-ground formula over all rows of the flights.

    Parameters
    ----------
    records : flights with range, factor and contact.
    vehicle : simulator numbers of the airframe.
    rate_hz : rows a second.

    Returns
    -------
    The quantities of :data:`PUBLISHED`; NaN where a flight failed.
    """
    steps = [round(h * rate_hz) for h in HORIZONS_S]
    predicted = [flat_ground_factor(r["range_m"], vehicle) for r in records]
    errors: dict[str, float] = {}
    for horizon, ahead in zip(HORIZONS_S, steps, strict=True):
        # every horizon on the rows that the longest allows, as in the sweep over horizons
        pairs = [_pairs(r, p, ahead, max(steps)) for r, p in zip(records, predicted, strict=True)]
        truth, guess = (np.concatenate([p[i] for p in pairs]) for i in range(2))
        error = guess - truth
        errors |= {
            # over the rows of all flights at once, as scores of models are
            f"r2_{horizon:g}": float(1.0 - np.mean(error**2) / np.var(truth)),
            f"rmse_{horizon:g}": float(np.sqrt(np.mean(error**2))),
            f"mae_{horizon:g}": float(np.mean(np.abs(error))),
        }
    return {name: errors[name] for name in PUBLISHED}


def misfit(errors: Mapping[str, float]) -> float:
    """Return the sum of squared distances from :data:`PUBLISHED`, each over its tolerance.

    Parameters
    ----------
    errors : of :func:`formula_errors`.
    """
    return misfit_of(errors, PUBLISHED, TOLERANCE)


def fit_plan(
    simulator: Simulator,
    plan: FlightPlan,
    plan_seeds: SeedRange,
    duration_s: float,
    rate_hz: float,
    fitted: Path,
) -> None:
    """Search the plan's free numbers, starting from those of the configuration.

    Parameters
    ----------
    simulator, plan : what is not free, and where the search starts.
    plan_seeds : seeds that serve nothing else.
    duration_s : length of a flight.
    rate_hz : rows a second.
    fitted : to write (JSON): free numbers, published and flown figures, bounds and seeds.
    """
    seeds, vehicle = plan_seeds.list(), simulator.vehicle.parameters()

    def flown(numbers: Mapping[str, float]) -> dict[str, float]:
        records = fly_plan(simulator, plan, numbers, seeds, duration_s, rate_hz)
        return formula_errors(records, vehicle, rate_hz)

    start = _plan_point({**simulator.parameters(), **plan.model_dump(exclude={"mode"})})
    # no derivatives: neighbouring plans differ much, since few features lie under each flight
    solution = minimize(
        lambda x: misfit(flown(_plan_numbers(x))),
        start,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(FREE),
        options={"maxfev": EVALUATIONS},
    )
    numbers = _plan_numbers(solution.x)
    report = record_of(
        numbers, flown(numbers), PUBLISHED, TOLERANCE, FREE, seeds, int(solution.nfev)
    )
    files.write_json(fitted, report)
