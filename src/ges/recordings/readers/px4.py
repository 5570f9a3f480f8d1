"""PX4 ULog, by pyulog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html.

World NED, body FRD. Message definitions: PX4-Autopilot ``msg/*.msg``; parameters by their PX4
names.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyulog

from ges.conventions import (
    BODY_RATE,
    FEWEST_ROTORS,
    MAX_ROTORS,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
)
from ges.errors import GesError
from ges.recordings.readers import frames, rotor_order
from ges.recordings.readers.log import Log, Options, Stream, increasing

_MAGIC = b"ULog\x01\x12\x35"
_HEADER, _MESSAGE_HEADER = 16, 3
_DEFINITIONS, _HUGE_ARRAY = 2**20, rb"\[\d{6,}\]"
_LONGEST_CIRCLE = 200_000  # reads; twice the longest message, through which pyulog goes bytewise
TOPICS = (
    "vehicle_attitude",
    "vehicle_angular_velocity",
    "sensor_combined",
    "vehicle_local_position",
    "actuator_outputs",
    "actuator_motors",
    "battery_status",
    "distance_sensor",
    "esc_status",
    "trajectory_setpoint",
    "vehicle_local_position_setpoint",
)
_DOWNWARD = 25  # distance_sensor.orientation, MAV_SENSOR_ROTATION_PITCH_270
_MOTOR_1 = 101  # actuator function of motor 1
_LATEST_SAMPLE_S = 0.2

# MAV_TYPE (https://mavlink.io/en/messages/common.html) of what is no multirotor, and the motors of
# what is one.
_NO_MULTIROTOR = {
    1: "a fixed-wing aircraft",
    3: "a coaxial helicopter",
    4: "a helicopter",
    10: "a rover",
    11: "a boat",
    12: "a submarine",
    **dict.fromkeys(range(19, 26), "a VTOL aircraft"),
}
_MOTORS = {2: 4, 13: 6, 14: 8, 15: 3, 29: 12, 35: 10}

# Outputs that can drive motors, by the prefix of their parameters <prefix>_FUNCn, _MINn, _MAXn.
_DRIVERS = ("PWM_MAIN", "PWM_AUX", "UAVCAN_EC", "SIM_GZ_EC", "HIL_ACT", "PCA9685", "PWM_EXTRA")

# PX4 drivers/dshot: values up to 1999, the lowest that spins DSHOT_MIN of it. A pulse width is
# never below 700 us.
_DSHOT_TIMERS = (-5, -4, -3, -2)
_DSHOT_TOP, _DSHOT_LOWEST, _SHORTEST_PULSE_US = 1999.0, 0.055, 700.0
_SIMULATED_PULSE_US = (1000.0, 2000.0)  # simulation/pwm_out_sim, which has no range parameters
_UAVCAN_RANGE = (1.0, 8191.0)
_LOWEST_CELL_V = 2.0

# Up to 1.12, MOT_ORDERING 1 puts PX4's motors 1 to 4 on the outputs where Betaflight has them.
_BETAFLIGHT_ORDER = (1, 2, 3, 0)


class _Topic:
    """One instance of a topic; samples whose time does not increase are left out."""

    def __init__(self, number: int, data: Mapping[str, np.ndarray], start_us: float) -> None:
        self.number = number
        stamp = np.asarray(data["timestamp"]).astype(float)
        # damaged or repeated messages are no samples
        good, _ = increasing(stamp)
        self._data, self._good = data, good
        self.t_s = (stamp[good] - start_us) * 1e-6

    def has(self, *fields: str) -> bool:
        return all(self.values(field) is not None for field in fields)

    def values(self, field: str, valid: str = "") -> np.ndarray | None:
        """Give the values of a field; NaN where the log's own flag says that they are not valid.

        Returns
        -------
        Values (n,); None for a field that is not there.
        """
        if field not in self._data:
            return None
        try:
            values = np.asarray(self._data[field]).astype(float)[self._good]
        except (TypeError, ValueError):
            return None
        flags = self.values(valid) if valid else None
        return values if flags is None else np.where(flags == 1, values, np.nan)

    def valid_values(self, field: str, valid: str = "") -> np.ndarray:
        """Give the values of a field that is there, as :meth:`values` does.

        Raises
        ------
        KeyError
            When it is not there.
        """
        values = self.values(field, valid)
        if values is None:
            raise KeyError(field)
        return values

    def stack(self, form: str, keys: Iterable[int | str] = range(3)) -> np.ndarray:
        """Stack fields ``form.format(k)`` as rows."""
        return np.stack([self.valid_values(form.format(k)) for k in keys])

    def measured_s(self) -> np.ndarray:
        """Give the times at which the samples were measured, where the log has increasing ones.

        Otherwise they are the times at which the samples were published.
        """
        sample = self.values("timestamp_sample")
        if sample is None:
            return self.t_s
        stamp = self.valid_values("timestamp")
        t_s = self.t_s + (sample - stamp) * 1e-6
        # a stamp of another clock would move samples far
        near = np.abs(t_s - self.t_s).max(initial=0.0) < _LATEST_SAMPLE_S
        return t_s if near and np.all(np.diff(t_s) > 0) else self.t_s


class Uorb:
    """Topics, parameters and notes of a log of PX4's own messages, of a ULog or a ROS bag.

    ``unusable`` has what is logged and not used, as of :class:`~ges.recordings.readers.log.Log`.

    Parameters
    ----------
    name : name of the log, for messages.
    start_us : time stamp that becomes t = 0.
    parameters : PX4 parameters, as far as they are known.
    about : what the log says of firmware and board.
    """

    def __init__(
        self, name: str, start_us: float, parameters: Mapping = {}, about: Mapping = {}
    ) -> None:
        self.name, self.start_us = name, start_us
        self.notes: list[str] = []
        self.unusable: dict[str, str] = {}
        self.parameters, self.about = _numbers(parameters), about
        self._instances: dict[str, list[_Topic]] = {}

    def add(self, name: str, number: int, data: Mapping[str, np.ndarray]) -> None:
        """Add one instance of a topic.

        Parameters
        ----------
        name : name of the topic.
        number : number of the instance.
        data : (n,) by field; ``timestamp`` in microseconds is among them, or the instance is
            ignored.
        """
        if "timestamp" in data:
            topic = _Topic(number, data, self.start_us)
            if len(topic.t_s) > 1:
                self._instances.setdefault(name, []).append(topic)

    def instances(self, name: str, *fields: str) -> list[_Topic]:
        """List the instances of a topic that have some fields.

        Parameters
        ----------
        name : name of the topic.
        *fields : fields that an instance must have.
        """
        return [topic for topic in self._instances.get(name, ()) if topic.has(*fields)]

    def topic(self, name: str, *fields: str) -> _Topic | None:
        """Find the first instance that has some fields and is not zero throughout in all of them.

        Parameters
        ----------
        name : name of the topic.
        *fields : fields that it must have.

        Returns
        -------
        The instance, with a note where it is not the first; None if there is none.
        """
        topics = self.instances(name, *fields)
        speaking = [
            topic for topic in topics if any(_speaks(topic.valid_values(f)) for f in fields)
        ]
        if not speaking:
            return None
        if speaking[0] is not topics[0]:
            self.notes.append(
                f"{name} instance {topics[0].number} is zero throughout; instance"
                f" {speaking[0].number} is used"
            )
        return speaking[0]

    def number(self, name: str) -> float | None:
        """Look up a parameter.

        Parameters
        ----------
        name : name of the parameter.

        Returns
        -------
        Its value; None where it was not logged or is negative, which means not set.
        """
        value = self.parameters.get(name)
        return None if value is None or value < 0 else value


def _numbers(values: Mapping) -> dict[str, float]:
    numbers = {}
    for name, value in values.items():
        with contextlib.suppress(TypeError, ValueError):
            numbers[str(name)] = float(value)
    return numbers


def _speaks(values: np.ndarray) -> bool:
    return bool(np.any(np.isfinite(values) & (values != 0)))


def _is_whole(data: bytes) -> bool:
    """Tell whether the messages of a log end where the file ends."""
    at = _HEADER
    while at + _MESSAGE_HEADER <= len(data):
        at += _MESSAGE_HEADER + int.from_bytes(data[at : at + 2], "little")
    return at == len(data)


class _Advancing(io.BytesIO):
    """Bytes that may not be read in circles.

    pyulog does so where a damaged length sends it back more than it came forward.
    """

    _furthest, _since = 0, 0

    def read(self, size: int | None = -1) -> bytes:
        out = super().read(size)
        self._since = 0 if self.tell() > self._furthest else self._since + 1
        self._furthest = max(self._furthest, self.tell())
        if self._since > _LONGEST_CIRCLE:
            raise EOFError(f"a damaged length near byte {self._furthest}")
        return out


def _open(path: Path) -> Uorb:
    data = path.read_bytes()
    try:
        # pyulog prints what it finds damaged, and raises whatever damaged bytes lead it to
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
            # a damaged definition could have pyulog ask for all of the memory
            if re.search(_HUGE_ARRAY, data[:_DEFINITIONS]):
                raise ValueError("a format with an array of millions")
            raw = pyulog.ULog(_Advancing(data), list(TOPICS))
        log = Uorb(path.stem, float(raw.start_timestamp), raw.initial_parameters, raw.msg_info_dict)
        for topic in raw.data_list:
            log.add(topic.name, topic.multi_id, topic.data)
    except Exception as error:
        raise GesError(
            f"{path.name} is cut short or damaged before its first sample"
            f" ({type(error).__name__}: {error}); take a fresh copy from the vehicle"
        ) from None
    if not _is_whole(data) or raw.file_corruption:
        log.notes.append("the log is cut short or damaged; the samples that can be read are used")
    dropout_s = sum(dropout.duration for dropout in raw.dropouts) * 1e-3
    if dropout_s > 0:
        log.notes.append(
            f"the logger lost {dropout_s:.2g} s of samples ({len(raw.dropouts)} dropouts)"
        )
    return log


def _attitude(log: Uorb) -> Iterator[tuple[str, Stream]]:
    topic = log.topic("vehicle_attitude", *(f"q[{k}]" for k in range(4)))
    if topic is not None:
        q = frames.attitude_from_ned(topic.stack("q[{}]", range(4)))
        yield (
            "attitude",
            Stream(topic.measured_s(), frames.named(QUATERNION, q), "vehicle_attitude"),
        )


def _inertial(log: Uorb) -> Iterator[tuple[str, Stream]]:
    """Give body rates by the best source that the log has, and specific force."""
    sources: tuple[tuple[str, str, Sequence[int | str]], ...] = (
        ("vehicle_angular_velocity", "xyz[{}]", range(3)),
        ("sensor_combined", "gyro_rad[{}]", range(3)),
        ("vehicle_attitude", "{}speed", ("roll", "pitch", "yaw")),
    )
    for name, form, keys in sources:
        topic = log.topic(name, *(form.format(k) for k in keys))
        if topic is not None:
            columns = frames.named(BODY_RATE, frames.flu_from_frd(topic.stack(form, keys)))
            yield "rates", Stream(topic.measured_s(), columns, name)
            break
    form = "accelerometer_m_s2[{}]"
    topic = log.topic("sensor_combined", *(form.format(k) for k in range(3)))
    if topic is not None:
        columns = frames.named(SPECIFIC_FORCE, frames.flu_from_frd(topic.stack(form)))
        yield "acceleration", Stream(topic.t_s, columns, "sensor_combined")


def _motion(log: Uorb) -> Iterator[tuple[str, Stream]]:
    """Give position and velocity where the log calls them valid."""
    for stream, names, fields, flags in (
        ("position", POSITION, ("x", "y", "z"), ("xy_valid", "xy_valid", "z_valid")),
        ("velocity", VELOCITY, ("vx", "vy", "vz"), ("v_xy_valid", "v_xy_valid", "v_z_valid")),
    ):
        topic = log.topic("vehicle_local_position", *fields)
        if topic is None:
            continue
        # a coordinate counts where its own flag does: height may be known without a place
        north, east, down = (topic.valid_values(f, ok) for f, ok in zip(fields, flags, strict=True))
        columns = frames.named(names, frames.enu_from_ned(north, east, down))
        for name, flag in zip(names, flags, strict=True):
            if not np.isfinite(columns[name]).any():
                source = "no GPS, optical flow or motion capture" if "xy" in flag else "nothing"
                log.unusable[name] = (
                    f"{flag} of vehicle_local_position is 0 throughout: {source} gave the estimator"
                    f" a {stream}"
                )
        if valid := {name: v for name, v in columns.items() if np.isfinite(v).any()}:
            yield stream, Stream(topic.measured_s(), valid, "vehicle_local_position")
    if topic := log.topic("vehicle_local_position", "x", "y", "z"):
        counters = [topic.values(f"{of}_reset_counter") for of in ("xy", "z", "vxy", "vz")]
        # the estimator's own counts of its jumps
        resets = sum(np.count_nonzero(np.diff(c)) for c in counters if c is not None)
        if resets:
            log.notes.append(
                f"the estimator was reset {resets} times while it was logged: position or velocity"
                " jumps there, though the vehicle did not"
            )


def _references(log: Uorb) -> Iterator[tuple[str, Stream]]:
    """Give what the position controller was asked for.

    ``vehicle_local_position_setpoint`` holds the velocity that the controller asked of itself after
    it had seen the position error. That is a response to disturbances and no reference. So only
    what stands without a position is taken of it (PX4
    ``PositionControl::getLocalPositionSetpoint``).
    """
    vectors = {"position": "position[{}]", "velocity": "velocity[{}]"}
    new = log.topic("trajectory_setpoint", *(f.format(0) for f in vectors.values()))
    old = log.topic("trajectory_setpoint", "x", "vx") or log.topic(
        "vehicle_local_position_setpoint", "x", "vx"
    )
    if new is not None:
        position, velocity = (new.stack(form) for form in vectors.values())
        topic, source = new, "trajectory_setpoint"
    elif old is not None:
        position, velocity = (old.stack(form, "xyz") for form in ("{}", "v{}"))
        # beside a position it is the controller's own answer to the error
        velocity = np.where(np.isfinite(position), np.nan, velocity)
        topic, source = old, "vehicle_local_position_setpoint"
    else:
        return
    columns = {
        **frames.named(POSITION_REF, frames.enu_from_ned(*position)),
        **frames.named(VELOCITY_REF, frames.enu_from_ned(*velocity)),
    }
    heading = topic.values("yaw")
    if heading is not None:
        columns["yaw_ref_rad"] = frames.yaw_from_heading(heading)
    asked = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    if asked:
        yield "reference", Stream(topic.t_s, asked, source, held=True)


def _motors(log: Uorb) -> int:
    """Count the motors, by the geometry of newer firmware, or by the kind of vehicle."""
    count = log.number("CA_ROTOR_COUNT")
    if count and log.parameters.get("CA_AIRFRAME", 0) == 0:
        return int(count)
    return _MOTORS.get(int(log.number("MAV_TYPE") or 0), 4)


def _commands(log: Uorb, options: Options) -> Iterator[tuple[str, Stream]]:
    """Give normalised motor commands: ``actuator_motors``, else outputs over their own range."""
    count = _motors(log)
    fields = [f"control[{k}]" for k in range(count)]
    topic = log.topic("actuator_motors", *fields)
    if topic is not None:
        control = topic.stack("control[{}]", range(count))
        # by its definition NaN stops the motor, and below 0 it turns backwards, which no output
        # here can express
        control = np.where(np.isnan(control), 0.0, control)
        if (backwards := np.mean(control < 0)) > 0.01:
            log.notes.append(
                f"{backwards:.0%} of the motor commands are negative (reversible motors); they are"
                " taken as 0"
            )
        u, t_s, source = np.clip(control, 0.0, 1.0), topic.t_s, "actuator_motors"
    elif (outputs := _outputs(log, options)) is not None:
        u, t_s, source = outputs
    else:
        return
    if not np.any(u > 0):
        log.notes.append(
            "the motor commands never leave zero; the vehicle was not armed, or other outputs"
            " drive it"
        )
    if bend := log.parameters.get("THR_MDL_FAC"):
        where = "before" if source == "actuator_motors" else "after"
        log.notes.append(
            f"THR_MDL_FAC is {bend:.2g}: the autopilot bends its commands so that thrust follows"
            f" them; the commands taken here ({source}) are those {where} that"
        )
    yield "command", Stream(t_s, {f"u_{i + 1}": row for i, row in enumerate(u)}, source)


def _outputs(log: Uorb, options: Options) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Give commands (motors, n) from what was sent to the motors; their times and source."""
    channels, driver = _channels(log)
    fields = [f"output[{k}]" for k in channels]
    topics = log.instances("actuator_outputs", *fields)
    # several drivers log outputs; those of the motors change in flight
    moving = [t for t in topics if any(np.ptp(t.valid_values(f)) > 0 for f in fields)]
    topic = next(iter(moving), None) or log.topic("actuator_outputs", *fields)
    if topic is None:
        return None
    if moving and moving[0] is not topics[0]:
        log.notes.append(
            f"actuator_outputs instance {topics[0].number} stands still; instance"
            f" {topic.number} is used"
        )
    sent = topic.stack("output[{}]", channels)
    # what the user says of the range goes before what the log says
    ranges = [options.pwm] * len(channels) if options.pwm else None
    low, high = np.asarray(ranges or _ranges(log, sent, channels, driver), dtype=float).T
    u = np.clip((sent - low[:, None]) / (high - low)[:, None], 0.0, 1.0)
    return u, topic.t_s, "actuator_outputs"


