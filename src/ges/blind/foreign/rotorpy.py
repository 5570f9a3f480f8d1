"""Cases flown by RotorPy (Folk, Paulos and Kumar 2023): its physics, its controller; what it has
switched on is the truth.

Needs the optional extra ``simulators``. Plans, sensors and the errors of the vehicle files are
those of the other cases.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from ges.blind.generator import ground
from ges.blind.generator.airframe import Airframe, declare
from ges.blind.generator.flight import Sortie
from ges.blind.generator.plan import CONTROL_DT_S, FULL_MENU, Room, make_plan
from ges.blind.generator.sensing import Logging, Recorder
from ges.blind.protocol import seal
from ges.errors import GesError, UsageError
from ges.files import write_json

AERO = ("c_Dx", "c_Dy", "c_Dz", "k_d", "k_z", "k_h", "k_flap")
STEP_S = 2.0 * CONTROL_DT_S
SECONDS = (14.0, 18.0)
PARASITIC = {"c_Dx": 0.02, "c_Dy": 0.02, "c_Dz": 0.02}
FLAPPING = {"k_flap": 2e-5}
# vehicle, aerodynamic coefficients kept as published, coefficients set here, wind (m/s), names of
# what is on
CASES = (
    ("hummingbird", (), {}, 0.0, ()),
    ("hummingbird", ("k_d",), {}, 0.0, ("rotor_drag",)),
    ("hummingbird", ("k_z",), {}, 0.0, ("axial_inflow",)),
    ("hummingbird", ("k_h",), {}, 0.0, ("translational_lift",)),
    ("hummingbird", (), PARASITIC, 0.0, ("parasitic_drag",)),
    ("hummingbird", ("k_d",), {}, 2.5, ("rotor_drag", "wind")),
    ("hummingbird", ("k_d", "k_z"), {}, 0.0, ("rotor_drag", "axial_inflow")),
    ("hummingbird", (), FLAPPING, 0.0, ()),
    ("crazyflie", (), {}, 0.0, ()),
    ("crazyflie", ("k_d",), {}, 0.0, ("rotor_drag",)),
    ("crazyflie", ("k_d",), {}, 1.5, ("rotor_drag", "wind")),
    ("crazyflie", ("k_d", "k_z"), {}, 0.0, ("rotor_drag", "axial_inflow")),
)


def make_rotorpy(
    out: Path,
    seed: int,
    seconds: tuple[float, float] = SECONDS,
    only: int | None = None,
    tell: Callable[[int, int], None] = lambda *_: None,
) -> int:
    """Fly and seal RotorPy's cases; return their number. ``only`` restricts to the first so many.

    Raises
    ------
    UsageError
        When ``out`` already holds sealed cases.
    GesError
        When RotorPy is not installed.
    """
    new_folder(out)
    cases = CASES[:only]
    for number, case in enumerate(cases):
        _make_case(out, case, np.random.default_rng([seed, number, 6]), seconds)
        tell(number + 1, len(cases))
    seal.close(out)
    return len(cases)


def new_folder(out: Path) -> None:
    """Make the folders of a proof; UsageError where sealed cases lie already."""
    if (out / "sealed" / seal.SUMS).exists():
        raise UsageError(f"'{out}' already holds sealed cases; name an empty folder")
    for part in ("cases", "sealed"):
        (out / part).mkdir(parents=True, exist_ok=True)


def plan_flights(
    craft: Airframe,
    rng: np.random.Generator,
    seconds: tuple[float, float] = SECONDS,
    pace: float = 0.8,
    smooth_s: float = 1.3,
) -> list[Sortie]:
    """Plan one flight of every manoeuvre over flat ground."""
    grid = np.zeros((ground.NODES, ground.NODES))
    rooms = [
        Room(float(rng.uniform(*seconds)), craft.radius_m, 0.5, pace, smooth_s, grid)
        for _ in FULL_MENU
    ]
    plans = [
        make_plan(str(m), room, False, False, rng)
        for m, room in zip(rng.permutation(FULL_MENU), rooms, strict=True)
    ]
    return [Sortie(craft, {}, plan, grid, 1.0, 0.0, 0) for plan in plans]


def write_case(
    out: Path,
    craft: Airframe,
    sorties: list[Sortie],
    flights: list[dict],
    log: Logging,
    truth: dict,
    rng: np.random.Generator,
) -> None:
    """Record flights with the other cases' sensors, and seal the truth with the situation."""
    identity = rng.bytes(6).hex()
    folder = out / "cases" / identity
    folder.mkdir()
    for k, (sortie, flown) in enumerate(zip(sorties, flights, strict=True), 1):
        frame = Recorder(flown, sortie, log, rng).frame()
        frame.astype({c: "float32" for c in frame.columns if c != "t_s"}).to_parquet(
            folder / f"flight_{k}.parquet", index=False
        )
    content = craft.vehicle_file({"kind": "flat", "z_m": 0.0})
    (folder / "vehicle.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    situation = {
        "vehicle": craft.size,
        "noise": log.noise,
        "rotor_speeds": log.rotor_speeds,
        "references": True,
        "excitation": False,
        "terrain": "flat",
        "menu": "full",
    }
    write_json(out / "sealed" / f"{identity}.json", truth | {"situation": situation})


