"""A controller that does win: the gains of the height loop chosen anew for every mode, on
validation seeds alone.

Only gains with a stated phase margin far from the ground are candidates, so that what wins could be
flown.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from ges.errors import UsageError
from ges.files import write_csv, write_json
from ges.study.config import Flights, Mode, Retune, SeedRange, Simulator
from ges.study.fly.comparison import REFERENCE, mode_conditions
from ges.study.fly.flights import Condition, fly_conditions
from ges.study.fly.poles import phase_margin_deg
from ges.study.stats.paired import compare, contrasts, means

METRICS = ("agl_rms_m", "gyro_rms_rad_s", "clearance_p5_m", "clearance_min_m", "low_clearance_s")
PUBLISHED, RETUNED = "as published", "retuned"
HELPED = "oracle, per rotor, with lead"


def _arms(simulator: Simulator, modes: list[Mode], clamp: Path) -> list[Condition]:
    """Every mode, and the oracle with every help that it can have."""
    oracle = Condition(
        HELPED,
        {"mode": "oracle", "per_rotor": 1.0, "lead_s": simulator.vehicle.motor_time_constant_s},
    )
    return [*mode_conditions(modes, clamp), oracle]


def _scaled(simulator: Simulator, kp: float, kd: float) -> dict[str, float]:
    return {
        "altitude_kp": kp * simulator.controller.altitude_kp,
        "altitude_kd": kd * simulator.controller.altitude_kd,
    }


def _margin_deg(simulator: Simulator, kp: float, kd: float) -> float:
    # the loop of scaled gains, linearised far from the ground, where no feedforward acts
    controller = simulator.controller.model_copy(update=_scaled(simulator, kp, kd))
    return phase_margin_deg(simulator.model_copy(update={"controller": controller}))


def sound_gains(simulator: Simulator, retune: Retune) -> dict[tuple[float, float], float]:
    """Return the pairs of gain factors with enough phase margin.

    Parameters
    ----------
    simulator : whose gains are scaled.
    retune : factors that are tried, and the least margin.

    Returns
    -------
    Phase margin (degrees) by (proportional factor, derivative factor).

    Raises
    ------
    UsageError
        When no pair has enough.
    """
    pairs = {
        pair: _margin_deg(simulator, *pair)
        for pair in itertools.product(retune.kp_factors, retune.kd_factors)
    }
    sound = {pair: margin for pair, margin in pairs.items() if margin >= retune.phase_margin_deg}
    if not sound:
        raise UsageError(
            "closed_loop.retune: no pair of factors has a phase margin of"
            f" {retune.phase_margin_deg:g} degrees; the best has {max(pairs.values()):.1f}; allow"
            " less or try other factors"
        )
    return sound


def _candidates(
    arm: Condition, simulator: Simulator, sound: Mapping[tuple[float, float], float]
) -> Iterator[Condition]:
    for (kp, kd), margin in sound.items():
        labels: dict[str, float | str] = {
            "mode": arm.name,
            "kp_factor": kp,
            "kd_factor": kd,
            "phase_margin_deg": margin,
        }
        parameters = {**arm.parameters, **_scaled(simulator, kp, kd)}
        yield Condition(f"{arm.name}, kp x {kp:g}, kd x {kd:g}", parameters, labels=labels)


def choose_gains(
    simulator: Simulator,
    plan: Flights,
    modes: list[Mode],
    retune: Retune,
    validation: SeedRange,
    clamp: Path,
    flights: Path,
    choice: Path,
) -> None:
    """Choose the gains of every mode on validation seeds.

    Every mode is flown with every pair of :func:`sound_gains`; the pair of least mean AGL RMS is
    its choice.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    modes : names of the modes.
    retune : factors that are tried, and the least margin.
    validation : seeds.
    clamp : choice of the clamp threshold (JSON).
    flights : to write: a row a flight.
    choice : to write (JSON): the seeds, and factors, phase margin and mean AGL RMS of every mode's
        choice.
    """
    sound = sound_gains(simulator, retune)
    candidates = [
        c for arm in _arms(simulator, modes, clamp) for c in _candidates(arm, simulator, sound)
    ]
    table = fly_conditions(candidates, validation.list(), simulator, plan)
    score = means(table, ["agl_rms_m"]).set_index("condition")["mean"]
    best: dict[str, dict[str, float | str]] = {}
    least: dict[str, float] = {}
    for candidate in candidates:
        value, mode = float(score[candidate.name]), str(candidate.labels["mode"])
        # each mode has gains of its own, so that none is judged in a loop tuned for another
        if mode not in least or value < least[mode]:
            least[mode] = value
            best[mode] = {**candidate.labels, "agl_rms_m": value}
    published = _margin_deg(simulator, 1.0, 1.0)
    write_csv(flights, table)
    write_json(
        choice, {"seeds": validation.list(), "gains": best, "published_phase_margin_deg": published}
    )


def fly_winner(
    simulator: Simulator,
    plan: Flights,
    modes: list[Mode],
    closed_loop: SeedRange,
    clamp: Path,
    choice: Path,
    flights: Path,
    summary: Path,
    tests: Path,
) -> None:
    """Fly every mode with the published and with its own gains over the evaluation seeds.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    modes : names of the modes.
    closed_loop : seeds.
    clamp, choice : choices of the clamp threshold and of the gains (JSON).
    flights : to write: a row a flight; ``gains`` names which.
    summary : to write: means, with the paired difference from the analytical mode as published.
    tests : to write: every retuned mode against itself as published, and against the retuned
        analytical mode.
    """
    chosen, conditions = json.loads(Path(choice).read_text())["gains"], []
    for arm in _arms(simulator, modes, clamp):
        own = _scaled(simulator, chosen[arm.name]["kp_factor"], chosen[arm.name]["kd_factor"])
        for gains, numbers in ((PUBLISHED, {}), (RETUNED, own)):
            labels = {"mode": arm.name, "gains": gains}
            conditions.append(
                Condition(f"{arm.name}, {gains}", {**arm.parameters, **numbers}, labels=labels)
            )
    table = fly_conditions(conditions, closed_loop.list(), simulator, plan)
    pairs = [(f"{m}, {RETUNED}", f"{m}, {PUBLISHED}") for m in chosen]
    pairs += [(f"{m}, {RETUNED}", f"{REFERENCE}, {RETUNED}") for m in chosen if m != REFERENCE]
    write_csv(flights, table)
    write_csv(summary, compare(table, METRICS, f"{REFERENCE}, {PUBLISHED}"))
    write_csv(tests, contrasts(table, METRICS, pairs))
