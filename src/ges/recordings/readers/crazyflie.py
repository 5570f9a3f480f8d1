"""Crazyflie micro-SD logs (binary): header 0xBC, event types with named fields, events, CRC-32.

Format: ``docs/functional-areas/uSD-card`` of bitcraze/crazyflie-firmware. Version 1 stamps events
in milliseconds (uint32), version 2 in microseconds (uint64). Letters of the types are those of
Python's struct module. World is ENU and body FLU already. Motors are M1 front right, M2 back right,
M3 back left, M4 front left.
"""

from __future__ import annotations

import dataclasses
import itertools
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ges.conventions import GRAVITY_M_S2 as _G
from ges.conventions import POSITION, QUATERNION, VELOCITY, command
from ges.errors import GesError
from ges.recordings.readers.frames import (
    named,
    one_sign,
    with_quaternion,
    with_specific_force,
)
from ges.recordings.readers.log import Log, Options, Stream, increasing, named_streams

_MAGIC = 0xBC
_STAMP = {1: ("I", 1e-3), 2: ("Q", 1e-6)}
_LETTERS = "bBhHiIlLqQefd?"
_PWM_FULL = 65535.0

# Log variable -> (contract column, factor). World accelerations and single angles are kept under
# their own names.
_KNOWN = {
    **{f"motor.m{i}": (f"u_{i}", 1 / _PWM_FULL) for i in range(1, 5)},
    **{f"pwm.m{i}_pwm": (f"pwm_{i}", 1 / _PWM_FULL) for i in range(1, 5)},
    **{f"rpm.m{i}": (f"rotor_speed_{i}_rad_s", np.pi / 30) for i in range(1, 5)},
    "pm.vbatMV": ("battery_V", 1e-3),
    "pm.vbat": ("battery_V", 1.0),
    **{f"stateEstimate.{a}": (f"p_{a}_m", 1.0) for a in "xyz"},
    **{f"stateEstimate.v{a}": (f"v_{a}_m_s", 1.0) for a in "xyz"},
    **{f"stateEstimate.a{a}": (f"acc_world_{a}_m_s2", _G) for a in "xyz"},
    "stateEstimate.roll": ("roll_rad", np.pi / 180),
    "stateEstimate.pitch": ("pitch_rad", -np.pi / 180),  # the firmware's pitch is positive nose up
    "stateEstimate.yaw": ("yaw_rad", np.pi / 180),
    "stateEstimate.qw": ("q_w", 1.0),
    **{f"stateEstimate.q{a}": (f"q_{a}", 1.0) for a in "xyz"},
    **{f"acc.{a}": (f"acc_{a}_m_s2", _G) for a in "xyz"},
    **{f"gyro.{a}": (f"omega_{a}_rad_s", np.pi / 180) for a in "xyz"},
    **{f"ctrltarget.{a}": (f"p_ref_{a}_m", 1.0) for a in "xyz"},
    **{f"ctrltarget.v{a}": (f"v_ref_{a}_m_s", 1.0) for a in "xyz"},
    "ctrltarget.yaw": ("yaw_ref_rad", np.pi / 180),
    "range.zrange": ("range_m", 1e-3),
    **{f"locSrv.{a}": (f"mocap_{a}_m", 1.0) for a in "xyz"},
    **{f"locSrv.q{a}": (f"mocap_q_{a}", 1.0) for a in "wxyz"},
}

_MOCAP = tuple(f"mocap_{a}_m" for a in "xyz")
_MOCAP_Q = tuple(f"mocap_q_{a}" for a in "wxyz")
DUTY = "pwm.m1_pwm"
_PWM = tuple(f"pwm_{i}" for i in range(1, 5))

# Motion capture is differentiated by cubics over 0.2 s, which leave motion below 3 Hz as it is;
# slower than 25 Hz there would be fewer than five samples in them, across a gap none.
_CUBIC_S, _LEAST_IN_CUBIC, _MOCAP_GAP_S = 0.2, 5, 0.1


@dataclasses.dataclass(frozen=True)
class _EventType:
    name: str
    fields: tuple[str, ...]
    layout: struct.Struct