def _parameters(vehicle: str, kept: tuple[str, ...], own: dict[str, float]) -> dict:
    try:
        from rotorpy.vehicles import crazyflie_params, hummingbird_params
    except ImportError:
        raise GesError("RotorPy is not installed; pip install 'ges[simulators]'") from None
    published = {"hummingbird": hummingbird_params, "crazyflie": crazyflie_params}[
        vehicle
    ].quad_params
    return (
        published | {k: 0.0 for k in AERO if k not in kept} | {k: published[k] for k in kept} | own
    )


def _make_case(
    out: Path, case: tuple, rng: np.random.Generator, seconds: tuple[float, float]
) -> None:
    vehicle, kept, own, wind, names = case
    numbers = _parameters(vehicle, kept, own)
    craft = _airframe(vehicle, numbers, rng)
    log = Logging(
        100.0,
        str(rng.choice(["low", "ordinary"])),
        bool(rng.random() < 0.6),
        True,
        False,
        False,
        False,
    )
    heading = rng.uniform(0.0, 2.0 * np.pi)
    air = wind * np.array([np.cos(heading), np.sin(heading), 0.0])
    sorties = plan_flights(craft, rng, seconds)
    flights = [_fly(numbers, s.plan.reference, air) for s in sorties]
    write_case(out, craft, sorties, flights, log, _truth(case, numbers), rng)


def _truth(case: tuple, numbers: dict) -> dict:
    vehicle, kept, own, wind, names = case
    strange = not names and bool(own)
    verdict = "unknown" if strange else "physics" if names else "nothing_proven"
    blown = wind > 0.0
    category = (
        "unknown"
        if strange
        else "null"
        if not names
        else "single"
        if len(names) == 1 or blown
        else "pair"
    )
    return {
        "verdict": verdict,
        "findings": [{"name": n, "parameters": {}} for n in names],
        "severity": "strong",
        "also_acceptable": [["wind"]] if blown else [],
        "category": category,
        "concealed": {
            "rotorpy": (
                {k: numbers[k] for k in (*kept, *own)} | ({"wind_m_s": wind} if blown else {})
            )
        },
    }


def _airframe(vehicle: str, numbers: dict, rng: np.random.Generator) -> Airframe:
    """RotorPy's vehicle as the true one, and a file about it with honest errors. Positive torque:
    the rotor turns cw.
    """
    theirs = {
        "mass": "mass",
        "ixx": "Ixx",
        "iyy": "Iyy",
        "izz": "Izz",
        "thrust": "k_eta",
        "torque": "k_m",
        "lag": "tau_m",
        "speed": "rotor_speed_max",
    }
    true = {own: float(numbers[name]) for own, name in theirs.items()}
    places = np.array(list(numbers["rotor_pos"].values()))
    radius = float(numbers.get("rotor_radius", 0.0231))
    spin = tuple(-int(d) for d in numbers["rotor_directions"])
    return Airframe(
        vehicle,
        radius,
        tuple(map(float, places[:, 0])),
        tuple(map(float, places[:, 1])),
        0.0,
        spin,
        12.0,
        declare(true, rng),
        true,
    )


