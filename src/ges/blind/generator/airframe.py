"""Drawn vehicles: the true one, and the vehicle file that declares it with honest uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ges.conventions import GRAVITY_M_S2

RHO_KG_M3 = 1.225
# mass kg, rotor radius m, arm m, hover speed rad/s, Ixx kg m^2, motor lag s, battery V
CLASSES = {
    "27g": (0.030, 0.0231, 0.040, 2150.0, 1.6e-5, 0.045, 4.1),
    "120g": (0.12, 0.038, 0.062, 1800.0, 1.3e-4, 0.035, 8.2),
    "350g": (0.35, 0.051, 0.090, 1400.0, 9.0e-4, 0.030, 12.3),
    "650g": (0.65, 0.0635, 0.115, 1250.0, 3.2e-3, 0.030, 16.4),
    "1500g": (1.50, 0.120, 0.225, 560.0, 2.0e-2, 0.045, 12.3),
    "2500g": (2.50, 0.165, 0.310, 420.0, 5.6e-2, 0.065, 24.6),
}
SD_REL = {
    "mass": 0.01,
    "thrust": 0.025,
    "torque": 0.08,
    "inertia": 0.07,
    "lag": 0.12,
    "speed": 0.01,
}
# rotor order of three common autopilots: quadrant (front +x, left +y) and spin seen from above
QUADS = (
    ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw")),
    ((1, -1, "cw"), (-1, -1, "ccw"), (-1, 1, "cw"), (1, 1, "ccw")),
    ((1, 1, "cw"), (1, -1, "ccw"), (-1, -1, "cw"), (-1, 1, "ccw")),
)


# six arms at these degrees to the left of the nose, of two autopilots
HEXAS = (
    ((-90, "cw"), (90, "ccw"), (30, "cw"), (-150, "ccw"), (-30, "ccw"), (150, "cw")),
    ((-30, "ccw"), (30, "cw"), (90, "ccw"), (150, "cw"), (-150, "ccw"), (-90, "cw")),
)
# four arms with a rotor above and one below: quadrant, spin, and whether it is the upper one
X8S = (
    (
        (1, -1, "ccw", 1),
        (1, 1, "cw", 1),
        (-1, 1, "ccw", 1),
        (-1, -1, "cw", 1),
        (1, 1, "ccw", 0),
        (1, -1, "cw", 0),
        (-1, -1, "ccw", 0),
        (-1, 1, "cw", 0),
    ),
)
ROTORS = {"quad": 4, "hexa": 6, "x8": 8}
# arm and inertia over those of a quadrotor with rotors of the same size
LONGER, HEAVIER = {"hexa": 1.45, "x8": 1.0}, {"hexa": 1.9, "x8": 1.15}
HALF_PAIR = 0.35
"""Upper and lower rotor of a pair from the plane between both, in radii."""


@dataclass(frozen=True)
class TrueVehicle:
    """A drawn vehicle: its true numbers, and those that its file declares.

    Attributes
    ----------
    size : class of :data:`CLASSES`, or the name of a vehicle.
    radius_m : rotor radius.
    rotor_x_m, rotor_y_m : (n_rotors,) hubs in the body frame.
    rotor_z_m : height of the rotor plane.
    spin : +1 for a rotor that turns counter-clockwise seen from above, else -1.
    battery_V : voltage of the full battery.
    nominal, true : mass, ixx, iyy, izz, thrust (N s^2), torque (N m s^2), lag (s) and top speed
        (rad/s), in SI units.
    rotor_level_m : height of each rotor over the plane at ``rotor_z_m``; empty where all lie in it.
    """

    size: str
    radius_m: float
    rotor_x_m: tuple[float, ...]
    rotor_y_m: tuple[float, ...]
    rotor_z_m: float
    spin: tuple[int, ...]
    battery_V: float
    nominal: dict[str, float]
    true: dict[str, float]
    rotor_level_m: tuple[float, ...] = ()

    @property
    def n_rotors(self) -> int:
        """Number of rotors: 4, 6 or 8."""
        return len(self.rotor_x_m)

    @property
    def hubs_m(self) -> np.ndarray:
        """Hubs in the body frame, (n_rotors, 3)."""
        level = np.array(self.rotor_level_m or (0.0,) * self.n_rotors)
        return np.stack([self.rotor_x_m, self.rotor_y_m, self.rotor_z_m + level], axis=1)

    @property
    def upper(self) -> tuple[int, ...]:
        """Index of the rotor above each rotor, -1 where there is none."""
        hubs = self.hubs_m
        over = [
            [j for j, b in enumerate(hubs) if np.allclose(a[:2], b[:2]) and b[2] > a[2]]
            for a in hubs
        ]
        return tuple(above[0] if above else -1 for above in over)

    @property
    def spacing_m(self) -> float:
        """Distance of the nearest hubs that are not one above the other."""
        plane = self.hubs_m[:, :2]
        gaps = np.hypot(*(plane[:, None] - plane[None, :]).transpose(2, 0, 1))
        return float(gaps[gaps > 0.1 * self.radius_m].min())

    @property
    def hover_speed_rad_s(self) -> float:
        """Rotor speed at which the thrust equals the true weight."""
        weight_N = self.true["mass"] * GRAVITY_M_S2
        return float(np.sqrt(weight_N / (self.n_rotors * self.true["thrust"])))

    @property
    def arm_m(self) -> float:
        """Distance of the first hub from the body's z axis."""
        return float(np.hypot(self.rotor_x_m[0], self.rotor_y_m[0]))

    def vehicle_file(self, terrain: dict) -> dict:
        """Return the content of the vehicle file.

        Parameters
        ----------
        terrain : its entry of that name.

        Returns
        -------
        Nominal parameters with their sds of :data:`SD_REL`, and no effects.
        """
        value = {k: float(f"{v:.6g}") for k, v in self.nominal.items()}
        rotors = zip(self.hubs_m.round(6).tolist(), self.spin, strict=True)
        return {
            "name": "vehicle",
            "mass_kg": {
                "value": value["mass"],
                "sd": float(f"{value['mass'] * SD_REL['mass']:.3g}"),
            },
            "inertia_kg_m2": {
                "xx": value["ixx"],
                "yy": value["iyy"],
                "zz": value["izz"],
                "sd_rel": SD_REL["inertia"],
            },
            "rotors": [
                {
                    "x_m": x,
                    "y_m": y,
                    "z_m": z,
                    "radius_m": self.radius_m,
                    "spin": "ccw" if spin > 0 else "cw",
                }
                for (x, y, z), spin in rotors
            ],
            "thrust_coefficient_N_s2": {"value": value["thrust"], "sd_rel": SD_REL["thrust"]},
            "torque_coefficient_Nm_s2": {"value": value["torque"], "sd_rel": SD_REL["torque"]},
            "motor_time_constant_s": {"value": value["lag"], "sd_rel": SD_REL["lag"]},
            "max_rotor_speed_rad_s": {"value": value["speed"], "sd_rel": SD_REL["speed"]},
            "rho_kg_m3": RHO_KG_M3,
            "terrain": terrain,
            "effects": {},
        }


