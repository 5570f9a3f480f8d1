"""Whether the streams of a log agree with one another on axes, signs and units."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

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


Reading = tuple[Sequence[int], float]


@dataclasses.dataclass(frozen=True)
class PairFit:
    """How much of two quantities that should be equal does not agree.

    Attributes
    ----------
    misfit : power of the difference over the sum of both powers, about their means. 0 where they
        are equal, 1 where they have nothing in common, 2 where they are opposite.
    windows : number of independent windows, by the width of the smoothing.
    """

    misfit: float
    windows: float

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the pair, with its noise at the most likely value: -(n/2) log m."""
        return -0.5 * self.windows * float(np.log(max(self.misfit, _LEAST_MISFIT)))


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
    grid = _grid(frame)
    if grid is None:
        return []
    pairs = {**_kinematic_pairs(grid, frame), **_thrust_pair(grid, frame)}
    return [
        Agreement(what, float(np.corrcoef(a, b)[0, 1]), float(a @ b / (b @ b)), float(np.std(b)))
        for what, (a, b) in _smoothed(pairs).items()
    ]


def kinematic_fits(frame: pd.DataFrame) -> dict[str, PairFit]:
    """Measure how well quantities that kinematics makes equal are equal.

    Parameters
    ----------
    frame : table (n rows) with ``t_s`` and contract columns.

    Returns
    -------
    Fits by the pair in words: those of :func:`agreements` without the thrust. Without an
    accelerometer the horizontal acceleration is compared with the tilt, dv/dt = g (R e_z)_xy / (R
    e_z)_z.
    """
    grid = _grid(frame)
    if grid is None:
        return {}
    windows = _windows(frame, _STEP_S, _SMOOTH_S)
    return {
        what: PairFit(float(np.sum((a - b) ** 2) / (a @ a + b @ b)), len(a) * windows)
        for what, (a, b) in _smoothed(_kinematic_pairs(grid, frame)).items()
    }


def _windows(frame: pd.DataFrame, step_s: float, smooth_s: float) -> float:
    """Count independent windows in a sample of the grid; none is shorter than smoothing or row."""
    # width of a box that averages noise as the smoothing does
    box_s = 2.0 * np.sqrt(np.pi) * smooth_s
    return step_s / max(box_s, float(np.median(np.diff(frame["t_s"]))))


def mixer_fits(
    frame: pd.DataFrame, rotors: Mapping[str, np.ndarray], readings: Sequence[Reading]
) -> list[dict[str, PairFit]]:
    """Measure how well the angular acceleration follows what unlike rotors ask for.

    Parameters
    ----------
    frame : table (n rows) with ``t_s`` and contract columns.
    rotors : ``x_m``, ``y_m``, ``spin`` (n_rotors,) of the vehicle; empty where not known.
    readings : ways to read the motors' columns: rotor of each column, from 0, and a factor on
        ``spin``.

    Returns
    -------
    For each reading the fits by axis; empty where the log does not show them.

    Notes
    -----
    Moments are proportional to sum_i (y_i, -x_i, -spin_i) s_i. s are the squared speeds, or the
    commands where no speeds were logged. The factor of each axis is fitted, not below zero.
    """
    grid = _grid(frame, _FAST_STEP_S)
    turning = None if grid is None else _turning(grid, frame)
    push = None if grid is None else _push(grid, frame)
    if turning is None or push is None or push[1].shape[1] != len(rotors.get("x_m", ())):
        return [{} for _ in readings]
    share = push[1] - push[1].mean(axis=1, keepdims=True)
    speeding = np.gradient(turning, _FAST_STEP_S, axis=0)
    both = np.isfinite(np.hstack([speeding, share])).all(axis=1)
    if both.sum() < _FEWEST:
        return [{} for _ in readings]
    width = _FAST_SMOOTH_S / _FAST_STEP_S
    speeding, share = _smooth(speeding, both, width), _smooth(share, both, width)
    windows = len(share) * _windows(frame, _FAST_STEP_S, _FAST_SMOOTH_S)
    by_reading = []
    for order, sense in readings:
        place = list(order)
        arms = [rotors["y_m"], -rotors["x_m"], -sense * rotors["spin"]]
        fits = {}
        for axis, arm, turned in zip(_TURNS, arms, speeding.T, strict=True):
            asked = share @ arm[place]
            if min(np.std(asked), np.std(turned)) >= _STILL:
                r = max(0.0, float(np.corrcoef(asked, turned)[0, 1]))
                fits[f"mixer in {axis}"] = PairFit(1.0 - r**2, windows)
        by_reading.append(fits)
    return by_reading


def _grid(frame: pd.DataFrame, step_s: float = _STEP_S) -> np.ndarray | None:
    """Make even times of a flight; None where it is too short, or too long for its rows."""
    t_s = frame["t_s"].to_numpy(dtype=float)
    if len(t_s) < 2 or t_s[-1] - t_s[0] > _LONGEST_GAP_S * len(t_s):
        return None
    grid = np.arange(t_s[0], t_s[-1], step_s)
    return grid if len(grid) >= _FEWEST else None


Pairs = dict[str, tuple[np.ndarray, np.ndarray]]


