"""Is the curvature gain found, or only chosen? The misfit of the calibration over fixed gains, the
other free numbers held, and refitted.

Refits begin at the nearest gain that is done and go along the derivatives at the fitted point
(chord steps of Gauss-Newton within the bounds), so what they reach is at most as good as a full
search: a small misfit shows that a gain fits, a great one does not show that none would.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import lsq_linear

from ges.study.config import Flights, Pulse, SeedRange, Simulator
from ges.study.fly import calibrate
from ges.study.fly.ensemble import effects
from ges.study.fly.flights import write_csv

GAIN = list(calibrate.FREE).index("curvature_gain_m")
REFITS = 5  # flights of a refit


def _derivatives(search: calibrate.Search, point: np.ndarray) -> np.ndarray:
    """Of the residuals by every free number at a point, (k + n, n)."""
    here, columns = search.residuals(point), []
    for i in range(len(point)):
        step = calibrate.STEP if point[i] + calibrate.STEP <= 2.0 else -calibrate.STEP
        there = point.copy()
        there[i] += step
        columns.append((search.residuals(there) - here) / step)
    return np.column_stack(columns)


@dataclasses.dataclass(frozen=True)
class _Flown:
    """A point, what was flown there, and its effects."""

    point: np.ndarray
    residuals: np.ndarray
    misfit: float
    effects: dict[str, float]

    @property
    def cost(self) -> float:
        return float(self.residuals @ self.residuals)


def _flown(search: calibrate.Search, point: np.ndarray) -> _Flown:
    arms = search.arms(search.numbers(point))
    figures = search.flown(arms)
    seen = effects(search.simulator, search.plan, arms)
    return _Flown(point, search.pulled(point, figures), calibrate.misfit(figures), seen)


def _refitted(search: calibrate.Search, start: _Flown, slopes: np.ndarray) -> _Flown:
    """The best of some steps along the derivatives with the gain held; a step that does not help is
    halved.
    """
    best, share, free = start, 1.0, np.arange(len(start.point)) != GAIN
    for _ in range(REFITS):
        point = best.point.copy()
        bounds = 1.0 - point[free], 2.0 - point[free]
        point[free] += share * lsq_linear(slopes[:, free], -best.residuals, bounds).x
        there = _flown(search, point)
        best, share = (there, 1.0) if there.cost < best.cost else (best, share / 2.0)
    return best


def _with_gain(point: np.ndarray, place: float) -> np.ndarray:
    moved = point.copy()
    moved[GAIN] = place
    return moved


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
        numbers as found; ``refitted``, the least over the steps of a refit; ``within``, whether
        that is below the number of ``figures``, each then within its tolerance on average; and the
        effects of that refitted simulator.
    """
    search = calibrate.Search(simulator, plan, pulse, calibration_seeds.list())
    found = search.point(json.loads(Path(calibration).read_text())["fitted"])
    slopes, refits, rows = _derivatives(search, found), [found], []
    figures = len(calibrate.PUBLISHED)
    low, high = calibrate.FREE["curvature_gain_m"]
    places = [1.0 + (gain - low) / (high - low) for gain in profile_gains_m]
    for gain, place in sorted(
        zip(profile_gains_m, places, strict=True), key=lambda pair: abs(pair[1] - found[GAIN])
    ):
        nearest = min(refits, key=lambda point: abs(point[GAIN] - place))
        held, start = (_flown(search, _with_gain(point, place)) for point in (found, nearest))
        best = _refitted(search, min(held, start, key=lambda flown: flown.cost), slopes)
        refits.append(best.point)
        misfits = {"held": held.misfit, "refitted": best.misfit, "figures": figures}
        misfits["within"] = int(best.misfit < figures)
        rows.append({"curvature_gain_m": gain, **misfits, **best.effects})
    write_csv(pd.DataFrame(rows).sort_values("curvature_gain_m"), profile)
