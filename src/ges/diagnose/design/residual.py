"""Residuals in weak form: recorded minus modelled, by window and channel.

Blocks are ``force_*`` (from velocity), ``acc_*`` (from the accelerometer, as a force), ``moment_*``
(from the gyro), ``drive_*`` (rotor speeds against commands) and ``range``. A force shows in the
first two alike; a fault of one sensor shows in one of them only. The model side is always the
compiled library's.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import csr_array

from ges.conventions import (
    BODY_RATE,
    FAR_FROM_GROUND_M,
    QUATERNION,
    VELOCITY,
    command,
    rotor_columns,
    rotor_speed,
)
from ges.diagnose.design.weak import Windows
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import ACC, FORCE, MOMENT
from ges.diagnose.prepare.channels import drive as drive_channels
from ges.diagnose.prepare.kinematics import body_rates, quaternion_product, to_body
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model, block_of
from ges.simulator import effects as effect_table
from ges.simulator import flight as sim

FINE = ("moment", "drive")
"""Blocks that are also compared under faster test functions: what acts within a few hundredths of a
second shows there.
"""


def with_higher_orders(names: Sequence[str], count: int) -> tuple[str, ...]:
    """Append the channels of faster test functions.

    Parameters
    ----------
    names : channels.
    count : number of faster test functions.

    Returns
    -------
    ``moment_x/1`` is ``moment_x`` under the first of them.
    """
    fine = [name for name in names if block_of(name) in FINE]
    return (*names, *(f"{name}/{k}" for k in range(1, count + 1) for name in fine))


def height_columns(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Return the position, over the logged ground where one is logged and the terrain is flat.

    Parameters
    ----------
    flight : prepared recording.
    model : with the terrain.

    Returns
    -------
    (n,) by contract column, m, world. Without a position the rangefinder's reading is the height.
    """
    columns = {
        name: flight.columns[name] for name in ("p_x_m", "p_y_m", "p_z_m") if name in flight.columns
    }
    if "ground_z_m" in flight.columns and model.terrain.kind == "flat" and "p_z_m" in columns:
        columns["p_z_m"] = (
            columns["p_z_m"]
            - flight.columns["ground_z_m"]
            + model.terrain.parameters().get("terrain_z_m", 0.0)
        )
    # without a position the rangefinder's reading is all that is known of the height
    if "p_z_m" not in columns and flight.has("range"):
        columns["p_z_m"] = flight.columns["range_m"]
    return columns


