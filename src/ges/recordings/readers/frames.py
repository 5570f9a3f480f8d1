"""Conversion of frames and angles.

Aviation's frames, world NED and body FRD, become world ENU and body FLU. Euler angles become
quaternions.
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
    """Turn a world vector from NED to ENU.

    Parameters
    ----------
    north, east, down : (n,) components.

    Returns
    -------
    x east, y north, z up, each (n,).
    """
    return east, north, -down


def yaw_from_heading(heading: np.ndarray) -> np.ndarray:
    """Turn a heading into a yaw.

    Parameters
    ----------
    heading : (n,) rad, from north to east.

    Returns
    -------
    Yaw (n,), rad from east to north, from -pi to pi.
    """
    return (np.pi / 2 - heading + np.pi) % (2 * np.pi) - np.pi


def attitude_from_ned(q: np.ndarray) -> np.ndarray:
    """Turn an attitude of FRD axes in NED into that of FLU axes in ENU.

    Parameters
    ----------
    q : (4, n) quaternions, Hamilton, body to world, scalar first.

    Returns
    -------
    q_enu_from_ned q q_frd_from_flu, (4, n), continuous in sign. That is (0, h, h, 0) q (0, 1, 0, 0)
    with h = sqrt(1/2).
    """
    w, x, y, z = q
    h = np.sqrt(0.5)
    return one_sign(np.stack([h * (w + z), h * (x + y), h * (x - y), h * (w - z)]))


def one_sign(q: np.ndarray) -> np.ndarray:
    """Normalise quaternions, and choose signs so that neighbours are alike.

    Parameters
    ----------
    q : (4, n) quaternions of any length.

    Returns
    -------
    Quaternions (4, n) of length one; NaN where the length is zero or not finite.
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
    """Convert yaw-pitch-roll (z-y-x) angles to quaternions.

    Parameters
    ----------
    roll, pitch, yaw : (n,) rad.

    Returns
    -------
    Quaternions (4, n), Hamilton, body to world, scalar first.
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
    """Turn a body vector from FRD to FLU.

    Parameters
    ----------
    vector : three components, each (n,).

    Returns
    -------
    Forward, left, up, each (n,).
    """
    return [sign * v for sign, v in zip(FLU_FROM_FRD, vector, strict=True)]


def named(names: tuple[str, ...], values: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    """Name the components of a vector or quaternion as columns.

    Parameters
    ----------
    names : names of the columns.
    values : as many components, each (n,).

    Returns
    -------
    Components by name.
    """
    return dict(zip(names, values, strict=True))


def with_quaternion(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Replace roll, pitch and yaw by the quaternion; incomplete angles stay as they are.

    Parameters
    ----------
    columns : (n,) by name; angles ``roll_rad``, ``pitch_rad``, ``yaw_rad``.

    Returns
    -------
    The columns with the quaternion, body to world, in the axes of the angles.
    """
    out = dict(columns)
    if all(name in out for name in EULER):
        out |= named(QUATERNION, quaternion(*(out.pop(name) for name in EULER)))
    return out


def with_world_velocity(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Turn a velocity along the body's axes into the world: v = R(q) v_body.

    Parameters
    ----------
    columns : (n,) by name; with ``v_body_x_m_s``, ``v_body_y_m_s``, ``v_body_z_m_s`` and the
        quaternion.

    Returns
    -------
    The columns with ``v_x_m_s``, ``v_y_m_s``, ``v_z_m_s`` in place of those of the body.
    """
    out = dict(columns)
    body = np.stack([out.pop(name) for name in BODY_VELOCITY])
    turned = np.einsum("ijn,jn->in", rotation(np.stack([out[name] for name in QUATERNION])), body)
    return out | named(VELOCITY, turned)


def rotation(q: np.ndarray) -> np.ndarray:
    """Convert quaternions to rotation matrices.

    Parameters
    ----------
    q : (4, n) of length one, body to world.

    Returns
    -------
    Matrices (3, 3, n), body to world.
    """
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def with_specific_force(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Replace a world acceleration without gravity by the specific force: f = R(q)^T (a + g e_z).

    Parameters
    ----------
    columns : (n,) by name; ``acc_world_x_m_s2`` ... in ENU, quaternion to ENU.

    Returns
    -------
    The columns with ``acc_x_m_s2`` ...; unchanged where attitude or acceleration are incomplete, or
    where there is a specific force.
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
