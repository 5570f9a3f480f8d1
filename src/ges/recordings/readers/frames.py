"""Frames: north-east-down with forward-right-down (aviation) to east-north-up with
forward-left-up, and angles to quaternions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ges.conventions import GRAVITY_M_S2, QUATERNION, SPECIFIC_FORCE, VELOCITY

FLU_FROM_FRD = (1.0, -1.0, -1.0)
BODY_VELOCITY = tuple(f"v_body_{a}_m_s" for a in "xyz")
EULER = ("roll_rad", "pitch_rad", "yaw_rad")
WORLD_ACCELERATION = ("acc_world_x_m_s2", "acc_world_y_m_s2", "acc_world_z_m_s2")


def enu_from_ned(north: np.ndarray, east: np.ndarray, down: np.ndarray) -> tuple[np.ndarray, ...]:
    """A world vector: x east, y north, z up."""
    return east, north, -down


def yaw_from_heading(heading: np.ndarray) -> np.ndarray:
    """Yaw (rad, from east to north, within pi) of a heading (rad, from north to east)."""
    return (np.pi / 2 - heading + np.pi) % (2 * np.pi) - np.pi


def attitude_from_ned(q: np.ndarray) -> np.ndarray:
    """Quaternion (4, n), Hamilton and scalar first, of NED/FRD as that of ENU/FLU:
    q_enu_from_ned q q_frd_from_flu, which is (0, h, h, 0) q (0, 1, 0, 0) with h = sqrt(1/2), sign
    dropped.
    """
    w, x, y, z = q
    h = np.sqrt(0.5)
    return one_sign(np.stack([h * (w + z), h * (x + y), h * (x - y), h * (w - z)]))


def one_sign(q: np.ndarray) -> np.ndarray:
    """Quaternions (4, n) of length one, each on the side of the one before; NaN where the length
    is zero or not finite.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        q = q / np.linalg.norm(q, axis=0)
    q = np.where(np.isfinite(q).all(axis=0), q, np.nan)
    good = np.flatnonzero(np.isfinite(q[0]))
    # q and -q are one attitude: where neighbours oppose each other, all that follow change sign
    flips = np.where(np.sum(q[:, good[1:]] * q[:, good[:-1]], axis=0) < 0, -1.0, 1.0)
    q[:, good[1:]] *= np.cumprod(flips)
    return q


def quaternion(roll: np.ndarray, pitch: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Hamilton quaternion body-to-world of shape (4, n) from yaw-pitch-roll (z-y-x) angles in
    radians.
    """
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    return np.stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )


def flu_from_frd(vector: Iterable[np.ndarray]) -> list[np.ndarray]:
    """A body vector, forward-right-down turned forward-left-up."""
    return [sign * v for sign, v in zip(FLU_FROM_FRD, vector, strict=True)]


def named(names: tuple[str, ...], values: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of a vector or quaternion, one a component."""
    return dict(zip(names, values, strict=True))


def with_quaternion(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Add the quaternion where roll, pitch and yaw are all there; incomplete angles stay as they
    are.
    """
    out = dict(columns)
    if all(name in out for name in EULER):
        out |= named(QUATERNION, quaternion(*(out.pop(name) for name in EULER)))
    return out


def with_world_velocity(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Turn a velocity along the body's axes into the world: v = R(q) v_body."""
    out = dict(columns)
    body = np.stack([out.pop(name) for name in BODY_VELOCITY])
    turned = np.einsum("ijn,jn->in", rotation(np.stack([out[name] for name in QUATERNION])), body)
    return out | named(VELOCITY, turned)


def rotation(q: np.ndarray) -> np.ndarray:
    """Rotation matrices (3, 3, n) body-to-world of quaternions (4, n) of length one."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def with_specific_force(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Turn a world acceleration without gravity into the body's specific force where the whole
    attitude was logged: f = R(q)^T (a + g e_z).
    """
    out = dict(columns)
    if all(name in out for name in (*QUATERNION, *WORLD_ACCELERATION)) and not any(
        name in out for name in SPECIFIC_FORCE
    ):
        world = [out.pop(name) for name in WORLD_ACCELERATION]
        # at rest an accelerometer feels +g; R' by swapped indices
        world[2] = world[2] + GRAVITY_M_S2
        to_world = rotation(np.stack([out[name] for name in QUATERNION]))
        out |= named(SPECIFIC_FORCE, np.einsum("jin,jn->in", to_world, np.stack(world)))
    return out
