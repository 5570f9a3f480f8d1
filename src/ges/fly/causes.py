"""Why the oracle does not win: one cause taken away at a time, the oracle against the analytical mode each time."""

from __future__ import annotations

from pathlib import Path

from ..config import ClosedLoop, SeedRange, Simulator
from ..stats.paired import contrasts, means
from .flights import Condition, fly_conditions, write_csv

METRICS = ("agl_rms_m", "clearance_p5_m", "low_clearance_s", "gyro_rms_rad_s")
FAST_MOTOR_S = 0.002
FLOOR = "no ground effect"


def removals(simulator: Simulator) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """Cause: (numbers of both modes, numbers of the oracle alone) with which it is gone."""
    lag = simulator.vehicle.motor_time_constant_s
    every = {"telemetry_every": 1.0, "control_every": 1.0}
    quiet = {"range_noise_m": 0.0, "gyro_noise_rad_s": 0.0, "rpm_noise_rad_s": 0.0, "current_noise_A": 0.0}
    fast, ahead, rotors = {"motor_time_constant_s": FAST_MOTOR_S}, {"preview_s": lag}, {"per_rotor": 1.0}
    return {
        "as published": ({}, {}),
        "no motor lag": (fast, {}),
        "lead of the motor lag": ({}, {"lead_s": lag}),
        "terrain preview of the motor lag": ({}, ahead),
        "per rotor": ({}, rotors),
        "no integral action": ({"altitude_ki": 0.0}, {}),
        "no sampling delay": (every, {}),
        "no sensor noise": (quiet, {}),
        "all but integral action": ({**fast, **every, **quiet}, rotors),
        "all": ({**fast, **every, **quiet, "altitude_ki": 0.0}, rotors),
    }


def cause_conditions(simulator: Simulator) -> list[Condition]:
    """Oracle, analytical and no feedforward without each cause, and the same vehicle where no ground effect exists."""
    conditions = []
    for cause, (both, oracle) in removals(simulator).items():
        labels = {"cause": cause}
        for name, own in (("none", {}), ("analytical", {}), ("oracle", oracle)):
            conditions.append(Condition(f"{name}, {cause}", {"mode": name, **both, **own}, labels={**labels, "mode": name}))
        gone = Condition(f"{FLOOR}, {cause}", {"mode": "none", **both}, {"amplitude": 0.0}, {**labels, "mode": FLOOR})
        conditions.append(gone)
    return conditions


def fly_causes(simulator: Simulator, plan: ClosedLoop, closed_loop: SeedRange, flights: Path, summary: Path, tests: Path) -> None:
    """Fly them over every seed.

    Parameters
    ----------
    flights : to write: a row a flight; ``cause`` names what is taken away.
    summary : to write: means.
    tests : to write: for every cause, oracle against analytical, against none, and against no ground effect at all; and
        every oracle against the published one.
    """
    table = fly_conditions(cause_conditions(simulator), closed_loop.list(), simulator, plan)
    pairs = [(f"oracle, {c}", f"{other}, {c}") for c in removals(simulator) for other in ("analytical", "none", FLOOR)]
    pairs += [(f"oracle, {c}", "oracle, as published") for c in list(removals(simulator))[1:]]
    write_csv(table, flights)
    write_csv(means(table, METRICS), summary)
    write_csv(contrasts(table, METRICS, pairs), tests)
