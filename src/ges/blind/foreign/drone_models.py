"""drone-models (Learning Systems Lab, TU Munich): first-principles Crazyflies identified from
flights; its equations of motion under the concealed cases' own controller.

The linear terms of its thrust and torque curves are left out: a vehicle file cannot state them, so
they would be in every set. The limit follows from its own accelerations along the flown path with
and without each effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ges.blind.foreign.paths import Scale, references
from ges.blind.foreign.sets import Concealed, Design, OffPath, Place, one_by_one, untrimmed
from ges.blind.generator.airframe import TrueVehicle, draw_nominal
from ges.blind.generator.detectable import TrueFlight
from ges.blind.generator.pilot import Pilot

WORLD = "drone-models"
NEEDS = ("drone_models",)
DRONES = ("cf2x_L250", "cf2x_P250", "cf2x_T350")
RPM = 60.0 / (2.0 * np.pi)
RADIUS_M = 0.0235
SECONDS, STEP_S = 14.0, 0.004
SPEED_M_S, SMOOTH_S = 1.1, 0.35
OFF_PATH_M = 3.0
METHOD = "force along the path, drone-models' own accelerations with and without each effect"


@dataclass(frozen=True)
class DroneModelsDesign(Design):
    """A set to fly by the equations of drone-models.

    Attributes
    ----------
    across, along : share of the published drag across and along the thrust axis.
    propeller : share of the published inertia of the propellers.
    """

    across: float = 0.0
    along: float = 0.0
    propeller: float = 0.0

    def concealed(self) -> Concealed:
        """Return the truth of the set.

        Returns
        -------
        ``motor_lag`` is always true or optional. The motors slow down faster than they speed up,
        and a file has one time constant.
        """
        effects = [name for n, name in NAMES.items() if getattr(self, n)]
        small = max(self.across, self.along, self.propeller) < 0.5 and not self.wrong
        optional = ("gyroscopic_moment",) if self.propeller else ()
        return self._concealed(
            effects,
            "weak" if small else "strong",
            optional=optional if "lag" in self.wrong else (*optional, "motor_lag"),
        )


NAMES = {
    "across": "rotor_drag",
    "along": "axial_inflow",
    "propeller": "rotor_inertia_reaction",
}


def designs(half: str) -> list[DroneModelsDesign]:
    """Return the sets of a half; one drone is in both, small sizes differ."""
    drones = {"development": DRONES[:2], "evaluation": DRONES[1:]}[half]
    small = {"development": 0.25, "evaluation": 0.35}[half]
    listed = [DroneModelsDesign(d, copy=k) for d in drones for k in range(2)]
    for d in drones:
        listed += [
            DroneModelsDesign(d, across=1.0),
            DroneModelsDesign(d, across=small),
            DroneModelsDesign(d, along=1.0),
            DroneModelsDesign(d, across=1.0, along=1.0),
            DroneModelsDesign(d, propeller=2.0),
        ]
    return listed + [
        DroneModelsDesign(drones[0], across=1.0, propeller=2.0),
        DroneModelsDesign(drones[1], wrong={"lag": 0.55}),
        DroneModelsDesign(drones[0], wrong={"mass": 1.13}),
        DroneModelsDesign(drones[1], across=1.0, wrong={"mass": 0.87}),
        DroneModelsDesign(drones[0], wrong={"torque": 0.6}),
        DroneModelsDesign(drones[1], wrong={"inertia": 1.4}),
    ]


def _fly_design(
    design: DroneModelsDesign, place: Place, rate_hz: float
) -> tuple[TrueVehicle, list[TrueFlight]]:
    numbers = _numbers(design)
    craft = airframe(design.vehicle, numbers, place.rng("file"))
    rng = place.rng("paths")
    scale = Scale(0.3, RADIUS_M, SPEED_M_S, SMOOTH_S)
    plans = references(place.half, SECONDS, STEP_S, scale, rng)
    return craft, _fly(design, numbers, craft, np.stack(plans, axis=-1), rng)


make = one_by_one(_fly_design, METHOD)


def _numbers(design: DroneModelsDesign) -> dict[str, Any]:
    from drone_models import parametrize
    from drone_models.first_principles import dynamics

    numbers = dict(parametrize(dynamics, design.vehicle).keywords)
    share = np.diag([design.across, design.across, design.along])
    numbers["drag_matrix"] = np.asarray(numbers["drag_matrix"]) * share
    numbers["prop_inertia"] = design.propeller * numbers["prop_inertia"]
    for curve in ("rpm2thrust", "rpm2torque"):
        numbers[curve] = np.asarray(numbers[curve]) * np.array([0.0, 0.0, 1.0])
    return numbers


def airframe(drone: str, numbers: Mapping[str, Any], rng: np.random.Generator) -> TrueVehicle:
    """Return the true vehicle, and a file about it with honest errors.

    Parameters
    ----------
    drone : name of the drone.
    numbers : parameters as drone-models has them, with rotor speeds in RPM.
    rng : stream that the errors of the file are drawn from.

    Notes
    -----
    A positive entry in the last row of the mixing matrix turns the body counter-clockwise, so that
    the rotor turns clockwise. The time constant of a file is the mean of speeding up and slowing
    down in hover.
    """
    mixing, arm = np.asarray(numbers["mixing_matrix"]), float(np.ravel(numbers["L"])[0])
    inertia = np.diag(np.asarray(numbers["J"]))
    mass = float(np.ravel(numbers["mass"])[0])
    curves = (np.ravel(numbers[k]) for k in ("rpm2thrust", "rpm2torque"))
    thrust, torque = (float(curve[2]) * RPM**2 for curve in curves)
    hover = np.sqrt(mass * 9.81 / (4.0 * thrust))
    up, up_squares, down, down_squares = np.ravel(numbers["rotor_dyn_coef"])
    # dw/dt = a (u - w) + b (u^2 - w^2) answers small changes about hover with the rate a + 2 b w
    rates = np.array([up, down]) + 2.0 * np.array([up_squares, down_squares]) * hover * RPM
    true = dict(zip(("ixx", "iyy", "izz"), inertia, strict=True))
    true |= {"mass": mass, "thrust": thrust, "torque": torque}
    # its equations know no top speed; half again that of hover leaves room to steer
    true |= {"lag": float(np.mean(1.0 / rates)), "speed": 1.5 * hover}
    true = {key: float(value) for key, value in true.items()}
    return TrueVehicle(
        size=drone,
        radius_m=RADIUS_M,
        # rows of the mixing matrix over the arm: M_x = y T, M_y = -x T
        rotor_x_m=tuple(float(v) for v in -arm * mixing[1]),
        rotor_y_m=tuple(float(v) for v in arm * mixing[0]),
        rotor_z_m=0.0,
        spin=tuple(-int(s) for s in np.sign(mixing[2])),
        battery_V=4.1,
        nominal=draw_nominal(true, rng),
        true=true,
    )


def _fly(
    design: DroneModelsDesign,
    numbers: Mapping[str, Any],
    craft: TrueVehicle,
    reference: np.ndarray,
    rng: np.random.Generator,
) -> list[TrueFlight]:
    """Fly references (11, n, flights) abreast by Runge and Kutta's fourth order."""
    flights = reference.shape[2]
    pilot = untrimmed(craft, design.wrong, craft.true["lag"], STEP_S, flights)
    first, half = reference[:, 0].T, 0.5 * reference[9, 0]
    s = np.zeros((flights, 17))
    s[:, :3], s[:, 5], s[:, 6] = first[:, :3], np.sin(half), np.cos(half)
    # it starts in hover at the start of its path
    s[:, 13:] = craft.hover_speed_rad_s * RPM
    without = {n: numbers_without(numbers, n) for n in NAMES if getattr(design, n)}
    rows = []
    for k in range(reference.shape[1]):
        ref = reference[:, k]
        u = _command(pilot, ref, s, rng)
        asked = u * craft.true["speed"] * RPM
        k1 = _rate(numbers, s, asked)
        rows.append(_row(craft, without, s, k1, u, ref.T, asked))
        k2 = _rate(numbers, s + 0.5 * STEP_S * k1, asked)
        k3 = _rate(numbers, s + 0.5 * STEP_S * k2, asked)
        k4 = _rate(numbers, s + STEP_S * k3, asked)
        s = s + STEP_S / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        # Runge and Kutta's sums leave the unit sphere by a little every step
        s[:, 3:7] /= np.linalg.norm(s[:, 3:7], axis=1, keepdims=True)
        if not np.abs(s[:, :3] - ref[:3].T).max() < OFF_PATH_M:
            raise OffPath(f"'{design.key}' lost its path; the path is too fast for the drone")
    book = {n: np.stack([r[n] for r in rows], axis=1) for n in rows[0]}
    return [
        TrueFlight(
            STEP_S,
            {n: v[f] for n, v in book.items() if "/" not in n},
            {NAMES[n]: {c: book[f"{n}/{c}"][f] for c in ("force_N", "moment_Nm")} for n in without},
        )
        for f in range(flights)
    ]