def _fly(numbers: dict, reference: np.ndarray, wind: np.ndarray) -> dict[str, np.ndarray]:
    """Fly a plan's references (11, n) with RotorPy's SE(3) controller; return the truth at the
    control rate.
    """
    from rotorpy.controllers.quadrotor_control import SE3Control
    from rotorpy.vehicles.multirotor import Multirotor

    hover = np.sqrt(numbers["mass"] * 9.81 / (4.0 * numbers["k_eta"]))
    turned = np.array([0.0, 0.0, np.sin(0.5 * reference[9, 0]), np.cos(0.5 * reference[9, 0])])
    state = {
        "x": reference[:3, 0].copy(),
        "v": np.zeros(3),
        "q": turned,
        "w": np.zeros(3),
        "wind": wind,
        "rotor_speeds": np.full(4, hover),
    }
    vehicle, pilot = Multirotor(numbers, state, aero=True), SE3Control(numbers)
    rows = []
    for k in range(0, reference.shape[1], 2):
        ref = reference[:, k]
        asked = {
            "x": ref[:3],
            "x_dot": ref[3:6],
            "x_ddot": ref[6:9],
            "x_dddot": np.zeros(3),
            "x_ddddot": np.zeros(3),
            "yaw": ref[9],
            "yaw_dot": ref[10],
        }
        control = pilot.update(k * CONTROL_DT_S, state, asked)
        state["wind"] = wind
        rows.append(_row(vehicle, state, control, numbers))
        state = _step(vehicle, state, control)
    book = {name: between(np.stack([r[name] for r in rows]), name == "u") for name in rows[0]}
    lost = np.abs(book["p"][: reference.shape[1]] - reference[:3].T[: len(book["p"])]).max()
    if not lost < 4.0:
        raise GesError(
            f"RotorPy's controller was {lost:.1f} m off its references; the plan is too fast for it"
        )
    return book


def between(rows: np.ndarray, held: bool) -> np.ndarray:
    """Rows at the control rate from rows at half of it: commands held, all else half way."""
    following = rows if held else 0.5 * (rows + np.concatenate([rows[1:], rows[-1:]]))
    return np.stack([rows, following], axis=1).reshape(-1, rows.shape[1])


def _step(vehicle, state: dict, control: dict) -> dict:
    """Advance RotorPy's equations of motion by one step of Runge and Kutta's fourth order, ten
    times faster than its own.
    """
    asked = np.clip(control["cmd_motor_speeds"], vehicle.rotor_speed_min, vehicle.rotor_speed_max)
    s, dt = vehicle._pack_state(state), STEP_S
    k1 = vehicle._s_dot_fn(0.0, s, asked)
    k2 = vehicle._s_dot_fn(0.0, s + 0.5 * dt * k1, asked)
    k3 = vehicle._s_dot_fn(0.0, s + 0.5 * dt * k2, asked)
    k4 = vehicle._s_dot_fn(0.0, s + dt * k3, asked)
    new = vehicle._unpack_state(s + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
    return new | {"q": new["q"] / np.linalg.norm(new["q"])}


def _row(vehicle, state: dict, control: dict, numbers: dict) -> dict[str, np.ndarray]:
    x, y, z, w = state["q"]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    felt = turn.T @ (vehicle.statedot(state, control, 0.0)["vdot"] + np.array([0.0, 0.0, 9.81]))
    asked = (
        np.clip(control["cmd_motor_speeds"], 0.0, numbers["rotor_speed_max"])
        / numbers["rotor_speed_max"]
    )
    told = {
        "p": state["x"],
        "v": state["v"],
        "q": [w, x, y, z],
        "omega": state["w"],
        "rotor_speed": state["rotor_speeds"],
        "u": asked,
        "current": np.zeros(4),
        "battery": [1.0],
        "ground": [0.0],
        "specific_force": felt,
    }
    return {name: np.array(value, dtype=float) for name, value in told.items()}
