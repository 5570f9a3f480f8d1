"""Rotor speeds as they were, from their readings and the commands.

Thrust is computed from the readings, so that their noise is in the regressors, where it biases: it
makes inertias too large and losses too small. The expectation of the speeds given all that was read
takes the place of the readings (regression calibration: Carroll, Ruppert, Stefanski and Crainiceanu
2006, Measurement Error in Nonlinear Models, chapter 4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from ges.diagnose.design.residual import driven_speeds
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


def with_turning_speeds(flights: Sequence[Prepared], model: Model) -> list[Prepared]:
    """Return the flights with rotor speeds at which the model is evaluated.

    Parameters
    ----------
    flights : prepared recordings. Those in which commands and rotor speeds do not change in every
        row stay as they are.
    model : of the vehicle, through whose drive the commands run.
    """
    told = [f for f in flights if f.drive_in_every_row]
    made = iter(driven_speeds(told, model, {}) if told else ())
    return [
        f.replace(model_speeds=expected_speeds(f.stack("rotor_speed"), next(made), f.dt_s))
        if f.drive_in_every_row
        else f
        for f in flights
    ]


def expected_speeds(read: np.ndarray, made: np.ndarray, dt_s: float) -> np.ndarray:
    """Rotor speeds given their readings and what the commands make of them, (n, rotors) rad/s each,
    ``dt_s`` apart.

    A reading is w_made + sum_j c_j b_j + level + noise: the level walks at random, and b is what
    another lag would add. That is spanned by exponential averages of w_made, as in Laguerre models
    (Wahlberg 1991, IEEE Trans. Autom. Control 36, 551), and its rate where it rises.
    """
    off, lags = read - made, [_lags(w, dt_s) for w in made.T]
    # one drive for all rotors, by normal equations: logs may be long
    gram = sum(b.T @ b for b in lags)
    right = sum(b.T @ (e - e.mean()) for b, e in zip(lags, off.T, strict=True))
    size = np.linalg.pinv(gram, hermitian=True) @ right
    lagged = made + np.stack([b @ size for b in lags], axis=1)
    return lagged + np.stack([_level(e) for e in (read - lagged).T], axis=1)


def _lags(made: np.ndarray, dt_s: float) -> np.ndarray:
    """What another lag adds to a speed (n,), (n, k), about its mean: averages over two rows and
    more, an octave apart, up to the shortest window.
    """
    octaves = math.ceil(math.log2(settings.design.window_shortest_s / dt_s))
    gains = [0.5**k for k in range(1, octaves + 1)]
    once = [_filtered(made, gain) for gain in gains]
    twice = [_filtered(w, gain) for w, gain in zip(once, gains, strict=True)]
    added = np.stack(
        [*(w - made for w in (*once, *twice)), np.maximum(np.gradient(made), 0.0)], axis=1
    )
    return added - added.mean(axis=0)


def _level(read: np.ndarray) -> np.ndarray:
    """A level that walks at random, read with white noise, (n,): its expectation given all of them,
    at the likeliest gain of the steady Kalman filter.

    Both ways the filter is an average that forgets exponentially (Durbin and Koopman 2012, Time
    Series Analysis by State Space Methods, sections 2.2, 2.4 and 2.11).
    """

    def innovations(log_gain: float) -> float:
        return float(np.mean((read[1:] - _filtered(read, np.exp(log_gain))[:-1]) ** 2))

    found = minimize_scalar(innovations, bounds=(-np.log(len(read)), 0.0), method="bounded")
    gain = float(np.exp(found.x))
    return _filtered(_filtered(read, gain)[::-1], gain)[::-1]


def _filtered(read: np.ndarray, gain: float) -> np.ndarray:
    start = [(1.0 - gain) * read[0]]
    return lfilter([gain], [1.0, gain - 1.0], read, zi=start)[0]
