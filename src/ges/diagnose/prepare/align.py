"""Data first: which samples fly, how often each stream really speaks, how late one stream is
against another.

A recording becomes a :class:`Prepared` flight on a uniform grid. Nothing here knows the name of a
file.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter

from ges.conventions import (
    BODY_RATE,
    POSITION,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    command,
    motor_current,
    rotor_speed,
    rotors_in,
)
from ges.diagnose.settings import settings
from ges.errors import GesError

_STREAMS: Mapping[str, tuple[str, ...]] = {
    "position": POSITION,
    "velocity": VELOCITY,
    "attitude": QUATERNION,
    "gyro": BODY_RATE,
    "accelerometer": SPECIFIC_FORCE,
    "battery": ("battery_V",),
    "range": ("range_m",),
    "ground": ("ground_z_m",),
    "reference": (
        "p_ref_x_m",
        "p_ref_y_m",
        "p_ref_z_m",
        "v_ref_x_m_s",
        "v_ref_y_m_s",
        "v_ref_z_m_s",
        "yaw_ref_rad",
    ),
    "excitation": ("excite_x_rad_s2", "excite_y_rad_s2", "excite_z_rad_s2", "excite_up_m_s2"),
}


@functools.cache
def streams(n_rotors: int) -> Mapping[str, tuple[str, ...]]:
    """Columns of every stream of a vehicle with so many rotors."""
    of_rotors = {"rotor_speed": rotor_speed, "command": command, "motor_current": motor_current}
    return {**_STREAMS, **{name: columns(n_rotors) for name, columns in of_rotors.items()}}


@dataclasses.dataclass(frozen=True)
class Held:
    """How long a command acts on after its row, so that it comes that much later on the whole: mean
    and sd, in rows.
    """

    late: float
    sd: float


def maybe_held() -> Held:
    """Until the next row, so that it comes half a row later on the whole, or not at all: most
    controllers run faster than their logs.
    """
    chance = settings.prepare.hold_probability
    return Held(0.5 * chance, 0.5 * math.sqrt(chance * (1.0 - chance)))


@dataclasses.dataclass(frozen=True)
class Prepared:
    """One flight on a uniform grid.

    Attributes
    ----------
    t_s : (n,) uniform times.
    columns : contract columns on the grid; what was not logged is absent. Only the rangefinder's
        may be NaN, out of its range.
    flying : (n,) True where the vehicle is in the air, away from contact and from gaps.
    lifting : (n,) True where the drive carries nearly as much as in flight, away from gaps; as
        ``flying`` where nothing is said.
    excluded : (n,) True where a sample is left out, by reason.
    update_s : median time between two new values of each stream.
    lateness_s : delay taken out of a stream, by stream.
    derived : streams that were not logged but made from others.
    path : position and velocity at which the model is asked, where not at the recorded ones; world,
        m and m/s.
    held : how long its commands are held.
    turning : (n, rotors) rotor speeds at which the model is asked, rad/s, where not at the recorded
        ones.
    """

    t_s: np.ndarray
    columns: Mapping[str, np.ndarray]
    flying: np.ndarray
    excluded: Mapping[str, np.ndarray]
    update_s: Mapping[str, float]
    lateness_s: Mapping[str, float] = dataclasses.field(default_factory=dict)
    derived: frozenset[str] = frozenset()
    path: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    lifting: np.ndarray | None = None
    held: Held = dataclasses.field(default_factory=maybe_held)
    turning: np.ndarray | None = None

    @property
    def driven(self) -> np.ndarray:
        """(n,) True where the drive tells of itself: in the air, and on the ground where
        it lifts.
        """
        return self.flying if self.lifting is None else self.flying | self.lifting

    @property
    def dt_s(self) -> float:
        """Spacing of the grid."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def left_out(self) -> dict[str, float]:
        """Seconds left out, by reason."""
        return {
            reason: float(at.sum() * self.dt_s) for reason, at in self.excluded.items() if at.any()
        }

    @functools.cached_property
    def streams(self) -> Mapping[str, tuple[str, ...]]:
        """Columns of every stream."""
        return streams(rotors_in(self.columns) or 1)

    def has(self, stream: str) -> bool:
        """Whether every column of a stream was logged."""
        return all(name in self.columns for name in self.streams[stream])

    def stack(self, stream: str) -> np.ndarray:
        """Columns of a stream, (n, k)."""
        return np.stack([self.columns[name] for name in self.streams[stream]], axis=1)

    @property
    def drive_in_every_row(self) -> bool:
        """Whether commands and rotor speeds bring news in every row."""
        if not (self.has("command") and self.has("rotor_speed")):
            return False
        slowest_s = max(self.update_s[s] for s in ("command", "rotor_speed"))
        return round(slowest_s / self.dt_s) <= 1

    def steps(self, longest_s: float) -> int:
        """Steps no longer than this between two samples."""
        return max(1, int(np.ceil(self.dt_s / longest_s)))

    def between(self, start: int, end: int) -> Prepared:
        """The rows from ``start`` up to ``end``."""
        rows = slice(start, end)
        of_rows = {
            name: {key: values[rows] for key, values in getattr(self, name).items()}
            for name in ("columns", "excluded", "path")
        }
        maybe = {
            name: None if (values := getattr(self, name)) is None else values[rows]
            for name in ("lifting", "turning")
        }
        return self.replaced(t_s=self.t_s[rows], flying=self.flying[rows], **maybe, **of_rows)

    def replaced(self, **changes: Any) -> Prepared:
        """A copy with other fields."""
        return dataclasses.replace(self, **changes)