def _channels(log: Uorb) -> tuple[list[int], str]:
    """Give the output of each motor, and the prefix of the driver's parameters.

    From 1.13 on motors are known by their functions, before that by the mixer's order.
    """
    for driver in _DRIVERS:
        functions = {log.parameters.get(f"{driver}_FUNC{n}"): n - 1 for n in range(1, 17)}
        motors = [float(_MOTOR_1 + i) for i in range(_motors(log))]
        # a driver that has all motors is the one they hang on
        if all(motor in functions for motor in motors):
            return [functions[motor] for motor in motors], driver
    betaflight = log.parameters.get("MOT_ORDERING") == 1
    return list(_BETAFLIGHT_ORDER if betaflight else range(_motors(log))), "PWM_MAIN"


def _ranges(
    log: Uorb, sent: np.ndarray, channels: list[int], driver: str
) -> list[tuple[float, float]]:
    """Give the outputs that mean command 0 and 1, for each motor."""
    # 0 is no pulse, or a motor that stands
    on = sent[np.isfinite(sent) & (sent > 0)]
    if driver.startswith("PWM") and _is_dshot(log, driver, on):
        lowest = log.number("DSHOT_MIN")
        return [((_DSHOT_LOWEST if lowest is None else lowest) * _DSHOT_TOP, _DSHOT_TOP)] * len(
            channels
        )
    # no pulse is that long: UAVCAN of a firmware that does not name its drivers
    if len(on) and driver.startswith("PWM") and on.max() > 2.0 * _SIMULATED_PULSE_US[1]:
        return [_UAVCAN_RANGE] * len(channels)
    ranges = []
    for n in channels:
        low, high = (
            next(
                (
                    value
                    for form in (f"{driver}_{end}{n + 1}", f"{driver}_{end}", f"PWM_{end}")
                    if (value := log.number(form)) is not None
                ),
                None,
            )
            for end in ("MIN", "MAX")
        )
        if (low is None or high is None) and "SITL" in str(log.about.get("ver_hw")):
            low, high = _SIMULATED_PULSE_US
        if low is None or high is None or not high > low:
            raise GesError(
                f"{log.name} holds motor outputs but not which of them mean 0 and 1"
                f" ({driver}_MIN{n + 1}, {driver}_MAX{n + 1}, PWM_MIN, PWM_MAX); give their range,"
                " e.g. --pwm 1000 2000"
            )
        ranges.append((low, high))
    return ranges


