"""Where a concealed effect can be seen: the channels in which it stands above the air's own turbulence."""

from __future__ import annotations

import numpy as np

from ..conventions import AXES
from .plan import CONTROL_DT_S

TRUTH_STEP = 10
SENSOR_CHANNELS = {
    "rangefinder_bias": ["range"],
    "rangefinder_lag": ["range"],
    "time_offset": ["time"],
    "accelerometer_bias": ["acc"],
    "gyro_bias": ["gyro"],
    "attitude_bias": ["attitude"],
}
DRIVE_ERROR = 0.01


def seen_channels(case, flights) -> list[str]:
    """Return channel names: force and moment axes, 'drive' where rotor speeds are logged, or a sensor's.

    A force or moment counts where its RMS over all flights exceeds the turbulence's; the drive where
    the speeds leave a first-order response of the declared kind by over 1 %.
    """
    sensors = [c for n in case.spec.names for c in SENSOR_CHANNELS.get(n, [])]
    if not case.spec.names or sensors:
        return sensors
    aloft = [_aloft(case, f) for f in flights]
    drive = [_drive_residual(case, f)[a] for f, a in zip(flights, aloft, strict=True)]
    force = [f["extra_force"][a] for f, a in zip(flights, aloft, strict=True)]
    moment = [f["extra_moment"][a] for f, a in zip(flights, aloft, strict=True)]
    names = []
    if not case.around.logging.rotor_speeds:
        more = [_thrust_difference(case, f)[a] for f, a in zip(flights, aloft, strict=True)]
        force = [x + np.pad(m[:, :1], ((0, 0), (2, 0))) for x, m in zip(force, more, strict=True)]
        moment = [x + m[:, 1:] for x, m in zip(moment, more, strict=True)]
    elif _rms(np.concatenate(drive).ravel()) > DRIVE_ERROR:
        names.append("drive")
    air, true = case.sorties[0].turbulence, case.craft.true
    inertia = np.array([true["ixx"], true["iyy"], true["izz"]])
    excess = case.sorties[0].numbers.get("inertia_error", 1.0) - 1.0
    spin_up = [np.gradient(f["omega"], CONTROL_DT_S, axis=0)[a] for f, a in zip(flights, aloft, strict=True)]
    forces, moments = np.concatenate(force), np.concatenate(moment) - excess * inertia * np.concatenate(spin_up)
    names += [f"force_{a}" for k, a in enumerate(AXES) if _rms(forces[:, k]) > air * true["mass"]]
    return names + [f"moment_{a}" for k, a in enumerate(AXES) if _rms(moments[:, k]) > 6.0 * air * inertia[k]]


def _rms(y: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(y))))


def _aloft(case, flight) -> np.ndarray:
    """Return samples off the ground."""
    return flight["p"][:, 2] - flight["ground"][:, 0] > 0.6 * case.craft.radius_m


def _drive_residual(case, flight) -> np.ndarray:
    """Return (n, 4) speed less the declared kind of response to the command, over the top speed."""
    from scipy.signal import lfilter

    true = case.craft.true
    keep = np.exp(-CONTROL_DT_S / true["lag"])
    start = flight["rotor_speed"][0] / true["speed"]
    model = lfilter([1.0 - keep], [1.0, -keep], flight["u"], axis=0, zi=keep * start[None])[0]
    return flight["rotor_speed"] / true["speed"] - model


def _thrust_difference(case, flight) -> np.ndarray:
    """Return (n, 4): thrust, and moments, that the declared kind of drive would not have given."""
    craft, true = case.craft, case.craft.true
    ratio = flight["rotor_speed"] / true["speed"]
    model = ratio - _drive_residual(case, flight)
    square = true["speed"] ** 2 * (ratio**2 - model**2)
    thrust, torque = true["thrust"] * square, true["torque"] * square
    x, y, spin = np.array(craft.rotor_x_m), np.array(craft.rotor_y_m), np.array(craft.spin)
    return np.stack([thrust.sum(1), thrust @ y, -thrust @ x, -torque @ spin], axis=1)
