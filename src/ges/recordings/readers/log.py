"""What a reader gives: a flight log as streams, each at its own times, in the contract's frames
and units.
"""

from __future__ import annotations

import dataclasses
import importlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Protocol

import numpy as np
import pandas as pd

from ges.conventions import (
    BODY_RATE,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
)
from ges.errors import GesError, UsageError

COLUMNS: Mapping[str, str] = {
    "position": "|".join(POSITION),
    "velocity": "|".join(VELOCITY),
    "attitude": "|".join(QUATERNION),
    "rates": "|".join(BODY_RATE),
    "acceleration": "|".join(SPECIFIC_FORCE),
    "command": r"u_[1-9]\d*",
    "rotor_speed": r"rotor_speed_[1-9]\d*_rad_s",
    "motor_current": r"motor_current_[1-9]\d*_A",
    "battery": "battery_V|battery_A",
    "range": "range_m",
    "ground": "ground_z_m",
    "reference": "|".join((*POSITION_REF, *VELOCITY_REF, "yaw_ref_rad")),
    "excitation": "excite_[xyz]_rad_s2|excite_up_m_s2",
}
"""Contract columns of each stream, as a pattern; what fits none is kept in the stream ``other``."""

DRIVE = ("command", "rotor_speed")
MOTION = ("attitude", "position", "velocity", "rates", "acceleration")

# The diagnosis takes half a second without news for a gap.
LEAST_RATE_HZ = 2.0
SHORTEST_S = 2.0

# Between two samples a straight line is drawn only if they are no farther apart than three usual
# spacings, but a quarter of a second always and a second never.
_USUAL_SPACINGS, _SHORT_GAP_S, _LONG_GAP_S = 3.0, 0.25, 1.0
_OTHER_RATE = 1.5

_FAR_AHEAD = 1e5
_LONGEST_S = 1e5


