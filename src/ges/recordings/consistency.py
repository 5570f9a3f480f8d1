"""Whether the streams of a log agree with one another on axes, signs and units."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from ges.conventions import (
    BODY_RATE,
    GRAVITY_M_S2,
    POSITION,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    commands_in,
    rotor_speeds_in,
)

_STEP_S, _SMOOTH_S = 0.02, 0.15
# rotors turn a vehicle faster than that moves it
_FAST_STEP_S, _FAST_SMOOTH_S = 0.01, 0.05
_LONGEST_GAP_S = 0.5
_FEWEST = 100
_STILL = 1e-6
_LEAST_UPRIGHT = 0.2
# a pair never agrees better than clocks and filters let it
_LEAST_MISFIT = 1e-3
_TURNS = ("roll", "pitch", "yaw")
SENSES = "spin"
"""Of rotation of the rotors, by name among the columns that pairs are computed from."""

Columns = Mapping[str, np.ndarray]
Pairs = Iterator[tuple[str, np.ndarray, np.ndarray]]


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How one quantity follows another that physics ties to it.

    Attributes
    ----------
    what : the two quantities, in words.
    correlation : 1 where they agree, -1 where a sign is wrong; 0 without motion.
    ratio : how many times as large the first is as the second (least squares).
    rms : standard deviation of the second, in its unit: small where little moves.
    """

    what: str
    correlation: float
    ratio: float
    rms: float


@dataclasses.dataclass(frozen=True)
class PairFit:
    """How much of two quantities does not agree that physics makes equal or proportional.

    Attributes
    ----------
    misfit : share of the power of either that the other does not explain, 1 - max(0, c)^2. c is
        twice the mean product of both over the sum of their powers, about their means. Where a
        factor between them is free it is their correlation. The misfit is 0 for equals, 1 for
        strangers or opposites.
    windows : number of independent windows, by the width of the smoothing.
    columns : names of what both are computed from; :data:`SENSES` is in the vehicle file.
    """

    misfit: float
    windows: float
    columns: frozenset[str]

    @property
    def log_likelihood(self) -> float:
        """Log likelihood over that of strangers, noise at its most likely value: -(n/2) log m."""
        return -0.5 * self.windows * float(np.log(max(self.misfit, _LEAST_MISFIT)))


@dataclasses.dataclass(frozen=True)
class OnGrids:
    """Columns of a flight at even times, once for all ways to read them.

    Attributes
    ----------
    values : by step of the grid and name, (t,), NaN in gaps; empty where the flight is too short,
        or too long for its rows.
    row_s : median spacing of the rows.
    """

    values: Mapping[float, Columns]
    row_s: float

    @classmethod
    def of(cls, frame: Columns | pd.DataFrame) -> OnGrids:
        """Interpolate the columns that pairs are computed from.

        Parameters
        ----------
        frame : table (n rows) with ``t_s`` and contract columns.
        """
        t_s = np.asarray(frame["t_s"], dtype=float)
        row_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else np.inf
        grids = {step_s: _grid(t_s, step_s) for step_s in (_STEP_S, _FAST_STEP_S)}
        fixed = (*POSITION, *VELOCITY, *QUATERNION, *BODY_RATE, *SPECIFIC_FORCE)
        names = (*(c for c in fixed if c in frame), *commands_in(frame), *rotor_speeds_in(frame))
        return cls(
            {
                step_s: {c: _on(grid, t_s, np.asarray(frame[c], dtype=float)) for c in names}
                for step_s, grid in grids.items()
                if grid is not None
            },
            row_s,
        )

    @property
    def logged(self) -> Columns:
        """Columns by name, on the coarse grid; empty where there is none."""
        return self.values.get(_STEP_S, {})

    def read(self, otherwise: Callable[[Columns], Columns]) -> OnGrids:
        """Replace columns by others.

        Parameters
        ----------
        otherwise : function of the columns to those that change.
        """
        values = {step_s: {**v, **otherwise(v)} for step_s, v in self.values.items()}
        return dataclasses.replace(self, values=values)


@dataclasses.dataclass(frozen=True)
class _Tie:
    """Quantities that physics ties to one another.

    Attributes
    ----------
    names : both quantities in words, for each component.
    streams : columns that they are computed from.
    sides : function of the streams on a grid, each (t, k), to both quantities, each (t, n).
    step_s, smooth_s : step of the grid and width of the smoothing.
    free : whether a factor between them is not known.
    """

    names: Sequence[str]
    streams: tuple[tuple[str, ...], ...]
    sides: Callable[..., tuple[np.ndarray, np.ndarray]]
    step_s: float = _STEP_S
    smooth_s: float = _SMOOTH_S
    free: bool = False

    @property
    def columns(self) -> frozenset[str]:
        return frozenset(c for stream in self.streams for c in stream)

    def pairs(self, flight: OnGrids) -> Pairs:
        """Smooth both of each pair about their means, where they have samples and motion."""
        values = flight.values[self.step_s]
        a, b = self.sides(*(np.stack([values[c] for c in s], axis=1) for s in self.streams))
        for what, x, y in zip(self.names, a.T, b.T, strict=True):
            both = np.isfinite(x) & np.isfinite(y)
            if both.sum() >= _FEWEST:
                x, y = (_smooth(side, both, self.smooth_s / self.step_s) for side in (x, y))
                if min(np.std(x), np.std(y)) >= _STILL:
                    yield what, x, y


