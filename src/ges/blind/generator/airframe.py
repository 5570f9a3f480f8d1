"""Drawn vehicles: the true one, and the vehicle file that declares it with honest doubt."""

from __future__ import annotations

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
DOUBTS = {
    "mass": 0.01,
    "thrust": 0.025,
    "torque": 0.08,
    "inertia": 0.07,
    "lag": 0.12,
    "speed": 0.01,
}
# rotor order of three common autopilots: quadrant (front +x, left +y) and spin seen from above
LAYOUTS = (
    ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw")),
    ((1, -1, "cw"), (-1, -1, "ccw"), (-1, 1, "cw"), (1, 1, "ccw")),
    ((1, 1, "cw"), (1, -1, "ccw"), (-1, -1, "cw"), (-1, 1, "ccw")),
)


@dataclass(frozen=True)
class Airframe:
    """One vehicle: numbers that are exact, and those that are declared with an error."""

    size: str
    radius_m: float
    rotor_x_m: tuple[float, ...]
    rotor_y_m: tuple[float, ...]
    rotor_z_m: float
    spin: tuple[int, ...]
    battery_V: float
    declared: dict[str, float]
    true: dict[str, float]

    @property
    def hover_speed_rad_s(self) -> float:
        """Rotor speed that carries the true weight."""
        return float(np.sqrt(self.true["mass"] * GRAVITY_M_S2 / (4.0 * self.true["thrust"])))

    @property
    def hover_induced_m_s(self) -> float:
        """Momentum theory's induced velocity in hover, sqrt(T / (2 rho A))."""
        disc = RHO_KG_M3 * np.pi * self.radius_m**2
        return float(np.sqrt(self.true["mass"] * GRAVITY_M_S2 / (8.0 * disc)))

    @property
    def arm_m(self) -> float:
        """Distance from the centre to a rotor axis."""
        return float(np.hypot(self.rotor_x_m[0], self.rotor_y_m[0]))

    def vehicle_file(self, terrain: dict) -> dict:
        """Return the vehicle file's content: declared values with their doubts, no effects."""
        value = {k: float(f"{v:.6g}") for k, v in self.declared.items()}
        rotors = zip(self.rotor_x_m, self.rotor_y_m, self.spin, strict=True)
        return {
            "name": "vehicle",
            "mass_kg": {
                "value": value["mass"],
                "sd": float(f"{value['mass'] * DOUBTS['mass']:.3g}"),
            },
            "inertia_kg_m2": {
                "xx": value["ixx"],
                "yy": value["iyy"],
                "zz": value["izz"],
                "sd_rel": DOUBTS["inertia"],
            },
            "rotors": [
                {
                    "x_m": x,
                    "y_m": y,
                    "z_m": self.rotor_z_m,
                    "radius_m": self.radius_m,
                    "spin": "ccw" if spin > 0 else "cw",
                }
                for x, y, spin in rotors
            ],
            "thrust_coefficient_N_s2": {"value": value["thrust"], "sd_rel": DOUBTS["thrust"]},
            "torque_coefficient_Nm_s2": {"value": value["torque"], "sd_rel": DOUBTS["torque"]},
            "motor_time_constant_s": {"value": value["lag"], "sd_rel": DOUBTS["lag"]},
            "max_rotor_speed_rad_s": {"value": value["speed"], "sd_rel": DOUBTS["speed"]},
            "rho_kg_m3": RHO_KG_M3,
            "terrain": terrain,
            "effects": {},
        }


def draw_airframe(size: str, rng: np.random.Generator) -> Airframe:
    """Draw a vehicle of a size class and the errors of its file (normal, within two
    declared sd).
    """
    mass, radius, arm, hover, ixx, lag, volt = (v * rng.uniform(0.88, 1.12) for v in CLASSES[size])
    thrust = mass * GRAVITY_M_S2 / (4.0 * hover**2)
    declared = {
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
    layout = LAYOUTS[rng.integers(len(LAYOUTS))]
    # an X layout: each hub as far ahead as aside
    lever = round(float(arm / np.sqrt(2.0)), 4)
    return Airframe(
        size=size,
        radius_m=round(float(radius), 4),
        rotor_x_m=tuple(lever * x for x, _, _ in layout),
        rotor_y_m=tuple(lever * y for _, y, _ in layout),
        rotor_z_m=round(float(0.25 * radius), 4),
        spin=tuple(1 if s == "ccw" else -1 for _, _, s in layout),
        battery_V=float(volt),
        declared={k: float(v) for k, v in declared.items()},
        true=_with_errors(declared, rng),
    )


def _with_errors(declared: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    doubt_of = {"ixx": "inertia", "iyy": "inertia", "izz": "inertia"}
    errors = {
        k: np.clip(rng.standard_normal(), -2.0, 2.0) * DOUBTS[doubt_of.get(k, k)] for k in declared
    }
    return {k: float(v * (1.0 + errors[k])) for k, v in declared.items()}


def declare(true: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Return what a file honestly says of known true numbers: each off by its doubt, within two of
    it.
    """
    return _with_errors(true, rng)
