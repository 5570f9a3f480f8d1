"""Worlds: the split, the making in pieces, and flights whose concealed forces are exactly known."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from ges.blind.foreign import given, logs, mujoco, multirotor, paths, real, rotorpy, sets, worlds
from ges.blind.foreign.sets import Concealed, Place, Sources
from ges.blind.generator.detectable import body_of
from ges.blind.protocol import seal
from ges.blind.score import by_world
from ges.errors import GesError, UsageError
from ges.recordings.readers import open_log

HALVES = sets.HALVES
VEHICLE = {"name": "toy", "mass_kg": 1.0}


def _every(half: str, seed: int) -> dict[str, set[str]]:
    """Names of all sets of a half, by world."""
    return {
        name: {p.identity for _, _, p in worlds._sets(world, half, seed, 1, Sources())}
        for name, world in worlds.WORLDS.items()
    }


def test_at_least_three_hundred_sets_half_for_each():
    seeds = dict(zip(HALVES, (7, 1007), strict=True))
    counts = [sum(map(len, _every(half, seed).values())) for half, seed in seeds.items()]
    assert min(counts) >= 150 and sum(counts) >= 300


def test_a_seed_belongs_to_one_half(tmp_path):
    assert [sets.half_of(s) for s in (0, 999, 1000, 5000)] == [*HALVES[:1] * 2, *HALVES[1:] * 2]
    for half, seed in (("development", 1000), ("evaluation", 999)):
        with pytest.raises(UsageError, match="belongs to"):
            worlds.make_worlds(tmp_path / half, half, seed)
        assert not (tmp_path / half).exists()


def test_development_never_writes_evaluation_sets():
    """Whatever the seeds, no set of one half is one of the other; nor do rates, noise, families of
    paths or real conditions meet.
    """
    for name in worlds.WORLDS:
        early = set().union(*(_every("development", seed)[name] for seed in (0, 7, 999)))
        late = set().union(*(_every("evaluation", seed)[name] for seed in (1000, 1007)))
        assert not early & late
    assert not set(sets.RATES_HZ[HALVES[0]]) & set(sets.RATES_HZ[HALVES[1]])
    assert not set(sets.LEVELS[HALVES[0]].values()) & set(sets.LEVELS[HALVES[1]].values())
    assert not set(paths.FAMILIES[HALVES[0]]) & set(paths.FAMILIES[HALVES[1]])
    for designs in (real.crazypad_designs, real.imrclab_designs, real.appius_designs):
        early, late = ({(d.about, d.flights) for d in designs(half)} for half in HALVES)
        assert not early & late
    crazypad = ({f for d in real.crazypad_designs(h) for f in d.flights} for h in HALVES)
    assert not set.intersection(*crazypad)


def test_every_design_has_a_key_of_its_own():
    for world in worlds.WORLDS.values():
        for half in HALVES:
            keys = [d.key for d in world.designs(half, Sources())]
            assert len(keys) == len(set(keys))


@dataclasses.dataclass(frozen=True)
class _Toy:
    key: str


def _toy(out: Path, chosen, places: Sources) -> None:
    for design, _, place in chosen:
        frame = pd.DataFrame({"t_s": np.arange(3.0), "x": place.rng("x").random(3)})
        truth = Concealed().truth() | {"situation": {"world": place.world, "design": design.key}}
        sets.write_set(out, place, VEHICLE, [frame, frame], truth)


@pytest.fixture
def toys(monkeypatch):
    """Two worlds that write at once, in this process, and one that cannot be made."""

    class Here:
        def __init__(self, *_):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def submit(self, function, *arguments):
            from concurrent.futures import Future

            done = Future()
            done.set_result(function(*arguments))
            return done

    def designs(half, _):
        return [_Toy(f"{half} {k}") for k in range(5)]

    table = {
        "toys": worlds.World("toys", "", designs, _toy, batch=2),
        "bricks": worlds.World("bricks", "", designs, _toy),
        "far": worlds.World("far", "", designs, _toy, modules=("no_such_simulator",)),
    }
    monkeypatch.setattr(worlds, "WORLDS", table)
    monkeypatch.setattr(worlds, "ProcessPoolExecutor", Here)
    return table


def test_worlds_are_made_sealed_and_what_is_missing_is_said(tmp_path, toys):
    out = tmp_path / "abroad"
    count, total, skipped = worlds.make_worlds(out, "development", 3)
    assert (count, total) == (10, 10) and set(skipped) == {"far"}
    assert "no_such_simulator is not installed; pip install" in skipped["far"]
    about = json.loads((out / "sealed" / "made.json").read_text())
    assert about["worlds"] == {"toys": 5, "bricks": 5} and about["skipped"] == skipped
    assert len(seal.cases(out)) == 10
    with pytest.raises(UsageError, match="already holds sealed cases"):
        worlds.make_worlds(out, "development", 3)


def test_a_set_that_nobody_can_fly_ends_no_world(tmp_path, toys, monkeypatch):
    def unsteady(out, chosen, sources):
        _toy(out, [one for one in chosen if one[1] != 2], sources)
        if any(number == 2 for _, number, _ in chosen):
            raise sets.OffPath("'brick 2' was lost; its path is too fast")

    monkeypatch.setitem(toys, "bricks", dataclasses.replace(toys["bricks"], make=unsteady))
    out = tmp_path / "abroad"
    count, total, skipped = worlds.make_worlds(out, "development", 3, ["bricks"])
    assert count == total == 5 and len(seal.cases(out)) == 4
    assert list(skipped.values()) == ["'brick 2' was lost; its path is too fast"]
    assert json.loads((out / "sealed" / "made.json").read_text())["lost"] == skipped
    assert by_world.skipped(out)["why"].tolist() == list(skipped.values())


def test_pieces_go_on_to_the_same_bytes(tmp_path, toys, monkeypatch):
    """A clock that runs a minute a look: stopped after three batches, and again; what it ends in is
    what one run makes.
    """
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    worlds.make_worlds(whole, "evaluation", 1003)
    minute = itertools.count()
    monkeypatch.setattr(worlds.time, "monotonic", lambda: 60.0 * next(minute))
    counts = []
    while not (parts / "sealed" / seal.SUMS).exists():
        count, total, _ = worlds.make_worlds(parts, "evaluation", 1003, minutes=3.5, processes=1)
        counts.append(count)
    assert len(counts) > 2 and counts == sorted(counts) and counts[-1] == total == 10
    assert seal.listed(whole) == seal.listed(parts)


def test_other_makers_or_seeds_clear_away_what_was_begun(tmp_path, toys):
    out = tmp_path / "abroad"
    seal.begin(out, {"seed": 1})
    (out / "cases" / "left").mkdir()
    seal.begin(out, {"seed": 1})
    assert (out / "cases" / "left").exists()
    seal.begin(out, {"seed": 2})
    assert not (out / "cases" / "left").exists()


def test_unknown_world_is_said(tmp_path, toys):
    with pytest.raises(UsageError, match="did you mean 'bricks'"):
        worlds.make_worlds(tmp_path, "development", 3, only=["brick"])


def test_every_so_many_th_set_of_a_world_is_taken(toys):
    world = dataclasses.replace(
        toys["toys"], designs=lambda half, _: [_Toy(str(k)) for k in range(20)]
    )
    keys = {
        every: [d.key for d, _, _ in worlds._sets(world, "development", 3, every, Sources())]
        for every in (1, 8, 50)
    }
    assert keys == {1: [str(k) for k in range(20)], 8: ["4", "12"], 50: ["0"]}


def test_names_of_sets_say_nothing():
    place = Place("rotorpy", "hummingbird rotor_drag 1 #0", "development", 7)
    assert len(place.identity) == 12 and int(place.identity, 16) >= 0
    assert place.rng("a").random() == place.rng("a").random() != place.rng("b").random()


def test_acceptable_answers_are_all_combinations_of_what_is_true_as_well():
    truth = Concealed(("a",), optional=("b", "c"), instead=(("d",),)).truth()
    assert truth["findings"] == [{"name": "a", "parameters": {}}]
    other = {frozenset(o) for o in truth["also_acceptable"]}
    assert other == {frozenset(s) for s in ("ab", "ac", "abc", "d", "bd", "cd", "bcd")}
    twice = Concealed(("weak_rotor",), places={"weak_rotor": ("rotor 1", "rotor 2")}).truth()
    assert [f["place"] for f in twice["findings"]] == ["rotor 1", "rotor 2"]
    heavy = Concealed(("rotor_drag", "thrust_scale"), heavier=True).truth()
    assert heavy["also_acceptable"] == [["payload", "rotor_drag"]]
    assert twice["category"] == "single" and Concealed().truth()["verdict"] == "nothing_proven"


@pytest.mark.parametrize("half", HALVES)
def test_paths_are_smooth_and_stay_above_the_lowest_height(half):
    scale = paths.Scale(0.2, 0.1, 2.5, 0.3)
    for reference in paths.references(half, 14.0, 0.004, scale, np.random.default_rng(0)):
        assert reference.shape == (11, 3500)
        assert reference[2].min() > 0.19
        assert np.abs(np.diff(reference[:3], axis=1) / 0.004 - reference[3:6, 1:]).max() < 0.05
        assert np.linalg.norm(reference[3:6], axis=0).max() < 1.3 * scale.speed_m_s


# Flights by other people's equations of motion: what they feel, less what the concealed effects
# did, is the thrust of a plain vehicle. Any part that is missing, twice, or of a wrong sign would
# show.


def _left(flown, craft) -> float:
    """Largest force over the weight that neither thrust nor the changes explain."""
    state, true = flown.state, craft.true
    force = true["mass"] * state["specific_force"]
    for change in flown.changes.values():
        force = force - change.get("force_N", 0.0)
    # changes of a drive are in the rotor speeds already
    force[:, 2] -= true["thrust"] * (state["rotor_speed"] ** 2).sum(axis=1)
    return float(np.abs(force).max() / (9.81 * true["mass"]))


def _balanced(flown, craft) -> None:
    """What the rotors' moments and the changes come to on the average is what turns the body."""
    body, state = body_of(craft), flown.state
    plain = body.wrench(craft.true["thrust"] * state["rotor_speed"] ** 2)["moment_Nm"]
    omega, seconds = state["omega"], flown.step_s * (len(state["omega"]) - 1)
    turning = body.inertia_kg_m2 * (omega[-1] - omega[0]) / seconds
    turning = turning + np.cross(omega, body.inertia_kg_m2 * omega).mean(axis=0)
    left = plain.mean(axis=0) - turning
    for change in flown.changes.values():
        left = left + np.mean(change.get("moment_Nm", np.zeros((1, 3))), axis=0)
    assert np.abs(left).max() < 2e-4 * 9.81 * craft.true["mass"] * craft.arm_m


