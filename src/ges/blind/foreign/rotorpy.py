"""RotorPy (Folk, Paulos and Kumar 2023): its physics, its SE(3) controller, its trajectories.

What is concealed is what is switched on: coefficients of its published vehicles, its wind, or a
vehicle file that is wrong. Sensors and the honest errors of the file are ours. The limit follows
from the wrench that RotorPy itself computes along the flown path with and without each effect.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ges.blind.foreign.sets import Concealed, Design, NoSet, OffPath, Place, one_by_one
from ges.blind.generator.airframe import TrueVehicle, draw_nominal
from ges.blind.generator.detectable import NOTHING, TrueFlight

WORLD = "rotorpy"
NEEDS = ("rotorpy",)
FLIGHTS = 4
SECONDS = (11.0, 15.0)
LONGEST_STEP_S = 0.005
OFF_PATH_M = 2.0
ATTEMPTS, GENTLER = 6, 0.85
PACE = {"hummingbird": 1.0, "crazyflie": 0.6, "hexarotor": 0.9}
HEXA_ARM_M = 0.3
"""Of a hexarotor made of a hummingbird's rotors, half again as heavy, wide enough for six."""
AERO = ("c_Dx", "c_Dy", "c_Dz", "k_d", "k_z", "k_h", "k_flap")
# coefficients that RotorPy's vehicles have or, where they have none, of a like share of the weight
ON = {
    "hummingbird": {
        "rotor_drag": {"k_d": 1.19e-4},
        "axial_inflow": {"k_z": 2.32e-4},
        "translational_lift": {"k_h": 3.39e-3},
        "parasitic_drag": {"c_Dx": 0.02, "c_Dy": 0.02, "c_Dz": 0.02},
        "flapping": {"k_flap": 2e-5},
    },
    "crazyflie": {
        "rotor_drag": {"k_d": 1.02506e-6},
        "axial_inflow": {"k_z": 7.553e-7},
        "translational_lift": {"k_h": 8e-4},
        "parasitic_drag": {"c_Dx": 0.002, "c_Dy": 0.002, "c_Dz": 0.002},
        "flapping": {"k_flap": 1.2e-7},
    },
}
ON["hexarotor"] = ON["hummingbird"]
# what no library has, and what RotorPy's vehicles have not either: in SI units, body frame
STRANGE = {
    "hummingbird": {"skew": 0.12, "plate": 0.05, "fin": 0.006, "vane": 0.01},
    "crazyflie": {"skew": 0.012, "plate": 0.006, "fin": 2.0e-4, "vane": 1.5e-4},
}
METHOD = "force along the path, RotorPy's own wrench with and without each effect"


@dataclass(frozen=True)
class RotorpyDesign(Design):
    """A set to fly with RotorPy: effects that are on, the air, and how the vehicle file is wrong.

    Attributes
    ----------
    on : share of the coefficients of :data:`ON`, by effect.
    wind_m_s : speed of a steady wind.
    gusts : kind of moving air ('dryden' or 'sinusoid', '' for none) and its size (m/s).
    shift_m : place of the centre of mass from the published one, body x and y.
    strange : share of the coefficients of :data:`STRANGE`, by name.
    """

    on: Mapping[str, float] = field(default_factory=dict)
    wind_m_s: float = 0.0
    gusts: tuple[str, float] = ("", 0.0)
    shift_m: tuple[float, float] = (0.0, 0.0)
    strange: Mapping[str, float] = field(default_factory=dict)

    def _parts(self) -> list[str]:
        parts = [f"{n} {s:g}" for n, s in self.on.items()]
        parts += [f"wind {self.wind_m_s:g}"] if self.wind_m_s else []
        parts += [f"{self.gusts[0]} {self.gusts[1]:g}"] if self.gusts[0] else []
        parts += [f"{n} {s:g}" for n, s in self.strange.items()]
        return parts + (["cg_offset"] if any(self.shift_m) else [])

    def concealed(self) -> Concealed:
        """Return the truth of the set.

        Returns
        -------
        Moving air may be named without the drag that it acts through. With flapping or what is
        strange, which no library has, the verdict is ``unknown``.
        """
        names = list(self.on)
        names += ["wind"] if self.wind_m_s else []
        names += ["gusts"] if self.gusts[0] else []
        names += ["cg_offset"] if any(self.shift_m) else []
        severity = "weak" if min(self.on.values(), default=1.0) < 0.5 else "strong"
        if "flapping" in self.on or self.strange:
            laws = tuple(_law(n, c) for n, c in _strange(self).items())
            return Concealed(severity=severity, verdict="unknown", category="unknown", laws=laws)
        # moving air is felt through the drag alone
        instead = tuple((n,) for n in names if n in ("wind", "gusts"))
        return self._concealed(
            names, severity, instead=instead, category="single" if instead else ""
        )


