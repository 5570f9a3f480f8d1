"""Logs that the tests write themselves, byte by byte or by the library of the format."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

_ULOG_LETTER = {"float": "f", "uint64_t": "Q", "uint8_t": "B", "int32_t": "i"}
_ULOG_BYTES = ("_valid", "_counter", "_function", "_flags", "orientation")


def motion() -> dict[str, Any]:
    """Times and quantities of a flight of 8 s, in the contract's frames (ENU, FLU)."""
    t = np.arange(0.0, 8.0, 0.02)
    roll, yaw = 0.2 * np.sin(2.0 * t), 0.3 + 0.1 * t
    turned = Rotation.from_euler("ZYX", np.column_stack([yaw, 0 * t, roll]))
    step = (turned[:-1].inv() * turned[1:]).as_rotvec() / 0.02
    omega = np.vstack([step, step[-1:]])
    p = np.column_stack([np.sin(t), 0.5 * np.cos(t), 1.0 + 0.1 * np.sin(1.5 * t)])
    v = np.gradient(p, 0.02, axis=0)
    force = turned.inv().apply(np.gradient(v, 0.02, axis=0) + [0, 0, 9.80665])
    rng = np.random.default_rng(3)
    u = 0.5 + 0.1 * np.cumsum(rng.normal(0, 0.05, (len(t), 4)), axis=0)
    return {
        "t": t,
        "q": turned.as_quat(scalar_first=True),
        "omega": omega,
        "p": p,
        "v": v,
        "acc": force,
        "u": np.clip(u, 0.05, 0.95),
        "rotation": turned,
    }


def ulog(
    path: Path,
    topics: Sequence[tuple[str, int, Mapping[str, np.ndarray]]],
    parameters: Mapping[str, float | int] | None = None,
    info: Mapping[str, str | int] | None = None,
) -> Path:
    """A PX4 ULog: (topic, instance, field -> values), ``timestamp`` (us) first of the fields."""

    def message(letter: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(letter)) + body

    def keyed(key: str, value: bytes) -> bytes:
        return bytes([len(key)]) + key.encode() + value

    out = [b"ULog\x01\x12\x35\x01", struct.pack("<Q", 0), message("B", bytes(40))]
    for key, value in (info or {}).items():
        if isinstance(value, int):
            out.append(message("I", keyed(f"uint32_t {key}", struct.pack("<I", value))))
        else:
            out.append(message("I", keyed(f"char[{len(value)}] {key}", value.encode())))
    for key, value in (parameters or {}).items():
        kind, letter = ("int32_t", "i") if isinstance(value, int) else ("float", "f")
        out.append(message("P", keyed(f"{kind} {key}", struct.pack("<" + letter, value))))
    for form in {line: None for name, _, fields in topics for line in _ulog_formats(name, fields)}:
        out.append(message("F", form.encode()))
    for number, (name, instance, _) in enumerate(topics):
        out.append(message("A", struct.pack("<BH", instance, number) + name.encode()))
    rows = []
    for number, (_, _, fields) in enumerate(topics):
        layout = struct.Struct("<" + "".join(_ULOG_LETTER[_ulog_kind(f)] for f in fields))
        for k, stamp in enumerate(fields["timestamp"]):
            values = [v[k] for v in fields.values()]
            whole = [
                float(v) if _ulog_kind(f) == "float" else int(v)
                for f, v in zip(fields, values, strict=True)
            ]
            rows.append((stamp, struct.pack("<H", number) + layout.pack(*whole)))
    out += [message("D", body) for _, body in sorted(rows, key=lambda row: row[0])]
    path.write_bytes(b"".join(out))
    return path


def _ulog_kind(field: str) -> str:
    if field.startswith("timestamp"):
        return "uint64_t"
    if field.endswith("esc_rpm"):
        return "int32_t"
    return "uint8_t" if field.endswith(_ULOG_BYTES) else "float"


def _ulog_formats(name: str, fields: Mapping[str, np.ndarray]) -> list[str]:
    """Formats of a topic and of the messages nested in it (``esc[0].esc_rpm``)."""
    parts, nested = {}, {}
    for field in fields:
        base, _, leaf = field.partition("].")
        base, _, number = base.partition("[")
        if leaf:
            nested.setdefault(base, {})[leaf] = f"{_ulog_kind(leaf)} {leaf}"
            parts[base] = f"{base}_report[{int(number) + 1}] {base}"
        elif number:
            parts[base] = f"{_ulog_kind(base)}[{int(number.rstrip(']')) + 1}] {base}"
        else:
            parts[base] = f"{_ulog_kind(base)} {base}"
    inner = [f"{base}_report:{';'.join(leaves.values())};" for base, leaves in nested.items()]
    return [f"{name}:{';'.join(parts.values())};", *inner]