@pytest.mark.parametrize(
    "design",
    [
        rotorpy.RotorpyDesign("hummingbird"),
        rotorpy.RotorpyDesign(
            "crazyflie", {"rotor_drag": 1.0, "parasitic_drag": 1.0}, wind_m_s=1.5
        ),
        rotorpy.RotorpyDesign("hummingbird", {"translational_lift": 1.0, "axial_inflow": 0.3}),
        rotorpy.RotorpyDesign("hummingbird", shift_m=(0.006, -0.004)),
        rotorpy.RotorpyDesign("hummingbird", strange={"skew": 1.0, "vane": 1.0}),
    ],
    ids=lambda d: d.key,
)
def test_rotorpy_keeps_its_balance(design, monkeypatch):
    pytest.importorskip("rotorpy", reason="the extra 'simulators' is not installed")
    monkeypatch.setattr(rotorpy, "SECONDS", (1.5, 1.5))
    numbers, rng = rotorpy._numbers(design), np.random.default_rng(0)
    craft = rotorpy._airframe(design, numbers, rng)
    path = rotorpy._trajectory("development", 1, rotorpy.PACE[design.vehicle], rng)
    blowing = design.wind_m_s * np.array([0.6, 0.8, 0.0])
    air = rotorpy._air(design, blowing, 0.005, rng)
    flown = rotorpy._fly(numbers, design, path, air, 0.005, rng)
    assert set(flown.changes) == {*design.concealed().names, *design.strange}
    assert _left(flown, craft) < 1e-9
    if any(design.shift_m):
        _balanced(flown, craft)
    assert np.abs(flown.state["p"] - flown.state["p_ref"]).max() < 0.6