def _is_dshot(log: Uorb, driver: str, on: np.ndarray) -> bool:
    """Tell whether outputs are DShot values.

    By DSHOT_CONFIG (up to 1.12), by the timers (from 1.13 on), or as no pulse is that short.
    """
    timers = [log.parameters.get(f"{driver}_TIM{k}") for k in range(8)]
    return (
        log.parameters.get("DSHOT_CONFIG", 0) > 0
        or any(timer in _DSHOT_TIMERS for timer in timers)
        or (len(on) > 0 and float(on.min()) < _SHORTEST_PULSE_US)
    )


def _rotor_speeds(
    log: Uorb, options: Options, command: Stream | None
) -> Iterator[tuple[str, Stream]]:
    """Give rotor speeds by the function of each speed controller.

    Without functions they are in the order of the log, if the commands agree with that.
    """
    # eight readings are always there; those of no controller are zero throughout
    readings = [k for k in range(8) if log.topic("esc_status", f"esc[{k}].esc_rpm")]
    topic = log.topic("esc_status", *(f"esc[{k}].esc_rpm" for k in readings[:1]))
    if topic is None:
        return
    # a controller's function is a motor's number where it never changes
    functions = {_constant(topic.values(f"esc[{k}].actuator_function")): k for k in range(8)}
    count = _motors(log)
    motors, stated = [float(_MOTOR_1 + i) for i in range(count)], options.order_of(count)
    order = list(range(count))
    assigned = bool(stated) or all(motor in functions for motor in motors)
    if assigned:
        order = [k - 1 for k in stated] if stated else [functions[motor] for motor in motors]
    if not topic.has(*(f"esc[{k}].esc_rpm" for k in order)):
        log.notes.append("the log has speeds of some rotors only; they are not used")
        return
    speeds = Stream(topic.t_s, dict(_each_esc(topic, order, "rpm")), "esc_status")
    # in which order controllers were wired, only the commands can show
    if not assigned and command is not None:
        why, _ = rotor_order.check_order(command, speeds)
        if why:
            log.notes.append(
                "the rotor speeds are not used, as the log does not say which motor each is of and"
                f" {why}; if you know it, give the order, e.g. --rotor-order 1,2,3,4"
            )
            return
    if order != list(range(count)):
        log.notes.append(
            f"rotor speeds of motors 1 to {count} are readings"
            f" {', '.join(str(k + 1) for k in order)} of esc_status"
        )
    yield "rotor_speed", speeds
    currents = dict(_each_esc(topic, order, "current"))
    if all(_speaks(values) for values in currents.values()):
        yield "motor_current", Stream(topic.t_s, currents, "esc_status")


