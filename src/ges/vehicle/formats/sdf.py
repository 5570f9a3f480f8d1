"""Gazebo models (SDFormat) whose rotors are driven by a motor model plugin.

Two plugins are read: ``libgazebo_motor_model.so`` of Gazebo classic and ``MulticopterMotorModel``
of Gazebo. The second is written. Their physics: thrust T_i = motorConstant w_i^2 along the rotor's
z, reaction torque momentConstant T_i. Rotor drag H_i = -rotorDragCoefficient |w_i| v across the
axis. First-order lag with timeConstantUp and timeConstantDown.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ges.conventions import FEWEST_ROTORS, GRAVITY_M_S2, MAX_ROTORS
from ges.errors import GesError, UsageError
from ges.vehicle import scaling
from ges.vehicle.datasheet import Datasheet
from ges.vehicle.drive import curve_at_hover, normalised_thrust
from ges.vehicle.file import Vehicle, parse_vehicle
from ges.vehicle.formats.neutral import Export, Plain, drag_at, number, parse_xml, plain, without
from ges.vehicle.formats.sdf_frames import Pose, Scope, finder, model_of, pose_of
from ges.vehicle.propeller import Propeller

CLASSIC = "libgazebo_motor_model.so"
UPRIGHT = math.cos(math.radians(5.0))
NEGLIGIBLE_PRODUCT = 0.02
# What a curve that agrees at hover alone is off elsewhere.
CURVE_SD = 0.05
# None: a plugin has to state it
_NUMBERS = {
    "motorConstant": None,
    "momentConstant": None,
    "timeConstantUp": None,
    "timeConstantDown": None,
    "maxRotVelocity": None,
    "rotorDragCoefficient": "0",
    "rollingMomentCoefficient": "0",
}


@dataclasses.dataclass(frozen=True)
class Motor:
    """One motor model plugin.

    Attributes
    ----------
    link, joint : names of the rotor's link and joint.
    spin : ``cw`` or ``ccw``, seen from above.
    numbers : the plugin's numbers, by element.
    classic : whether it is the plugin of Gazebo classic.
    """

    link: str
    joint: str
    spin: str
    numbers: Mapping[str, float]
    classic: bool


@dataclasses.dataclass(frozen=True)
class Inertial:
    """Mass properties of one or several links, in one frame.

    Attributes
    ----------
    mass_kg : mass.
    centre_m : (3,) centre of mass.
    tensor_kg_m2 : (3, 3) inertia about the centre of mass.
    """

    mass_kg: float
    centre_m: np.ndarray
    tensor_kg_m2: np.ndarray


def read(
    data: bytes, path: Path, prop: Propeller | None = None, models: Sequence[Path] = ()
) -> Datasheet:
    """Read a vehicle from a Gazebo model.

    Mass, centre of mass and inertia are those of all links together. Hubs count from that centre,
    along the axes of the link that the rotors turn on.

    Parameters
    ----------
    data : the file.
    path : where it lies; included models are looked for beside it.
    prop : propellers, in place of the size of the rotors' collision shapes.
    models : more folders for included models.

    Returns
    -------
    The vehicle with the source of each number.

    Raises
    ------
    GesError
        When it is no multirotor with motor model plugins, or something in it cannot be read.
    """
    name = path.name
    model = model_of(parse_xml(data, name), name)
    scope = Scope(model, name, finder(path, models))
    links = {key: (pose, element) for key, pose, element in scope.links()}
    motors = _motors(scope, name)
    whole = _together([_inertial(*link, name) for link in links.values()], name)
    base = _base(scope, links, motors, name)
    rotors = [_rotor(links, motor, base, name) for motor in motors]
    # model to base axes: d' R for rows of places, R' I R for the tensor
    axes = base.r.as_matrix()
    hubs = np.array([pose.p - whole.centre_m for pose, _ in rotors]) @ axes
    tensor = axes.T @ whole.tensor_kg_m2 @ axes
    radius_m, radius_source = _radius([element for _, element in rotors], hubs, prop, name)
    content, sources = _motor_content(motors, whole.mass_kg, scope, name)
    content |= {
        "name": model.get("name") or path.stem,
        "mass_kg": whole.mass_kg,
        "inertia_kg_m2": dict(zip(("xx", "yy", "zz"), np.diag(tensor).tolist(), strict=True)),
        "rotors": [
            {"x_m": x, "y_m": y, "z_m": z, "radius_m": radius_m, "spin": motor.spin}
            for (x, y, z), motor in zip((hubs.round(9) + 0.0).tolist(), motors, strict=True)
        ],
    }
    sources |= {
        "mass_kg": f"Sum of {len(links)} links.",
        "inertia_kg_m2": "All links about their common centre of mass.",
        "rotors": f"Places of the rotor links from the centre of mass; {radius_source}.",
        "rho_kg_m3": "Not in the model; air at sea level, 15 degrees.",
    }
    origin = f"Read by ges vehicle from {name}, a Gazebo model; exact for that simulator."
    remarks = _remarks(links, motors, tensor)
    return Datasheet(parse_vehicle(content, name), origin, sources, tuple(remarks))


def _motors(scope: Scope, name: str) -> list[Motor]:
    """List the motors in the order of their numbers."""
    motors: dict[float, Motor] = {}
    for plugin in scope.elements("plugin"):
        # known by what it holds: the plugin's name differs between Gazebos
        if plugin.find("motorConstant") is None or plugin.find("motorNumber") is None:
            continue
        which = number(plugin.findtext("motorNumber"), "motorNumber", name)
        if which in motors:
            raise UsageError(f"{name}: two motors have the number {which:g}")
        motors[which] = _motor(plugin, name)
    if not FEWEST_ROTORS <= len(motors) <= MAX_ROTORS:
        what = f"{len(motors)} motor model plugins" if motors else "no motor model plugin"
        raise GesError(
            f"{name} holds {what} (motorNumber, motorConstant ...); ges reads multirotors that are"
            f" driven by {FEWEST_ROTORS} to {MAX_ROTORS} of them"
        )
    return [motors[key] for key in sorted(motors)]


def _motor(plugin: Element, name: str) -> Motor:
    if (plugin.findtext("motorType") or "velocity").strip() != "velocity":
        raise GesError(f"{name}: a motor is commanded by force or position; ges reads speeds")
    spin = (plugin.findtext("turningDirection") or "").strip()
    if spin not in ("cw", "ccw"):
        raise UsageError(f"{name}: turningDirection is '{spin[:20]}'; it is cw or ccw")
    numbers = {
        key: number(plugin.findtext(key) or default, key, name) for key, default in _NUMBERS.items()
    }
    link, joint = ((plugin.findtext(key) or "").strip() for key in ("linkName", "jointName"))
    return Motor(link, joint, spin, numbers, plugin.get("filename") == CLASSIC)


def _inertial(pose: Pose, link: Element, name: str) -> Inertial:
    """Read the mass properties of a link.

    Without ``<inertial>`` SDFormat gives a link 1 kg and a unit tensor.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return Inertial(1.0, pose.p, np.eye(3))
    placed = pose @ pose_of(inertial.find("pose"), name)
    mass = number(inertial.findtext("mass") or "1", "mass", name)
    if mass < 0:
        raise UsageError(f"{name}: a link has the mass {mass:g}; it must not be negative")
    tensor = np.zeros((3, 3))
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        key = f"i{'xyz'[i]}{'xyz'[j]}"
        text = inertial.findtext(f"inertia/{key}") or ("1" if i == j else "0")
        tensor[i, j] = tensor[j, i] = number(text, key, name)
    r = placed.r.as_matrix()
    # a tensor turns with its link: R I R'
    return Inertial(mass, placed.p, r @ tensor @ r.T)


