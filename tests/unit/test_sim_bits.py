"""One lane or eight, these instructions or those, Python or ges_sim: the same bytes."""

import os
import platform
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ges.simulator import _lib, effects
from ges.simulator import flight as sim
from ges.simulator.parameters import parameter_vector
from ges.simulator.terrain import Terrain

ROOT = Path(__file__).resolve().parents[2]


def batch() -> list[sim.Flight]:
    """Flights that differ in everything a lane may differ in."""
    rng = np.random.default_rng(1)
    flights = []
    for i in range(13):
        numbers = {
            "seed": i,
            "duration_s": 4,
            "mode": sim.modes()[i % 6],
            "bias": 0.01 * (i % 3 - 1),
            "shadow": i % 2,
            "mass_kg": 1.0 + 0.05 * i,
            "pulse": 0.02,
            "pulse_start_s": 1,
            "pulse_duration_s": 0.1,
            "preview_s": 0.1 * (i % 2),
            "lead_s": 0.01 * (i % 3),
        }
        on = {
            "ground_effect": {"curvature_gain_m": 0.6, "amplitude": 1 + 0.1 * i},
            "rotor_drag": {"k_kg": 1e-4 * rng.uniform()},
        }
        flights.append(sim.Flight(numbers, on))
    flights.append(
        sim.Flight(
            {"seed": 99, "duration_s": 2, "integrator": 1},
            {"wind": {"roughness_m": 0.02}, "rotor_drag": {}, "gusts": {}},
        )
    )
    flights.append(
        sim.Flight(
            {"duration_s": 2, "agl_ref_m": 0.5},
            {"ground_effect": {"form": 3}, "ground_effect_lag": {}},
            Terrain.flat(),
        )
    )
    return flights


def as_bytes(records: list[sim.Record]) -> bytes:
    return b"".join(np.stack(list(r.columns.values())).tobytes() for r in records)


def test_results_do_not_depend_on_lanes():
    assert len({as_bytes(sim.fly(batch(), lanes=n)) for n in (0, 1, 2, 4, 8)}) == 1


def test_results_do_not_depend_on_company():
    together = sim.fly(batch())
    alone = [sim.fly([flight])[0] for flight in batch()]
    reversed_order = sim.fly(batch()[::-1])[::-1]
    assert as_bytes(together) == as_bytes(alone) == as_bytes(reversed_order)


def test_seeds_and_modes_matter():
    flights = batch()
    assert len({as_bytes([r]) for r in sim.fly(flights)}) == len(flights)


def test_both_faces_give_equal_bytes(tmp_path):
    references = np.zeros((50, 14))
    references[:, 2] = np.linspace(0.5, 1.0, 50)
    flights = [
        *batch(),
        sim.Flight({"duration_s": 2, "inputs_dt_s": 0.05}, {}, Terrain.flat(), references),
    ]
    names = ["t_s", "p_z_m", "gyro_x_rad_s", "range_m", "ge_factor", "battery_V"]
    script, out = tmp_path / "flights.txt", tmp_path / "out.bin"
    sim.write_script(flights, script, names)
    subprocess.run([_lib.library_path().parent / "ges_sim", script, "--out", out], check=True)
    python = b"".join(
        np.stack([r[n] for n in names], axis=1).tobytes() for r in sim.fly(flights, names)
    )
    assert out.read_bytes() == python


# Flags, and what the processor has to have to run what they make.
AVX512 = "-mavx512f -mavx512dq -mavx512vl -mavx512bw -mfma"
INSTRUCTIONS = {
    "baseline": ("", set()),
    "avx2_fma": ("-mavx2 -mfma", {"avx2", "fma"}),
    "avx512_fma": (AVX512, {"avx512f", "avx512vl"}),
}


def built(folder: Path, **settings: str) -> Path:
    """The simulator compiled with these settings of its Makefile."""
    options = [f"{name}={value}" for name, value in settings.items()]
    subprocess.run(
        ["make", "-s", "-j2", "-C", ROOT / "sim_c", f"BUILD={folder}", *options], check=True
    )
    return folder


def flown(program: Path, script: Path, lanes: int, *before: str) -> bytes:
    out = script.with_name("out.bin")
    subprocess.run([*before, program, script, "--out", out, "--lanes", str(lanes)], check=True)
    return out.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("instructions", INSTRUCTIONS)
