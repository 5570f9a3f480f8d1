"""Two baselines that need no diagnosis at all.

One is how far mean rotor speeds are from those that should hover. The other is which single rotor
would have to be weak for the mean balance to hold. Means are taken flight by flight, of the rows in
which the rotors turn. With thrusts T_i = k w_i^2 the balance is sum(T_i) = m f_z, and no moment
about any axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ges.conventions import GRAVITY_M_S2, SPECIFIC_FORCE, command, rotor_speed
from ges.errors import GesError
from ges.recordings.recording import RecordingSet
from ges.vehicle.file import Vehicle

TURNING = 0.5
"""Rows count in which every rotor is faster than this share of its usual speed."""


@dataclass(frozen=True)
class Balance:
    """Mean balance of the forces and moments of a recording set.

    Attributes
    ----------
    thrust_N : (flights, n_rotors) mean thrusts by the nominal coefficient.
    asked_N : (n_rotors,) thrusts that the balance asks for.
    matrix : (equations, n_rotors) from thrusts to vertical force, roll, pitch and, where the torque
        coefficient is stated, yaw.
    """

    thrust_N: np.ndarray
    asked_N: np.ndarray
    matrix: np.ndarray


def balance(recordings: RecordingSet) -> Balance:
    """Return the mean balance of a recording set.

    Notes
    -----
    Means are over rows in which all rotors turn.

        sum T = m f_z,  sum y T = 0,  sum x T = 0,  sum s (k_q / k) T = 0

    Raises
    ------
    GesError
        When neither rotor speeds nor commands are logged.
    """
    vehicle = recordings.vehicle
    effects = vehicle.effect_values()
    thrust, lifted = zip(*(_means(f.frame, vehicle) for f in recordings.flights), strict=True)
    arrays, offset = vehicle.rotor_arrays(), effects.get("cg_offset", {})
    x = arrays["x_m"] - offset.get("x_m", 0.0)
    y = arrays["y_m"] - offset.get("y_m", 0.0)
    # f_z = sum T, M_x = sum y T, M_y = -sum x T; a hub counts from where the file says the mass is
    rows = [np.ones(len(x)), y, -x]
    if vehicle.torque_coefficient_Nm_s2 is not None:
        ratio = vehicle.torque_coefficient_Nm_s2.value / vehicle.thrust_coefficient_N_s2.value
        # a rotor that spins ccw turns the body cw: M_z = -sum s (k_q / k) T
        rows.append(-arrays["spin"] * ratio)
    matrix = np.stack(rows)
    weight = vehicle.mass_kg.value * float(np.mean(lifted))
    # four equations have one solution; without yaw the least thrusts of all that satisfy the others
    lean = np.linalg.lstsq(matrix, np.r_[weight, np.zeros(len(rows) - 1)], rcond=None)[0]
    # thrusts are told as k w^2: a rotor that is known to lose some has to be the faster
    losses = effects.get("weak_rotor", {})
    kept = 1.0 - np.array([losses.get(f"loss_{i + 1}", 0.0) for i in range(len(x))])
    return Balance(np.stack(thrust), lean / kept, matrix * kept)


def _means(frame: pd.DataFrame, vehicle: Vehicle) -> tuple[np.ndarray, float]:
    """Return mean thrusts (n_rotors,) by the nominal coefficient, and upward specific force."""
    k, n = vehicle.thrust_coefficient_N_s2.value, len(vehicle.rotors)
    if set(rotor_speed(n)) <= set(frame):
        square = frame[list(rotor_speed(n))].to_numpy(dtype=float) ** 2
    elif set(command(n)) <= set(frame) and vehicle.max_rotor_speed_rad_s is not None:
        u = frame[list(command(n))].to_numpy(dtype=float)
        linear = vehicle.effect_values().get("thrust_curve", {}).get("c", 0.0)
        square = ((1.0 - linear) * u**2 + linear * u) * vehicle.max_rotor_speed_rad_s.value**2
    else:
        raise GesError("neither rotor speeds nor commands are logged; there is no mean to take")
    # on the ground and while spinning up rotors carry nothing
    usual = np.nanmedian(square, axis=0)
    turning = (square > TURNING**2 * usual).all(axis=1)
    lifted = GRAVITY_M_S2
    if SPECIFIC_FORCE[2] in frame:
        lifted = float(np.nanmean(frame[SPECIFIC_FORCE[2]].to_numpy(dtype=float)[turning]))
    return k * np.nanmean(square[turning], axis=0), lifted


def mean_distance(recordings: RecordingSet) -> list[dict]:
    """Return one finding without a name: how far the mean rotor speeds are from the balance.

    Returns
    -------
    The finding's ``statistic`` is the norm of their relative distances from the speeds that carry
    the vehicle. Commands stand for speeds where none are logged.
    """
    balanced = balance(recordings)
    # thrust over thrust is speed over speed, squared
    ratio = np.sqrt(np.maximum(balanced.thrust_N.mean(axis=0) / balanced.asked_N, 0.0))
    return [_finding("", float(np.linalg.norm(ratio - 1.0)))]


def largest_loss(recordings: RecordingSet) -> list[dict]:
    """Return the rotor whose loss of thrust stands out most, were the balance to hold by losses.

    Returns
    -------
    One ``weak_rotor`` with its ``place``; ``statistic`` is the loss beyond the median rotor's, a
    share of thrust.
    """
    balanced = balance(recordings)
    mean = balanced.thrust_N.mean(axis=0)
    # shares that make the thrusts as flown balance: sum_i A_i T_i kept_i = A T_asked
    kept = np.linalg.lstsq(balanced.matrix * mean, balanced.matrix @ balanced.asked_N, rcond=None)[
        0
    ]
    # a wrong mass or coefficient is common to all rotors, and no loss of one
    loss = np.median(kept) - kept
    rotor = int(np.argmax(loss))
    return [_finding("weak_rotor", float(loss[rotor])) | {"place": f"rotor {rotor + 1}"}]


def _finding(name: str, statistic: float) -> dict:
    return {
        "name": name,
        "kind": "physics",
        "probability": 1.0,
        "parameters": {},
        "statistic": statistic,
    }


METHODS = {"means": mean_distance, "losses": largest_loss}
