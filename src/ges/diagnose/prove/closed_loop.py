"""Held-out flights flown again in closed loop, along the logged references.

The simulated firmware follows them.

The real controller need not be ours, so signals that depend on gains carry little information. What
slow flight requires does not depend on them: the drive and the lean, which are compared first.
Errors are averages over the windows of the weak form.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import POSITION, command, rotor_speed, rotors_in
from ges.diagnose.design.instruments import replay_references
from ges.diagnose.design.weak import Windows, block_windows, make_windows
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.kinematics import to_body
from ges.diagnose.prove.verify import stages_row
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

LEAN = ("lean_forward_rad", "lean_left_rad")
SPEED, DUTY = "rotor_speed_rad_s", "command"


def lean(q: np.ndarray) -> np.ndarray:
    """Return the lean of the thrust axis, in the heading frame.

    Parameters
    ----------
    q : (n, 4) attitudes.

    Returns
    -------
    (n, 2) rad, forward and to the left.
    """
    # seen from the body the world's up leans against the thrust axis: hence the minus
    up = to_body(q, np.tile([0.0, 0.0, 1.0], (len(q), 1)))
    return np.arctan2(-up[:, :2], up[:, 2:])


def _comparable_channels(flight: Prepared) -> tuple[str, ...]:
    """Return channels in which this recording can be compared."""
    drive = SPEED if flight.has("rotor_speed") else DUTY if flight.has("command") else ""
    measured = LEAN if flight.has("attitude") and "attitude" not in flight.derived else ()
    placed = POSITION if flight.has("position") else ()
    return (*((drive,) if drive else ()), *measured, *placed)


def _compared_signals(columns: Mapping[str, np.ndarray], names: Sequence[str]) -> np.ndarray:
    """Return these channels of a recording or a simulated flight, (n, k)."""
    signals = {name: columns[name] for name in POSITION if name in names}
    n_rotors = rotors_in(columns)
    for name, each in ((SPEED, rotor_speed(n_rotors)), (DUTY, command(n_rotors))):
        if name in names:
            signals[name] = np.mean([columns[c] for c in each], axis=0)
    if LEAN[0] in names:
        signals |= dict(
            zip(LEAN, lean(np.stack([columns[f"q_{a}"] for a in "wxyz"], axis=1)).T, strict=True)
        )
    return np.stack([signals[name] for name in names], axis=1)


def _closed_loop_errors(
    flight: Prepared, windows: Windows, model: Model, names: Sequence[str]
) -> np.ndarray | None:
    """Return simulated minus recorded, (windows, k); None where the model cannot follow."""
    physics = effect_table.only(model.effects, lambda e: e.kind != "sensor")
    simulated = replay_references(
        flight, dataclasses.replace(model, effects=physics), command(model.n_rotors)
    )
    return (
        None
        if simulated is None
        else windows.mean
        @ (_compared_signals(simulated, names) - _compared_signals(flight.columns, names))
    )


def closed_loop(flights: Sequence[Prepared], models: Mapping[str, Model], length_s: float) -> dict:
    """Return ``fit.closed_loop``: rms by channel and stage over flights with logged references.

    Parameters
    ----------
    flights : held out.
    models : by stage.
    length_s : support of the test functions.

    Returns
    -------
    ``channels``: by name, rms of each stage and ``reduction_ci95`` of 'after' against
    'recalibrated'. ``flights``: their number. Empty where no flight has references that all models
    can follow.
    """
    pieces: dict[str, dict[str, list[np.ndarray]]] = {}
    count = 0
    for flight in (f for f in flights if f.has("reference")):
        windows = make_windows(flight.t_s, flight.flying, length_s)
        names = _comparable_channels(flight)
        by_stage_errors = (
            {
                stage: _closed_loop_errors(flight, windows, model, names)
                for stage, model in models.items()
            }
            if names
            else {}
        )
        followed = {stage: e for stage, e in by_stage_errors.items() if e is not None}
        # stages compare on the same flights alone: all can follow this one, or it does not count
        if not by_stage_errors or not len(windows) or len(followed) < len(by_stage_errors):
            continue
        count += 1
        for k, name in enumerate(names):
            for stage, e in followed.items():
                pieces.setdefault(name, {}).setdefault(stage, []).append(e[:, k])
    block = block_windows(0.5 * length_s)
    channels = {name: stages_row(by_stage, block) for name, by_stage in pieces.items()}
    return {"flights": count, "channels": channels} if count else {}