def designs(half: str) -> list[RotorpyDesign]:
    """Return the sets of a half: the same effects in both, small ones and winds at other sizes."""
    small = {"development": 0.3, "evaluation": 0.4}[half]
    wind = {"development": (2.5, 1.5), "evaluation": (3.2, 1.1)}[half]
    both = ("hummingbird", "crazyflie")
    effects = ("rotor_drag", "axial_inflow", "translational_lift", "parasitic_drag")
    pairs = [
        ("rotor_drag", "axial_inflow"),
        ("rotor_drag", "translational_lift"),
        ("rotor_drag", "parasitic_drag"),
        ("axial_inflow", "translational_lift"),
        ("axial_inflow", "parasitic_drag"),
        ("translational_lift", "parasitic_drag"),
    ]
    listed = [RotorpyDesign(v, copy=k) for v in both for k in range(4)]
    listed += [RotorpyDesign(v, {n: size}) for v in both for n in effects for size in (1.0, small)]
    listed += [RotorpyDesign("hummingbird", dict.fromkeys(p, 1.0)) for p in pairs]
    listed += [RotorpyDesign("crazyflie", dict.fromkeys(pairs[k], 1.0)) for k in (0, 2)]
    listed += [RotorpyDesign("hummingbird", dict.fromkeys(effects[:3], 1.0))]
    listed += [RotorpyDesign(v, {"flapping": 1.0}) for v in both]
    odd = {"development": 1.0, "evaluation": 0.7}[half]
    listed += [RotorpyDesign(v, strange={n: odd}) for v in both for n in STRANGE[v]]
    for vehicle, speed in zip(both, wind, strict=True):
        listed += [
            RotorpyDesign(vehicle, {"rotor_drag": 1.0}, wind_m_s=speed),
            RotorpyDesign(vehicle, {"parasitic_drag": 1.0}, wind_m_s=speed),
            RotorpyDesign(vehicle, {"rotor_drag": 1.0}, gusts=("dryden", 0.4 * speed)),
            RotorpyDesign(vehicle, {"rotor_drag": 1.0}, gusts=("sinusoid", 0.4 * speed)),
            RotorpyDesign(
                vehicle, shift_m=(0.006, -0.004) if vehicle == "hummingbird" else (0.0, 0.002)
            ),
        ]
    wrong = [("hummingbird", {"mass": 1.12}), ("crazyflie", {"mass": 0.86})]
    wrong += [("hummingbird", {"thrust": 0.85}), ("crazyflie", {"thrust": 1.14})]
    wrong += [("hummingbird", {"torque": 0.65}), ("crazyflie", {"torque": 1.45})]
    wrong += [("hummingbird", {"inertia": 1.45}), ("crazyflie", {"inertia": 0.65})]
    wrong += [("hummingbird", {"lag": 8.0}), ("crazyflie", {"lag": 0.5})]
    listed += [RotorpyDesign("hexarotor", copy=k) for k in range(2)]
    listed += [RotorpyDesign("hexarotor", {n: 1.0}) for n in effects]
    listed += [
        RotorpyDesign("hexarotor", {"rotor_drag": 1.0}, wind_m_s=wind[0]),
        RotorpyDesign("hexarotor", shift_m=(0.008, -0.006)),
    ]
    wrong += [("hexarotor", {"mass": 1.13}), ("hexarotor", {"torque": 0.65})]
    return listed + [RotorpyDesign(v, wrong=w) for v, w in wrong]


def _fly_design(
    design: RotorpyDesign, place: Place, rate_hz: float
) -> tuple[TrueVehicle, list[TrueFlight]]:
    numbers = _numbers(design)
    craft = _airframe(design, numbers, place.rng("file"))
    rng = place.rng("paths")
    # a whole number of steps from sample to sample: none is interpolated
    steps = int(np.ceil(1.0 / (rate_hz * LONGEST_STEP_S) - 1e-9))
    step_s = 1.0 / (rate_hz * max(steps, 1))
    heading = rng.uniform(0.0, 2.0 * np.pi)
    blowing = design.wind_m_s * np.array([np.cos(heading), np.sin(heading), 0.0])
    return craft, [
        _fly_gently(design, numbers, place.half, kind, blowing, step_s, rng)
        for kind in range(FLIGHTS)
    ]


