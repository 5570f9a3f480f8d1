"""Multiple shooting: the simulator flies a recording again in pieces, each from the recorded state.

Rotor speeds and attitude are imposed as recorded; position and velocity are free. Held-out flights
are judged by the error after one second.

Fits are refined by rollouts as long as the shortest window: the model is evaluated along the
simulated path. A window of the weak form then sees the error of the rollout. Its test function
vanishes at both ends, and the derivative of the simulated velocity is the simulated force. So
turbulence no longer moves the velocity that a drag depends on.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ges.conventions import BODY_RATE, POSITION, QUATERNION, VELOCITY, rotor_speed
from ges.diagnose.design.residual import flown_columns
from ges.diagnose.design.system import window_length_s
from ges.diagnose.design.weak import all_allowed
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator import flight as sim


def can_roll_out(flight: Prepared) -> bool:
    """Return whether a rollout has a start and a drive.

    Parameters
    ----------
    flight : prepared recording.
    """
    placed = all(flight.has(stream) for stream in ("attitude", "velocity", "position"))
    return placed and (flight.has("rotor_speed") or flight.has("command"))


def rollout_starts(flight: Prepared, n: int) -> np.ndarray:
    """Return rows from which a whole horizon flies, one horizon apart.

    Parameters
    ----------
    flight : prepared recording.
    n : rows of a horizon.

    Returns
    -------
    (k,) rows.
    """
    rows = np.arange(0, len(flight.t_s) - n - 1, n)
    return rows[all_allowed(flight.flying, rows, rows + n + 1)]


@dataclasses.dataclass(frozen=True)
class Rollouts:
    """Rollouts of one flight.

    Attributes
    ----------
    starts : (k,) rows at which they start.
    flown : a record of each.
    recorded : (n,) smoothed positions and velocities by contract column, world.
    """

    starts: np.ndarray
    flown: list[sim.Record]
    recorded: dict[str, np.ndarray]


def fly_rollouts(flight: Prepared, model: Model, n: int) -> Rollouts:
    """Fly every horizon of one flight.

    Parameters
    ----------
    flight : prepared recording.
    model : that is flown.
    n : rows of a horizon.
    """
    columns = flown_columns(flight, model, model.effects)
    width = settings.design.coarsest_s / flight.dt_s
    recorded = {
        name: gaussian_filter1d(flight.columns[name], width) for name in VELOCITY + POSITION
    }
    # where the ground's height was logged over flat terrain, the model's height is over that
    recorded["p_z_m"] = recorded["p_z_m"] + (columns["p_z_m"] - flight.columns["p_z_m"])
    table = np.stack([columns[name] for name in _imposed(model)], axis=1)
    rates = np.stack([columns[name] for name in BODY_RATE], axis=1)
    battery = flight.columns.get("battery_V", np.full(len(table), np.nan))
    inputs = np.column_stack([table, battery, rates])
    # imposed speeds have what actuators did in them, and a rollout reads no sensor
    effects = effect_table.only(model.effects, lambda e: e.kind not in ("sensor", "actuator"))
    starts = rollout_starts(flight, n)
    pieces = [_piece(flight, model, effects, recorded, inputs[s : s + n + 2], s) for s in starts]
    return Rollouts(
        starts, sim.fly(pieces, ("t_s", *POSITION, *VELOCITY)) if pieces else [], recorded
    )


def _imposed(model: Model) -> tuple[str, ...]:
    """Return columns that a rollout takes from the recording, in the order of a replay."""
    return (*rotor_speed(model.n_rotors), *QUATERNION)


def _piece(
    flight: Prepared, model: Model, effects: dict, recorded: dict, inputs: np.ndarray, start: int
) -> sim.Flight:
    every, imposed = flight.steps(settings.numerics.step_s), _imposed(model)
    state = {f"start_{name}": float(recorded[name][start]) for name in POSITION + VELOCITY}
    state |= {
        f"start_{name}": float(v)
        for name, v in zip(imposed, inputs[0, : len(imposed)], strict=True)
    }
    numbers = {
        **model.parameters,
        **state,
        "control": 2,
        "attitude_imposed": 1,
        "start": 1,
        "inputs_dt_s": flight.dt_s,
        "dt_s": flight.dt_s / every,
        "duration_s": (len(inputs) - 2) * flight.dt_s,
        "record_every": every,
        # no gear: pieces start and end in the air, contacts were left out
        "gear_height_m": 0.0,
        "gear_stiffness_N_m": 0.0,
    }
    return sim.Flight(numbers, effects, model.terrain, inputs)


def with_rollout_path(flight: Prepared, model: Model) -> Prepared:
    """Return the flight with the path of its rollouts, see :attr:`Prepared.path`.

    Parameters
    ----------
    flight : prepared recording.
    model : that is flown.

    Returns
    -------
    The flight unchanged where it cannot be flown, or where streams are slow.

    Notes
    -----
    What rotors did between slow readings would move the path against the residual that it makes.
    """
    shortest_s = settings.design.window_shortest_s
    if not can_roll_out(flight) or window_length_s([flight]) > shortest_s:
        return flight
    n = max(1, int(round(shortest_s / flight.dt_s)))
    rolled, clock = fly_rollouts(flight, model, n), flight.dt_s * np.arange(n)
    path = {name: values.copy() for name, values in rolled.recorded.items()}
    for start, record in zip(rolled.starts, rolled.flown, strict=True):
        # a piece that the simulator gave up keeps the recorded path
        for name in path if record.status == "ok" else ():
            path[name][start : start + n] = np.interp(
                clock, record["t_s"] - record["t_s"][0], record[name]
            )
    return flight.replace(path=path)