def numbers_without(numbers: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the parameters of drone-models, or of crazyflow, without one effect.

    Parameters
    ----------
    numbers : parameters by their own names.
    name : key of :data:`NAMES`.
    """
    if name == "propeller":
        return {**numbers, "prop_inertia": 0.0 * numbers["prop_inertia"]}
    kept = np.array([0.0, 0.0, 1.0]) if name == "across" else np.array([1.0, 1.0, 0.0])
    return {**numbers, "drag_matrix": numbers["drag_matrix"] * np.diag(kept)}


def _command(pilot: Pilot, ref: np.ndarray, s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the commands (flights, 4) of a controller that sees its state with noise."""
    noise = rng.standard_normal((3, 3, len(s)))
    p = s[:, :3].T + 0.001 * noise[0]
    v = s[:, 7:10].T + 0.005 * noise[1]
    omega = s[:, 10:13].T + 0.005 * noise[2]
    turn = Rotation.from_quat(s[:, 3:7]).as_matrix().transpose(1, 2, 0)
    still = np.zeros((4, len(s)))
    return pilot.command(ref, still, p, v, turn, omega, np.ones(len(s))).T


def _rate(numbers: Mapping[str, Any], s: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Return the rate of states (flights, 17) by drone-models' equations of motion.

    The rate of the quaternion, scalar last, is written out: theirs (0.1.0) puts the scalar first.
    """
    from drone_models.first_principles import dynamics

    q, omega = s[:, 3:7], s[:, 10:13]
    p, _, v, w, rotors = dynamics(s[:, :3], q, s[:, 7:10], omega, asked, s[:, 13:], **numbers)
    # dq/dt = q (0, omega) / 2
    vector = q[:, 3:] * omega + np.cross(q[:, :3], omega)
    scalar = -(q[:, :3] * omega).sum(axis=1, keepdims=True)
    return np.concatenate([p, 0.5 * vector, 0.5 * scalar, v, w, rotors], axis=1)


def _row(
    craft: TrueVehicle,
    without: Mapping[str, Mapping[str, Any]],
    s: np.ndarray,
    rate: np.ndarray,
    u: np.ndarray,
    ref: np.ndarray,
    asked: np.ndarray,
) -> dict[str, np.ndarray]:
    turn = Rotation.from_quat(s[:, 3:7])
    row = {
        "p": s[:, :3],
        "v": s[:, 7:10],
        "q": s[:, [6, 3, 4, 5]],
        "omega": s[:, 10:13],
        "rotor_speed": s[:, 13:] / RPM,
        "u": u,
        "specific_force": turn.apply(rate[:, 7:10] + np.array([0.0, 0.0, 9.81]), inverse=True),
        "p_ref": ref[:, :3],
        "v_ref": ref[:, 3:6],
        "yaw_ref": ref[:, 9:10],
    }
    inertia = np.array([craft.true[k] for k in ("ixx", "iyy", "izz")])
    for name, numbers in without.items():
        # at the same states, so that all else, gyroscopic terms too, drops out of the difference
        off = rate - _rate(numbers, s, asked)
        row[f"{name}/force_N"] = craft.true["mass"] * turn.apply(off[:, 7:10], inverse=True)
        row[f"{name}/moment_Nm"] = inertia * off[:, 10:13]
    return row