make = one_by_one(_fly_design, METHOD)


def _numbers(design: RotorpyDesign) -> dict[str, Any]:
    from rotorpy.vehicles import crazyflie_params, hummingbird_params

    published = {
        "hummingbird": hummingbird_params.quad_params,
        "crazyflie": crazyflie_params.quad_params,
        "hexarotor": _hexarotor(hummingbird_params.quad_params),
    }
    # a plain vehicle without any drag; what is on is added to it
    numbers = published[design.vehicle] | dict.fromkeys(AERO, 0.0)
    for name, share in design.on.items():
        numbers |= {k: share * v for k, v in ON[design.vehicle][name].items()}
    return numbers


def _strange(design: RotorpyDesign) -> dict[str, float]:
    """Return coefficients of what is strange, in the units of :func:`_strange_wrench`."""
    return {n: share * STRANGE[design.vehicle][n] for n, share in design.strange.items()}


def _strange_wrench(
    numbers: Mapping[str, float], air: np.ndarray, rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return force (N) and moment (N m) that no library has, in the body frame.

    - ``skew`` (N s/m): a frame that is not symmetric pushes sideways as it flies forward. Its drag
      tensor has an entry off the diagonal (Happel and Brenner 1983, *Low Reynolds Number
      Hydrodynamics*, ch. 5).
    - ``plate`` (N s^2/m^2): a deck at a small incidence lifts with the square of forward speed, and
      pushes down in backward flight (Anderson 2017, *Fundamentals of Aerodynamics*, sec. 4.7).
    - ``fin`` (N m s^2/m^2): a fin behind the centre of mass turns the nose into the wind of a
      sideslip (Etkin and Reid 1996, *Dynamics of Flight*, ch. 3).
    - ``vane`` (N m s): vanes in the downwash damp yaw (the same, ch. 5).

    ``air`` is the velocity through the air (3,), m/s.
    """
    u, v, _ = air
    force = np.array([0.0, numbers.get("skew", 0.0) * u, numbers.get("plate", 0.0) * u * abs(u)])
    turning = numbers.get("fin", 0.0) * v * np.hypot(u, v) - numbers.get("vane", 0.0) * rates[2]
    return force, np.array([0.0, 0.0, turning])


def _law(name: str, coefficient: float) -> dict[str, Any]:
    """Return channel, powers of the speeds and rates (m/s, rad/s) and coefficient of a stranger."""
    channel, powers, sign = {
        "skew": ("force_y", {"V_x": 1}, 1.0),
        "plate": ("force_z", {"V_x": 2}, 1.0),
        "fin": ("moment_z", {"V_y": 1, "V_h": 1}, 1.0),
        "vane": ("moment_z", {"r": 1}, -1.0),
    }[name]
    return {"channel": channel, "powers": powers, "coefficient_SI": sign * coefficient}


def _hexarotor(of: Mapping[str, Any]) -> dict[str, Any]:
    """Return a hummingbird with six of its rotors, every other one turning the other way."""
    angles = np.radians(30.0 + 60.0 * np.arange(6))
    hubs = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    return {
        **of,
        "mass": 1.5 * of["mass"],
        **{name: 3.0 * of[name] for name in ("Ixx", "Iyy", "Izz")},
        "num_rotors": 6,
        "rotor_pos": {f"r{k + 1}": HEXA_ARM_M * hub for k, hub in enumerate(hubs)},
        "rotor_directions": np.array([1, -1] * 3),
    }


def _four_of(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers with the first four rotors alone.

    RotorPy's constructors invert the effects of the rotors, which only those of four can be.
    """
    hubs = dict(list(numbers["rotor_pos"].items())[:4])
    return {
        **numbers,
        "num_rotors": len(hubs),
        "rotor_pos": hubs,
        "rotor_directions": np.array([1, -1, 1, -1]),
    }


def _vehicle(
    numbers: Mapping[str, Any],
    state: Mapping[str, np.ndarray],
    strange: Mapping[str, float] = NOTHING,
) -> Any:
    """Return RotorPy's vehicle with all of its rotors, and with what is strange."""
    from rotorpy.vehicles.multirotor import Multirotor

    class Strange(Multirotor):
        def compute_body_wrench(
            self, body_rates: np.ndarray, rotor_speeds: np.ndarray, body_airspeed_vector: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            force, moment = super().compute_body_wrench(
                body_rates, rotor_speeds, body_airspeed_vector
            )
            more = _strange_wrench(strange, body_airspeed_vector, body_rates)
            return force + more[0], moment + more[1]

    if numbers["num_rotors"] == 4:
        return Strange(dict(numbers), dict(state), aero=True)
    vehicle = Strange(_four_of(numbers), dict(state), aero=True)
    vehicle.num_rotors, vehicle.rotor_pos = numbers["num_rotors"], numbers["rotor_pos"]
    vehicle.rotor_dir = numbers["rotor_directions"]
    vehicle.extract_geometry()
    return vehicle


def _pilot(numbers: Mapping[str, Any]) -> Any:
    """Return RotorPy's controller; of more than four rotors the least thrusts are asked for."""
    from rotorpy.controllers.quadrotor_control import SE3Control

    if numbers["num_rotors"] == 4:
        return SE3Control(dict(numbers))
    pilot = SE3Control(_four_of(numbers))
    hubs = np.array(list(numbers["rotor_pos"].values()))
    yaw = numbers["k_m"] / numbers["k_eta"] * numbers["rotor_directions"]
    pilot.f_to_TM = np.vstack([np.ones(len(hubs)), hubs[:, 1], -hubs[:, 0], yaw])
    pilot.TM_to_f = np.linalg.pinv(pilot.f_to_TM)
    return pilot


def _airframe(
    design: RotorpyDesign, numbers: Mapping[str, Any], rng: np.random.Generator
) -> TrueVehicle:
    """Return the true vehicle, and a file about it with honest errors.

    Of RotorPy's rotors those with a positive direction turn clockwise.
    """
    names = {"mass": "mass", "ixx": "Ixx", "iyy": "Iyy", "izz": "Izz"}
    names |= {"thrust": "k_eta", "torque": "k_m", "lag": "tau_m", "speed": "rotor_speed_max"}
    true = {own: float(numbers[name]) for own, name in names.items()}
    places = np.array(list(numbers["rotor_pos"].values()))
    return TrueVehicle(
        size=design.vehicle,
        radius_m=float(numbers.get("rotor_radius", 0.0231)),
        rotor_x_m=tuple(map(float, places[:, 0])),
        rotor_y_m=tuple(map(float, places[:, 1])),
        rotor_z_m=0.0,
        spin=tuple(-int(d) for d in numbers["rotor_directions"]),
        battery_V=12.0,
        nominal=draw_nominal(true, rng),
        true=true,
    )


def _fly_gently(
    design: RotorpyDesign,
    numbers: Mapping[str, Any],
    half: str,
    kind: int,
    blowing: np.ndarray,
    step_s: float,
    rng: np.random.Generator,
) -> TrueFlight:
    """Fly a trajectory.

    One that has no solution, or that the controller loses, is drawn anew and flown slower.
    """
    pace = PACE[design.vehicle]
    for _ in range(ATTEMPTS):
        path = _trajectory(half, kind, pace, rng)
        air = _air(design, blowing, step_s, rng)
        flown = _fly(numbers, design, path, air, step_s, rng) if path else None
        if flown is not None:
            return flown
        pace *= GENTLER
    raise OffPath(
        f"trajectory {kind} of '{design.key}' was lost, or has no solution, {ATTEMPTS} times; the"
        " trajectories are too fast for the vehicle"
    )


def _trajectory(half: str, kind: int, pace: float, rng: np.random.Generator) -> Any:
    """Return one of RotorPy's own trajectories; None where its solver finds none.

    The halves fly other families and other shapes.
    """
    from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
    from rotorpy.trajectories.lissajous_traj import TwoDLissajous
    from rotorpy.trajectories.minsnap import MinSnap
    from rotorpy.trajectories.speed_traj import ConstantSpeed

    early, other = half == "development", rng.uniform(0.9, 1.1, 2)
    high = np.array([0.0, 0.0, 2.5])
    if kind == 0:
        size, turns = (1.5, 1.2), np.array([0.9, 1.6] if early else [0.7, 2.0]) * pace * other
        return TwoDLissajous(
            A=size[0 if early else 1],
            B=size[1 if early else 0],
            a=turns[0],
            b=turns[1],
            height=2.0 if early else 3.0,
            yaw_bool=early and bool(rng.random() < 0.5),
        )
    if kind == 1:
        radius, hz = (1.5, 0.28 * pace) if early else (1.1, 0.34 * pace)
        radii = np.array([radius, radius, 0.5]) * rng.uniform(0.9, 1.1, 3)
        turns = np.array([hz, hz, hz * rng.uniform(0.5, 0.8)])
        return ThreeDCircularTraj(high, radii, turns, yaw_traj=None if early else "forward")
    if kind == 2:
        count, speed, reach = (16, 1.3, 1.0) if early else (18, 1.1, 1.4)
        points = high + rng.uniform(-reach, reach, (count, 3)) * np.array([1.0, 1.0, 0.5])
        turns = np.cumsum(rng.uniform(-0.9, 0.9, count))
        # without a solution its constructor fails on the None that it should have held
        try:
            return MinSnap(points, turns, v_avg=speed * pace, v_max=9.0, verbose=False)
        except TypeError:
            return None
    axis, speed = (2, 1.2) if early else (int(rng.integers(2)), 1.5)
    return ConstantSpeed(high, dist=2.0 * speed, speed=speed * pace, axis=axis, repeat=True)


def _air(
    design: RotorpyDesign, blowing: np.ndarray, step_s: float, rng: np.random.Generator
) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return RotorPy's wind as a function of time and position."""
    from rotorpy.wind.default_winds import ConstantWind, SinusoidWind

    kind, size = design.gusts
    if kind == "sinusoid":
        hz = rng.uniform(0.1, 0.5, 3)
        wind = SinusoidWind(np.array([1.6, 1.6, 0.3]) * size, hz, rng.uniform(0.0, 5.0, 3))
    elif kind == "dryden":
        wind = _dryden(size, step_s, rng)
    else:
        wind = ConstantWind(*blowing)
    return lambda t, p: np.asarray(wind.update(t, p), dtype=float)


def _dryden(size: float, step_s: float, rng: np.random.Generator) -> Any:
    """Return RotorPy's Dryden gusts.

    Their intensity is that of white noise of one step. The gusts' own sd falls with the root of the
    step, which is made up for here.
    """
    # RotorPy is installed without it, and imports it for these gusts alone
    if importlib.util.find_spec("torch") is None:
        raise NoSet("RotorPy's Dryden gusts need torch, which is not installed; pip install torch")
    from rotorpy.wind.dryden_winds import DrydenGust

    # these gusts draw from numpy's global stream
    np.random.seed(int(rng.integers(2**31)))
    louder = size * np.sqrt(4.0 * np.pi / step_s) * np.array([1.0, 1.0, 0.5])
    return DrydenGust(step_s, np.array([0.0, 0.0, 0.0]), louder)


def _fly(
    numbers: Mapping[str, Any],
    design: RotorpyDesign,
    path: Any,
    air: Callable[[float, np.ndarray], np.ndarray],
    step_s: float,
    rng: np.random.Generator,
) -> TrueFlight | None:
    """Fly one trajectory by RotorPy's controller; None where it lost it.

    Runge and Kutta's fourth order on RotorPy's equations of motion, ten times faster than its own
    adaptive integration.
    """
    first = path.update(0.0)
    half = 0.5 * float(first["yaw"])
    rotors = int(numbers["num_rotors"])
    hover = np.sqrt(numbers["mass"] * 9.81 / (rotors * numbers["k_eta"]))
    state = {
        "x": np.array(first["x"], dtype=float),
        "v": np.array(first["x_dot"], dtype=float),
        "q": np.array([0.0, 0.0, np.sin(half), np.cos(half)]),
        "w": np.zeros(3),
        "wind": air(0.0, np.asarray(first["x"])),
        "rotor_speeds": np.full(rotors, hover),
    }
    # the body alone is shifted: controller and file believe in the published hubs
    vehicle, pilot = _vehicle(numbers, state, _strange(design)), _pilot(numbers)
    vehicle.rotor_geometry = vehicle.rotor_geometry - np.array([*design.shift_m, 0.0])
    without = _vehicles_without(design, numbers, state)
    rows = []
    for k in range(int(rng.uniform(*SECONDS) / step_s)):
        asked = path.update(k * step_s)
        control = pilot.update(k * step_s, state, asked)
        state["wind"] = air(k * step_s, state["x"])
        rows.append(_row(vehicle, without, state, control, asked))
        state = _step(vehicle, state, control, step_s)
        # also true of NaN, which every comparison denies
        if not np.abs(state["x"] - asked["x"]).max() < OFF_PATH_M:
            return None
    states = {n: np.stack([r[n] for r in rows]) for n in rows[0] if "/" not in n}
    changes = {
        name: {c: np.stack([r[f"{name}/{c}"] for r in rows]) for c in ("force_N", "moment_Nm")}
        for name in without
    }
    return TrueFlight(step_s, states, changes)


def _vehicles_without(
    design: RotorpyDesign, numbers: Mapping[str, Any], state: Mapping[str, np.ndarray]
) -> dict[str, Any]:
    """Return by name the vehicle that lacks this one effect; None for air that moves."""

    def vehicle(off: Iterable[str], shift: Sequence[float], strange: Iterable[str] = ()) -> Any:
        # as it flies but for the one effect
        left = {n: c for n, c in _strange(design).items() if n not in strange}
        one = _vehicle(dict(numbers) | dict.fromkeys(off, 0.0), state, left)
        one.rotor_geometry = one.rotor_geometry - np.array([*shift, 0.0])
        return one

    vehicles = {n: vehicle(ON[design.vehicle][n], design.shift_m) for n in design.on}
    vehicles |= {n: vehicle((), design.shift_m, (n,)) for n in design.strange}
    if any(design.shift_m):
        vehicles["cg_offset"] = vehicle((), (0.0, 0.0))
    if design.wind_m_s or design.gusts[0]:
        vehicles["wind" if design.wind_m_s else "gusts"] = None
    return vehicles


def _row(
    vehicle: Any,
    without: Mapping[str, Any],
    state: Mapping[str, np.ndarray],
    control: Mapping[str, Any],
    asked: Mapping[str, Any],
) -> dict[str, np.ndarray]:
    from scipy.spatial.transform import Rotation

    x, y, z, w = state["q"]
    to_body = Rotation.from_quat(state["q"]).as_matrix().T
    still, moving = to_body @ state["v"], to_body @ (state["v"] - state["wind"])
    rates, speeds = state["w"], state["rotor_speeds"]
    force, moment = vehicle.compute_body_wrench(rates, speeds, moving)
    top = vehicle.rotor_speed_max
    row = {
        "p": state["x"],
        "v": state["v"],
        "q": [w, x, y, z],
        "omega": rates,
        "rotor_speed": speeds,
        "u": np.clip(control["cmd_motor_speeds"], vehicle.rotor_speed_min, top) / top,
        "specific_force": force / vehicle.mass,
        "p_ref": asked["x"],
        "v_ref": asked["x_dot"],
        "yaw_ref": [asked["yaw"]],
    }
    # effects act in the air at rest, and the wind is what moving air adds to all of them, so that
    # the parts sum up to the whole
    calm = vehicle.compute_body_wrench(rates, speeds, still)
    for name, other in without.items():
        bare = other.compute_body_wrench(rates, speeds, still) if other else calm
        whole = calm if other else (force, moment)
        row[f"{name}/force_N"], row[f"{name}/moment_Nm"] = whole[0] - bare[0], whole[1] - bare[1]
    return {name: np.array(value, dtype=float) for name, value in row.items()}


def _step(
    vehicle: Any, state: Mapping[str, np.ndarray], control: Mapping[str, Any], dt: float
) -> dict[str, np.ndarray]:
    asked = np.clip(control["cmd_motor_speeds"], vehicle.rotor_speed_min, vehicle.rotor_speed_max)
    # in the order of its own packing, which has room for four rotors
    s = np.concatenate([state[k] for k in ("x", "v", "q", "w", "wind", "rotor_speeds")])
    # the command is held over the step, as a speed controller does
    k1 = vehicle._s_dot_fn(0.0, s, asked)
    k2 = vehicle._s_dot_fn(0.0, s + 0.5 * dt * k1, asked)
    k3 = vehicle._s_dot_fn(0.0, s + 0.5 * dt * k2, asked)
    k4 = vehicle._s_dot_fn(0.0, s + dt * k3, asked)
    new = vehicle._unpack_state(s + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
    return new | {"q": new["q"] / np.linalg.norm(new["q"])}
