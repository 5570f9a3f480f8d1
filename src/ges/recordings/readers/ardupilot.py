"""ArduPilot DataFlash (.bin and .log), by pymavlink.

Format: https://ardupilot.org/copter/docs/logmessages.html. World NED, body FRD. Parameters by their
ArduPilot names. Motors are ArduPilot's own 1 to 4, which stand where FRAME_TYPE says (quad X: 1
front right, 2 rear left, 3 front left, 4 rear right).
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ges.conventions import BODY_RATE, POSITION, QUATERNION, SPECIFIC_FORCE, VELOCITY
from ges.errors import GesError
from ges.recordings.readers import frames, rotor_order
from ges.recordings.readers.log import (
    Log,
    Options,
    Stream,
    from_first_sample,
    increasing,
    on_axis,
    optional_module,
)
from ges.vehicle import layouts
from ges.vehicle.layouts import LAYOUTS

_MAGIC, _TEXT = b"\xa3\x95", b"FMT,"
_HEADER = 3
"""Bytes of a message before its fields."""

# Message -> fields that are read; those that a log lacks are left out. An instance is told by one
# of _INSTANCES, or by a number behind the name in older logs.
_FIELDS = {
    "ATT": ("Roll", "Pitch", "Yaw", "DesYaw"),
    "RATE": ("R", "P", "Y"),
    "IMU": ("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"),
    "XKF1": ("VN", "VE", "VD", "PN", "PE", "PD"),
    "NKF1": ("VN", "VE", "VD", "PN", "PE", "PD"),
    "XKF4": ("PI",),
    "NKF4": ("PI",),
    "RCOU": tuple(f"C{n}" for n in range(1, 17)),
    "ESC": ("RPM", "Curr"),
    "BAT": ("Volt", "Curr"),
    "CURR": ("Volt", "Curr"),
    "RFND": ("Dist1", "Orient1", "Dist", "Orient", "Stat"),
    "PSC": ("TPX", "TPY", "PX", "PY"),
    "PSCN": ("TPN", "PN", "DVN"),
    "PSCE": ("TPE", "PE", "DVE"),
    "PSCD": ("TPD", "PD", "DVD"),
    "CTUN": ("DAlt", "Alt"),
    "MODE": ("ModeNum", "Mode", "Rsn"),
}
_INSTANCES = ("I", "C", "Instance", "Inst")
# Older logs number instances behind the name; IMU2 and BAT2 are the second, but ESC1 the first.
_NUMBERED = {
    **{f"IMU{n}": ("IMU", n - 1) for n in (2, 3)},
    **{f"BAT{n}": ("BAT", n - 1) for n in range(2, 5)},
    **{f"ESC{n}": ("ESC", n - 1) for n in range(1, 9)},
    "XKF6": ("XKF1", 1),
    "NKF6": ("NKF1", 1),
}

# Message and field, the estimate that a relaxed controller lets it follow, column, factor.
_ASKED = (
    ("PSCN", "TPN", "PN", "p_ref_y_m", 1.0),
    ("PSCE", "TPE", "PE", "p_ref_x_m", 1.0),
    ("PSCD", "TPD", "PD", "p_ref_z_m", -1.0),
    ("PSC", "TPX", "PX", "p_ref_y_m", 0.01),
    ("PSC", "TPY", "PY", "p_ref_x_m", 0.01),
    ("CTUN", "DAlt", "Alt", "p_ref_z_m", 1.0),
    ("ATT", "DesYaw", "Yaw", "yaw_ref_rad", 1.0),
    ("PSCN", "DVN", "", "v_ref_y_m_s", 1.0),
    ("PSCE", "DVE", "", "v_ref_x_m_s", 1.0),
    ("PSCD", "DVD", "", "v_ref_z_m_s", -1.0),
)
_WITHOUT_HEIGHT = (0, 1, 14)  # MODE: Stabilize, Acro, Flip

_DOWNWARD, _GOOD = 25, 4  # RFND.Orient ROTATION_PITCH_270, RFND.Stat
_MOTOR_1 = 33  # SERVOn_FUNCTION
_DSHOT = range(4, 8)  # MOT_PWM_TYPE; outputs are then always 1000 to 2000
_DSHOT_RANGE = (1000.0, 2000.0)
_LEAST_PULSE_US = 500.0  # RCOU 0: no pulse

# SERVOn_FUNCTION of motors 9 to 12, and the motors of a tricopter, whose seventh is a servo.
_MOTOR_9, _TRICOPTER, _TRI_MOTORS = 82, 7, (1, 2, 4)


class _Message:
    """Samples of one message, of one instance."""

    def __init__(self, rows: list[tuple[float, ...]], fields: tuple[str, ...]) -> None:
        table = np.array(rows, dtype=float).T
        good, _ = increasing(table[0])
        self.t_s = table[0][good]
        self._columns = dict(zip(fields, table[1:, good], strict=True))

    def __getitem__(self, field: str) -> np.ndarray:
        return self._columns[field]

    def has(self, *fields: str) -> bool:
        """Tell whether these fields are there and one of them is not zero throughout."""
        return all(f in self._columns for f in fields) and any(
            bool(np.any(np.isfinite(self[f]) & (self[f] != 0))) for f in fields
        )

    def stack(self, *fields: str) -> np.ndarray:
        return np.stack([self[field] for field in fields])


class _Log:
    """Messages by name and instance, parameters and notes of one log."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.notes: list[str] = []
        self.messages: dict[str, dict[int, _Message]] = {}
        self.parameters: dict[str, float] = {}
        self.texts: list[str] = []

    def message(self, name: str, *fields: str, instance: int | None = None) -> _Message | None:
        """Find the first instance (or a given one) of a message with values in these fields."""
        instances = self.messages.get(name, {})
        wanted = sorted(instances) if instance is None else [instance]
        speaking = [n for n in wanted if n in instances and instances[n].has(*fields)]
        if speaking and speaking[0] != wanted[0]:
            self.notes.append(
                f"{name} instance {wanted[0]} is zero throughout; instance {speaking[0]} is used"
            )
        return instances[speaking[0]] if speaking else None


