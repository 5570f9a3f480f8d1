"""Is the curvature gain found, or only chosen? The misfit of the calibration over fixed gains, the
other free numbers held, and refitted.

The refits are searches of their own and no part of the study: what they found stands in
``config/gain_profile.json``, and is flown here.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from ges import files
from ges.files import write_csv
from ges.study.config import Flights, Pulse, SeedRange, Simulator
from ges.study.fly import calibrate
from ges.study.fly.ensemble import effects

GAIN = "curvature_gain_m"
EVALUATIONS = 4  # of a refit, each with its derivatives


def _refitted(
    search: calibrate.GainSearch, start: dict[str, float], gain: float
) -> dict[str, float]:
    """The free numbers that fit best with the gain held, from those of a start."""
    # the residuals keep the pull of the held gain, a constant that moves nothing
    here = search.point({**start, GAIN: gain})
    free = np.array([name != GAIN for name in calibrate.FREE])

    def point(others: np.ndarray) -> np.ndarray:
        there = here.copy()
        there[free] = others
        return there

    solution = least_squares(
        lambda others: search.residuals(point(others)),
        np.clip(here[free], 1.0 + calibrate.STEP, 2.0 - calibrate.STEP),
        bounds=(1.0, 2.0),
        diff_step=calibrate.STEP,
        max_nfev=EVALUATIONS,
    )
    # the gain itself, without the rounding of its place
    return {**search.numbers(point(solution.x)), GAIN: gain}


def fit_profile(
    simulator: Simulator,
    plan: Flights,
    pulse: Pulse,
    profile_gains_m: list[float],
    calibration_seeds: SeedRange,
    calibration: Path,
    profile: Path,
) -> None:
    """Refit the other free numbers at every curvature gain, each from the nearest that is done.

    Parameters
    ----------
    simulator, plan, pulse : what is not free.
    profile_gains_m : gains to hold.
    calibration_seeds : seeds of the flights.
    calibration : what the calibration found (JSON); the refits start there.
    profile : to write (JSON): the free numbers at every gain, and the seeds.
    """
    search = calibrate.GainSearch(simulator, plan, pulse, calibration_seeds.list())
    done = [json.loads(Path(calibration).read_text())["fitted"]]
    centre = done[0][GAIN]
    # outwards from the calibrated gain, so that each refit starts from its neighbour
    for gain in sorted(profile_gains_m, key=lambda g: abs(g - centre)):
        nearest = min(done, key=lambda numbers: abs(numbers[GAIN] - gain))
        done.append(_refitted(search, nearest, gain))
    refits = sorted(done[1:], key=lambda numbers: numbers[GAIN])
    files.write_json(profile, {"refitted": refits, "seeds": search.seeds})


def fly_profile(
    simulator: Simulator,
    plan: Flights,
    pulse: Pulse,
    calibration_seeds: SeedRange,
    calibration: Path,
    profile: Path,
    misfits: Path,
) -> None:
    """Fly every curvature gain with the other numbers as calibrated and as refitted.

    Parameters
    ----------
    simulator, plan, pulse : what is not free.
    calibration_seeds : seeds of the flights.
    calibration, profile : what the calibration and :func:`fit_profile` found (JSON).
    misfits : to write: a row a gain: ``curvature_gain_m``, misfits ``held`` and ``refitted``, and
        the effects of the refitted simulator. ``within`` is 1 where the latter misfit is below the
        number of ``figures``, each then within its tolerance on average.
    """
    search = calibrate.GainSearch(simulator, plan, pulse, calibration_seeds.list())
    calibrated = json.loads(Path(calibration).read_text())["fitted"]
    rows, figures = [], len(calibrate.PUBLISHED)
    for numbers in json.loads(Path(profile).read_text())["refitted"]:
        # held is a section through the misfit, refitted its profile: a section alone makes a
        # number look known that the others could make up for
        fixed = search.arms({**calibrated, GAIN: numbers[GAIN]})
        arms = search.arms(numbers)
        misfit = calibrate.misfit(search.flown(arms))
        rows.append(
            {
                GAIN: numbers[GAIN],
                "held": calibrate.misfit(search.flown(fixed)),
                "refitted": misfit,
                "figures": figures,
                "within": int(misfit < figures),
                **effects(simulator, plan, arms),
            }
        )
    write_csv(misfits, pd.DataFrame(rows))