def _state_columns(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Return all that the library reads of every sample but rotor speeds.

    (n,) by contract column, in the units of their names.
    """
    columns = {"t_s": flight.t_s - flight.t_s[0], **height_columns(flight, model)}
    for names in (VELOCITY, QUATERNION, command(model.n_rotors), ("battery_V",)):
        columns.update({name: flight.columns[name] for name in names if name in flight.columns})
    # effects ask for an angular acceleration, and differences amplify the gyro's noise: smoothed
    omega, width = body_rates(flight), settings.prepare.rate_smoothing_s / flight.dt_s
    rate = np.gradient(gaussian_filter1d(omega, width, axis=0), flight.dt_s, axis=0)
    columns.update(zip(BODY_RATE, omega.T, strict=True))
    columns.update(zip((f"omega_dot_{a}_rad_s2" for a in "xyz"), rate.T, strict=True))
    return columns


@dataclasses.dataclass(frozen=True)
class Motion:
    """The recorded motion as the library and the equations of motion take it.

    Attributes
    ----------
    columns : (n,) by contract column; rotor speeds are not among them.
    as_read : the same before sensor faults are undone.
    gravity_m_s2 : gravity.
    """

    columns: Mapping[str, np.ndarray]
    as_read: Mapping[str, np.ndarray]
    gravity_m_s2: float

    @functools.cached_property
    def omega(self) -> np.ndarray:
        """Body rates, (n, 3) rad/s."""
        return np.stack([self.columns[name] for name in BODY_RATE], axis=1)

    @functools.cached_property
    def velocity_terms(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity v_b in the body frame, and omega x v_b + R^T g; (n, 3) each."""
        # (1) of docs/method.md without the derivative: omega x v_b + R^T g
        q = np.stack([self.columns[name] for name in QUATERNION], axis=1)
        v = to_body(q, np.stack([self.columns[name] for name in VELOCITY], axis=1))
        return v, np.cross(self.omega, v) + to_body(
            q, np.tile([0.0, 0.0, self.gravity_m_s2], (len(q), 1))
        )


def motion_of(
    flight: Prepared, model: Model, effects: effect_table.Effects, like: Motion | None = None
) -> Motion:
    """Return the motion of a flight, with sensor faults undone.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    effects : of which sensor faults count.
    like : motion of the same flight and vehicle under other faults.
    """
    as_read = like.as_read if like else _state_columns(flight, model)
    return Motion(
        undo_sensor_faults(as_read, model, effects), as_read, model.number("gravity_m_s2")
    )


def _of_kind(effects: effect_table.Effects, *kinds: str) -> dict:
    return {
        name: values for name, values in effects.items() if effect_table.get(name).kind in kinds
    }


def _turning_faults(effects: effect_table.Effects) -> dict:
    """Return sensor faults of attitude and rates."""
    faults = _of_kind(effects, "sensor")
    return {
        name: values
        for name, values in faults.items()
        if {"gyro", "attitude"} & set(effect_table.get(name).channels)
    }


def undo_sensor_faults(
    columns: Mapping[str, np.ndarray], model: Model, effects: effect_table.Effects
) -> Mapping[str, np.ndarray]:
    """Return attitude and rates as they were, if the given sensor faults had made the readings.

    Parameters
    ----------
    columns : (n,) by contract column, rates in rad/s.
    model : of the vehicle.
    effects : of which sensor faults count.
    """
    faults = _turning_faults(effects)
    if not faults:
        return columns
    errors, rates = (
        [name.format(a) for a in "xyz"] for name in ("attitude_error_{}_rad", "gyro_{}_rad_s")
    )
    output = effect_table.replay(
        model.parameters,
        effect_table.Samples.from_columns(columns),
        faults,
        model.terrain,
        wanted=(*errors, *rates),
    )
    # a small turn by the error e is undone by the quaternion (sqrt(1 - |e / 2|^2), -e / 2)
    turn = -0.5 * output.stack(*errors)
    columns = dict(columns)
    if "q_w" in columns:
        q = np.stack([columns[name] for name in QUATERNION], axis=1)
        q = quaternion_product(q, np.column_stack([np.sqrt(1.0 - (turn**2).sum(axis=1)), turn]))
        columns.update(zip(QUATERNION, q.T, strict=True))
    # the fault f makes f(x) of a rate x: to first order what was read as x had been 2 x - f(x)
    for name, rate in zip(BODY_RATE, rates, strict=True):
        columns[name] = 2.0 * columns[name] - output[rate]
    return columns


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
        [(f, effects, _drive_inputs(f, model, motor_commands(f, model, effects))) for f in flights],
        model,
    )


def _commanded_speeds_of_each(
    flight: Prepared, model: Model, sets: Sequence[effect_table.Effects]
) -> list[np.ndarray]:
    """Fly the drive of one flight under several sets of effects, in one batch.

    Rotor speeds are (n, rotors) rad/s each.
    """
    # few sets change the commands: the inputs of all others are the same
    tables: dict[str, np.ndarray] = {}
    batch = []
    for e in sets:
        key = repr(e) if _command_modifiers(e) else ""
        if key not in tables:
            commands = motor_commands(flight, model, e if key else {})
            tables[key] = _drive_inputs(flight, model, commands)
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


def _command_modifiers(effects: effect_table.Effects) -> set[str]:
    """Return actuators that change the commands of another effect."""
    return {name for name in _of_kind(effects, "actuator") if effect_table.get(name).modifies}


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
    acting = _command_modifiers(effects)
    if not acting:
        return u
    modified = {m for a in acting if (m := effect_table.get(a).modifies)}
    on = {name: effects[name] for name in acting | modified if name in effects}
    samples = effect_table.Samples.from_columns(
        {**_state_columns(flight, model), **dict(zip(command(model.n_rotors), u.T, strict=True))}
    )
    output = effect_table.replay(model.parameters, samples, on, model.terrain)
    return output.rotor_command_rad_s / model.number("max_rotor_speed_rad_s")


