"""Manoeuvres: tables of references for the simulator's firmware or an autopilot's offboard mode.

A table has 14 columns, :data:`COLUMNS`, and rows :data:`STEP_S` apart. They are position, velocity,
acceleration and yaw references in the world frame ENU, and an excitation. The excitation is added
to the commanded angular acceleration about the body axes (rad/s^2) and to the vertical acceleration
(m/s^2).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ges.conventions import AXES, EXCITATION, MOST_NUMBERS, POSITION_REF, VELOCITY_REF
from ges.errors import GesError, UsageError, unknown_name

if TYPE_CHECKING:
    import pandas as pd

STEP_S = 0.02
COLUMNS = (
    *POSITION_REF,
    *VELOCITY_REF,
    *(f"a_ref_{a}_m_s2" for a in AXES),
    "yaw_ref_rad",
    *EXCITATION,
)


def _times(duration_s: float) -> np.ndarray:
    return np.arange(int(round(duration_s / STEP_S)) + 1) * STEP_S


def _quintic_path(t: np.ndarray, knots_s: list[float], points: np.ndarray) -> np.ndarray:
    """Pass the points (n, 3) at the knots, at rest there, with quintic blends between them."""
    table = np.zeros((len(t), 14))
    leg = np.clip(np.searchsorted(knots_s, t, side="right") - 1, 0, len(knots_s) - 2)
    start, length = np.asarray(knots_s)[leg], np.diff(knots_s)[leg]
    s = np.clip((t - start) / length, 0, 1)[:, None]
    step, length = (points[leg + 1] - points[leg]), length[:, None]
    # s^3 (10 - 15 s + 6 s^2) has no velocity and no acceleration at both ends
    table[:, 0:3] = points[leg] + step * (10 * s**3 - 15 * s**4 + 6 * s**5)
    table[:, 3:6] = step / length * (30 * s**2 - 60 * s**3 + 30 * s**4)
    table[:, 6:9] = step / length**2 * (60 * s - 180 * s**2 + 120 * s**3)
    return table


def hover(duration_s: float = 30.0, height_m: float = 1.0) -> np.ndarray:
    """Make a hover at one point.

    Parameters
    ----------
    duration_s : length.
    height_m : height reference.

    Returns
    -------
    Table (n, 14), see the module.
    """
    return _quintic_path(
        _times(duration_s), [0.0, duration_s], np.tile([0.0, 0.0, height_m], (2, 1))
    )


def height_staircase(
    duration_s: float = 60.0, low_m: float = 0.15, high_m: float = 1.5
) -> np.ndarray:
    """Make a descent and a climb through a ladder of heights, each held for a while.

    It separates ground effect from mass, rangefinder errors and inflow. Heights have equal ratios.

    Parameters
    ----------
    duration_s : length.
    low_m, high_m : lowest and highest step.

    Returns
    -------
    Table (n, 14), see the module.
    """
    # the ground's effect falls off with height: equal ratios, not equal steps
    ladder = np.geomspace(high_m, low_m, 6)
    heights = np.concatenate([ladder, ladder[-2::-1]])
    moves = np.repeat(heights, 2)
    knots = np.linspace(0, duration_s, len(moves))
    return _quintic_path(
        _times(duration_s),
        list(knots),
        np.stack([np.zeros_like(moves), np.zeros_like(moves), moves], 1),
    )


def straight_runs(
    duration_s: float = 60.0, length_m: float = 6.0, height_m: float = 1.0
) -> np.ndarray:
    """Make runs out and back along both axes, at three speeds.

    They separate drag from wind, tilt and attitude bias.

    Parameters
    ----------
    duration_s : length.
    length_m : length of a run.
    height_m : height reference.

    Returns
    -------
    Table (n, 14), see the module.
    """
    legs = [np.array(p) * length_m for p in ((1.0, 0, 0), (0.0, 0, 0), (0, 1.0, 0), (0, 0.0, 0))]
    points, weights = [np.zeros(3)], []
    for pace in (1.0, 0.6, 0.4):
        points += legs
        weights += [pace] * len(legs)
    knots = np.concatenate([[0.0], np.cumsum(weights)]) * duration_s / sum(weights)
    return _quintic_path(_times(duration_s), list(knots), np.array(points) + [0, 0, height_m])


def climbs(duration_s: float = 40.0, low_m: float = 1.0, high_m: float = 4.0) -> np.ndarray:
    """Make climbs and descents at several rates, out of ground effect.

    They separate inflow from motor lag.

    Parameters
    ----------
    duration_s : length.
    low_m, high_m : lowest and highest point.

    Returns
    -------
    Table (n, 14), see the module.
    """
    heights = np.array([low_m, high_m] * 5)
    knots = np.concatenate([[0.0], np.cumsum(np.linspace(1.6, 0.6, len(heights) - 1))])
    points = np.stack([np.zeros_like(heights), np.zeros_like(heights), heights], 1)
    return _quintic_path(_times(duration_s), list(knots * duration_s / knots[-1]), points)


def yaw_turn(duration_s: float = 30.0, height_m: float = 1.0) -> np.ndarray:
    """Make a full turn in hover.

    It separates what is fixed in the body from what is fixed in the world.

    Parameters
    ----------
    duration_s : length.
    height_m : height reference.

    Returns
    -------
    Table (n, 14), see the module.
    """
    table = hover(duration_s, height_m)
    # at rest for a twelfth of the time before and after the turn
    table[:, 9] = np.clip(_times(duration_s) / duration_s * 1.2 - 0.1, 0, 1) * 2 * np.pi
    return table


def multisine(
    duration_s: float = 20.0, height_m: float = 1.5, amplitude_rad_s2: float = 6.0
) -> np.ndarray:
    """Make an excitation of roll, pitch, yaw and height, each with frequencies of its own.

    It separates inertia, motor lag and delays.

    Parameters
    ----------
    duration_s : length.
    height_m : height reference.
    amplitude_rad_s2 : peak angular acceleration about each axis; vertically it is 2 m/s^2.

    Returns
    -------
    Table (n, 14), see the module.

    References
    ----------
    Schroeder, IEEE Transactions on Information Theory 16, 1970: phases that keep the peak low.
    """
    table, t, lines = hover(duration_s, height_m), _times(duration_s), 6
    for axis in range(4):
        # every fourth line belongs to an axis, so that axes share no frequency
        harmonics = 10 + axis + 4 * np.arange(lines)
        # Schroeder's phases keep the peak of the sum low
        phases = np.pi * np.arange(lines) ** 2 / lines
        waves = np.sin(2 * np.pi * np.outer(t, harmonics / duration_s * 1.0) + phases)
        table[:, 10 + axis] = (
            (amplitude_rad_s2 if axis < 3 else 2.0) * waves.sum(1) / np.abs(waves.sum(1)).max()
        )
    return table


MENU: Mapping[str, Callable[..., np.ndarray]] = {
    f.__name__: f for f in (hover, height_staircase, straight_runs, climbs, yaw_turn, multisine)
}


def make(name: str, duration_s: float | None = None) -> np.ndarray:
    """Make a manoeuvre by name.

    Parameters
    ----------
    name : a key of :data:`MENU`: ``hover``, ``height_staircase``, ``straight_runs``, ``climbs``,
        ``yaw_turn``, ``multisine``.
    duration_s : length; by default that of the manoeuvre.

    Returns
    -------
    Table (n, 14) of references, rows :data:`STEP_S` apart. Columns are position (m), velocity (m/s)
    and acceleration (m/s^2), each x, y, z in the world, yaw (rad), and excitation.

    Raises
    ------
    UsageError
        When the name is not in :data:`MENU`, or the table would not fit into memory.

    Examples
    --------
    >>> manoeuvres.make("climbs", 10.0).shape
    (501, 14)
    """
    if name not in MENU:
        raise unknown_name("manoeuvre", name, MENU)
    if duration_s is None:
        return MENU[name]()
    longest_s = MOST_NUMBERS / len(COLUMNS) * STEP_S
    if not duration_s <= longest_s:
        raise UsageError(
            f"duration is {duration_s:g} s; a manoeuvre lasts {longest_s:.0f} s at most"
        )
    return MENU[name](duration_s)


def to_frame(table: np.ndarray) -> pd.DataFrame:
    """Give a table of references column names and times.

    Parameters
    ----------
    table : (n, 14), rows :data:`STEP_S` apart.

    Returns
    -------
    Table of ``t_s`` and :data:`COLUMNS`, as a set-point file has it.
    """
    # whatever lists the manoeuvres would wait for it: a quarter of a second
    import pandas as pd

    return pd.DataFrame(
        {"t_s": np.arange(len(table)) * STEP_S, **dict(zip(COLUMNS, table.T, strict=True))}
    )


def from_frame(frame: pd.DataFrame) -> np.ndarray:
    """Read references from a set-point file or a recording.

    Parameters
    ----------
    frame : table with ``t_s`` and at least the position reference.

    Returns
    -------
    Table (m, 14) resampled to :data:`STEP_S` from the first time on; 0 in columns that are absent.

    Raises
    ------
    GesError
        When the time or a position reference is missing.
    """
    for name in ("t_s", *COLUMNS[:3]):
        if name not in frame:
            raise GesError(f"references need the column {name}; have: {', '.join(frame.columns)}")
    t = frame["t_s"].to_numpy(dtype=float)
    grid = _times(t[-1] - t[0]) + t[0]
    return np.stack(
        [
            (
                np.interp(grid, t, frame[c].to_numpy(dtype=float))
                if c in frame
                else np.zeros_like(grid)
            )
            for c in COLUMNS
        ],
        1,
    )
