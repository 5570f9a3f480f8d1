"""Channels: what of a model a flight can be held against."""

from __future__ import annotations

from ges.conventions import rotor_columns
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.types.model import Model, block_of

FORCE = ("force_x", "force_y", "force_z")
MOMENT = ("moment_x", "moment_y", "moment_z")
ACC = ("acc_x", "acc_y", "acc_z")
_UNITS = {
    **dict.fromkeys(FORCE + ACC, "N"),
    **dict.fromkeys(MOMENT, "Nm"),
    "drive": "rad_s",
    "range": "m",
}


def unit_of(channel: str) -> str:
    """Unit of a channel as names carry it."""
    return _UNITS.get(channel) or _UNITS[block_of(channel)]


def drive(n_rotors: int) -> tuple[str, ...]:
    """Channels of the speeds of so many rotors."""
    return rotor_columns("drive_{}", n_rotors)


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
    if driven and (flight.has("gyro") or attitude) and "moments_of_inertia" in model.stated_parts:
        found += MOMENT if "torque" in model.stated_parts else MOMENT[:2]
    if flight.has("rotor_speed") and flight.has("command"):
        found += drive(model.n_rotors)
    if flight.has("range") and "p_z_m" in flight.columns and attitude:
        found.append("range")
    return tuple(found)
