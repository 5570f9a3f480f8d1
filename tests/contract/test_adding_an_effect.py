"""docs/adding-an-effect.md to the letter: a new effect is compiled, concealed and found."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ges.errors import GesError
from ges.simulator import _lib, effects
from ges.simulator.effects import _effect

ROOT = Path(__file__).resolve().parents[2]
FIND = """
import sys
sys.path.insert(0, {tests!r})
from diagnose.conftest import fly, parse_vehicle, SHEET, manoeuvres
import ges
vehicle = parse_vehicle(SHEET)
extra = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
plans = ("straight_runs", "multisine", "straight_runs", "climbs")
frames = [
    fly(vehicle, {{"flapping_moment": {{"c_s": 2e-3}}}}, manoeuvres.make(p, 20.0), k, extra)
    for k, p in enumerate(plans, 1)
]
found = ges.diagnose(frames, vehicle, holdout=["flight3"])
print(found.verdict, *[f.name for f in found.findings], found.sentence)
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Sources with the page's file and line added, built; the checkout is left alone."""
    top = tmp_path_factory.mktemp("added")
    for folder in ("sim_c", "build"):
        shutil.copytree(ROOT / folder, top / folder, copy_function=shutil.copy2)
    page = (ROOT / "docs" / "adding-an-effect.md").read_text()
    source, line = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    (path,) = re.findall(r"Write `(.*?)`", page)
    (top / path).write_text(source)
    with (top / "sim_c" / "effects" / "effects.def").open("a") as listed:
        listed.write(line)
    subprocess.run(["make", "-s", "-j2", "-C", str(top / "sim_c")], check=True)
    return top / "build" / "libges.so"


def _python(library: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, "GES_LIBRARY": str(library)},
        capture_output=True,
        text=True,
    )


@pytest.mark.slow
def test_the_new_effect_keeps_its_invariants(copy):
    done = _python(copy, str(ROOT / "tests/contract/invariants.py"))
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_the_new_effect_is_found_where_it_is_concealed(copy):
    done = _python(copy, "-c", FIND.format(tests=str(ROOT / "tests")))
    assert done.stdout.startswith("physics flapping_moment "), done.stdout + done.stderr


@pytest.mark.parametrize("field", ["kind", "about", "feedback"])
def test_an_effect_that_leaves_out_what_all_have_to_say_does_not_load(field):
    given = _lib.effect_descriptors()[effects.get("rotor_drag").number]
    with pytest.raises(GesError, match=f"effect rotor_drag declares no '{field}'"):
        _effect(0, given | {field: ""})


def test_a_parameter_that_leaves_out_its_role_does_not_load():
    given = _lib.effect_descriptors()[effects.get("rotor_drag").number]
    without = tuple(p | {"role": ""} for p in given["parameters"])
    with pytest.raises(GesError, match="parameter k_kg of effect rotor_drag declares no 'role'"):
        _effect(0, given | {"parameters": without})
