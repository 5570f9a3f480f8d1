"""The generator: its own physics, right in the limits that theory knows, and silent about its
secret.
"""

from __future__ import annotations

import ast
import collections
import dataclasses
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import ges
from ges.blind import generator
from ges.blind.generator import air, attached, drive, grid, ground, make, rotor
from ges.blind.generator.airframe import CLASSES, SD_REL, draw_airframe
from ges.blind.generator.concealed import EVERY, NEUTRAL, PHYSICS
from ges.blind.generator.sensing import Recorder
from ges.blind.protocol import seal
from ges.vehicle.load import load_vehicle

BLIND = Path(generator.__file__).parents[1]
GENERATOR = [
    *sorted((BLIND / "generator").glob("[!_]*.py")),
    BLIND / "limit.py",
    BLIND / "noise.py",
]
ALLOWED = (
    "ges.blind.generator",
    "ges.blind.limit",
    "ges.blind.noise",
    "ges.blind.protocol.seal",
    "ges.conventions",
    "ges.errors",
    "ges.files",
    "ges.provenance.sources",
)


def _imports(path: Path) -> set[str]:
    """Everything a file imports, dotted; of ``from x import y`` it is x.y."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{'.' * node.level}{node.module or ''}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("path", GENERATOR, ids=lambda p: p.stem)
def test_generator_imports_nothing_of_the_simulator(path):
    imports = _imports(path)
    assert not [
        i
        for i in imports
        if i.startswith(("ges", ".")) and not f"{i}.".startswith(tuple(f"{a}." for a in ALLOWED))
    ]
    assert not {"ctypes", "cffi", "importlib"} & {i.split(".")[0] for i in imports}


def test_generator_runs_without_the_compiled_simulator():
    """No symbol of the library is loaded by making a case: the library is not even there."""
    code = (
        "import sys, os\nfrom ges.blind.generator import make\nfrom ges.blind.generator.flight"
        " import Simulation\nc = make.draw_case(make.Spec(0, 'null', (), (), '650g'), 'tiny',"
        " 1)\nassert not any(m.startswith('ges.simulator.') or m == 'ctypes.util' for m in"
        " sys.modules)\nmaps = open('/proc/self/maps').read() if os.path.exists('/proc/self/maps')"
        " else ''\nassert 'libges' not in maps\n"
    )
    import sys

    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"GES_LIBRARY": "/nowhere/libges.so", "PATH": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


def test_equations_are_not_copied_from_the_simulator():
    """No function of the generator has the name of a symbol of the simulator's effects."""
    effects = {p.stem for p in (Path(ges.__file__).parents[2] / "sim_c" / "effects").glob("*.c")}
    assert effects
    named = {
        node.name
        for p in GENERATOR
        if p.stem != "concealed"
        for node in ast.walk(ast.parse(p.read_text()))
        if isinstance(node, ast.FunctionDef)
    }
    assert named & effects <= {"slung_load", "tether"}


def test_flat_ground_is_the_image_rotor():
    """One rotor over flat ground: (R/4z)^2 of Cheeseman and Bennett, to the ray count's
    accuracy.
    """
    radius = np.array([0.12])
    for height in (0.12, 0.24, 0.48):
        centre = np.zeros((3, 4, 1)) + np.array([0.0, 0.0, height])[:, None, None]
        centre[0] += np.array([0.0, 1e3, 2e3, 3e3])[:, None]
        share = ground.image_fraction(centre, radius, lambda x, y: 0.0 * x, np.zeros((2, 1)))
        assert share[0, 0] == pytest.approx((radius[0] / (4.0 * height)) ** 2, rel=0.05)


def test_hover_of_the_blade_element_rotor():
    """Pitch gives back its thrust coefficient, and climbing takes away what heave damping says
    (Bramwell).
    """
    mass, radius, tip, s = 0.65, 0.0635, 79.4, 0.6
    disc = 1.225 * np.pi * radius**2
    ct = mass * 9.81 / (4.0 * disc * tip**2)
    theta, lam = rotor.blade_pitch(ct, s), np.sqrt(ct / 2.0)
    assert rotor.thrust_coefficient(theta, s, lam, 0.0) == pytest.approx(ct, rel=1e-12)
    thrust, v_i, climb = 0.25 * mass * 9.81, lam * tip, 0.05
    for _ in range(4000):
        v_i = rotor.step_inflow(v_i, thrust, 0.0, climb, radius, 1.225, 1e-3)
        thrust = disc * tip**2 * rotor.thrust_coefficient(theta, s, (v_i + climb) / tip, 0.0)
    damping = -4.0 * (thrust - 0.25 * mass * 9.81) / mass / climb
    assert damping == pytest.approx(
        rotor.heave_damping_1_s(s, ct, radius, tip, mass, 1.225), rel=0.02
    )


