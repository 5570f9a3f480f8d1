"""Residuals in weak form: what the recording shows less what the model gives, window by window and
channel by channel.

Blocks: ``force_*`` (from velocity), ``acc_*`` (from the accelerometer, as a force), ``moment_*``
(from the gyro), ``drive_*`` (rotor speeds against commands) and ``range``. A force shows in the
first two alike; a fault of one sensor shows in one of them only. The model side always is the
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
"""Blocks that are also held against faster test functions: what acts within a few hundredths of a
second shows there.
"""


def with_higher_orders(names: Sequence[str], count: int) -> tuple[str, ...]:
    """Channels and, after them, those of the faster test functions: ``moment_x/1`` is ``moment_x``
    under the first.
    """
    fine = [name for name in names if block_of(name) in FINE]
    return (*names, *(f"{name}/{k}" for k in range(1, count + 1) for name in fine))


def height_columns(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Position (n,) by contract column, m in the world, with the logged ground taken out where one
    is logged and the terrain is flat.
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


def state_columns(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """What the library reads of every sample, rotor speeds apart: (n,) by contract column, in the
    units of their names.
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
    """What the library reads of every sample, rotor speeds apart, and what the equations of motion
    take of it.
    """

    columns: Mapping[str, np.ndarray]
    gravity_m_s2: float

    @functools.cached_property
    def omega(self) -> np.ndarray:
        """Body rates, (n, 3)."""
        return np.stack([self.columns[name] for name in BODY_RATE], axis=1)

    @functools.cached_property
    def carried(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity in the body frame, and the part of the acceleration less gravity that is not its
        derivative; (n, 3) each.
        """
        # (1) of docs/method.md without the derivative: omega x v_b + R^T g
        q = np.stack([self.columns[name] for name in QUATERNION], axis=1)
        v = to_body(q, np.stack([self.columns[name] for name in VELOCITY], axis=1))
        return v, np.cross(self.omega, v) + to_body(
            q, np.tile([0.0, 0.0, self.gravity_m_s2], (len(q), 1))
        )


def motion_of(flight: Prepared, model: Model, effects: effect_table.Effects) -> Motion:
    """Of one flight, as believed with these effects."""
    return Motion(
        corrected(state_columns(flight, model), model, effects), model.number("gravity_m_s2")
    )


def _of_kind(effects: effect_table.Effects, *kinds: str) -> dict:
    return {
        name: values for name, values in effects.items() if effect_table.get(name).kind in kinds
    }


def _turning_faults(effects: effect_table.Effects) -> dict:
    """Faults of sensors that turn what was read of attitude and rates."""
    faults = _of_kind(effects, "sensor")
    return {
        name: values
        for name, values in faults.items()
        if {"gyro", "attitude"} & set(effect_table.get(name).channels)
    }


def corrected(
    columns: dict[str, np.ndarray], model: Model, effects: effect_table.Effects
) -> dict[str, np.ndarray]:
    """Columns (n,) with attitude and rates (rad/s) as they were, if the given sensor faults had
    made the readings.
    """
    faults = _turning_faults(effects)
    if not faults:
        return columns
    said = effect_table.replay(
        model.parameters, effect_table.Samples.from_columns(columns), faults, model.terrain
    )
    # a small turn by the error e is undone by the quaternion (sqrt(1 - |e / 2|^2), -e / 2)
    turned = -0.5 * said.stack(
        "attitude_error_x_rad", "attitude_error_y_rad", "attitude_error_z_rad"
    )
    columns = dict(columns)
    if "q_w" in columns:
        q = np.stack([columns[name] for name in QUATERNION], axis=1)
        q = quaternion_product(q, np.column_stack([np.sqrt(1.0 - (turned**2).sum(axis=1)), turned]))
        columns.update(zip(QUATERNION, q.T, strict=True))
    # the fault f makes f(x) of a rate x: to first order what was read as x had been 2 x - f(x)
    for k, name in enumerate(BODY_RATE):
        columns[name] = 2.0 * columns[name] - said[f"gyro_{'xyz'[k]}_rad_s"]
    return columns


def driven_speeds(
    flights: Sequence[Prepared], model: Model, effects: effect_table.Effects
) -> list[np.ndarray]:
    """Rotor speeds that the commands make, flown through the compiled drive; (n, rotors) rad/s
    each.
    """
    return _flown(
        [
            (f, effects, _drive_inputs(f, model, commands_at_work(f, model, effects)))
            for f in flights
        ],
        model,
    )


def driven_by_each(
    flight: Prepared, model: Model, sets: Sequence[effect_table.Effects]
) -> list[np.ndarray]:
    """Rotor speeds of one flight under several sets of effects, flown as one batch; (n, rotors)
    rad/s each.
    """
    # few sets change the commands: the inputs of all others are the same
    plain = _drive_inputs(flight, model, commands_at_work(flight, model, {}))
    inputs = [
        _drive_inputs(flight, model, commands_at_work(flight, model, e)) if _modified(e) else plain
        for e in sets
    ]
    return _flown([(flight, e, table) for e, table in zip(sets, inputs, strict=True)], model)


def _flown(
    batch: Sequence[tuple[Prepared, effect_table.Effects, np.ndarray]], model: Model
) -> list[np.ndarray]:
    """Rotor speeds (n, rotors) of flights with their effects and the inputs of their drives."""
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


def _modified(effects: effect_table.Effects) -> set[str]:
    """Actuators that change the commands by what another effect says."""
    return {name for name in _of_kind(effects, "actuator") if effect_table.get(name).modifies}


def commands_at_work(flight: Prepared, model: Model, effects: effect_table.Effects) -> np.ndarray:
    """Commands that reach the motors, (n, rotors): the logged ones, changed by what acts by height
    between log and motor.

    The drive itself is flown far above the ground, so such effects are asked here, along the
    recorded path.
    """
    u = flight.stack("command").clip(0.0, 1.0)
    acting = _modified(effects)
    if not acting:
        return u
    modified = {m for a in acting if (m := effect_table.get(a).modifies)}
    on = {name: effects[name] for name in acting | modified if name in effects}
    samples = effect_table.Samples.from_columns(
        {**state_columns(flight, model), **dict(zip(command(model.n_rotors), u.T, strict=True))}
    )
    said = effect_table.replay(model.parameters, samples, on, model.terrain)
    return said.rotor_command_rad_s / model.number("max_rotor_speed_rad_s")


def _drive_inputs(flight: Prepared, model: Model, commands: np.ndarray) -> np.ndarray:
    """Commands, attitude, battery voltage and rates, a row for every step of the drive."""
    every = flight.steps(settings.numerics.step_s)
    u, voltage = (
        _between(commands, every, flight.command_hold.delay_rows),
        flight.columns.get("battery_V", np.full(len(flight.t_s), np.nan)),
    )
    # motors alone are flown: attitude is imposed level and at rest
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(u), 1))
    return np.column_stack([u, upright, np.repeat(voltage, every), np.zeros((len(u), 3))])


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


def _between(u: np.ndarray, every: int, late: float) -> np.ndarray:
    """Commands (n, rotors) at the middles of the steps of the replay, (n * every, rotors), on
    straight lines between the samples.

    The replay holds a row for its step; they act ``late`` (rows): held, see
    :func:`~.delays.command_hold`.
    """
    rows = (np.arange(len(u) * every) + 0.5) / every - late
    return np.stack([np.interp(rows, np.arange(len(u)), column) for column in u.T], axis=1)


@dataclasses.dataclass(frozen=True)
class Drive:
    """Rotor speeds that turn the air, and those that the commands make (None where nothing asks for
    them); (n, rotors) rad/s.
    """

    at_work: np.ndarray
    commanded: np.ndarray | None


def drives_of(
    flight: Prepared, model: Model, sets: Sequence[effect_table.Effects], names: Sequence[str]
) -> list[Drive]:
    """Both of one flight under each of these sets of effects, flown once."""
    if not flight.has("rotor_speed"):
        return [Drive(made, made) for made in driven_by_each(flight, model, sets)]
    commanded = driven_by_each(flight, model, sets) if "drive_1" in names else [None] * len(sets)
    return [
        Drive(speeds_at_work(flight, model, e), made)
        for e, made in zip(sets, commanded, strict=True)
    ]


def speeds_at_work(flight: Prepared, model: Model, effects: effect_table.Effects) -> np.ndarray:
    """Rotor speeds that turn the air: expected, measured, or made by the commands; (n, rotors)
    rad/s.
    """
    if flight.model_speeds is not None:
        return flight.model_speeds
    if not flight.has("rotor_speed"):
        return driven_speeds([flight], model, effects)[0]
    measured = flight.stack("rotor_speed")
    suspect = {
        name: values
        for name, values in effects.items()
        if "reads_voltage" in effect_table.get(name).hints
    }
    if not suspect or flight.has("command") or not flight.has("battery"):
        return measured
    return _as_if_commanded(flight, measured, model, suspect)


def _as_if_commanded(
    flight: Prepared, speeds: np.ndarray, model: Model, effects: effect_table.Effects
) -> np.ndarray:
    """Without commands, sag can only hide in the telemetry: speeds as the voltage would have
    changed them.
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


def drives(effects: effect_table.Effects, on: effect_table.Effects | None = None) -> bool:
    """Whether effects change the rotor speeds: actuators, and what an actuator that is ``on`` acts
    upon.
    """
    acting = [*effects, *(name for name in on or {} if effect_table.get(name).modifies in effects)]
    return any(effect_table.get(name).kind == "actuator" for name in acting)


def model_along(
    flight: Prepared,
    model: Model,
    effects: effect_table.Effects,
    speeds: np.ndarray | None = None,
    motion: Motion | None = None,
    late: bool = False,
) -> tuple[dict[str, np.ndarray], effect_table.Replay]:
    """State columns as believed, (n,) each in the units of their names, and the compiled model
    along them.

    Actuators have made the speeds and change nothing else of it: left out, none of their states is
    advanced.

    Parameters
    ----------
    speeds : (n, rotors) rotor speeds, rad/s; those at work where not given.
    motion : of :func:`motion_of`, where it is known.
    late : whether a rangefinder that remembers is asked too: one sample then waits for another.
    """
    motion = motion or motion_of(flight, model, effects)
    speeds = speeds_at_work(flight, model, effects) if speeds is None else speeds
    columns = _with_rotors(flight, motion, speeds)
    samples = effect_table.Samples.from_columns(columns)
    asked = but_actuators(effects) | (late_ranges(effects) if late else {})
    return columns, effect_table.replay(model.parameters, samples, asked, model.terrain)


def _with_rotors(flight: Prepared, motion: Motion, speeds: np.ndarray) -> dict[str, np.ndarray]:
    """All that the library reads of every sample, with these rotor speeds (n, rotors)."""
    n, rate = speeds.shape[1], np.gradient(speeds, flight.dt_s, axis=0)
    return {
        **motion.columns,
        **flight.path,
        **dict(zip(rotor_speed(n), speeds.T, strict=True)),
        **dict(zip(rotor_columns("rotor_acceleration_{}_rad_s2", n), rate.T, strict=True)),
    }


def but_actuators(effects: effect_table.Effects) -> dict:
    """Effects on what given rotor speeds do, but those of :func:`late_ranges`."""
    late = late_ranges(effects)
    return {
        name: values
        for name, values in effects.items()
        if effect_table.get(name).kind != "actuator" and name not in late
    }


def late_ranges(effects: effect_table.Effects) -> dict:
    """Effects on a rangefinder alone that remember: with them samples go one after another, which
    forces need not wait for.
    """
    return {
        name: values
        for name, values in effects.items()
        if (known := effect_table.get(name)).n_states and known.channels == ("range",)
    }


@dataclasses.dataclass(frozen=True)
class Along:
    """One evaluation of a flight: drive, motion, what the model says along it, and by channel what
    that leaves, (m,) each.

    The next evaluation takes over what it does not change.
    """

    drive: Drive
    motion: Motion
    effects: effect_table.Effects
    said: effect_table.Replay
    parts: Mapping[str, np.ndarray]

    def stack(self, names: Sequence[str]) -> np.ndarray:
        """Channels as an array of shape (m, k)."""
        return np.stack([self.parts[name] for name in names], axis=1)

    def says_alike(self, said: effect_table.Replay, motion: Motion, block: str) -> bool:
        """Whether this evaluation had the same of all that a block of channels is held against."""
        return motion is self.motion and all(
            np.array_equal(said[name], self.said[name]) for name in _HELD_AGAINST[block]
        )


def residual(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    more: effect_table.Effects | None = None,
) -> np.ndarray:
    """Recorded less modelled, (windows, channels); N, N m, rad/s and m. See :func:`along`."""
    return along(flight, windows, model, names, more).stack(names)


def along(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    more: effect_table.Effects | None = None,
    like: Along | None = None,
    drive: Drive | None = None,
    said: effect_table.Replay | None = None,
) -> Along:
    """Recorded less modelled.

    Parameters
    ----------
    names : channels, those of faster test functions included (see :func:`with_higher_orders`).
    more : effects added to those of the model, for this evaluation.
    like : evaluation without ``more``.
    drive, said : with ``more``, where they are known.
    """
    effects = model.with_effects(more).effects if more else model.effects
    if drive is None:
        drive = (
            like.drive
            if like and not drives(more or {}, model.effects)
            else drives_of(flight, model, [effects], names)[0]
        )
    motion = (
        like.motion
        if like and not _turning_faults(more or {})
        else motion_of(flight, model, effects)
    )
    if said is None:
        said = (
            _said_again(like, drive, motion, effects)
            or model_along(flight, model, effects, drive.at_work, motion)[1]
        )
    as_late = like is not None and late_ranges(effects) == late_ranges(like.effects)
    parts: dict[str, np.ndarray] = {}
    for block in dict.fromkeys(block_of(name) for name in names):
        # the effect of a column reaches few blocks: the others are those of the evaluation before
        if (
            like
            and (drive is like.drive if block == "drive" else like.says_alike(said, motion, block))
            and (block != "range" or as_late)
        ):
            parts.update(
                {name: value for name, value in like.parts.items() if block_of(name) == block}
            )
        else:
            heard = (
                _as_read(flight, model, effects, drive, said, like) if block == "range" else said
            )
            parts.update(_PARTS[block](flight, windows, model, names, drive, motion, heard))
    return Along(drive, motion, effects, said, parts)


def _as_read(
    flight: Prepared,
    model: Model,
    effects: effect_table.Effects,
    drive: Drive,
    said: effect_table.Replay,
    like: Along | None,
) -> effect_table.Replay:
    """What the model says of a rangefinder, with its memory, and with the attitude as it was read:
    where on uneven ground its beam falls, which sees a patch and not a point, speaks about no error
    of the attitude.
    """
    faults, late = _turning_faults(effects), bool(late_ranges(effects))
    if not faults and not late:
        return said
    straight = {name: values for name, values in effects.items() if name not in faults}
    known = _said_again(like, drive, like.motion, straight) if like and not late else None
    return known or model_along(flight, model, straight, drive.at_work, late=late)[1]


def said_with_each(
    flight: Prepared, model: Model, like: Along, added: Sequence[effect_table.Effects]
) -> list:
    """The :class:`Replay` with each of these additions, which change neither drive nor motion;
    asked in one batch.
    """
    samples = effect_table.Samples.from_columns(
        _with_rotors(flight, like.motion, like.drive.at_work)
    )
    sets = [but_actuators(model.with_effects(more).effects) for more in added]
    return effect_table.replay_each(model.parameters, samples, sets, model.terrain)


def act_along_the_path(effects: effect_table.Effects, on: effect_table.Effects) -> bool:
    """Whether effects remember where the vehicle has been, and change neither drive nor motion
    beside those that are ``on``.
    """
    remembers = any(effect_table.get(name).remembers_the_path for name in effects)
    return remembers and not _turning_faults(effects) and not drives(effects, on)


def _said_again(
    like: Along | None, drive: Drive, motion: Motion, effects: effect_table.Effects
) -> effect_table.Replay | None:
    """What the model said before, if nothing that it is asked about differs."""
    if like is None or motion is not like.motion:
        return None
    same = but_actuators(effects) == but_actuators(like.effects)
    return like.said if same and np.array_equal(drive.at_work, like.drive.at_work) else None


def _marked(
    windows: Windows, channel: str, names: Sequence[str]
) -> list[tuple[str, csr_array, csr_array]]:
    """Every test function that one channel is asked under: mark of its name, weights, rate
    weights.
    """
    return [(mark, *pair) for mark, pair in windows.functions.items() if channel + mark in names]


def _force(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    said: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """m (a - g) - F in the body frame, as an acceleration times the declared mass; the derivative
    of the velocity rests on the test function.

    In that unit a payload scales what the model says and not what was measured, noise and all.
    """
    v, carried = motion.carried
    declared = model.number("mass_kg")
    acting = (declared / float(said["mass_kg"][0])) * said.force_N
    left = declared * (windows.rate @ v) + windows.mean @ (declared * carried - acting)
    return dict(zip(FORCE, left.T, strict=True))


def _moment(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    said: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """I dOmega + Omega x I Omega - M in the body frame, as an angular acceleration times the
    declared inertia.

    In that unit a wrong inertia scales what the model says and not what was measured; otherwise the
    best fit would be to shrink both to nothing.
    """
    omega, inertia = motion.omega, said.stack("ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2")
    declared = np.array([model.number(f"i{a}_kg_m2") for a in ("xx", "yy", "zz")])
    # (1) of docs/method.md over the inertia that is believed, then times the declared one
    acting = (np.cross(omega, inertia * omega) - said.moment_Nm) / inertia
    left = [
        (mark, declared * (rate @ omega + mean @ acting))
        for mark, mean, rate in _marked(windows, "moment_x", names)
    ]
    return {
        name + mark: column
        for mark, each in left
        for name, column in zip(MOMENT, each.T, strict=True)
    }


def _acc(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    said: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """The accelerometer's readings less the model's, as a force."""
    columns = {name: f"{name}_m_s2" for name in ACC if name in names}
    # as the acceleration of a force: in the declared mass
    declared = model.number("mass_kg")
    return {
        n: windows.mean @ (declared * (flight.columns[c] - said[c])) for n, c in columns.items()
    }


def _lost(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    said: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """Rotor speeds less those that the commands make."""
    if drive.commanded is None:
        raise ValueError("the drive was not flown from the commands; ask for its channels too")
    lost = flight.stack("rotor_speed") - drive.commanded
    left = [(mark, mean @ lost) for mark, mean, _ in _marked(windows, "drive_1", names)]
    return {
        name + mark: column
        for mark, each in left
        for name, column in zip(drive_channels(each.shape[1]), each.T, strict=True)
    }


def _range(
    flight: Prepared,
    windows: Windows,
    model: Model,
    names: Sequence[str],
    drive: Drive,
    motion: Motion,
    said: effect_table.Replay,
) -> dict[str, np.ndarray]:
    """The rangefinder's readings less the model's."""
    return {"range": windows.mean @ (flight.columns["range_m"] - said["range_m"])}


_PARTS = {"force": _force, "moment": _moment, "acc": _acc, "drive": _lost, "range": _range}
# What of the model each block rests on; the drive rests on its speeds alone.
_HELD_AGAINST = {
    "force": ("mass_kg", "force_x_N", "force_y_N", "force_z_N"),
    "moment": ("moment_x_Nm", "moment_y_Nm", "moment_z_Nm", "ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"),
    "acc": ("mass_kg", "acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2"),
    "range": ("range_m",),
}