def _constant(values: np.ndarray | None) -> float | None:
    """Give the value that a field has throughout; None where it changes."""
    return float(values[0]) if values is not None and np.all(values == values[0]) else None


def _each_esc(topic: _Topic, order: list[int], what: str) -> Iterator[tuple[str, np.ndarray]]:
    """Give one quantity of every speed controller; NaN while it is offline."""
    online = topic.values("esc_online_flags")
    for i, k in enumerate(order, 1):
        values = topic.values(f"esc[{k}].esc_{what}")
        if values is None:
            values = np.full(len(topic.t_s), np.nan)
        if online is not None and _speaks(online):
            # bit k of the flags is controller k
            values = np.where((online.astype(int) >> k) & 1, values, np.nan)
        if what == "rpm":
            # the sign is the sense of rotation, which the vehicle file knows
            yield f"rotor_speed_{i}_rad_s", np.abs(values) * (np.pi / 30)
        else:
            yield f"motor_current_{i}_A", values


def _battery(log: Uorb) -> Iterator[tuple[str, Stream]]:
    topic = log.topic("battery_status", "voltage_v")
    if topic is None:
        return
    volts, amperes = topic.valid_values("voltage_v"), topic.values("current_a")
    if (usual := float(np.median(volts[np.isfinite(volts)]))) < _LOWEST_CELL_V:
        log.notes.append(
            f"the battery voltage reads {usual:.2g} V, which no battery has; it is not used"
        )
        return
    columns = {"battery_V": np.where(volts > 0, volts, np.nan)}
    # -1 means that nothing measures it
    if amperes is not None and np.any(amperes > 0):
        columns["battery_A"] = np.where(amperes >= 0, amperes, np.nan)
    yield "battery", Stream(topic.t_s, columns, "battery_status")


