"""Battery and motors: RC battery, motor equation, current limit and filter of the ESC.

All is in units of the full voltage and the nominal top speed: x = w / w_max, d = duty cycle. The
torque balance is

    dx/dt = rate (d V/V_full - (1 - r) x - r x^2).

The first two terms of the bracket are the current, the last is the aerodynamic torque. At top speed
a share r of the full voltage falls over the winding.
"""

from __future__ import annotations

import numpy as np

DROOP = 0.15
NOMINAL = 0.92  # voltage over full at which a vehicle file states the top speed


def linear_duty(x: np.ndarray, droop: np.ndarray | float) -> np.ndarray:
    """Return the duty cycle at which the full battery holds a rotor speed.

    Parameters
    ----------
    x : (n_rotors, F) rotor speed over top speed.
    droop : share of the full voltage that falls over the winding at top speed.

    Returns
    -------
    (1 - r) x + r x^2: the map of a controller that is linear in speed.
    """
    return (1.0 - droop) * x + droop * x * x


def rate_of_lag(lag_s: np.ndarray, hover_x: np.ndarray, droop: np.ndarray | float) -> np.ndarray:
    """Return the rate of the motor equation for a time constant of small changes in hover.

    Parameters
    ----------
    lag_s : (F,) time constant.
    hover_x : (F,) speed in hover over top speed.
    droop : share of the full voltage that falls over the winding at top speed.

    Returns
    -------
    (F,) 1/s.
    """
    return 1.0 / (lag_s * ((1.0 - droop) + 2.0 * droop * hover_x))


def step_motor(
    x: np.ndarray,
    duty: np.ndarray,
    volt_ratio: np.ndarray | float,
    droop: np.ndarray | float,
    rate: np.ndarray,
    coast: np.ndarray | float,
    current_limit: float,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Advance rotor speeds by the motor equation of the module.

    The quadratic term is linearised over the step, so that the step is stable at any rate.

    Parameters
    ----------
    x, duty : (n_rotors, F) speed over top speed, and duty cycle.
    volt_ratio : voltage over its full value.
    droop : share of the full voltage that falls over the winding at top speed.
    rate : (F,) of the equation (1/s).
    coast : above 1 it slows deceleration, as without active braking.
    current_limit : of the current, in units of full voltage; half of it when braking.
    dt : step (s).

    Returns
    -------
    Speed and current, (n_rotors, F) each.
    """
    current = np.clip(duty * volt_ratio - (1.0 - droop) * x, -0.5 * current_limit, current_limit)
    # torque of the current less that of the air
    push = current - droop * x * x
    slope = (1.0 - droop) + 2.0 * droop * x
    pace = np.where(push < 0.0, rate / coast, rate)
    return x + dt * pace * push / (1.0 + 0.5 * dt * pace * slope), current


def open_circuit(charge: np.ndarray) -> np.ndarray:
    """Return a lithium polymer cell's voltage at rest over its full voltage.

    Parameters
    ----------
    charge : (F,) state of charge, 0 to 1.
    """
    return 0.86 + 0.14 * charge - 0.12 * np.exp(-18.0 * np.maximum(charge, 0.0))


def step_battery(
    charge: np.ndarray,
    polar: np.ndarray,
    current: np.ndarray,
    resistance: np.ndarray,
    polar_resistance: np.ndarray,
    drain: np.ndarray,
    dt: float,
    polar_time: float = 6.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance charge and polarisation of a battery; voltages are over the full one.

    Parameters
    ----------
    charge : (F,) state of charge, 0 to 1.
    polar : (F,) voltage of the polarisation.
    current : (F,) over that of hover.
    resistance, polar_resistance : (F,) voltage per current of hover.
    drain : (F,) charge per second at the current of hover.
    dt, polar_time : step, and time constant of the polarisation (s).

    Returns
    -------
    Charge, polarisation and terminal voltage, (F,) each.
    """
    charge = charge - dt * drain * current
    polar = polar + dt / polar_time * (polar_resistance * current - polar)
    return charge, polar, open_circuit(charge) - resistance * current - polar
