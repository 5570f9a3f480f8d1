"""Named layouts: where the motors of an autopilot's frames sit, and which way they turn.

ArduPilot's are those of ``libraries/AP_Motors/AP_MotorsMatrix.cpp`` (4.5). PX4's geometries of six
and eight motors have the same numbers. Betaflight's are those of ``src/main/flight/mixer_init.c``
(4.5), which INAV shares. The settings that they print (``diff all``) name one of them or hold a
mixer of their own.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from ges.errors import GesError, unknown_name

Spin = Literal["cw", "ccw"]
"""Sense in which a rotor turns, seen from above."""


@dataclasses.dataclass(frozen=True)
class Mount:
    """Place of a motor.

    Attributes
    ----------
    angle_deg : direction of its arm, clockwise from the nose seen from above.
    spin : sense of its rotor.
    level : 1 for the upper and -1 for the lower one of a coaxial pair, 0 for a motor alone.
    reach : length of its arm over that of the vehicle.
    """

    angle_deg: float
    spin: Spin
    level: int = 0
    reach: float = 1.0


def _mounted(*motors: tuple[float, Spin] | tuple[float, Spin, int]) -> tuple[Mount, ...]:
    """Place motors at angles, those of coaxial pairs with their levels."""
    return tuple(Mount(*motor) for motor in motors)


def _placed(*motors: tuple[float, float, Spin]) -> tuple[Mount, ...]:
    """Place motors at factors of roll (left) and pitch (forward)."""
    return tuple(
        Mount(math.degrees(math.atan2(-roll, pitch)), spin, reach=math.hypot(roll, pitch))
        for roll, pitch, spin in motors
    )


def _around(count: int, first_deg: float, *, coaxial: bool = False) -> tuple[Mount, ...]:
    """Place motors clockwise from the nose, alternately ccw and cw.

    In coaxial pairs the upper ones alternate, and the lower ones turn the other way.
    """
    senses: tuple[Spin, Spin] = ("ccw", "cw")
    arms = range(count // 2 if coaxial else count)
    step = 360.0 / len(arms)
    if not coaxial:
        return tuple(Mount(first_deg + step * i, senses[i % 2]) for i in arms)
    return tuple(
        Mount(first_deg + step * i, senses[(i + k) % 2], 1 - 2 * k) for i in arms for k in (0, 1)
    )


_X8: Sequence[tuple[float, Spin, int]] = (
    (45, "ccw", 1),
    (315, "cw", 1),
    (225, "ccw", 1),
    (135, "cw", 1),
    (315, "ccw", -1),
    (45, "cw", -1),
    (135, "ccw", -1),
    (225, "cw", -1),
)

LAYOUTS: Mapping[str, tuple[Mount, ...]] = {
    "x": _mounted((45, "ccw"), (225, "ccw"), (315, "cw"), (135, "cw")),
    "h": _mounted((45, "cw"), (225, "cw"), (315, "ccw"), (135, "ccw")),
    "plus": _mounted((90, "ccw"), (270, "ccw"), (0, "cw"), (180, "cw")),
    "plus-reversed": _mounted((90, "cw"), (270, "cw"), (0, "ccw"), (180, "ccw")),
    "betaflight-x": _mounted((135, "cw"), (45, "ccw"), (225, "ccw"), (315, "cw")),
    "betaflight-x-reversed": _mounted((135, "ccw"), (45, "cw"), (225, "cw"), (315, "ccw")),
    "dji-x": _mounted((45, "ccw"), (315, "cw"), (225, "ccw"), (135, "cw")),
    "clockwise-x": _mounted((45, "ccw"), (135, "cw"), (225, "ccw"), (315, "cw")),
    "betaflight-x1234": _mounted((315, "cw"), (45, "ccw"), (135, "cw"), (225, "ccw")),
    "betaflight-plus": _mounted((180, "cw"), (90, "ccw"), (270, "ccw"), (0, "cw")),
    "tri": _mounted((60, "ccw"), (300, "cw"), (180, "ccw")),
    "betaflight-tri": _mounted((180, "ccw"), (60, "ccw"), (300, "cw")),
    "hexa-x": _mounted(
        (90, "cw"), (270, "ccw"), (330, "cw"), (150, "ccw"), (30, "ccw"), (210, "cw")
    ),
    "hexa-plus": _mounted(
        (0, "cw"), (180, "ccw"), (240, "cw"), (60, "ccw"), (300, "ccw"), (120, "cw")
    ),
    "hexa-h": _placed(
        (-1, 0, "cw"), (1, 0, "ccw"), (1, 1, "cw"), (-1, -1, "ccw"), (-1, 1, "ccw"), (1, -1, "cw")
    ),
    "hexa-dji-x": _mounted(
        (30, "ccw"), (330, "cw"), (270, "ccw"), (210, "cw"), (150, "ccw"), (90, "cw")
    ),
    "hexa-clockwise-x": _around(6, 30),
    "betaflight-hexa-x": _mounted(
        (150, "ccw"), (30, "ccw"), (210, "cw"), (330, "cw"), (90, "cw"), (270, "ccw")
    ),
    "betaflight-hexa-plus": _mounted(
        (120, "ccw"), (60, "cw"), (240, "ccw"), (300, "cw"), (0, "ccw"), (180, "cw")
    ),
    "y6": _mounted(
        (60, "ccw", -1),
        (300, "cw", 1),
        (300, "ccw", -1),
        (180, "cw", -1),
        (60, "cw", 1),
        (180, "ccw", 1),
    ),
    "y6-b": _mounted(
        (60, "cw", 1),
        (60, "ccw", -1),
        (180, "cw", 1),
        (180, "ccw", -1),
        (300, "cw", 1),
        (300, "ccw", -1),
    ),
    "y6-f": _mounted(
        (180, "ccw", 1),
        (60, "ccw", 1),
        (300, "ccw", 1),
        (180, "cw", -1),
        (60, "cw", -1),
        (300, "cw", -1),
    ),
    "betaflight-y6": _mounted(
        (180, "ccw", 1),
        (60, "cw", 1),
        (300, "cw", 1),
        (180, "cw", -1),
        (60, "ccw", -1),
        (300, "ccw", -1),
    ),
    "octo-x": _mounted(
        (22.5, "cw"),
        (202.5, "cw"),
        (67.5, "ccw"),
        (157.5, "ccw"),
        (337.5, "ccw"),
        (247.5, "ccw"),
        (292.5, "cw"),
        (112.5, "cw"),
    ),
    "octo-plus": _mounted(
        (0, "cw"),
        (180, "cw"),
        (45, "ccw"),
        (135, "ccw"),
        (315, "ccw"),
        (225, "ccw"),
        (270, "cw"),
        (90, "cw"),
    ),
    "octo-v": _placed(
        (-0.83, 0.34, "cw"),
        (-1.0, 1.0, "ccw"),
        (-0.67, -0.32, "cw"),
        (-0.50, -1.0, "ccw"),
        (0.50, -1.0, "cw"),
        (0.67, -0.32, "ccw"),
        (0.83, 0.34, "cw"),
        (1.0, 1.0, "ccw"),
    ),
    "octo-dji-x": _mounted(
        (22.5, "ccw"),
        (337.5, "cw"),
        (292.5, "ccw"),
        (247.5, "cw"),
        (202.5, "ccw"),
        (157.5, "cw"),
        (112.5, "ccw"),
        (67.5, "cw"),
    ),
    "octo-clockwise-x": _around(8, 22.5),
    "betaflight-octo-plus": _mounted(
        (315, "ccw"),
        (45, "ccw"),
        (135, "ccw"),
        (225, "ccw"),
        (0, "cw"),
        (90, "cw"),
        (180, "cw"),
        (270, "cw"),
    ),
    "betaflight-octo-x": _mounted(
        (292.5, "ccw"),
        (22.5, "ccw"),
        (112.5, "ccw"),
        (202.5, "ccw"),
        (337.5, "cw"),
        (67.5, "cw"),
        (157.5, "cw"),
        (247.5, "cw"),
    ),
    "x8": _mounted(*_X8),
    "x8-h": _mounted(*((a, "cw" if s == "ccw" else "ccw", level) for a, s, level in _X8)),
    "x8-plus": _mounted(*(((a - 45) % 360, s, level) for a, s, level in _X8)),
    "x8-clockwise": _around(8, 45, coaxial=True),
    "betaflight-x8": _mounted(
        (135, "cw", 1),
        (45, "ccw", 1),
        (225, "ccw", 1),
        (315, "cw", 1),
        (135, "ccw", -1),
        (45, "cw", -1),
        (225, "cw", -1),
        (315, "ccw", -1),
    ),
    "deca-x": _around(10, 18),
    "deca-plus": _around(10, 0),
    "dodeca-x": _around(12, 30, coaxial=True),
    "dodeca-plus": _around(12, 0, coaxial=True),
}
"""Motors of every layout, in the order of their numbers."""

ARDUPILOT: Mapping[int, Mapping[int, str]] = {
    1: {
        0: "plus",
        1: "x",
        # a V frame has the places and spins of an X
        2: "x",
        3: "h",
        6: "plus-reversed",
        12: "betaflight-x",
        13: "dji-x",
        14: "clockwise-x",
        18: "betaflight-x-reversed",
    },
    2: {0: "hexa-plus", 1: "hexa-x", 3: "hexa-h", 13: "hexa-dji-x", 14: "hexa-clockwise-x"},
    3: {0: "octo-plus", 1: "octo-x", 2: "octo-v", 13: "octo-dji-x", 14: "octo-clockwise-x"},
    4: {0: "x8-plus", 1: "x8", 3: "x8-h", 14: "x8-clockwise"},
    5: {0: "y6", 1: "y6", 10: "y6-b", 11: "y6-f"},
    7: dict.fromkeys(range(20), "tri"),
    12: {0: "dodeca-plus", 1: "dodeca-x"},
    14: {0: "deca-plus", 1: "deca-x"},
}
"""Layout of every FRAME_TYPE, by FRAME_CLASS."""

BETAFLIGHT: Mapping[str, str] = {
    "TRI": "betaflight-tri",
    "QUADP": "betaflight-plus",
    "QUADX": "betaflight-x",
    "QUADX1234": "betaflight-x1234",
    "Y6": "betaflight-y6",
    "HEX6": "betaflight-hexa-plus",
    "HEX6X": "betaflight-hexa-x",
    "OCTOX8": "betaflight-x8",
    "OCTOFLATP": "betaflight-octo-plus",
    "OCTOFLATX": "betaflight-octo-x",
}
"""Layout of every ``mixer`` of Betaflight whose motors all point up."""

NO_MULTIROTORS: Mapping[int, str] = {
    6: "helicopter",
    8: "single rotor",
    9: "coaxial helicopter",
    10: "bi-copter",
    11: "helicopter",
    13: "helicopter",
    15: "scripted matrix",
    16: "six degrees of freedom frame",
    17: "scripted matrix",
}
"""What else a FRAME_CLASS can be."""

PX4_AIRFRAMES: Mapping[int, str] = {
    4040: "h",
    4900: "clockwise-x",
    5001: "plus",
    6001: "hexa-x",
    6002: "hexa-x",
    7001: "hexa-plus",
    8001: "octo-x",
    9001: "octo-plus",
    11001: "y6-b",
    12001: "x8",
    12002: "x8",
}
"""Airframes (SYS_AUTOSTART) of PX4 before it logged CA_ROTOR*, but for its X quadrotors."""


@dataclasses.dataclass(frozen=True)
class MotorLayout:
    """Motors of a vehicle, in the order of their numbers.

    Attributes
    ----------
    mounts : where they sit and how they turn.
    source : where that is from.
    """

    mounts: tuple[Mount, ...]
    source: str


def layout_of(frame: str) -> MotorLayout:
    """Find a layout by its name, or read it from settings of Betaflight or INAV.

    Parameters
    ----------
    frame : a key of :data:`LAYOUTS`, or the path of a text with lines ``mmix`` or ``mixer``.

    Returns
    -------
    Motors in the order of their numbers.

    Raises
    ------
    UsageError
        When it is neither a name nor a file.
    GesError
        When the settings hold no mixer, or one of no multirotor.

    Examples
    --------
    >>> [mount.spin for mount in layout_of("x").mounts]
    ['ccw', 'ccw', 'cw', 'cw']
    """
    if frame in LAYOUTS:
        return MotorLayout(LAYOUTS[frame], f"Motor order and spins of the layout {frame}")
    path = Path(frame)
    if not path.is_file():
        raise unknown_name("frame", frame, LAYOUTS)
    return _of_settings(path.name, path.read_text(encoding="utf-8", errors="replace"))


def _of_settings(name: str, text: str) -> MotorLayout:
    """Read the layout from settings as ``diff all`` and ``dump`` print them."""
    turned = re.search(r"^set (?:yaw_motors_reversed|motor_direction_inverted) = ON", text, re.M)
    mix = re.findall(r"^mmix\s+(\d+)((?:\s+[-+.\d]+){4})\s*$", text, re.M)
    if mix:
        # a later line of a motor's number takes the place of an earlier one
        rows = {int(number): [float(w) for w in weights.split()] for number, weights in mix}
        mixed = _of_mix(name, [rows[number] for number in sorted(rows) if rows[number][0] > 0.0])
    else:
        mixed = _of_mixer(name, re.findall(r"^mixer\s+(\w+)\s*$", text, re.M))
    return dataclasses.replace(mixed, mounts=_reversed(mixed.mounts)) if turned else mixed


def _of_mixer(name: str, mixers: Sequence[str]) -> MotorLayout:
    if not mixers or mixers[-1] not in BETAFLIGHT:
        source = f"mixer {mixers[-1]}" if mixers else "no line 'mmix' and no line 'mixer'"
        raise GesError(
            f"{name} has {source}; --frame takes a file with mmix lines (diff all), a mixer of"
            f" {', '.join(BETAFLIGHT)}, or a name, as in --frame x"
        )
    layout = layout_of(BETAFLIGHT[mixers[-1]])
    return dataclasses.replace(layout, source=f"Motor order and spins of {mixers[-1]} in {name}")


def _of_mix(name: str, weights: Sequence[Sequence[float]]) -> MotorLayout:
    """Derive the layout from the weights (throttle, roll, pitch, yaw) of each motor.

    A motor with positive roll lies to the left, with positive pitch to the rear. It turns ccw where
    its yaw is positive.
    """
    # a tricopter yaws by a servo, and which way its rotors turn hardly matters
    by_servo = len(weights) == 3
    for number, (_, roll, pitch, yaw) in enumerate(weights, 1):
        if not (roll or pitch) or not (yaw or by_servo):
            raise GesError(
                f"{name}: motor {number} has no part in {'roll, pitch' if yaw else 'yaw'} (mmix),"
                " so that its place or spin is not known; give --frame by name"
            )
    placed = _placed(*((r, -p, "cw" if yaw < 0 else "ccw") for _, r, p, yaw in weights))
    longest = max(mount.reach for mount in placed)
    # of two motors at one place the firmware's own mixers number the upper one first
    places = [(round(m.angle_deg, 3), round(m.reach, 3)) for m in placed]
    mounts = tuple(
        dataclasses.replace(
            m,
            reach=m.reach / longest,
            level=0 if places.count(here) == 1 else 1 if here not in places[:k] else -1,
        )
        for k, (m, here) in enumerate(zip(placed, places, strict=True))
    )
    source = f"Motor order, places and spins as the mixer of {name} weighs them (mmix)"
    return MotorLayout(mounts, source)


def _reversed(mounts: Sequence[Mount]) -> tuple[Mount, ...]:
    return tuple(
        dataclasses.replace(mount, spin="cw" if mount.spin == "ccw" else "ccw") for mount in mounts
    )


def of_rotors(count: int) -> tuple[str, ...]:
    """List the layouts with a number of motors.

    Parameters
    ----------
    count : number of motors.

    Returns
    -------
    Names, keys of :data:`LAYOUTS`.

    Examples
    --------
    >>> of_rotors(10)
    ('deca-x', 'deca-plus')
    """
    return tuple(name for name, mounts in LAYOUTS.items() if len(mounts) == count)