def _range(log: Uorb) -> Iterator[tuple[str, Stream]]:
    """Give the first rangefinder that looks down, within its own range."""
    for topic in log.instances("distance_sensor", "current_distance"):
        facing, seen = topic.values("orientation"), topic.valid_values("current_distance")
        if not _speaks(seen) or (facing is not None and np.any(facing != _DOWNWARD)):
            continue
        nearest, farthest = topic.values("min_distance"), topic.values("max_distance")
        # out of its own range a reading says nothing
        if nearest is not None and farthest is not None and np.all(farthest > nearest):
            seen = np.where((seen >= nearest) & (seen <= farthest), seen, np.nan)
        if np.isfinite(seen).any():
            yield "range", Stream(topic.t_s, {"range_m": seen}, "distance_sensor")
        return


def _refusal(log: Uorb) -> str:
    """Say why the vehicle is none that can be diagnosed, by the log's own parameters."""
    # by the kind of vehicle, or by the rotors that newer firmware counts
    kind = _NO_MULTIROTOR.get(int(log.number("MAV_TYPE") or 0))
    if kind is None and _motors(log) not in range(FEWEST_ROTORS, MAX_ROTORS + 1):
        kind = f"a vehicle with {_motors(log)} rotors"
    return f"this is a log of {kind}; multirotors can be diagnosed" if kind else ""


