"""crazyflow (Learning Systems Lab, TU Munich): its simulation of Crazyflies, flown by its own
re-implementation of the firmware's Mellinger controller, all sets abreast.

The limit follows from its own accelerations along the flown paths with and without each effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ges.blind.foreign import drone_models
from ges.blind.foreign.drone_models import RPM, DroneModelsDesign, airframe
from ges.blind.foreign.paths import Scale, references
from ges.blind.foreign.sets import Concealed, OffPath, Place, Sources, draw_log, write_flown
from ges.blind.generator.detectable import TrueFlight

WORLD = "crazyflow"
NEEDS = ("crazyflow",)
DRONES = {
    "development": ("cf21B_500", "cf2x_T350"),
    "evaluation": ("cf2x_L250", "cf21B_500"),
}
SECONDS, RATE_HZ, STATE_HZ = 14.0, 500, 100
SPEED_M_S, SMOOTH_S = 1.0, 0.4
OFF_PATH_M = 3.0
WEAK = 2
METHOD = "force along the path, crazyflow's own accelerations with and without each effect"


@dataclass(frozen=True)
class CrazyflowDesign(DroneModelsDesign):
    """A set to fly with crazyflow.

    Attributes
    ----------
    weak : share of thrust and torque that rotor 3 loses.
    linear : whether thrust and torque curves keep their linear term.
    """

    weak: float = 0.0
    linear: bool = field(default=False, metadata={"words": "linear term of thrust"})

    def concealed(self) -> Concealed:
        """Return the truth of the set.

        Returns
        -------
        ``motor_lag`` is always true or optional: crazyflow's motors slow down faster than they
        speed up. A linear term shows as the map from command to thrust, which is optional as well.
        """
        effects = [name for n, name in NAMES.items() if getattr(self, n)]
        optional = ["gyroscopic_moment"] if self.propeller else []
        # seen from the commands, a linear term is the command-thrust curve
        optional += ["thrust_curve", "thrust_scale"] if self.linear else []
        optional += [] if "lag" in self.wrong else ["motor_lag"]
        size = max(self.across, self.along, self.propeller, 10.0 * self.weak)
        return self._concealed(
            effects,
            "weak" if 0.0 < size < 0.5 and not self.wrong else "strong",
            optional=tuple(optional),
            places={"weak_rotor": (f"rotor {WEAK + 1}",)} if self.weak else {},
        )


NAMES = drone_models.NAMES | {"weak": "weak_rotor"}


def designs(half: str) -> list[CrazyflowDesign]:
    """Return the sets of a half; one drone is in both, small sizes differ."""
    small = {"development": 0.3, "evaluation": 0.4}[half]
    listed = [CrazyflowDesign(d, copy=k) for d in DRONES[half] for k in range(2)]
    for d in DRONES[half]:
        listed += [
            CrazyflowDesign(d, across=1.0),
            CrazyflowDesign(d, across=small),
            CrazyflowDesign(d, along=1.0),
            CrazyflowDesign(d, across=1.0, along=1.0),
            CrazyflowDesign(d, weak=0.3 * small),
            CrazyflowDesign(d, across=1.0, along=1.0, propeller=1.0, linear=True),
        ]
    first, second = DRONES[half]
    return listed + [
        CrazyflowDesign(first, propeller=2.0),
        CrazyflowDesign(second, across=1.0, weak=0.1),
        CrazyflowDesign(first, wrong={"mass": 0.86}),
        CrazyflowDesign(second, across=1.0, wrong={"mass": 1.15}),
        CrazyflowDesign(first, wrong={"lag": 2.2}),
        CrazyflowDesign(second, wrong={"inertia": 0.65}),
        CrazyflowDesign(first, wrong={"torque": 1.5}),
    ]


def make(out: Path, sets: Sequence[tuple[CrazyflowDesign, int, Place]], sources: Sources) -> None:
    """Fly designs abreast, a drone at a time, and seal them.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    sets : designs, each with its number in the world and its place.
    sources : of which nothing is needed.

    Raises
    ------
    OffPath
        When a drone was more than :data:`OFF_PATH_M` from its path.
    """
    for drone in sorted({design.vehicle for design, _, _ in sets}):
        chosen = [one for one in sets if one[0].vehicle == drone]
        _make_of_drone(out, drone, chosen)


def _make_of_drone(
    out: Path, drone: str, sets: Sequence[tuple[CrazyflowDesign, int, Place]]
) -> None:
    simulator = _simulator(drone, 4 * len(sets))
    published = {k: np.asarray(v) for k, v in vars(simulator.data.params).items()}
    numbers = [_numbers(design, published) for design, _, _ in sets]
    top = _top_speed(simulator, drone)
    crafts = [
        airframe(drone, n | {"rpm2thrust": n["rpm2thrust"][0]}, place.rng("file"))
        for n, (_, _, place) in zip(numbers, sets, strict=True)
    ]
    for craft in crafts:
        # this simulator has a top speed of its own; the file's honest error of it stays
        craft.nominal["speed"] *= top / craft.true["speed"]
        craft.true["speed"] = top
    scale = Scale(0.3, crafts[0].radius_m, SPEED_M_S, SMOOTH_S)
    plans = [
        plan
        for _, _, place in sets
        for plan in references(place.half, SECONDS, 1.0 / RATE_HZ, scale, place.rng("paths"))
    ]
    book = _fly(simulator, _batched(numbers), np.stack(plans))
    for k, (design, number, place) in enumerate(sets):
        log = draw_log(place, number)
        flights = [
            _flown(design, crafts[k], numbers[k], {n: v[:, f] for n, v in book.items()}, plans[f])
            for f in range(4 * k, 4 * k + 4)
        ]
        write_flown(out, place, crafts[k], flights, log, design.concealed(), METHOD, design.wrong)


def _simulator(drone: str, worlds: int) -> Any:
    from crazyflow.sim import Sim

    return Sim(
        n_worlds=worlds,
        n_drones=1,
        drone=drone,
        dynamics="first_principles",
        control="state",
        integrator="rk4",
        freq=RATE_HZ,
        state_freq=STATE_HZ,
        attitude_freq=RATE_HZ,
        force_torque_freq=RATE_HZ,
    )


def _top_speed(simulator: Any, drone: str) -> float:
    from crazyflow.sim.sim import rotor_vel_limits

    return float(np.max(rotor_vel_limits(simulator.dynamics, drone)[1])) / RPM


def _numbers(design: CrazyflowDesign, published: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the parameters of one set.

    Without its linear term a thrust curve carries the same weight at the same speed.
    """
    numbers = {k: np.array(v) for k, v in published.items()}
    share = np.diag([design.across, design.across, design.along])
    numbers["drag_matrix"] = numbers["drag_matrix"] * share
    numbers["prop_inertia"] = numbers["prop_inertia"] * design.propeller
    if not design.linear:
        weight = 9.81 * float(np.ravel(numbers["mass"])[0]) / 4.0
        for name in ("rpm2thrust", "rpm2torque"):
            _, one, two = numbers["rpm2thrust"][0]
            # speed at which one w + two w^2 carries a quarter of the weight
            hover = (-one + np.sqrt(one**2 + 4.0 * two * weight)) / (2.0 * two)
            curve = numbers[name][0]
            numbers[name] = np.array([[0.0, 0.0, curve[2] + curve[1] / hover]])
    # a rotor that loses thrust loses as much of its torque
    share = np.ones((4, 1))
    share[WEAK] -= design.weak
    numbers["rpm2thrust"] = numbers["rpm2thrust"] * share
    numbers["rpm2torque"] = numbers["rpm2torque"] * share
    return numbers


