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
    """Advance a weight on a cord that its own weight stretches by an eighth; it can lie on the
    ground. Return (force on the vehicle, place, velocity).
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
    """Return the world force of a hose from the origin, lifted in a straight line: its weight hangs
    on both ends, its tension pulls towards the foot.
    """
    height, aside = np.maximum(p[2], 0.0), np.hypot(p[0], p[1])
    lifted = np.hypot(height, aside)
    level = 0.25 * weight_N_m * lifted * aside / np.maximum(lifted, 1e-6)
    towards = -level / np.maximum(aside, 1e-6)
    return np.stack([towards * p[0], towards * p[1], -0.9 * weight_N_m * height])


def side_force(
    omega: np.ndarray, v_body: np.ndarray, share_s: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Return a body force across speed and turning, as a spinning cylinder has it (Magnus)."""
    return share_s * weight * np.cross(omega, v_body, axis=0)


def rubbing(v: np.ndarray, share: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return a world force against the motion that hardly knows how fast it is: a dragged cable."""
    speed = np.sqrt((v**2).sum(axis=0) + 0.03**2)
    return -share * weight * v / speed * np.array([[1.0], [1.0], [0.0]])


def step_slosh(
    s: np.ndarray, s_v: np.ndarray, felt: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance liquid (2, F) that swings level in a tank, by specific force; return its place,
    velocity and acceleration back on the tank over its mass share.
    """
    n = 2.0 * np.pi * SLOSH_HZ
    back = -n * n * s - 0.12 * n * s_v
    s_v = s_v + dt * (back - felt)
    return s + dt * s_v, s_v, -back
