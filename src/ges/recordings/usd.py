"""Crazyflie micro-SD logs (binary): header 0xBC, event types with named fields, events, CRC-32.

Format: ``docs/functional-areas/uSD-card`` of bitcraze/crazyflie-firmware. Version 1 stamps events
in milliseconds (uint32), version 2 in microseconds (uint64). Letters of the types are those of
Python's struct module.
"""

from __future__ import annotations

import dataclasses
import struct
import zlib
from pathlib import Path

import numpy as np
import pandas as pd

from ges.conventions import GRAVITY_M_S2 as _G
from ges.errors import GesError
from ges.recordings.columns import increasing, with_quaternion, with_specific_force

_MAGIC = 0xBC
_STAMP = {1: ("I", 1e-3), 2: ("Q", 1e-6)}
_PWM_FULL = 65535.0

# Log variable -> (contract column, factor). World accelerations and single angles are kept under
# their own names.
_KNOWN = {
    **{f"motor.m{i}": (f"u_{i}", 1 / _PWM_FULL) for i in range(1, 5)},
    **{f"pwm.m{i}_pwm": (f"pwm_{i}", 1 / _PWM_FULL) for i in range(1, 5)},
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
    "range.zrange": ("range_m", 1e-3),
}


@dataclasses.dataclass(frozen=True)
class _EventType:
    name: str
    fields: tuple[str, ...]
    layout: struct.Struct


def _string(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _event_types(data: bytes, stamp: str) -> tuple[dict[int, _EventType], int]:
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
            fields.append((field[:-3], field[-2]))
        layout = struct.Struct(f"<{stamp}" + "".join(letter for _, letter in fields))
        types[number] = _EventType(name, tuple(f for f, _ in fields), layout)
    return types, at


def _events(data: bytes, at: int, types: dict[int, _EventType]) -> tuple[dict[str, list[tuple]], bool]:
    """Rows of every event type up to the end or the first broken event; whether the end was
    reached.
    """
    rows: dict[str, list[tuple]] = {t.name: [] for t in types.values()}
    end = len(data)
    while at < end:
        kind = types.get(int.from_bytes(data[at : at + 2], "little"))
        if kind is None or at + 2 + kind.layout.size > end:
            return rows, False
        rows[kind.name].append(kind.layout.unpack_from(data, at + 2))
        at += 2 + kind.layout.size
    return rows, True


def _parse(path: Path) -> tuple[pd.DataFrame, list[str]]:
    data = path.read_bytes()
    if len(data) < 9 or data[0] != _MAGIC:
        raise GesError(f"{path.name} is not a Crazyflie micro-SD log (it must begin with byte 0xBC)")
    (version,) = struct.unpack_from("<H", data, 1)
    if version not in _STAMP:
        raise GesError(f"{path.name} has log format version {version}; versions 1 and 2 are known")
    letter, seconds = _STAMP[version]
    whole = zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    types, at = _event_types(data, letter)
    rows, complete = _events(data[:-4] if whole else data, at, types)
    warnings = [] if whole and complete else [f"{path.name} is damaged or cut short; the samples before the damage are used"]
    name = max(rows, key=lambda n: len(rows[n]))
    fields = next(t.fields for t in types.values() if t.name == name)
    frame = pd.DataFrame(np.array(rows[name], dtype=float).reshape(-1, 1 + len(fields)), columns=["t_s", *fields])
    return frame.assign(t_s=frame["t_s"] * seconds), warnings


def read_usd(path: str | Path) -> tuple[pd.DataFrame, list[str]]:
    """One flight from a Crazyflie micro-SD log.

    Returns
    -------
    frame, warnings : contract columns. Commands ``u_i`` are what the mixer asked for over its full
        scale; world accelerations without gravity become the body's specific force where the whole
        attitude was logged and are kept as ``acc_world_*_m_s2`` where not; roll and yaw without
        pitch are kept as ``roll_rad``, ``yaw_rad``.

    Raises
    ------
    GesError
        When the file is no such log or holds no sample.
    """
    path = Path(path)
    try:
        raw, warnings = _parse(path)
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror}") from None
    except (struct.error, ValueError, IndexError):
        raise GesError(f"{path.name}: the header of this micro-SD log is cut short; no sample can be read") from None
    if len(raw) == 0:
        raise GesError(f"{path.name} holds no sample; there is no flight in it")
    values = {"t_s": raw["t_s"].to_numpy() - raw["t_s"].iloc[0]}
    for name in raw.columns[1:]:
        column, factor = _KNOWN.get(name, (name.replace(".", "_"), 1.0))
        values[column] = raw[name].to_numpy() * factor
    frame, repeats = increasing(pd.DataFrame(with_specific_force(with_quaternion(values))), path.name)
    return frame, warnings + repeats
