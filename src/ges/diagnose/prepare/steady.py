"""Noisy readings, told where they change fast by what makes them: position by velocity, voltage by
the drive.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ges.conventions import POSITION
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings


def with_steady_position(flight: Prepared) -> Prepared:
    """Positions that change fast as the velocity says and slowly as they were read, within each
    stretch in the air.

    The wander of a reading within seconds would swing a load that hangs on it, at its own
    frequency; the velocity, which is its rate, wanders less there (Brown and Hwang 2012,
    complementary filter; symmetric in time, so that nothing lags).
    """
    if not (flight.has("position") and flight.has("velocity")):
        return flight
    p, v = flight.stack("position"), flight.stack("velocity")
    # trapezoidal rule; its drift is slow, and goes with the slow part of the difference below
    travelled = np.vstack([np.zeros(3), np.cumsum(0.5 * (v[1:] + v[:-1]) * flight.dt_s, axis=0)])
    for at in np.split(np.arange(len(p)), np.flatnonzero(np.diff(flight.flying)) + 1):
        # in less than one period of the cut-off nothing can be told as slow
        if flight.flying[at[0]] and len(at) * flight.dt_s * settings.prepare.slow_Hz > 1.0:
            p[at] = travelled[at] + _slow(p[at] - travelled[at], flight.dt_s)
    return flight.replaced(columns={**flight.columns, **dict(zip(POSITION, p.T, strict=True))})


def with_steady_voltage(flight: Prepared) -> Prepared:
    """A battery voltage that changes slowly as it was read, and fast as what the drive did
    shortly before predicts it (least squares of a finite response).

    Noise of the reading would weaken what voltage does to thrust: a column in error attenuates its
    coefficient (Fuller 1987, section 1.1), and most of what whitening leaves of a voltage is noise.
    """
    drive = next((s for s in ("rotor_speed", "command") if flight.has(s)), None)
    if not (drive and flight.has("battery")):
        return flight
    told = np.column_stack([flight.columns["battery_V"], flight.stack(drive).mean(axis=1)])
    # both sides without their slow part: else the battery's discharge would be laid on the drive
    slow = _slow(told, flight.dt_s)
    read, work = (told - slow).T
    past = with_past(work, max(1, round(settings.design.window_shortest_s / flight.dt_s)))
    fast = past @ np.linalg.lstsq(past, read, rcond=None)[0]
    return flight.replaced(columns={**flight.columns, "battery_V": slow[:, 0] + fast})


def with_past(values: np.ndarray, taps: int) -> np.ndarray:
    """Values (n,) now and of up to ``taps`` - 1 rows before, zero before the first: what a finite
    response takes, (n, taps).
    """
    padded = np.pad(values, (taps - 1, 0))
    return np.lib.stride_tricks.sliding_window_view(padded, taps)[:, ::-1]


def _slow(values: np.ndarray, dt_s: float) -> np.ndarray:
    """What of values (n, k) changes slowly: at ``settings.prepare.slow_Hz`` half of the amplitude
    is left; trends go on beyond both ends.
    """
    width = settings.prepare.slow_s / dt_s
    ends = min(len(values) - 1, int(4.0 * width))
    padded = np.pad(values, ((ends, ends), (0, 0)), mode="reflect", reflect_type="odd")
    return gaussian_filter1d(padded, width, axis=0)[ends : ends + len(values)]
