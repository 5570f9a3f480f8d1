"""Held-out flights flown again in closed loop: the simulator's firmware follows the logged
references.

The controller on regression need not be ours, so what depends on gains tells little; what a vehicle
needs to hold a reference at all, its drive and its lean, does not depend on them while the flight
is slow, and is compared first. The errors are averages over the windows of the weak form: before,
recalibrated and after, with intervals over blocks of time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import POSITION, command, rotor_speed, rotors_in
from ges.diagnose.design.instruments import replayed
from ges.diagnose.design.weak import Windows, make_windows
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.kinematics import to_body
from ges.diagnose.prove.verify import block_windows, stages_row
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

LEAN = ("lean_forward_rad", "lean_left_rad")
SPEED, DUTY = "rotor_speed_rad_s", "command"


def lean(q: np.ndarray) -> np.ndarray:
    """Angles of the thrust axis from the vertical, turned to the vehicle's heading: forward and to
    the left, (n, 2) rad.
    """
    # seen from the body the world's up leans against the thrust axis: hence the minus
    up = to_body(q, np.tile([0.0, 0.0, 1.0], (len(q), 1)))
    return np.arctan2(-up[:, :2], up[:, 2:])


def _compared(flight: Prepared) -> tuple[str, ...]:
    """Channels that this recording can be held against."""
    drive = SPEED if flight.has("rotor_speed") else DUTY if flight.has("command") else ""
    measured = LEAN if flight.has("attitude") and "attitude" not in flight.derived else ()
    placed = POSITION if flight.has("position") else ()
    return (*((drive,) if drive else ()), *measured, *placed)


def _told(columns: Mapping[str, np.ndarray], names: Sequence[str]) -> np.ndarray:
    """These channels of a recording or of a simulated flight, (n, k)."""
    known = {name: columns[name] for name in POSITION if name in names}
    n_rotors = rotors_in(columns)
    for name, each in ((SPEED, rotor_speed(n_rotors)), (DUTY, command(n_rotors))):
        if name in names:
            known[name] = np.mean([columns[c] for c in each], axis=0)
    if LEAN[0] in names:
        known |= dict(
            zip(LEAN, lean(np.stack([columns[f"q_{a}"] for a in "wxyz"], axis=1)).T, strict=True)
        )
    return np.stack([known[name] for name in names], axis=1)


def _flown(
    flight: Prepared, windows: Windows, model: Model, names: Sequence[str]
) -> np.ndarray | None:
    """Simulated less recorded, (windows, k); None where the model cannot follow."""
    physics = {n: v for n, v in model.effects.items() if effect_table.get(n).kind != "sensor"}
    said = replayed(flight, dataclasses.replace(model, effects=physics), command(model.n_rotors))
    return (
        None if said is None else windows.mean @ (_told(said, names) - _told(flight.columns, names))
    )


def closed_loop(flights: Sequence[Prepared], models: Mapping[str, Model], length_s: float) -> dict:
    """``closed_loop`` of the fit: rms by channel and stage over the held-out flights whose
    references were logged.

    Returns
    -------
    ``channels``: by name, the rms of each stage and ``reduction_ci95`` of 'after' against
    'recalibrated'; ``flights``: how many; empty where no flight has references or one of the models
    cannot follow them.
    """
    pieces: dict[str, dict[str, list[np.ndarray]]] = {}
    count = 0
    for flight in (f for f in flights if f.has("reference")):
        windows, names = make_windows(flight.t_s, flight.flying, length_s), _compared(flight)
        told = (
            {stage: _flown(flight, windows, model, names) for stage, model in models.items()}
            if names
            else {}
        )
        followed = {stage: e for stage, e in told.items() if e is not None}
        # stages compare on the same flights alone: all can follow this one, or it does not count
        if not told or not len(windows) or len(followed) < len(told):
            continue
        count += 1
        for k, name in enumerate(names):
            for stage, e in followed.items():
                pieces.setdefault(name, {}).setdefault(stage, []).append(e[:, k])
    block = block_windows(0.5 * length_s)
    channels = {name: stages_row(by_stage, block) for name, by_stage in pieces.items()}
    return {"flights": count, "channels": channels} if count else {}