def test_motor_reaches_the_speed_that_its_map_asks_for():
    droop, x = np.array([0.15]), np.full((4, 1), 0.2)
    for _ in range(3000):
        x, _ = drive.step_motor(
            x, drive.linear_duty(np.full((4, 1), 0.6), droop), 1.0, droop, 30.0, 1.0, 1.5, 1e-3
        )
    assert x == pytest.approx(np.full((4, 1), 0.6), abs=1e-6)


def test_gusts_have_their_standard_deviation():
    rng, state, u = np.random.default_rng(1), np.zeros((5, 400)), []
    sigma, speed, height = np.full(400, 1.5), np.full(400, 4.0), np.full(400, 2.0)
    for k in range(6000):
        state = air.step_gusts(state, sigma, speed, height, rng.standard_normal((3, 400)), 0.05)
        if k > 1000 and k % 50 == 0:
            u.append(state[[0, 1, 3]])
    assert np.std(np.stack(u), axis=(0, 2)) == pytest.approx([1.5, 1.5, 0.75], rel=0.08)


def test_hanging_cable_weighs_what_hangs():
    force = attached.tether(np.array([[0.0], [0.0], [1.5]]), 0.0, 0.2, 0.0)
    assert force.ravel() == pytest.approx([0.0, 0.0, -0.3])


@pytest.mark.parametrize("size", list(CLASSES))
def test_vehicle_files_are_honestly_wrong(size):
    """Nominal parameters are off by about their doubt, never beyond two of it."""
    crafts = [draw_airframe(size, np.random.default_rng(k)) for k in range(200)]
    for key, doubt in (("mass", "mass"), ("thrust", "thrust"), ("lag", "lag"), ("izz", "inertia")):
        off = np.array([c.true[key] / c.nominal[key] - 1.0 for c in crafts]) / SD_REL[doubt]
        assert np.abs(off).max() <= 2.0 + 1e-9
        assert 0.75 < off.std() < 1.1


def test_full_grid_has_what_it_promises(every_spec):
    count = collections.Counter(s.category for s in every_spec)
    assert count == grid.COMPOSITIONS["full"]
    assert (
        count["null"] >= 300
        and count["pair"] >= 150
        and count["triple"] >= 60
        and count["unknown"] >= 100
    )
    singles = collections.Counter(
        (s.names[0], s.levels[0], s.size) for s in every_spec if s.category == "single"
    )
    assert len({n for n, _, _ in singles}) == len(PHYSICS) >= 15
    assert len(singles) == len(PHYSICS) * 3 * len(CLASSES)


def test_each_of_confounded_names_is_concealed_as_often(every_spec):
    concealed = collections.Counter(
        (s.menu, s.names[0], s.rivals) for s in every_spec if s.category == "confounded"
    )
    expected = {
        (menu, n, tuple(r for r in names if r != n))
        for menu, names, _ in grid.CONFOUNDED
        for n in names
    }
    assert set(concealed) == expected and set(concealed.values()) == {5}


@pytest.mark.parametrize("name", [g for g in grid.COMPOSITIONS if g not in ("full", "world")])
def test_small_grids_show_every_kind(name):
    assert (
        sum(grid.COMPOSITIONS[name].values())
        == {"smoke": 4, "glance": 12, "tiny": 40, "sample": 60, "third": 399}[name]
    )
    assert name == "smoke" or {s.category for s in grid.specs(name, 1)} == set(
        grid.COMPOSITIONS["full"]
    )


def test_the_home_world_conceals_every_effect_once():
    singles = [s.names for s in grid.specs("world", 1) if s.category == "single"]
    assert sorted(singles) == sorted((name,) for name in PHYSICS)


@pytest.mark.parametrize("name", sorted(EVERY))
def test_a_secret_touches_only_known_numbers(name):
    craft = draw_airframe("650g", np.random.default_rng(1))
    sizes = []
    for level in range(3):
        numbers = EVERY[name](craft, level, np.random.default_rng(2))
        assert set(numbers) <= set(NEUTRAL)
        sizes.append(max(abs(v - NEUTRAL[k]) for k, v in numbers.items()))
    assert all(np.isfinite(sizes)) and max(sizes) > 0


def test_circumstances_do_not_know_the_secret(every_spec):
    """Name, terrain, flights, logging: the same whatever is concealed."""
    for spec in every_spec[:50]:
        spec = dataclasses.replace(spec, menu="full", logging={})
        bare = dataclasses.replace(spec, category="null", names=(), levels=())
        assert grid.draw_circumstances(spec, "full", 3) == grid.draw_circumstances(bare, "full", 3)


