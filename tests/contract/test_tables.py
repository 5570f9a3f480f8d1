"""In C a mode, a controller and an effect stand in one place each, and no name or
invariant decides."""

import json
import os
import re
import shutil
import subprocess
import sys
import typing
from pathlib import Path

import numpy as np
import pytest

from ges.errors import GesError
from ges.simulator import effects
from ges.simulator import flight as sim
from ges.study import config
from ges.study.figures import style

ROOT = Path(__file__).resolve().parents[2]
SIM = ROOT / "sim_c"
# What flies; the program ges_sim reads names from a file, and has to compare them.
FLYING = [
    path
    for folder in ("core", "world", "body", "effects", "firmware", "sim", "include")
    for path in sorted((SIM / folder).iterdir())
    if path.suffix in (".c", ".h", ".def") and path.name != "ge_ff_mlp_weights.h"
]


def code(path: Path) -> str:
    """Text of a C file without its comments."""
    return re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.S)


def places(pattern: str) -> set[str]:
    return {path.name for path in FLYING if re.search(pattern, code(path))}


def test_no_name_is_compared():
    assert places(r"\bstr(n?case)?n?cmp\b|\bstrstr\b|\bmemcmp\([^;]*name") == set()


def test_effects_are_named_in_their_files_and_in_one_table():
    """Other effects may name one in their descriptors; what flies them may not."""
    for name in effects.table():
        assert places(rf"\b(?:EFFECT|X)\({name}\)") == {f"{name}.c", "effects.def"}
        # wind is an effect, and a kind of effects too
        named = {f"{other}.c" for other in effects.table()} | {"descriptor.h"}
        assert places(rf'"{name}"') <= named


def test_no_invariant_decides():
    """Invariants are for the tests: what flies writes them down, and nothing reads them."""
    engine = [path for path in FLYING if path.parent.name not in ("effects", "include")]
    lines = [line for path in engine for line in code(path).splitlines() if "invariant" in line]
    assert lines == ["SET(invariants, GES_INVARIANTS)"]


def test_no_mode_and_no_controller_is_compared_with_a_number():
    assert places(r"\b(mode|control)\]?\s*[<>=!]=?\s*-?\d") == set()
    assert places(r"\bFF_(?!MODES\b|#)") == {"params.def"}
    # a mixer is needed where the firmware flies, and by none else
    assert places(r"\bCONTROL_(?!#|firmware)") == set()


def test_the_study_and_its_figures_know_the_modes():
    assert list(typing.get_args(config.Mode)) == sim.modes()
    assert set(style.MODE_LABELS) == set(sim.modes())


@pytest.mark.parametrize(
    ("numbers", "sentence"),
    [
        ({"mode": 2.5}, "mode is 2.5; allowed are 0 none, 1 analytical, 2 oracle, 3 ml"),
        ({"control": 0.5}, "control is 0.5; allowed are 0 firmware, 1 replayed_commands"),
        ({"control": "replayed"}, "unknown control 'replayed'; did you mean 'replayed_speeds'?"),
        ({"control": 1}, "control is replayed_commands, but no replay table was given"),
        ({"attitude_imposed": 1}, "the input table of firmware holds references"),
        ({"mass_kg": "heavy"}, "mass_kg is 'heavy'; it takes a number"),
    ],
)
def test_a_choice_that_does_not_exist_is_refused(numbers, sentence):
    with pytest.raises(GesError, match=re.escape(sentence)):
        sim.fly([sim.Flight({"duration_s": 0.1, **numbers})])


def test_an_input_table_without_a_row_is_refused():
    empty = np.empty((0, 14))
    with pytest.raises(GesError, match="the input table has no row"):
        sim.fly([sim.Flight({"duration_s": 0.1}, inputs=empty)])


NEW_MODES = """
X(halfway, 0, 0.5f * (1.0f + model), "half of what the formula says")
X(network_twice, 1, network + network, "twice the network")
"""
FLOWN = """
import json
from ges.errors import GesError
from ges.simulator import flight as sim

def first(mode, *names):
    flight = sim.Flight({"duration_s": 0.1, "mode": mode}, {"ground_effect": {}})
    record = sim.fly([flight])[0]
    return [float(record[name][0]) for name in names]

estimates = {mode: first(mode, "ge_estimate", "ge_shadow") for mode in sim.modes()}
flight = sim.Flight({"duration_s": 2, "mode": "oracle"}, {"ground_effect": {}, "fountain_lift": {}})
oracle = sim.fly([flight])[0]["ge_estimate"]
try:
    sim.fly([sim.Flight({"duration_s": 0.1}, {"ground_effect": {}, "twin": {}})])
    refusal = None
except GesError as error:
    refusal = str(error)
print(json.dumps({"estimates": estimates, "oracle": oracle.tolist(), "refusal": refusal}))
"""


@pytest.fixture(scope="module")
def changed(tmp_path_factory) -> dict:
    """What a copy of the simulator flies that has two more modes, a second thrust gain near the
    ground, and not one promise to fade away from it.
    """
    top = tmp_path_factory.mktemp("tables")
    for folder in ("sim_c", "build"):
        shutil.copytree(ROOT / folder, top / folder, copy_function=shutil.copy2)
    sources = top / "sim_c"
    with (sources / "firmware/modes.def").open("a") as modes:
        modes.write(NEW_MODES)
    twin = (sources / "effects/ground_effect.c").read_text()
    twin = twin.replace("EFFECT(ground_effect)", "EFFECT(twin)")
    (sources / "effects/twin.c").write_text(twin.replace('"ground_effect"', '"twin"'))
    with (sources / "effects/effects.def").open("a") as table:
        table.write("X(twin)\n")
    for path in (sources / "effects").glob("*.c"):
        if "GES_LAW_FADES" in path.read_text():
            path.write_text(path.read_text().replace("GES_LAW_FADES", "0"))
    subprocess.run(["make", "-s", "-j2", "-C", sources, "OPT=-O0"], check=True)
    flown = subprocess.run(
        [sys.executable, "-c", FLOWN],
        env={**os.environ, "GES_LIBRARY": str(top / "build/libges.so")},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(flown.stdout)


def test_a_new_mode_is_one_row(changed):
    estimates = changed["estimates"]
    assert list(estimates) == [*sim.modes(), "halfway", "network_twice"]
    formula, halfway = estimates["analytical"][0], estimates["halfway"][0]
    assert formula > 1.001 and halfway == pytest.approx(0.5 * (1 + formula), abs=1e-6)
    direct, twice = estimates["ml_direct"][0], estimates["network_twice"][0]
    assert twice == pytest.approx(2 * direct, rel=1e-6)
    runs = {mode for mode, (_, shadow) in estimates.items() if shadow == shadow}
    assert runs == {"ml", "ml_direct", "ml_asym_clamp", "network_twice"}


def test_the_ground_effect_factor_does_not_hang_on_a_promise(changed):
    flight = sim.Flight(
        {"duration_s": 2, "mode": "oracle"}, {"ground_effect": {}, "fountain_lift": {}}
    )
    assert changed["oracle"] == sim.fly([flight])[0]["ge_estimate"].tolist()


def test_two_thrust_gains_near_the_ground_are_refused(changed):
    assert "ground_effect and twin are both the thrust gain near the ground" in changed["refusal"]
