"""multirotor (Ahmed and others): blade-element propellers, electric motors and equations of motion
as that package has them, flown by the concealed cases' own controller.

Thrust of a blade falls with climb and rises with speed along the disc; a motor is a winding with a
back electromotive force, loaded by the torque of its propeller. The limit follows from the
package's own thrusts along the flown path with and without each effect.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ges.blind.foreign.paths import Scale, references
from ges.blind.foreign.piloted import change_by_shift, noisy_command, require_on_path
from ges.blind.foreign.sets import Concealed, Design, Place, one_by_one, untrimmed
from ges.blind.generator.airframe import RHO_KG_M3, TrueVehicle, draw_nominal
from ges.blind.generator.detectable import TrueFlight, body_of, driven
from ges.conventions import GRAVITY_M_S2

WORLD = "multirotor"
NEEDS = ("multirotor",)
SECONDS = 15.0
STEP_S, STEPS_A_COMMAND = 0.002, 2
INCH_M = 0.0254
BATTERY_V = 14.8
# mass kg, rotor radius and pitch m, chord over radius, lever m, inertia kg m^2, thrust over weight,
# lag s, drag of the propeller over the back electromotive force in hover, speed m/s
VEHICLES = {
    "quad": (0.9, 0.102, 0.114, 0.16, 0.14, (0.0072, 0.0078, 0.0134), 2.4, 0.035, 0.30, 3.0),
    "hexa": (2.4, 0.127, 0.114, 0.14, 0.28, (0.048, 0.051, 0.088), 2.2, 0.045, 0.35, 3.0),
    # numbers of the package's own Tarot T18, its motors as slow as such propellers are
    "t18": (10.66, 0.2286, 0.14, 0.10, 0.635, (0.2206, 0.2206, 0.4238), 2.2, 0.07, 0.40, 2.5),
}
# degrees to the left of the nose
ARMS = {
    "quad": (-45.0, 135.0, 45.0, -135.0),
    "hexa": (-90.0, 90.0, 30.0, -150.0, -30.0, 150.0),
    "t18": (67.5, 22.5, -22.5, -67.5, -112.5, -157.5, 157.5, 112.5),
}
SPIN = {
    "quad": (1, 1, -1, -1),
    "hexa": (-1, 1, -1, 1, 1, -1),
    "t18": (1, -1, 1, -1, 1, -1, 1, -1),
}
METHOD = "thrusts along the path, multirotor's own with and without each effect"


@dataclass(frozen=True)
class MultirotorDesign(Design):
    """A set to fly with multirotor: what differs from a plain vehicle.

    Attributes
    ----------
    blades : whether thrust is that of blades in moving air, or that of a constant.
    voltage : whether the command is a share of the voltage, or of the speed.
    ceiling : greatest voltage over that of full speed.
    weak : share of thrust and torque that rotor 2 loses.
    shift : shift of all rotors towards body -x over the arm; towards y it is half of that.
    """

    blades: bool = False
    voltage: bool = False
    ceiling: float = 1.0
    weak: float = 0.0
    shift: float = 0.0

    def concealed(self) -> Concealed:
        """Return the truth of the set, by the library's names."""
        names = ["axial_inflow", "translational_lift"] if self.blades else []
        names += ["thrust_curve"] if self.voltage else []
        names += ["rotor_saturation"] if self.ceiling < 1.0 else []
        names += ["weak_rotor"] if self.weak else []
        names += ["cg_offset"] if self.shift else []
        return self._concealed(
            names, "medium", places={"weak_rotor": ("rotor 2",)} if self.weak else {}
        )


def designs(half: str) -> list[MultirotorDesign]:
    """Return the sets of a half: the same effects in both, a quarter larger for evaluation."""
    more = {"development": 1.0, "evaluation": 1.25}[half]
    listed = [MultirotorDesign(v, copy=k) for k in range(2) for v in VEHICLES]
    for v in VEHICLES:
        listed += [
            MultirotorDesign(v, blades=True),
            MultirotorDesign(v, voltage=True),
            MultirotorDesign(v, ceiling=0.7 / more**0.5),
            MultirotorDesign(v, weak=0.18 * more),
            MultirotorDesign(v, shift=0.05 * more),
            MultirotorDesign(v, wrong={"mass": 1.0 - 0.12 * more}),
            MultirotorDesign(v, wrong={"lag": 1.0 / (2.0 * more)}),
            MultirotorDesign(v, blades=True, wrong={"inertia": 1.0 - 0.3 * more}),
            MultirotorDesign(v, blades=True, weak=0.16 * more),
        ]
    return listed + [
        MultirotorDesign("quad", wrong={"torque": 1.0 + 0.35 * more}),
        MultirotorDesign("hexa", blades=True, shift=0.05 * more),
        MultirotorDesign("t18", wrong={"inertia": 1.0 + 0.35 * more}),
    ]