def usd(
    path: Path, events: Sequence[tuple[str, Mapping[str, np.ndarray]]], version: int = 2
) -> Path:
    """A Crazyflie micro-SD log: (event, field -> values), ``t_us`` among them; all floats."""
    head = [struct.pack("<BHH", 0xBC, version, len(events))]
    rows = []
    for number, (name, fields) in enumerate(events):
        names = [f for f in fields if f != "t_us"]
        head.append(struct.pack("<H", number) + name.encode() + b"\0")
        head.append(struct.pack("<H", len(names)))
        head += [f"{f}(f)".encode() + b"\0" for f in names]
        form = struct.Struct("<HQ" + "f" * len(names))
        for k, t_us in enumerate(fields["t_us"]):
            rows.append((t_us, form.pack(number, int(t_us), *(float(fields[f][k]) for f in names))))
    data = b"".join(head) + b"".join(body for _, body in sorted(rows, key=lambda r: r[0]))
    path.write_bytes(data + struct.pack("<I", zlib.crc32(data)))
    return path


_DATAFLASH = {"Q": ("Q", 8), "f": ("f", 4), "B": ("B", 1), "H": ("H", 2), "N": ("16s", 16)}


def dataflash(
    path: Path,
    messages: Sequence[tuple[str, str, Sequence[str], Sequence[Sequence]]],
    parameters: Mapping[str, float] | None = None,
    text: Sequence[str] = ("ArduCopter V4.5.7 (2a3dc4b7)",),
) -> Path:
    """An ArduPilot DataFlash log: (message, format letters, columns, rows), ``TimeUS`` first."""
    tables = [
        (
            "PARM",
            "QNf",
            ("TimeUS", "Name", "Value"),
            [(1, n, v) for n, v in (parameters or {}).items()],
        ),
        ("MSG", "QZ", ("TimeUS", "Message"), [(1, t) for t in text]),
        *messages,
    ]
    letters = {**{k: v[0] for k, v in _DATAFLASH.items()}, "Z": "64s", "n": "4s"}
    out = [_fmt(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    rows = []
    for number, (name, form, columns, values) in enumerate(tables, 129):
        layout = struct.Struct("<" + "".join(letters[c] for c in form))
        out.append(_fmt(number, layout.size + 3, name, form, ",".join(columns)))
        for row in values:
            packed = [x.encode() if isinstance(x, str) else x for x in row]
            rows.append((row[0], bytes([0xA3, 0x95, number]) + layout.pack(*packed)))
    out += [body for _, body in sorted(rows, key=lambda r: r[0])]
    path.write_bytes(b"".join(out))
    return path


def _fmt(number: int, length: int, name: str, form: str, columns: str) -> bytes:
    return bytes([0xA3, 0x95, 128]) + struct.pack(
        "<BB4s16s64s", number, length, name.encode(), form.encode(), columns.encode()
    )


def blackbox(
    path: Path,
    fields: Mapping[str, np.ndarray],
    header: Mapping[str, str],
    flights: int = 1,
) -> Path:
    """A blackbox log of I frames alone: every field a signed variable-byte number."""

    def signed(value: int) -> bytes:
        value = (value << 1) ^ (value >> 31)
        out = bytearray()
        while value > 127:
            out.append(value & 127 | 128)
            value >>= 7
        return bytes([*out, value])

    names = list(fields)
    lines = {
        "Product": "Blackbox flight data recorder by Nicholas Sherlock",
        "Data version": "2",
        "I interval": "1",
        "P interval": "1/1",
        **header,
        "Field I name": ",".join(names),
        "Field I signed": ",".join("1" for _ in names),
        "Field I predictor": ",".join("0" for _ in names),
        "Field I encoding": ",".join("0" for _ in names),
        "Field P predictor": ",".join("0" for _ in names),
        "Field P encoding": ",".join("0" for _ in names),
    }
    head = b"".join(f"H {k}:{v}\n".encode() for k, v in lines.items())
    rows = zip(*(np.asarray(v).astype(int).tolist() for v in fields.values()), strict=True)
    body = b"".join(b"I" + b"".join(signed(v) for v in row) for row in rows)
    path.write_bytes((head + body + b"E\xffEnd of log\0") * flights)
    return path
