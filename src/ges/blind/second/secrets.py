"""Vehicles of the second author, and how strongly each effect is concealed in them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ges.blind.second import ground, rotor
from ges.blind.second.flight import RHO_KG_M3
from ges.blind.second.pilot import G_M_S2

# mass kg, rotor radius m, half the distance of neighbouring hubs m, hover speed rad/s, Ixx kg m^2,
# lag s
VEHICLES = {
    "s45": (0.045, 0.029, 0.036, 1900.0, 2.6e-5, 0.05),
    "s250": (0.25, 0.0445, 0.062, 1550.0, 5.2e-4, 0.032),
    "s900": (0.90, 0.089, 0.125, 760.0, 7.5e-3, 0.035),
    "s1900": (1.90, 0.14, 0.19, 490.0, 3.1e-2, 0.055),
}
LAYOUT = ((1, 1, 1), (1, -1, -1), (-1, -1, 1), (-1, 1, -1))
LEVELS = ("weak", "medium", "strong")


def true_numbers(size: str, rng: np.random.Generator) -> dict[str, float]:
    """Draw the true numbers of a vehicle.

    Parameters
    ----------
    size : class of :data:`VEHICLES`.
    rng : stream of all draws.

    Returns
    -------
    mass, ixx, iyy, izz, thrust (N s^2), torque (N m s^2), lag (s) and top speed (rad/s), in SI
    units.
    """
    mass, radius, _, hover, ixx, lag = VEHICLES[size]
    mass, hover, ixx, lag = (v * rng.uniform(0.9, 1.1) for v in (mass, hover, ixx, lag))
    thrust = mass * G_M_S2 / (4.0 * hover**2)
    return {
        "mass": mass,
        "ixx": ixx,
        "iyy": ixx * rng.uniform(0.9, 1.2),
        "izz": ixx * rng.uniform(1.65, 1.95),
        "thrust": thrust,
        "torque": thrust * 0.17 * radius,
        "lag": lag,
        "speed": hover * float(np.sqrt(rng.uniform(2.0, 2.6))),
    }


class Craft:
    """What a concealed effect must know of a vehicle.

    Parameters
    ----------
    size : class of :data:`VEHICLES`.
    true : its true numbers, as of :func:`true_numbers`.
    """

    def __init__(self, size: str, true: dict[str, float]) -> None:
        _, self.radius_m, self.lever_m, _, _, _ = VEHICLES[size]
        self.true = true
        self.weight_N = true["mass"] * G_M_S2
        self.hover_rad_s = float(np.sqrt(self.weight_N / (4.0 * true["thrust"])))
        self.disc = RHO_KG_M3 * np.pi * self.radius_m**2
        self.thrust_coefficient = true["thrust"] / (self.disc * self.radius_m**2)

    def blade_force_N_s_m(self, s: float) -> float:
        """Return the in-plane force of four hovering rotors at 1 m/s.

        Parameters
        ----------
        s : solidity times lift slope.
        """
        tip = self.hover_rad_s * self.radius_m
        pitch = rotor.pitch_of(s, self.thrust_coefficient)
        return 4.0 * self.disc * tip**2 * float(rotor.coefficients(s, pitch, 1.0 / tip, 0.0)[1][0])

    def blocked_for(self, gain: float, s: float) -> float:
        """Return the blocked share, over theory's, of a ground-effect thrust gain.

        Parameters
        ----------
        gain : share of thrust that a rotor gains one radius above the ground.
        s : solidity times lift slope.
        """
        table = rotor.table_of(s, self.thrust_coefficient).near_ground
        # thrust falls as more of the inflow is left; interpolation wants it to rise
        share = float(np.interp(-(1.0 + gain), -table, rotor.SHARES))
        return (1.0 - share) / float(ground.blocked_share(np.array(1.0)))


Numbers = dict[str, float]


def _near(level: int, values: tuple[float, float, float], rng: np.random.Generator) -> float:
    return values[level] * rng.uniform(0.85, 1.15)


def _either(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _drag(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    share = _near(level, (0.008, 0.02, 0.04), rng) * craft.weight_N
    return {"blade_s": 0.6, "drag_gain": share / craft.blade_force_N_s_m(0.6)}


def _box(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    # a share of the weight at 3 m/s
    share = _near(level, (0.02, 0.05, 0.1), rng) * craft.weight_N
    return {"area_m2": share / (0.5 * RHO_KG_M3 * 9.0)}


def _wind(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    speed = _near(level, (1.2, 2.4, 4.0), rng)
    return _drag(craft, 1, rng) | {"wind_m_s": speed, "wind_rad": rng.uniform(0.0, 2.0 * np.pi)}


def _gusts(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    return _drag(craft, 1, rng) | {"gust_m_s": _near(level, (0.4, 0.8, 1.5), rng)}


def _ground_effect(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    gain = _near(level, (0.05, 0.1, 0.2), rng)
    return {"blade_s": 0.9, "blocked": craft.blocked_for(gain, 0.9)}


def _of_companion(level: int) -> int:
    return max(level, 1)


def _direction(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _offset(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    size = _near(level, (0.02, 0.045, 0.08), rng) * craft.lever_m * np.sqrt(2.0)
    x, y = size * _direction(rng)
    return {"cg_x_m": float(x), "cg_y_m": float(y)}


def _tilt(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    x, y = np.radians(_near(level, (0.8, 1.7, 3.2), rng)) * _direction(rng)
    return {"tilt_x_rad": float(x), "tilt_y_rad": float(y)}


def _cap(craft: Craft, level: int, rng: np.random.Generator) -> Numbers:
    # the ceiling lies at this thrust over weight; thrust goes with the square of the speed
    hover = craft.hover_rad_s / craft.true["speed"]
    return {"cap": hover * float(np.sqrt(_near(level, (1.6, 1.42, 1.3), rng)) / 1.0)}


SECRETS: dict[str, Callable[[Craft, int, np.random.Generator], Numbers]] = {
    "rotor_drag": _drag,
    "parasitic_drag": _box,
    "axial_inflow": lambda c, k, rng: {"axial": 1.0, "blade_s": _near(k, (0.25, 0.5, 0.9), rng)},
    "translational_lift": lambda c, k, rng: {
        "edgewise": 1.0,
        "blade_s": _near(k, (0.35, 0.6, 1.0), rng),
    },
    "wind": _wind,
    "gusts": _gusts,
    "ground_effect": _ground_effect,
    "ground_effect_forward_flight": lambda c, k, rng: (
        _ground_effect(c, _of_companion(k), rng) | {"sweep": _near(k, (1.5, 3.0, 5.0), rng)}
    ),
    "ground_effect_lag": lambda c, k, rng: (
        _ground_effect(c, _of_companion(k), rng) | {"wake_delay": _near(k, (2.0, 5.0, 9.0), rng)}
    ),
    "ground_effect_moment": lambda c, k, rng: (
        _ground_effect(c, _of_companion(k), rng) | {"levelling": _near(k, (0.15, 0.35, 0.7), rng)}
    ),
    "fountain_lift": lambda c, k, rng: {"fountain": _near(k, (0.03, 0.06, 0.11), rng)},
    "battery_sag": lambda c, k, rng: {"sags": _near(k, (0.35, 0.65, 1.0), rng)},
    "motor_lag": lambda c, k, rng: {
        "lag_gain": _near(k, (1.5, 2.0, 2.6), rng),
        "coast": rng.uniform(1.0, 1.4),
    },
    "esc_delay": lambda c, k, rng: {"frame_s": _near(k, (0.007, 0.014, 0.026), rng)},
    "thrust_curve": lambda c, k, rng: {"bent": _near(k, (0.15, 0.3, 0.55), rng)},
    "rotor_saturation": _cap,
    "weak_rotor": lambda c, k, rng: {
        "weak_share": _near(k, (0.05, 0.11, 0.2), rng),
        "weak_index": float(rng.integers(4)),
    },
    "cg_offset": _offset,
    "rotor_tilt": _tilt,
    "rotor_inertia_reaction": lambda c, k, rng: {
        "propeller_kg_m2": _near(k, (1.2, 2.5, 5.0), rng) * c.true["izz"] / c.hover_rad_s
    },
    "slung_load": lambda c, k, rng: {
        "load_share": _near(k, (0.04, 0.09, 0.16), rng),
        "cord_m": rng.uniform(0.25, 0.5),
    },
    "tether": lambda c, k, rng: {"hose_N_m": _near(k, (0.01, 0.025, 0.05), rng) * c.weight_N},
    "thrust_scale": lambda c, k, rng: {
        "density": 1.0 + _either(rng) * _near(k, (0.1, 0.15, 0.22), rng)
    },
    "inertia": lambda c, k, rng: {"inertia_error": 1.0 + _near(k, (0.3, 0.45, 0.7), rng)},
    "torque_coefficient": lambda c, k, rng: {
        "torque_error": 1.0 + _either(rng) * _near(k, (0.3, 0.45, 0.6), rng)
    },
}
UNLISTED: dict[str, Callable[[Craft, int, np.random.Generator], Numbers]] = {
    "magnus": lambda c, k, rng: {"magnus_s": _near(k, (0.03, 0.06, 0.12), rng)},
    "dragged_cable": lambda c, k, rng: {"rubbing": _near(k, (0.01, 0.025, 0.05), rng)},
    "slosh": lambda c, k, rng: {"slosh": _near(k, (0.1, 0.2, 0.35), rng)},
}