def _fly_design(
    design: MultirotorDesign, place: Place, rate_hz: float
) -> tuple[TrueVehicle, list[TrueFlight]]:
    craft = _airframe(design, place.rng("file"))
    rng = place.rng("paths")
    lag, speed = craft.true["lag"], VEHICLES[design.vehicle][-1]
    scale = Scale(1.4 * craft.radius_m, craft.radius_m, speed, 0.18 + 2.0 * lag)
    plans = references(place.half, SECONDS, STEP_S, scale, rng)
    return craft, [_fly(design, craft, plan, rng) for plan in plans]


make = one_by_one(_fly_design, METHOD)


def _airframe(design: MultirotorDesign, rng: np.random.Generator) -> TrueVehicle:
    mass, radius, _, _, lever, inertia, lift, lag, _, _ = VEHICLES[design.vehicle]
    angles = np.radians(ARMS[design.vehicle])
    blade = _propeller(design.vehicle)
    # of still air thrust is k w^2, whatever the speed
    thrust = float(blade.thrust(100.0, np.zeros(3))) / 100.0**2
    hover = float(np.sqrt(mass * GRAVITY_M_S2 / (len(angles) * thrust)))
    true = dict(zip(("ixx", "iyy", "izz"), inertia, strict=True))
    true |= {"mass": mass, "thrust": thrust, "torque": thrust * 0.16 * radius}
    true |= {"lag": lag, "speed": hover * float(np.sqrt(lift))}
    return TrueVehicle(
        size=design.vehicle,
        radius_m=radius,
        rotor_x_m=tuple(float(v) for v in lever * np.cos(angles)),
        rotor_y_m=tuple(float(v) for v in lever * np.sin(angles)),
        rotor_z_m=0.0,
        spin=SPIN[design.vehicle],
        battery_V=BATTERY_V,
        nominal=draw_nominal(true, rng),
        true=true,
    )


def _propeller(vehicle: str) -> Any:
    """Return the package's propeller of a vehicle, by its blades.

    What it calls a diameter is its radius (0.5.0), and of the pitch it takes the ratio to that.
    """
    from multirotor.simulation import Propeller
    from multirotor.vehicle import PropellerParams, SimulationParams

    _, radius, pitch, chord, *_ = VEHICLES[vehicle]
    return Propeller(
        PropellerParams(
            moment_of_inertia=0.0,
            diameter=radius / INCH_M,
            pitch=0.5 * pitch / INCH_M,
            c=chord * radius,
            use_thrust_constant=False,
        ),
        SimulationParams(dt=STEP_S, g=GRAVITY_M_S2, rho=RHO_KG_M3),
    )


class _Drive:
    """The package's motors of a vehicle, and the voltages that a firmware asks for.

    In hover the torque of the propeller is a share of what the back electromotive force takes, and
    the time constant is the vehicle's lag.
    """

    def __init__(self, design: MultirotorDesign, craft: TrueVehicle) -> None:
        from multirotor.simulation import Motor
        from multirotor.vehicle import MotorParams, SimulationParams

        true, hover = craft.true, craft.hover_speed_rad_s
        share = VEHICLES[design.vehicle][8]
        self.design, self.top, self.curve = design, true["speed"], share / hover
        self.emf = BATTERY_V / (self.top * (1.0 + self.curve * self.top))
        # J dw/dt = k (V - k w) / R - q w^2
        damping = true["torque"] * hover / share
        inertia = true["lag"] * (damping + 2.0 * true["torque"] * hover)
        of_each = MotorParams(
            resistance=self.emf**2 / damping,
            k_emf=self.emf,
            k_drag=true["torque"],
            moment_of_inertia=inertia,
        )
        self.motors = [Motor(of_each, SimulationParams(dt=STEP_S)) for _ in range(craft.n_rotors)]
        for k, motor in enumerate(self.motors):
            motor.speed = hover
            # a propeller that lost thrust loads its motor less
            motor.params.k_drag *= 1.0 - design.weak * (k == 1)

    @property
    def speeds_rad_s(self) -> np.ndarray:
        return np.array([motor.speed for motor in self.motors])

    def step(self, u: np.ndarray) -> None:
        """Go on by a step under commands of 0 to 1."""
        wanted = u * self.top
        volts = self.emf * wanted * (1.0 + self.curve * wanted)
        if self.design.voltage:
            volts = BATTERY_V * u
        for motor, v in zip(self.motors, volts, strict=True):
            motor.step(float(v), max_voltage=BATTERY_V * self.design.ceiling)