def _string(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _event_types(data: bytes, stamp: str) -> tuple[dict[int, _EventType], int]:
    """Read the event types by number, and where the header ends."""
    (count,) = struct.unpack_from("<H", data, 3)
    types, at = {}, 5
    for _ in range(count):
        (number,) = struct.unpack_from("<H", data, at)
        name, at = _string(data, at + 2)
        (n_fields,) = struct.unpack_from("<H", data, at)
        at += 2
        fields = []
        for _ in range(n_fields):
            field, at = _string(data, at)
            # a field is written NAME(LETTER)
            fields.append((field[:-3], field[-2]))
        letters = "".join(letter for _, letter in fields)
        if not set(letters) <= set(_LETTERS):
            raise ValueError(f"a field of event {name} is of no known type")
        layout = struct.Struct(f"<{stamp}{letters}")
        types[number] = _EventType(name, tuple(f for f, _ in fields), layout)
    return types, at


def _events(
    data: bytes, at: int, types: Mapping[int, _EventType]
) -> tuple[dict[int, list[tuple]], bool]:
    """Read rows of every event type up to the end or the first broken event.

    Returns
    -------
    The rows, and whether the end was reached.
    """
    rows: dict[int, list[tuple]] = {number: [] for number in types}
    end = len(data)
    while at < end:
        number = int.from_bytes(data[at : at + 2], "little")
        kind = types.get(number)
        # a number that no type has: from a damaged event on nothing can be trusted
        if kind is None or at + 2 + kind.layout.size > end:
            return rows, False
        rows[number].append(kind.layout.unpack_from(data, at + 2))
        at += 2 + kind.layout.size
    return rows, True


def _parse(data: bytes, name: str) -> tuple[list[tuple[str, dict[str, np.ndarray]]], bool]:
    """Read the event types that occur, the longest first, each with its fields and ``t_s``.

    Returns
    -------
    The tables, and whether the log is whole.
    """
    (version,) = struct.unpack_from("<H", data, 1)
    if version not in _STAMP:
        raise GesError(f"{name} has log format version {version}; versions 1 and 2 are known")
    letter, second = _STAMP[version]
    # the last four bytes are a checksum only if it holds; a log cut short ends in events
    whole = zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    types, at = _event_types(data, letter)
    rows, complete = _events(data[:-4] if whole else data, at, types)
    tables = []
    for number in sorted(types, key=lambda n: -len(rows[n])):
        kind, events = types[number], rows[number]
        if len(events) > 1 and kind.fields:
            table = np.array(events, dtype=float).T
            tables.append(
                (
                    kind.name,
                    {"t_s": table[0] * second, **dict(zip(kind.fields, table[1:], strict=True))},
                )
            )
    return tables, whole and complete


def _columns(event: str, table: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Convert the fields of one event type to contract columns.

    Unknown fields keep their name, behind that of the event where they have no group.
    """
    columns = {}
    for field, values in table.items():
        if field != "t_s":
            plain = field if "." in field else f"{event}.{field}"
            column, factor = _KNOWN.get(field, (plain.replace(".", "_"), 1.0))
            columns[column] = values * factor
    return columns


def _commands(columns: dict[str, np.ndarray], notes: list[str]) -> bool:
    """Take the duty cycle as the command where the mixer's request was not logged.

    Returns
    -------
    Whether it was taken.
    """
    duty = not any(name in columns for name in command(len(_PWM))) and all(
        name in columns for name in _PWM
    )
    if duty:
        columns |= {u: columns.pop(pwm) for u, pwm in zip(command(len(_PWM)), _PWM, strict=True)}
        notes.append(
            "motor.m1 to m4 were not logged; the commands are the duty cycles pwm.m1_pwm to"
            " m4_pwm, after the firmware's battery compensation"
        )
    return duty


def _velocity(t_s: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Differentiate positions (3, n) to velocity (3, n) by local cubics between gaps.

    NaN where there are too few samples for that.

    References
    ----------
    Savitzky and Golay, Analytical Chemistry 36, 1964.
    """
    # here, as it takes a third of a second, and one kind of log alone needs it
    from scipy.signal import savgol_filter

    usual_s = float(np.median(np.diff(t_s)))
    # an odd number of samples, centred
    window = 2 * int(0.5 * _CUBIC_S / usual_s) + 1
    v = np.full(p.shape, np.nan)
    if window < _LEAST_IN_CUBIC:
        return v
    # no cubic is laid over a gap
    ends = [0, *(np.flatnonzero(np.diff(t_s) > _MOCAP_GAP_S) + 1), len(t_s)]
    for first, last in itertools.pairwise(ends):
        own = t_s[first:last]
        # the filter takes even steps: onto a grid and back
        even = np.arange(own[0], own[-1], usual_s)
        if len(even) >= window:
            on_even = np.stack([np.interp(even, own, row[first:last]) for row in p])
            slope = savgol_filter(on_even, window, 3, deriv=1, delta=usual_s, axis=1)
            v[:, first:last] = [np.interp(own, even, row) for row in slope]
    return v


def _with_motion_capture(streams: dict[str, Stream], seen: Stream, notes: list[str]) -> None:
    """Put position and velocity of motion capture in place of the vehicle's own estimate.

    The estimate stays under other names. The attitude of motion capture is taken only where there
    is no other, as it is noisier. The estimator's velocity is no derivative of the position: on
    published flights (IMRCLab) it is 4 to 8 % too large along the ground.
    """
    # poses are repeated in the log until the next one comes
    rows = seen.news()
    rows = rows[np.isfinite([seen.columns[name][rows] for name in _MOCAP]).all(axis=0)]
    if len(rows) < 2:
        return
    t_s, columns = seen.t_s[rows], {name: v[rows] for name, v in seen.columns.items()}
    p = np.stack([columns.pop(name) for name in _MOCAP])
    measured = {"position": (POSITION, p), "velocity": (VELOCITY, _velocity(t_s, p))}
    for name, (names, values) in measured.items():
        own = streams.get(name)
        if not np.isfinite(values).any():
            continue
        if own is not None:
            kept = {f"{column}_estimate": v for column, v in own.columns.items()}
            streams[f"other {name}"] = Stream(own.t_s, kept, own.source)
        streams[name] = Stream(t_s, named(names, values), seen.source)
    if "attitude" not in streams and all(name in columns for name in _MOCAP_Q):
        q = one_sign(np.stack([columns.pop(name) for name in _MOCAP_Q]))
        streams["attitude"] = Stream(t_s, named(QUATERNION, q), seen.source)
    if columns:
        streams["other motion capture"] = Stream(t_s, columns, seen.source)
    notes.append(
        f"position is that of motion capture ({1 / np.median(np.diff(t_s)):.0f} Hz), velocity its"
        f" derivative by cubics over {_CUBIC_S:g} s; the vehicle's own estimate is kept as"
        " p_x_m_estimate ..."
    )


def _streams(
    tables: list[tuple[str, dict[str, np.ndarray]]], notes: list[str]
) -> dict[str, Stream]:
    """Give streams of all event types on one clock.

    A quantity in several events is that of the event with most samples.
    """
    start_s = min(float(table["t_s"][0]) for _, table in tables)
    # what the mixer asks for goes before duty cycles, in whichever event it is
    asked = any("motor.m1" in table for _, table in tables)
    streams: dict[str, Stream] = {}
    seen, taken = None, set()
    for event, table in tables:
        good, dropped = increasing(table["t_s"])
        notes += [f"event {event}: {dropped}"] if dropped else []
        t_s = table["t_s"][good] - start_s
        columns = {name: v[good] for name, v in _columns(event, table).items()}
        duty = not asked and _commands(columns, notes)
        columns = with_specific_force(with_quaternion(columns))
        # tables come the longest first: a quantity stays with the event that has most of it
        columns = {name: v for name, v in columns.items() if name not in taken}
        taken |= set(columns)
        if seen is None and set(_MOCAP) <= set(columns) and len(t_s) > 2:
            pose = {name: columns.pop(name) for name in (*_MOCAP, *_MOCAP_Q) if name in columns}
            seen = Stream(t_s, pose, "locSrv")
        for name, stream in named_streams(t_s, columns, event).items():
            if duty and name == "command":
                stream = dataclasses.replace(stream, source=DUTY)
            streams[name if name not in streams else f"{name} ({event})"] = stream
    if seen is not None:
        _with_motion_capture(streams, seen, notes)
    return streams


class Crazyflie:
    """Reader of Crazyflie micro-SD logs.

    Attributes
    ----------
    name, title, advice : as of :class:`~ges.recordings.readers.log.Reader`.
    """

    name = "crazyflie"
    title = "Crazyflie micro-SD log"
    advice = {
        "attitude": "stateEstimate.qx, .qy, .qz, .qw in config.txt on the card",
        "position": "stateEstimate.x, .y, .z in config.txt, or motion capture by 'on:estPose'",
        "velocity": "stateEstimate.vx, .vy, .vz in config.txt",
        "rates": "gyro.x, .y, .z in config.txt",
        "acceleration": "acc.x, .y, .z in config.txt",
        "command": "motor.m1 to motor.m4 in config.txt",
        "rotor_speed": "rpm.m1 to rpm.m4 in config.txt, with an RPM deck",
        "battery": "pm.vbatMV in config.txt",
        "reference": "ctrltarget.x, .y, .z, .vx, .vy, .vz, .yaw in config.txt",
        "range": "range.zrange in config.txt, with a z-ranger deck",
    }

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether the first bytes are 0xBC and a version that is known."""
        return head[:1] == bytes([_MAGIC]) and int.from_bytes(head[1:3], "little") in _STAMP

    def read(self, path: Path, options: Options) -> Log:
        """Read a micro-SD log; t = 0 at its first event.

        Parameters
        ----------
        path : the log.
        options : not used.

        Returns
        -------
        Streams in ENU and FLU. Commands ``u_i`` are the mixer's requests over their full scale.
        World accelerations become the specific force where the whole attitude was logged; else they
        stay ``acc_world_*_m_s2``. Roll and yaw without pitch stay ``roll_rad`` and ``yaw_rad``.

        Raises
        ------
        GesError
            When the header is damaged or there is no sample.
        """
        data = path.read_bytes()
        if len(data) < 9 or data[0] != _MAGIC:
            raise GesError(
                f"{path.name} is not a Crazyflie micro-SD log (it must begin with byte 0xBC)"
            )
        try:
            tables, whole = _parse(data, path.name)
        except (struct.error, ValueError, IndexError):
            raise GesError(
                f"{path.name}: the header of this micro-SD log is damaged or cut short; no sample"
                " can be read, so take a fresh copy from the card"
            ) from None
        if not tables:
            raise GesError(f"{path.name} holds no sample; there is no flight in it")
        notes = (
            [] if whole else ["the log is damaged or cut short; the samples before that are used"]
        )
        streams = _streams(tables, notes)
        return Log(path.stem, self.name, "Crazyflie", streams, {}, tuple(notes))