def _rows(reader: Any, log: _Log) -> dict[tuple[str, int], tuple[tuple[str, ...], list]]:
    """Read the samples of all wanted messages: (time in s, values) by name and instance."""
    wanted = [*_FIELDS, *_NUMBERED, "PARM", "MSG"]
    tables: dict[tuple[str, int], tuple[tuple[str, ...], list]] = {}
    while (message := reader.recv_match(type=wanted)) is not None:
        name = message.get_type()
        columns = message.get_fieldnames()
        try:
            if name == "PARM":
                log.parameters[str(message.Name)] = float(message.Value)
                continue
            if name == "MSG":
                log.texts.append(str(message.Message))
                continue
            # older logs have the number behind the name, newer ones in a field
            name, instance = _NUMBERED.get(name, (name, None))
            if instance is None:
                instance = next((int(getattr(message, f)) for f in _INSTANCES if f in columns), 0)
            fields = tuple(f for f in _FIELDS[name] if f in columns)
            # older logs count milliseconds
            time_s = message.TimeUS * 1e-6 if "TimeUS" in columns else message.TimeMS * 1e-3
            row = (time_s, *(float(getattr(message, f)) for f in fields))
        except (AttributeError, TypeError, ValueError, OverflowError):
            # a damaged message; what follows is whole again
            continue
        # rows of a message that was defined anew on the way do not fit the first
        first_fields, rows = tables.setdefault((name, instance), (fields, []))
        if first_fields == fields:
            rows.append(row)
    return tables


