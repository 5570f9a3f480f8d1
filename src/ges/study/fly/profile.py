"""Is the curvature gain found, or only chosen? The misfit of the calibration over fixed gains, the
other free numbers held, and refitted.

Refits go along the derivatives at the fitted point (chord steps of Gauss-Newton, within the
bounds), so what they reach is at most as good as a full search: a small misfit shows that a gain
fits, a great one does not show that none would.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import lsq_linear

from ges.study.config import Flights, Pulse, SeedRange, Simulator
from ges.study.fly import calibrate
from ges.study.fly.ensemble import effects
from ges.study.fly.flights import write_csv

GAIN = list(calibrate.FREE).index("curvature_gain_m")
REFITS = 3  # steps of a refit


def _derivatives(search: calibrate.Search, point: np.ndarray) -> np.ndarray:
    """Of the residuals by every free number at a point, (k + n, n)."""
    here, columns = search.residuals(point), []
    for i in range(len(point)):
        step = calibrate.STEP if point[i] + calibrate.STEP <= 2.0 else -calibrate.STEP
        there = point.copy()
        there[i] += step
        columns.append((search.residuals(there) - here) / step)
    return np.column_stack(columns)


def _refits(
    search: calibrate.Search, point: np.ndarray, slopes: np.ndarray
) -> Iterator[tuple[float, dict[str, float], dict[str, float]]]:
    """Of a point and of every step from it with its gain held: sum of squared residuals, quantities
    flown, and effects.
    """
    free = np.arange(len(point)) != GAIN
    for _ in range(REFITS + 1):
        arms = search.arms(search.numbers(point))
        flown = search.flown(arms)
        residuals = search.pulled(point, flown)
        yield float(residuals @ residuals), flown, effects(search.simulator, search.plan, arms)
        bounds = 1.0 - point[free], 2.0 - point[free]
        point = point.copy()
        point[free] += lsq_linear(slopes[:, free], -residuals, bounds).x


def profile_gain(
    simulator: Simulator,
    plan: Flights,
    pulse: Pulse,
    profile_gains_m: list[float],
    calibration_seeds: SeedRange,
    calibration: Path,
    profile: Path,
) -> None:
    """Misfit of the calibration at every gain.

    Parameters
    ----------
    profile_gains_m : gains to hold (m).
    calibration : what the calibration found (JSON).
    profile : to write: a row a gain: ``curvature_gain_m``; ``held``, the misfit with the other
        numbers as found; ``refitted``, the least over the steps of a refit; and the effects of that
        refitted simulator.
    """
    search = calibrate.Search(simulator, plan, pulse, calibration_seeds.list())
    found = search.point(json.loads(Path(calibration).read_text())["fitted"])
    slopes, rows = _derivatives(search, found), []
    low, high = calibrate.FREE["curvature_gain_m"]
    for gain in profile_gains_m:
        start = found.copy()
        start[GAIN] = 1.0 + (gain - low) / (high - low)
        steps = list(_refits(search, start, slopes))
        _, best, seen = min(steps, key=lambda step: step[0])
        misfits = {
            "held": calibrate.misfit(steps[0][1]),
            "refitted": calibrate.misfit(best),
        }
        rows.append({"curvature_gain_m": gain, **misfits, **seen})
    write_csv(pd.DataFrame(rows), profile)
