"""Other people's simulators on one vehicle: how many steps a second each of them makes.

Constant commands lift the vehicle in still air, without controller, sensors or ground. So what is
timed is a rigid body with its rotors, stepped as each simulator is meant to be.
"""

from __future__ import annotations

import importlib.util
import math
import multiprocessing
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ges.blind.foreign.drone_models import RPM
from ges.blind.foreign.worlds import ALONE, JAX, environment_of
from ges.conventions import FAR_FROM_GROUND_M, rotor_speed
from ges.extras import install_command
from ges.simulator import flight as sim
from ges.simulator.parameters import parameters
from ges.simulator.terrain import Terrain
from ges.vehicle.load import load_vehicle

VEHICLE = "crazyflie-2.1-brushless"
"""Of the library; within the limits of crazyflow, which are those of its drones."""
STEP_S = 0.002
MORE_THAN_HOVER = 1.005
"""Of the rotor speeds: the vehicle climbs by a hundredth of gravity."""
MANY = 64
"""Vehicles that are stepped together where a simulator can."""
CALLS = 20
"""Timed calls a repeat. They are short, so that some escape what else the machine does."""


@dataclass(frozen=True)
class Lift:
    """A vehicle with four rotors in hover, and commands that lift it.

    Attributes
    ----------
    numbers : of the vehicle, by name of :func:`ges.simulator.parameters.parameters`.
    """

    numbers: Mapping[str, float]

    @property
    def hover_rad_s(self) -> float:
        """Rotor speed of the hover, rad/s."""
        # m g = n k w^2
        weight_N = self.numbers["mass_kg"] * self.numbers["gravity_m_s2"]
        return math.sqrt(weight_N / (4.0 * self.numbers["thrust_coefficient_N_s2"]))

    @property
    def asked_rad_s(self) -> float:
        """Commanded rotor speed, rad/s."""
        return MORE_THAN_HOVER * self.hover_rad_s

    def of_rotors(self, name: str) -> np.ndarray:
        """Return a number of every rotor, (4,).

        Parameters
        ----------
        name : as ``x_m`` or ``spin``, in the unit of its name.
        """
        return np.array([self.numbers[f"rotor_{i}_{name}"] for i in range(1, 5)])

    @property
    def inertia_kg_m2(self) -> np.ndarray:
        """Moments of inertia, (3,)."""
        return np.array([self.numbers[f"i{a}_kg_m2"] for a in ("xx", "yy", "zz")])

    @property
    def torque_over_thrust_m(self) -> float:
        """Reaction torque of a rotor over its thrust, m."""
        return self.numbers["torque_coefficient_Nm_s2"] / self.numbers["thrust_coefficient_N_s2"]


def lift_of(name: str = VEHICLE) -> Lift:
    """Return a vehicle of the library as every simulator takes it.

    Parameters
    ----------
    name : of a vehicle with four level rotors.
    """
    defaults = {key: p.default for key, p in parameters().items()}
    # RotorPy has no other gravity
    return Lift({**defaults, **load_vehicle(name).parameters(), "gravity_m_s2": 9.81})


Climb = Callable[[], float]
"""Makes the next steps, and returns how far the (first) vehicle has climbed, m."""


@dataclass(frozen=True)
class Peer:
    """A simulator to compare with.

    Attributes
    ----------
    name : of it, with what is special about its steps.
    module : package that must be importable.
    begin : prepares the steps of one call, of so many vehicles together.
    steps : of one call, some ten milliseconds.
    abreast : vehicles that are stepped together.
    environment : variables of the process that it is timed in.
    """

    name: str
    module: str
    begin: Callable[[Lift, int, int], Climb]
    steps: int
    abreast: int = 1
    environment: Mapping[str, str] = field(default_factory=lambda: ALONE)

    def missing(self) -> str:
        """Return why it cannot be compared here; empty where it can."""
        if importlib.util.find_spec(self.module):
            return ""
        return f"{self.module} is not installed; {install_command('simulators')}"

    def steps_per_s(self, lift: Lift, repeats: int) -> float:
        """Measure the steps of all vehicles together, in a process of its own.

        Parameters
        ----------
        lift : what to fly.
        repeats : how many times :data:`CALLS` calls are timed.

        Returns
        -------
        Of the fastest call, 1/s: what else the machine does can only add to its time.
        """
        # spawned, not forked: libraries read these variables when they are imported
        spawn = multiprocessing.get_context("spawn")
        with environment_of(self.environment), ProcessPoolExecutor(1, spawn) as pool:
            return pool.submit(self._steps_per_s, lift, repeats).result()

    def _steps_per_s(self, lift: Lift, repeats: int) -> float:
        climb = self.begin(lift, self.steps, self.abreast)
        # what is compiled or read at first use does not count
        climb()
        times = []
        for _ in range(repeats * CALLS):
            start = time.perf_counter()
            climb()
            times.append(time.perf_counter() - start)
        return self.steps * self.abreast / min(times)