def _autopilot(log: Uorb) -> str:
    """Name the firmware with its version (0xMMmmppTT) and board."""
    release, board = log.about.get("ver_sw_release"), log.about.get("ver_hw")
    version = ""
    if isinstance(release, int):
        version = " " + ".".join(str(release >> shift & 0xFF) for shift in (24, 16, 8))
    return f"PX4{version}" + (f" on {board}" if isinstance(board, str) and board else "")


def uorb_streams(log: Uorb, options: Options) -> dict[str, Stream]:
    """Convert PX4's own messages to streams.

    Parameters
    ----------
    log : the messages; remarks are added to its notes.
    options : ``pwm`` and ``rotor_order`` are used.

    Returns
    -------
    Streams by name, in ENU and FLU.

    Raises
    ------
    GesError
        When motor outputs have no range.
    UsageError
        When ``rotor_order`` is of another number of motors.
    """
    streams: dict[str, Stream] = {}
    for part in (_attitude, _inertial, _motion, _references, _battery, _range):
        streams |= dict(part(log))
    streams |= dict(_commands(log, options))
    streams |= dict(_rotor_speeds(log, options, streams.get("command")))
    return streams


class Px4:
    """Reader of PX4 ULogs.

    Attributes
    ----------
    name, title, advice : as of :class:`~ges.recordings.readers.log.Reader`.
    """

    name = "px4"
    title = "PX4 ULog (.ulg)"
    advice = {
        **dict.fromkeys(
            ("attitude", "rates", "acceleration", "command"),
            "SDLOG_PROFILE 25 (default set, system identification, high rate)",
        ),
        **dict.fromkeys(
            ("position", "velocity"),
            "a file etc/logging/logger_topics.txt on the card with the line"
            " 'vehicle_local_position 20' (ms), and the other topics that you need beside it, as it"
            " replaces the profile",
        ),
        "rotor_speed": (
            "ESC telemetry: DSHOT_BIDIR_EN 1 (bidirectional DShot), or DSHOT_TEL_CFG (telemetry"
            " wire), or UAVCAN speed controllers; the topic is esc_status"
        ),
        "battery": "the battery monitor (BAT1_SOURCE, BAT1_V_DIV calibrated)",
        "reference": (
            "a flight in Position, Mission or Offboard mode; in Manual and Stabilized there are no"
            " references"
        ),
        "range": "a rangefinder that looks down (topic distance_sensor)",
    }

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether the first bytes are those of a ULog."""
        return head.startswith(_MAGIC)

    def read(self, path: Path, options: Options) -> Log:
        """Read a ULog; t = 0 where the log starts.

        Parameters
        ----------
        path : the log.
        options : ``pwm`` and ``rotor_order`` are used.

        Returns
        -------
        Streams in ENU and FLU, see :func:`uorb_streams`.

        Raises
        ------
        GesError
            When nothing can be read, or motor outputs have no range.
        UsageError
            When ``rotor_order`` is of another number of motors.
        """
        log = _open(path)
        streams = uorb_streams(log, options)
        if "SITL" in str(log.about.get("ver_hw")):
            log.notes.append("the flight is one of a simulator (PX4 SITL)")
        return Log(
            path.stem,
            self.name,
            _autopilot(log),
            streams,
            log.parameters,
            tuple(log.notes),
            _refusal(log),
            log.unusable,
        )
