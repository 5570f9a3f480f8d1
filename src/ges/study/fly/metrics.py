"""Numbers of one closed-loop flight."""

from __future__ import annotations

import numpy as np

from ges.conventions import AXES
from ges.simulator.flight import Record

GYRO = tuple(f"gyro_{a}_rad_s" for a in AXES)
COLUMNS = ("t_s", *GYRO, "range_m", "agl_m", "ge_factor", "ge_estimate", "ge_shadow", "contact")
NAMES = (
    "agl_rms_m",
    "gyro_rms_rad_s",
    "clearance_mean_m",
    "clearance_p5_m",
    "clearance_min_m",
    "low_clearance_s",
    "agl_rms_restricted_m",
    "estimate_mae",
    "network_mae",
    "contact_s",
)


def gyro_rms(record: Record) -> float:
    """Return the root mean square of the length of the gyro vector (rad/s).

    Parameters
    ----------
    record : with the columns :data:`GYRO`.
    """
    # mean |w|^2 is the sum of the means of w_x^2, w_y^2, w_z^2
    return float(np.sqrt(sum(np.mean(record[name] ** 2) for name in GYRO)))


def flight_metrics(
    record: Record, agl_ref_m: float, low_clearance_m: float, restricted_m: float
) -> dict[str, float]:
    """Return the metrics of one flight.

    Parameters
    ----------
    record : columns :data:`COLUMNS`.
    agl_ref_m : height that the controller holds.
    low_clearance_m : clearance below it counts as low.
    restricted_m : readings from this one on make the restricted tracking error.

    Returns
    -------
    By name of :data:`NAMES`. The network's error is NaN where it did not run.

    Notes
    -----
    The tracking error is that of the rangefinder, as published: sqrt(mean((range - reference)^2)).
    Clearances are of the body's true height over the ground, so that sensor noise does not move a
    minimum.
    """
    reading, clearance = record["range_m"], record["agl_m"]
    row_s = float(np.median(np.diff(record["t_s"])))
    # by the reading, as the firmware's cutover: the zone in which a network may act
    far = reading[reading >= restricted_m]
    return {
        # NaN beyond the rangefinder's reach
        "agl_rms_m": float(np.sqrt(np.nanmean((reading - agl_ref_m) ** 2))),
        "gyro_rms_rad_s": gyro_rms(record),
        "clearance_mean_m": float(clearance.mean()),
        "clearance_p5_m": float(np.percentile(clearance, 5)),
        "clearance_min_m": float(clearance.min()),
        "low_clearance_s": float((clearance < low_clearance_m).sum() * row_s),
        "agl_rms_restricted_m": (
            float(np.sqrt(np.mean((far - agl_ref_m) ** 2))) if len(far) else float("nan")
        ),
        "estimate_mae": float(np.mean(np.abs(record["ge_estimate"] - record["ge_factor"]))),
        "network_mae": float(np.mean(np.abs(record["ge_shadow"] - record["ge_factor"]))),
        "contact_s": float(record["contact"].sum() * row_s),
    }