def _drive_inputs(flight: Prepared, model: Model, commands: np.ndarray) -> np.ndarray:
    """Return commands, attitude, battery voltage and rates, one row for each step of the drive."""
    every = flight.steps(settings.numerics.step_s)
    u = _at_step_middles(commands, every, flight.command_hold.delay_rows)
    voltage = flight.columns.get("battery_V", np.full(len(flight.t_s), np.nan))
    rotors = u.shape[1]
    # motors alone are flown: attitude is imposed level and at rest
    inputs = np.zeros((len(u), rotors + 8))
    inputs[:, :rotors], inputs[:, rotors], inputs[:, rotors + 4] = u, 1.0, np.repeat(voltage, every)
    return inputs


def _drive_flight(
    flight: Prepared, model: Model, effects: effect_table.Effects, inputs: np.ndarray
) -> sim.Flight:
    from ges.simulator.terrain import Terrain

    drives = {
        name: values
        for name, values in _of_kind(effects, "actuator").items()
        if not effect_table.get(name).modifies
    }
    every, n = flight.steps(settings.numerics.step_s), len(flight.t_s)
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
        "control": 1,
        "attitude_imposed": 1,
        "start": 1,
        "start_p_z_m": FAR_FROM_GROUND_M,
        "inputs_dt_s": flight.dt_s / every,
        "dt_s": flight.dt_s / every,
        "record_every": every,
        "control_every": every,
        "telemetry_every": every,
        "duration_s": n * flight.dt_s,
    }
    return sim.Flight(numbers, drives, Terrain.flat(), inputs)


def _at_step_middles(u: np.ndarray, every: int, delay_rows: float) -> np.ndarray:
    """Return commands (n * every, rotors) at the middles of the steps, ``delay_rows`` late.

    They are interpolated between the samples (n, rotors). Commands that are held act later, see
    :func:`~.delays.estimate_command_hold`.
    """
    rows = (np.arange(len(u) * every) + 0.5) / every - delay_rows
    return np.stack([np.interp(rows, np.arange(len(u)), column) for column in u.T], axis=1)


@dataclasses.dataclass(frozen=True)
class Drive:
    """Rotor speeds of one flight.

    Attributes
    ----------
    acting : (n, rotors) rad/s, those that turn the air.
    commanded : (n, rotors) rad/s, those that the commands make; None where no channel needs them.
    """

    acting: np.ndarray
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
    suspect = {
        name: values for name, values in effects.items() if effect_table.get(name).reads_voltage
    }
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
    acting = [_of_drives(model.effects) for model in (one, other)]
    same_vehicle = one.parameters == other.parameters and one.terrain is other.terrain
    return same_vehicle and acting[0] == acting[1]


def _of_drives(effects: effect_table.Effects) -> dict:
    """Return the effects that change rotor speeds, or commands on their way to the motors."""
    modified = {effect_table.get(name).modifies for name in _of_kind(effects, "actuator")}
    return {
        name: values
        for name, values in effects.items()
        if name in modified
        or effect_table.get(name).kind == "actuator"
        or effect_table.get(name).reads_voltage
    }


def affects_drive(effects: effect_table.Effects, on: effect_table.Effects | None = None) -> bool:
    """Return whether effects change the rotor speeds.

    Parameters
    ----------
    effects : that are added.
    on : effects that are on; an actuator among them may act upon the added ones.
    """
    acting = [*effects, *(name for name in on or {} if effect_table.get(name).modifies in effects)]
    return any(effect_table.get(name).kind == "actuator" for name in acting)


def flown_columns(
    flight: Prepared, model: Model, effects: effect_table.Effects
) -> dict[str, np.ndarray]:
    """Return all that the library reads of every sample, with the acting rotor speeds.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    effects : that are on. Actuators have made the speeds.

    Returns
    -------
    State columns (n,) in the units of their names, with sensor faults undone.
    """
    motion = motion_of(flight, model, effects)
    return _with_rotors(flight, motion, acting_speeds(flight, model, effects))