def _together(parts: Sequence[Inertial], name: str) -> Inertial:
    """Combine several bodies into one (parallel axis theorem)."""
    mass = sum(part.mass_kg for part in parts)
    if not mass > 0:
        raise UsageError(f"{name}: its links have no mass; give base_link an <inertial>")
    centre = sum((part.mass_kg * part.centre_m for part in parts), np.zeros(3)) / mass
    tensor = sum(
        (part.tensor_kg_m2 + _offset(part.mass_kg, part.centre_m - centre) for part in parts),
        np.zeros((3, 3)),
    )
    return Inertial(mass, centre, tensor)


def _offset(mass_kg: float, d: np.ndarray) -> np.ndarray:
    """Compute the inertia of a point mass at ``d`` (3,)."""
    return mass_kg * (d @ d * np.eye(3) - np.outer(d, d))


def _base(scope: Scope, links: Mapping, motors: Sequence[Motor], name: str) -> Pose:
    """Find the pose of the link that the rotors turn on."""
    parents = {
        joint.get("name"): (joint.findtext("parent") or "").strip()
        for joint in scope.elements("joint")
    }
    parent = parents.get(motors[0].joint)
    if parent not in links:
        raise UsageError(
            f"{name}: the joint '{motors[0].joint[:60]}' of motor 0 hangs on no link of the model"
        )
    return links[parent][0]


