"""Vehicles of gym-pybullet-drones (Panerati et al. 2021): URDF with an element ``<properties>``.

Its physics (``BaseAviary.py``): T_i = kf n_i^2 and a reaction torque km n_i^2, n in revolutions a
minute. Torques have the signs -, +, -, + about z for propellers 0 to 3. Rotor speeds follow their
commands at once, up to thrust2weight. Ground effect, drag and downwash exist in the modes
``PYB_GND``, ``PYB_DRAG`` and ``PYB_DW`` alone, so they are read as comments.
"""

from __future__ import annotations

import math
import re
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ges.conventions import GRAVITY_M_S2
from ges.errors import GesError, UsageError
from ges.simulator import effects as effect_table
from ges.vehicle.datasheet import Datasheet
from ges.vehicle.file import Vehicle, parse_vehicle
from ges.vehicle.formats.neutral import (
    Export,
    Plain,
    drag_at,
    number,
    one_thrust,
    parse_xml,
    plain,
    rotors_at,
    without,
)
from ges.vehicle.propeller import Propeller

RAD_S_PER_RPM = math.pi / 30.0
SPINS = ("ccw", "cw", "ccw", "cw")
# Propellers 0 to 3 stand front left, back left, back right, front right.
CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
_EXPRESSED = ("rotor_drag", "axial_inflow", "ground_effect")


def read(data: bytes, name: str, prop: Propeller | None = None) -> Datasheet:
    """Read a vehicle from a URDF of gym-pybullet-drones.

    Parameters
    ----------
    data : the file.
    name : name of the file, for messages.
    prop : propellers, in place of ``prop_radius``.

    Returns
    -------
    The vehicle with the source of each number.

    Raises
    ------
    GesError
        When it is no quadrotor of that simulator.
    UsageError
        When a number or a link is missing.
    """
    root = parse_xml(data, name)
    properties = root.find("properties")
    if root.tag != "robot" or properties is None:
        raise GesError(
            f"{name} has no <properties kf=... km=...>; of URDF files those of gym-pybullet-drones"
            " can be read, others say nothing of rotors"
        )
    values = {key: number(text, key, name) for key, text in properties.attrib.items()}
    for key in ("kf", "km", "thrust2weight"):
        if not values.get(key, 0.0) > 0:
            raise UsageError(f"{name}: properties has no positive {key}; add it")
    base = _link(root, "base_link", name)
    mass = _attribute(base, "inertial/mass", "value", name)
    moments = {k: _attribute(base, "inertial/inertia", f"i{k}", name) for k in ("xx", "yy", "zz")}
    hubs = _hubs(root, base, name)
    if prop is not None:
        radius_m = prop.radius_m
    else:
        radius_m = number(properties.get("prop_radius"), "prop_radius (or give --prop)", name)
    # k n^2 = (k / (pi / 30)^2) w^2
    thrust = values["kf"] / RAD_S_PER_RPM**2
    # at top speed four rotors make thrust2weight times the weight
    top = math.sqrt(values["thrust2weight"] * mass * GRAVITY_M_S2 / (4 * thrust))
    content = {
        "name": root.get("name") or name.removesuffix(".urdf"),
        "mass_kg": mass,
        "inertia_kg_m2": moments,
        "rotors": [
            {"x_m": x, "y_m": y, "z_m": z, "radius_m": radius_m, "spin": spin}
            for (x, y, z), spin in zip(hubs.tolist(), SPINS, strict=True)
        ],
        "thrust_coefficient_N_s2": thrust,
        "torque_coefficient_Nm_s2": values["km"] / RAD_S_PER_RPM**2,
        # a vehicle file asks for a positive one
        "motor_time_constant_s": 0.001,
        "max_rotor_speed_rad_s": top,
    }
    sources = {
        "rotors": "Origins of prop0_link to prop3_link; spins as BaseAviary turns them (its RACE"
        " model turns all the other way).",
        "thrust_coefficient_N_s2": "kf, per squared rad/s.",
        "torque_coefficient_Nm_s2": "km, per squared rad/s.",
        "motor_time_constant_s": "Rotor speeds follow their commands at once there.",
        "max_rotor_speed_rad_s": f"thrust2weight {values['thrust2weight']:g}.",
        "rho_kg_m3": "Not in the file; air at sea level, 15 degrees.",
    }
    origin = (
        f"Read by ges vehicle from {name}, of gym-pybullet-drones; exact for its mode Physics.PYB."
    )
    return Datasheet(parse_vehicle(content, name), origin, sources, tuple(_modes(values)))


