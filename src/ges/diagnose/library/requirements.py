"""What a recording can show: candidates, and what would have to be logged for the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

from ges.conventions import SPECIFIC_FORCE
from ges.diagnose.library.candidates import Candidate, flight_envelope
from ges.diagnose.library.grids import library
from ges.diagnose.prepare.align import Prepared, no_attitude_derived
from ges.diagnose.prepare.channels import FORCE, channels
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

Flights = Sequence[Prepared]
SIDEWAYS = ("force_x", "force_y")
"""Channels in which drag acts."""


@dataclasses.dataclass(frozen=True)
class Requirement:
    """A signal that effects need (``needs`` of their descriptors).

    Attributes
    ----------
    is_met : whether flights have it.
    message : what to say where they have not: ``needs ...``, then why, after a semicolon.
    """

    is_met: Callable[[Flights, Model], bool]
    message: str


def _all_have(stream: str) -> Callable[[Flights, Model], bool]:
    return lambda flights, model: all(f.has(stream) for f in flights)


def _flown_over_an_edge(flight: Prepared, model: Model) -> bool:
    if model.terrain.kind == "flat" or not flight.has("position"):
        return False
    ground = model.terrain.at(flight.columns["p_x_m"], flight.columns["p_y_m"])
    return bool(ground.slope.max() > settings.library.edge_slope)


VOLTAGE = (
    "needs a logged battery voltage (battery_V); without it a sagging battery cannot be told apart"
)
REQUIREMENTS: Mapping[str, Requirement] = {
    "attitude": Requirement(
        lambda flights, model: no_attitude_derived(flights), "needs a measured attitude"
    ),
    "height": Requirement(
        lambda flights, model: all("p_z_m" in f.columns or f.has("range") for f in flights),
        "needs a logged height (p_z_m or range_m)",
    ),
    "range": Requirement(
        lambda flights, model: any(f.has("range") and "p_z_m" in f.columns for f in flights),
        "needs a rangefinder and a logged height (range_m, p_z_m)",
    ),
    "smooth_ground": Requirement(
        lambda flights, model: not any(_flown_over_an_edge(f, model) for f in flights),
        "needs ground without edges; the cone of a rangefinder rounds them off as a lag would",
    ),
    "accelerometer": Requirement(
        lambda flights, model: any(n in f.columns for f in flights for n in SPECIFIC_FORCE),
        "needs a logged accelerometer (acc_x_m_s2 ...)",
    ),
    "voltage": Requirement(_all_have("battery"), VOLTAGE),
    "voltage_or_rotor_speed": Requirement(
        lambda flights, model: all(f.has("battery") or f.has("rotor_speed") for f in flights),
        VOLTAGE,
    ),
    "velocity": Requirement(
        _all_have("velocity"), "needs a logged velocity (all of v_x_m_s, v_y_m_s, v_z_m_s)"
    ),
    "position": Requirement(_all_have("position"), "needs a logged position (p_x_m ...)"),
    "rates": Requirement(_all_have("gyro"), "needs a logged gyro (omega_x_rad_s ...)"),
    "rotor_speed_or_command": Requirement(
        lambda flights, model: all(f.has("rotor_speed") or f.has("command") for f in flights),
        "needs rotor speeds or motor commands (rotor_speed_1_rad_s ..., u_1 ...)",
    ),
    "rotor_speed": Requirement(
        _all_have("rotor_speed"), "needs logged rotor speeds (rotor_speed_1_rad_s ...)"
    ),
    "command": Requirement(_all_have("command"), "needs logged motor commands (u_1 ...)"),
    "cause_of_command": Requirement(
        lambda flights, model: any(
            f.has(stream) for f in flights for stream in ("rotor_speed", "reference", "excitation")
        ),
        "needs rotor speeds or the controller's references; its responses to disturbances look like"
        " this effect",
    ),
}
"""By the names that descriptors use."""


def unmet_requirement(name: str, flights: Flights, model: Model) -> str:
    """Return what these flights lack to show an effect.

    Parameters
    ----------
    name : of the effect.
    flights : prepared recordings.
    model : of the vehicle.

    Returns
    -------
    ``needs ...``; '' where nothing is missing.
    """
    return first_unmet(effect_table.get(name).needs, flights, model)


def first_unmet(needs: Iterable[str], flights: Flights, model: Model) -> str:
    """Return the first of some requirements that these flights do not meet.

    Parameters
    ----------
    needs : keys of :data:`REQUIREMENTS`.
    flights : prepared recordings.
    model : of the vehicle.

    Returns
    -------
    ``needs ...``; '' where all are met.
    """
    requirements = (REQUIREMENTS[need] for need in needs)
    return next((r.message for r in requirements if not r.is_met(flights, model)), "")


def unmet_reference(name: str, flights: Flights) -> str:
    """Return why flights without references cannot show an effect that a controller mimics.

    Parameters
    ----------
    name : of the effect.
    flights : prepared recordings.

    Returns
    -------
    ``needs ...``; '' where nothing is missing.

    Notes
    -----
    In closed loop only references, as instruments, explain a controller's motion.
    """
    dynamic = effect_table.get(name).feedback == "dynamic"
    if not dynamic or any(f.has("reference") for f in flights):
        return ""
    return (
        "needs the references that the controller followed; its responses to disturbances look"
        " like this effect"
    )


def untestable_drags(flights: Flights, model: Model) -> dict[str, str]:
    """Return the drags that these flights cannot show, each with what would have to be logged.

    Parameters
    ----------
    flights : prepared recordings.
    model : of the vehicle.

    Notes
    -----
    Every multirotor has some drag. Whatever else pushes sideways has to be separated from it. Drags
    are effects that need the velocity, and act in forces alone, along x and y among them.
    """
    drags = (
        name
        for name, effect in effect_table.table().items()
        if {"velocity"} <= set(effect.needs)
        and set(SIDEWAYS) <= set(effect.channels) <= set(FORCE)
        and not (effect.prerequisites or effect.settled)
    )
    reasons = {name: unmet_requirement(name, flights, model) for name in drags}
    return {name: reason for name, reason in reasons.items() if reason}


def candidates_of(
    flights: Sequence[Prepared],
    base: Model,
    taken: Sequence[str] = (),
    only: Sequence[str] | None = None,
) -> list[Candidate]:
    """Return the candidates that can act on a model and be seen in these flights.

    Parameters
    ----------
    flights : prepared recordings.
    base : the model they are tested on.
    taken : names that are left out. With any, only effects with a prerequisite in ``base`` are
        listed.
    only : names that are allowed; None allows all.
    """
    return [
        c
        for c in library(base, flight_envelope(flights, base.radius_m)).values()
        if c.name not in taken
        and (only is None or c.name in only)
        and not unmet_requirement(c.name, flights, base)
        and (set(c.prerequisites) & set(base.effects) or c.stands_alone and not taken)
    ]


def needs_attitude(name: str) -> bool:
    """Return whether only a measured attitude or measured rates can show an effect.

    Parameters
    ----------
    name : of the effect.

    Notes
    -----
    A derived attitude shows the slow balance alone.
    """
    return "attitude" in effect_table.get(name).needs


def silent_channels(flights: Sequence[Prepared], model: Model) -> dict[str, str]:
    """Return the channels that no flight has, each with what to log or to state.

    Parameters
    ----------
    flights : prepared recordings.
    model : of the vehicle.
    """
    logged = {name for f in flights for name in channels(f, model)}
    pose = "log velocity and attitude (v_x_m_s ..., q_w ...)"
    gyro = "log the gyro (omega_x_rad_s ...)"
    reasons = {
        "force_x": "log the attitude (q_w ...)" if "force_z" in logged else pose,
        "force_z": pose,
        "acc_x": "log the accelerometer (acc_x_m_s2 ...)",
        "moment_x": gyro
        if "moments_of_inertia" in model.stated_parts
        else "state inertia_kg_m2 in the vehicle file",
        "moment_z": (
            gyro
            if "torque" in model.stated_parts
            else "state torque_coefficient_Nm_s2 in the vehicle file"
        ),
        "drive_1": "log rotor speeds and motor commands, both (rotor_speed_1_rad_s ..., u_1 ...)",
        "range": "log a rangefinder and the height (range_m, p_z_m)",
    }
    return {name: why for name, why in reasons.items() if name not in logged}


def silent_channels_words(off: Mapping[str, str]) -> str:
    """Return a sentence on what a verdict of *nothing proven* does not cover.

    Parameters
    ----------
    off : of :func:`silent_channels`.

    Returns
    -------
    '' for full logs.
    """
    parts = []
    if "force_z" in off:
        parts.append(f"nothing of drag, inflow, loads and the ground ({off['force_z']})")
    elif "force_x" in off:
        parts.append(f"nothing of drag and wind ({off['force_x']})")
    if "moment_x" in off:
        parts.append(f"nothing of moments ({off['moment_x']})")
    return f" They say {' and '.join(parts)}." if parts else ""