def _rotor(links: Mapping, motor: Motor, base: Pose, name: str) -> tuple[Pose, Element]:
    """Find a rotor's link, which must be upright on the base."""
    if motor.link not in links:
        raise UsageError(f"{name}: there is no link '{motor.link[:60]}' for a motor's linkName")
    pose, element = links[motor.link]
    if (base.r.inv() * pose.r).as_matrix()[2, 2] < UPRIGHT:
        raise GesError(f"{name}: the rotor '{motor.link}' is tilted; ges simulates upright rotors")
    return pose, element


def _radius(
    rotors: Sequence[Element], hubs: np.ndarray, prop: Propeller | None, name: str
) -> tuple[float, str]:
    """Give the radius of the rotors and its source."""
    if prop is not None:
        return prop.radius_m, "radius as given"
    sizes = []
    for rotor in rotors:
        for shape in rotor.iterfind("collision/geometry/*"):
            if shape.tag == "cylinder":
                sizes.append(number(shape.findtext("radius"), "radius", name))
            elif shape.tag == "box":
                edges = (shape.findtext("size") or "").split()
                # blades lie along the longest edge
                sizes.append(0.5 * max(number(edge, "size", name) for edge in edges or [""]))
    if sizes:
        return float(np.mean(sizes)), "radius of their collision shapes"
    return scaling.radius_m(hubs), (
        "radius that hubs this far apart usually have, to"
        f" {scaling.SPACING_SD_REL:.0%} (--prop tells it)"
    )


def _motor_content(
    motors: Sequence[Motor], mass_kg: float, scope: Scope, name: str
) -> tuple[dict, dict[str, str]]:
    """Convert the numbers of the motor plugins to keys of a vehicle file, with their sources."""
    by_key = {key: np.array([m.numbers[key] for m in motors]) for key in _NUMBERS}
    thrust = by_key["motorConstant"]
    if not np.all(thrust > 0):
        raise UsageError(f"{name}: motorConstant is {thrust.min():g}; it must be positive")
    # a vehicle file has one coefficient: rotors below the strongest lose the rest
    strongest = float(thrust.max())
    up_s, down_s = (float(by_key[f"timeConstant{way}"].mean()) for way in ("Up", "Down"))
    effects: dict[str, dict] = {}
    sources = {
        "thrust_coefficient_N_s2": "motorConstant.",
        "torque_coefficient_Nm_s2": "motorConstant times momentConstant.",
        "motor_time_constant_s": "timeConstantUp.",
        "max_rotor_speed_rad_s": (
            "maxRotVelocity. The model does not say which command that is; PX4's bridge maps"
            " commands to SIM_GZ_EC_MIN .. SIM_GZ_EC_MAX."
        ),
        "effects.rotor_drag": "rotorDragCoefficient.",
        "effects.motor_lag": "timeConstantDown beyond timeConstantUp.",
        "effects.weak_rotor": "motorConstant of each rotor below the largest.",
    }
    if drag := float(by_key["rotorDragCoefficient"].mean()):
        effects["rotor_drag"] = {"k_kg": drag}
    if down_s != up_s:
        effects["motor_lag"] = {"up_s": 0.0, "down_s": down_s - up_s}
    if not np.allclose(thrust, strongest):
        losses = 1.0 - thrust / strongest
        effects["weak_rotor"] = {f"loss_{i + 1}": float(x) for i, x in enumerate(losses)}
    top = float(by_key["maxRotVelocity"].mean())
    # speeds s u + w_0 of this model are no curve that a vehicle file has; one is laid through hover
    if channel := _channel(scope, name):
        scaling_rad_s, idle_rad_s = channel
        hover = math.sqrt(mass_kg * GRAVITY_M_S2 / float(thrust.sum()))
        u = (hover - idle_rad_s) / scaling_rad_s
        if scaling_rad_s > 0 and 0.0 < u < 1.0:
            # T ~ w^2, so that d ln T / d ln u = 2 (dw/du) u / w
            c = curve_at_hover(2.0 * scaling_rad_s * u / hover, u)
            top = hover / math.sqrt(normalised_thrust(np.array(u), c))
            effects["thrust_curve"] = {"c": {"value": c, "sd": CURVE_SD}}
            sources["effects.thrust_curve"] = sources["max_rotor_speed_rad_s"] = (
                f"Agrees in value and slope at hover with the model's own map of commands to"
                f" speeds, {scaling_rad_s:g} u + {idle_rad_s:g} rad/s."
            )
    content = {
        "thrust_coefficient_N_s2": strongest,
        "torque_coefficient_Nm_s2": strongest * float(by_key["momentConstant"].mean()),
        "motor_time_constant_s": up_s,
        "max_rotor_speed_rad_s": top,
        "effects": effects,
    }
    return content, sources


