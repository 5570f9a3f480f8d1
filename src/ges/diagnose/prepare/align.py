"""Recordings on a uniform grid: streams, gaps, and the samples that are in the air.

A recording becomes a :class:`Prepared` flight. Nothing here knows the name of a file.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter

from ges.conventions import (
    BODY_RATE,
    EXCITATION,
    POSITION,
    QUATERNION,
    REFERENCE,
    SPECIFIC_FORCE,
    VELOCITY,
    command,
    motor_current,
    rotor_speed,
    rotors_in,
)
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
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
    "reference": REFERENCE,
    "excitation": EXCITATION,
}


@functools.cache
def streams(n_rotors: int) -> Mapping[str, tuple[str, ...]]:
    """Return the columns of every stream.

    Parameters
    ----------
    n_rotors : number of rotors of the vehicle.
    """
    of_rotors = {"rotor_speed": rotor_speed, "command": command, "motor_current": motor_current}
    return {**_STREAMS, **{name: columns(n_rotors) for name, columns in of_rotors.items()}}


@dataclasses.dataclass(frozen=True)
class CommandHold:
    """How long the vehicle acts on a command after its row.

    Attributes
    ----------
    delay_rows : mean delay that this adds, in rows.
    bound_rows : most that it may be off, in rows.

    Notes
    -----
    Commands of which nothing is known are held until the next row, half a row late on average, or
    not at all: even odds, as nothing favours either.
    """

    delay_rows: float = 0.25
    bound_rows: float = 0.25


@dataclasses.dataclass(frozen=True)
class Prepared:
    """One flight on a uniform grid.

    Attributes
    ----------
    t_s : (n,) uniform times.
    columns : contract columns on the grid; what was not logged is absent. Only the rangefinder's
        may be NaN, out of its range.
    flying : (n,) True in the air, away from contact and from gaps.
    lifting : (n,) True where the drive carries nearly as much as in flight, away from gaps. None
        means as ``flying``.
    excluded : (n,) True where a sample is left out, by reason.
    update_s : median time between two new values of each stream.
    derived : streams that were not logged but made from others.
    path : position and velocity at which the model is evaluated, where not at the recorded ones;
        world, m and m/s.
    command_hold : how long its commands are held.
    model_speeds : (n, rotors) rotor speeds at which the model is evaluated, rad/s, where not at the
        recorded ones.
    """

    t_s: np.ndarray
    columns: Mapping[str, np.ndarray]
    flying: np.ndarray
    excluded: Mapping[str, np.ndarray]
    update_s: Mapping[str, float]
    derived: frozenset[str] = frozenset()
    path: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    lifting: np.ndarray | None = None
    command_hold: CommandHold = CommandHold()
    model_speeds: np.ndarray | None = None

    @property
    def driven(self) -> np.ndarray:
        """(n,) True where the drive can be compared: in the air, or lifting on the ground."""
        return self.flying if self.lifting is None else self.flying | self.lifting

    @property
    def dt_s(self) -> float:
        """Spacing of the grid."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def left_out(self) -> dict[str, float]:
        """Seconds that are left out, by reason."""
        return {
            reason: float(at.sum() * self.dt_s) for reason, at in self.excluded.items() if at.any()
        }

    @functools.cached_property
    def streams(self) -> Mapping[str, tuple[str, ...]]:
        """Columns of every stream."""
        return streams(rotors_in(self.columns) or 1)

    def has(self, stream: str) -> bool:
        """Return whether every column of a stream was logged.

        Parameters
        ----------
        stream : a key of :func:`streams`.
        """
        return all(name in self.columns for name in self.streams[stream])

    def stack(self, stream: str) -> np.ndarray:
        """Return the columns of a stream side by side.

        Parameters
        ----------
        stream : a key of :func:`streams` that was logged.

        Returns
        -------
        (n, k), in the unit of the columns.
        """
        return np.stack([self.columns[name] for name in self.streams[stream]], axis=1)

    @property
    def drive_in_every_row(self) -> bool:
        """Whether commands and rotor speeds have new values in every row."""
        if not (self.has("command") and self.has("rotor_speed")):
            return False
        slowest_s = max(self.update_s[s] for s in ("command", "rotor_speed"))
        return round(slowest_s / self.dt_s) <= 1

    def steps(self, longest_s: float) -> int:
        """Return how many simulator steps lie between two samples.

        Parameters
        ----------
        longest_s : longest step that is allowed.
        """
        return max(1, int(np.ceil(self.dt_s / longest_s)))

    def between(self, start: int, end: int) -> Prepared:
        """Return a part of the flight.

        Parameters
        ----------
        start, end : first row, and one past the last.
        """
        rows = slice(start, end)
        of_rows = {
            name: {key: values[rows] for key, values in getattr(self, name).items()}
            for name in ("columns", "excluded", "path")
        }
        maybe = {
            name: None if (values := getattr(self, name)) is None else values[rows]
            for name in ("lifting", "model_speeds")
        }
        return self.replace(t_s=self.t_s[rows], flying=self.flying[rows], **maybe, **of_rows)

    def replace(self, **changes: Any) -> Prepared:
        """Return a copy with other fields.

        Parameters
        ----------
        changes : fields by name.
        """
        return dataclasses.replace(self, **changes)