def draw_airframe(size: str, rng: np.random.Generator, frame: str = "quad") -> TrueVehicle:
    """Draw a vehicle and the errors of its file.

    Parameters
    ----------
    size : class of :data:`CLASSES`.
    rng : stream of all draws.
    frame : 'quad', 'hexa' or 'x8'.

    Returns
    -------
    Errors are normal, within two sds of :data:`SD_REL`.
    """
    mass, radius, arm, hover, ixx, lag, volt = (v * rng.uniform(0.88, 1.12) for v in CLASSES[size])
    arm, ixx = arm * LONGER.get(frame, 1.0), ixx * HEAVIER.get(frame, 1.0)
    thrust = mass * GRAVITY_M_S2 / (ROTORS[frame] * hover**2)
    nominal = {
        "mass": mass,
        "ixx": ixx,
        "iyy": ixx * rng.uniform(1.0, 1.15),
        "izz": ixx * rng.uniform(1.6, 1.9),
        "thrust": thrust,
        "torque": thrust * (0.15 * radius + 0.0035),
        "lag": lag,
        # thrust over weight of 1.9 to 2.4 at top speed
        "speed": hover * np.sqrt(rng.uniform(1.9, 2.4)),
    }
    places, spins, levels = _places(frame, float(arm), float(radius), rng)
    return TrueVehicle(
        size=size,
        radius_m=round(float(radius), 4),
        rotor_x_m=tuple(x for x, _ in places),
        rotor_y_m=tuple(y for _, y in places),
        rotor_z_m=round(float(0.25 * radius), 4),
        spin=spins,
        battery_V=float(volt),
        nominal={k: float(v) for k, v in nominal.items()},
        true=_with_errors(nominal, rng),
        rotor_level_m=levels,
    )


def _places(
    frame: str, arm_m: float, radius_m: float, rng: np.random.Generator
) -> tuple[list[tuple[float, float]], tuple[int, ...], tuple[float, ...]]:
    """Draw the order of a frame's motors: places (x, y), spins, and levels of coaxial ones."""
    if frame == "hexa":
        arms = HEXAS[rng.integers(len(HEXAS))]
        turned = np.radians([angle for angle, _ in arms])
        hubs = np.stack([arm_m * np.cos(turned), arm_m * np.sin(turned)], axis=1).round(4) + 0.0
        return [(float(x), float(y)) for x, y in hubs], _senses([s for _, s in arms]), ()
    # an X layout: each hub as far ahead as aside
    lever = round(float(arm_m / np.sqrt(2.0)), 4)
    if frame == "x8":
        motors = X8S[rng.integers(len(X8S))]
        levels = tuple(round((2 * up - 1) * HALF_PAIR * radius_m, 4) for *_, up in motors)
        at = [(lever * x, lever * y) for x, y, _, _ in motors]
        return at, _senses([s for _, _, s, _ in motors]), levels
    quad = QUADS[rng.integers(len(QUADS))]
    return [(lever * x, lever * y) for x, y, _ in quad], _senses([s for _, _, s in quad]), ()


def _senses(spins: Sequence[str]) -> tuple[int, ...]:
    return tuple(1 if s == "ccw" else -1 for s in spins)


def _with_errors(nominal: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    number_of = {"ixx": "inertia", "iyy": "inertia", "izz": "inertia"}
    errors = {
        k: np.clip(rng.standard_normal(), -2.0, 2.0) * SD_REL[number_of.get(k, k)] for k in nominal
    }
    return {k: float(v * (1.0 + errors[k])) for k, v in nominal.items()}


def draw_nominal(true: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Draw what a file honestly declares of known true numbers.

    Parameters
    ----------
    true : numbers by name, as of :class:`TrueVehicle`.
    rng : stream of the errors.

    Returns
    -------
    Each number off by a normal error of its :data:`SD_REL`, within two sds.
    """
    return _with_errors(true, rng)