def _link(root: Element, wanted: str, name: str) -> Element:
    for link in root.iterfind("link"):
        if link.get("name") == wanted:
            return link
    raise UsageError(f"{name} has no link '{wanted}'; gym-pybullet-drones needs it")


def _attribute(link: Element, path: str, key: str, name: str) -> float:
    element = link.find(path)
    return number(None if element is None else element.get(key), f"{path} {key}", name)


def _origin(link: Element, name: str) -> np.ndarray:
    element = link.find("inertial/origin")
    text = element.get("xyz", "") if element is not None else "0 0 0"
    row = [number(part, "an origin", name) for part in text.split()]
    if len(row) != 3:
        raise UsageError(f"{name}: the origin '{text[:40]}' is not x y z")
    return np.array(row)


def _hubs(root: Element, base: Element, name: str) -> np.ndarray:
    """Read the hubs (4, 3) from the centre of mass."""
    count = sum(bool(re.fullmatch(r"prop\d+_link", x.get("name", ""))) for x in root.iter("link"))
    if count != 4:
        raise GesError(
            f"{name} has {count} propellers; the spins that gym-pybullet-drones gives them are"
            " known of four"
        )
    links = [_link(root, f"prop{i}_link", name) for i in range(4)]
    return np.array([_origin(link, name) for link in links]) - _origin(base, name)


def _modes(values: dict[str, float]) -> list[str]:
    """List what acts in other modes only, as lines for ``effects``."""
    xy, z, ground = (values.get(k, 0.0) for k in ("drag_coeff_xy", "drag_coeff_z", "gnd_eff_coeff"))
    remarks = []
    if xy or z:
        remarks.append(
            f"In the modes with drag add to effects: rotor_drag: {{k_kg: {xy:g}, lever: 0}},"
            f" axial_inflow: {{k_kg: {z:g}}}."
        )
    # Cheeseman and Bennett's f - 1 is 1/15 at one radius, (R / 4 h)^2 is 1/16
    if ground:
        remarks.append(
            f"In the modes with ground effect thrust gains {ground:g} (R / 4 h)^2; add to effects:"
            f" ground_effect: {{amplitude: {min(0.9375 * ground, 12.0):.4g}, high: 10}} (equal at"
            " one rotor radius)."
        )
    return remarks


def write(vehicle: Vehicle) -> Export:
    """Write a vehicle as a URDF for gym-pybullet-drones.

    Parameters
    ----------
    vehicle : the vehicle.

    Raises
    ------
    GesError
        When it is no X quadrotor of upright rotors.
    """
    p = plain(vehicle)
    target = "gym-pybullet-drones"
    remarks = [*p.remarks, *one_thrust(p, target), *without(p, _EXPRESSED, target)]
    remarks.append("Rotor speeds follow their commands at once: the motors' lag is left out.")
    order, turned = _order(p)
    remarks += turned
    gain = _ground_gain(p)
    if gain:
        remarks.append(
            "The ground effect is that of the form 1 + G (R / 4 h)^2 with equal gain at one rotor"
            " radius; it flies in the modes PYB_GND only."
        )
    if p.effect("rotor_drag", "k_kg") or p.effect("axial_inflow", "k_kg"):
        remarks.append("Drag flies in the modes PYB_DRAG only.")
    remarks += drag_at(0.0, p, "gym-pybullet-drones")
    hubs = p.hubs_m[order]
    # that simulator's arms are those of a square
    arm_m = math.sqrt(2.0) * float(np.abs(hubs[:, :2]).mean())
    weight = p.mass_kg * GRAVITY_M_S2
    properties = {
        "arm": arm_m,
        "kf": p.mean_thrust_N_s2 * RAD_S_PER_RPM**2,
        "km": p.mean_torque_Nm_s2 * RAD_S_PER_RPM**2,
        "thrust2weight": 4 * p.mean_thrust_N_s2 * p.top_speed_rad_s**2 / weight,
        "max_speed_kmh": 30.0,
        "gnd_eff_coeff": gain,
        "prop_radius": p.radius_m,
        "drag_coeff_xy": p.effect("rotor_drag", "k_kg"),
        "drag_coeff_z": p.effect("axial_inflow", "k_kg"),
        "dw_coeff_1": 0.0,
        "dw_coeff_2": 0.16,
        "dw_coeff_3": -0.11,
    }
    attributes = " ".join(f'{key}="{value:.9g}"' for key, value in properties.items())
    shape = f'<geometry><cylinder radius="{arm_m:.6g}" length="{0.5 * arm_m:.6g}"/></geometry>'
    lines = [
        '<?xml version="1.0" ?>',
        # XML has no comment with two hyphens in it
        f"<!-- {escape(p.name).replace('--', '- -')}, written by ges vehicle. -->",
        *(f"<!-- {escape(remark).replace('--', '- -')} -->" for remark in remarks),
        f"<robot name={quoteattr(p.name)}>",
        f"  <properties {attributes}/>",
        *_link_lines("base_link", np.zeros(3), p.mass_kg, p.inertia_kg_m2, shape),
    ]
    for i, hub in enumerate(hubs):
        lines += _fixed_lines(f"prop{i}", hub)
    lines += _fixed_lines("center_of_mass", np.zeros(3))
    return Export("\n".join([*lines, "</robot>"]) + "\n", tuple(remarks))


