"""What is random in a recorded flight: noise of the sensors and disturbance of the air.

Whoever makes recordings draws from these, and :mod:`ges.blind.limit` asks what they hide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Noise:
    """True sensor noise of a log; every sd is of one sample and one axis.

    Attributes
    ----------
    position_m, velocity_m_s, attitude_rad, rate_rad_s, acceleration_m_s2 : sd of the white noise.
    position_drift, velocity_drift, attitude_drift : (sd, correlation time in s) of an
        Ornstein-Uhlenbeck process beside the white noise, the sd in the unit of its channel.
    attitude_bias_rad, rate_bias_rad_s, acceleration_bias_m_s2 : sd of the bias that a flight keeps.
    speed_share : sd of the white noise of a rotor speed over the speed; infinite without such a
        log.
    range_m : sd of the white noise of a rangefinder; infinite without one.
    vibration_rad_s, vibration_m_s2 : amplitude of the rotors' tones in gyro and accelerometer.
    pose_every : samples from one pose (position, velocity, attitude) to the next.
    """

    position_m: float = 0.002
    position_drift: tuple[float, float] = (0.003, 1.0)
    velocity_m_s: float = 0.012
    velocity_drift: tuple[float, float] = (0.006, 0.3)
    attitude_rad: float = 0.0015
    attitude_drift: tuple[float, float] = (0.003, 1.0)
    attitude_bias_rad: float = 0.002
    rate_rad_s: float = 0.008
    rate_bias_rad_s: float = 0.001
    acceleration_m_s2: float = 0.15
    acceleration_bias_m_s2: float = 0.02
    speed_share: float = 0.002
    range_m: float = np.inf
    vibration_rad_s: float = 0.0
    vibration_m_s2: float = 0.0
    pose_every: int = 1

    def scaled(self, by: float) -> Noise:
        """Return the same sensors at another noise level.

        Parameters
        ----------
        by : factor on white noise, drifts and vibration; biases stay as they are.
        """
        drifts = ("position_drift", "velocity_drift", "attitude_drift")
        white = (
            "position_m",
            "velocity_m_s",
            "attitude_rad",
            "rate_rad_s",
            "acceleration_m_s2",
            "speed_share",
            "range_m",
            "vibration_rad_s",
            "vibration_m_s2",
        )
        louder = {name: by * getattr(self, name) for name in white}
        louder |= {name: (by * getattr(self, name)[0], getattr(self, name)[1]) for name in drifts}
        return replace(self, **louder)

    def thinned(self, by: int) -> Noise:
        """Return the noise of means over ``by`` samples.

        Such means keep all information that is slower than they are.

        Parameters
        ----------
        by : samples of a mean; divides ``pose_every`` where that is more than one.

        Returns
        -------
        White noise and vibration fall with the root of ``by``, that of the pose only where every
        sample has one. Drifts and biases stay.
        """
        # what is independent from sample to sample falls with the root of their number; biases and
        # drifts are as large in the mean
        root = by**0.5
        alone = ("rate_rad_s", "acceleration_m_s2", "speed_share", "range_m")
        tones = ("vibration_rad_s", "vibration_m_s2")
        pose = ("position_m", "velocity_m_s", "attitude_rad") if self.pose_every == 1 else ()
        quieter = {name: getattr(self, name) / root for name in (*alone, *tones, *pose)}
        return replace(self, **quieter, pose_every=max(self.pose_every // by, 1))


@dataclass(frozen=True)
class Air:
    """Disturbance of one flight by the air: Ornstein-Uhlenbeck processes, the same in every axis.

    Attributes
    ----------
    acceleration_m_s2 : (sd, correlation time in s) of each process; they add up.
    turn_per_m : angular acceleration over acceleration, 1/m.
    level : (n,) factor on the processes over the flight; None where it is one throughout.
    """

    acceleration_m_s2: tuple[tuple[float, float], ...] = ()
    turn_per_m: float = 0.0
    level: np.ndarray | None = None


def coloured(
    shape: tuple[int, int], dt: float, time_s: float, rng: np.random.Generator
) -> np.ndarray:
    """Draw stationary Ornstein-Uhlenbeck noise of unit variance.

    Parameters
    ----------
    shape : (channels, n).
    dt : time from one sample to the next (s).
    time_s : correlation time.
    rng : stream of the white noise.

    Returns
    -------
    (channels, n), independent from channel to channel.
    """
    from scipy.signal import lfilter

    keep = np.exp(-dt / time_s)
    # x_k = a x_(k-1) + sqrt(1 - a^2) e_k has unit variance from the first sample on, if that is
    # drawn from the stationary law
    white = rng.standard_normal(shape) * np.sqrt(1.0 - keep**2)
    white[:, 0] /= np.sqrt(1.0 - keep**2)
    return lfilter([1.0], [1.0, -keep], white, axis=1)
