"""Wind by the power law, von Karman gusts, and the air's turbulence of two time scales."""

from __future__ import annotations

import numpy as np

from ges.blind.noise import coloured

EXPONENT = 1.0 / 7.0
REFERENCE_M = 2.0
TURBULENCE = ((0.8, 0.45), (0.6, 0.09))
"""Share of the sd and correlation time (s) of the processes that add up."""
GUST_LENGTH_M = 12.0


def profile(height: np.ndarray) -> np.ndarray:
    """Return the wind speed over that at 2 m by the power law of exponent 1/7.

    Parameters
    ----------
    height : (F,) above the ground (m).

    References
    ----------
    Hellmann 1919.
    """
    return (np.maximum(height, 0.02) / REFERENCE_M) ** EXPONENT


def karman_gusts(n: int, dt: float, speed: float, rng: np.random.Generator) -> np.ndarray:
    """Draw von Karman gusts of unit sd at a steady air speed.

    Parameters
    ----------
    n : number of samples.
    dt : time from one sample to the next (s).
    speed : of the air (m/s).
    rng : stream of the white noise.

    Returns
    -------
    (3, n) along, across and up.

    Notes
    -----
    Rational filters approximate the spectra, with T = L / V. Along it is

        (1 + 0.25 T s) / (1 + 1.357 T s + 0.1987 T^2 s^2),

    across and up

        (1 + 2.7478 T s + 0.3398 T^2 s^2) / (1 + 2.9958 T s + 1.9754 T^2 s^2 + 0.1539 T^3 s^3).

    References
    ----------
    MIL-STD-1797A, appendix A.
    """
    from scipy.signal import bilinear, lfilter

    time = GUST_LENGTH_M / speed
    longitudinal = ([0.25 * time, 1.0], [0.1987 * time**2, 1.357 * time, 1.0])
    lateral = (
        [0.3398 * time**2, 2.7478 * time, 1.0],
        [0.1539 * time**3, 1.9754 * time**2, 2.9958 * time, 1.0],
    )
    # the filters start at rest: what comes before they have settled is dropped
    warm = int(4.0 * time / dt)
    rows = []
    for over, under in (longitudinal, lateral, lateral):
        b, a = bilinear(over, under, fs=1.0 / dt)
        row = lfilter(b, a, rng.standard_normal(n + warm))[warm:]
        rows.append(row / row.std())
    return np.stack(rows)


def turbulence(n: int, dt: float, rng: np.random.Generator) -> np.ndarray:
    """Draw turbulence of two time scales.

    Parameters
    ----------
    n : number of samples.
    dt : time from one sample to the next (s).
    rng : stream of all draws.

    Returns
    -------
    (6, n) of unit sd: three rows of force, three of moment.
    """
    return np.sum([share * coloured((6, n), dt, time, rng) for share, time in TURBULENCE], axis=0)