def replay_model(
    flight: Prepared, model: Model, effects: effect_table.Effects
) -> tuple[dict[str, np.ndarray], effect_table.Replay]:
    """Evaluate the compiled model along the recorded state.

    Parameters
    ----------
    flight, model, effects : as for :func:`flown_columns`.

    Returns
    -------
    The columns (n,) of :func:`flown_columns`, and the model's output.
    """
    columns = flown_columns(flight, model, effects)
    samples, modelled = effect_table.Samples.from_columns(columns), without_actuators(effects)
    return columns, effect_table.replay(model.parameters, samples, modelled, model.terrain)


def _samples(flight: Prepared, motion: Motion, speeds: np.ndarray) -> effect_table.Samples:
    """Return what the library reads, with these rotor speeds (n, rotors)."""
    return effect_table.Samples.from_columns(_with_rotors(flight, motion, speeds))


def _with_rotors(flight: Prepared, motion: Motion, speeds: np.ndarray) -> dict[str, np.ndarray]:
    n, rate = speeds.shape[1], np.gradient(speeds, flight.dt_s, axis=0)
    return {
        **motion.columns,
        **flight.path,
        **dict(zip(rotor_speed(n), speeds.T, strict=True)),
        **dict(zip(rotor_columns("rotor_acceleration_{}_rad_s2", n), rate.T, strict=True)),
    }


def without_actuators(effects: effect_table.Effects) -> dict:
    """Return the effects on what given rotor speeds do.

    Parameters
    ----------
    effects : of which actuators and :func:`range_lags` are left out.
    """
    late = range_lags(effects)
    return {
        name: values
        for name, values in effects.items()
        if effect_table.get(name).kind != "actuator" and name not in late
    }


def range_lags(effects: effect_table.Effects) -> dict:
    """Return the effects with memory on a rangefinder alone.

    Parameters
    ----------
    effects : that are on.

    Notes
    -----
    With them samples depend on one another, which forces need not wait for.
    """
    return {
        name: values
        for name, values in effects.items()
        if (effect := effect_table.get(name)).n_states and effect.channels == ("range",)
    }


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """One evaluation of a flight, which the next one reuses where nothing changed.

    Attributes
    ----------
    drive, motion : of the flight.
    samples : of both, as the library reads them.
    effects : that were on.
    output : the model's, along the flight.
    range_output : the model's for a rangefinder, see :func:`_range_output`; None where its
        residual was taken over.
    residuals : by channel, (m,).
    """

    drive: Drive
    motion: Motion
    samples: effect_table.Samples
    effects: effect_table.Effects
    output: effect_table.Replay
    range_output: effect_table.Replay | None
    residuals: Mapping[str, np.ndarray]

    def flies_the_same(self, drive: Drive, motion: Motion) -> bool:
        """Return whether rotor speeds and motion are those of this evaluation.

        Parameters
        ----------
        drive, motion : of another evaluation.
        """
        return motion is self.motion and (
            drive is self.drive or np.array_equal(drive.acting, self.drive.acting)
        )

    def stack(self, names: Sequence[str]) -> np.ndarray:
        """Return residuals side by side.

        Parameters
        ----------
        names : k channels.

        Returns
        -------
        (m, k).
        """
        return np.stack([self.residuals[name] for name in names], axis=1)

    def has_same_output(self, output: effect_table.Replay, motion: Motion, block: str) -> bool:
        """Return whether the model output that a block of channels depends on is the same.

        Parameters
        ----------
        output, motion : of another evaluation.
        block : of channels.
        """
        return motion is self.motion and all(
            np.array_equal(output[name], self.output[name]) for name in _OUTPUTS_OF_BLOCK[block]
        )


def residual(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    extra_effects: effect_table.Effects | None = None,
) -> np.ndarray:
    """Compute residuals, recorded minus modelled.

    Parameters
    ----------
    flight, windows, model, names, extra_effects : as for :func:`evaluate`.

    Returns
    -------
    (windows, channels) in N, N m, rad/s and m.
    """
    return evaluate(flight, windows, model, names, extra_effects).stack(names)