def _kinematic_pairs(grid: np.ndarray, frame: pd.DataFrame) -> Pairs:
    has = {
        names: all(n in frame for n in names)
        for names in (POSITION, VELOCITY, QUATERNION, BODY_RATE, SPECIFIC_FORCE)
    }
    value = {names: _on(grid, frame, names) for names, logged in has.items() if logged}
    pairs: Pairs = {}
    if has[QUATERNION]:
        turned, valid = _attitude(value[QUATERNION])
        if has[BODY_RATE]:
            turning = _rates(turned, valid, _STEP_S)
            pairs |= _paired(
                "{} and the turning of the attitude", BODY_RATE, value[BODY_RATE], turning
            )
        if has[VELOCITY]:
            speeding = np.gradient(value[VELOCITY], _STEP_S, axis=0)
            if has[SPECIFIC_FORCE]:
                force = np.where(np.isfinite(value[SPECIFIC_FORCE]), value[SPECIFIC_FORCE], 0.0)
                # dv/dt = R f - g e_z
                world = turned.apply(force) - [0.0, 0.0, GRAVITY_M_S2]
                world[~(valid & np.isfinite(value[SPECIFIC_FORCE]).all(axis=1))] = np.nan
                what = "d({})/dt and the accelerometer"
                pairs |= _paired(what, VELOCITY, speeding, world)
            else:
                axis = turned.apply([0.0, 0.0, 1.0])
                axis[~valid] = np.nan
                tilt = GRAVITY_M_S2 * axis[:, :2] / np.maximum(axis[:, 2:], _LEAST_UPRIGHT)
                pairs |= _paired("d({})/dt and the tilt", VELOCITY[:2], speeding, tilt)
    if has[POSITION] and has[VELOCITY]:
        moving = np.gradient(value[POSITION], _STEP_S, axis=0)
        pairs |= {
            f"d({p})/dt and {v}": (moving[:, k], value[VELOCITY][:, k])
            for k, (p, v) in enumerate(zip(POSITION, VELOCITY, strict=True))
        }
    return pairs


def _thrust_pair(grid: np.ndarray, frame: pd.DataFrame) -> Pairs:
    push = _push(grid, frame)
    if push is None or not all(n in frame for n in SPECIFIC_FORCE):
        return {}
    name, of_rotors = push
    along_thrust = _on(grid, frame, SPECIFIC_FORCE)[:, 2]
    return {f"acc_z_m_s2 and {name}": (along_thrust, of_rotors.sum(axis=1))}


def _push(grid: np.ndarray, frame: pd.DataFrame) -> tuple[str, np.ndarray] | None:
    """Give what goes with the thrust of every rotor: its name and values (t, n)."""
    # speeds first: thrust goes with their square, whatever the drive does
    if speeds := rotor_speeds_in(frame):
        return "squared rotor speeds", _on(grid, frame, speeds) ** 2
    if commands := commands_in(frame):
        return "commands", _on(grid, frame, commands)
    return None


def _turning(grid: np.ndarray, frame: pd.DataFrame) -> np.ndarray | None:
    """Give body rates (t, 3) as logged, or as the attitude turns."""
    if all(n in frame for n in BODY_RATE):
        return _on(grid, frame, BODY_RATE)
    if all(n in frame for n in QUATERNION):
        return _rates(*_attitude(_on(grid, frame, QUATERNION)), _FAST_STEP_S)
    return None


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


def _on(grid: np.ndarray, frame: pd.DataFrame, names: tuple[str, ...]) -> np.ndarray:
    """Interpolate columns (n, k) on the grid between their own samples; NaN in gaps."""
    t_s, out = frame["t_s"].to_numpy(dtype=float), np.full((len(grid), len(names)), np.nan)
    for k, name in enumerate(names):
        values = frame[name].to_numpy(dtype=float)
        finite = np.isfinite(values)
        t = t_s[finite]
        if len(t) > 1:
            after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
            # a line across a long gap would be no sample
            near = (t[after] - t[after - 1] < _LONGEST_GAP_S) & (grid >= t[0]) & (grid <= t[-1])
            out[:, k] = np.where(near, np.interp(grid, t, values[finite]), np.nan)
    return out


def _paired(what: str, names: tuple[str, ...], columns: np.ndarray, other: np.ndarray) -> Pairs:
    return {what.format(name): (columns[:, k], other[:, k]) for k, name in enumerate(names)}


def _smoothed(pairs: Pairs) -> Pairs:
    """Smooth both of each pair about their means; pairs without samples or motion are left out."""
    smoothed: Pairs = {}
    for what, (a, b) in pairs.items():
        both = np.isfinite(a) & np.isfinite(b)
        if both.sum() < _FEWEST:
            continue
        a, b = (_smooth(x, both, _SMOOTH_S / _STEP_S) for x in (a, b))
        if min(np.std(a), np.std(b)) >= _STILL:
            smoothed[what] = a, b
    return smoothed


def _smooth(values: np.ndarray, valid: np.ndarray, width: float) -> np.ndarray:
    """Smooth valid values (t,) or (t, n) over ``width`` samples, about their means."""
    steps = np.arange(len(values))
    # gaps are bridged for the filter alone; only what is there is compared
    whole = np.apply_along_axis(
        lambda column: np.interp(steps, steps[valid], column[valid]), 0, values
    )
    smooth = gaussian_filter1d(whole, width, axis=0)[valid]
    return smooth - smooth.mean(axis=0)
