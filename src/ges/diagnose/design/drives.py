"""Rotor speeds of a flight under a model: logged, or flown from commands through the motors."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ges.conventions import FAR_FROM_GROUND_M, command, rotor_speed
from ges.diagnose.design.motion import effects_of_kind, state_columns
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator import flight as sim


def commanded_speeds(
    flights: Sequence[Prepared], model: Model, effects: effect_table.Effects
) -> list[np.ndarray]:
    """Return the rotor speeds that the commands make, through the compiled drive.

    Parameters
    ----------
    flights : prepared recordings.
    model : of the vehicle.
    effects : of which actuators count.

    Returns
    -------
    By flight, (n, rotors) rad/s.
    """
    return _fly_motors(
        [(f, effects, _drive_inputs(f, motor_commands(f, model, effects))) for f in flights],
        model,
    )


def _commanded_speeds_of_each(
    flight: Prepared, model: Model, sets: Sequence[effect_table.Effects]
) -> list[np.ndarray]:
    """Fly the drive of one flight under several sets of effects, in one batch.

    Rotor speeds are (n, rotors) rad/s each.
    """
    # few sets change the commands in another way: the inputs of all others are the same
    tables: dict[str, np.ndarray] = {}
    batch = []
    for e in sets:
        key = repr(_of_commands(e))
        if key not in tables:
            tables[key] = _drive_inputs(flight, motor_commands(flight, model, e))
        batch.append((flight, e, tables[key]))
    return _fly_motors(batch, model)


def _fly_motors(
    batch: Sequence[tuple[Prepared, effect_table.Effects, np.ndarray]], model: Model
) -> list[np.ndarray]:
    """Return rotor speeds (n, rotors) of flights with the inputs of their drives."""
    names = rotor_speed(model.n_rotors)
    records = sim.fly(
        [_drive_flight(flight, model, effects, inputs) for flight, effects, inputs in batch],
        names,
    )
    lengths = [len(flight.t_s) for flight, _, _ in batch]
    return [
        np.stack([r[name][:n] for name in names], axis=1)
        for r, n in zip(records, lengths, strict=True)
    ]


def _of_commands(effects: effect_table.Effects) -> dict:
    """Return actuators that change the commands of another effect, and those effects."""
    modified = {
        n: m for n in effects_of_kind(effects, "actuator") if (m := effect_table.get(n).modifies)
    }
    on = {*modified, *modified.values()}
    return effect_table.only(effects, lambda e: e.name in on)


def motor_commands(flight: Prepared, model: Model, effects: effect_table.Effects) -> np.ndarray:
    """Return the commands that reach the motors.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    effects : of which modifiers of commands count.

    Returns
    -------
    (n, rotors), 0 to 1: the logged ones, changed by what acts by height.

    Notes
    -----
    The drive itself is flown far above the ground, so such effects are evaluated here, along the
    recorded path.
    """
    u = flight.stack("command").clip(0.0, 1.0)
    on = _of_commands(effects)
    if not on:
        return u
    samples = effect_table.Samples.from_columns(
        {**state_columns(flight, model), **dict(zip(command(model.n_rotors), u.T, strict=True))}
    )
    output = effect_table.replay(model.parameters, samples, on, model.terrain)
    return output.rotor_command_rad_s / model.number("max_rotor_speed_rad_s")


def _drive_inputs(flight: Prepared, commands: np.ndarray) -> np.ndarray:
    """Return commands, attitude, battery voltage and rates, one row for each of the log."""
    n, rotors = commands.shape
    # motors alone are flown: attitude is imposed level and at rest
    inputs = np.zeros((n, rotors + 8))
    inputs[:, :rotors], inputs[:, rotors] = commands, 1.0
    inputs[:, rotors + 4] = flight.columns.get("battery_V", np.full(n, np.nan))
    return inputs


def _drive_flight(
    flight: Prepared, model: Model, effects: effect_table.Effects, inputs: np.ndarray
) -> sim.Flight:
    from ges.simulator.terrain import Terrain

    drives = effect_table.only(effects, lambda e: e.kind == "actuator" and not e.modifies)
    every, n = flight.steps(settings.numerics.step_s), len(flight.t_s)
    step_s = flight.dt_s / every
    # rotors start as they were logged; else what they did before is unknown, and they start where
    # the first command has them
    logged = flight.has("rotor_speed")
    first = {
        f"start_{name}": float(flight.columns[name][0])
        if logged
        else model.number("max_rotor_speed_rad_s") * inputs[0, i]
        for i, name in enumerate(rotor_speed(model.n_rotors))
    }
    # a bench for motors: commands replayed, the ground far below, a record for every row of the log
    numbers = {
        **model.parameters,
        **first,
        "control": "interpolated_commands",
        "attitude_imposed": 1,
        "start": 1,
        "start_p_z_m": FAR_FROM_GROUND_M,
        # a step takes the commands of its middle; those that are held act later, see
        # :func:`~.delays.estimate_command_hold`
        "inputs_start_s": flight.command_hold.delay_rows * flight.dt_s - 0.5 * step_s,
        "inputs_dt_s": flight.dt_s,
        "dt_s": step_s,
        "record_every": every,
        "control_every": every,
        "telemetry_every": every,
        "duration_s": n * flight.dt_s,
    }
    return sim.Flight(numbers, drives, Terrain.flat(), inputs)


@dataclasses.dataclass(frozen=True)
class Drive:
    """Rotor speeds of one flight.

    Attributes
    ----------
    acting_speeds : (n, rotors) rad/s, those that turn the air.
    commanded : (n, rotors) rad/s, those that the commands make; None where no channel needs them.
    """

    acting_speeds: np.ndarray
    commanded: np.ndarray | None


def fly_drives(
    flight: Prepared, model: Model, sets: Sequence[effect_table.Effects], names: Sequence[str]
) -> list[Drive]:
    """Return the drive of one flight under several sets of effects, flown once.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    sets : of effects.
    names : channels; without ``drive_1`` the commands are not flown where speeds were logged.
    """
    if not flight.has("rotor_speed"):
        return [Drive(speeds, speeds) for speeds in _commanded_speeds_of_each(flight, model, sets)]
    commanded = (
        _commanded_speeds_of_each(flight, model, sets) if "drive_1" in names else [None] * len(sets)
    )
    return [
        Drive(acting_speeds(flight, model, e), speeds)
        for e, speeds in zip(sets, commanded, strict=True)
    ]


def acting_speeds(flight: Prepared, model: Model, effects: effect_table.Effects) -> np.ndarray:
    """Return the rotor speeds that turn the air: expected, measured, or made by the commands.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    effects : that are on.

    Returns
    -------
    (n, rotors) rad/s.
    """
    if flight.model_speeds is not None:
        return flight.model_speeds
    if not flight.has("rotor_speed"):
        return commanded_speeds([flight], model, effects)[0]
    measured = flight.stack("rotor_speed")
    suspect = effect_table.only(effects, lambda e: e.reads_voltage)
    if not suspect or flight.has("command") or not flight.has("battery"):
        return measured
    return _as_if_commanded(flight, measured, model, suspect)


def _as_if_commanded(
    flight: Prepared, speeds: np.ndarray, model: Model, effects: effect_table.Effects
) -> np.ndarray:
    """Return speeds as the voltage would have changed them.

    Without commands, sag can only hide in the telemetry.
    """
    # speeds stand for commands, the median voltage for the nominal: only its changes count
    columns = {"t_s": flight.t_s, "battery_V": flight.columns["battery_V"]}
    columns.update(zip(rotor_speed(model.n_rotors), speeds.T, strict=True))
    asked = speeds.T / model.number("max_rotor_speed_rad_s")
    columns.update(zip(command(model.n_rotors), asked, strict=True))
    parameters = {
        **model.parameters,
        "battery_nominal_V": float(np.median(flight.columns["battery_V"])),
    }
    return effect_table.replay(
        parameters, effect_table.Samples.from_columns(columns), effects
    ).rotor_command_rad_s


def have_same_drive(one: Model, other: Model) -> bool:
    """Return whether two models make the same rotor speeds of any recording.

    Parameters
    ----------
    one, other : models.
    """
    drive_effects = [_drive_effects(model.effects) for model in (one, other)]
    same_vehicle = one.parameters == other.parameters and one.terrain is other.terrain
    return same_vehicle and drive_effects[0] == drive_effects[1]


def _drive_effects(effects: effect_table.Effects) -> dict:
    """Return the effects that change rotor speeds, or commands on their way to the motors."""
    modified = {effect_table.get(name).modifies for name in effects_of_kind(effects, "actuator")}
    return effect_table.only(
        effects, lambda e: e.name in modified or e.kind == "actuator" or e.reads_voltage
    )


def affects_drive(effects: effect_table.Effects, on: effect_table.Effects | None = None) -> bool:
    """Return whether effects change the rotor speeds.

    Parameters
    ----------
    effects : that are added.
    on : effects that are on; an actuator among them may act upon the added ones.
    """
    modifiers = (name for name in on or {} if effect_table.get(name).modifies in effects)
    return any(effect_table.get(name).kind == "actuator" for name in (*effects, *modifiers))