def _ges(lift: Lift, steps: int, abreast: int) -> Climb:
    numbers: dict[str, float | str] = {
        **lift.numbers,
        **{f"start_{name}": lift.hover_rad_s for name in rotor_speed(4)},
        "control": "replayed_commands",
        "start": 1,
        "start_p_z_m": FAR_FROM_GROUND_M,
        "dt_s": STEP_S,
        "duration_s": steps * STEP_S,
        "inputs_dt_s": steps * STEP_S,
        "record_every": steps,
        "control_every": steps,
        "telemetry_every": steps,
    }
    # the same commands from start to end; the other columns impose nothing here
    row = np.zeros(12)
    row[:4], row[4], row[8] = lift.asked_rad_s / lift.numbers["max_rotor_speed_rad_s"], 1.0, np.nan
    flights = [sim.Flight(numbers, {}, Terrain.flat(), np.tile(row, (2, 1)))] * abreast

    def climb() -> float:
        return float(sim.fly(flights, ["p_z_m"])[0]["p_z_m"][-1]) - FAR_FROM_GROUND_M

    return climb


def _rotorpy(lift: Lift, steps: int, abreast: int) -> Climb:
    from rotorpy.vehicles.hummingbird_params import quad_params
    from rotorpy.vehicles.multirotor import Multirotor

    n, (ixx, iyy, izz) = lift.numbers, lift.inertia_kg_m2
    hubs = np.stack([lift.of_rotors("x_m"), lift.of_rotors("y_m"), np.zeros(4)], axis=1)
    own = {"mass": n["mass_kg"], "Ixx": ixx, "Iyy": iyy, "Izz": izz}
    own |= {"k_eta": n["thrust_coefficient_N_s2"], "k_m": n["torque_coefficient_Nm_s2"]}
    own |= {"tau_m": n["motor_time_constant_s"], "rotor_speed_max": n["max_rotor_speed_rad_s"]}
    # of its rotors those with a positive direction turn clockwise
    own |= {"rotor_directions": -lift.of_rotors("spin")}
    own |= {"rotor_pos": {f"r{i}": hub for i, hub in enumerate(hubs, 1)}}
    state = {
        "x": np.zeros(3),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, lift.hover_rad_s),
    }
    vehicle = Multirotor({**quad_params, **own}, state, aero=False)
    control = {"cmd_motor_speeds": np.full(4, lift.asked_rad_s)}

    def climb() -> float:
        nonlocal state
        for _ in range(steps):
            state = vehicle.step(state, control, STEP_S)
        return float(state["x"][2])

    return climb


