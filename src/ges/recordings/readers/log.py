"""A flight log as streams, each at its own times, in the package's frames and units."""

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
    QUATERNION,
    REFERENCE,
    SPECIFIC_FORCE,
    VELOCITY,
)
from ges.errors import GesError, UsageError
from ges.extras import install_command

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
    "reference": "|".join(REFERENCE),
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
    t_s : (n,) strictly increasing times on the log's clock, s.
    columns : quantities (n,) by column name, in SI units; world ENU, body FLU. NaN where a sample
        is missing.
    source : what the log calls it: topic, message or event.
    held : whether it is a set-point, which stays in force until the next one.

    Examples
    --------
    >>> stream = log.streams["velocity"]
    >>> list(stream.columns), round(stream.rate_hz)
    (['v_x_m_s', 'v_y_m_s', 'v_z_m_s'], 50)
    """

    t_s: np.ndarray
    columns: Mapping[str, np.ndarray]
    source: str = ""
    held: bool = False

    @property
    def rate_hz(self) -> float:
        """Rate of new values, 1/s, by the median spacing; 0 where fewer than two rows have one.

        Of a set-point, which may stand still, every row counts.
        """
        rows = self.news() if not self.held else np.arange(len(self.t_s))
        return 1.0 / float(np.median(np.diff(self.t_s[rows]))) if len(rows) > 1 else 0.0

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time with a finite value, s; (0, 0) where there is none."""
        finite = self.t_s[self._finite().any(axis=1)]
        return (float(finite[0]), float(finite[-1])) if len(finite) else (0.0, 0.0)

    def news(self) -> np.ndarray:
        """Find the rows that bring a new value.

        Returns
        -------
        Row numbers (k,). All rows with a finite value where fewer than two of them bring a new one.
        """
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
    """A flight log as its reader gives it.

    Attributes
    ----------
    name : stem of the file.
    format : name of the reader.
    autopilot : firmware and version; '' where the log does not say.
    streams : by name, a key of :data:`COLUMNS` or ``other``.
    parameters : the autopilot's own parameters, by their own names, as logged.
    notes : what was found, chosen or corrected, one sentence each.
    refusal : why the log is of no use at all; '' where it is.
    unusable : columns that are logged and not used, each with the reason.

    Examples
    --------
    >>> log.name, sorted(log.streams)[:3]
    ('runs_fast', ['acceleration', 'attitude', 'command'])
    >>> log.frame().shape
    (1001, 29)
    """

    name: str
    format: str
    autopilot: str
    streams: Mapping[str, Stream]
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    notes: Sequence[str] = ()
    refusal: str = ""
    unusable: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def problem(self) -> str:
        """Say why this log cannot be diagnosed.

        Returns
        -------
        One sentence that says what to log instead; '' where the log can be diagnosed.
        """
        return self.refusal or _shortcoming(self.streams)

    def axis(self) -> np.ndarray:
        """Choose the times of the rows of :meth:`frame`.

        Returns
        -------
        Times (n,) of the attitude, s; of the stream with most rows if the attitude is missing or
        slower than 2 Hz.
        """
        # at its own times the attitude, by which all else is turned, needs no interpolation
        attitude = self.streams.get("attitude")
        if attitude is not None and attitude.rate_hz >= LEAST_RATE_HZ:
            return attitude.t_s
        return max(self.streams.values(), key=lambda s: len(s.t_s)).t_s

    def frame(self) -> pd.DataFrame:
        """Bring all columns to one time axis.

        A stream slower than the axis appears in the row nearest to each sample, interpolated
        linearly. Its other rows are NaN, so that no sample counts twice. A faster stream is
        averaged around each row, so that vibration does not alias. A set-point is held for at most
        1 s. Nothing is interpolated across a gap.

        Returns
        -------
        Table with ``t_s`` and a column for each quantity.

        Raises
        ------
        GesError
            When :meth:`problem` finds one.
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
    """What a user states about a log.

    Attributes
    ----------
    mapping : column or topic map: a file, or the name of a preset.
    pwm : values of the motor outputs (us) that mean command 0 and 1, where the log does not say.
    rotor_order : for motors 1, 2, ... the number of the speed reading that belongs to it, from 1,
        where the log does not say.
    part : which flight of a file that holds several, from 1; the longest if None.

    Raises
    ------
    UsageError
        When ``pwm`` does not increase, or ``rotor_order`` is no permutation.

    Examples
    --------
    >>> from ges.recordings.readers import Options
    >>> Options(pwm=(1000.0, 2000.0)).pwm
    (1000.0, 2000.0)
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
        """Check the stated order of the speed readings against the number of motors.

        Parameters
        ----------
        count : number of motors in the log.

        Returns
        -------
        :attr:`rotor_order`; None where it is not stated.

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
    """A reader of one log format; the protocol that every reader follows.

    Attributes
    ----------
    name : for options.
    title : for people.
    advice : by stream, what to switch on to log it, or to log it faster.

    Examples
    --------
    >>> from ges.recordings.readers import READERS
    >>> [reader.name for reader in READERS]
    ['px4', 'ardupilot', 'betaflight', 'crazyflie', 'ros', 'matlab', 'table']
    """

    @property
    def name(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def advice(self) -> Mapping[str, str]: ...

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether a log is of this format.

        Parameters
        ----------
        head : first bytes of the file, 4096 at most; empty for a folder.
        path : path of the log, which formats without a signature need.
        """

    def read(self, path: Path, options: Options) -> Log:
        """Read a log.

        Parameters
        ----------
        path : the log.
        options : what the user states about it.

        Raises
        ------
        GesError
            When it cannot be read, in one sentence.
        """


