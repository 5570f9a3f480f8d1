"""Parameter files of RotorPy (Folk, Paulos & Kumar 2023): a Python module with ``quad_params``.

The file is read as text, never run. It may hold numbers, names given before, arithmetic, lists,
dictionaries and the few numpy calls that such files use.

Its physics (``rotorpy/vehicles/multirotor.py``): thrust T_i = k_eta w_i^2 + k_h (v_x^2 + v_y^2).
Yaw moment k_m w_i^2 along +z where ``rotor_directions`` is +1 (a rotor turning cw). Rotor drag H_i
= -w_i diag(k_d, k_d, k_z) v_i at each hub. Body drag D = -|v| diag(c_Dx, c_Dy, c_Dz) v. Lag dw/dt =
(w_cmd - w) / tau_m.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ges.errors import GesError, UsageError
from ges.vehicle import scaling
from ges.vehicle.datasheet import Datasheet, comment
from ges.vehicle.file import Vehicle, parse_vehicle
from ges.vehicle.formats.neutral import Export, drag_at, one_thrust, plain, without
from ges.vehicle.propeller import Propeller

# no operator but these, as a file is worked out and never run
_OPERATORS: Mapping[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_CALLS: Mapping[str, Callable[[Any], Any]] = {
    "array": lambda x: np.array(x, dtype=float),
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "deg2rad": np.deg2rad,
    "radians": np.deg2rad,
}
_CONSTANTS = {"pi": math.pi}
_NEEDED = ("mass", "Ixx", "Iyy", "Izz", "rotor_pos", "rotor_directions", "k_eta", "k_m", "tau_m")
_EXPRESSED = ("rotor_drag", "axial_inflow", "parasitic_drag", "translational_lift")


def _value(node: ast.AST, names: Mapping[str, Any]) -> Any:
    """Evaluate an expression; ValueError where it is more than arithmetic on literals."""
    match node:
        case ast.Constant(value=str() as value):
            return value
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.Attribute(value=ast.Name(id="np" | "numpy" | "math"), attr=name) if (
            name in _CONSTANTS
        ):
            return _CONSTANTS[name]
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [_value(item, names) for item in items]
        case ast.Dict(keys=keys, values=values):
            pairs = [(k, v) for k, v in zip(keys, values, strict=True) if k is not None]
            if len(pairs) < len(keys):
                raise ValueError(ast.unparse(node)[:60])
            return {_value(k, names): _value(v, names) for k, v in pairs}
        case ast.UnaryOp(op=op, operand=x) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(x, names))
        case ast.BinOp(op=op, left=left, right=right) if type(op) in _OPERATORS:
            a, b = _value(left, names), _value(right, names)
            # text and lists know + and *, too, and can grow without end by it
            if not all(isinstance(x, float | np.ndarray) for x in (a, b)):
                raise ValueError(ast.unparse(node)[:60])
            return _OPERATORS[type(op)](a, b)
        case ast.Subscript(value=x, slice=ast.Constant(value=key)):
            return _value(x, names)[key]
        case ast.Call(
            func=ast.Attribute(value=ast.Name(id="np" | "numpy" | "math"), attr=name),
            args=[argument],
            keywords=[],
        ) if name in _CALLS:
            return _CALLS[name](_value(argument, names))
    raise ValueError(ast.unparse(node)[:60])


def _parameters(data: bytes, name: str) -> dict[str, Any]:
    """Evaluate ``quad_params`` of a file."""
    try:
        tree = ast.parse(data)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise UsageError(f"{name} is not Python: {error}") from None
    # what cannot be worked out is passed over, unless quad_params is made of it
    names: dict[str, Any] = {}
    for node in tree.body:
        match node:
            case ast.Assign(targets=[ast.Name(id=target)], value=value):
                try:
                    names[target] = _value(value, names)
                except RecursionError:
                    raise UsageError(f"{name} nests without end; it is not read") from None
                except (ValueError, TypeError, KeyError, IndexError, ArithmeticError) as error:
                    if target == "quad_params":
                        raise UsageError(
                            f"{name}: quad_params holds {error}, more than numbers and arithmetic;"
                            " write the numbers out"
                        ) from None
    parameters = names.get("quad_params")
    if not isinstance(parameters, dict):
        raise UsageError(f"{name} holds no dictionary quad_params, which RotorPy reads")
    return parameters


def read(data: bytes, name: str, prop: Propeller | None = None) -> Datasheet:
    """Read a vehicle from a RotorPy parameter file.

    Parameters
    ----------
    data : the file.
    name : name of the file, for messages.
    prop : propellers; most files do not state their size.

    Returns
    -------
    The vehicle with the source of each number.

    Raises
    ------
    GesError
        When the file is not as RotorPy reads it.
    """
    return from_parameters(_parameters(data, name), name, prop)


def from_parameters(
    params: Mapping[str, Any], name: str = "quad_params", prop: Propeller | None = None
) -> Datasheet:
    """Convert RotorPy's ``quad_params`` to a vehicle.

    Parameters
    ----------
    params : the dictionary, as RotorPy's modules hold it.
    name : name of its file, for messages; the vehicle is named after it.
    prop : propellers; by default of ``rotor_radius``, or as the hubs suggest.

    Returns
    -------
    The vehicle with the source of each number.

    Raises
    ------
    UsageError
        When a number is missing or not finite.
    GesError
        When rotors and directions differ in number.
    """
    for key in _NEEDED:
        if key not in params:
            raise UsageError(f"{name}: quad_params has no {key}; add it")
    hubs = _hubs(params, name)
    directions = np.ravel(_numbers(params["rotor_directions"], "rotor_directions", name))
    if len(hubs) != len(directions) or not np.all(np.abs(directions) == 1):
        raise GesError(
            f"{name}: rotor_pos and rotor_directions hold {len(hubs)} and {len(directions)} rotors;"
            " they hold one entry for each, directions +1 (cw) or -1 (ccw)"
        )

    def scalar(key: str, default: float = 0.0) -> float:
        return float(_numbers(params.get(key, default), key, name))

    radius_m, radius_source = _radius(params, hubs, prop, name)
    rho = 1.225
    weight = scalar("mass") * 9.81
    effects, sources, remarks = _effects(params, scalar, radius_m, rho)
    content = {
        "name": name.removesuffix(".py").removesuffix("_params"),
        "mass_kg": scalar("mass"),
        "inertia_kg_m2": {"xx": scalar("Ixx"), "yy": scalar("Iyy"), "zz": scalar("Izz")},
        "rotors": [
            {
                "x_m": float(x),
                "y_m": float(y),
                "z_m": float(z),
                "radius_m": radius_m,
                "spin": "cw" if turn > 0 else "ccw",
            }
            for (x, y, z), turn in zip(hubs, directions, strict=True)
        ],
        "thrust_coefficient_N_s2": scalar("k_eta"),
        "torque_coefficient_Nm_s2": scalar("k_m"),
        "motor_time_constant_s": scalar("tau_m"),
        "rho_kg_m3": rho,
        "effects": effects,
    }
    if "rotor_speed_max" in params:
        content["max_rotor_speed_rad_s"] = scalar("rotor_speed_max")
    for key, place in (("Ixy", "xy"), ("Ixz", "xz"), ("Iyz", "yz")):
        if scalar(key):
            remarks.append(f"Product of inertia {place} ({scalar(key):g} kg m^2) is left out.")
    if scalar("k_flap"):
        remarks.append("k_flap (flapping moment) has no counterpart and is left out.")
    if scalar("rotor_speed_min"):
        remarks.append("rotor_speed_min has no counterpart: rotors may stand still here.")
    sources |= {
        "thrust_coefficient_N_s2": f"k_eta; it carries {weight:.3g} N.",
        "torque_coefficient_Nm_s2": "k_m.",
        "motor_time_constant_s": "tau_m.",
        "max_rotor_speed_rad_s": "rotor_speed_max.",
        "rotors": f"rotor_pos, and rotor_directions (+1: cw). {radius_source}",
        "rho_kg_m3": "Not in the file; air at sea level, 15 degrees.",
    }
    origin = f"Read by ges vehicle from {name}, a RotorPy parameter file; exact for that simulator."
    return Datasheet(parse_vehicle(content, name), origin, sources, tuple(remarks))


def _numbers(value: Any, key: str, name: str) -> np.ndarray:
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if not np.all(np.isfinite(numbers)):
        raise UsageError(f"{name}: {key} is {str(value)[:40]}, no finite number")
    return numbers


def _hubs(params: Mapping[str, Any], name: str) -> np.ndarray:
    """Read hubs (n, 3) from a dictionary or a list of positions."""
    given = params["rotor_pos"]
    rows = list(given.values()) if isinstance(given, Mapping) else list(np.atleast_1d(given))
    hubs = [np.ravel(_numbers(row, "rotor_pos", name)) for row in rows]
    if any(hub.shape != (3,) for hub in hubs):
        raise UsageError(f"{name}: every position in rotor_pos has three numbers, x, y and z")
    return np.array(hubs)


def _radius(
    params: Mapping[str, Any], hubs: np.ndarray, prop: Propeller | None, name: str
) -> tuple[float, str]:
    """Give the radius of the rotors and its source."""
    if prop is not None:
        return prop.radius_m, "Radius as given."
    if params.get("rotor_radius") is not None:
        return float(_numbers(params["rotor_radius"], "rotor_radius", name)), "rotor_radius."
    return scaling.radius_m(hubs), (
        "The file does not say how large the rotors are: what hubs this far apart usually have, to"
        f" {scaling.SPACING_SD_REL:.0%} (--prop tells it)."
    )


def _effects(
    params: Mapping[str, Any], scalar: Callable[..., float], radius_m: float, rho: float
) -> tuple[dict, dict, list]:
    """Convert drag and lift to effects, with their sources and what they lose."""
    effects: dict[str, dict[str, float]] = {}
    sources: dict[str, str] = {}
    remarks: list[str] = []
    if scalar("k_d"):
        effects["rotor_drag"] = {"k_kg": scalar("k_d")}
        sources["effects.rotor_drag"] = "k_d."
    if scalar("k_z"):
        effects["axial_inflow"] = {"k_kg": scalar("k_z")}
        sources["effects.axial_inflow"] = "k_z."
    # D = c |v| v = rho A |v| v / 2
    across = 0.5 * (scalar("c_Dx") + scalar("c_Dy"))
    if across:
        effects["parasitic_drag"] = {
            "area_m2": 2.0 * across / rho,
            # within the bounds of the effect
            "vertical_ratio": min(max(scalar("c_Dz") / across, 0.2), 5.0),
        }
        sources["effects.parasitic_drag"] = (
            "Twice the mean of c_Dx and c_Dy over the density, and c_Dz over that mean."
        )
        if scalar("c_Dx") != scalar("c_Dy"):
            remarks.append("c_Dx and c_Dy differ; their mean is taken.")
    if scalar("k_h"):
        effects["translational_lift"] = {"c": scalar("k_h") / (2.0 * rho * math.pi * radius_m**2)}
        sources["effects.translational_lift"] = (
            "k_h over 2 rho A: equal at speeds well below the induced velocity; RotorPy's lift"
            " grows without end, this one levels off."
        )
    return effects, sources, remarks


def write(vehicle: Vehicle) -> Export:
    """Write a vehicle as a RotorPy parameter file.

    Parameters
    ----------
    vehicle : the vehicle.

    Raises
    ------
    GesError
        When a rotor is canted or makes no thrust.
    """
    p = plain(vehicle)
    remarks = [*p.remarks, *one_thrust(p, "RotorPy"), *without(p, _EXPRESSED, "RotorPy")]
    if abs(p.lag_up_s - p.lag_down_s) > 1e-6:
        remarks.append("RotorPy has one motor time constant: the mean of speeding up and down.")
    remarks += drag_at(1.0, p, "RotorPy")
    coupling = p.effect("parasitic_drag", "coupling")
    if p.effect("parasitic_drag", "area_m2") and coupling < 1.0:
        remarks.append(
            "RotorPy's drag of the airframe goes with the whole speed. Of this vehicle each axis"
            f" has a part of its own (coupling {coupling:g})."
        )
    # the reader's laws, solved for RotorPy's coefficients
    disc = math.pi * p.radius_m**2
    across = 0.5 * p.rho_kg_m3 * p.effect("parasitic_drag", "area_m2")
    numbers = {
        "mass": p.mass_kg,
        **dict(zip(("Ixx", "Iyy", "Izz"), p.inertia_kg_m2, strict=True)),
        **dict.fromkeys(("Ixy", "Iyz", "Ixz"), 0.0),
        "num_rotors": len(p.hubs_m),
        "rotor_radius": p.radius_m,
        "rotor_pos": {f"r{i}": hub for i, hub in enumerate(p.hubs_m, 1)},
        "rotor_directions": -p.spin,
        "rI": np.zeros(3),
        "c_Dx": across,
        "c_Dy": across,
        "c_Dz": across * p.effect("parasitic_drag", "vertical_ratio"),
        "k_eta": p.mean_thrust_N_s2,
        "k_m": p.mean_torque_Nm_s2,
        "k_d": p.effect("rotor_drag", "k_kg"),
        "k_z": p.effect("axial_inflow", "k_kg"),
        "k_h": p.effect("translational_lift", "c") * 2.0 * p.rho_kg_m3 * disc,
        "k_flap": 0.0,
        "tau_m": 0.5 * (p.lag_up_s + p.lag_down_s),
        "rotor_speed_min": 0.0,
        "rotor_speed_max": p.top_speed_rad_s,
        "motor_noise_std": 0.0,
    }
    lines = comment(f"{p.name}, written by ges vehicle for RotorPy. SI units, FLU.")
    lines += [line for remark in remarks for line in comment(remark)]
    lines += ["import numpy as np", "", "quad_params = {"]
    lines += [f"    {key!r}: {_literal(value)}," for key, value in numbers.items()]
    return Export("\n".join([*lines, "}"]) + "\n", tuple(remarks))


def _literal(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k!r}: {_literal(v)}" for k, v in value.items()) + "}"
    if isinstance(value, np.ndarray):
        return f"np.array([{', '.join(_literal(float(x)) for x in value)}])"
    return f"{value + 0.0:.8g}" if isinstance(value, float) else repr(value)