@functools.cache
def _keep_lengths_apart_from_zero(dfreader: Any) -> None:
    """Change the module of pymavlink that reads logs."""

    class Format(dfreader.DFFormat):
        """A message's format that is no shorter than its header."""

        # of a length of 0, as a damaged byte may say, the reader never comes to the next message
        def __init__(self, number: int, name: bytes, length: int, *rest: Any, **more: Any) -> None:
            super().__init__(number, name, max(length, _HEADER), *rest, **more)

    dfreader.DFFormat = Format


def _open(path: Path) -> _Log:
    # its fast indexer prints what it finds damaged past sys.stderr
    os.environ.setdefault("PYMAVLINK_FAST_INDEX", "0")
    dfreader = optional_module("pymavlink.DFReader", "ardupilot", "ArduPilot logs")
    _keep_lengths_apart_from_zero(dfreader)
    with path.open("rb") as file:
        binary = file.read(2) == _MAGIC
    log = _Log(path.stem)
    try:
        # pymavlink prints what it finds damaged, and raises whatever damaged bytes lead it to
        with (
            open(os.devnull, "w") as nowhere,
            contextlib.redirect_stdout(nowhere),
            contextlib.redirect_stderr(nowhere),
            (dfreader.DFReader_binary if binary else dfreader.DFReader_text)(str(path)) as reader,
        ):
            tables = _rows(reader, log)
        for (name, instance), (fields, rows) in tables.items():
            if len(rows) > 1 and fields:
                log.messages.setdefault(name, {})[instance] = _Message(rows, fields)
    except Exception as error:
        raise GesError(
            f"{path.name} is damaged: no sample can be read ({type(error).__name__}: {error});"
            " take a fresh copy from the vehicle"
        ) from None
    if not log.messages:
        raise GesError(
            f"{path.name} holds none of the messages that are read (ATT, IMU, RCOU, XKF1 ...); log"
            " with LOG_BITMASK as 'ges doctor' says"
        )
    return log


def _attitude(log: _Log) -> Iterator[tuple[str, Stream]]:
    message = log.message("ATT", "Roll", "Pitch", "Yaw")
    if message is not None:
        ned = frames.quaternion(*np.radians(message.stack("Roll", "Pitch", "Yaw")))
        q = frames.attitude_from_ned(ned)
        yield "attitude", Stream(message.t_s, frames.named(QUATERNION, q), "ATT")


def _inertial(log: _Log) -> Iterator[tuple[str, Stream]]:
    """Give body rates from the gyro, else from the rate controller; and specific force."""
    gyro, rate = log.message("IMU", "GyrX", "GyrY", "GyrZ"), log.message("RATE", "R", "P", "Y")
    if gyro is not None:
        rates, t_s, source = gyro.stack("GyrX", "GyrY", "GyrZ"), gyro.t_s, "IMU"
    elif rate is not None:
        rates, t_s, source = np.radians(rate.stack("R", "P", "Y")), rate.t_s, "RATE"
    if gyro is not None or rate is not None:
        columns = frames.named(BODY_RATE, frames.flu_from_frd(rates))
        yield "rates", Stream(t_s, columns, source)
    accelerometer = log.message("IMU", "AccX", "AccY", "AccZ")
    if accelerometer is not None:
        force = frames.flu_from_frd(accelerometer.stack("AccX", "AccY", "AccZ"))
        yield "acceleration", Stream(accelerometer.t_s, frames.named(SPECIFIC_FORCE, force), "IMU")


def _motion(log: _Log) -> Iterator[tuple[str, Stream]]:
    """Give position and velocity of the estimator that flew (EKF3 before EKF2).

    They are those of the core that led for most of the flight.
    """
    for name, about in (("XKF1", "XKF4"), ("NKF1", "NKF4")):
        # one core throughout, the one that led for most of the flight: a change of core is a step
        primary = log.message(about, "PI", instance=0)
        core = int(Counter(primary["PI"].tolist()).most_common(1)[0][0]) if primary else 0
        message = log.message(name, *_FIELDS[name], instance=core) or log.message(
            name, *_FIELDS[name]
        )
        if message is None:
            continue
        for stream, names, fields in (
            ("position", POSITION, ("PN", "PE", "PD")),
            ("velocity", VELOCITY, ("VN", "VE", "VD")),
        ):
            columns = frames.named(names, frames.enu_from_ned(*message.stack(*fields)))
            yield stream, Stream(message.t_s, columns, name)
        return


