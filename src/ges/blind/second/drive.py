"""Battery of two relaxations, motors of second order, commands that are held for a frame."""

from __future__ import annotations

import numpy as np

DAMPING = 1.1
NOMINAL = 0.93
RELAX_S = (2.5, 45.0)
# thrust over voltage of a Crazyflie's motor by its firmware, without the constant, over that at 3 V
FIRMWARE = np.array([0.06524 * 3.0, -0.02679 * 9.0, 0.006777 * 27.0])


def open_circuit(charge: np.ndarray) -> np.ndarray:
    """Return a lithium cell's voltage at rest over 4.1 V.

    Parameters
    ----------
    charge : (F,) state of charge, 0 to 1.

    References
    ----------
    Chen and Rincon-Mora 2006, IEEE Transactions on Energy Conversion 21.
    """
    z = np.clip(charge, 0.0, 1.0)
    volt = -1.031 * np.exp(-35.0 * z) + 3.685 + 0.2156 * z - 0.1178 * z**2 + 0.3201 * z**3
    return volt / 4.1


def step_battery(
    charge: np.ndarray,
    relax: np.ndarray,
    current: np.ndarray,
    resistance: np.ndarray,
    drain: np.ndarray,
    dt: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Advance charge and both relaxation voltages of a battery; voltages are over the full one.

    A third of the resistance acts at once, and a third with each time constant of :data:`RELAX_S`.

    Parameters
    ----------
    charge : (F,) state of charge, 0 to 1.
    relax : (2, F) relaxation voltages.
    current : (F,) over that of hover.
    resistance : (F,) voltage per current of hover.
    drain : (F,) charge per second at the current of hover.
    dt : step (s).

    Returns
    -------
    Charge (F,), relaxation voltages (2, F) and terminal voltage (F,).
    """
    charge = charge - dt * drain * current
    pull = resistance / 3.0 * current
    relax = np.stack([r + dt / time * (pull - r) for r, time in zip(relax, RELAX_S, strict=True)])
    return charge, relax, open_circuit(charge) - pull - relax.sum(axis=0)


def speed_of_voltage(volt: np.ndarray, sags: np.ndarray) -> np.ndarray:
    """Return the factor on rotor speed of a voltage.

    Parameters
    ----------
    volt : (F,) voltage over the full one.
    sags : (F,) 0 where speed does not depend on voltage, 1 for the whole dependence.

    Notes
    -----
    A constant resistance takes V^2 as power, which goes into w^3: w goes with V^(2/3).
    """
    return 1.0 + sags * ((np.maximum(volt, 0.3) / NOMINAL) ** (2.0 / 3.0) - 1.0)


def bent(u: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the rotor speed of a command, over top speed.

    Parameters
    ----------
    u : (4, F) command, 0 to 1.
    share : (F,) of the thrust that follows the firmware's cubic in voltage instead of the square.
    """
    cubic = u * (FIRMWARE[0] + u * (FIRMWARE[1] + u * FIRMWARE[2])) / FIRMWARE.sum()
    return np.sqrt(np.maximum((1.0 - share) * u * u + share * cubic, 0.0))


def capped(speed: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Return a speed that approaches a ceiling smoothly, s / (1 + (s / top)^12)^(1/12).

    Parameters
    ----------
    speed, top : (4, F) speed, and (F,) ceiling, over top speed.
    """
    return speed / (1.0 + (speed / top) ** 12) ** (1.0 / 12.0)


def step_motor(
    w: np.ndarray,
    rate: np.ndarray,
    asked: np.ndarray,
    lag_s: np.ndarray,
    coast: np.ndarray | float,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Advance speed and acceleration of rotors by a lag of second order.

    Parameters
    ----------
    w, rate : (4, F) speed (rad/s) and its rate (rad/s^2).
    asked : (4, F) speed that the command asks for (rad/s).
    lag_s : (F,) area under the error of a unit step.
    coast : factor on the lag where the rotor slows down.
    dt : step (s).

    Returns
    -------
    Speed and its rate, (4, F) each.

    Notes
    -----
    w'' = n^2 (asked - w) - 2 d n w' with n = 2 d / lag and the damping d.
    """
    n = 2.0 * DAMPING / (lag_s * np.where(asked < w, coast, 1.0))
    rate = (rate + dt * n * n * (asked - w)) / (1.0 + 2.0 * DAMPING * n * dt)
    return np.maximum(w + dt * rate, 0.0), rate
