"""Why the oracle does not win: one cause taken away at a time.

Every mode is compared with the same vehicle where no ground effect exists. An oracle that cancels
perfectly returns that vehicle, so its tracking error is the oracle's floor. Where ground effect
itself helps the loop, an estimate that leaves some of it tracks better.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path

from ges.files import write_csv
from ges.study.config import Flights, SeedRange, Simulator
from ges.study.fly.flights import Condition, fly_conditions
from ges.study.stats.paired import contrasts, means

METRICS = ("agl_rms_m", "clearance_p5_m", "low_clearance_s", "gyro_rms_rad_s")
FAST_MOTOR_S = 0.002
DAMPED = 8.0
FLOOR = "no ground effect"
FEEDFORWARD = ("analytical", "oracle")
AS_PUBLISHED = "as published"


@dataclasses.dataclass(frozen=True)
class _Removal:
    """Numbers with which a cause is gone.

    Attributes
    ----------
    every_mode, oracle : numbers of the flights of every mode, and of the oracle alone.
    truth : parameters of the true ground effect.
    """

    every_mode: Mapping[str, float] = dataclasses.field(default_factory=dict)
    oracle: Mapping[str, float] = dataclasses.field(default_factory=dict)
    truth: Mapping[str, float] = dataclasses.field(default_factory=dict)


def _removals(simulator: Simulator) -> dict[str, _Removal]:
    """Every cause by name, then several together."""
    lag = simulator.vehicle.motor_time_constant_s
    damping = {"altitude_kd": DAMPED * simulator.controller.altitude_kd}
    every = {"telemetry_every": 1.0, "control_every": 1.0}
    noises = ("range_noise_m", "gyro_noise_rad_s", "rpm_noise_rad_s", "current_noise_A")
    quiet = dict.fromkeys(noises, 0.0)
    fast, rotors = {"motor_time_constant_s": FAST_MOTOR_S}, {"per_rotor": 1.0}
    return {
        AS_PUBLISHED: _Removal(),
        "no motor lag": _Removal(fast),
        # f + tau df/dt undoes a lag of 1 / (tau s + 1)
        "lead of the motor lag": _Removal(oracle={"lead_s": lag}),
        # no derivative: the truth where the vehicle will be when the thrust has come
        "terrain preview of the motor lag": _Removal(oracle={"preview_s": lag}),
        "per rotor": _Removal(oracle=rotors),
        "no integral action": _Removal({"altitude_ki": 0.0}),
        "no sampling delay": _Removal(every),
        "no sensor noise": _Removal(quiet),
        "no slope or curvature correction": _Removal(
            truth={"slope_exponent": 0.0, "curvature_gain_m": 0.0}
        ),
        "damped height loop": _Removal(damping),
        "all but integral action": _Removal({**fast, **every, **quiet}, rotors),
        "all": _Removal({**fast, **every, **quiet, "altitude_ki": 0.0}, rotors),
    }


def _conditions_without(cause: str, gone: _Removal) -> Iterator[Condition]:
    """Yield oracle, analytical and no feedforward without a cause, then no ground effect at all."""
    arms: tuple[tuple[str, str, Mapping[str, float], Mapping[str, float]], ...] = (
        ("none", "none", {}, gone.truth),
        ("analytical", "analytical", {}, gone.truth),
        ("oracle", "oracle", gone.oracle, gone.truth),
        (FLOOR, "none", {}, {"amplitude": 0.0}),
    )
    for name, mode, own, truth in arms:
        numbers: dict[str, float | str] = {"mode": mode, **gone.every_mode, **own}
        yield Condition(f"{name}, {cause}", numbers, truth, {"cause": cause, "mode": name})


def fly_causes(
    simulator: Simulator,
    plan: Flights,
    closed_loop: SeedRange,
    flights: Path,
    summary: Path,
    tests: Path,
) -> None:
    """Fly every mode with one cause taken away at a time.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    closed_loop : seeds.
    flights : to write: a row a flight; ``cause`` names what is taken away.
    summary : to write: means.
    tests : to write: paired tests. For every cause the oracle meets the analytical mode and none,
        and every mode meets no ground effect at all. Every oracle meets the published one.
    """
    causes = _removals(simulator)
    conditions = [c for cause, gone in causes.items() for c in _conditions_without(cause, gone)]
    table = fly_conditions(conditions, closed_loop.list(), simulator, plan)
    # Holm's correction is over all of these: no pair that nobody asks for
    pairs = [(f"oracle, {c}", f"{other}, {c}") for c in causes for other in ("analytical", "none")]
    pairs += [(f"{m}, {c}", f"{FLOOR}, {c}") for c in causes for m in ("none", *FEEDFORWARD)]
    pairs += [(f"oracle, {c}", f"oracle, {AS_PUBLISHED}") for c in causes if c != AS_PUBLISHED]
    write_csv(flights, table)
    write_csv(summary, means(table, METRICS))
    write_csv(tests, contrasts(table, METRICS, pairs))
