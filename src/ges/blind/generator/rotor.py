"""Blade-element rotor in momentum inflow: untwisted blade, uniform dynamic inflow.

Symbols: s = solidity times lift slope, theta = blade pitch, mu = edgewise speed over tip speed, lam
= total inflow over tip speed. Per unit s (Leishman 2006, ch. 3 and 5; Fay 2001, Mesicopter)

    C_T / s = theta (1/6 + mu^2/4) - lam/4,

    C_H / s = mu c_d/(4 a) + lam mu theta/4.
"""

from __future__ import annotations

import numpy as np

PROFILE_DRAG_OVER_LIFT_SLOPE = 0.02 / 5.0


def blade_pitch(thrust_coefficient: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Return the pitch at which a hovering rotor has a thrust coefficient.

    Parameters
    ----------
    thrust_coefficient : (F,) C_T; the inflow ratio is sqrt(C_T / 2).
    s : (F,) solidity times lift slope.

    Returns
    -------
    (F,) rad.
    """
    lam = np.sqrt(thrust_coefficient / 2.0)
    return 6.0 * (thrust_coefficient / s + lam / 4.0)


def thrust_coefficient(
    theta: np.ndarray, s: np.ndarray, lam: np.ndarray, mu: np.ndarray | float
) -> np.ndarray:
    """Return C_T of an untwisted blade in uniform inflow, s (theta (1/6 + mu^2 / 4) - lam / 4).

    Parameters
    ----------
    theta : (F,) blade pitch (rad).
    s : (F,) solidity times lift slope.
    lam, mu : (n_rotors, F) total inflow and edgewise speed over tip speed.

    References
    ----------
    Leishman 2006, ch. 3 and 5.
    """
    return s * (theta * (1.0 / 6.0 + 0.25 * mu * mu) - 0.25 * lam)


def inplane_coefficient(
    theta: np.ndarray, s: np.ndarray, lam: np.ndarray, mu: np.ndarray | float
) -> np.ndarray:
    """Return C_H, the in-plane force against the edgewise air.

    The disc tilts back with the first harmonic of flapping, and takes the thrust with it.

    Parameters
    ----------
    theta : (F,) blade pitch (rad).
    s : (F,) solidity times lift slope.
    lam, mu : (n_rotors, F) total inflow and edgewise speed over tip speed.

    References
    ----------
    Leishman 2006, ch. 3 and 5; Fay 2001, Mesicopter.
    """
    hub = s * mu * (0.25 * PROFILE_DRAG_OVER_LIFT_SLOPE + 0.25 * lam * theta)
    # the disc tilts back with the first-harmonic flapping, and takes the thrust with it
    flap = (8.0 / 3.0 * theta - 2.0 * lam) * mu / (1.0 - 0.5 * mu * mu)
    return hub + flap * thrust_coefficient(theta, s, lam, mu)


def step_inflow(
    v_i: np.ndarray,
    thrust: np.ndarray,
    edge: np.ndarray,
    axial: np.ndarray,
    radius: np.ndarray,
    rho: float,
    dt: float,
) -> np.ndarray:
    """Advance the induced velocity of rotors, implicit in it.

    Parameters
    ----------
    v_i : (n_rotors, F) induced velocity (m/s).
    thrust : (n_rotors, F) N.
    edge, axial : (n_rotors, F) edgewise and axial speed of the air (m/s), axial positive in climb.
    radius : (F,) of the rotors (m).
    rho : density of the air (kg/m^3).
    dt : step (s).

    Returns
    -------
    (n_rotors, F) m/s by (8/3) rho R^3 dv/dt + 2 rho A U v = T, U the resultant speed through the
    disc.

    References
    ----------
    Apparent mass after Pitt and Peters 1981.
    """
    apparent = 8.0 / 3.0 * rho * radius**3
    axial_flow = axial + v_i
    resultant = np.sqrt(edge * edge + axial_flow * axial_flow)
    flow = 2.0 * rho * np.pi * radius * radius * resultant
    return (v_i + dt * np.maximum(thrust, 0.0) / apparent) / (1.0 + dt * flow / apparent)


def heave_damping_1_s(
    s: np.ndarray,
    ct: np.ndarray,
    radius: np.ndarray,
    tip_speed: np.ndarray,
    mass: np.ndarray,
    rho: float,
    rotors: int = 4,
) -> np.ndarray:
    """Return Z_w of the hovering vehicle, to check pitch and inflow against.

    Parameters
    ----------
    s : (F,) solidity times lift slope.
    ct : (F,) thrust coefficient in hover.
    radius : (F,) of the rotors (m).
    tip_speed : (F,) in hover (m/s).
    mass : (F,) of the vehicle (kg).
    rho : density of the air (kg/m^3).
    rotors : their number.

    Returns
    -------
    (F,) vertical deceleration over vertical speed (1/s).

    References
    ----------
    Bramwell 1976; Padfield 2007.
    """
    lam = np.sqrt(ct / 2.0)
    area = np.pi * radius**2
    return rotors * rho * area * tip_speed * 2.0 * s * lam / ((16.0 * lam + s) * mass)