@dataclasses.dataclass(frozen=True)
class Stream:
    """Quantities that were logged together.

    Attributes
    ----------
    t_s : (n,) strictly increasing, seconds on the log's clock.
    columns : name -> (n,); contract columns in SI, ENU and FLU; NaN where a sample is missing.
    source : what the log calls it (topic, message, event).
    held : a set-point that stays in force until the next one.
    """

    t_s: np.ndarray
    columns: Mapping[str, np.ndarray]
    source: str = ""
    held: bool = False

    @property
    def rate_hz(self) -> float:
        """New values a second: rows with a finite value other than the row before's; all rows of a
        set-point, which may stand still.
        """
        rows = self.news() if not self.held else np.arange(len(self.t_s))
        return 1.0 / float(np.median(np.diff(self.t_s[rows]))) if len(rows) > 1 else 0.0

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time with a finite value."""
        finite = self.t_s[self._finite().any(axis=1)]
        return (float(finite[0]), float(finite[-1])) if len(finite) else (0.0, 0.0)

    def news(self) -> np.ndarray:
        """Rows that bring a new value; all finite ones where nothing ever changes."""
        # a slow sensor copied into every row of a fast loop brings nothing new in most of them
        rows = np.flatnonzero(self._finite().any(axis=1))
        values = self._values()[rows]
        fresh = np.r_[True, (np.diff(values, axis=0) != 0).any(axis=1)][: len(rows)]
        return rows[fresh] if fresh.sum() > 1 else rows

    def _values(self) -> np.ndarray:
        return np.stack([np.asarray(v, dtype=float) for v in self.columns.values()], axis=1)

    def _finite(self) -> np.ndarray:
        return np.isfinite(self._values())


@dataclasses.dataclass(frozen=True)
class Log:
    """One flight log.

    Attributes
    ----------
    name : stem of the file.
    format : name of the reader.
    autopilot : firmware and version, '' where the log does not say.
    streams : by name, a key of :data:`COLUMNS` or ``other``.
    parameters : the autopilot's own parameters, by their own names, as logged.
    notes : what was found, chosen or corrected, a sentence each.
    refusal : why the vehicle or the log can be of no use at all; '' where it can.
    """

    name: str
    format: str
    autopilot: str
    streams: Mapping[str, Stream]
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    notes: Sequence[str] = ()
    refusal: str = ""

    def problem(self) -> str:
        """Why this log cannot serve, in one sentence with what to log instead; '' where it can."""
        return self.refusal or _shortcoming(self.streams)

    def axis(self) -> np.ndarray:
        """Times of the rows of :meth:`frame`: those of the attitude, or of the fastest stream
        where there is no attitude (or one too slow).
        """
        # at its own times the attitude, by which all else is turned, needs no interpolation
        attitude = self.streams.get("attitude")
        if attitude is not None and attitude.rate_hz >= LEAST_RATE_HZ:
            return attitude.t_s
        return max(self.streams.values(), key=lambda s: len(s.t_s)).t_s

    def frame(self) -> pd.DataFrame:
        """All columns on one time axis.

        A stream that is slower than the axis appears in the row nearest to each of its samples, by
        a straight line between its own; its other rows are NaN, so that nobody counts one sample
        twice. A faster one appears by its mean around each row, so that vibration does not fold
        down. A set-point stays for a second at most. Nothing is drawn over a gap.

        Returns
        -------
        pandas.DataFrame with ``t_s`` and contract columns.

        Raises
        ------
        GesError
            When the log cannot serve (:meth:`problem`).
        """
        if problem := self.problem():
            raise GesError(f"{self.name}: {problem}")
        axis = self.axis()
        columns = {"t_s": axis}
        for stream in self.streams.values():
            columns |= on_axis(axis, stream)
        return pd.DataFrame(columns)


@dataclasses.dataclass(frozen=True)
class Options:
    """What a user may say about a log.

    Attributes
    ----------
    mapping : column or topic map: a file, or the name of a preset.
    pwm : values of the motor outputs (us) that mean command 0 and 1, where the log does not say.
    rotor_order : for each motor 1, 2, ... the number of the speed reading that is its own, counted
        from 1, where the log does not say.
    part : which flight of a file that holds several, counted from 1; the longest if None.
    """

    mapping: str | Path | None = None
    pwm: tuple[float, float] | None = None
    rotor_order: tuple[int, ...] | None = None
    part: int | None = None

    def __post_init__(self) -> None:
        if self.pwm and not self.pwm[1] > self.pwm[0]:
            raise UsageError(
                f"--pwm {self.pwm[0]:g} {self.pwm[1]:g}: the output that means 0 must be below the"
                " one that means 1"
            )
        count = len(self.rotor_order or ())
        if self.rotor_order and sorted(self.rotor_order) != list(range(1, count + 1)):
            order = " ".join(map(str, self.rotor_order))
            raise UsageError(f"--rotor-order {order}: name each of 1 to {count} once")

    def order_of(self, count: int) -> tuple[int, ...] | None:
        """The stated order of the readings of so many motors; None where it is not stated.

        Raises
        ------
        UsageError
            When it is of another number of motors.
        """
        if self.rotor_order and len(self.rotor_order) != count:
            raise UsageError(
                f"--rotor-order names {len(self.rotor_order)} readings; the log has {count} motors"
            )
        return self.rotor_order


class Reader(Protocol):
    """One log format.

    Attributes
    ----------
    name, title : for options, and for people.
    advice : what to switch on to have a stream, or to have it faster, by stream.
    """

    @property
    def name(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def advice(self) -> Mapping[str, str]: ...

    def sniff(self, head: bytes, path: Path) -> bool:
        """Whether the first bytes are this format's; ``path`` only for formats that are folders."""

    def read(self, path: Path, options: Options) -> Log:
        """The log; raises GesError with one sentence where it cannot be read."""


def optional_module(name: str, extra: str, what: str) -> ModuleType:
    """A module that not every installation has.

    Raises
    ------
    GesError
        With the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise GesError(
            f"{what} are read by {name.split('.')[0].replace('_', '-')}, which is not installed;"
            f" pip install 'ges[{extra}]' brings it"
        ) from None


def named_streams(
    t_s: np.ndarray, columns: Mapping[str, np.ndarray], source: str = ""
) -> dict[str, Stream]:
    """Columns of one table as streams, all at the times ``t_s`` (n,); those without any finite
    value are left out.
    """
    groups: dict[str, dict[str, np.ndarray]] = {}
    for column, values in columns.items():
        if np.isfinite(values).any():
            groups.setdefault(stream_of(column), {})[column] = values
    return {name: Stream(t_s, group, source) for name, group in groups.items()}


def increasing(t_s: np.ndarray) -> tuple[np.ndarray, str]:
    """Rows (n,) whose time is a number and goes on, and what is to be said of the others."""
    finite = np.isfinite(t_s)
    if len(t_s) > 2:
        # one damaged time far ahead would make all later rows repeat an earlier one
        ahead = t_s[1:-1] - np.maximum(t_s[:-2], t_s[2:])
        finite[1:-1] &= ~((ahead > _FAR_AHEAD) & (t_s[2:] > t_s[:-2]))
    # against the latest time so far: after a jump back no row counts until it is past that
    latest = np.maximum.accumulate(np.where(finite, t_s, -np.inf))
    good = finite & (t_s > np.r_[-np.inf, latest[:-1]])
    dropped = int(np.sum(~good))
    return good, f"{dropped} rows repeat an earlier time and were dropped" if dropped else ""


def stream_of(column: str) -> str:
    """Name of the stream that a column belongs to."""
    return next((s for s, form in COLUMNS.items() if re.fullmatch(form, column)), "other")


def on_axis(axis: np.ndarray, stream: Stream) -> dict[str, np.ndarray]:
    """Columns of a stream at the times ``axis`` (n,), as :meth:`Log.frame` says."""
    t = stream.t_s
    if len(t) == len(axis) and np.array_equal(t, axis):
        return dict(stream.columns)
    if stream.held:
        return {name: _held(axis, t, values) for name, values in stream.columns.items()}
    step, own = _spacing(axis), _spacing(t)
    # rates that differ by less are taken as the same, with jitter
    if own * _OTHER_RATE < step:
        return {name: _means(axis, t, values) for name, values in stream.columns.items()}
    # of a slower stream one row a sample, so that its number of values stays as it was
    rows = np.arange(len(axis))
    if own > _OTHER_RATE * step:
        rows = np.unique(_nearest(axis, t[(t >= axis[0]) & (t <= axis[-1])]))
    return {name: _lines(axis, rows, t, values) for name, values in stream.columns.items()}


def _spacing(t: np.ndarray) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else np.inf


def _nearest(axis: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Row of ``axis`` nearest to each of the times ``t``."""
    if len(axis) < 2:
        return np.zeros(len(t), dtype=int)
    after = np.clip(np.searchsorted(axis, t), 1, len(axis) - 1)
    # true counts as one: the row before, where that is nearer
    return after - (t - axis[after - 1] < axis[after] - t)


