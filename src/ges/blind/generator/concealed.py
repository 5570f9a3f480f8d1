"""What can be concealed: every effect, its physical numbers at three severities, and the neutral
craft.

An effect is a function (airframe, level, rng) -> physical numbers that differ from ``NEUTRAL``.
Severities are shares of the weight at ordinary flight (level 0 weak, 1 medium, 2 strong).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ges.blind.generator import rotor
from ges.blind.generator.airframe import RHO_KG_M3, TrueVehicle
from ges.conventions import GRAVITY_M_S2

LEVELS = ("weak", "medium", "strong")
NEUTRAL: dict[str, float] = {
    # rotors and frame
    "coaxial": 0.0,
    "weak_share": 0.0,
    "weak_index": 0.0,
    "cg_x_m": 0.0,
    "cg_y_m": 0.0,
    "tilt_x_rad": 0.0,
    "tilt_y_rad": 0.0,
    "rotor_inertia_kg_m2": 0.0,
    "thrust_error": 1.0,
    "inertia_error": 1.0,
    "torque_error": 1.0,
    # air
    "blade_s": 0.5,
    "axial": 0.0,
    "edgewise": 0.0,
    "drag_gain": 0.0,
    "area_m2": 0.0,
    "wind_m_s": 0.0,
    "wind_direction_rad": 0.0,
    "gust_m_s": 0.0,
    # ground
    "image_gain": 0.0,
    "image_sweep": 0.0,
    "image_lag": 0.0,
    "image_contrast": 0.0,
    "fountain": 0.0,
    # drive
    "sags": 0.0,
    "resistance": 0.05,
    "polar_resistance": 0.02,
    "drain_1_s": 0.001,
    "lag_gain": 1.0,
    "coast": 1.0,
    "delay_s": 0.0,
    "curve_droop": 0.0,
    "ceiling_u": 1.0,
    "mapping": 0.0,
    # attached
    "payload_share": 0.0,
    "payload_x_m": 0.0,
    "payload_y_m": 0.0,
    "load_share": 0.0,
    "rope_m": 0.3,
    "tether_N_m": 0.0,
    "tether_sag_m": 0.2,
    # nobody's library
    "magnet_N": 0.0,
    "magnet_x_m": 0.0,
    "magnet_y_m": 0.0,
    "magnet_width_m": 0.7,
    "buffet": 0.0,
    "pitch_up_s_m": 0.0,
    "interference": 0.0,
    "updraft_N": 0.0,
    "hatch_N": 0.0,
    "wall_N": 0.0,
    # sensors
    "range_bias_m": 0.0,
    "range_lag_s": 0.0,
    "time_offset_s": 0.0,
    "att_bias_x_rad": 0.0,
    "att_bias_y_rad": 0.0,
    "acc_bias_x_m_s2": 0.0,
    "acc_bias_y_m_s2": 0.0,
    "acc_bias_z_m_s2": 0.0,
    "gyro_bias_x_rad_s": 0.0,
    "gyro_bias_y_rad_s": 0.0,
    "gyro_bias_z_rad_s": 0.0,
}

Secret = Callable[[TrueVehicle, int, np.random.Generator], dict[str, float]]


def _weight_N(craft: TrueVehicle) -> float:
    """Return the true weight."""
    return craft.true["mass"] * GRAVITY_M_S2


def _pick(
    level: int, values: tuple[float, float, float], rng: np.random.Generator, spread: float = 0.15
) -> float:
    return values[level] * rng.uniform(1.0 - spread, 1.0 + spread)


def _direction(rng: np.random.Generator) -> tuple[float, float]:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return float(np.cos(angle)), float(np.sin(angle))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _hover_drag_N_s_m(craft: TrueVehicle, s: float) -> float:
    """Return the blade-element in-plane force of all rotors in hover per m/s, at unit gain."""
    tip = craft.hover_speed_rad_s * craft.radius_m
    disc = RHO_KG_M3 * np.pi * craft.radius_m**2
    ct = _weight_N(craft) / (craft.n_rotors * disc * tip**2)
    slope = np.asarray(s)
    theta = rotor.blade_pitch(np.asarray(ct), slope)
    mu = 0.5 / tip
    ch = rotor.inplane_coefficient(theta, slope, np.sqrt(ct / 2.0), mu)
    return float(craft.n_rotors * disc * tip**2 * ch / 0.5)


def _image_sum_at(craft: TrueVehicle, x: float) -> float:
    """Return the image upwash of all rotors over flat ground, a share of the induced velocity.

    The rotors are ``x`` radii above the ground.
    """
    h, plane = x * craft.radius_m, craft.hubs_m[:, :2]
    # image of the first rotor itself and of all others
    squares = ((plane - plane[0]) ** 2).sum(axis=1)
    return float((craft.radius_m**2 / 4.0 * 2.0 * h / (squares + 4.0 * h * h) ** 1.5).sum())


def _rotor_drag(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    target = _pick(level, (0.008, 0.018, 0.034), rng) * _weight_N(craft)
    return {"drag_gain": target / _hover_drag_N_s_m(craft, NEUTRAL["blade_s"])}


def _parasitic_drag(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    share_at_3_m_s = _pick(level, (0.02, 0.045, 0.09), rng)
    return {"area_m2": share_at_3_m_s * _weight_N(craft) / (0.5 * RHO_KG_M3 * 9.0)}


def _moving_air(craft: TrueVehicle, rng: np.random.Generator) -> dict[str, float]:
    return _rotor_drag(craft, int(rng.integers(1, 3)), rng)


def _wind(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    speed = _pick(level, (1.0, 2.2, 4.5), rng)
    return _moving_air(craft, rng) | {
        "wind_m_s": speed,
        "wind_direction_rad": rng.uniform(0.0, 2.0 * np.pi),
    }


def _gusts(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    return _moving_air(craft, rng) | {"gust_m_s": _pick(level, (0.4, 0.8, 1.6), rng)}


def _ground_effect(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    gain_at_one_radius = _pick(level, (0.05, 0.10, 0.20), rng)
    tip = craft.hover_speed_rad_s * craft.radius_m
    disc = RHO_KG_M3 * np.pi * craft.radius_m**2
    ct = _weight_N(craft) / (craft.n_rotors * disc * tip**2)
    # upwash u (over v_i) gives dC_T / C_T = slope u, with slope = s lam / (4 C_T)
    lam, s = np.sqrt(ct / 2.0), NEUTRAL["blade_s"]
    slope = s * lam / (4.0 * ct)
    # more thrust draws more inflow, v_i ~ sqrt(T): gain (1 + slope / 2) = slope u
    upwash = gain_at_one_radius * (1.0 + 0.5 * slope) / slope
    # undo ``ground.saturate``, which is applied to the gain times the images' sum
    return {"image_gain": upwash / (1.0 - min(upwash / 0.75, 0.8)) / _image_sum_at(craft, 1.0)}


def _motor_lag(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    return {"lag_gain": _pick(level, (1.5, 1.9, 2.5), rng, 0.05), "coast": rng.uniform(1.0, 1.5)}


def _saturation(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    # the ceiling lies at this thrust over weight; thrust goes with the square of the speed
    hover_u = craft.hover_speed_rad_s / craft.true["speed"]
    return {"ceiling_u": hover_u * np.sqrt(_pick(level, (1.5, 1.35, 1.24), rng, 0.02))}


def _weak_rotor(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    return {
        "weak_share": _pick(level, (0.05, 0.11, 0.22), rng),
        "weak_index": float(rng.integers(craft.n_rotors)),
    }


def _cg_offset(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    x, y = _direction(rng)
    size = _pick(level, (0.02, 0.04, 0.07), rng) * craft.arm_m
    return {"cg_x_m": x * size, "cg_y_m": y * size}


def _rotor_tilt(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    x, y = _direction(rng)
    size = np.radians(_pick(level, (0.8, 1.6, 3.0), rng))
    return {"tilt_x_rad": x * size, "tilt_y_rad": y * size}


def _rotor_inertia(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    rate = _pick(level, (1.2, 2.5, 5.0), rng)
    return {"rotor_inertia_kg_m2": rate * craft.true["izz"] / craft.hover_speed_rad_s}


def _slung_load(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    return {"load_share": _pick(level, (0.04, 0.09, 0.18), rng), "rope_m": rng.uniform(0.2, 0.45)}


def _payload(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    x, y = _direction(rng)
    away = rng.uniform(0.0, 0.7) * craft.arm_m
    share = _pick(level, (0.08, 0.14, 0.24), rng)
    return {"payload_share": share, "payload_x_m": x * away, "payload_y_m": y * away}


def _tether(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    return {
        "tether_N_m": _pick(level, (0.01, 0.025, 0.05), rng) * _weight_N(craft),
        "tether_sag_m": rng.uniform(0.1, 0.4),
    }


def _inertia(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    return {"inertia_error": 1.0 + _pick(level, (0.28, 0.45, 0.7), rng, 0.1)}


def _mapping(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
    return _ground_effect(craft, level, rng) | {"mapping": 0.5}


def _number(
    key: str, values: tuple[float, float, float], spread: float = 0.15, **others: float
) -> Secret:
    return lambda craft, level, rng: {**others, key: _pick(level, values, rng, spread)}


def _either_way(key: str, values: tuple[float, float, float], spread: float = 0.15) -> Secret:
    return lambda craft, level, rng: {
        key: NEUTRAL[key] + _sign(rng) * _pick(level, values, rng, spread)
    }


def _of_weight(key: str, values: tuple[float, float, float]) -> Secret:
    return lambda craft, level, rng: {key: _pick(level, values, rng) * _weight_N(craft)}


def _over_ground(key: str, values: tuple[float, float, float]) -> Secret:
    return lambda craft, level, rng: (
        _ground_effect(craft, max(level, 1), rng) | {key: _pick(level, values, rng)}
    )


def _at_a_place(key: str) -> Secret:
    def secret(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
        x, y = rng.uniform(-1.0, 1.0, 2)
        force = _pick(level, (0.04, 0.08, 0.15), rng) * _weight_N(craft)
        return {key: force, "magnet_x_m": x, "magnet_y_m": y}

    return secret


def _bias(prefix: str, unit: str, values: tuple[float, float, float], axes: str = "xyz") -> Secret:
    def secret(craft: TrueVehicle, level: int, rng: np.random.Generator) -> dict[str, float]:
        # a normal vector over its length has no preferred direction
        direction = rng.standard_normal(len(axes))
        size = _pick(level, values, rng) * direction / np.linalg.norm(direction)
        return {f"{prefix}_{a}_{unit}": float(v) for a, v in zip(axes, size, strict=True)}

    return secret


PHYSICS: dict[str, Secret] = {
    "rotor_drag": _rotor_drag,
    "parasitic_drag": _parasitic_drag,
    "axial_inflow": _number("blade_s", (0.2, 0.45, 0.85), axial=1.0),
    "translational_lift": _number("blade_s", (0.35, 0.6, 1.0), edgewise=1.0),
    "wind": _wind,
    "gusts": _gusts,
    "ground_effect": _ground_effect,
    "ground_effect_forward_flight": _over_ground("image_sweep", (2.0, 3.5, 6.0)),
    "ground_effect_lag": _over_ground("image_lag", (1.5, 3.5, 8.0)),
    "ground_effect_moment": _over_ground("image_contrast", (0.8, 1.6, 3.0)),
    "fountain_lift": _number("fountain", (0.025, 0.05, 0.10)),
    "battery_sag": _number("sags", (0.3, 0.6, 0.95), 0.05),
    "motor_lag": _motor_lag,
    "esc_delay": _number("delay_s", (0.006, 0.012, 0.025)),
    "thrust_curve": _number("curve_droop", (0.08, 0.18, 0.35)),
    "rotor_saturation": _saturation,
    "weak_rotor": _weak_rotor,
    "cg_offset": _cg_offset,
    "rotor_tilt": _rotor_tilt,
    "rotor_inertia_reaction": _rotor_inertia,
    "slung_load": _slung_load,
    "payload": _payload,
    "coaxial_wake": _number("coaxial", (0.35, 0.6, 1.0)),
    "tether": _tether,
}
PARAMETER: dict[str, Secret] = {
    "thrust_scale": _either_way("thrust_error", (0.10, 0.15, 0.22), 0.1),
    "inertia": _inertia,
    "torque_coefficient": _either_way("torque_error", (0.3, 0.45, 0.6), 0.1),
    "actuator_mapping": _mapping,
}
SENSOR: dict[str, Secret] = {
    "rangefinder_bias": _either_way("range_bias_m", (0.03, 0.06, 0.12)),
    "rangefinder_lag": _number("range_lag_s", (0.06, 0.15, 0.35)),
    "time_offset": _either_way("time_offset_s", (0.015, 0.03, 0.06)),
    "accelerometer_bias": _bias("acc_bias", "m_s2", (0.15, 0.35, 0.8)),
    "gyro_bias": _bias("gyro_bias", "rad_s", (0.02, 0.05, 0.12)),
    "attitude_bias": _bias("att_bias", "rad", (0.014, 0.03, 0.06), "xy"),
}
UNLISTED: dict[str, Secret] = {
    "magnetic_patch": _at_a_place("magnet_N"),
    "wall_suction": _of_weight("wall_N", (0.03, 0.06, 0.12)),
    "updraft_column": _at_a_place("updraft_N"),
    "loose_hatch": _of_weight("hatch_N", (0.05, 0.1, 0.2)),
    "vortex_ring_buffet": _number("buffet", (0.08, 0.16, 0.3)),
    "flapping_moment": _number("pitch_up_s_m", (0.01, 0.02, 0.04)),
    "rotor_interference": _number("interference", (0.04, 0.08, 0.15)),
}
# library effects that are the same physics in another form: right answers, too
RELATED = {"wall_suction": ("wall_effect",)}
EVERY = PHYSICS | PARAMETER | SENSOR | UNLISTED
# what a physical secret brings with it: wind and gusts act through drag, the rest modify the
# ground's effect
COMPANIONS = {
    "wind": ("rotor_drag",),
    "gusts": ("rotor_drag",),
    "ground_effect_forward_flight": ("ground_effect",),
    "ground_effect_lag": ("ground_effect",),
    "ground_effect_moment": ("ground_effect",),
    "actuator_mapping": ("ground_effect",),
}