def _references(log: _Log) -> Iterator[tuple[str, Stream]]:
    """Give what the position and attitude controllers were asked for.

    A target that equals the estimate to the last digit follows it (a relaxed controller) and asks
    for nothing. Target velocities hold the controller's response to the position error
    (AC_PosControl adds it). So only the desired velocity DV of newer logs is taken.
    """
    columns: dict[str, np.ndarray] = {}
    base = log.message("ATT", "DesYaw") or log.message("CTUN", "DAlt")
    if base is None:
        return
    for name, field, follows, column, factor in _ASKED:
        message = log.message(name, field)
        if message is None or column in columns:
            continue
        asked = message[field] * factor
        if follows and message.has(follows):
            # a target that is the estimate to the last digit follows it
            asked = np.where(message[field] == message[follows], np.nan, asked)
        if column == "p_ref_z_m":
            asked = np.where(_holds_height(log, message.t_s) & (asked != 0), asked, np.nan)
        if column == "yaw_ref_rad":
            asked = frames.yaw_from_heading(np.radians(asked))
        if np.isfinite(asked).any():
            # one clock for all: messages come at rates of their own
            columns |= on_axis(base.t_s, Stream(message.t_s, {column: asked}, held=True))
    if columns:
        yield "reference", Stream(base.t_s, columns, "PSC, CTUN, ATT", held=True)


def _holds_height(log: _Log, t_s: np.ndarray) -> np.ndarray:
    """Tell when the flight mode has a height to hold, (n,)."""
    modes = log.messages.get("MODE", {}).get(0)
    if modes is None:
        return np.ones(len(t_s), dtype=bool)
    # a mode lasts until the next message
    at = np.searchsorted(modes.t_s, t_s, side="right") - 1
    number = modes["ModeNum" if modes.has("ModeNum") else "Mode"]
    return (at >= 0) & ~np.isin(number[np.maximum(at, 0)], _WITHOUT_HEIGHT)


def _motors(log: _Log) -> list[int]:
    """List the numbers of the motors, by the frame, else by the functions of the outputs."""
    group = int(log.parameters.get("FRAME_CLASS", 0))
    if group == _TRICOPTER:
        return list(_TRI_MOTORS)
    if group in layouts.ARDUPILOT:
        return list(range(1, len(LAYOUTS[next(iter(layouts.ARDUPILOT[group].values()))]) + 1))
    functions = _functions(log)
    count = next(n for n in itertools.count() if _function(n + 1) not in functions)
    return list(range(1, max(count, 4) + 1))


def _function(motor: int) -> float:
    """Give SERVOn_FUNCTION of a motor."""
    return float(_MOTOR_1 + motor - 1 if motor < 9 else _MOTOR_9 + motor - 9)


def _functions(log: _Log) -> dict[float | None, int]:
    """Give the output (from 1) of every function."""
    return {log.parameters.get(f"SERVO{n}_FUNCTION"): n for n in range(1, 33)}


def _channels(log: _Log) -> list[int]:
    """Give the output (from 1) of each motor, by SERVOn_FUNCTION.

    In logs from before there was one it is the motor's own number.
    """
    functions, motors = _functions(log), _motors(log)
    if all(_function(motor) in functions for motor in motors):
        return [functions[_function(motor)] for motor in motors]
    return motors


