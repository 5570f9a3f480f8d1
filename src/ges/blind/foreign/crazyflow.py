"""Cases with crazyflow's first-principles dynamics (package ``drone-models``, identified
Crazyflies): drag, motors, propellers.

Needs the optional extra ``simulators``. Their equations of motion and numbers, the other cases'
controller, plans and sensors. The linear term of their thrust curve is left out: a vehicle file
cannot state it, so it would be in every case.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ges.blind.foreign.rotorpy import STEP_S, between, new_folder, plan_flights, write_case
from ges.blind.generator.airframe import Airframe, declare
from ges.blind.generator.pilot import Pilot
from ges.blind.generator.sensing import Logging
from ges.blind.protocol import seal
from ges.errors import GesError

DRONES = ("cf2x_L250", "cf2x_T350")
RPM = 60.0 / (2.0 * np.pi)
PACE, SMOOTH_S = 0.45, 2.4  # motors that take 0.1 s ask for gentle flights
# what is on: drag in the plane, drag along the axis, inertia of the propellers, declared share of
# the motors' lag; the names
CASES = (
    (0.0, 0.0, 0.0, 1.0, ()),
    (1.0, 0.0, 0.0, 1.0, ("rotor_drag",)),
    (1.0, 1.0, 0.0, 1.0, ("rotor_drag", "axial_inflow")),
    (0.0, 0.0, 2.0, 1.0, ("rotor_inertia_reaction",)),
    (0.0, 0.0, 0.0, 0.55, ("motor_lag",)),
)


def make_crazyflow(out: Path, seed: int, tell: Callable[[int, int], None] = lambda *_: None) -> int:
    """Fly and seal the cases, each with both drones; return their number.

    Raises
    ------
    UsageError
        When ``out`` already holds sealed cases.
    GesError
        When the extra is not installed.
    """
    new_folder(out)
    cases = [(drone, case) for case in CASES for drone in DRONES]
    for number, (drone, case) in enumerate(cases):
        _make_case(out, drone, case, np.random.default_rng([seed, number, 7]))
        tell(number + 1, len(cases))
    seal.close(out)
    return len(cases)


def _parameters(drone: str, case: tuple) -> dict:
    try:
        from drone_models import parametrize
        from drone_models.first_principles import dynamics
    except ImportError:
        raise GesError(
            "crazyflow's drone-models is not installed; pip install 'ges[simulators]'"
        ) from None
    plane, axial, propeller, _, _ = case
    numbers = dict(parametrize(dynamics, drone).keywords)
    numbers["drag_matrix"] = np.asarray(numbers["drag_matrix"]) * np.diag([plane, plane, axial])
    numbers["prop_inertia"] = propeller * numbers["prop_inertia"]
    for curve in ("rpm2thrust", "rpm2torque"):
        numbers[curve] = np.asarray(numbers[curve]) * np.array([0.0, 0.0, 1.0])
    return numbers


def _airframe(drone: str, numbers: dict, case: tuple, rng: np.random.Generator) -> Airframe:
    """The true vehicle in our terms; a positive entry of the mixing matrix's last row turns the
    body ccw, the rotor cw.

    Their motors slow down faster than they speed up; a vehicle file has one time constant: the mean
    of both in hover.
    """
    mixing, arm = np.asarray(numbers["mixing_matrix"]), float(numbers["L"])
    inertia = np.diag(np.asarray(numbers["J"]))
    thrust, torque = (float(numbers[k][2]) * RPM**2 for k in ("rpm2thrust", "rpm2torque"))
    hover = np.sqrt(float(numbers["mass"]) * 9.81 / (4.0 * thrust))
    up, up_squares, down, down_squares = np.asarray(numbers["rotor_dyn_coef"])
    rates = np.array([up, down]) + 2.0 * np.array([up_squares, down_squares]) * hover * RPM
    lag = float(np.mean(1.0 / rates))
    true = {
        "mass": numbers["mass"],
        "ixx": inertia[0],
        "iyy": inertia[1],
        "izz": inertia[2],
        "thrust": thrust,
        "torque": torque,
        "lag": lag,
        "speed": 1.5 * hover,
    }
    true = {key: float(value) for key, value in true.items()}
    declared = declare(true, rng)
    declared["lag"] *= case[3]
    spin = tuple(-int(s) for s in np.sign(mixing[2]))
    x, y = tuple(-arm * mixing[1]), tuple(arm * mixing[0])
    return Airframe(
        drone, 0.0235, tuple(map(float, x)), tuple(map(float, y)), 0.0, spin, 4.1, declared, true
    )


def _make_case(out: Path, drone: str, case: tuple, rng: np.random.Generator) -> None:
    numbers = _parameters(drone, case)
    craft = _airframe(drone, numbers, case, rng)
    log = Logging(
        100.0,
        str(rng.choice(["low", "ordinary"])),
        bool(rng.random() < 0.6),
        True,
        False,
        False,
        False,
    )
    sorties = plan_flights(craft, rng, pace=PACE, smooth_s=SMOOTH_S)
    flights = [_fly(numbers, craft, s.plan.reference) for s in sorties]
    names = case[-1]
    truth = {
        "verdict": "physics" if names else "nothing_proven",
        "findings": [{"name": n, "parameters": {}} for n in names],
        "severity": "strong",
        "also_acceptable": [[*names, "gyroscopic_moment"]] if case[2] else [],
        "category": {0: "null", 1: "single", 2: "pair"}[len(names)],
    }
    write_case(out, craft, sorties, flights, log, truth, rng)


def _turning(q: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Rate of a quaternion, scalar last, by body rates; theirs (0.1.0) puts the scalar first."""
    return 0.5 * np.concatenate([q[3] * omega + np.cross(q[:3], omega), [-q[:3] @ omega]])


