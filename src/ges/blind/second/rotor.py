"""Blade elements summed up numerically over radius and azimuth, with the inflow of a skewed wake.

Section forces are of a rigid, linearly twisted blade (Leishman 2006, ch. 3). Per unit of solidity
times lift slope s

    U_T = r + mu sin(psi),  U_P = lam_c + lam_i (1 + k_x r cos(psi)),

    dC_T = (theta U_T^2 - U_P U_T) / 2,

    dC_H = (c_d/a U_T^2 + theta U_T U_P - U_P^2) sin(psi) / 2.

The induced inflow is Glauert's (1926),

    lam_i = C_T / (2 sqrt(mu^2 + (lam_c + lam_i)^2)).

Its slope is k_x = tan(chi / 2) after Coleman, Feingold and Stempin 1945 (NACA WR L-126).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

DRAG_OVER_LIFT_SLOPE = 0.018 / 5.2
TWIST_RAD = -0.22
ROOT = 0.15
STATIONS, AZIMUTHS = 14, 24
OUTER, INNER = 30, 12
"""Iterations of thrust and of inflow; both halve their error, and more."""
EDGES = np.linspace(0.0, 0.36, 19)
CLIMBS = np.linspace(-0.08, 0.12, 21)
SHARES = np.linspace(0.35, 1.0, 27)


@dataclass(frozen=True)
class RotorTable:
    """Coefficients of a rotor by its speed through the air and by the ground.

    Attributes
    ----------
    thrust : thrust over that of hover at (:data:`EDGES`, :data:`CLIMBS`), speeds over tip speed.
    inplane : in-plane force coefficient at the same.
    near_ground : thrust over that of hover at :data:`SHARES`, the share of inflow that the ground
        leaves.
    """

    thrust: np.ndarray
    inplane: np.ndarray
    near_ground: np.ndarray


def _section() -> tuple[np.ndarray, np.ndarray, float]:
    edges = np.linspace(ROOT, 1.0, STATIONS + 1)
    r = 0.5 * (edges[1:] + edges[:-1])
    psi = 2.0 * np.pi * (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS
    return r[:, None], psi[None, :], float(edges[1] - edges[0])


def coefficients(
    s: float,
    theta: float,
    mu: np.ndarray | float,
    climb: np.ndarray | float,
    share: np.ndarray | float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return C_T and C_H of rotors in steady air, inflow and thrust in agreement.

    Parameters
    ----------
    s : solidity times lift slope.
    theta : pitch at three quarters of the radius (rad).
    mu, climb : (g,) edgewise and axial air speed over tip speed (climb positive).
    share : (g,) of the induced inflow that is left; less than one near the ground.

    Returns
    -------
    (g,) each.

    References
    ----------
    Leishman 2006, ch. 3; Glauert 1926; Coleman, Feingold and Stempin 1945, NACA WR L-126.
    """
    mu, climb, share = np.broadcast_arrays(
        *(np.atleast_1d(v).astype(float) for v in (mu, climb, share))
    )
    r, psi, width = _section()
    pitch = theta + TWIST_RAD * (r - 0.75)
    across = r + mu[:, None, None] * np.sin(psi)
    thrust = np.full(mu.shape, 0.01)
    for _ in range(OUTER):
        # Glauert's inflow of this thrust, then the thrust in that inflow, each damped by half
        lifting = np.maximum(thrust, 1e-6)
        induced = np.sqrt(lifting / 2.0)
        for _ in range(INNER):
            resultant = np.maximum(np.hypot(mu, climb + induced), 1e-4)
            induced = 0.5 * (induced + lifting / (2.0 * resultant))
        # a skewed wake blows harder through the rear of the disc
        chi = np.arctan2(mu, np.maximum(climb + induced, 1e-4))
        bias = np.tan(0.5 * chi)[:, None, None] * r * np.cos(psi)
        # near the ground only a share of the induced inflow is left
        down = climb[:, None, None] + (share * induced)[:, None, None] * (1.0 + bias)
        lift = np.mean(pitch * across**2 - down * across, axis=2).sum(axis=1)
        thrust = thrust + 0.5 * (0.5 * s * width * lift - thrust)
    drag = DRAG_OVER_LIFT_SLOPE * across**2 + pitch * across * down - down**2
    inplane = 0.5 * s * width * np.mean(drag * np.sin(psi), axis=2).sum(axis=1)
    return thrust, inplane


def pitch_of(s: float, thrust: float) -> float:
    """Return the pitch at which a hovering rotor has a thrust coefficient.

    Parameters
    ----------
    s : solidity times lift slope.
    thrust : thrust coefficient.

    Returns
    -------
    Pitch at three quarters of the radius (rad).
    """
    from scipy.optimize import brentq

    def error(theta: float) -> float:
        return float(coefficients(s, theta, 0.0, 0.0)[0][0]) - thrust

    return float(brentq(error, 0.0, 1.2, xtol=1e-5))


@functools.lru_cache(maxsize=256)
def table_of(s: float, thrust: float) -> RotorTable:
    """Return a rotor's table.

    Parameters
    ----------
    s : solidity times lift slope.
    thrust : thrust coefficient in hover.
    """
    theta = pitch_of(s, thrust)
    hover = coefficients(s, theta, 0.0, 0.0)[0][0]
    # one call for all points of the table, which the iteration takes abreast
    mu, climb = (grid.ravel() for grid in np.meshgrid(EDGES, CLIMBS, indexing="ij"))
    lift, inplane = (v.reshape(len(EDGES), -1) for v in coefficients(s, theta, mu, climb))
    near_ground = coefficients(s, theta, 0.0, 0.0, SHARES)[0]
    return RotorTable(lift / hover, inplane, near_ground / hover)


def look_up(table: np.ndarray, mu: np.ndarray, climb: np.ndarray) -> np.ndarray:
    """Interpolate tables bilinearly.

    Parameters
    ----------
    table : (F, edges, climbs), one a flight.
    mu, climb : edgewise and axial speed over tip speed; the last axis is F.

    Returns
    -------
    Values in the shape of ``mu``; beyond the edges those of the edges.
    """
    x = np.clip(mu / (EDGES[1] - EDGES[0]), 0.0, len(EDGES) - 1.001)
    y = np.clip((climb - CLIMBS[0]) / (CLIMBS[1] - CLIMBS[0]), 0.0, len(CLIMBS) - 1.001)
    i, j = x.astype(int), y.astype(int)
    a, b, f = x - i, y - j, np.arange(table.shape[0])
    low = table[f, i, j] * (1.0 - b) + table[f, i, j + 1] * b
    high = table[f, i + 1, j] * (1.0 - b) + table[f, i + 1, j + 1] * b
    return low * (1.0 - a) + high * a


def near_ground_thrust(table: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate the thrust over that of hover near the ground.

    Parameters
    ----------
    table : (F, shares), one a flight.
    share : of the inflow that the ground leaves; the last axis is F.
    """
    x = np.clip((share - SHARES[0]) / (SHARES[1] - SHARES[0]), 0.0, len(SHARES) - 1.001)
    i, f = x.astype(int), np.arange(table.shape[0])
    return table[f, i] * (1.0 - (x - i)) + table[f, i + 1] * (x - i)
