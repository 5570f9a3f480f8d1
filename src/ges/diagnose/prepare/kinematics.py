"""Attitudes and body rates; Hamilton quaternions, body to world, scalar first."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings


def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the Hamilton product.

    Parameters
    ----------
    a, b : (n, 4).

    Returns
    -------
    (n, 4).
    """
    w1, x1, y1, z1 = a.T
    w2, x2, y2, z2 = b.T
    return np.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        axis=1,
    )


def to_body(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rotate world vectors into the body frame.

    Parameters
    ----------
    q : (n, 4) attitudes.
    v : (n, 3), world.

    Returns
    -------
    (n, 3), body.
    """
    # v + 2 w (u x v) + 2 u x (u x v), with the conjugate: from the world to the body
    u, w = -q[:, 1:], q[:, :1]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def turn_rates(q: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the body rates of a changing attitude.

    Parameters
    ----------
    q : (n, 4) attitudes.
    rate : (n, 4) time derivative of ``q``, 1/s.

    Returns
    -------
    (n, 3) rad/s, body.
    """
    # omega = 2 q* dq/dt, of which the scalar part is zero for unit quaternions
    conjugate = q * np.array([1.0, -1.0, -1.0, -1.0])
    return 2.0 * quaternion_product(conjugate, rate)[:, 1:]


def body_rates(flight: Prepared) -> np.ndarray:
    """Return the gyro where logged, else rates from the attitude, else zero.

    Parameters
    ----------
    flight : prepared recording.

    Returns
    -------
    (n, 3) rad/s, body.
    """
    if flight.has("gyro"):
        return flight.stack("gyro")
    if not flight.has("attitude"):
        return np.zeros((len(flight.t_s), 3))
    q = flight.stack("attitude")
    width = settings.prepare.rate_smoothing_s / flight.dt_s
    # smoothed first: a difference of raw attitudes turns their noise into rates
    rate = np.gradient(gaussian_filter1d(q, width, axis=0), flight.dt_s, axis=0)
    return turn_rates(q, rate)