def _fly(numbers: dict, craft: Airframe, reference: np.ndarray) -> dict[str, np.ndarray]:
    """Fly references (11, n) by Runge and Kutta's fourth order; return the truth at the control
    rate.
    """
    from drone_models.first_principles import dynamics

    one = {k: np.array([v]) for k, v in craft.declared.items()}
    place = (np.array([p]).T for p in (craft.rotor_x_m, craft.rotor_y_m, craft.spin))
    pilot = Pilot(one, *place, np.array([craft.true["lag"]]), STEP_S)
    pilot.held = np.zeros((3, 1))
    half = 0.5 * reference[9, 0]
    hover = craft.hover_speed_rad_s * RPM
    s = np.concatenate(
        [reference[:3, 0], [0.0, 0.0, np.sin(half), np.cos(half)], np.zeros(6), np.full(4, hover)]
    )

    def rate(s: np.ndarray, asked: np.ndarray) -> np.ndarray:
        q = s[3:7] / np.linalg.norm(s[3:7])
        p, _, v, w, rotors = dynamics(s[:3], q, s[7:10], s[10:13], asked, s[13:], **numbers)
        return np.concatenate([p, _turning(q, s[10:13]), v, w, rotors])

    rows = []
    for k in range(0, reference.shape[1], 2):
        x, y, z, w = s[3:7] / np.linalg.norm(s[3:7])
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        ref, quiet = reference[:, k : k + 1], np.zeros((4, 1))
        u = pilot.command(
            ref, quiet, s[:3, None], s[7:10, None], turn[:, :, None], s[10:13, None], np.ones(1)
        )[:, 0]
        asked = u * craft.true["speed"] * RPM
        k1 = rate(s, asked)
        felt = turn.T @ (k1[7:10] + np.array([0.0, 0.0, 9.81]))
        rows.append(
            {
                "p": s[:3],
                "v": s[7:10],
                "q": np.array([w, x, y, z]),
                "omega": s[10:13],
                "rotor_speed": s[13:] / RPM,
                "u": u,
                "current": np.zeros(4),
                "battery": np.ones(1),
                "ground": np.zeros(1),
                "specific_force": felt,
            }
        )
        k2 = rate(s + 0.5 * STEP_S * k1, asked)
        k3 = rate(s + 0.5 * STEP_S * k2, asked)
        s = s + STEP_S / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(s + STEP_S * k3, asked))
    book = {name: between(np.stack([r[name] for r in rows]), name == "u") for name in rows[0]}
    lost = np.abs(book["p"][: reference.shape[1]] - reference[:3].T[: len(book["p"])]).max()
    if not lost < 4.0:
        raise GesError(
            f"{craft.size} was {lost:.1f} m off its references; the plan is too fast for it"
        )
    return book
