"""Betaflight and INAV blackbox (.bbl, .bfl, .txt), by betaflight-chirp-core.

Header fields and scales are those of betaflight/blackbox-log-viewer
(``flightlog_fields_presenter.js``). Body axes are FLU already, as a published flight (Betaflight
4.2) shows. More thrust at the left is followed by a positive roll acceleration. More thrust at the
rear is followed by a positive pitch acceleration (nose down). The accelerometer reads +1 g. Motors
are the firmware's: 1 rear right, 2 front right, 3 rear left, 4 front left.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ges.conventions import (
    BODY_RATE,
    FEWEST_ROTORS,
    GRAVITY_M_S2,
    POSITION,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
)
from ges.errors import GesError, UsageError
from ges.recordings.readers import frames
from ges.recordings.readers.log import (
    Log,
    Options,
    Stream,
    increasing,
    named_streams,
    optional_module,
)

_MAGIC = b"H Product:Blackbox flight data recorder by Nicholas Sherlock"
_DSHOT_RANGE, _DSHOT_LARGEST = (48.0, 2047.0), 2047.0
_IDLE_US = 1000.0
_LARGEST_INTERVAL = 65536
_CM, _DECIDEGREE = 0.01, np.pi / 1800


class _Header:
    """Lines ``H name:value`` of one flight."""

    def __init__(self, data: bytes) -> None:
        self.text: dict[str, str] = {}
        for line in data.split(b"\n"):
            if not line.startswith(b"H "):
                break
            name, _, value = line[2:].decode("latin-1").partition(":")
            self.text[name] = value.strip()

    def numbers(self, name: str) -> list[float]:
        """Read the numbers of a line, separated by commas or a stroke; none where it holds text."""
        try:
            return [float(part) for part in re.split("[,/]", self.text[name])]
        except (KeyError, ValueError):
            return []

    def number(self, name: str, default: float) -> float:
        """Read a positive number of the header."""
        value, *_ = self.numbers(name) or [default]
        return value if 0 < value < math.inf else default

    def parameters(self) -> dict[str, float]:
        """Collect every number by its name, those of a list with their place."""
        numbers: dict[str, float] = {}
        for name in self.text:
            values = [] if name.startswith("Field ") else self.numbers(name)
            single = len(values) == 1
            numbers |= {name if single else f"{name}[{k}]": v for k, v in enumerate(values)}
        return numbers

    def firmware(self) -> tuple[str, tuple[int, ...]]:
        """Read name and version of the firmware."""
        match = re.search(r"(\w+)\s+(\d+)\.(\d+)", self.text.get("Firmware revision", ""))
        return (
            (match.group(1), (int(match.group(2)), int(match.group(3)))) if match else ("", (0, 0))
        )

    def rad_s(self) -> float:
        """Read the size of a gyro unit, rad/s.

        ``gyro_scale`` holds the bytes of a float in hexadecimal, deg/s a unit.
        """
        text = self.text.get("gyro_scale", self.text.get("gyro.scale", "0x3f800000"))
        try:
            (scale,) = struct.unpack("<f", struct.pack("<I", int(text, 16)))
        except (ValueError, struct.error):
            return math.radians(1.0)
        return math.radians(scale) if 0 < scale < math.inf else math.radians(1.0)


def _flights(decoder: Any, data: bytes, options: Options, name: str) -> tuple[int, int, str]:
    """Find the bytes of the flight that is wanted, and what to say of the others."""
    parts = decoder.split_sessions(data)
    if options.part is None:
        # the longest, as arming on the ground makes a short one
        chosen = max(range(len(parts)), key=lambda k: parts[k][1] - parts[k][0])
    elif options.part > len(parts):
        raise UsageError(
            f"{name} holds {len(parts)} flights; --part {options.part} is none of them"
        )
    else:
        chosen = options.part - 1
    note = ""
    if len(parts) > 1:
        note = f"flight {chosen + 1} of {len(parts)} in the file is read; --part chooses another"
    return *parts[chosen], note


def _decoded(
    decoder: Any, data: bytes, start: int, end: int, name: str
) -> tuple[_Header, dict[str, np.ndarray], int]:
    """Decode all frames of one flight."""
    # each flight repeats the header, with the settings of that time
    header = _Header(data[start:end])
    for line, fewest in (("I interval", 1), ("P interval", 1)):
        # the decoder would never end, or divide by zero
        if any(not fewest <= n <= _LARGEST_INTERVAL for n in header.numbers(line)):
            raise GesError(f"{name}: the header is damaged ({line}: {header.text[line]})")
    try:
        parser = decoder.FlightLogParser(data, start, end)
        parser.parse_header()
        parser.parse_data()
        table = np.array(parser.main_frames, dtype=float)
    except Exception as error:
        # the decoder meets damage with whatever error its bytes lead to
        raise GesError(
            f"{name}: this blackbox log is damaged; nothing can be read"
            f" ({type(error).__name__}: {error})"
        ) from None
    if len(table) < 2:
        raise GesError(f"{name} holds no sample; there is no flight in it")
    fields = dict(zip(parser.main_field_names, table.T, strict=True))
    return header, fields, parser.stats["total_corrupt_frames"]


def _vector(fields: Mapping[str, np.ndarray], name: str, count: int = 3) -> np.ndarray | None:
    """Give fields ``name[0]`` ... as rows."""
    names = [f"{name}[{k}]" for k in range(count)]
    complete = names and all(n in fields for n in names)
    return np.stack([fields[n] for n in names]) if complete else None


def _motors(fields: Mapping[str, np.ndarray]) -> int:
    """Count the motors."""
    return sum(1 for field in fields if re.fullmatch(r"motor\[\d+\]", field))


def _range(header: _Header, options: Options) -> tuple[float, float]:
    """Give the motor outputs that mean command 0 and 1."""
    if options.pwm:
        return options.pwm
    ends = header.numbers("motorOutput")
    # no pulse is that short: DShot, whose values below 48 are commands
    if len(ends) == 2 and ends[0] < 0.5 * _IDLE_US and ends[1] <= _DSHOT_LARGEST:
        return _DSHOT_RANGE
    high = ends[1] if len(ends) == 2 else header.number("maxthrottle", 2000.0)
    low = header.number("mincommand", _IDLE_US)
    return (low, high) if high > low else (_IDLE_US, 2.0 * _IDLE_US)


def _drive(
    header: _Header, fields: Mapping[str, np.ndarray], options: Options
) -> dict[str, np.ndarray]:
    """Give commands, and rotor speeds where bidirectional DShot gave them (eRPM in hundreds)."""
    columns: dict[str, np.ndarray] = {}
    count = _motors(fields)
    motors, speeds = _vector(fields, "motor", count), _vector(fields, "eRPM", count)
    if motors is not None:
        low, high = _range(header, options)
        u = np.clip((motors - low) / (high - low), 0.0, 1.0)
        columns |= {f"u_{i + 1}": row for i, row in enumerate(u)}
    if speeds is not None and np.any(speeds > 0):
        # electrical turns: one turn of the rotor has as many as pairs of poles
        rpm = 100.0 * speeds / (0.5 * header.number("motor_poles", 14.0))
        columns |= {f"rotor_speed_{i + 1}_rad_s": row * (np.pi / 30) for i, row in enumerate(rpm)}
    return columns


def _electrics(header: _Header, fields: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Give the battery in the unit of the firmware's version.

    It is 0.01 V in Betaflight 4 and INAV, 0.1 V from Betaflight 3.1 on.
    """
    name, version = header.firmware()
    volts = fields.get("vbatLatest", fields.get("vbat"))
    amperes = fields.get("amperageLatest", fields.get("amperage"))
    # the unit changed between versions, and the header does not state it
    hundredths = (name == "Betaflight" and version >= (4, 0)) or name == "INAV"
    columns: dict[str, np.ndarray] = {}
    if volts is not None and (hundredths or (name == "Betaflight" and version >= (3, 1))):
        columns["battery_V"] = volts * (0.01 if hundredths else 0.1)
    if amperes is not None and hundredths and np.any(amperes > 0):
        columns["battery_A"] = 0.01 * amperes
    return columns