def attitude_measured(flights: Sequence[Prepared]) -> bool:
    """Whether every flight logged its attitude."""
    return not any("attitude" in f.derived for f in flights)


def _present(frame: pd.DataFrame, names: Sequence[str]) -> list[str]:
    return [
        name
        for name in names
        if name in frame and np.isfinite(frame[name].to_numpy(dtype=float)).sum() >= 2
    ]


def _fresh(values: np.ndarray) -> np.ndarray:
    """Rows that bring a new value of a stream: finite, and any column other than in the
    row before.
    """
    finite = np.isfinite(values).all(axis=1)
    rows = np.flatnonzero(finite)
    changed = (
        np.r_[True, (np.diff(values[rows], axis=0) != 0).any(axis=1)]
        if len(rows)
        else np.zeros(0, bool)
    )
    fresh = np.zeros(len(values), dtype=bool)
    fresh[rows[changed]] = True
    return fresh


def _held_ends(t_s: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows at which a value is known: its arrival; where it stood long without news, also the last
    row that repeats it.
    """
    usual = np.median(np.diff(t_s[rows])) if len(rows) > 2 else np.inf
    before_next = np.r_[rows[1:] - 1, len(t_s) - 1]
    # a straight line to the next news would turn a long hold into a slow ramp
    stood = t_s[before_next] - t_s[rows] > settings.design.window_updates * usual
    return np.unique(np.r_[rows, before_next[stood]])


def _regrid(
    t_s: np.ndarray, values: np.ndarray, grid_s: np.ndarray, mean_s: float
) -> tuple[np.ndarray, float]:
    """A stream between its new values, straight lines, or their means over ``mean_s`` where news
    comes faster; and the median time between them.
    """
    fresh = np.flatnonzero(_fresh(values))
    # one value for the whole flight: nothing to interpolate, and no time between news
    if len(fresh) < 2:
        return np.repeat(values[np.isfinite(values).all(axis=1)][:1], len(grid_s), axis=0), np.inf
    knots = _held_ends(t_s, fresh)
    # the last row before news may be a hole in the log
    knots = knots[np.isfinite(values[knots]).all(axis=1)]
    on_grid = np.stack(
        [np.interp(grid_s, t_s[knots], values[knots, k]) for k in range(values.shape[1])], axis=1
    )
    every_s = float(np.median(np.diff(t_s[fresh])))
    if every_s < mean_s:
        on_grid = _averaged(t_s[knots], values[knots], grid_s, mean_s, on_grid)
    return on_grid, every_s


def _averaged(
    t_s: np.ndarray, values: np.ndarray, grid_s: np.ndarray, mean_s: float, points: np.ndarray
) -> np.ndarray:
    """Means of straight lines between values over ``mean_s`` about every time of a grid; ``points``
    where not all of it is known.
    """
    area = make_interp_spline(t_s, values, k=1).antiderivative()
    start, end = grid_s - 0.5 * mean_s, grid_s + 0.5 * mean_s
    known = (start >= t_s[0]) & (end <= t_s[-1])
    points[known] = (area(end[known]) - area(start[known])) / mean_s
    return points


def _continuous(q: np.ndarray) -> np.ndarray:
    """Quaternions of one sign along the flight."""
    q = q.copy()
    finite = np.flatnonzero(np.isfinite(q).all(axis=1))
    # q and -q are one attitude: a line between them would pass through attitudes never flown
    flips = np.cumprod(np.where((q[finite][1:] * q[finite][:-1]).sum(axis=1) < 0, -1.0, 1.0))
    q[finite[1:]] *= flips[:, None]
    return q


def grid_step_s(frame: pd.DataFrame) -> float:
    """Step of the uniform grid: the median spacing of the rows, within bounds."""
    median_s = np.median(np.diff(frame["t_s"].to_numpy(dtype=float)))
    shortest_s, longest_s = (
        settings.prepare.grid_step_shortest_s,
        settings.design.coarsest_s,
    )
    return float(np.clip(median_s, shortest_s, longest_s))


def regrid(frame: pd.DataFrame, step_s: float, number: int = 0) -> Prepared:
    """Put a recording on a uniform grid; ``flying`` is not decided yet.

    Parameters
    ----------
    frame : a recording with contract columns.
    step_s : spacing of the grid.
    number : index of the flight, for messages.
    """
    t_s = frame["t_s"].to_numpy(dtype=float)
    shortest_s = settings.prepare.flight_shortest_s
    if len(t_s) < 2 or t_s[-1] - t_s[0] < shortest_s:
        raise GesError(
            f"flight {number}: {len(t_s)} rows are less than {shortest_s:g} s; leave this"
            " recording out"
        )
    if not (np.diff(t_s) > 0).all():
        raise GesError(
            f"flight {number}: t_s does not increase at row {int(np.argmin(np.diff(t_s) > 0)) + 1};"
            " sort the recording"
        )
    grid = np.arange(t_s[0], t_s[-1], step_s)
    # points of faster rows would fold their noise and the rotors' vibration into what is slow; rows
    # no faster are not smoothed, however their times round
    row_s = np.median(np.diff(t_s))
    mean_s = step_s if row_s < step_s and not np.isclose(row_s, step_s) else 0.0
    columns: dict[str, np.ndarray] = {}
    update: dict[str, float] = {}
    for stream, names in streams(rotors_in(frame.columns) or 1).items():
        # a height, or one axis of an accelerometer, is of use alone; an attitude only whole
        if stream in ("position", "reference", "accelerometer"):
            groups = [[name] for name in _present(frame, names)]
        else:
            groups = [list(names)] if len(_present(frame, names)) == len(names) else []
        for group in groups:
            values = frame[group].to_numpy(dtype=float)
            values = _continuous(values) if stream == "attitude" else values
            on_grid, every = _regrid(t_s, values, grid, mean_s)
            columns.update(zip(group, on_grid.T, strict=True))
            # the slowest axis sets the update time; one that stands still says nothing of it
            update[stream] = (
                max(every, update.get(stream, 0.0))
                if np.isfinite(every)
                else update.get(stream, every)
            )
    # a line across a rangefinder's silence is invented: kept only where it stands for the height
    if "range_m" in columns and "p_z_m" in columns:
        columns["range_m"] = np.where(_silent(frame, "range_m", grid), np.nan, columns["range_m"])
    # straight lines between attitudes leave the unit sphere
    if all(name in columns for name in QUATERNION):
        norm = np.sqrt(sum(columns[name] ** 2 for name in QUATERNION))
        columns.update({name: columns[name] / norm for name in QUATERNION})
    return Prepared(grid, columns, np.ones(len(grid), bool), {}, update)


def _silent(frame: pd.DataFrame, name: str, grid_s: np.ndarray) -> np.ndarray:
    """True on the grid where a sensor had nothing to say for too long to be bridged."""
    heard = frame["t_s"].to_numpy(dtype=float)[np.isfinite(frame[name].to_numpy(dtype=float))]
    # the readings on both sides of every sample: a line is drawn only between near ones
    after = np.searchsorted(heard, grid_s, side="left").clip(1, len(heard) - 1)
    return (
        (heard[after] - heard[after - 1] > settings.prepare.pause_s)
        | (grid_s < heard[0])
        | (grid_s > heard[-1])
    )


def gaps(frame: pd.DataFrame, grid_s: np.ndarray) -> np.ndarray:
    """True on the grid (n,) where the recording itself stopped for long (no row, or motion not
    logged).
    """
    motion = (
        _present(frame, VELOCITY) or _present(frame, POSITION) or _present(frame, SPECIFIC_FORCE)
    )
    t_s = frame["t_s"].to_numpy(dtype=float)
    # rows that bring no motion are as good as no rows
    good = t_s[np.isfinite(frame[motion].to_numpy(dtype=float)).all(axis=1)] if motion else t_s
    if len(good) < 2:
        return np.ones(len(grid_s), dtype=bool)
    after = np.searchsorted(good, grid_s, side="left").clip(1, len(good) - 1)
    return (
        (good[after] - good[after - 1] > settings.prepare.pause_s)
        | (grid_s < good[0])
        | (grid_s > good[-1])
    )


def lift(
    flight: Prepared, thrust_coefficient: float, speed_max: float, weight_N: float
) -> np.ndarray | None:
    """Thrust over weight by the drive, (n,), smoothed by ``prepare.thrust_smoothing_s``; None
    without rotor speeds and commands.

    Parameters
    ----------
    thrust_coefficient : N s^2.
    speed_max : rotor speed of a full command, rad/s.
    """
    if flight.has("rotor_speed"):
        speeds = flight.stack("rotor_speed")
    elif flight.has("command"):
        # the motors' lag is short against the smoothing below: a command stands for its speed
        speeds = speed_max * flight.stack("command")
    else:
        return None
    ratio = thrust_coefficient * (speeds**2).sum(axis=1) / weight_N
    return gaussian_filter1d(ratio, settings.prepare.thrust_smoothing_s / flight.dt_s)


def over_usual(flight: Prepared, ratio: np.ndarray | None) -> np.ndarray:
    """Thrust over its own median where it is clearly up, (n,), so that a wrong thrust coefficient
    does not matter; one where no drive was logged.
    """
    return np.ones(len(flight.t_s)) if ratio is None else ratio / _usual(ratio)


def resting_m(flight: Prepared, working: np.ndarray, height_m: np.ndarray | None) -> float:
    """Height over the ground that the vehicle rests at: that of an end of the recording where the
    drive idles, if nothing is much lower (a brisk descent idles too, and a table is left for what
    is below it); infinite in a recording that begins and ends in the air, or has no height.

    Parameters
    ----------
    working : (n,) thrust of :func:`over_usual`.
    height_m : (n,) over the ground; None where it is not known.
    """
    if height_m is None:
        return np.inf
    idle = working <= settings.prepare.lifting_share
    n = max(1, int(settings.prepare.pause_s / flight.dt_s))
    ends = (end for end in (slice(n), slice(-n, None)) if idle[end].mean() > 0.5)
    rest_m = min((float(np.median(height_m[end])) for end in ends), default=np.inf)
    # a low quantile and not the least: single readings of a height may be wrong
    lowest_m = float(np.quantile(height_m, settings.statistics.extreme_quantile))
    return rest_m if rest_m < lowest_m + settings.prepare.rest_tolerance_m else np.inf


def airborne(
    flight: Prepared,
    working: np.ndarray,
    above_m: np.ndarray | None,
) -> np.ndarray:
    """Samples in the air.

    The drive must carry most of its own median where it is clearly up, or a part of it well above
    the resting height, as in a brisk descent; and the vehicle must be off its resting height:
    ``above_m`` it, where that is known. A margin around every contact is left out.

    Parameters
    ----------
    working : (n,) thrust of :func:`over_usual`.
    above_m : (n,) height over that at rest; None where it is not known.

    Returns
    -------
    (n,) True in the air.
    """
    p = settings.prepare
    up = working > p.lifting_share
    if above_m is not None:
        descending = (working > p.descent_share) & (above_m > p.descent_height_m)
        up = (up & (above_m > p.height_error_m)) | descending
    # shorter than half the margin is a flicker about a threshold, no take-off and no landing
    size = 2 * int(0.5 * p.pause_s / flight.dt_s) + 1
    up = median_filter(up.astype(np.uint8), size=size, mode="nearest").astype(bool)
    return _well_within(up, p.pause_s, flight.dt_s)


def lifting(flight: Prepared, flying: np.ndarray) -> np.ndarray:
    """Samples, True of (n,), in which the rotors push most of their median in flight, and a little
    before and after do: a take-off shows what a drive does at its limits, but not while it spins
    up.

    Parameters
    ----------
    flying : (n,) True in the air.
    """
    if not (flight.has("rotor_speed") and flight.has("command") and flying.any()):
        return flying
    # squares of speeds are thrust but for a factor, which the ratio to the median drops
    push = (flight.stack("rotor_speed") ** 2).sum(axis=1)
    lifts = push > settings.prepare.lifting_share * np.median(push[flying])
    return _well_within(lifts, settings.design.half_window_s, flight.dt_s)


def _well_within(at: np.ndarray, margin_s: float, dt_s: float) -> np.ndarray:
    """Those of the samples ``at`` (n,) that are a margin away from all others."""
    return (
        ~binary_dilation(~at, iterations=max(1, int(round(margin_s / dt_s)))) if (~at).any() else at
    )


def _usual(ratio: np.ndarray) -> float:
    """Median of the thrust (n,) where it is clearly up: above half of its mean, each sample counted
    by its thrust, so that what idles does not; infinite for a drive that never runs.
    """
    total = float(ratio.sum())
    return float(np.median(ratio[ratio > 0.5 * (ratio @ ratio) / total])) if total > 0 else np.inf