def _channel(scope: Scope, name: str) -> tuple[float, float] | None:
    """Read scale and offset (rad/s) of commands in PX4's mavlink interface; None without it."""
    for plugin in scope.elements("plugin"):
        channel = plugin.find("control_channels/channel")
        if channel is not None:
            keys = ("input_scaling", "zero_position_armed")
            scale, idle = (number(channel.findtext(key), key, name) for key in keys)
            return scale, idle
    return None


def _remarks(links: Mapping, motors: Sequence[Motor], tensor: np.ndarray) -> list[str]:
    """List what the model has and a vehicle file cannot have."""
    remarks = [
        f"Link {key} has no <inertial>; SDFormat gives it 1 kg and 1 kg m^2."
        for key, (_, element) in links.items()
        if element.find("inertial") is None
    ]
    products = np.abs(tensor - np.diag(np.diag(tensor))).max()
    if products > NEGLIGIBLE_PRODUCT * np.diag(tensor).min():
        remarks.append(f"Products of inertia of up to {products:.2g} kg m^2 are left out.")
    if any(motor.numbers["rollingMomentCoefficient"] for motor in motors):
        remarks.append("rollingMomentCoefficient has no counterpart and is left out.")
    if any(motor.classic for motor in motors):
        remarks.append(
            "The motor model of PX4's Gazebo classic also takes |v| / 25 m/s off every thrust, at"
            " any height and in any direction; no effect here has that form."
        )
    return remarks


def write(vehicle: Vehicle) -> Export:
    """Write a vehicle as a Gazebo model: a body and its rotors with plugins, without sensors.

    Parameters
    ----------
    vehicle : the vehicle.

    Raises
    ------
    GesError
        When a rotor is canted or makes no thrust, or the body would have no positive inertia.
    """
    p = plain(vehicle)
    remarks = [*p.remarks, *without(p, ("rotor_drag", "thrust_curve"), "Gazebo's motor model")]
    remarks += drag_at(1.0, p, "Gazebo's motor model")
    if "thrust_curve" in p.effects:
        remarks.append(
            "Gazebo is commanded in rotor speeds: the thrust curve is for who commands it (PX4:"
            f" THR_MDL_FAC {1.0 - p.effect('thrust_curve', 'c'):.2g} for a bridge that maps"
            " commands linearly to speeds)."
        )
    remarks.append("No sensors are in the model: include them, or merge it as x500 does x500_base.")
    blade_kg = 0.002 * p.mass_kg
    # a thin rod of length 2 R about its middle, m (2 R)^2 / 12, and next to nothing along itself
    blade = blade_kg * p.radius_m**2 / 3.0 * np.array([0.01, 1.0, 1.005])
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        # XML has no comment with two hyphens in it
        f"<!-- {escape(p.name).replace('--', '- -')}, written by ges vehicle. -->",
        *(f"<!-- {escape(remark).replace('--', '- -')} -->" for remark in remarks),
        '<sdf version="1.9">',
        f"  <model name={quoteattr(p.name)}>",
        *_body_lines(p, blade_kg, blade),
    ]
    for i in range(len(p.hubs_m)):
        lines += _rotor_lines(p, i, blade_kg, blade)
    lines += [line for i in range(len(p.hubs_m)) for line in _plugin_lines(p, i)]
    return Export("\n".join([*lines, "  </model>", "</sdf>"]) + "\n", tuple(remarks))


