"""Which claims hang on numbers that the paper left out: the effects over like simulators.

A Metropolis walk goes through the free numbers of the calibration, from the fitted point, on
calibration seeds. It visits simulators whose figures come out near the published ones, to within
the tolerances times a slack. Few of them fit as well as the fitted one, so the misfit of the walk
is reported beside the effects. What is looked at is what the fit did not look at.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from ges.files import write_csv
from ges.study.config import Ensemble, Flights, Pulse, SeedRange, Simulator
from ges.study.fly import calibrate
from ges.study.fly.flights import counted
from ges.study.stats.target import ends

CLAIMED_SIGN = {
    "oracle - analytical, AGL RMS (m)": 0,
    "bias +0.02 - -0.02, AGL RMS (m)": -1,
    "bias +0.02 - -0.02, 5th percentile of clearance (m)": -1,
    "bias +0.02 - -0.02, low clearance (s)": 1,
}


def effects(simulator: Simulator, plan: Flights, arms: calibrate.Arms) -> dict[str, float]:
    """Return the effects that the paper claims, over the flights of every arm.

    Parameters
    ----------
    simulator, plan : of the flights.
    arms : records of :func:`calibrate.fly_arms`.

    Returns
    -------
    By name of :data:`CLAIMED_SIGN`.
    """
    reference, low = simulator.controller.agl_ref_m, plan.low_clearance_m
    rms = {name: calibrate.mean_rms(records, reference) for name, records in arms.items()}
    row_s = float(np.diff(arms["none"][0]["t_s"][:2])[0])
    p5 = {
        name: np.mean([np.percentile(r["agl_m"], 5) for r in arms[name]])
        for name in ("over", "under")
    }
    low_s = {
        name: np.mean([(r["agl_m"] < low).sum() * row_s for r in arms[name]])
        for name in ("over", "under")
    }
    values = (
        rms["oracle"] - rms["analytical"],
        rms["over"] - rms["under"],
        p5["over"] - p5["under"],
        low_s["over"] - low_s["under"],
    )
    return dict(zip(CLAIMED_SIGN, map(float, values), strict=True))


def _folded(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Reflect a step that leaves the bounds."""
    # a reflected walk is as likely there as back, which Metropolis' rule takes for granted
    x = np.where(x < low, 2 * low - x, x)
    return np.where(x > high, 2 * high - x, x)


def _walk(
    search: calibrate.GainSearch, how: Ensemble, start: dict[str, float]
) -> Iterator[dict[str, float]]:
    """A row a step: where the walk is, its misfit and its effects."""
    low, high = ends(calibrate.FREE)
    rng, row = np.random.default_rng(how.seed), None
    here = np.array([start[name] for name in calibrate.FREE])
    for step in counted(how.steps + 1, 1):
        there = (
            _folded(here + how.stride * (high - low) * rng.normal(size=len(here)), low, high)
            if step
            else here
        )
        numbers = calibrate.free_parameters(there)
        arms = search.arms(numbers)
        misfit = calibrate.misfit(search.flown(arms))
        luck = rng.uniform()
        # target density exp(-misfit / (2 slack^2)): each tolerance, times the slack, is a standard
        # deviation; a worse place is taken with the ratio of densities
        if row is None or np.log(luck) < (row["misfit"] - misfit) / (2 * how.slack**2):
            here = there
            row = {**numbers, "misfit": misfit, **effects(search.simulator, search.plan, arms)}
        # a step that is refused counts the old place once more
        yield {"step": step, **row}


def _shares(walk: pd.DataFrame) -> pd.DataFrame:
    """Return middle and 95 % range of every effect over the walk.

    ``share`` of it has the sign that the paper claims. ``fit_misfit`` is of the first simulator,
    ``misfit`` of the middle one.
    """
    fit = walk["misfit"].iloc[0], walk["misfit"].median()
    rows = []
    for effect, sign in CLAIMED_SIGN.items():
        values = walk[effect]
        # 0 stands for "no better": any value that is not below zero agrees
        share = float((np.sign(values) == sign).mean()) if sign else float((values >= 0).mean())
        low, middle, high = np.percentile(values, [2.5, 50, 97.5])
        claim = {1: "above 0", -1: "below 0", 0: "not below 0"}[sign]
        # refused steps repeat a misfit, so distinct ones count the simulators
        rows.append((effect, middle, low, high, claim, share, walk["misfit"].nunique(), *fit))
    return pd.DataFrame(
        rows,
        columns=[
            "effect",
            "median",
            "low",
            "high",
            "claimed",
            "share",
            "simulators",
            "fit_misfit",
            "misfit",
        ],
    )


def fly_ensemble(
    simulator: Simulator,
    plan: Flights,
    pulse: Pulse,
    ensemble: Ensemble,
    calibration_seeds: SeedRange,
    calibration: Path,
    flights: Path,
    summary: Path,
) -> None:
    """Walk through simulators that fit the published figures.

    Parameters
    ----------
    simulator, plan, pulse : what is not free.
    ensemble : length and steps of the walk.
    calibration_seeds : seeds of every step.
    calibration : what the calibration found (JSON); the walk starts there.
    flights : to write: a row a step of the walk.
    summary : to write: range of every effect, and the share of the walk with the claimed sign.
    """
    walk = pd.DataFrame(
        _walk(
            calibrate.GainSearch(simulator, plan, pulse, calibration_seeds.list()),
            ensemble,
            json.loads(Path(calibration).read_text())["fitted"],
        )
    )
    write_csv(flights, walk)
    write_csv(summary, _shares(walk))
