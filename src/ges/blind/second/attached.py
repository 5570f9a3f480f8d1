"""A weight on an elastic cord, a hose that is lifted off the ground, and what is in no library."""

from __future__ import annotations

import numpy as np

G_M_S2 = 9.80665
STRETCH = 0.12
SLOSH_HZ = 1.1


def step_cord(
    load: np.ndarray,
    load_v: np.ndarray,
    p: np.ndarray,
    v: np.ndarray,
    mass: np.ndarray,
    length: np.ndarray,
    dt: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance a weight on an elastic cord.

    Its own weight stretches the cord by :data:`STRETCH`. It can lie on the ground, where it slides
    with friction.

    Parameters
    ----------
    load, load_v : (3, F) place (m) and velocity (m/s) of the weight, world frame.
    p, v : (3, F) of the vehicle.
    mass : (F,) of the weight (kg).
    length : (F,) of the cord (m).
    dt : step (s).

    Returns
    -------
    Force on the vehicle (N, world frame), place and velocity of the weight, (3, F) each.
    """
    away = load - p
    reach = np.maximum(np.sqrt((away**2).sum(axis=0)), 1e-6)
    line = away / reach
    stiff = mass * G_M_S2 / (STRETCH * length)
    loss = 0.25 * np.sqrt(stiff * np.maximum(mass, 1e-9))
    opening = ((load_v - v) * line).sum(axis=0)
    pull = np.maximum(stiff * (reach - length) + loss * opening, 0.0) * (reach > length)
    heavy = np.maximum(mass, 1e-9)
    load_v = load_v + dt * (-pull * line / heavy - 0.25 * load_v)
    load_v[2] -= dt * G_M_S2
    load = load + dt * load_v
    # what lies on the ground slides with friction
    down = load[2] < 0.0
    load[2] = np.where(down, 0.0, load[2])
    load_v = np.where(down, load_v * np.array([[0.97], [0.97], [0.0]]), load_v)
    return pull * line, load, load_v


def hose(p: np.ndarray, weight_N_m: np.ndarray) -> np.ndarray:
    """Return the force of a hose from the origin that is lifted in a straight line.

    Its weight hangs on both ends, and its tension pulls towards the foot.

    Parameters
    ----------
    p : (3, F) place of the vehicle (m).
    weight_N_m : (F,) weight of the hose per metre.

    Returns
    -------
    (3, F) N, world frame.
    """
    height, aside = np.maximum(p[2], 0.0), np.hypot(p[0], p[1])
    lifted = np.hypot(height, aside)
    level = 0.25 * weight_N_m * lifted * aside / np.maximum(lifted, 1e-6)
    towards = -level / np.maximum(aside, 1e-6)
    return np.stack([towards * p[0], towards * p[1], -0.9 * weight_N_m * height])


def side_force(
    omega: np.ndarray, v_body: np.ndarray, share_s: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Return a force across speed and rotation, as a spinning cylinder has it (Magnus).

    Parameters
    ----------
    omega : (3, F) body rates (rad/s).
    v_body : (3, F) velocity, body frame (m/s).
    share_s : (F,) force over weight per unit of omega x v.
    weight : (F,) N.

    Returns
    -------
    (3, F) N, body frame.
    """
    return share_s * weight * np.cross(omega, v_body, axis=0)


def rubbing(v: np.ndarray, share: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the friction of a dragged cable, which hardly depends on the speed.

    Parameters
    ----------
    v : (3, F) velocity, world frame (m/s).
    share : (F,) force over weight.
    weight : (F,) N.

    Returns
    -------
    (3, F) N, world frame, level.
    """
    speed = np.sqrt((v**2).sum(axis=0) + 0.03**2)
    return -share * weight * v / speed * np.array([[1.0], [1.0], [0.0]])


def step_slosh(
    s: np.ndarray, s_v: np.ndarray, felt: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance liquid that swings in a tank at :data:`SLOSH_HZ`.

    Parameters
    ----------
    s, s_v : (2, F) place (m) and velocity (m/s) along body x and y.
    felt : (2, F) specific force that drives it (m/s^2).
    dt : step (s).

    Returns
    -------
    Place, velocity, and the acceleration back on the tank over the liquid's share of the mass.
    """
    n = 2.0 * np.pi * SLOSH_HZ
    back = -n * n * s - 0.12 * n * s_v
    s_v = s_v + dt * (back - felt)
    return s + dt * s_v, s_v, -back
