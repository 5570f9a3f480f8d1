"""Moving air: turbulence, logarithmic wind profile and Dryden gusts (MIL-F-8785C, low altitude)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ges.blind.noise import coloured

FOOT_M = 0.3048
ROUGHNESS_M = 0.02
REFERENCE_HEIGHT_M = 2.0


@dataclass(frozen=True)
class Weather:
    """Turbulence of one flight; by default stationary, Gaussian and of one time scale.

    Attributes
    ----------
    scales : (share of the sd, correlation time in s) of the processes that add up.
    wander, wander_s : sd of the level's logarithm, and its correlation time.
    spikes : the same within a tenth of a second, which makes heavy tails.
    burst : share by which the level rises now and then, for a second or two.
    strength : factor on the whole flight.
    """

    scales: tuple[tuple[float, float], ...] = ((1.0, 0.3),)
    wander: float = 0.0
    wander_s: float = 3.0
    spikes: float = 0.0
    burst: float = 0.0
    strength: float = 1.0

    @property
    def usual(self) -> bool:
        """Whether the level stays the same throughout."""
        return not (self.wander or self.spikes or self.burst)


SPIKE_S, BURST_S, BURST_ABOVE = 0.1, 1.5, 1.3
"""Time scales of what makes the level uneven; a burst comes where a process of unit sd is above."""


def turbulence(
    weather: Weather, n: int, dt: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the turbulence of one flight.

    Parameters
    ----------
    weather : its time scales and its level.
    n : number of samples.
    dt : time from one sample to the next (s).
    rng : stream of all draws.

    Returns
    -------
    (6, n) rows of unit sd times the level, three for force and three for moment, and the level
    (n,).
    """
    # several time scales add up; the level then makes their sum uneven, the same for all six rows
    rows = sum(share * coloured((6, n), dt, time, rng) for share, time in weather.scales)
    level = np.full(n, weather.strength)
    if not weather.usual:
        slow, quick, rare = (
            coloured((1, n), dt, time, rng)[0] for time in (weather.wander_s, SPIKE_S, BURST_S)
        )
        level = level * np.exp(weather.wander * slow + weather.spikes * quick)
        level = level * (1.0 + weather.burst * (rare > BURST_ABOVE))
    return rows * level, level


def log_profile(height: np.ndarray) -> np.ndarray:
    """Return the wind speed over that at 2 m by the logarithmic law.

    Parameters
    ----------
    height : (F,) above the ground (m).

    Notes
    -----
    ln((h + z0) / z0) / ln(2 m / z0 + 1) with the roughness length z0 of 0.02 m.
    """
    z = np.maximum(height, 0.0) + ROUGHNESS_M
    return np.log(z / ROUGHNESS_M) / np.log(REFERENCE_HEIGHT_M / ROUGHNESS_M + 1.0)


def _dryden_lengths(height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (L_u, L_w) in metres; below 10 ft the values of 10 ft."""
    # the standard states its lengths in feet
    feet = np.maximum(height / FOOT_M, 10.0)
    return FOOT_M * feet / (0.177 + 0.000823 * feet) ** 1.2, FOOT_M * feet


def step_gusts(
    state: np.ndarray,
    sigma: np.ndarray,
    airspeed: np.ndarray,
    height: np.ndarray,
    noise: np.ndarray,
    dt: float,
) -> np.ndarray:
    """Advance the filters of Dryden gusts.

    The gust along the wind is of first order, the others of second. All are discretised exactly on
    their poles.

    Parameters
    ----------
    state : (5, F) gust along, then (output, inner) of the gusts across and up (m/s).
    sigma : (F,) sd of the gusts along and across (m/s); that of the gust up is half as large.
    airspeed : (F,) m/s.
    height : (F,) above the ground (m).
    noise : (3, F) unit normal.
    dt : step (s).

    Returns
    -------
    (5, F) in the order of ``state``.

    References
    ----------
    MIL-F-8785C, low-altitude model.
    """
    speed = np.maximum(airspeed, 1.0)
    long, vert = _dryden_lengths(height)
    out = np.empty_like(state)
    # the noise that keeps the variance at sigma^2 whatever the step
    keep = np.exp(-dt * speed / long)
    out[0] = keep * state[0] + sigma * np.sqrt(1.0 - keep**2) * noise[0]
    for row, length, share, shock in ((1, long, 1.0, noise[1]), (3, vert, 0.5, noise[2])):
        out[row], out[row + 1] = _second_order(
            state[row], state[row + 1], length / speed, share * sigma, shock, dt
        )
    return out


def _second_order(
    y: np.ndarray,
    inner: np.ndarray,
    time: np.ndarray,
    sigma: np.ndarray,
    shock: np.ndarray,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Advance H = sigma sqrt(T/pi) (1 + sqrt3 T s) / (1 + T s)^2 by a step.

    The output is y = sqrt3 x1 + (1 - sqrt3) x2, with x2 lagging x1.
    """
    root3 = np.sqrt(3.0)
    keep = np.exp(-dt / time)
    x2 = inner
    # only the output and x2 are kept; x1 follows from them
    x1 = (y - (1.0 - root3) * x2) / root3
    scale = sigma * np.sqrt(0.5)
    x1_new = keep * x1 + scale * np.sqrt(1.0 - keep**2) * shock
    x2_new = keep * x2 + (1.0 - keep) * 0.5 * (x1 + x1_new)
    return root3 * x1_new + (1.0 - root3) * x2_new, x2_new
