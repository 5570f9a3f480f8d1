"""Sensors of the foreign worlds: a flight as it truly was becomes a log of one rate and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from ges.blind.generator.detectable import TrueFlight, sample_times
from ges.blind.noise import Noise, coloured
from ges.conventions import (
    BODY_RATE,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
    command,
    rotor_speed,
)


@dataclass(frozen=True)
class LogSettings:
    """How a set is logged.

    Attributes
    ----------
    rate_hz : samples a second.
    noise : true noise of the sensors.
    level : name of the noise level, 'low' or 'high'.
    rotor_speeds, references : whether these streams are logged.
    """

    rate_hz: float
    noise: Noise
    level: str
    rotor_speeds: bool = True
    references: bool = True

    @property
    def sensors(self) -> Noise:
        """True noise; rotor speeds have an infinite sd where they are not logged."""
        return self.noise if self.rotor_speeds else replace(self.noise, speed_share=np.inf)


def record(flown: TrueFlight, log: LogSettings, rng: np.random.Generator) -> pd.DataFrame:
    """Return a flight as its sensors logged it.

    Parameters
    ----------
    flown : the true flight.
    log : rate, noise and streams of the log.
    rng : stream that all sensor errors are drawn from.

    Returns
    -------
    A row a sample, with the columns of :mod:`ges.conventions`; ``t_s`` begins at 0. The pose is NaN
    in rows without a sample of it.
    """
    return _Recorder(flown, log, rng).frame()


class _Recorder:
    def __init__(self, flown: TrueFlight, log: LogSettings, rng: np.random.Generator):
        self.flown, self.log, self.noise, self.rng = flown, log, log.noise, rng
        self.clock = np.arange(len(flown.state["p"])) * flown.step_s
        # samples may fall between steps: smooth states are drawn through, set-points hold
        self.t = sample_times(flown, log.rate_hz)

    def frame(self) -> pd.DataFrame:
        columns: dict[str, np.ndarray] = {"t_s": self.t - self.t[0]}
        for part in (self._pose, self._inertial, self._drive, self._asked):
            columns |= part()
        return pd.DataFrame(columns)

    def _at(self, name: str) -> np.ndarray:
        rows = self.flown.state[name].T
        return np.stack([np.interp(self.t, self.clock, row) for row in rows])

    def _hold_last(self, name: str) -> np.ndarray:
        return self.flown.state[name][_last(self.t, self.flown.step_s)].T

    def _white(self, width: int, sd: float) -> np.ndarray:
        return sd * self.rng.standard_normal((width, len(self.t)))

    def _drift(self, drift: tuple[float, float]) -> np.ndarray:
        return drift[0] * coloured((3, len(self.t)), 1.0 / self.log.rate_hz, drift[1], self.rng)

    def _bias(self, sd: float) -> np.ndarray:
        return sd * self.rng.standard_normal((3, 1))

    def _pose(self) -> dict[str, np.ndarray]:
        noise = self.noise
        p = self._at("p") + self._white(3, noise.position_m) + self._drift(noise.position_drift)
        v = self._at("v") + self._white(3, noise.velocity_m_s) + self._drift(noise.velocity_drift)
        # an error of attitude is a small turn about the body's axes; roll and pitch have a bias too
        small = self._white(3, noise.attitude_rad) + self._drift(noise.attitude_drift)
        small[:2] += self._bias(noise.attitude_bias_rad)[:2]
        attitude = Rotation.from_quat(self._at("q").T, scalar_first=True)
        q = (attitude * Rotation.from_rotvec(small.T)).as_quat(scalar_first=True).T
        named = dict(zip((*POSITION, *VELOCITY, *QUATERNION), (*p, *v, *q), strict=True))
        # one row of pose_every sees a pose
        seen = np.arange(len(self.t)) % noise.pose_every == 0
        return {name: np.where(seen, values, np.nan) for name, values in named.items()}

    def _inertial(self) -> dict[str, np.ndarray]:
        noise = self.noise
        rate = self._at("omega") + self._white(3, noise.rate_rad_s)
        felt = self._at("specific_force") + self._white(3, noise.acceleration_m_s2)
        rate += self._bias(noise.rate_bias_rad_s)
        felt += self._bias(noise.acceleration_bias_m_s2)
        return dict(zip((*BODY_RATE, *SPECIFIC_FORCE), (*rate, *felt), strict=True))

    def _drive(self) -> dict[str, np.ndarray]:
        u = np.clip(self._hold_last("u"), 0.0, 1.0)
        named = dict(zip(command(len(u)), u, strict=True))
        if self.log.rotor_speeds:
            # noise of a rotor speed is a share of it
            speed = self._at("rotor_speed") * (1.0 + self._white(len(u), self.noise.speed_share))
            named |= dict(zip(rotor_speed(len(u)), speed, strict=True))
        return named

    def _asked(self) -> dict[str, np.ndarray]:
        if not self.log.references:
            return {}
        named = dict(zip(POSITION_REF, self._hold_last("p_ref"), strict=True))
        named |= dict(zip(VELOCITY_REF, self._hold_last("v_ref"), strict=True))
        return named | {"yaw_ref_rad": self._hold_last("yaw_ref")[0]}


def _last(t: np.ndarray, step_s: float) -> np.ndarray:
    # a time that rounding puts just below its step belongs to that step
    return np.floor(t / step_s + 1e-9).astype(int)