def _pulses(log: _Log, options: Options) -> tuple[float, float]:
    """Give the pulse widths that mean command 0 and 1.

    As AP_MotorsMulticopter::get_pwm_output_min does.
    """
    if options.pwm:
        return options.pwm
    if log.parameters.get("MOT_PWM_TYPE") in _DSHOT:
        return _DSHOT_RANGE
    # MOT_PWM_* at 0 stand for the throttle channel's range
    for low, high in (("MOT_PWM_MIN", "MOT_PWM_MAX"), ("RC3_MIN", "RC3_MAX")):
        ends = log.parameters.get(low, 0.0), log.parameters.get(high, 0.0)
        if 0 < ends[0] < ends[1]:
            return ends
    raise GesError(
        f"{log.name} holds pulse widths but not which of them mean 0 and 1 (MOT_PWM_MIN,"
        " MOT_PWM_MAX, RC3_MIN, RC3_MAX); give their range, e.g. --pwm 1000 2000"
    )


def _commands(log: _Log, options: Options) -> Iterator[tuple[str, Stream]]:
    channels = _channels(log)
    message = log.message("RCOU", *(f"C{n}" for n in channels))
    if message is None:
        return
    low, high = _pulses(log, options)
    pulses = message.stack(*(f"C{n}" for n in channels))
    # a motor that gets no pulse stands
    pulses = np.where(pulses < _LEAST_PULSE_US, low, pulses)
    u = np.clip((pulses - low) / (high - low), 0.0, 1.0)
    if channels != list(range(1, len(channels) + 1)):
        listed = ", ".join(map(str, channels))
        log.notes.append(f"motors 1 to {len(channels)} are outputs {listed}")
    yield "command", Stream(message.t_s, {f"u_{i + 1}": row for i, row in enumerate(u)}, "RCOU")


def _rotor_speeds(
    log: _Log, options: Options, command: Stream | None
) -> Iterator[tuple[str, Stream]]:
    """Give rotor speeds by output channel, each controller's own samples.

    They are refused if the commands indicate another order.
    """
    escs = {k: m for k, m in log.messages.get("ESC", {}).items() if m.has("RPM")}
    channels = _channels(log)
    stated = options.order_of(len(channels))
    order = (
        [sorted(escs)[k - 1] if k <= len(escs) else -1 for k in stated]
        if stated
        else [n - 1 for n in channels]
    )
    # controllers may be counted by themselves, not by outputs: as many are taken in their order
    if not set(order) <= set(escs):
        if len(escs) == len(channels):
            order = sorted(escs)
        else:
            return
    t_s = escs[order[0]].t_s
    speeds, currents = {}, {}
    for i, k in enumerate(order, 1):
        own = escs[k]
        # each controller reports at its own times: brought to those of the first
        speeds[f"rotor_speed_{i}_rad_s"] = np.interp(t_s, own.t_s, own["RPM"]) * (np.pi / 30)
        if own.has("Curr"):
            currents[f"motor_current_{i}_A"] = np.interp(t_s, own.t_s, own["Curr"])
    stream = Stream(t_s, speeds, "ESC")
    if command is not None and not stated:
        why, spoken_for = rotor_order.check_order(command, stream)
        if why and spoken_for:
            log.notes.append(
                "the rotor speeds are not used: by the output channels they are in one order, but"
                f" {why}; if you know it, give the order, e.g. --rotor-order 1,2,3,4"
            )
            return
    yield "rotor_speed", stream
    if len(currents) == len(channels):
        yield "motor_current", Stream(t_s, currents, "ESC")


def _battery(log: _Log) -> Iterator[tuple[str, Stream]]:
    for name in ("BAT", "CURR"):
        message = log.message(name, "Volt")
        if message is not None:
            columns = {"battery_V": np.where(message["Volt"] > 0, message["Volt"], np.nan)}
            if message.has("Curr"):
                columns["battery_A"] = message["Curr"]
            yield "battery", Stream(message.t_s, columns, name)
            return