def no_attitude_derived(flights: Sequence[Prepared]) -> bool:
    """Return whether no flight's attitude was derived from its acceleration.

    Parameters
    ----------
    flights : prepared recordings. One without any attitude derives none.
    """
    return not any("attitude" in f.derived for f in flights)


def _present(frame: pd.DataFrame, names: Sequence[str]) -> list[str]:
    return [
        name
        for name in names
        if name in frame and np.isfinite(frame[name].to_numpy(dtype=float)).sum() >= 2
    ]


def _new_value_rows(values: np.ndarray) -> np.ndarray:
    """Return true in rows that bring a new value of a stream.

    All columns are finite there, and one differs from the last finite row.
    """
    finite = np.isfinite(values).all(axis=1)
    rows = np.flatnonzero(finite)
    changed = (
        np.r_[True, (np.diff(values[rows], axis=0) != 0).any(axis=1)]
        if len(rows)
        else np.zeros(0, bool)
    )
    new = np.zeros(len(values), dtype=bool)
    new[rows[changed]] = True
    return new


def _knot_rows(t_s: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return rows at which a value is known: its first, and its last where it stood for long."""
    usual = np.median(np.diff(t_s[rows])) if len(rows) > 2 else np.inf
    before_next = np.r_[rows[1:] - 1, len(t_s) - 1]
    # a straight line to the next news would turn a long hold into a slow ramp
    stood = t_s[before_next] - t_s[rows] > settings.design.window_updates * usual
    return np.unique(np.r_[rows, before_next[stood]])


def _regrid(
    t_s: np.ndarray, values: np.ndarray, grid_s: np.ndarray, mean_s: float
) -> tuple[np.ndarray, float]:
    """Return a stream on the grid, and the median time between its new values.

    It is interpolated linearly. Rows faster than ``mean_s`` are averaged over it.
    """
    new = np.flatnonzero(_new_value_rows(values))
    # one value for the whole flight: nothing to interpolate, and no time between news
    if len(new) < 2:
        return np.repeat(values[np.isfinite(values).all(axis=1)][:1], len(grid_s), axis=0), np.inf
    knots = _knot_rows(t_s, new)
    # the last row before news may be a hole in the log
    knots = knots[np.isfinite(values[knots]).all(axis=1)]
    on_grid = np.stack(
        [np.interp(grid_s, t_s[knots], values[knots, k]) for k in range(values.shape[1])], axis=1
    )
    every_s = float(np.median(np.diff(t_s[new])))
    if every_s < mean_s:
        on_grid = _grid_means(t_s[knots], values[knots], grid_s, mean_s, on_grid)
    return on_grid, every_s


def _grid_means(
    t_s: np.ndarray, values: np.ndarray, grid_s: np.ndarray, mean_s: float, points: np.ndarray
) -> np.ndarray:
    """Return means of linearly interpolated values over ``mean_s`` around every time of a grid.

    ``points`` stay where the interval reaches beyond the values.
    """
    area = make_interp_spline(t_s, values, k=1).antiderivative()
    start, end = grid_s - 0.5 * mean_s, grid_s + 0.5 * mean_s
    inside = (start >= t_s[0]) & (end <= t_s[-1])
    points[inside] = (area(end[inside]) - area(start[inside])) / mean_s
    return points


def _as_attitudes(q: np.ndarray) -> np.ndarray:
    """Return quaternions without sign changes along the flight, NaN where all four are zero."""
    # an estimator that has not begun writes zeros, which are no attitude
    q = np.where((q == 0.0).all(axis=1, keepdims=True), np.nan, q)
    finite = np.flatnonzero(np.isfinite(q).all(axis=1))
    # q and -q are one attitude: a line between them would pass through attitudes never flown
    flips = np.cumprod(np.where((q[finite][1:] * q[finite][:-1]).sum(axis=1) < 0, -1.0, 1.0))
    q[finite[1:]] *= flips[:, None]
    return q


def grid_step_s(frame: pd.DataFrame) -> float:
    """Return the step of the uniform grid: the median spacing of the rows, within bounds.

    Parameters
    ----------
    frame : a recording with contract columns.
    """
    median_s = np.median(np.diff(frame["t_s"].to_numpy(dtype=float)))
    shortest_s = settings.prepare.grid_step_shortest_s
    longest_s = settings.design.coarsest_s
    return float(np.clip(median_s, shortest_s, longest_s))


def regrid(frame: pd.DataFrame, step_s: float, index: int = 0) -> Prepared:
    """Put a recording on a uniform grid.

    Parameters
    ----------
    frame : a recording with contract columns.
    step_s : spacing of the grid.
    index : of the flight, for messages.

    Returns
    -------
    A flight in which all samples still count as flying.

    Raises
    ------
    GesError
        When the recording is too short, or its times do not increase.
    """
    t_s = frame["t_s"].to_numpy(dtype=float)
    shortest_s = settings.prepare.flight_shortest_s
    if len(t_s) < 2 or t_s[-1] - t_s[0] < shortest_s:
        raise GesError(
            f"flight {index}: {len(t_s)} rows are less than {shortest_s:g} s; leave this"
            " recording out"
        )
    if not (np.diff(t_s) > 0).all():
        raise GesError(
            f"flight {index}: t_s does not increase at row {int(np.argmin(np.diff(t_s) > 0)) + 1};"
            " sort the recording"
        )
    row_s, longest_s = float(np.median(np.diff(t_s))), settings.prepare.pause_s
    if row_s > longest_s:
        raise GesError(
            f"flight {index}: rows are {row_s:.3g} s apart, and {longest_s:g} s are a gap; t_s has"
            " to be in seconds"
        )
    grid = np.arange(t_s[0], t_s[-1], step_s)
    # points of faster rows would fold their noise and the rotors' vibration into what is slow; rows
    # no faster are not smoothed, however their times round
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
            values = _as_attitudes(values) if stream == "attitude" else values
            if not np.isfinite(values).all(axis=1).any():
                continue
            on_grid, every = _regrid(t_s, values, grid, mean_s)
            columns.update(zip(group, on_grid.T, strict=True))
            # the slowest axis sets the update time; one that stands still shows none
            update[stream] = (
                max(every, update.get(stream, 0.0))
                if np.isfinite(every)
                else update.get(stream, every)
            )
    # a line across a rangefinder's silence is invented: kept only where it stands for the height
    if "range_m" in columns and "p_z_m" in columns:
        readings_s = t_s[np.isfinite(frame["range_m"].to_numpy(dtype=float))]
        columns["range_m"] = np.where(_far_from(readings_s, grid), np.nan, columns["range_m"])
    # straight lines between attitudes leave the unit sphere
    if all(name in columns for name in QUATERNION):
        norm = np.sqrt(sum(columns[name] ** 2 for name in QUATERNION))
        columns.update({name: columns[name] / norm for name in QUATERNION})
    return Prepared(grid, columns, np.ones(len(grid), bool), {}, update)


def _far_from(readings_s: np.ndarray, grid_s: np.ndarray) -> np.ndarray:
    """Return true on the grid where the readings on both sides are further apart than a pause."""
    # a line is drawn only between near readings
    after = np.searchsorted(readings_s, grid_s, side="left").clip(1, len(readings_s) - 1)
    return (
        (readings_s[after] - readings_s[after - 1] > settings.prepare.pause_s)
        | (grid_s < readings_s[0])
        | (grid_s > readings_s[-1])
    )


def gaps(frame: pd.DataFrame, grid_s: np.ndarray) -> np.ndarray:
    """Find the pauses of a recording, without rows or without logged motion.

    Parameters
    ----------
    frame : a recording with contract columns.
    grid_s : (n,) times of the grid.

    Returns
    -------
    (n,) True within a pause.
    """
    motion = (
        _present(frame, VELOCITY) or _present(frame, POSITION) or _present(frame, SPECIFIC_FORCE)
    )
    t_s = frame["t_s"].to_numpy(dtype=float)
    # rows that bring no motion are as good as no rows
    good = t_s[np.isfinite(frame[motion].to_numpy(dtype=float)).all(axis=1)] if motion else t_s
    return np.ones(len(grid_s), dtype=bool) if len(good) < 2 else _far_from(good, grid_s)


def thrust_over_weight(flight: Prepared, model: Model) -> np.ndarray | None:
    """Return thrust over weight as the drive makes it.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle.

    Returns
    -------
    (n,), smoothed by ``prepare.thrust_smoothing_s``; None without rotor speeds and commands.
    """
    if flight.has("rotor_speed"):
        speeds = flight.stack("rotor_speed")
    elif flight.has("command"):
        # the motors' lag is short against the smoothing below: a command stands for its speed
        speeds = model.number("max_rotor_speed_rad_s") * flight.stack("command")
    else:
        return None
    thrust_N = model.number("thrust_coefficient_N_s2") * (speeds**2).sum(axis=1)
    return gaussian_filter1d(
        thrust_N / model.weight_N, settings.prepare.thrust_smoothing_s / flight.dt_s
    )


def thrust_over_usual(flight: Prepared, ratio: np.ndarray | None) -> np.ndarray:
    """Return thrust over its usual value, so that a wrong thrust coefficient does not matter.

    Parameters
    ----------
    flight : prepared recording.
    ratio : (n,) of :func:`thrust_over_weight`.

    Returns
    -------
    (n,) thrust over its median in flight; ones where no drive was logged.
    """
    return np.ones(len(flight.t_s)) if ratio is None else ratio / _usual_thrust(ratio)


def resting_m(flight: Prepared, working: np.ndarray, height_m: np.ndarray | None) -> float:
    """Return the height over the ground at which the vehicle rests.

    Parameters
    ----------
    flight : prepared recording.
    working : (n,) of :func:`thrust_over_usual`.
    height_m : (n,) over the ground; None where it is not known.

    Returns
    -------
    The height at an end of the recording where the drive idles; infinite where there is none.

    Notes
    -----
    A brisk descent idles too, and a table is left for what is below it. So a height does not count
    if the vehicle goes much lower.
    """
    if height_m is None:
        return np.inf
    idle = working <= settings.prepare.lifting_share
    n = max(1, int(settings.prepare.pause_s / flight.dt_s))
    ends = (end for end in (slice(n), slice(-n, None)) if idle[end].mean() > 0.5)
    rest_m = min((float(np.median(height_m[end])) for end in ends), default=np.inf)
    # a low quantile and not the least: single readings of a height may be wrong
    lowest_m = float(np.quantile(height_m, settings.statistics.extreme_quantile))
    return rest_m if rest_m < lowest_m + settings.prepare.near_ground_m else np.inf


def airborne(
    flight: Prepared,
    working: np.ndarray,
    above_m: np.ndarray | None,
) -> np.ndarray:
    """Find the samples in the air.

    Parameters
    ----------
    flight : prepared recording.
    working : (n,) of :func:`thrust_over_usual`.
    above_m : (n,) height over that at rest; None where it is not known.

    Returns
    -------
    (n,) True in the air, without a margin around every contact.

    Notes
    -----
    The drive must carry most of its usual thrust, or a part of it well above the resting height, as
    in a descent. The vehicle must also be off its resting height, where that is known.
    """
    p = settings.prepare
    up = working > p.lifting_share
    if above_m is not None:
        descending = (working > p.descent_share) & (above_m > p.near_ground_m)
        up = (up & (above_m > p.height_error_m)) | descending
    # shorter than half the margin is a flicker about a threshold, no take-off and no landing
    size = 2 * int(0.5 * p.pause_s / flight.dt_s) + 1
    up = median_filter(up.astype(np.uint8), size=size, mode="nearest").astype(bool)
    return _well_within(up, p.pause_s, flight.dt_s)


def lifting(flight: Prepared, flying: np.ndarray) -> np.ndarray:
    """Find the samples in which the drive works as in flight, take-offs included.

    Parameters
    ----------
    flight : prepared recording.
    flying : (n,) True in the air.

    Returns
    -------
    (n,) True where the rotors make most of their median thrust in flight, and do so shortly before
    and after.

    Notes
    -----
    A take-off shows what a drive does at its limits, but not while it spins up.
    """
    if not (flight.has("rotor_speed") and flight.has("command") and flying.any()):
        return flying
    # squares of speeds are thrust but for a factor, which the ratio to the median drops
    thrust = (flight.stack("rotor_speed") ** 2).sum(axis=1)
    lifts = thrust > settings.prepare.lifting_share * np.median(thrust[flying])
    return _well_within(lifts, settings.design.half_window_s, flight.dt_s)


def _well_within(at: np.ndarray, margin_s: float, dt_s: float) -> np.ndarray:
    """Return the samples ``at`` (n,) that are a margin away from all others."""
    return (
        ~binary_dilation(~at, iterations=max(1, int(round(margin_s / dt_s)))) if (~at).any() else at
    )


def _usual_thrust(ratio: np.ndarray) -> float:
    """Return the median of the thrust (n,) above half of its mean, weighted by itself.

    Idling samples hardly count in that mean. A drive that never runs gives infinity.
    """
    total = float(ratio.sum())
    return float(np.median(ratio[ratio > 0.5 * (ratio @ ratio) / total])) if total > 0 else np.inf
