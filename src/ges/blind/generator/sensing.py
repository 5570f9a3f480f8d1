"""What is logged: jittered clocks, quantised and noisy sensors, cone rangefinder, sensor faults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ges.blind.generator.flight import Sortie, rotation_matrix, to_world
from ges.blind.generator.ground import height_at
from ges.blind.generator.plan import CONTROL_DT_S
from ges.blind.noise import Noise, coloured
from ges.conventions import (
    AXES,
    BODY_RATE,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    VELOCITY_REF,
    command,
    motor_current,
    rotor_speed,
)

NOISE_LEVELS = {"low": 0.4, "ordinary": 1.0, "high": 2.2}
ORDINARY = Noise(range_m=0.004, vibration_rad_s=0.006, vibration_m_s2=0.25)
CONE_HALF_ANGLE_RAD = 0.2
RANGE_LIMIT_M = 4.0
REFERENCE_CURRENT_A_PER_KG = 18.0


@dataclass(frozen=True)
class Logging:
    """How a case is logged; drawn without regard to what is concealed.

    Attributes
    ----------
    rate_hz : samples a second.
    noise : key of :data:`NOISE_LEVELS`.
    rotor_speeds, references, battery, currents, ground : whether these streams are logged.
    """

    rate_hz: float
    noise: str
    rotor_speeds: bool
    references: bool
    battery: bool
    currents: bool
    ground: bool

    @property
    def scale(self) -> float:
        """Factor on the ordinary noise."""
        return NOISE_LEVELS[self.noise]

    @property
    def sensors(self) -> Noise:
        """True noise; rotor speeds have an infinite sd where they are not logged."""
        level = ORDINARY.scaled(self.scale)
        return level if self.rotor_speeds else replace(level, speed_share=np.inf)


class Recorder:
    """Sensors that turn one true flight into a log.

    Parameters
    ----------
    truth : channels of :meth:`Simulation.run` for one flight, (n, width) each.
    sortie : the flight; faults of its sensors are in its numbers.
    logging : rate, noise and streams of the log.
    rng : stream of all sensor errors.
    """

    def __init__(
        self,
        truth: Mapping[str, np.ndarray],
        sortie: Sortie,
        logging: Logging,
        rng: np.random.Generator,
    ) -> None:
        self.truth, self.sortie, self.log, self.rng = truth, sortie, logging, rng
        self.n = len(truth["p"])
        self.clock = np.arange(self.n) * CONTROL_DT_S
        self.hid = {k: sortie.numbers.get(k, 0.0) for k in _SENSOR_NUMBERS}
        dt = 1.0 / logging.rate_hz
        ticks = np.arange(0.02, self.clock[-1] - 0.12, dt)
        # a clock that is off by 20 ppm or so, and jitter of up to 4 % of a step
        self.t = ticks * (1.0 + 2e-5 * rng.standard_normal()) + 0.04 * dt * rng.uniform(
            -1, 1, len(ticks)
        )

    def frame(self) -> pd.DataFrame:
        """Return the logged flight.

        Returns
        -------
        A row a sample, in columns of :mod:`ges.conventions`; ``t_s`` begins at 0. A range that did
        not come back is NaN.
        """
        columns: dict[str, np.ndarray] = {"t_s": self.t - self.t[0]}
        for part in (self._pose, self._inertial, self._drive, self._range, self._asked):
            columns.update(part())
        return pd.DataFrame(columns)

    def _at(self, name: str, shift: float = 0.0, smooth: float = 0.0) -> np.ndarray:
        """Return the truth at the sample times, (width, n).

        A centred anti-alias mean over ``smooth`` seconds (an odd count) comes first.
        """
        from scipy.ndimage import uniform_filter1d

        rows = self.truth[name].T
        if smooth:
            rows = uniform_filter1d(
                rows, max(int(round(smooth / CONTROL_DT_S)), 1), axis=1, mode="nearest"
            )
        return np.stack([np.interp(self.t - shift, self.clock, row) for row in rows])

    def _noise(self, shape: int | tuple[int, ...], size: float) -> np.ndarray:
        return size * self.log.scale * self.rng.standard_normal(shape)

    def _drift(self, shape: tuple[int, int], drift: tuple[float, float]) -> np.ndarray:
        size, time_s = drift
        drawn = coloured(shape, 1.0 / self.log.rate_hz, time_s, self.rng)
        return size * self.log.scale * drawn

    def _pose(self) -> dict[str, np.ndarray]:
        late = self.hid["time_offset_s"]
        n = len(self.t)
        p = self._at("p", late) + self._noise((3, n), ORDINARY.position_m)
        p += self._drift((3, n), ORDINARY.position_drift)
        v = self._at("v", late) + self._noise((3, n), ORDINARY.velocity_m_s)
        v += self._drift((3, n), ORDINARY.velocity_drift)
        q = self._at("q", late)
        small = self._noise((3, n), ORDINARY.attitude_rad)
        small += self._drift((3, n), ORDINARY.attitude_drift)
        # a fault's own bias, beside the one that every attitude estimate has
        small[0] += (
            self.hid["att_bias_x_rad"] + ORDINARY.attitude_bias_rad * self.rng.standard_normal()
        )
        small[1] += (
            self.hid["att_bias_y_rad"] + ORDINARY.attitude_bias_rad * self.rng.standard_normal()
        )
        q = _tilt(q / np.linalg.norm(q, axis=0), small)
        named = dict(zip(POSITION, _quantise(p, 1e-4), strict=True))
        named |= dict(zip(VELOCITY, _quantise(v, 1e-3), strict=True))
        return named | dict(zip(QUATERNION, _quantise(q, 1e-5), strict=True))

    def _inertial(self) -> dict[str, np.ndarray]:
        n = len(self.t)
        # one vibration shakes both sensors, so that their errors go together
        tone, scale = self._vibration(), self.log.scale
        gyro = (
            self._at("omega", smooth=3 * CONTROL_DT_S)
            + self._noise((3, n), ORDINARY.rate_rad_s)
            + ORDINARY.vibration_rad_s * scale * tone
        )
        acc = (
            self._at("specific_force", smooth=3 * CONTROL_DT_S)
            + self._noise((3, n), ORDINARY.acceleration_m_s2)
            + ORDINARY.vibration_m_s2 * scale * tone
        )
        for k, axis in enumerate("xyz"):
            gyro[k] += self.hid[f"gyro_bias_{axis}_rad_s"]
            gyro[k] += ORDINARY.rate_bias_rad_s * self.rng.standard_normal()
            acc[k] += self.hid[f"acc_bias_{axis}_m_s2"]
            acc[k] += ORDINARY.acceleration_bias_m_s2 * self.rng.standard_normal()
        named = dict(zip(BODY_RATE, _quantise(gyro, 0.00106), strict=True))
        return named | dict(zip(SPECIFIC_FORCE, _quantise(acc, 0.0048), strict=True))

    def _vibration(self) -> np.ndarray:
        """Once-per-revolution tones of the rotors as the sampling folds them down, (3, n)."""
        speed = self.truth["rotor_speed"]
        phase = np.cumsum(speed, axis=0) * CONTROL_DT_S
        share = np.sqrt(np.maximum(speed, 0.0) / (speed.max() + 1e-9))
        out = np.zeros((3, len(self.t)))
        for rotor in range(speed.shape[1]):
            turned = np.interp(self.t, self.clock, phase[:, rotor])
            size = np.interp(self.t, self.clock, share[:, rotor])
            start = self.rng.uniform(0.0, 2.0 * np.pi, (3, 1))
            out += size * np.sin(turned + start)
        return 0.5 * out

    def _drive(self) -> dict[str, np.ndarray]:
        n, u = len(self.t), _quantise(np.clip(self._hold_last("u"), 0.0, 1.0), 1e-4)
        rotors = len(u)
        named = dict(zip(command(rotors), u, strict=True))
        if self.log.rotor_speeds:
            w = self._at("rotor_speed") * (1.0 + self._noise((rotors, n), ORDINARY.speed_share))
            named |= dict(zip(rotor_speed(rotors), _quantise(w, 0.5), strict=True))
        full = self.sortie.craft.battery_V
        amps = REFERENCE_CURRENT_A_PER_KG * self.sortie.craft.true["mass"]
        current = np.maximum(self._at("current"), 0.0) * amps
        if self.log.battery:
            volt = full * self._at("battery")[0] + self._noise(n, 0.002 * full)
            named["battery_V"] = _quantise(volt, 0.01)
            named["battery_A"] = _quantise(current.sum(axis=0) + self._noise(n, 0.01 * amps), 0.01)
        if self.log.currents:
            each = current + self._noise((rotors, n), 0.01 * amps)
            named |= dict(zip(motor_current(rotors), _quantise(each, 0.005), strict=True))
        return named

    def _hold_last(self, name: str) -> np.ndarray:
        """Return the value last written before each sample: commands are steps, not lines."""
        index = np.clip((self.t / CONTROL_DT_S).astype(int), 0, self.n - 1)
        return self.truth[name][index].T

    def _range(self) -> dict[str, np.ndarray]:
        n = len(self.t)
        reading = self._cone()
        if self.hid["range_lag_s"]:
            reading = lagged(reading, self.hid["range_lag_s"], CONTROL_DT_S)
        y = (
            np.interp(self.t, self.clock, reading)
            + self.hid["range_bias_m"]
            + self._noise(n, ORDINARY.range_m)
        )
        # out of reach, or one of the few in a thousand that do not come back
        y = np.where((y > RANGE_LIMIT_M) | (self.rng.random(n) < 0.002), np.nan, _quantise(y, 1e-3))
        named = {"range_m": y}
        if self.log.ground:
            named["ground_z_m"] = _quantise(
                self._at("ground")[0] + self._drift((1, n), (0.002, 2.0))[0], 1e-3
            )
        return named

    def _cone(self) -> np.ndarray:
        """Return slant range (n,) averaged over the cone's footprint, along body -z."""
        r = rotation_matrix(self.truth["q"].T)
        p, grid = self.truth["p"].T, self.sortie.grid[None]
        total = np.zeros(self.n)
        # the axis and four beams at 0.6 of the edge stand for the cone
        spread = np.tan(CONE_HALF_ANGLE_RAD) * 0.6
        pattern = [(0.0, 0.0)] + [
            (spread * np.cos(a), spread * np.sin(a)) for a in np.arange(4) * np.pi / 2.0
        ]
        for dx, dy in pattern:
            beam = to_world(r, np.array([dx, dy, -1.0])[:, None] * np.ones(self.n))
            total += _march(p, beam / np.linalg.norm(beam, axis=0), grid)
        return np.maximum(total / len(pattern), 0.0)

    def _asked(self) -> dict[str, np.ndarray]:
        if not self.log.references:
            return {}
        k = np.clip((self.t / CONTROL_DT_S).astype(int), 0, self.n - 1)
        ref = self.sortie.plan.reference[:, k]
        named = dict(zip(POSITION_REF, ref[0:3], strict=True)) | dict(
            zip(VELOCITY_REF, ref[3:6], strict=True)
        )
        return named | {"yaw_ref_rad": ref[9]}