def evaluate(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    extra_effects: effect_table.Effects | None = None,
    reuse: Evaluation | None = None,
    drive: Drive | None = None,
    output: effect_table.Replay | None = None,
) -> Evaluation:
    """Compute the residuals of one flight, recorded minus modelled, by window and channel.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight.
    model : that is evaluated.
    names : channels, those of faster test functions included (see :func:`with_higher_orders`).
    extra_effects : effects added to those of the model, for this evaluation.
    reuse : evaluation without ``extra_effects``, whose unchanged parts are shared.
    drive, output : with ``extra_effects``, where they are known.
    """
    effects = model.with_effects(extra_effects).effects if extra_effects else model.effects
    if drive is None:
        drive = (
            reuse.drive
            if reuse and not affects_drive(extra_effects or {}, model.effects)
            else fly_drives(flight, model, [effects], names)[0]
        )
    motion = (
        reuse.motion
        if reuse and not _turning_faults(extra_effects or {})
        else motion_of(flight, model, effects, reuse.motion if reuse else None)
    )
    same = reuse if reuse and reuse.flies_the_same(drive, motion) else None
    samples = same.samples if same else _samples(flight, motion, drive.acting)
    modelled = without_actuators(effects)
    if output is None:
        output = (
            same.output
            if same and modelled == without_actuators(same.effects)
            else effect_table.replay(
                model.parameters, samples, modelled, model.terrain, wanted=_outputs_of(names)
            )
        )
    range_output = None
    same_lags = reuse is not None and range_lags(effects) == range_lags(reuse.effects)
    residuals: dict[str, np.ndarray] = {}
    for block in dict.fromkeys(block_of(name) for name in names):
        # the effect of a column reaches few blocks: the others are those of the evaluation before
        if (
            reuse
            and (
                drive is reuse.drive
                if block == "drive"
                else reuse.has_same_output(output, motion, block)
            )
            and (block != "range" or same_lags)
        ):
            residuals.update(
                {name: value for name, value in reuse.residuals.items() if block_of(name) == block}
            )
        else:
            block_output = output
            if block == "range":
                block_output = range_output = _range_output(
                    flight, model, effects, drive, motion, output, reuse
                )
            residuals.update(
                _BLOCKS[block](flight, windows, model, names, drive, motion, block_output)
            )
    return Evaluation(drive, motion, samples, effects, output, range_output, residuals)


def _range_output(
    flight: Prepared,
    model: Model,
    effects: effect_table.Effects,
    drive: Drive,
    motion: Motion,
    output: effect_table.Replay,
    reuse: Evaluation | None,
) -> effect_table.Replay:
    """Return model output for a rangefinder, with its memory, and with the attitude as it was read.

    On uneven ground its beam sees a patch and not a point. Where it falls carries no information on
    an error of the attitude.
    """
    if not _turning_faults(effects) and not range_lags(effects):
        return output
    seen = _of_the_range(effects)
    if reuse and reuse.range_output and seen == _of_the_range(reuse.effects):
        return reuse.range_output
    samples = _samples(flight, motion_of(flight, model, {}, motion), drive.acting)
    wanted = _outputs_of(["range"])
    return effect_table.replay(model.parameters, samples, seen, model.terrain, wanted=wanted)


def _of_the_range(effects: effect_table.Effects) -> dict:
    """Return the effects that a rangefinder shows, its memory included: no force is among them."""
    return {
        name: values
        for name, values in effects.items()
        if "range" in effect_table.get(name).channels
    }


def replay_with_each(
    flight: Prepared, model: Model, base: Evaluation, sets: Sequence[effect_table.Effects]
) -> list:
    """Replay the model with each of several additions, in one batch.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.
    base : evaluation without additions.
    sets : additions that change neither drive nor motion.
    """
    merged = [without_actuators(model.with_effects(extra).effects) for extra in sets]
    return effect_table.replay_each(
        model.parameters, base.samples, merged, model.terrain, wanted=base.output.names
    )