def _inav_motion(fields: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Give INAV's own estimate.

    Position and velocity are north, east, up in cm. Roll, pitch (nose down) and heading are in
    tenths of a degree.
    """
    columns: dict[str, np.ndarray] = {}
    for names, field in ((POSITION, "navPos"), (VELOCITY, "navVel")):
        vector = _vector(fields, field)
        if vector is not None and np.any(vector != 0):
            north, east, up = _CM * vector
            columns |= frames.named(names, frames.enu_from_ned(north, east, -up))
    angles = _vector(fields, "attitude")
    if angles is not None and np.any(angles != 0):
        roll, pitch, heading = _DECIDEGREE * angles
        # INAV's pitch is positive nose down, that of NED and FRD nose up
        q = frames.attitude_from_ned(frames.quaternion(roll, -pitch, heading))
        columns |= frames.named(QUATERNION, q)
    return columns


def _yaw_note(fields: Mapping[str, np.ndarray]) -> str:
    """Say which way the motors turn, by how the mixer responds to its own yaw controller."""
    motors = _vector(fields, "motor", 4) if _motors(fields) == 4 else None
    p, i = fields.get("axisP[2]"), fields.get("axisI[2]")
    if motors is None or p is None or i is None:
        return ""
    # what the yaw controller asks of the mixer
    asked = p + i + fields.get("axisF[2]", 0.0)
    # rotors on a diagonal turn alike: the difference of diagonals is the mixer's yaw
    split = motors[[0, 3]].sum(axis=0) - motors[[1, 2]].sum(axis=0)
    if not (np.std(asked) > 0 and np.std(split) > 0):
        return ""
    r = float(np.corrcoef(asked, split)[0, 1])
    if abs(r) < 0.5:
        return ""
    way = "counter-clockwise" if r < 0 else "clockwise"
    return (
        f"motors 1 and 4 turn {way} seen from above, as the mixer gives them"
        f" {'less' if r < 0 else 'more'} for a yaw to the left"
    )


class Betaflight:
    """Reader of Betaflight and INAV blackbox logs.

    Attributes
    ----------
    name, title, advice : as of :class:`~ges.recordings.readers.log.Reader`.
    """

    name = "betaflight"
    title = "Betaflight or INAV blackbox (.bbl, .bfl)"
    advice = {
        **dict.fromkeys(
            ("attitude", "position", "velocity"),
            "INAV, which logs them, or motion capture beside the log; Betaflight has none of them",
        ),
        "rates": "set blackbox_disable_gyro = OFF",
        "acceleration": (
            "set blackbox_disable_acc = OFF, and the accelerometer itself (acc_hardware)"
        ),
        "command": "set blackbox_disable_motors = OFF",
        "rotor_speed": (
            "set dshot_bidir = ON and, from Betaflight 4.5 on, set blackbox_disable_rpm = OFF"
            " (fields eRPM)"
        ),
        "battery": "set blackbox_disable_bat = OFF, and a voltage meter",
    }

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether the header line of the recorder is among the first bytes."""
        return _MAGIC in head

    def read(self, path: Path, options: Options) -> Log:
        """Read one flight of a blackbox log; t = 0 at its first sample.

        Parameters
        ----------
        path : the log.
        options : ``pwm`` and ``part`` are used.

        Returns
        -------
        Streams in ENU and FLU, all at the times of the main frames.

        Raises
        ------
        GesError
            When the decoder is not installed, or nothing can be read.
        UsageError
            When the file has no flight of the number ``part``.
        """
        decoder = optional_module("betaflight_chirp_core.decoder", "betaflight", "Betaflight logs")
        data = path.read_bytes()
        start, end, note = _flights(decoder, data, options, path.name)
        header, fields, damaged = _decoded(decoder, data, start, end, path.name)
        notes = [note] if note else []
        if damaged:
            notes.append(f"{damaged} frames of the log are damaged and were left out")
        if "time" not in fields:
            raise GesError(f"{path.name}: the log has no field 'time'; a flight needs its time")
        columns = _drive(header, fields, options) | _electrics(header, fields)
        gyro, force = _vector(fields, "gyroADC"), _vector(fields, "accSmooth")
        if gyro is not None:
            columns |= frames.named(BODY_RATE, header.rad_s() * gyro)
        if force is not None:
            one_g = header.number("acc_1G", 2048.0)
            columns |= frames.named(SPECIFIC_FORCE, force * (GRAVITY_M_S2 / one_g))
        columns |= _inav_motion(fields)
        if turning := _yaw_note(fields):
            notes.append(turning)
        good, dropped = increasing(fields["time"])
        notes += [dropped] if dropped else []
        t_s = (fields["time"][good] - fields["time"][good][0]) * 1e-6
        streams: dict[str, Stream] = named_streams(
            t_s, {name: values[good] for name, values in columns.items()}, "main frames"
        )
        count = _motors(fields)
        kind = f"a vehicle with {count} motors" if 0 < count < FEWEST_ROTORS else ""
        return Log(
            path.stem,
            self.name,
            header.text.get("Firmware revision", ""),
            streams,
            header.parameters() | {"motors": float(count)},
            tuple(notes),
            f"this is a log of {kind}; multirotors can be diagnosed" if kind else "",
        )
