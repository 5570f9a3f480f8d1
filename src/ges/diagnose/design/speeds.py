"""Rotor speeds as they were, from their readings and the commands.

Thrust is computed from the readings. Their noise is then in the regressors and biases them:
inertias come out too large and losses too small. So the readings are replaced by the expected
speeds given all data (regression calibration). See Carroll, Ruppert, Stefanski and Crainiceanu
2006, Measurement Error in Nonlinear Models, chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from ges.diagnose.design.drives import commanded_speeds
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


def with_expected_speeds(flights: Sequence[Prepared], model: Model) -> list[Prepared]:
    """Return the flights with expected rotor speeds, at which the model is evaluated.

    Parameters
    ----------
    flights : prepared recordings. Those in which commands and rotor speeds do not change in every
        row stay as they are.
    model : of the vehicle, through whose drive the commands run.
    """
    complete = [f for f in flights if f.drive_in_every_row]
    commanded = iter(commanded_speeds(complete, model, {}) if complete else ())
    return [
        f.replace(model_speeds=expected_speeds(f.stack("rotor_speed"), next(commanded), f.dt_s))
        if f.drive_in_every_row
        else f
        for f in flights
    ]


def expected_speeds(readings: np.ndarray, commanded: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the rotor speeds given their readings and the commands.

    Parameters
    ----------
    readings : (n, rotors) rad/s.
    commanded : (n, rotors) rad/s, what the commands make.
    dt_s : spacing of the rows.

    Returns
    -------
    (n, rotors) rad/s.

    Notes
    -----
    A reading is w_commanded + sum_j c_j b_j + random walk + noise, where b spans another lag. It
    consists of exponential averages of w_commanded, as in Laguerre models (Wahlberg 1991, IEEE
    Trans. Autom. Control 36, 551), and its rate where it rises.
    """
    differences, lags = readings - commanded, [_lag_basis(w, dt_s) for w in commanded.T]
    # one drive for all rotors, by normal equations: logs may be long
    gram = sum(b.T @ b for b in lags)
    right = sum(b.T @ (e - e.mean()) for b, e in zip(lags, differences.T, strict=True))
    coefficients = np.linalg.pinv(gram, hermitian=True) @ right
    lagged = commanded + np.stack([b @ coefficients for b in lags], axis=1)
    return lagged + np.stack([_random_walk(e) for e in (readings - lagged).T], axis=1)


def _lag_basis(commanded: np.ndarray, dt_s: float) -> np.ndarray:
    """Return basis functions of a change of lag for one rotor, (n, 2 octaves + 1), rad/s.

    They are the speed smoothed once and twice, less the speed. Exponential averages are over 2, 4,
    8 ... rows, up to the shortest window. The last function is the rise per row, zero in falls: a
    motor speeds up slower than it slows down. Each is less its mean.
    """
    octaves = math.ceil(math.log2(settings.design.window_shortest_s / dt_s))
    gains = [0.5**k for k in range(1, octaves + 1)]
    once = [_smooth(commanded, gain) for gain in gains]
    twice = [_smooth(w, gain) for w, gain in zip(once, gains, strict=True)]
    added = np.stack(
        [*(w - commanded for w in (*once, *twice)), np.maximum(np.gradient(commanded), 0.0)], axis=1
    )
    return added - added.mean(axis=0)


def _random_walk(readings: np.ndarray) -> np.ndarray:
    """Return the expected value (n,) of a random walk that is read with white noise.

    The gain of the steady Kalman filter is the most probable one. Forward and backward the filter
    is an exponential average (Durbin and Koopman 2012, Time Series Analysis by State Space Methods,
    sections 2.2, 2.4, 2.11).
    """

    def innovations(log_gain: float) -> float:
        return float(np.mean((readings[1:] - _smooth(readings, np.exp(log_gain))[:-1]) ** 2))

    optimum = minimize_scalar(innovations, bounds=(-np.log(len(readings)), 0.0), method="bounded")
    gain = float(np.exp(optimum.x))
    return _smooth(_smooth(readings, gain)[::-1], gain)[::-1]


def _smooth(readings: np.ndarray, gain: float) -> np.ndarray:
    # pandas is there already, and scipy.signal takes a third of a second to import
    return pd.Series(readings).ewm(alpha=gain, adjust=False).mean().to_numpy()