def test_results_do_not_depend_on_instructions(instructions, tmp_path):
    flags, needed = INSTRUCTIONS[instructions]
    if not needed <= processor():
        pytest.skip(f"this processor has no {instructions}")
    every = {f"ISA_{n}": flags for n in (1, 2, 4, 8)}
    ours = built(tmp_path / "b", OPT="-O1", **every) / "ges_sim"
    script = tmp_path / "flights.txt"
    sim.write_script(batch(), script)
    outputs = {flown(ours, script, lanes) for lanes in (0, 1, 2, 4, 8)}
    assert outputs == {flown(ROOT / "build/ges_sim", script, 0)}


def processor() -> set[str]:
    """What instructions the processor says it has, by the names of Linux; nothing elsewhere."""
    about = Path("/proc/cpuinfo")
    return set(about.read_text().split()) if about.exists() else set()


@pytest.mark.skipif(shutil.which("objdump") is None, reason="objdump is not installed")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="one width alone on this processor")
def test_each_width_keeps_to_its_instructions():
    """A processor without AVX meets none of it: batch, terrain, all of 2, firmware of 1."""
    avx512, avx = r"%zmm|\{%k\d\}", r"%[yz]mm|\bv[a-z]+[sp][sd]\b"
    wider = {r".*_w8\.o": r"$^", r".*_w4\.o|(?!firmware).*_w1\.o": avx512, r".*\.o": avx}
    for unit in (ROOT / "build/obj").glob("*.o"):
        allowed = next(pattern for name, pattern in wider.items() if re.fullmatch(name, unit.name))
        listing = subprocess.run(["objdump", "-d", unit], capture_output=True, text=True).stdout
        assert not re.search(allowed, listing), unit.name
    wide = {n: (ROOT / f"build/obj/kernel_r4_w{n}.o").read_bytes() for n in (4, 8)}
    assert wide[4] != wide[8]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("qemu-x86_64") is None, reason="qemu-user is not installed")
@pytest.mark.parametrize("older", ["core2duo", "Haswell"])
def test_an_older_processor_runs_what_it_has(older, tmp_path):
    script, program = tmp_path / "flights.txt", ROOT / "build/ges_sim"
    sim.write_script(batch()[::3], script)
    outputs = {flown(program, script, n, "qemu-x86_64", "-cpu", older) for n in (0, 1, 4, 8)}
    assert outputs == {flown(program, script, 0)}


ARM = "aarch64-linux-gnu"


@pytest.mark.slow
@pytest.mark.skipif(
    not all(map(shutil.which, (f"{ARM}-gcc", "qemu-aarch64"))),
    reason="the cross compiler and emulator of arm64 are not installed",
)
def test_results_are_those_of_an_arm_processor(tmp_path):
    theirs = built(tmp_path / "b", CC=f"{ARM}-gcc", OPT="-O1") / "ges_sim"
    script = tmp_path / "flights.txt"
    sim.write_script(batch()[::3], script)
    emulator = ("qemu-aarch64", "-L", f"/usr/{ARM}")
    outputs = {flown(theirs, script, lanes, *emulator) for lanes in (0, 1, 2)}
    assert outputs == {flown(ROOT / "build/ges_sim", script, 0)}


@pytest.mark.parametrize("first", [1, 51])
def test_numpy_terrain_equals_c_bit_for_bit(first):
    rng = np.random.default_rng(first)
    for seed in range(first, first + 50):
        x, y = rng.uniform(-5, 2505, 10_000), rng.uniform(-3, 3, 10_000)
        ours = Terrain.procedural(seed).at(x, y)
        theirs = _lib.terrain(parameter_vector(Terrain.procedural(seed).parameters()), None, x, y)
        for a, b in zip(
            (ours.height_m, ours.slope_x, ours.slope_y, ours.curvature_1_m), theirs, strict=True
        ):
            assert np.array_equal(a.view(np.int64), b.view(np.int64))


def test_numpy_height_map_equals_c():
    rng = np.random.default_rng(0)
    terrain = Terrain.grid(np.linspace(-2, 3, 11), np.linspace(-1, 1, 9), rng.normal(size=(9, 11)))
    x, y = rng.uniform(-4, 5, 1000), rng.uniform(-2, 2, 1000)
    grid = _lib.pack_grid(terrain.x_m, terrain.y_m, terrain.heights_m)
    height, *_ = _lib.terrain(parameter_vector(terrain.parameters()), grid, x, y)
    assert np.array_equal(terrain.at(x, y).height_m, height)


