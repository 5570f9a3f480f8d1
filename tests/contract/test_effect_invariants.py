"""The invariants hold for every effect, and the suite catches faults planted into copies of the
sources.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from invariants import CHECKS, FRAMES, flying

from ges.simulator import effects

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
def test_invariant_holds_for_every_effect(check, frame):
    with flying(frame):
        assert [f"{e.name} {what}" for e in effects.table().values() for what in check(e)] == []


FAULTS = {
    "wrong arm": (
        "sim_c/effects/effect.h",
        "s->air[2] + (w[0] * r[1]",
        "s->air[2] + (w[0] * r[0]",
        "axial_inflow",
    ),
    "wrong arm of all": (
        "sim_c/effects/effect.h",
        "moment[0] += r[1] * thrust",
        "moment[0] += r[0] * thrust",
        "ground_effect",
    ),
    "flipped sign": ("sim_c/effects/rotor_drag.c", "vd fx = -p[0]", "vd fx = p[0]", "rotor_drag"),
    "forgotten density": (
        "sim_c/effects/parasitic_drag.c",
        "-0.5 * s->rho * p[0]",
        "-0.5 * p[0]",
        "parasitic_drag",
    ),
    "wrong unit": (
        "sim_c/effects/rotor_drag.c",
        '.name = "k_kg", .unit = "kg"',
        '.name = "k_kg", .unit = "kg/m"',
        "rotor_drag",
    ),
    "density in the induced velocity": (
        "sim_c/effects/effect.h",
        "(s->rho * (2.0",
        "(1.225 * (2.0",
        "translational_lift",
    ),
    "steps too long for a delay": (
        "sim_c/sim/kernel.c",
        "ceil(dt / GES_STATE_STEP_S",
        "ceil(dt / (2.0 * GES_STATE_STEP_S)",
        "esc_delay",
    ),
    "does not switch off": (
        "sim_c/effects/translational_lift.c",
        "+= p[0] *",
        "+= (p[0] + 1e-3) *",
        "translational_lift",
    ),
}


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Sources and objects, with their times, so that a fault rebuilds only what it touches."""
    top = tmp_path_factory.mktemp("faults")
    for folder in ("sim_c", "build"):
        shutil.copytree(ROOT / folder, top / folder, copy_function=shutil.copy2)
    return top


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_planted_fault_is_caught(copy, fault):
    path, right, wrong, named = FAULTS[fault]
    source = copy / path
    good = source.read_text()
    assert good.count(right) >= 1
    source.write_text(good.replace(right, wrong, 1))
    try:
        subprocess.run(["make", "-s", "-j2", "-C", str(copy / "sim_c"), "OPT=-O0"], check=True)
        environment = {**os.environ, "GES_LIBRARY": str(copy / "build" / "libges.so")}
        run = subprocess.run(
            [sys.executable, str(ROOT / "tests/contract/invariants.py")],
            env=environment,
            capture_output=True,
            text=True,
        )
    finally:
        source.write_text(good)
    assert run.returncode == 1
    assert named in run.stdout
