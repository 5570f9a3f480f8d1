"""Channels: the quantities of a model that a flight can be compared with."""

from __future__ import annotations

import math

from ges.conventions import SPECIFIC_FORCE, rotor_columns
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model, block_of

FORCE = ("force_x", "force_y", "force_z")
MOMENT = ("moment_x", "moment_y", "moment_z")
ACC = ("acc_x", "acc_y", "acc_z")
_UNITS = {"force": "N", "acc": "N", "moment": "Nm", "drive": "rad_s", "range": "m"}


def unit_of(channel: str) -> str:
    """Return the unit of a channel as names carry it.

    Parameters
    ----------
    channel : ``moment_x``, which gives ``Nm``.
    """
    return _UNITS[block_of(channel)]


def drive(n_rotors: int) -> tuple[str, ...]:
    """Return the channels of the rotor speeds.

    Parameters
    ----------
    n_rotors : number of rotors.
    """
    return rotor_columns("drive_{}", n_rotors)


def channels(flight: Prepared, model: Model) -> tuple[str, ...]:
    """Return the channels in which a flight can be compared with a model.

    Parameters
    ----------
    flight : prepared recording.
    model : of the vehicle; moments need the inertia that its file states.

    Notes
    -----
    The rangefinder counts over flat ground alone. Elsewhere it sees a patch, not a point.
    """
    driven = flight.has("rotor_speed") or flight.has("command")
    attitude = flight.has("attitude")
    names: list[str] = []
    if driven and attitude and flight.has("velocity"):
        names += ["force_z"] if "attitude" in flight.derived else FORCE
    if driven:
        names += [
            name
            for name, column in zip(ACC, SPECIFIC_FORCE, strict=True)
            if column in flight.columns
        ]
    if driven and (flight.has("gyro") or attitude) and "moments_of_inertia" in model.stated_parts:
        names += MOMENT if "torque" in model.stated_parts else MOMENT[:2]
    if flight.has("rotor_speed") and flight.has("command"):
        names += drive(model.n_rotors)
    if flight.has("range") and "p_z_m" in flight.columns and attitude:
        names.append("range")
    return tuple(names)


def least_rms(block: str, whole: float) -> float:
    """Return the practical significance threshold of a block of channels.

    Parameters
    ----------
    block : ``force``, ``acc``, ``moment``, ``drive`` or ``range``.
    whole : reference scale of the block, in the unit of its channels.

    Returns
    -------
    Rms below which no model is right; infinite for other blocks.

    Notes
    -----
    No thrust is right to less than a share: of all rotors in a force, of one of four in a moment.
    Thrust goes as the square of a speed, which is right to half of that share.
    """
    least = settings.decide.least_thrust_share
    if block == "range":
        return settings.prepare.height_error_m
    shares = {"force": least, "acc": least, "moment": 0.25 * least, "drive": 0.5 * least}
    return shares.get(block, math.inf) * whole


def least_rms_in(channel: str, model: Model) -> float:
    """Return the practical significance threshold of a channel.

    Parameters
    ----------
    channel : ``force_x``.
    model : for the reference scale.

    Returns
    -------
    Rms in the channel's unit, of :func:`least_rms`.
    """
    return least_rms(block_of(channel), model.reference_scale(channel))