def test_features_do_not_overlap_and_ground_is_irregular():
    from ges.simulator.terrain import ProceduralShape, _layout

    for seed in range(1, 21):
        layout = _layout(seed, ProceduralShape())
        assert 800 <= len(layout.features) <= 1499
        low, high = (
            layout.features[:, 0] - 1 / layout.features[:, 1],
            layout.features[:, 0] + 1 / layout.features[:, 1],
        )
        assert np.all(high[:-1] < low[1:])
    heights = Terrain.procedural(1).at(np.linspace(0, 80, 4000), 0.0).height_m
    assert 0.02 < heights.std() < 0.2


def test_slope_and_curvature_are_derivatives_of_the_height():
    terrain, rng, h = Terrain.procedural(4), np.random.default_rng(2), 1e-5
    x, y = rng.uniform(1, 100, 2000), rng.uniform(-2, 2, 2000)
    at = terrain.at
    slope_x = (at(x + h, y).height_m - at(x - h, y).height_m) / (2 * h)
    laplacian = (
        at(x + h, y).slope_x - at(x - h, y).slope_x + at(x, y + h).slope_y - at(x, y - h).slope_y
    ) / (2 * h)
    assert np.allclose(at(x, y).slope_x, slope_x, atol=1e-6)
    assert np.allclose(at(x, y).curvature_1_m, laplacian, atol=2e-3)


def test_replay_asks_the_function_that_flew():
    on = {"ground_effect": {"curvature_gain_m": 0.6}, "rotor_drag": {}, "parasitic_drag": {}}
    record = sim.fly([sim.Flight({"seed": 3, "duration_s": 20}, on)])[0]
    replay = effects.replay(
        {}, effects.Samples.from_columns(record.columns), on, Terrain.procedural(3)
    )
    for i in range(1, 5):
        assert np.array_equal(replay[f"ge_factor_{i}"], record[f"ge_factor_{i}"])
    specific = (replay.force_N[:, 2] / 1.2)[record["contact"] == 0]
    assert np.allclose(specific, record["acc_z_m_s2"][record["contact"] == 0], atol=6 * 0.05)


@pytest.mark.parametrize("lanes", [0, 1, 2, 4, 8])
def test_sets_are_replayed_alike_side_by_side_and_alone(lanes):
    record = sim.fly([sim.Flight({"seed": 3, "duration_s": 4}, {"ground_effect": {}})])[0]
    samples = effects.Samples.from_columns(record.columns)
    loads = [{"slung_load": {"length_m": length}} for length in (0.3, 0.5, 0.9)]
    lagging = [{"ground_effect": {}, "ground_effect_lag": {"c": c}} for c in (2.0, 5.0)]
    sets = [*loads, {}, *lagging, {"ground_effect": {}}, loads[0]]
    alone = [effects.replay({}, samples, e, Terrain.procedural(3)).data for e in sets]
    together = [
        r.data for r in effects.replay_each({}, samples, sets, Terrain.procedural(3), lanes)
    ]
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(alone, together, strict=True))
    assert not np.array_equal(together[0], together[1])


def test_a_million_samples_go_through_one_effect():
    record = sim.fly([sim.Flight({"duration_s": 100}, {"ground_effect": {}}, Terrain.flat())])[0]
    samples = effects.Samples.from_columns({n: np.tile(v, 100) for n, v in record.columns.items()})
    replay = effects.evaluate("ground_effect", {}, samples, {})
    assert replay.data.shape[1] > 1_000_000
    assert np.all(replay.force_N[:, 2] > 0)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
def test_no_leak_and_no_undefined_value_by_valgrind(tmp_path):
    """Sanitized and plain builds are covered below; valgrind sees uninitialised values."""
    program, script = built(tmp_path / "b", OPT="-O1 -g") / "ges_sim", tmp_path / "flights.txt"
    sim.write_script(
        [
            sim.Flight({**f.parameters, "duration_s": 0.1}, f.effects, f.terrain, f.inputs)
            for f in batch()
        ],
        script,
    )
    checked = ["valgrind", "-q", "--error-exitcode=9", "--leak-check=full", program]
    assert subprocess.run([*checked, script, "--out", tmp_path / "o"]).returncode == 0


@pytest.mark.slow
def test_no_undefined_behaviour_by_sanitizers(tmp_path, sanitized):
    script, out = tmp_path / "flights.txt", tmp_path / "o"
    sim.write_script(batch(), script)
    for lanes in (1, 2, 4, 8):
        run = subprocess.run(
            [sanitized / "ges_sim", script, "--out", out, "--lanes", str(lanes)],
            env={**os.environ, "ASAN_OPTIONS": "detect_leaks=1"},
            capture_output=True,
            text=True,
        )
        assert run.returncode == 0, run.stderr