_SENSOR_NUMBERS = (
    "range_bias_m",
    "range_lag_s",
    "time_offset_s",
    "att_bias_x_rad",
    "att_bias_y_rad",
    *(f"acc_bias_{a}_m_s2" for a in AXES),
    *(f"gyro_bias_{a}_rad_s" for a in AXES),
)


def _march(p: np.ndarray, beam: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return the distance along unit beams (3, n) to the terrain, by four fixed-point steps."""
    # a beam near the horizon would never meet the ground
    down = np.maximum(-beam[2], 0.2)
    zero = np.zeros(p.shape[1], np.intp)
    distance = (p[2] - height_at(grid, zero, p[0], p[1])) / down
    for _ in range(4):
        hit = height_at(grid, zero, p[0] + distance * beam[0], p[1] + distance * beam[1])
        # damped: on steep ground a whole step overshoots
        distance = 0.5 * distance + 0.5 * (p[2] - hit) / down
    return distance


def lagged(y: np.ndarray, lag_s: float, dt: float) -> np.ndarray:
    """Return samples behind a first-order lag, exact for a held input.

    Parameters
    ----------
    y : (n,) samples; the lag is at rest at the first.
    lag_s : time constant.
    dt : time from one sample to the next (s).
    """
    from scipy.signal import lfilter

    # exact for a held input, at rest at the first value
    keep = np.exp(-dt / lag_s)
    return lfilter([1.0 - keep], [1.0, -keep], y, zi=[keep * y[0]])[0]


def _tilt(q: np.ndarray, small: np.ndarray) -> np.ndarray:
    """Multiply attitudes (4, n) by small body rotations (3, n)."""
    # q (1, small / 2), the exponential of a small rotation to first order
    w, x, y, z = q
    a, b, c = 0.5 * small
    out = np.stack(
        [
            w - x * a - y * b - z * c,
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
        ]
    )
    return out / np.linalg.norm(out, axis=0)


def _quantise(y: np.ndarray, step: float) -> np.ndarray:
    return np.round(y / step) * step