def _lines(axis: np.ndarray, rows: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Straight lines between samples, at some rows of the axis; NaN elsewhere and in gaps."""
    out = np.full(len(axis), np.nan)
    if len(t) < 2 or len(rows) == 0:
        return out
    at = axis[rows]
    gap = np.clip(_USUAL_SPACINGS * _spacing(t), _SHORT_GAP_S, _LONG_GAP_S)
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    # a sample that falls on the row needs no line to it
    short = (t[after] - t[after - 1] < gap) | (t[after] == at)
    inside = (at >= t[0]) & (at <= t[-1]) & short
    out[rows] = np.where(inside, np.interp(at, t, values), np.nan)
    return out


def _means(axis: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean of the finite samples in the cell around each row, NaN in an empty cell; a cell is a
    usual step wide.
    """
    half, finite = 0.5 * _spacing(axis), np.isfinite(values)
    first, last = np.searchsorted(t, axis - half), np.searchsorted(t, axis + half)
    # sums over cells are differences of running sums
    total = np.concatenate([[0.0], np.cumsum(np.where(finite, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(finite)])
    n = count[last] - count[first]
    return np.divide(total[last] - total[first], n, out=np.full(len(axis), np.nan), where=n > 0)


def _held(axis: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The last value given, for a second at most."""
    before = np.searchsorted(t, axis, side="right") - 1
    given = (before >= 0) & (axis - t[np.maximum(before, 0)] < _LONG_GAP_S)
    return np.where(given, values[np.maximum(before, 0)], np.nan)


def _shortcoming(streams: Mapping[str, Stream]) -> str:
    """What a log lacks to say anything of forces, whoever wrote it."""
    longest_s = max((s.t_s[-1] - s.t_s[0] for s in streams.values()), default=0.0)
    if longest_s > _LONGEST_S:
        return (
            f"its times span {longest_s / 86400:.3g} days: the clock was set while it was logged,"
            " or the log is damaged; cut the flight out"
        )
    for names, what, remedy in (
        (DRIVE, "drive", "motor commands or rotor speeds"),
        (MOTION, "motion", "attitude, velocity, gyro and accelerometer"),
    ):
        # one of these is enough, and the best of them counts
        present = [streams[name] for name in names if name in streams]
        if not present:
            return (
                f"the log says nothing of the {what}, without which no force can be told; log"
                f" {remedy} ('ges doctor' says how)"
            )
        rate_hz = max(stream.rate_hz for stream in present)
        if 0 < rate_hz < LEAST_RATE_HZ:
            return (
                f"its {what} is logged {rate_hz:.2g} times a second; to tell forces takes"
                f" {LEAST_RATE_HZ:g} at the very least, and 50 or more to be of good use, so log"
                f" {remedy} faster ('ges doctor' says how)"
            )
        # by finite values: a topic may go on after its sensor has fallen silent
        spans = [stream.span_s for stream in present]
        if max(end - start for start, end in spans) < SHORTEST_S:
            return (
                f"the log holds {max(end - start for start, end in spans):.2g} s of {what}; a"
                f" flight needs {SHORTEST_S:g} s or more"
            )
    return ""
