"""Channels: what of a model a flight can be held against."""

from __future__ import annotations

from ges.diagnose.prepare.align import Prepared
from ges.diagnose.types.model import Model

FORCE = ("force_x", "force_y", "force_z")
MOMENT = ("moment_x", "moment_y", "moment_z")
ACC = ("acc_x", "acc_y", "acc_z")
DRIVE = ("drive_1", "drive_2", "drive_3", "drive_4")
UNITS = {
    **dict.fromkeys(FORCE + ACC, "N"),
    **dict.fromkeys(MOMENT, "Nm"),
    **dict.fromkeys(DRIVE, "rad_s"),
    "range": "m",
}


def channels(flight: Prepared, model: Model) -> tuple[str, ...]:
    """Channels that a flight can speak about; the rangefinder over flat ground alone: elsewhere it
    sees a patch, not a point.
    """
    driven = flight.has("rotor_speed") or flight.has("command")
    attitude = flight.has("attitude")
    found: list[str] = []
    if driven and attitude and flight.has("velocity"):
        found += ["force_z"] if "attitude" in flight.derived else FORCE
    if driven:
        found += [
            name
            for name, column in zip(ACC, ("acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2"), strict=True)
            if column in flight.columns
        ]
    if driven and (flight.has("gyro") or attitude) and "moments_of_inertia" in model.known:
        found += MOMENT if "torque" in model.known else MOMENT[:2]
    if flight.has("rotor_speed") and flight.has("command"):
        found += DRIVE
    if flight.has("range") and "p_z_m" in flight.columns and attitude:
        found.append("range")
    return tuple(found)