def _mujoco(lift: Lift, steps: int, abreast: int) -> Climb:
    import mujoco

    n = lift.numbers
    top_N = n["thrust_coefficient_N_s2"] * n["max_rotor_speed_rad_s"] ** 2
    x, y, spin = (lift.of_rotors(name) for name in ("x_m", "y_m", "spin"))
    sites = "".join(f'<site name="r{k}" pos="{x[k]} {y[k]} 0"/>' for k in range(4))
    # it has no rotors: an actuator is a thrust with a torque about it, and its filter is the lag
    thrusters = "".join(
        f'<general site="r{k}" gear="0 0 1 0 0 {-spin[k] * lift.torque_over_thrust_m}"'
        f' dyntype="filterexact" dynprm="{n["motor_time_constant_s"]}" gainprm="{top_N}"/>'
        for k in range(4)
    )
    inertia = " ".join(map(str, lift.inertia_kg_m2))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{STEP_S}" gravity="0 0 -{n["gravity_m_s2"]}"/>
        <worldbody><body><freejoint/>
          <inertial pos="0 0 0" mass="{n["mass_kg"]}" diaginertia="{inertia}"/>{sites}
        </body></worldbody><actuator>{thrusters}</actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    # thrusts over the largest go with the square of the speeds
    data.act[:] = (lift.hover_rad_s / n["max_rotor_speed_rad_s"]) ** 2
    data.ctrl[:] = (lift.asked_rad_s / n["max_rotor_speed_rad_s"]) ** 2

    def climb() -> float:
        mujoco.mj_step(model, data, nstep=steps)
        return float(data.qpos[2])

    return climb


def _crazyflow(lift: Lift, steps: int, abreast: int) -> Climb:
    import jax.numpy as jnp
    from crazyflow.sim import Sim

    simulator = Sim(
        n_worlds=abreast,
        drone="cf21B_500",
        dynamics="first_principles",
        control="rotor_vel",
        integrator="rk4",
        freq=round(1.0 / STEP_S),
    )
    data = simulator.data
    simulator.data = data.replace(
        params=data.params.replace(**_crazyflow_numbers(lift, vars(data.params))),
        states=data.states.replace(
            rotor_vel=jnp.full((abreast, 1, 4), lift.hover_rad_s * RPM),
            pos=jnp.asarray(np.tile([0.0, 0.0, 1.0], (abreast, 1, 1))),
        ),
    )
    simulator.rotor_vel_control(jnp.full((abreast, 1, 4), lift.asked_rad_s * RPM))

    def climb() -> float:
        simulator.step(steps)
        return float(np.asarray(simulator.data.states.pos)[0, 0, 2]) - 1.0

    return climb


def _crazyflow_numbers(lift: Lift, published: Mapping[str, Any]) -> dict[str, Any]:
    """Return its parameters of the vehicle; its rotor speeds count in RPM."""
    import jax.numpy as jnp

    n, rate = lift.numbers, 1.0 / lift.numbers["motor_time_constant_s"]
    x, y, spin = (lift.of_rotors(name) for name in ("x_m", "y_m", "spin"))
    arm_m = float(np.abs(x).mean())
    values: dict[str, ArrayLike] = {
        "mass": n["mass_kg"],
        "gravity_vec": [0.0, 0.0, -n["gravity_m_s2"]],
        "J": np.diag(lift.inertia_kg_m2),
        "J_inv": np.diag(1.0 / lift.inertia_kg_m2),
        "L": arm_m,
        # M_x = y T, M_y = -x T; a rotor turns the body against its spin
        "mixing_matrix": np.stack([y / arm_m, -x / arm_m, -spin]),
        "rpm2thrust": [0.0, 0.0, n["thrust_coefficient_N_s2"] / RPM**2],
        "rpm2torque": [0.0, 0.0, n["torque_coefficient_Nm_s2"] / RPM**2],
        "rotor_dyn_coef": [rate, 0.0, rate, 0.0],
        "drag_matrix": 0.0,
        "prop_inertia": 0.0,
    }
    return {
        name: jnp.asarray(np.broadcast_to(value, np.shape(published[name])).astype(float))
        for name, value in values.items()
    }


PEERS: Sequence[Peer] = (
    Peer("ges, one flight", "ges", _ges, 50_000),
    Peer("ges, lanes", "ges", _ges, 5_000, MANY),
    Peer("MuJoCo", "mujoco", _mujoco, 5_000),
    Peer("crazyflow, one world", "crazyflow", _crazyflow, 100, 1, JAX),
    Peer("crazyflow, worlds", "crazyflow", _crazyflow, 100, MANY, JAX),
    Peer("RotorPy, adaptive steps", "rotorpy", _rotorpy, 20),
)
"""Ours first: all others are told as shares of its speed."""
