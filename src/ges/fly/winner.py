"""A controller that does win: the gains of the height loop chosen anew for every mode, on validation seeds alone."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from pathlib import Path

from ..config import ClosedLoop, SeedRange, Simulator
from ..files import write_json
from ..stats.paired import compare, contrasts, means
from .comparison import REFERENCE, mode_conditions
from .flights import Condition, fly_conditions, write_csv

METRICS = ("agl_rms_m", "gyro_rms_rad_s", "clearance_p5_m", "clearance_min_m", "low_clearance_s")
PUBLISHED, RETUNED = "as published", "retuned"
HELPED = "oracle, per rotor, with lead"


def arms(simulator: Simulator, plan: ClosedLoop, clamp: Path) -> list[Condition]:
    """Every mode, and the oracle with every help that it can have."""
    oracle = Condition(HELPED, {"mode": "oracle", "per_rotor": 1.0, "lead_s": simulator.vehicle.motor_time_constant_s})
    return [*mode_conditions(plan, clamp), oracle]


def _scaled(simulator: Simulator, kp: float, kd: float) -> dict[str, float]:
    return {"altitude_kp": kp * simulator.controller.altitude_kp, "altitude_kd": kd * simulator.controller.altitude_kd}


def _candidates(arm: Condition, simulator: Simulator, plan: ClosedLoop) -> Iterator[Condition]:
    for kp, kd in itertools.product(plan.retune.kp_factors, plan.retune.kd_factors):
        labels = {"mode": arm.name, "kp_factor": kp, "kd_factor": kd}
        parameters = {**arm.parameters, **_scaled(simulator, kp, kd)}
        yield Condition(f"{arm.name}, kp x {kp:g}, kd x {kd:g}", parameters, labels=labels)


def choose_gains(simulator: Simulator, plan: ClosedLoop, validation: SeedRange, clamp: Path, flights: Path, choice: Path) -> None:
    """Fly every mode with every pair of gains; for each mode take the pair of least mean AGL RMS.

    Parameters
    ----------
    flights : to write: a row a flight.
    choice : to write (JSON): the seeds, and kp_factor, kd_factor and mean AGL RMS of the choice of every mode.
    """
    candidates = [c for arm in arms(simulator, plan, clamp) for c in _candidates(arm, simulator, plan)]
    table = fly_conditions(candidates, validation.list(), simulator, plan)
    score = means(table, ["agl_rms_m"]).set_index("condition")["mean"]
    best = {}
    for candidate in candidates:
        value, mode = float(score[candidate.name]), candidate.labels["mode"]
        if mode not in best or value < best[mode]["agl_rms_m"]:
            best[mode] = {**candidate.labels, "agl_rms_m": value}
    write_csv(table, flights)
    write_json(choice, {"seeds": validation.list(), "gains": best})


def fly_winner(
    simulator: Simulator,
    plan: ClosedLoop,
    closed_loop: SeedRange,
    clamp: Path,
    choice: Path,
    flights: Path,
    summary: Path,
    tests: Path,
) -> None:
    """Every mode with the published and with its own gains over the evaluation seeds.

    Parameters
    ----------
    flights : to write: a row a flight; ``gains`` says which.
    summary : to write: means, with the paired difference from the analytical mode as published.
    tests : to write: every retuned mode against itself as published, and against the retuned analytical mode.
    """
    chosen, conditions = json.loads(Path(choice).read_text())["gains"], []
    for arm in arms(simulator, plan, clamp):
        own = _scaled(simulator, chosen[arm.name]["kp_factor"], chosen[arm.name]["kd_factor"])
        for gains, numbers in ((PUBLISHED, {}), (RETUNED, own)):
            labels = {"mode": arm.name, "gains": gains}
            conditions.append(Condition(f"{arm.name}, {gains}", {**arm.parameters, **numbers}, labels=labels))
    table = fly_conditions(conditions, closed_loop.list(), simulator, plan)
    pairs = [(f"{m}, {RETUNED}", f"{m}, {PUBLISHED}") for m in chosen]
    pairs += [(f"{m}, {RETUNED}", f"{REFERENCE}, {RETUNED}") for m in chosen if m != REFERENCE]
    write_csv(table, flights)
    write_csv(compare(table, METRICS, f"{REFERENCE}, {PUBLISHED}"), summary)
    write_csv(contrasts(table, METRICS, pairs), tests)