def _body_lines(p: Plain, blade_kg: float, blade: np.ndarray) -> list[str]:
    """Write the body: total mass, centre and inertia less those of the rotors' links."""
    mass = p.mass_kg - len(p.hubs_m) * blade_kg
    # body and blades have their common centre at the origin
    centre = -blade_kg * p.hubs_m.sum(axis=0) / mass
    tensor = np.diag(p.inertia_kg_m2) - _offset(mass, centre)
    # the parallel axis theorem backwards: a blade's own tensor, and that of its mass at the hub
    for hub in p.hubs_m:
        tensor = tensor - np.diag(blade) - _offset(blade_kg, hub)
    # a body that exists has a positive tensor; physics engines refuse others
    if np.linalg.eigvalsh(tensor)[0] <= 0:
        raise GesError(
            f"vehicle '{p.name}' has too little inertia ({p.inertia_kg_m2.min():.2g} kg m^2) for a"
            " body with rotors where they are; check inertia_kg_m2"
        )
    size = np.append(p.hubs_m[:, :2].max(axis=0) - p.hubs_m[:, :2].min(axis=0), 0.1 * p.radius_m)
    return [
        '    <link name="base_link">',
        *_inertial_lines(mass, centre, tensor),
        *_shape_lines("base_link", f"<box><size>{_row(size)}</size></box>"),
        "    </link>",
    ]


def _inertial_lines(mass: float, centre: np.ndarray, tensor: np.ndarray) -> list[str]:
    cells = "".join(
        f"<i{'xyz'[i]}{'xyz'[j]}>{tensor[i, j]:.9g}</i{'xyz'[i]}{'xyz'[j]}>"
        for i in range(3)
        for j in range(i, 3)
    )
    return [
        "      <inertial>",
        f"        <pose>{_row(centre)} 0 0 0</pose>",
        f"        <mass>{mass:.9g}</mass>",
        f"        <inertia>{cells}</inertia>",
        "      </inertial>",
    ]


def _shape_lines(name: str, geometry: str) -> list[str]:
    return [
        f'      <{kind} name="{name}_{kind}"><geometry>{geometry}</geometry></{kind}>'
        for kind in ("collision", "visual")
    ]


def _row(values: np.ndarray) -> str:
    return " ".join(f"{value + 0.0:.9g}" for value in values)


def _rotor_lines(p: Plain, i: int, blade_kg: float, blade: np.ndarray) -> list[str]:
    """Write link and joint of a rotor."""
    disc = f"<cylinder><radius>{p.radius_m:.9g}</radius><length>0.005</length></cylinder>"
    return [
        f'    <link name="rotor_{i}">',
        f"      <pose>{_row(p.hubs_m[i])} 0 0 0</pose>",
        *_inertial_lines(blade_kg, np.zeros(3), np.diag(blade)),
        *_shape_lines(f"rotor_{i}", disc),
        "    </link>",
        f'    <joint name="rotor_{i}_joint" type="revolute">',
        f"      <parent>base_link</parent><child>rotor_{i}</child>",
        "      <axis><xyz>0 0 1</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis>",
        "    </joint>",
    ]


def _plugin_lines(p: Plain, i: int) -> list[str]:
    """Write the motor model of a rotor."""
    values = {
        "jointName": f"rotor_{i}_joint",
        "linkName": f"rotor_{i}",
        "turningDirection": "ccw" if p.spin[i] > 0 else "cw",
        "timeConstantUp": f"{p.lag_up_s:.9g}",
        "timeConstantDown": f"{p.lag_down_s:.9g}",
        "maxRotVelocity": f"{p.top_speed_rad_s:.9g}",
        "motorConstant": f"{p.thrust_N_s2[i]:.9g}",
        "momentConstant": f"{p.torque_Nm_s2[i] / p.thrust_N_s2[i]:.9g}",
        "commandSubTopic": "command/motor_speed",
        "motorNumber": f"{i}",
        "rotorDragCoefficient": f"{p.effect('rotor_drag', 'k_kg'):.9g}",
        "rollingMomentCoefficient": "0",
        "rotorVelocitySlowdownSim": "10",
        "motorType": "velocity",
    }
    return [
        '    <plugin filename="gz-sim-multicopter-motor-model-system"',
        '      name="gz::sim::systems::MulticopterMotorModel">',
        *(f"      <{key}>{value}</{key}>" for key, value in values.items()),
        "    </plugin>",
    ]