def _order(p: Plain) -> tuple[list[int], list[str]]:
    """Give the rotors in that simulator's order, front left first, and what does not fit it."""
    order = rotors_at(p, CORNERS, "; gym-pybullet-drones' urdf is written for those")
    spins = ["ccw" if p.spin[k] > 0 else "cw" for k in order]
    listed = ", ".join(str(k + 1) for k in order)
    remarks = [f"Propellers 0 to 3 are rotors {listed} of the vehicle file."]
    if tuple(spins) != SPINS:
        remarks.append(
            "Its rotors turn the other way than BaseAviary turns them: yaw comes out reversed."
        )
    return order, remarks


def _ground_gain(p: Plain) -> float:
    """Compute G of 1 + G (R / 4 h)^2 with the vehicle's ground-effect gain at one radius."""
    if "ground_effect" not in p.effects:
        return 0.0
    hubs = {
        f"rotor_{i + 1}_{axis}_m": float(p.hubs_m[i, k])
        for i in range(4)
        for k, axis in enumerate("xyz")
    }
    numbers = {**hubs, "thrust_coefficient_N_s2": p.mean_thrust_N_s2, "mass_kg": p.mass_kg}
    numbers |= {f"rotor_{i + 1}_radius_m": p.radius_m for i in range(4)}
    speeds = {f"rotor_speed_{i + 1}_rad_s": np.array([p.hover_rad_s]) for i in range(4)}
    # hovering level with the rotors one radius above the ground
    at = {"t_s": np.zeros(1), "p_z_m": np.array([p.radius_m - p.hubs_m[:, 2].mean()]), **speeds}
    samples = effect_table.Samples.from_columns(at)
    effects = {"ground_effect": p.effects["ground_effect"]}
    near, free = (effect_table.replay(numbers, samples, e).force_N[0, 2] for e in (effects, {}))
    # (R / 4 h)^2 = 1/16 there
    return 16.0 * float(near / free - 1.0)


def _link_lines(
    name: str, origin: np.ndarray, mass: float, inertia: np.ndarray, shape: str = ""
) -> list[str]:
    place = " ".join(f"{x + 0.0:.9g}" for x in origin)
    ixx, iyy, izz = (f"{x:.9g}" for x in inertia)
    lines = [
        f'  <link name="{name}">',
        "    <inertial>",
        f'      <origin rpy="0 0 0" xyz="{place}"/>',
        f'      <mass value="{mass:.9g}"/>',
        f'      <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>',
        "    </inertial>",
    ]
    if shape:
        lines += [
            f'    <{kind}><origin rpy="0 0 0" xyz="0 0 0"/>{shape}</{kind}>'
            for kind in ("visual", "collision")
        ]
    return [*lines, "  </link>"]


def _fixed_lines(name: str, origin: np.ndarray) -> list[str]:
    """Write a link without mass, fixed to the base."""
    return [
        *_link_lines(f"{name}_link", origin, 0.0, np.zeros(3)),
        f'  <joint name="{name}_joint" type="fixed">',
        f'    <parent link="base_link"/><child link="{name}_link"/>',
        "  </joint>",
    ]