def _batched(numbers: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return parameters with a world and a drone axis, four flights a set."""
    return {
        name: np.repeat(np.stack([n[name] for n in numbers])[:, None], 4, axis=0)
        for name in numbers[0]
    }


def _fly(
    simulator: Any, parameters: Mapping[str, np.ndarray], plans: np.ndarray
) -> dict[str, np.ndarray]:
    """Fly references (worlds, 11, n); return states and accelerations, (n, worlds, width)."""
    import jax.numpy as jnp

    data = simulator.data
    wanted = {k: jnp.asarray(v) for k, v in parameters.items()}
    states, start = data.states, np.zeros((len(plans), 1, 4))
    # first yaw of the path, scalar last; rotors start in hover
    start[:, 0, 2:] = np.stack([np.sin(0.5 * plans[:, 9, 0]), np.cos(0.5 * plans[:, 9, 0])], 1)
    hover = _hover_rpm(parameters)
    simulator.data = data.replace(
        params=data.params.replace(**wanted),
        states=states.replace(
            pos=jnp.asarray(plans[:, None, :3, 0]),
            quat=jnp.asarray(start),
            rotor_vel=jnp.asarray(np.broadcast_to(hover[:, None], (len(plans), 1, 4)).copy()),
        ),
    )
    rows = []
    for k in range(plans.shape[2]):
        # set-points come at the rate of the position loop, the simulation goes on between them
        if k % (RATE_HZ // STATE_HZ) == 0:
            simulator.state_control(jnp.asarray(_asked(plans[:, :, k])))
        before = simulator.data.states
        kept = {
            n: np.asarray(getattr(before, n))[:, 0]
            for n in ("pos", "vel", "quat", "ang_vel", "rotor_vel")
        }
        simulator.step(1)
        rows.append(kept | {"cmd": np.asarray(simulator.data.controls.rotor_vel)[:, 0]})
        if not np.abs(kept["pos"] - plans[:, :3, k]).max() < OFF_PATH_M:
            raise OffPath("crazyflow's controller lost a path; the path is too fast for the drone")
    return {name: np.stack([r[name] for r in rows]) for name in rows[0]}


def _hover_rpm(parameters: Mapping[str, np.ndarray]) -> np.ndarray:
    curve = parameters["rpm2thrust"].mean(axis=2)[:, 0]
    weight = 9.81 * parameters["mass"].reshape(-1) / 4.0
    # positive root of c_1 w + c_2 w^2 = m g / 4
    root = np.sqrt(curve[:, 1] ** 2 + 4.0 * curve[:, 2] * weight)
    return ((-curve[:, 1] + root) / (2.0 * curve[:, 2]))[:, None]


def _asked(ref: np.ndarray) -> np.ndarray:
    """Return setpoints (worlds, 1, 16) of references (worlds, 11)."""
    # position, velocity, acceleration, attitude by yaw alone (scalar last), body rates
    command = np.zeros((len(ref), 1, 16))
    command[:, 0, :9] = ref[:, :9]
    command[:, 0, 11:13] = np.stack([np.sin(0.5 * ref[:, 9]), np.cos(0.5 * ref[:, 9])], axis=1)
    command[:, 0, 15] = ref[:, 10]
    return command


def _flown(
    design: CrazyflowDesign,
    craft: Any,
    numbers: Mapping[str, np.ndarray],
    book: Mapping[str, np.ndarray],
    plan: np.ndarray,
) -> TrueFlight:
    # f = R' (a + g e_z)
    turn = Rotation.from_quat(book["quat"])
    push, spin = _accelerations(numbers, book)
    inertia = np.diag(numbers["J"])
    changes = {}
    for name in [n for n in NAMES if getattr(design, n)]:
        # at the same states, so that all else, gyroscopic terms too, drops out of the difference
        bare = _accelerations(_without(numbers, name), book)
        changes[NAMES[name]] = {
            "force_N": craft.true["mass"] * turn.apply(push - bare[0], inverse=True),
            "moment_Nm": inertia * (spin - bare[1]),
        }
    states = {
        "p": book["pos"],
        "v": book["vel"],
        "q": book["quat"][:, [3, 0, 1, 2]],
        "omega": book["ang_vel"],
        "rotor_speed": book["rotor_vel"] / RPM,
        "u": book["cmd"] / RPM / craft.true["speed"],
        "specific_force": turn.apply(push + np.array([0.0, 0.0, 9.81]), inverse=True),
        "p_ref": plan[:3].T,
        "v_ref": plan[3:6].T,
        "yaw_ref": plan[9:10].T,
    }
    return TrueFlight(1.0 / RATE_HZ, states, changes)


def _without(numbers: Mapping[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    if name == "weak":
        curves = ("rpm2thrust", "rpm2torque")
        return {**numbers, **{c: np.repeat(numbers[c][:1], 4, axis=0) for c in curves}}
    return drone_models.numbers_without(numbers, name)


def _accelerations(
    numbers: Mapping[str, np.ndarray], book: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return linear (world) and angular acceleration (body), (n, 3), by crazyflow's dynamics."""
    import jax.numpy as jnp
    from crazyflow.dynamics.first_principles import dynamics

    state = [jnp.asarray(book[n]) for n in ("pos", "quat", "vel", "ang_vel", "cmd", "rotor_vel")]
    _, _, push, spin, _ = dynamics(*state, **numbers)
    return np.asarray(push), np.asarray(spin)