def depend_on_path_alone(effects: effect_table.Effects, on: effect_table.Effects) -> bool:
    """Return whether effects have memory of the path, and change neither drive nor motion.

    Parameters
    ----------
    effects : that are added.
    on : effects that are on.
    """
    remembers = any(effect_table.get(name).remembers_the_path for name in effects)
    return remembers and not _turning_faults(effects) and not affects_drive(effects, on)


def _test_functions_of(
    windows: Windows, channel: str, names: Sequence[str]
) -> list[tuple[str, csr_array, csr_array]]:
    """Return every test function of one channel: mark of its name, weights, rate weights."""
    return [(mark, *pair) for mark, pair in windows.functions.items() if channel + mark in names]


def _force(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    output: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """Return the residual m (a - g) - F in the body frame, with the nominal mass.

    In that unit a payload scales the model and not the measurement, noise and all. The derivative
    of the velocity is in the test function.
    """
    v, apparent = motion.velocity_terms
    nominal_mass = model.number("mass_kg")
    acting = (nominal_mass / float(output["mass_kg"][0])) * output.force_N
    residual = nominal_mass * (windows.rate @ v) + windows.mean @ (nominal_mass * apparent - acting)
    return dict(zip(FORCE, residual.T, strict=True))


def _moment(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    output: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """Return the residual I dOmega + Omega x I Omega - M in the body frame.

    It is scaled by nominal over modelled inertia.

    In that unit a wrong inertia scales the model and not the measurement. Otherwise the best fit
    would shrink both to nothing.
    """
    omega, inertia = motion.omega, output.stack("ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2")
    nominal = np.array([model.number(f"i{a}_kg_m2") for a in ("xx", "yy", "zz")])
    # (1) of docs/method.md over the modelled inertia, then times the nominal one
    acting = (np.cross(omega, inertia * omega) - output.moment_Nm) / inertia
    residuals = [
        (mark, nominal * (rate @ omega + mean @ acting))
        for mark, mean, rate in _test_functions_of(windows, "moment_x", names)
    ]
    return {
        name + mark: column
        for mark, each in residuals
        for name, column in zip(MOMENT, each.T, strict=True)
    }


def _acc(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    output: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """Return the residual of the accelerometer, as a force with the nominal mass."""
    columns = {name: f"{name}_m_s2" for name in ACC if name in names}
    # as the acceleration of a force: with the nominal mass
    nominal_mass = model.number("mass_kg")
    return {
        n: windows.mean @ (nominal_mass * (flight.columns[c] - output[c]))
        for n, c in columns.items()
    }


def _drive(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    output: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """Return the residual of the rotor speeds against those that the commands make."""
    if drive.commanded is None:
        raise ValueError("the drive was not flown from the commands; ask for its channels too")
    residual = flight.stack("rotor_speed") - drive.commanded
    residuals = [
        (mark, mean @ residual) for mark, mean, _ in _test_functions_of(windows, "drive_1", names)
    ]
    return {
        name + mark: column
        for mark, each in residuals
        for name, column in zip(drive_channels(each.shape[1]), each.T, strict=True)
    }


def _range(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    output: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """Return the residual of the rangefinder."""
    return {"range": windows.mean @ (flight.columns["range_m"] - output["range_m"])}


_BLOCKS = {"force": _force, "moment": _moment, "acc": _acc, "drive": _drive, "range": _range}
# What of the model each block rests on; the drive rests on its speeds alone.
_OUTPUTS_OF_BLOCK = {
    "force": ("mass_kg", "force_x_N", "force_y_N", "force_z_N"),
    "moment": ("moment_x_Nm", "moment_y_Nm", "moment_z_Nm", "ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"),
    "acc": ("mass_kg", "acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2"),
    "range": ("range_m",),
    "drive": (),
}


def _outputs_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return what of the model's output channels rest on."""
    blocks = dict.fromkeys(block_of(name) for name in names)
    return tuple(dict.fromkeys(o for block in blocks for o in _OUTPUTS_OF_BLOCK[block]))