def optional_module(name: str, extra: str, what: str) -> ModuleType:
    """Import a module that not every installation has.

    Parameters
    ----------
    name : name of the module.
    extra : extra of this package that installs it.
    what : which logs it reads, for the message.

    Raises
    ------
    GesError
        When it is not installed; the message has the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise GesError(
            f"{what} are read by {name.split('.')[0].replace('_', '-')}, which is not installed;"
            f" {install_command(extra)} brings it"
        ) from None


def named_streams(
    t_s: np.ndarray, columns: Mapping[str, np.ndarray], source: str = ""
) -> dict[str, Stream]:
    """Group the columns of one table into streams.

    Parameters
    ----------
    t_s : (n,) times of the rows, s.
    columns : values (n,) by column name.
    source : what the log calls the table.

    Returns
    -------
    Streams by name; columns without any finite value are left out.
    """
    groups: dict[str, dict[str, np.ndarray]] = {}
    for column, values in columns.items():
        if np.isfinite(values).any():
            groups.setdefault(stream_of(column), {})[column] = values
    return {name: Stream(t_s, group, source) for name, group in groups.items()}


def from_first_sample(streams: Mapping[str, Stream]) -> dict[str, Stream]:
    """Shift the clock of streams, so that t = 0 is the first sample of any.

    Parameters
    ----------
    streams : by name, on one clock.
    """
    start_s = min((s.t_s[0] for s in streams.values()), default=0.0)
    return {n: dataclasses.replace(s, t_s=s.t_s - start_s) for n, s in streams.items()}


def increasing(t_s: np.ndarray) -> tuple[np.ndarray, str]:
    """Select rows whose times are finite and strictly increase.

    Parameters
    ----------
    t_s : (n,) times as logged, s.

    Returns
    -------
    Which rows are kept (n,), and a sentence about the others; '' where all are kept.
    """
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
    """Name the stream that a column belongs to, a key of :data:`COLUMNS` or ``other``.

    Examples
    --------
    >>> stream_of("v_x_m_s"), stream_of("temperature")
    ('velocity', 'other')
    """
    return next((s for s, form in COLUMNS.items() if re.fullmatch(form, column)), "other")


def on_axis(axis: np.ndarray, stream: Stream) -> dict[str, np.ndarray]:
    """Bring the columns of a stream to other times, as :meth:`Log.frame` describes.

    Parameters
    ----------
    axis : (n,) times, s.
    stream : the stream.

    Returns
    -------
    Values (n,) by column name; NaN where the stream has none.
    """
    t = stream.t_s
    if len(t) == len(axis) and np.array_equal(t, axis):
        return dict(stream.columns)
    if stream.held:
        return {name: _hold_last(axis, t, values) for name, values in stream.columns.items()}
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
    """Interpolate linearly between samples at some rows of the axis; NaN elsewhere and in gaps."""
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
    """Average the finite samples around each row, over one usual step; NaN where there is none."""
    half, finite = 0.5 * _spacing(axis), np.isfinite(values)
    first, last = np.searchsorted(t, axis - half), np.searchsorted(t, axis + half)
    # sums over cells are differences of running sums
    total = np.concatenate([[0.0], np.cumsum(np.where(finite, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(finite)])
    n = count[last] - count[first]
    return np.divide(total[last] - total[first], n, out=np.full(len(axis), np.nan), where=n > 0)


def _hold_last(axis: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Hold the last value given, for at most one second."""
    before = np.searchsorted(t, axis, side="right") - 1
    given = (before >= 0) & (axis - t[np.maximum(before, 0)] < _LONG_GAP_S)
    return np.where(given, values[np.maximum(before, 0)], np.nan)


def _shortcoming(streams: Mapping[str, Stream]) -> str:
    """Say what a log of any origin lacks to determine forces; '' for nothing."""
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
