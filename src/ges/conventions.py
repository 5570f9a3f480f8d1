"""Frames, units and the names that cross every border.

World is ENU (z up), body is FLU (x forward, y left, z along thrust). Quaternions are Hamilton,
body-to-world, scalar first. Everything is SI and radians; a name carries its unit.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Collection

GRAVITY_M_S2 = 9.80665
FAR_FROM_GROUND_M = 5e4
FEWEST_ROTORS, MAX_ROTORS = 3, 16
MOST_NUMBERS = 2**27
"""Of one flight, read or simulated: an hour at 1 kHz of 37 columns, a gigabyte."""

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
REFERENCE = (*POSITION_REF, *VELOCITY_REF, "yaw_ref_rad")
EXCITATION = (*(f"excite_{a}_rad_s2" for a in AXES), "excite_up_m_s2")


@functools.cache
def rotor_columns(template: str, n_rotors: int) -> tuple[str, ...]:
    """Name one quantity of every rotor.

    Parameters
    ----------
    template : name with ``{}`` where the number of the rotor stands.
    n_rotors : number of rotors.

    Returns
    -------
    Names of rotors 1 to ``n_rotors``, in this order.

    Examples
    --------
    >>> rotor_columns("rotor_speed_{}_rad_s", 2)
    ('rotor_speed_1_rad_s', 'rotor_speed_2_rad_s')
    """
    return tuple(template.format(i + 1) for i in range(n_rotors))


def rotor_speed(n_rotors: int) -> tuple[str, ...]:
    """Name the columns of rotor speeds in rad/s.

    Examples
    --------
    >>> rotor_speed(2)
    ('rotor_speed_1_rad_s', 'rotor_speed_2_rad_s')
    """
    return rotor_columns("rotor_speed_{}_rad_s", n_rotors)


def command(n_rotors: int) -> tuple[str, ...]:
    """Name the columns of motor commands, each from 0 to 1.

    Examples
    --------
    >>> command(2)
    ('u_1', 'u_2')
    """
    return rotor_columns("u_{}", n_rotors)


def motor_current(n_rotors: int) -> tuple[str, ...]:
    """Name the columns of motor currents in A.

    Examples
    --------
    >>> motor_current(2)
    ('motor_current_1_A', 'motor_current_2_A')
    """
    return rotor_columns("motor_current_{}_A", n_rotors)


def _in(names: Collection[str], template: str) -> tuple[str, ...]:
    missing = next(i for i in itertools.count() if template.format(i + 1) not in names)
    return rotor_columns(template, missing)


def rotor_speeds_in(names: Collection[str]) -> tuple[str, ...]:
    """Select the columns of rotor speeds, without a gap from rotor 1 on.

    Examples
    --------
    >>> rotor_speeds_in({"t_s", "rotor_speed_1_rad_s", "rotor_speed_3_rad_s"})
    ('rotor_speed_1_rad_s',)
    """
    return _in(names, "rotor_speed_{}_rad_s")


def commands_in(names: Collection[str]) -> tuple[str, ...]:
    """Select the columns of motor commands, without a gap from rotor 1 on.

    Examples
    --------
    >>> commands_in({"t_s", "u_1", "u_2", "u_4"})
    ('u_1', 'u_2')
    """
    return _in(names, "u_{}")


def rotors_in(names: Collection[str]) -> int:
    """Count the rotors that have a speed, a command or a current among the columns.

    Returns
    -------
    Number of rotors, counted without a gap from rotor 1 on; 0 where there is none.

    Examples
    --------
    >>> rotors_in({"t_s", "u_1", "u_2", "rotor_speed_1_rad_s"})
    2
    """
    currents = _in(names, "motor_current_{}_A")
    return max(map(len, (rotor_speeds_in(names), commands_in(names), currents)))
