"""What the formats share: plain numbers of a vehicle, and XML from untrusted files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from xml.etree.ElementTree import Element, ParseError

import defusedxml.ElementTree
import numpy as np
from defusedxml.common import DefusedXmlException

from ges.conventions import GRAVITY_M_S2
from ges.errors import GesError, UsageError
from ges.simulator import effects as effect_table
from ges.vehicle import scaling
from ges.vehicle.file import Vehicle

# effects that correct a nominal parameter, which every format has
FOLDED = ("thrust_scale", "torque_coefficient", "inertia", "motor_lag", "rotor_saturation")


UPRIGHT = math.cos(math.radians(5.0))
"""Least upward part of the axis of a rotor that formats without axes take as upright."""


@dataclasses.dataclass(frozen=True)
class Export:
    """A vehicle in another simulator's format.

    Attributes
    ----------
    text : content of the file.
    remarks : what the format cannot express, or what stands in its place, one sentence each.
    """

    text: str
    remarks: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Plain:
    """A multirotor as plain numbers, with corrections of nominal parameters applied.

    Attributes
    ----------
    name : name of the vehicle.
    mass_kg : mass.
    inertia_kg_m2 : (3,) about the body axes.
    hubs_m : (n, 3) from the centre of mass, body frame; an offset of the centre is applied.
    radius_m : mean over the rotors.
    spin : (n,) +1 ccw, -1 cw, seen from above.
    thrust_N_s2 : (n,) thrust coefficient of each rotor, with its losses.
    torque_Nm_s2 : (n,) reaction torque of each rotor over squared speed, with its losses.
    lag_up_s, lag_down_s : time constants of the drive, speeding up and slowing down.
    top_speed_rad_s : at full command.
    rho_kg_m3 : density of the air.
    effects : effects that are not applied to the numbers above.
    remarks : numbers that the vehicle file leaves out and that were estimated.
    """

    name: str
    mass_kg: float
    inertia_kg_m2: np.ndarray
    hubs_m: np.ndarray
    radius_m: float
    spin: np.ndarray
    thrust_N_s2: np.ndarray
    torque_Nm_s2: np.ndarray
    lag_up_s: float
    lag_down_s: float
    top_speed_rad_s: float
    rho_kg_m3: float
    effects: Mapping[str, Mapping[str, float]]
    remarks: tuple[str, ...]

    @property
    def hover_rad_s(self) -> float:
        """Rotor speed at which equal speeds of all rotors carry the weight."""
        return math.sqrt(self.mass_kg * GRAVITY_M_S2 / float(np.sum(self.thrust_N_s2)))

    @property
    def mean_thrust_N_s2(self) -> float:
        """Mean thrust coefficient, for a format that has one for all rotors."""
        return float(np.mean(self.thrust_N_s2))

    @property
    def mean_torque_Nm_s2(self) -> float:
        """Mean torque coefficient, for a format that has one for all rotors."""
        return float(np.mean(self.torque_Nm_s2))

    def effect(self, name: str, parameter: str) -> float:
        """Look up a parameter of an effect.

        Parameters
        ----------
        name, parameter : of the effect, and of its number.

        Returns
        -------
        The value; 0 where the effect is off.
        """
        return self.effects.get(name, {}).get(parameter, 0.0)


def plain(vehicle: Vehicle) -> Plain:
    """Convert a vehicle file to plain numbers.

    Parameters
    ----------
    vehicle : the vehicle.

    Returns
    -------
    The numbers; what the file leaves out is estimated by :mod:`ges.vehicle.scaling`.

    Raises
    ------
    GesError
        When a rotor is canted or makes no thrust.
    """
    for i, rotor in enumerate(vehicle.rotors, 1):
        if rotor.unit_axis[2] < UPRIGHT:
            raise GesError(
                f"rotor {i} of vehicle '{vehicle.name}' is canted; models are written of upright"
                " rotors"
            )
    numbers = vehicle.parameters()
    effects = {
        name: effect_table.get(name).completed(values)
        for name, values in vehicle.effect_values().items()
    }
    rotors = vehicle.rotor_arrays()
    hubs = np.stack([rotors["x_m"], rotors["y_m"], rotors["z_m"]], axis=1)
    moved = effects.get("cg_offset", {})
    # seen from a centre of mass further ahead, every hub is further behind
    hubs = hubs - (moved.get("x_m", 0.0), moved.get("y_m", 0.0), 0.0)
    weak = effects.get("weak_rotor", {})
    losses = np.array([weak.get(f"loss_{i + 1}", 0.0) for i in range(len(hubs))])
    scale = effects.get("thrust_scale", {}).get("scale", 0.0)
    thrust = (1.0 + scale - losses) * rotors["thrust"] * numbers["thrust_coefficient_N_s2"]
    if not np.all(thrust > 0):
        raise GesError(
            f"rotor {int(np.argmin(thrust)) + 1} of vehicle '{vehicle.name}' makes no thrust"
            " (weak_rotor, thrust_scale); no simulator's format expresses that"
        )
    inertia, torque, lag_s, top, remarks = _estimated(vehicle, hubs, thrust)
    change = effects.get("inertia", {})
    lags = effects.get("motor_lag", {})
    return Plain(
        vehicle.name,
        numbers["mass_kg"],
        inertia * [1.0 + change.get(axis, 0.0) for axis in ("xx", "yy", "zz")],
        hubs,
        float(np.mean(rotors["radius_m"])),
        rotors["spin"],
        thrust,
        torque
        * rotors["torque"]
        * (1.0 + effects.get("torque_coefficient", {}).get("scale", 0.0) - losses),
        # simulators divide by their time constants
        max(lag_s + lags.get("up_s", 0.0), 1e-3),
        max(lag_s + lags.get("down_s", 0.0), 1e-3),
        top * effects.get("rotor_saturation", {}).get("share", 1.0),
        numbers["rho_kg_m3"],
        {name: values for name, values in effects.items() if name not in FOLDED},
        tuple(remarks),
    )


def _estimated(
    vehicle: Vehicle, hubs: np.ndarray, thrust: np.ndarray
) -> tuple[np.ndarray, float, float, float, list[str]]:
    """Give inertia, torque coefficient, lag and top speed, estimated where they are missing."""
    diameter_m = 2.0 * float(np.mean([r.radius_m.value for r in vehicle.rotors]))
    inertia, torque = vehicle.inertia_kg_m2, vehicle.torque_coefficient_Nm_s2
    lag, top = vehicle.motor_time_constant_s, vehicle.max_rotor_speed_rad_s
    lacking = []
    if inertia is None:
        lacking.append("inertia_kg_m2")
        inertia = scaling.inertia(vehicle.mass_kg.value, scaling.arm_m(hubs[:, 0], hubs[:, 1]))
    if torque is None:
        lacking.append("torque_coefficient_Nm_s2")
        torque = scaling.torque_coefficient(float(np.mean(thrust)), diameter_m)
    if lag is None:
        lacking.append("motor_time_constant_s")
        lag = scaling.motor_time_constant(diameter_m)
    # twice the thrust is sqrt(2) the speed
    top_rad_s = top.value if top else math.sqrt(2.0) * vehicle.hover_speed_rad_s()
    if top is None:
        lacking.append("max_rotor_speed_rad_s (twice the hover thrust)")
    values = np.array([inertia.xx, inertia.yy, inertia.zz])
    remarks = [
        f"{key} is not in the vehicle file: estimated from mass and size." for key in lacking
    ]
    return values, torque.value, lag.value, top_rad_s, remarks


def without(plain: Plain, expressed: Iterable[str], target: str) -> list[str]:
    """List the effects that a format cannot express.

    Parameters
    ----------
    plain : the vehicle.
    expressed : names of effects that the format has.
    target : name of the format, for people.

    Returns
    -------
    One sentence for each effect that is left out.
    """
    expressible = {"cg_offset", "weak_rotor", *expressed}
    return [
        f"{target} has no {name} ({effect_table.get(name).title}): left out."
        for name in plain.effects
        if name not in expressible
    ]


def drag_at(lever: float, plain: Plain, target: str) -> list[str]:
    """Say that the rotor drag of a format acts elsewhere.

    Parameters
    ----------
    lever : of the format's drag: 1 at the hubs, 0 at the centre of mass.
    plain : the vehicle.
    target : name of the format, for people.

    Returns
    -------
    One sentence, or none where it acts where the vehicle's does.
    """
    own = plain.effect("rotor_drag", "lever")
    if not plain.effect("rotor_drag", "k_kg") or own == lever:
        return []
    where = "the hubs" if lever else "the centre of mass"
    return [
        f"The rotor drag of {target} acts at {where}: its moment is not that of a lever of {own:g}."
    ]


def one_thrust(plain: Plain, target: str) -> list[str]:
    """Say that a format takes the mean where rotors differ in thrust.

    Parameters
    ----------
    plain : the vehicle.
    target : name of the format, for people.

    Returns
    -------
    One sentence; empty where all rotors are alike.
    """
    if np.allclose(plain.thrust_N_s2, plain.mean_thrust_N_s2, rtol=1e-6):
        return []
    return [f"{target} has one thrust coefficient for all rotors: the mean of four that differ."]


def rotors_at(plain: Plain, corners: Sequence[tuple[float, float]], refusal: str) -> list[int]:
    """Find the rotor at each corner of an X.

    Parameters
    ----------
    plain : the vehicle.
    corners : x and y of the corners, at any distance.
    refusal : what the format is written for, the end of the sentence.

    Returns
    -------
    Number of the rotor for each corner, from 0.

    Raises
    ------
    GesError
        When the vehicle is no X quadrotor.
    """
    hubs, places = plain.hubs_m[:, 0] + 1j * plain.hubs_m[:, 1], [complex(*xy) for xy in corners]
    # differences of angles within pi
    gaps = np.abs(np.angle(hubs[:, None] * np.conj(places)))
    order = np.argmin(gaps, axis=0).tolist()
    # one rotor nearest to two places
    if len(hubs) != len(corners) or len(set(order)) < len(corners):
        raise GesError(f"vehicle '{plain.name}' is no X quadrotor{refusal}")
    return order


def parse_xml(data: bytes, name: str) -> Element:
    """Parse XML without entities, external references or endless nesting.

    Parameters
    ----------
    data : the file.
    name : name of the file, for messages.

    Returns
    -------
    Root element.

    Raises
    ------
    UsageError
        When it is no XML.
    GesError
        When it defines entities or nests without end.
    """
    try:
        return defusedxml.ElementTree.fromstring(data)
    except ParseError as error:
        raise UsageError(f"{name} is not XML: {error}") from None
    except (DefusedXmlException, RecursionError):
        raise GesError(
            f"{name} defines entities or nests without end, which no vehicle needs; it is not read"
        ) from None
    except (ValueError, LookupError) as error:
        raise UsageError(f"{name} is not XML in an encoding that is known: {error}") from None


def number(text: str | None, what: str, name: str) -> float:
    """Read a finite number of a file.

    Parameters
    ----------
    text : as it stands in the file; None where it is missing.
    what, name : what it is and the name of the file, for messages.

    Raises
    ------
    UsageError
        When it is missing, or no finite number.
    """
    if text is None or not text.strip():
        raise UsageError(f"{name}: {what} is missing; add it")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"{name}: {what} is '{text.strip()[:40]}', no finite number")
    return value
