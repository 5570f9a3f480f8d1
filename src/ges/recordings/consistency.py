"""Whether the streams of a log agree with one another on axes, signs and units: what a wrong frame
would break, measured.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from ges.conventions import (
    BODY_RATE,
    COMMAND,
    GRAVITY_M_S2,
    POSITION,
    QUATERNION,
    ROTOR_SPEED,
    SPECIFIC_FORCE,
    VELOCITY,
)

_STEP_S, _SMOOTH_S = 0.02, 0.15
_LONGEST_GAP_S = 0.5
_FEWEST = 100
_STILL = 1e-6


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How one quantity follows another that physics ties to it.

    Attributes
    ----------
    what : the two quantities, in words.
    correlation : 1 where they agree, -1 where a sign is wrong; 0 without motion.
    ratio : how many times as large the first is as the second (least squares).
    rms : of the second, in its unit: where nothing moves, nothing is said.
    """

    what: str
    correlation: float
    ratio: float
    rms: float


def agreements(frame: pd.DataFrame) -> list[Agreement]:
    """Pairs of quantities that must agree, smoothed over 0.15 s.

    Body rates against the turning of the attitude; velocity against the derivative of the
    position; acceleration of the velocity against the specific force turned into the world,
    dv/dt = R f - g e_z; specific force along the thrust axis against the squared rotor speeds (or
    the commands).

    Parameters
    ----------
    frame : contract columns.

    Returns
    -------
    list of Agreement, one a component; pairs that were not logged are left out.
    """
    t_s = frame["t_s"].to_numpy(dtype=float)
    if len(t_s) < 2:
        return []
    grid = np.arange(t_s[0], t_s[-1], _STEP_S)
    if len(grid) < _FEWEST:
        return []
    has = {
        names: all(n in frame for n in names)
        for names in (POSITION, VELOCITY, QUATERNION, BODY_RATE, SPECIFIC_FORCE)
    }
    value = {names: _on(grid, frame, names) for names, logged in has.items() if logged}
    found = []
    if has[QUATERNION]:
        q = value[QUATERNION]
        q = np.where(np.isfinite(q).all(axis=1)[:, None], q, [1.0, 0.0, 0.0, 0.0])
        turned = Rotation.from_quat(q, scalar_first=True)
        valid = np.isfinite(value[QUATERNION]).all(axis=1)
        if has[BODY_RATE]:
            # body rates: log(q_k* q_k+1) / dt
            step = (turned[:-1].inv() * turned[1:]).as_rotvec() / _STEP_S
            turning = np.vstack([step, step[-1:]])
            # a turn needs both of its attitudes
            turning[~(valid & np.r_[valid[1:], False])] = np.nan
            found += _pairs("{} and the turning of the attitude", BODY_RATE, value, turning)
        if has[VELOCITY] and has[SPECIFIC_FORCE]:
            force = np.where(np.isfinite(value[SPECIFIC_FORCE]), value[SPECIFIC_FORCE], 0.0)
            # dv/dt = R f - g e_z
            world = turned.apply(force) - [0.0, 0.0, GRAVITY_M_S2]
            world[~(valid & np.isfinite(value[SPECIFIC_FORCE]).all(axis=1))] = np.nan
            speeding = {VELOCITY: np.gradient(value[VELOCITY], _STEP_S, axis=0)}
            found += _pairs("d({})/dt and the accelerometer", VELOCITY, speeding, world)
    if has[POSITION] and has[VELOCITY]:
        moving = {POSITION: np.gradient(value[POSITION], _STEP_S, axis=0)}
        found += [
            pair
            for axis, p, v in zip(range(3), POSITION, VELOCITY, strict=True)
            for pair in _pair(
                f"d({p})/dt and {v}", moving[POSITION][:, axis], value[VELOCITY][:, axis]
            )
        ]
    if has[SPECIFIC_FORCE]:
        for names, power in ((ROTOR_SPEED, 2), (COMMAND, 1)):
            if all(n in frame for n in names):
                # speeds first: thrust goes with their square, whatever the drive does
                push = (_on(grid, frame, names) ** power).sum(axis=1)
                along = value[SPECIFIC_FORCE][:, 2]
                what = f"acc_z_m_s2 and {'squared rotor speeds' if power == 2 else 'commands'}"
                found += _pair(what, along, push)
                break
    return found


def _on(grid: np.ndarray, frame: pd.DataFrame, names: tuple[str, ...]) -> np.ndarray:
    """Columns (n, k) on the grid between their own samples, NaN in gaps."""
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


def _pairs(what: str, names: tuple[str, ...], value: dict, other: np.ndarray) -> list[Agreement]:
    return [
        pair
        for k, name in enumerate(names)
        for pair in _pair(what.format(name), value[names][:, k], other[:, k])
    ]


def _pair(what: str, a: np.ndarray, b: np.ndarray) -> list[Agreement]:
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < _FEWEST:
        return []
    a, b = (
        # gaps are bridged for the filter alone; only what both had is compared
        gaussian_filter1d(
            np.interp(np.arange(len(x)), np.flatnonzero(both), x[both]), _SMOOTH_S / _STEP_S
        )[both]
        for x in (a, b)
    )
    a, b = a - a.mean(), b - b.mean()
    if min(np.std(a), np.std(b)) < _STILL:
        return []
    return [
        Agreement(what, float(np.corrcoef(a, b)[0, 1]), float(a @ b / (b @ b)), float(np.std(b)))
    ]
