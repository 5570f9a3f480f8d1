"""Frames, units and the names that cross every border.

World is ENU (z up), body is FLU (x forward, y left, z along thrust). Quaternions are Hamilton,
body-to-world, scalar first. Everything is SI and radians; a name carries its unit.
"""

from __future__ import annotations

GRAVITY_M_S2 = 9.80665
N_ROTORS = 4
FAR_FROM_GROUND_M = 5e4

Dimension = tuple[int, ...]
"""Exponents of kg, m and s."""
NUMBER, LENGTH, SPEED = (0, 0, 0), (0, 1, 0), (0, 1, -1)
FORCE, MOMENT = (1, 1, -2), (1, 2, -2)

# of a Gaussian: half of a 95 % interval in sds, its quantiles, and the sd over the median deviation
SDS_95 = 1.96
QUANTILES_95 = (0.025, 0.975)
MAD_TO_SD = 1.4826

AXES = ("x", "y", "z")
POSITION = tuple(f"p_{a}_m" for a in AXES)
VELOCITY = tuple(f"v_{a}_m_s" for a in AXES)
QUATERNION = ("q_w", "q_x", "q_y", "q_z")
BODY_RATE = tuple(f"omega_{a}_rad_s" for a in AXES)
SPECIFIC_FORCE = tuple(f"acc_{a}_m_s2" for a in AXES)
POSITION_REF = tuple(f"p_ref_{a}_m" for a in AXES)
VELOCITY_REF = tuple(f"v_ref_{a}_m_s" for a in AXES)


def rotor_columns(template: str, n_rotors: int = N_ROTORS) -> tuple[str, ...]:
    """Names of one quantity for every rotor, e.g. ``rotor_columns("rotor_speed_{}_rad_s")``."""
    return tuple(template.format(i + 1) for i in range(n_rotors))


ROTOR_SPEED = rotor_columns("rotor_speed_{}_rad_s")
COMMAND = rotor_columns("u_{}")
MOTOR_CURRENT = rotor_columns("motor_current_{}_A")
