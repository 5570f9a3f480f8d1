"""Parameters of PX4's simulator in hardware (``SIH_*``), quadrotor.

Read from an airframe script (``param set-default SIH_MASS 1.0``), a parameter file of
QGroundControl, or lines of name and value. Its physics (``sih.cpp``): T_i = SIH_T_MAX u_i, reaction
torque SIH_Q_MAX u_i, u following its command with SIH_T_TAU. Hubs are at (+-SIH_L_PITCH,
+-SIH_L_ROLL) in PX4's order; F = -SIH_KDV v and M = -SIH_KDW omega.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from ges.conventions import GRAVITY_M_S2
from ges.errors import GesError, UsageError
from ges.vehicle import propeller, scaling
from ges.vehicle.datasheet import Datasheet, comment
from ges.vehicle.file import Vehicle, parse_vehicle
from ges.vehicle.formats.neutral import (
    Export,
    drag_at,
    number,
    one_thrust,
    plain,
    rotors_at,
    without,
)
from ges.vehicle.layouts import LAYOUTS
from ges.vehicle.propeller import Propeller

# sih_params.yaml of PX4.
DEFAULTS: Mapping[str, float] = {
    "SIH_MASS": 1.0,
    "SIH_IXX": 0.025,
    "SIH_IYY": 0.025,
    "SIH_IZZ": 0.03,
    "SIH_IXY": 0.0,
    "SIH_IXZ": 0.0,
    "SIH_IYZ": 0.0,
    "SIH_T_MAX": 5.0,
    "SIH_Q_MAX": 0.1,
    "SIH_L_ROLL": 0.2,
    "SIH_L_PITCH": 0.2,
    "SIH_KDV": 1.0,
    "SIH_KDW": 0.025,
    "SIH_T_TAU": 0.05,
    "SIH_VEHICLE_TYPE": 0.0,
}
# param set-default NAME VALUE; two ids before NAME, as QGroundControl writes; or NAME = VALUE
_LINE = re.compile(r"\s*(?:param\s+set(?:-default)?\s+|(?:\d+\s+){2})?(SIH_\w+)[\s=,:]+([^\s,#]+)")
RHO_KG_M3 = 1.225
# clockwise from the nose, as the layouts count
ANGLES_RAD = [math.radians(m.angle_deg) for m in LAYOUTS["x"]]
CORNERS = [(math.cos(a), -math.sin(a)) for a in ANGLES_RAD]
SPINS = [m.spin for m in LAYOUTS["x"]]


def _given(data: bytes, name: str) -> dict[str, float]:
    """Read the parameters that a text file sets; the last of a name counts."""
    try:
        text = data.decode()
    except UnicodeDecodeError:
        raise UsageError(
            f"{name} is no text; give an airframe script or a parameter file"
        ) from None
    given = {}
    for line in text.splitlines():
        if match := _LINE.match(line):
            given[match[1]] = number(match[2], match[1], name)
    if not set(given) & set(DEFAULTS):
        raise UsageError(f"{name} sets none of {', '.join(DEFAULTS)}")
    return given


def read(data: bytes, name: str, prop: Propeller | None = None) -> Datasheet:
    """Read a vehicle from a file that sets SIH parameters.

    Parameters
    ----------
    data : the file.
    name : name of the file, for messages.
    prop : propellers; SIH states none.

    Returns
    -------
    The vehicle with the source of each number.

    Raises
    ------
    GesError
        When the file sets no SIH parameter, or those of no quadrotor.
    """
    return from_parameters(_given(data, name), name, prop)


def from_parameters(
    given: Mapping[str, float], name: str = "SIH parameters", prop: Propeller | None = None
) -> Datasheet:
    """Convert SIH parameters to a vehicle.

    Parameters
    ----------
    given : values by name; PX4's defaults elsewhere.
    name : name of the file, for messages.
    prop : propellers; by default as the hubs suggest.

    Returns
    -------
    The vehicle with the source of each number.

    Raises
    ------
    GesError
        When they are of no quadrotor.
    UsageError
        When a number is not positive.
    """
    p = {**DEFAULTS, **{key: float(value) for key, value in given.items() if key in DEFAULTS}}
    if p["SIH_VEHICLE_TYPE"] != 0:
        raise GesError(f"{name}: SIH_VEHICLE_TYPE {p['SIH_VEHICLE_TYPE']:g} is no quadrotor (0)")
    for key in ("SIH_MASS", "SIH_T_MAX", "SIH_Q_MAX", "SIH_L_ROLL", "SIH_L_PITCH", "SIH_T_TAU"):
        if not p[key] > 0:
            raise UsageError(f"{name}: {key} is {p[key]:g}; it must be positive")
    hubs = np.sign(CORNERS) * [p["SIH_L_PITCH"], p["SIH_L_ROLL"]]
    radius_m = prop.radius_m if prop else scaling.radius_m(hubs)
    # only T_MAX = k w_max^2 acts; a usual k for the size makes usual speeds of it
    thrust = propeller.thrust_coefficient(Propeller(2.0 * radius_m), RHO_KG_M3).value
    top = math.sqrt(p["SIH_T_MAX"] / thrust)
    hover = math.sqrt(p["SIH_MASS"] * GRAVITY_M_S2 / (4 * thrust))
    # K v = sum_i k w_i v, with the rotors as fast as in hover
    drag = p["SIH_KDV"] / (4 * hover)
    effects: dict[str, dict[str, float]] = {"thrust_curve": {"c": 1.0}}
    if drag:
        # it acts at the centre of mass
        effects |= {
            "rotor_drag": {"k_kg": drag, "lever": 0.0},
            "axial_inflow": {"k_kg": drag},
        }
    content = {
        "name": "sih-quad",
        "mass_kg": p["SIH_MASS"],
        "inertia_kg_m2": {k: p[f"SIH_I{k.upper()}"] for k in ("xx", "yy", "zz")},
        "rotors": [
            {"x_m": x, "y_m": y, "radius_m": radius_m, "spin": spin}
            for (x, y), spin in zip(hubs.tolist(), SPINS, strict=True)
        ],
        "thrust_coefficient_N_s2": thrust,
        "torque_coefficient_Nm_s2": thrust * p["SIH_Q_MAX"] / p["SIH_T_MAX"],
        "motor_time_constant_s": p["SIH_T_TAU"],
        "max_rotor_speed_rad_s": top,
        "rho_kg_m3": RHO_KG_M3,
        "effects": effects,
    }
    both = "SIH_KDV over the sum of the rotor speeds at hover: equal there; SIH's drag does not"
    sources = {
        "rotors": "SIH_L_PITCH and SIH_L_ROLL, PX4's order. "
        + ("Radius as given." if prop else "Radius that hubs this far apart usually have."),
        "thrust_coefficient_N_s2": "SIH has no rotor speeds: nominal for this radius. Coefficient"
        f" times top speed squared is SIH_T_MAX, {p['SIH_T_MAX']:g} N.",
        "torque_coefficient_Nm_s2": "SIH_Q_MAX over SIH_T_MAX times the thrust coefficient.",
        "motor_time_constant_s": "SIH_T_TAU, which delays thrust there and speed here.",
        "max_rotor_speed_rad_s": "Nominal, see the thrust coefficient.",
        "effects.thrust_curve": "Thrust is linear in the command.",
        "effects.rotor_drag": f"{both} change with thrust.",
        "effects.axial_inflow": f"{both} change with thrust.",
    }
    remarks = [
        f"{key} ({p[key]:g}) has no counterpart and is left out."
        for key in ("SIH_KDW", "SIH_IXY", "SIH_IXZ", "SIH_IYZ")
        if p[key]
    ]
    origin = f"Read by ges vehicle from {name} of PX4's simulator in hardware."
    return Datasheet(parse_vehicle(content, name), origin, sources, tuple(remarks))


def write(vehicle: Vehicle) -> Export:
    """Write a vehicle as lines of an airframe script for PX4's SIH.

    Parameters
    ----------
    vehicle : the vehicle.

    Raises
    ------
    GesError
        When it is no X quadrotor of upright rotors.
    """
    p = plain(vehicle)
    order = rotors_at(p, CORNERS, ", the only one that SIH flies")
    remarks = [*p.remarks]
    if order != list(range(4)):
        listed = ", ".join(str(k + 1) for k in order)
        remarks.append(f"PX4's motors 1 to 4 are rotors {listed} of the vehicle file.")
    if [("ccw" if p.spin[k] > 0 else "cw") for k in order] != SPINS:
        remarks.append("Its rotors turn the other way than SIH turns them: yaw comes out reversed.")
    remarks += one_thrust(p, "SIH")
    remarks += without(p, ("rotor_drag", "axial_inflow", "thrust_curve"), "SIH")
    remarks += drag_at(0.0, p, "SIH")
    curve = p.effect("thrust_curve", "c")
    if curve != 1.0:
        remarks.append(
            f"SIH's thrust is linear in the command; the vehicle's curve (c = {curve:.2g}) cannot"
            " be expressed: leave THR_MDL_FAC at 0 there."
        )
    if abs(p.lag_up_s - p.lag_down_s) > 1e-6:
        remarks.append("SIH has one time constant: the mean of speeding up and down.")
    across_thrust, along_thrust = p.effect("rotor_drag", "k_kg"), p.effect("axial_inflow", "k_kg")
    if across_thrust != along_thrust:
        remarks.append(
            "SIH_KDV drags alike in all directions: that across the rotors is taken, that along"
            " them is lost."
        )
    remarks.append("SIH_KDW (damping of rotation) is not in a vehicle file: 0.")
    hubs = np.abs(p.hubs_m[order])
    numbers = {
        "SIH_VEHICLE_TYPE": 0,
        "SIH_MASS": p.mass_kg,
        **dict(zip(("SIH_IXX", "SIH_IYY", "SIH_IZZ"), p.inertia_kg_m2, strict=True)),
        "SIH_T_MAX": p.mean_thrust_N_s2 * p.top_speed_rad_s**2,
        "SIH_Q_MAX": p.mean_torque_Nm_s2 * p.top_speed_rad_s**2,
        "SIH_L_ROLL": float(hubs[:, 1].mean()),
        "SIH_L_PITCH": float(hubs[:, 0].mean()),
        # k = K / (4 w) of the reader, backwards
        "SIH_KDV": across_thrust * 4 * p.hover_rad_s,
        "SIH_KDW": 0.0,
        "SIH_T_TAU": 0.5 * (p.lag_up_s + p.lag_down_s),
    }
    for i, k in enumerate(order):
        x, y, z = p.hubs_m[k]
        numbers |= {f"CA_ROTOR{i}_PX": x, f"CA_ROTOR{i}_PY": -y, f"CA_ROTOR{i}_PZ": -z}
    lines = comment(f"{p.name}, written by ges vehicle for PX4's simulator in hardware.")
    lines += [line for remark in remarks for line in comment(remark)]
    lines += [f"param set-default {key} {value + 0.0:.8g}" for key, value in numbers.items()]
    return Export("\n".join(lines) + "\n", tuple(remarks))