def agreements(frame: pd.DataFrame) -> list[Agreement]:
    """Compare pairs of quantities that must agree, smoothed over 0.15 s.

    Parameters
    ----------
    frame : table (n rows) with ``t_s`` and contract columns.

    Returns
    -------
    One agreement for each component; pairs that were not logged are left out.

    Notes
    -----
    The pairs are:

    - body rates and the turning of the attitude;
    - velocity and the derivative of the position;
    - acceleration of the velocity and the specific force in the world, dv/dt = R f - g e_z;
    - specific force along the thrust axis and squared rotor speeds, or commands.
    """
    flight = OnGrids.of(frame)
    return [
        Agreement(what, float(np.corrcoef(a, b)[0, 1]), float(a @ b / (b @ b)), float(np.std(b)))
        for tie in (*_kinematic_ties(flight.logged), *_thrust_ties(flight.logged))
        for what, a, b in tie.pairs(flight)
    ]


def pair_fits(
    flight: OnGrids, rotors: Mapping[str, np.ndarray], among: Collection[str] | None = None
) -> Iterator[tuple[str, PairFit]]:
    """Measure how well quantities agree that physics makes equal or proportional.

    Parameters
    ----------
    flight : its columns at even times, (t,) by name.
    rotors : ``x_m``, ``y_m``, ``spin`` (n_rotors,) of the vehicle; empty where not known.
    among : what a pair has to be computed from, in part; None for every pair.

    Yields
    ------
    The pair in words, and its fit; pairs that were not logged or do not move are left out.

    Notes
    -----
    The pairs are:

    - those of :func:`agreements` without the thrust. Without an accelerometer the horizontal
      acceleration is compared with the tilt, dv/dt = g (R e_z)_xy / (R e_z)_z;
    - commands and squared rotor speeds, each over the mean of all rotors;
    - angular acceleration and sum_i (y_i, -x_i, -spin_i) s_i. s are the squared speeds, or the
      commands where no speeds were logged.

    A factor between the two of a pair is free where motors are in it, but not below zero.
    """
    frame = flight.logged
    for tie in (*_kinematic_ties(frame), *_drive_ties(frame), *_mixer_ties(frame, rotors)):
        columns = tie.columns | {"t_s"} | ({SENSES} if tie.free and rotors else set())
        if among is None or not columns.isdisjoint(among):
            # width of a box that averages noise as the smoothing does; no window is shorter
            window = tie.step_s / max(2.0 * np.sqrt(np.pi) * tie.smooth_s, flight.row_s)
            for what, a, b in tie.pairs(flight):
                power = np.sqrt((a @ a) * (b @ b)) if tie.free else 0.5 * (a @ a + b @ b)
                misfit = 1.0 - max(0.0, float(a @ b / power)) ** 2
                yield what, PairFit(misfit, len(a) * window, columns)


def _grid(t_s: np.ndarray, step_s: float) -> np.ndarray | None:
    """Make even times of a flight; None where it is too short, or too long for its rows."""
    if len(t_s) < 2 or t_s[-1] - t_s[0] > _LONGEST_GAP_S * len(t_s):
        return None
    grid = np.arange(t_s[0], t_s[-1], step_s)
    return grid if len(grid) >= _FEWEST else None


def _kinematic_ties(frame: Columns) -> Iterator[_Tie]:
    turning = [f"{c} and the turning of the attitude" for c in BODY_RATE]
    yield from _logged(frame, _Tie(turning, (BODY_RATE, QUATERNION), _turning_sides))
    if all(c in frame for c in SPECIFIC_FORCE):
        speeding = [f"d({c})/dt and the accelerometer" for c in VELOCITY]
        streams: tuple[tuple[str, ...], ...] = (VELOCITY, QUATERNION, SPECIFIC_FORCE)
        yield from _logged(frame, _Tie(speeding, streams, _speeding_sides))
    else:
        tilting = [f"d({c})/dt and the tilt" for c in VELOCITY[:2]]
        yield from _logged(frame, _Tie(tilting, (VELOCITY, QUATERNION), _tilting_sides))
    moving = [f"d({p})/dt and {v}" for p, v in zip(POSITION, VELOCITY, strict=True)]
    yield from _logged(frame, _Tie(moving, (POSITION, VELOCITY), _moving_sides))


def _logged(frame: Columns, tie: _Tie) -> Iterator[_Tie]:
    if all(c in frame for c in tie.columns):
        yield tie


