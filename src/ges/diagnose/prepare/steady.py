"""Noisy readings replaced, where they change fast, by what makes them change.

A position follows the velocity there, a voltage the drive.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ges.conventions import POSITION
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings


def with_steady_position(flight: Prepared) -> Prepared:
    """Return the flight with positions whose fast changes are those of the velocity.

    Parameters
    ----------
    flight : prepared recording; unchanged without position and velocity.

    Notes
    -----
    A complementary filter within each stretch in the air, symmetric in time, so that nothing lags.
    Wander of a position within seconds would swing a simulated load at its own frequency.

    References
    ----------
    Brown and Hwang 2012, *Introduction to Random Signals and Applied Kalman Filtering*.
    """
    if not (flight.has("position") and flight.has("velocity")):
        return flight
    p, v = flight.stack("position"), flight.stack("velocity")
    # trapezoidal rule; its drift is slow, and goes with the slow part of the difference below
    travelled = np.vstack([np.zeros(3), np.cumsum(0.5 * (v[1:] + v[:-1]) * flight.dt_s, axis=0)])
    for at in np.split(np.arange(len(p)), np.flatnonzero(np.diff(flight.flying)) + 1):
        # in less than one period of the cut-off nothing can be seen as slow
        if flight.flying[at[0]] and len(at) * flight.dt_s * settings.prepare.slow_Hz > 1.0:
            p[at] = travelled[at] + _slow(p[at] - travelled[at], flight.dt_s)
    return flight.replace(columns={**flight.columns, **dict(zip(POSITION, p.T, strict=True))})


def with_steady_voltage(flight: Prepared) -> Prepared:
    """Return the flight with a battery voltage that changes fast only as the drive predicts.

    Parameters
    ----------
    flight : prepared recording; unchanged without voltage or drive.

    Notes
    -----
    The prediction is a finite response to the recent past, by least squares. Noise of a regressor
    would attenuate its coefficient.

    References
    ----------
    Fuller 1987, *Measurement Error Models*, section 1.1.
    """
    drive = next((s for s in ("rotor_speed", "command") if flight.has(s)), None)
    if not (drive and flight.has("battery")):
        return flight
    signals = np.column_stack([flight.columns["battery_V"], flight.stack(drive).mean(axis=1)])
    # both sides without their slow part: else the battery's discharge would be laid on the drive
    slow = _slow(signals, flight.dt_s)
    read, work = (signals - slow).T
    past = lag_matrix(work, max(1, round(settings.design.window_shortest_s / flight.dt_s)))
    fast = past @ np.linalg.lstsq(past, read, rcond=None)[0]
    return flight.replace(columns={**flight.columns, "battery_V": slow[:, 0] + fast})


def lag_matrix(values: np.ndarray, taps: int) -> np.ndarray:
    """Return values of the current row and of those before it, side by side.

    Parameters
    ----------
    values : (n,).
    taps : number of columns.

    Returns
    -------
    (n, taps), zero before the first row.
    """
    padded = np.pad(values, (taps - 1, 0))
    return np.lib.stride_tricks.sliding_window_view(padded, taps)[:, ::-1]


def _slow(values: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the slow part of values (n, k).

    Half of the amplitude stays at ``settings.prepare.slow_Hz``.

    Trends go on beyond both ends.
    """
    width = settings.prepare.slow_s / dt_s
    ends = min(len(values) - 1, int(4.0 * width))
    padded = np.pad(values, ((ends, ends), (0, 0)), mode="reflect", reflect_type="odd")
    return gaussian_filter1d(padded, width, axis=0)[ends : ends + len(values)]