def _fly(
    design: MultirotorDesign, craft: TrueVehicle, plan: np.ndarray, rng: np.random.Generator
) -> TrueFlight:
    from multirotor.physics import apply_forces_torques

    true, body = craft.true, body_of(craft)
    inertia = np.diag([true[k] for k in ("ixx", "iyy", "izz")])
    inverse = np.linalg.inv(inertia)
    moved = craft.hubs_m - design.shift * craft.arm_m * np.array([1.0, -0.5, 0.0])
    share = 1.0 - design.weak * (np.arange(craft.n_rotors) == 1)
    air = _Air(design, craft, moved)
    pilot = untrimmed(craft, design.wrong, true["lag"], STEP_S * STEPS_A_COMMAND)
    drive, plain = _Drive(design, craft), _Drive(MultirotorDesign(design.vehicle), craft)

    def rate(x: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rate of the package's state, and the force in the body frame."""
        thrust = share * air.thrusts(x, speeds)
        force = np.array([0.0, 0.0, thrust.sum()])
        torque = np.array(
            [
                thrust @ moved[:, 1],
                -thrust @ moved[:, 0],
                -true["torque"] * (share * speeds**2) @ np.array(craft.spin),
            ]
        )
        return (
            apply_forces_torques(force, torque, x, GRAVITY_M_S2, true["mass"], inertia, inverse),
            force,
        )

    # position, velocity in the body frame, roll, pitch and yaw, body rates; it starts in hover
    x = np.zeros(12)
    x[:3], x[8] = plan[:3, 0], plan[9, 0]
    rows, u = [], np.zeros(craft.n_rotors)
    for k in range(plan.shape[1]):
        if k % STEPS_A_COMMAND == 0:
            turn = _turn(x).as_matrix()
            v, omega = turn @ x[3:6], x[9:12]
            u = noisy_command(pilot, plan[:, k], x[:3], v, turn, omega, rng).clip(0.0, 1.0)
        speeds = drive.speeds_rad_s
        first, force = rate(x, speeds)
        rows.append(_row(x, speeds, plain.speeds_rad_s, u, force / true["mass"], plan[:, k]))
        drive.step(u)
        plain.step(u)
        # Heun's method, with the rotors at both ends
        second, _ = rate(x + STEP_S * first, drive.speeds_rad_s)
        x = x + 0.5 * STEP_S * (first + second)
        require_on_path(design.key, x[:3], plan[:3, k], k * STEP_S)
    states = {n: np.stack([r[n] for r in rows]) for n in rows[0]}
    x, off = states.pop("x"), states["rotor_speed"] - states.pop("plain")
    changes: dict[str, Any] = {}
    thrust = true["thrust"] * states["rotor_speed"] ** 2
    if design.blades:
        path: Iterable[Any] = zip(x, states["rotor_speed"], strict=True)
        parts = np.array([air.parts(*row) for row in path])
        changes["axial_inflow"] = body.wrench(parts[:, 0])
        changes["translational_lift"] = body.wrench(parts[:, 1])
    if design.weak:
        changes["weak_rotor"] = body.wrench((share - 1.0) * thrust)
    if design.shift:
        changes["cg_offset"] = change_by_shift(design.shift * craft.arm_m, thrust)
    for name, on in (("thrust_curve", design.voltage), ("rotor_saturation", design.ceiling < 1.0)):
        if on:
            changes[name] = driven(body, true, states["rotor_speed"], off)
    return TrueFlight(STEP_S, states, changes)


class _Air:
    """Thrusts of the rotors of a vehicle in the air that they move through.

    States are the package's, (12,), and rotor speeds (n_rotors,) in rad/s.
    """

    def __init__(self, design: MultirotorDesign, craft: TrueVehicle, hubs_m: np.ndarray) -> None:
        self.blades, self.k, self.hubs_m = design.blades, craft.true["thrust"], hubs_m
        self.propeller = _propeller(design.vehicle)

    def thrusts(self, x: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Return the thrust of each rotor (N)."""
        return self._of_blades(speeds, self._flow(x)) if self.blades else self.k * speeds**2

    def parts(self, x: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what climb changes of the thrusts of blades, and then speed along the disc (N)."""
        axial = self._of_blades(speeds, self._flow(x) * np.array([0.0, 0.0, 1.0]))
        return axial - self.k * speeds**2, self.thrusts(x, speeds) - axial

    def _flow(self, x: np.ndarray) -> np.ndarray:
        # the blade equation counts a climb negative: its axes point down
        return (x[3:6] + np.cross(x[9:12], self.hubs_m)) * np.array([1.0, 1.0, -1.0])

    def _of_blades(self, speeds: np.ndarray, flow: np.ndarray) -> np.ndarray:
        return np.array(
            [self.propeller.thrust(w, f) for w, f in zip(speeds, flow, strict=True)], dtype=float
        )


def _turn(x: np.ndarray) -> Rotation:
    return Rotation.from_euler("ZYX", x[[8, 7, 6]])


def _row(
    x: np.ndarray,
    speeds: np.ndarray,
    plain: np.ndarray,
    u: np.ndarray,
    specific_force: np.ndarray,
    ref: np.ndarray,
) -> dict[str, np.ndarray]:
    turn = _turn(x)
    return {
        "x": x,
        "p": x[:3],
        "v": turn.apply(x[3:6]),
        "q": turn.as_quat(scalar_first=True),
        "omega": x[9:12],
        "rotor_speed": speeds,
        "plain": plain,
        "u": u,
        "specific_force": specific_force,
        "p_ref": ref[:3],
        "v_ref": ref[3:6],
        "yaw_ref": ref[9:10],
    }