def _turning_sides(rate: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return rate, _rates(*_attitude(q), _STEP_S)


def _speeding_sides(
    velocity: np.ndarray, q: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    turned, valid = _attitude(q)
    # dv/dt = R f - g e_z
    world = turned.apply(np.where(np.isfinite(force), force, 0.0)) - [0.0, 0.0, GRAVITY_M_S2]
    world[~(valid & np.isfinite(force).all(axis=1))] = np.nan
    return np.gradient(velocity, _STEP_S, axis=0), world


def _tilting_sides(velocity: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turned, valid = _attitude(q)
    axis = turned.apply([0.0, 0.0, 1.0])
    axis[~valid] = np.nan
    tilt = GRAVITY_M_S2 * axis[:, :2] / np.maximum(axis[:, 2:], _LEAST_UPRIGHT)
    return np.gradient(velocity[:, :2], _STEP_S, axis=0), tilt


def _moving_sides(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.gradient(position, _STEP_S, axis=0), velocity


def _thrust_ties(frame: Columns) -> Iterator[_Tie]:
    name, columns, power = _push(frame)

    def sides(force: np.ndarray, push: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return force[:, 2:], (push**power).sum(axis=1, keepdims=True)

    if columns:
        yield from _logged(
            frame, _Tie([f"acc_z_m_s2 and {name}"], (SPECIFIC_FORCE, columns), sides)
        )


def _drive_ties(frame: Columns) -> Iterator[_Tie]:
    commands, speeds = commands_in(frame), rotor_speeds_in(frame)
    if len(commands) == len(speeds) > 0:
        names = [f"{u} and {w}" for u, w in zip(commands, speeds, strict=True)]
        yield _Tie(names, (commands, speeds), _drive_sides, free=True)


def _drive_sides(commands: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return _shares(commands), _shares(speeds**2)


def _mixer_ties(frame: Columns, rotors: Mapping[str, np.ndarray]) -> Iterator[_Tie]:
    _, columns, power = _push(frame)
    logged = [s for s in (BODY_RATE, QUATERNION) if all(c in frame for c in s)]
    if not logged or not columns or len(columns) != len(rotors.get("x_m", ())):
        return
    arms = np.stack([rotors["y_m"], -rotors["x_m"], -rotors["spin"]], axis=1)

    def sides(turned: np.ndarray, push: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rates = turned if logged[0] == BODY_RATE else _rates(*_attitude(turned), _FAST_STEP_S)
        return np.gradient(rates, _FAST_STEP_S, axis=0), _shares(push**power) @ arms

    names = [f"mixer in {axis}" for axis in _TURNS]
    yield _Tie(names, (logged[0], columns), sides, _FAST_STEP_S, _FAST_SMOOTH_S, free=True)


def _push(frame: Columns) -> tuple[str, tuple[str, ...], int]:
    """Name what goes with the thrust of every rotor, its columns (none if not logged) and power."""
    # speeds first: thrust goes with their square, whatever the drive does
    if speeds := rotor_speeds_in(frame):
        return "squared rotor speeds", speeds, 2
    return "commands", commands_in(frame), 1


def _shares(values: np.ndarray) -> np.ndarray:
    """Compute what every motor has over the mean of all, (t, n)."""
    return values - values.mean(axis=1, keepdims=True)


def _attitude(q: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Give attitudes, and where they are known."""
    valid = np.isfinite(q).all(axis=1) & (np.linalg.norm(q, axis=1) > 0.0)
    return Rotation.from_quat(
        np.where(valid[:, None], q, [1.0, 0.0, 0.0, 0.0]), scalar_first=True
    ), valid


def _rates(turned: Rotation, valid: np.ndarray, step_s: float) -> np.ndarray:
    # body rates: log(q_k* q_k+1) / dt
    step = (turned[:-1].inv() * turned[1:]).as_rotvec() / step_s
    turning = np.vstack([step, step[-1:]])
    # a turn needs both of its attitudes
    turning[~(valid & np.r_[valid[1:], False])] = np.nan
    return turning


def _on(grid: np.ndarray, t_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate a column (n,) on the grid between its own samples; NaN in gaps."""
    finite = np.isfinite(values)
    t = t_s[finite]
    if len(t) < 2:
        return np.full(len(grid), np.nan)
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    # a line across a long gap would be no sample
    near = (t[after] - t[after - 1] < _LONGEST_GAP_S) & (grid >= t[0]) & (grid <= t[-1])
    return np.where(near, np.interp(grid, t, values[finite]), np.nan)


def _smooth(values: np.ndarray, valid: np.ndarray, width: float) -> np.ndarray:
    """Smooth valid values (t,) over ``width`` samples, about their mean."""
    steps = np.arange(len(values))
    # gaps are bridged for the filter alone; only what is there is compared
    whole = np.interp(steps, steps[valid], values[valid])
    smooth = gaussian_filter1d(whole, width)[valid]
    return smooth - smooth.mean()