@pytest.mark.parametrize("name", sorted(rotorpy.STRANGE["hummingbird"]))
def test_the_sealed_law_of_a_stranger_is_what_acts(name):
    """Evaluated as powers of forward and leftward speed and yaw rate, all of them positive."""
    design = rotorpy.RotorpyDesign("hummingbird", strange={name: 0.7})
    truth = design.concealed().truth()
    (law,) = truth["laws"]
    air, rates = np.array([1.3, 0.6, -0.4]), np.array([0.1, 0.2, 0.9])
    values = {"V_x": air[0], "V_y": air[1], "V_h": np.hypot(*air[:2]), "r": rates[2]}
    expected = law["coefficient_SI"] * np.prod([values[q] ** n for q, n in law["powers"].items()])
    wrench = np.concatenate(rotorpy._strange_wrench(rotorpy._strange(design), air, rates))
    kind, axis = law["channel"].split("_")
    at = 3 * (kind == "moment") + "xyz".index(axis)
    assert wrench[at] == pytest.approx(expected) and np.count_nonzero(wrench) == 1
    assert (truth["verdict"], truth["category"]) == ("unknown", "unknown")


def test_rotorpy_gusts_without_torch_are_a_set_that_cannot_be_made(monkeypatch):
    monkeypatch.setattr(rotorpy.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(sets.NoSet, match="torch, which is not installed"):
        rotorpy._dryden(1.0, 0.005, np.random.default_rng(0))


def test_rotorpy_gusts_have_the_same_size_whatever_the_step():
    pytest.importorskip("rotorpy", reason="the extra 'simulators' is not installed")
    rng, sizes = np.random.default_rng(0), []
    for step in (0.002, 0.005):
        wind = rotorpy._dryden(0.8, step, rng)
        rows = [wind.update(0.0, np.zeros(3)) for _ in range(int(200.0 / step))]
        sizes.append(np.std(rows, axis=0)[:2].mean())
    assert 0.7 < sizes[0] / sizes[1] < 1.4 and min(sizes) > 0.4 and max(sizes) < 1.6


MUJOCO = (
    mujoco.MujocoDesign("x1100"),
    mujoco.MujocoDesign("x1100", drag=4.0, wind_m_s=3.0),
    mujoco.MujocoDesign("x150", viscosity=0.02),
    mujoco.MujocoDesign("x1100", load=0.1),
    mujoco.MujocoDesign("x1100", spring=2.0),
    mujoco.MujocoDesign("x150", weak=0.1, tilt_rad=0.03),
    mujoco.MujocoDesign("x1100", shift=0.05),
    mujoco.MujocoDesign("x1100", curve=0.6),
    mujoco.MujocoDesign("x1100", ceiling=0.8, delay_s=0.016),
)


@pytest.mark.parametrize("design", MUJOCO, ids=lambda d: d.key)
def test_mujoco_keeps_its_balance(design):
    pytest.importorskip("mujoco", reason="the extra 'simulators' is not installed")
    rng = np.random.default_rng(0)
    craft = mujoco._airframe(design, rng)
    scale = paths.Scale(1.0, craft.radius_m, 2.0, 0.3)
    plan = paths.references("development", 6.0, mujoco.STEP_S, scale, rng)[1][:, :1200]
    flown = mujoco._fly(design, craft, plan, 0.4, rng)
    assert set(flown.changes) == set(design.concealed().names)
    drives = {"thrust_curve", "rotor_saturation", "esc_delay"} & set(flown.changes)
    if not drives:
        assert _left(flown, craft) < 2e-6
        _balanced(flown, craft)
    for name in drives & {"thrust_curve"}:
        assert np.abs(flown.changes[name]["speed_rad_s"]).max() > 1.0


def test_mujoco_without_anything_in_its_drive_is_the_declared_drive():
    pytest.importorskip("mujoco", reason="the extra 'simulators' is not installed")
    rng, design = np.random.default_rng(0), mujoco.MujocoDesign("x150")
    craft = mujoco._airframe(design, rng)
    plan = paths.references(
        "development", 6.0, mujoco.STEP_S, paths.Scale(1.0, 0.04, 2.0, 0.3), rng
    )[0][:, :1000]
    state = mujoco._fly(design, craft, plan, 0.0, rng).state
    plain = mujoco._plain_speed(craft, state)
    assert np.abs(plain - state["rotor_speed"]).max() < 1e-6 * craft.true["speed"]


def test_multirotor_keeps_its_balance():
    """What blades, a weak rotor and a shift change is all that parts the force from k w^2."""
    pytest.importorskip("multirotor", reason="the extra 'simulators' is not installed")
    rng = np.random.default_rng(1)
    design = multirotor.MultirotorDesign("quad", blades=True, weak=0.1, voltage=True)
    craft = multirotor._airframe(design, rng)
    plan = paths.references(
        "development", 6.0, multirotor.STEP_S, paths.Scale(1.0, 0.1, 2.0, 0.3), rng
    )[3][:, 1000:1300]
    flown = multirotor._fly(design, craft, plan, rng)
    force = craft.true["mass"] * flown.state["specific_force"]
    assert set(flown.changes) == {
        "axial_inflow",
        "translational_lift",
        "thrust_curve",
        "weak_rotor",
    }
    # of the weak rotor the blades change a tenth less
    left = force[:, 2] - craft.true["thrust"] * (flown.state["rotor_speed"] ** 2).sum(axis=1)
    parts = {n: c["force_N"][:, 2] for n, c in flown.changes.items() if n != "thrust_curve"}
    of_blades = parts["axial_inflow"] + parts["translational_lift"]
    assert np.abs(left - sum(parts.values())).max() < 0.1 * np.abs(of_blades).max()
    # thrust falls with climb and rises with speed along the disc
    climb = np.einsum("ni,ni->n", flown.state["v"], _up(flown.state["q"]))
    assert np.corrcoef(climb, parts["axial_inflow"])[0, 1] < -0.9
    assert parts["translational_lift"].min() > -1e-6
    # commands that are a share of the voltage make more than they would of the speed
    assert flown.changes["thrust_curve"]["speed_rad_s"][-1].min() > 0.0


def _up(q: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(q, scalar_first=True).apply([0.0, 0.0, 1.0])


ARRAYS = """
import numpy as np
from ges.blind.foreign import drone_models as d, paths
design = d.DroneModelsDesign("cf2x_L250", across=1.0, along=1.0, propeller=2.0)
numbers, rng = d._numbers(design), np.random.default_rng(1)
craft = d.airframe(design.vehicle, numbers, rng)
plan = paths.references("development", 6.0, d.STEP_S, paths.Scale(0.5, 0.02, 0.8, 0.4), rng)[1]
flown = d._fly(design, numbers, craft, plan[:, :300, None], rng)[0]
force = craft.true["mass"] * flown.state["specific_force"]
force = force - sum(c["force_N"] for c in flown.changes.values())
force[:, 2] -= craft.true["thrust"] * (flown.state["rotor_speed"] ** 2).sum(axis=1)
assert np.abs(force).max() < 1e-9, np.abs(force).max()
assert set(flown.changes) == {"rotor_drag", "axial_inflow", "rotor_inertia_reaction"}
reaction = flown.changes["rotor_inertia_reaction"]["moment_Nm"]
assert np.abs(reaction[:, 2]).max() > 0.0
assert np.abs(flown.state["p"] - flown.state["p_ref"]).max() < 0.3
"""


def test_drone_models_keep_their_balance():
    """In a process of its own: the package wants its setting of scipy before scipy is imported."""
    pytest.importorskip("mujoco", reason="the extra 'simulators' is not installed")
    _alone(ARRAYS, {"SCIPY_ARRAY_API": "1"})


CRAZYFLOW = """
import numpy as np
from pathlib import Path
from ges.blind.foreign import crazyflow as c
from ges.blind.foreign.sets import Place
c.SECONDS = 5.0
designs = [
    c.CrazyflowDesign("cf21B_500", across=1.0, along=1.0, weak=0.1),
    c.CrazyflowDesign("cf21B_500"),
]
kept = []
c.write_flown = lambda out, place, *flown: kept.append(flown[:2])
places = [Place(c.WORLD, d.key, "development", 3) for d in designs]
c.make(Path("."), [(d, k, p) for k, (d, p) in enumerate(zip(designs, places))], None)
for craft, flights in kept:
    flown = flights[1]
    force = craft.true["mass"] * flown.state["specific_force"]
    force = force - sum(c["force_N"] for c in flown.changes.values())
    force[:, 2] -= craft.true["thrust"] * (flown.state["rotor_speed"] ** 2).sum(axis=1)
    assert np.abs(force).max() < 1e-9, np.abs(force).max()
"""


@pytest.mark.slow
def test_crazyflow_keeps_its_balance():
    pytest.importorskip("mujoco", reason="the extra 'simulators' is not installed")
    _alone(CRAZYFLOW, dict(worlds.JAX))


def _alone(code: str, environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-3000:]


def test_gym_pybullet_sets_are_taken_as_they_are(tmp_path):
    """A given folder becomes sets under other names, with the truth that lies beside it."""
    case = tmp_path / "worlds" / given.WORLD / "cases" / "g1"
    case.mkdir(parents=True)
    pd.DataFrame({"t_s": [0.0, 0.1], "p_x_m": [0.0, 1.0]}).to_parquet(case / "flight_1.parquet")
    (case / "vehicle.yaml").write_text("name: crazyflie\n")
    sealed = case.parents[1] / "sealed"
    sealed.mkdir()
    truth = Concealed(("rotor_drag",)).truth() | {"case": "gpd_drag"}
    places = Sources(given=tmp_path / "worlds")
    designs = given.designs("development", places)
    place = Place(given.WORLD, "g1", "development", 7)
    with pytest.raises(GesError, match="no truth"):
        given.make(tmp_path / "out", [(designs[0], 0, place)], places)
    (sealed / "g1.json").write_text(json.dumps(truth))
    given.make(tmp_path / "out", [(designs[0], 0, place)], places)
    kept = json.loads((tmp_path / "out" / "sealed" / f"{place.identity}.json").read_text())
    assert kept["situation"]["design"] == "gpd_drag" and kept["category"] == "single"
    assert not given.designs("evaluation", places)


def test_real_flights_become_sets(tmp_path, recordings_dir):
    """A labelled change against its own reference; nothing in a set's folder tells what it was."""
    design = next(d for d in real.crazypad_designs("development") if "cut" in d.about)
    place = Place(real.CRAZYPAD, design.key, "development", 7)
    make = real.maker(real.CRAZYPAD)
    make(tmp_path, [(design, 0, place)], Sources(recordings=recordings_dir))
    files = list((tmp_path / "cases").rglob("*"))
    assert len([f for f in files if f.suffix == ".parquet"]) == len(design.flights) == 2
    for path in files:
        text = str(path.relative_to(tmp_path)).lower()
        assert not any(w in text for w in ("cut", "tape", "string", "weight", "normal", "e8", "e9"))
    truth = json.loads((tmp_path / "sealed" / f"{place.identity}.json").read_text())
    assert {f["name"] for f in truth["findings"]} == {"weak_rotor"}
    assert truth["detectable"]["whole"] is None


def test_labels_of_real_flights_are_those_of_their_folders(recordings_dir):
    for half in HALVES:
        for name, designs in (
            (real.CRAZYPAD, real.crazypad_designs),
            (real.IMRCLAB, real.imrclab_designs),
            (real.APPIUS, real.appius_designs),
        ):
            for design in designs(half):
                for path in (*design.flights, *design.reference):
                    assert (recordings_dir / real.FOLDERS[name] / path).is_file(), path
                assert not set(design.flights) & set(design.reference)


@pytest.mark.parametrize("half", HALVES)
def test_logs_made_in_another_process_are_those_of_their_half(half, tmp_path, recordings_dir):
    design = logs.designs(half)[0]
    sent = pickle.loads(pickle.dumps(design))
    assert sent.concealed() == design.concealed() and "axial_inflow" in sent.concealed().optional
    place = Place(logs.WORLD, sent.key, half, 1)
    logs.make(tmp_path, [(sent, 0, place)], Sources(recordings_dir))
    whole = open_log(recordings_dir / logs.GAZEBO.path, logs.GAZEBO.options).frame()
    case = tmp_path / "cases" / place.identity
    made = sum(len(pd.read_parquet(f)) for f in case.glob("flight_*.parquet"))
    assert made <= len(whole) / 2, "the other half keeps its samples"


def test_logs_of_simulators_conceal_what_is_left_out_of_the_file(tmp_path, recordings_dir):
    design = next(d for d in logs.designs("development") if d.without)
    place = Place(logs.WORLD, design.key, "development", 7)
    logs.make(tmp_path, [(design, 0, place)], Sources(recordings=recordings_dir))
    import yaml

    content = yaml.safe_load(next((tmp_path / "cases").rglob("vehicle.yaml")).read_text())
    assert not set(design.without) & set(content["effects"])
    assert content["mass_kg"]["sd"] > 0.0


def test_a_trajectory_without_a_solution_is_drawn_anew_and_slower(monkeypatch):
    drawn, paces = iter([None, "path"]), []
    monkeypatch.setattr(rotorpy, "_air", lambda *_: None)
    monkeypatch.setattr(rotorpy, "_fly", lambda numbers, design, path, *_: path)
    monkeypatch.setattr(
        rotorpy, "_trajectory", lambda half, kind, pace, rng: paces.append(pace) or next(drawn)
    )
    design, rng = rotorpy.RotorpyDesign("hummingbird"), np.random.default_rng(0)
    assert rotorpy._fly_gently(design, {}, "development", 2, np.zeros(3), 0.01, rng) == "path"
    assert paces[1] == rotorpy.GENTLER * paces[0]


def test_waypoints_that_rotorpys_solver_finds_no_path_through_give_none(monkeypatch):
    minsnap = pytest.importorskip("rotorpy.trajectories.minsnap", reason="no rotorpy here")

    def unsolved(*_, **__):
        raise TypeError("'NoneType' object is not subscriptable")

    monkeypatch.setattr(minsnap, "MinSnap", unsolved)
    assert rotorpy._trajectory("development", 2, 1.0, np.random.default_rng(0)) is None
