"""Scaling laws for numbers that no log states, with the spread of published vehicles as sd.

Every law is checked against the library in ``tests/vehicle/test_scaling.py``.
"""

from __future__ import annotations

import numpy as np

from ges.vehicle.file import Inertia, Quantity

# Inertia over mass and squared arm (mean squared distance of the hubs from the centre), about x or
# y and about z, of eight published models: Crazyflie 2.1 0.25 to 0.33 and 0.44 to 0.51, its
# brushless sister 0.23 and 0.45, Hummingbird 0.25 and 0.49, Gazebo's x500 0.19 and 0.35, its iris
# 0.32 and 0.60, PX4 SIH 0.31 and 0.38.
ABOUT_X_Y, ABOUT_Z = 0.26, 0.44
INERTIA_SD_REL = 0.25
# Reaction torque over thrust and diameter: Hummingbird 0.12, Crazyflie 2.1 0.15, its brushless
# sister 0.11 (drone-models), Gazebo's x500 0.06.
TORQUE = 0.1
TORQUE_SD_REL = 0.35
# Distance of neighbouring hubs over the diameter: Crazyflie 1.41, Hummingbird 1.2, x500 1.37,
# appius 1.46, a 220 mm racer with 5 in 1.23.
SPACING = 1.35
SPACING_SD_REL = 0.1
# Time constant of motor, controller and propeller: 0.02 to 0.04 s at 5 in, 0.03 to 0.06 s at 10 in,
# 0.05 to 0.1 s at 13 in (judgement, no published table). The small brushed motors of a Crazyflie
# take 0.04 to 0.07 s (fast telemetry of IMRCLab's flights; RotorPy).
LAG_S, LAG_DIAMETER_M, LAG_EXPONENT = 0.03, 0.127, 0.7
BRUSHED_LAG_S = 0.055
LAG_SD_REL = 0.4


def inertia(mass_kg: float, arm_m: float) -> Inertia:
    """Estimate the moments of inertia of a multirotor.

    Parameters
    ----------
    mass_kg : mass.
    arm_m : root mean square distance of the hubs from the centre, see :func:`arm_m`.

    Returns
    -------
    0.26, 0.26 and 0.44 m L^2 about x, y and z, to 25 %: the spread of eight published vehicles.
    """
    about_x_y = ABOUT_X_Y * mass_kg * arm_m**2
    about_z = ABOUT_Z * mass_kg * arm_m**2
    return Inertia(xx=about_x_y, yy=about_x_y, zz=about_z, sd_rel=INERTIA_SD_REL)


def torque_coefficient(thrust_coefficient_N_s2: float, diameter_m: float) -> Quantity:
    """Estimate the torque coefficient of a rotor.

    Parameters
    ----------
    thrust_coefficient_N_s2 : k in T = k w^2.
    diameter_m : of the propeller.

    Returns
    -------
    Reaction torque over squared rotor speed, 0.1 k D in N m s^2, to 35 %.
    """
    value = TORQUE * diameter_m * thrust_coefficient_N_s2
    return Quantity(value=value, sd=TORQUE_SD_REL * value)


def motor_time_constant(diameter_m: float, brushed: bool = False) -> Quantity:
    """Estimate the first-order time constant of motor, controller and propeller.

    Parameters
    ----------
    diameter_m : of the propeller.
    brushed : whether it is a small brushed motor, as a Crazyflie's.

    Returns
    -------
    0.03 s (D / 0.127 m)^0.7, or 0.055 s if brushed, to 40 %.
    """
    value = BRUSHED_LAG_S if brushed else LAG_S * (diameter_m / LAG_DIAMETER_M) ** LAG_EXPONENT
    return Quantity(value=value, sd=LAG_SD_REL * value)


def arm_m(x_m: np.ndarray, y_m: np.ndarray) -> float:
    """Compute the root mean square distance of the hubs from the centre, in the rotor plane.

    Parameters
    ----------
    x_m, y_m : (n_rotors,) hubs in the body frame.

    Returns
    -------
    Distance, m.
    """
    return float(np.sqrt(np.mean(np.square(x_m) + np.square(y_m))))


def radius_m(hubs_m: np.ndarray) -> float:
    """Estimate the rotor radius from the distance of neighbouring hubs.

    Parameters
    ----------
    hubs_m : (n, 3) hubs in the body frame.

    Returns
    -------
    Half of the least horizontal distance over 1.35, m; NaN where all hubs are in one place.
    """
    # the two nearest hubs limit the propellers
    gaps = np.linalg.norm(hubs_m[:, None, :2] - hubs_m[None, :, :2], axis=2)
    return 0.5 * float(gaps[gaps > 0].min()) / SPACING if np.any(gaps > 0) else float("nan")