def test_recordings_say_nothing_but_physics(flown):
    """With and without a secret: same columns, types, times and rows; only what is measured
    differs.
    """
    _, cases, parts = flown
    a, b = (
        Recorder(p[0], c.sorties[0], c.around.logging, np.random.default_rng(0)).frame()
        for c, p in zip(cases, parts, strict=True)
    )
    assert list(a) == list(b) and (a.dtypes == b.dtypes).all() and len(a) == len(b)
    assert (a["t_s"] == b["t_s"]).all()
    assert not np.allclose(a["p_x_m"], b["p_x_m"], atol=1e-3)


def test_concealed_force_is_there_and_only_there(flown):
    _, cases, parts = flown
    weight = cases[0].craft.true["mass"] * 9.80665
    drag, nothing = (np.abs(p[0]["extra_force"]).max() / weight for p in parts)
    assert drag > 0.01 and nothing < 1e-9


def test_flights_stay_up(flown):
    _, cases, parts = flown
    for case, flights in zip(cases, parts, strict=True):
        assert make._flew(case, flights)


def test_what_cannot_be_flown_is_flown_gentler(every_spec):
    """A further attempt at a case, its numbers drawn anew, asks for slower runs: some motors are
    too lazy for the first.
    """
    spec = next(s for s in every_spec if s.names == ("motor_lag",) and s.menu == "full")
    runs = list(make.draw_case(spec, "full", 3).around.menu).index("runs")
    fastest = [
        np.abs(make.draw_case(spec, "full", 3, a).sorties[runs].plan.reference[3:6]).max()
        for a in (0, make.ATTEMPTS - 1)
    ]
    # another vehicle is drawn, too, and a larger one flies faster
    assert fastest[1] < 0.8 * fastest[0]
    hard = dataclasses.replace(spec, levels=(2,))
    assert [
        make.draw_case(hard, "full", 3, a).spec.levels
        for a in (0, make.ATTEMPTS, 2 * make.ATTEMPTS)
    ] == [(2,), (1,), (0,)]


@pytest.mark.slow
def test_an_interrupted_making_goes_on_to_the_same_bytes(tmp_path, monkeypatch):
    few = make.specs("smoke", 5)[:2]
    monkeypatch.setattr(make, "BATCH", 1)
    monkeypatch.setattr(make, "specs", lambda *_: few)
    whole, broken, made, turns = tmp_path / "whole", tmp_path / "broken", make._make_batch, []
    make.make_cases(whole, 5, "smoke")

    def second_fails(job):
        turns.append(job)
        if len(turns) == 2:
            raise KeyboardInterrupt
        return made(job)

    monkeypatch.setattr(make, "_make_batch", second_fails)
    with pytest.raises(KeyboardInterrupt):
        make.make_cases(broken, 5, "smoke")
    assert make.make_cases(broken, 5, "smoke") == 2 and len(turns) == 3
    sums = [(folder / "sealed" / seal.SUMS).read_text() for folder in (whole, broken)]
    assert sums[0] == sums[1]


def test_streams_are_in_step(flown):
    """Nothing is late in a recording without a concealed lateness."""
    _, cases, parts = flown
    case, truth = cases[1], parts[1][0]
    case = dataclasses.replace(
        case,
        around=dataclasses.replace(
            case.around,
            logging=dataclasses.replace(case.around.logging, noise="low", rotor_speeds=True),
        ),
    )
    record = Recorder(truth, case.sorties[0], case.around.logging, np.random.default_rng(0))
    frame, shifts = record.frame(), np.arange(-6, 7) * 1e-3
    for name, columns in (
        ("omega", "omega_{}_rad_s"),
        ("v", "v_{}_m_s"),
        ("specific_force", "acc_{}_m_s2"),
    ):
        logged = frame[[columns.format(a) for a in "xyz"]].to_numpy()
        off = [((record._at(name, d).T - logged) ** 2).sum() for d in shifts]
        assert abs(shifts[int(np.argmin(off))]) <= 1e-3


@pytest.mark.parametrize(
    ("frame", "names"),
    [("hexa", ()), ("x8", ()), ("x8", ("coaxial_wake",)), ("hexa", ("payload",))],
)
def test_more_rotors_stay_up_and_can_be_told(frame, names, tmp_path):
    spec = grid.Spec(0, "single" if names else "null", names, (1,) * len(names), frame=frame)
    (tmp_path / "cases").mkdir()
    (tmp_path / "sealed").mkdir()
    make.fly_batch([spec], tmp_path, 3, lambda s, attempt: make.draw_case(s, "tiny", 3, attempt))
    (case,) = (tmp_path / "cases").iterdir()
    vehicle = load_vehicle(case / "vehicle.yaml")
    assert len(vehicle.rotors) == {"hexa": 6, "x8": 8}[frame]
    sealed = json.loads((tmp_path / "sealed" / f"{case.name}.json").read_text())
    assert sealed["situation"]["rotors"] == len(vehicle.rotors)
    told = sealed["detectable"]["without"]
    assert told.keys() == set(names) and all(nats > 1.0 for nats in told.values())