def _range(log: _Log) -> Iterator[tuple[str, Stream]]:
    """Give the first rangefinder that looks down, where its status is good."""
    for message in log.messages.get("RFND", {}).values():
        distance, facing = ("Dist", "Orient") if message.has("Dist") else ("Dist1", "Orient1")
        if not message.has(distance) or not message.has(facing):
            continue
        # readings of another direction are no height
        seen = np.where(message[facing] == _DOWNWARD, message[distance], np.nan)
        if message.has("Stat"):
            seen = np.where(message["Stat"] == _GOOD, seen, np.nan)
        if np.isfinite(seen).any():
            yield "range", Stream(message.t_s, {"range_m": seen}, "RFND")
            return


def _refusal(log: _Log) -> str:
    """Say why the vehicle is none that can be diagnosed; '' where it can."""
    text = " ".join(log.texts)
    other = re.search(r"Ardu(Plane|Rover|Sub)|APM:(Plane|Rover|Sub)|Blimp", text)
    kind = layouts.NO_MULTIROTORS.get(int(log.parameters.get("FRAME_CLASS", 0)))
    kind = f"a {kind}" if kind else None
    if other:
        kind = f"an {other.group(0)} vehicle"
    return f"this is a log of {kind}; multirotors can be diagnosed" if kind else ""


class ArduPilot:
    """Reader of ArduPilot DataFlash logs, binary and text.

    Attributes
    ----------
    name, title, advice : as of :class:`~ges.recordings.readers.log.Reader`.
    """

    name = "ardupilot"
    title = "ArduPilot DataFlash (.bin, .log)"
    advice = {
        **dict.fromkeys(
            ("attitude", "rates", "acceleration"),
            "LOG_BITMASK 438271 (the default with fast attitude, bit 0, and fast IMU, bit 18)",
        ),
        **dict.fromkeys(("position", "velocity"), "EKF3 (EK3_ENABLE 1, AHRS_EKF_TYPE 3)"),
        "command": "LOG_BITMASK bit 10 (RCOUT); ArduPilot writes RCOU 10 times a second",
        "rotor_speed": (
            "ESC telemetry: SERVO_BLH_AUTO 1 with SERVO_BLH_TRATE 50, or bidirectional DShot by"
            " SERVO_BLH_BDMASK; the message is ESC"
        ),
        "battery": "LOG_BITMASK bit 9 (CURRENT) and BATT_MONITOR",
        "reference": (
            "a flight in Loiter, Auto or Guided (messages PSCN, PSCE, PSCD); in Stabilize there are"
            " no references"
        ),
        "range": "a rangefinder that looks down (RNGFND1_TYPE, RNGFND1_ORIENT 25)",
    }

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether the first bytes are those of a DataFlash message, or of its text form."""
        return head.startswith(_MAGIC) or head.lstrip().startswith(_TEXT)

    def read(self, path: Path, options: Options) -> Log:
        """Read a DataFlash log; t = 0 at its first sample.

        Parameters
        ----------
        path : the log.
        options : ``pwm`` and ``rotor_order`` are used.

        Returns
        -------
        Streams in ENU and FLU. Commands are RCOU over the pulse range; references are held.

        Raises
        ------
        GesError
            When pymavlink is not installed, nothing can be read, or pulse widths have no range.
        UsageError
            When ``rotor_order`` is of another number of motors.
        """
        log = _open(path)
        streams: dict[str, Stream] = {}
        for part in (_attitude, _inertial, _motion, _references, _battery, _range):
            streams |= dict(part(log))
        streams |= dict(_commands(log, options))
        streams |= dict(_rotor_speeds(log, options, streams.get("command")))
        if bend := log.parameters.get("MOT_THST_EXPO"):
            log.notes.append(
                f"MOT_THST_EXPO is {bend:.2g}: the autopilot bends its commands so that thrust"
                " follows them; the commands taken here (RCOU) are those after that"
            )
        version = next((t for t in log.texts if re.search("Ardu|APM:|Copter", t)), "")
        return Log(
            path.stem,
            self.name,
            version or "ArduPilot",
            from_first_sample(streams),
            log.parameters,
            tuple(log.notes),
            _refusal(log),
        )
