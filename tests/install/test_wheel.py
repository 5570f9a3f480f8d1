"""The wheel in an empty environment, outside of the checkout and without a compiler."""

import json
import os
import subprocess
import sys
import zipfile
from importlib import resources
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
UV = Path(sys.executable).with_name("uv")
CORE_MIB = 560


def run(*command, **options) -> subprocess.CompletedProcess:
    done = subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, timeout=300, **options
    )
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    run(UV, "build", "--wheel", "--no-build-isolation", "--out-dir", out, ROOT)
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """Programs of an environment that holds the wheel and what it needs, and nothing else."""
    folder = tmp_path_factory.mktemp("elsewhere")
    asked = [UV, "pip", "compile", "--quiet", "--no-cache", "--no-header", "-"]
    if subprocess.run([str(c) for c in asked], input="click", text=True).returncode != 0:
        pytest.skip("no package index answers, so nothing can be installed")
    run(UV, "venv", "--python", sys.executable, folder / "env")
    python = folder / "env/bin/python"
    run(
        UV, "pip", "install", "--python", python, "--constraints", ROOT / "requirements.lock", wheel
    )
    return python.parent


def outside(programs: Path) -> dict:
    """What a process sees of this machine: its own programs, no compiler, no checkout."""
    kept = {k: v for k, v in os.environ.items() if k in ("HOME", "LANG", "TMPDIR")}
    return {"cwd": programs.parents[1], "env": {**kept, "PATH": str(programs)}}


def test_one_wheel_for_every_python_3(wheel):
    assert wheel.name.split("-")[2:4] == ["py3", "none"]
    files = zipfile.ZipFile(wheel).namelist()
    assert "ges/simulator/libges.so" in files
    assert any(name.endswith("licenses/LICENSE") for name in files)


def test_core_is_small_and_free_of_the_study(installed):
    listed = json.loads(run(UV, "pip", "list", "--format=json", "-p", installed / "python").stdout)
    names = {package["name"] for package in listed}
    assert not names & {"torch", "scikit-learn", "statsmodels", "snakemake", "control", "typst"}
    files = [f for f in installed.parents[1].rglob("*") if f.is_file() and not f.is_symlink()]
    assert sum(f.stat().st_size for f in files) < CORE_MIB * 2**20


@pytest.mark.parametrize(
    "verb", ["simulate", "effects", "import", "calibrate", "diagnose", "bench"]
)
def test_verbs_of_the_core_start(installed, verb):
    run(installed / "ges", verb, "--help", **outside(installed))


def test_what_an_extra_brings_is_named(installed):
    verb = "import ges.cli; ges.cli.cli = lambda **_: __import__('sklearn.svm'); ges.cli.main()"
    done = subprocess.run(
        [installed / "python", "-c", verb], capture_output=True, text=True, **outside(installed)
    )
    assert done.returncode == 1
    named = done.stderr.removeprefix("ges: sklearn is not installed; run ").split()
    assert named[:2] == ["pip", "install"] and {"scikit-learn", "torch"} <= set(named)


def leaves(tree, path: str = "") -> dict:
    """Numbers and words of nested dictionaries and lists by their path, so that a test that fails
    shows those that differ.
    """
    if not isinstance(tree, dict | list):
        return {path: tree}
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
    return {k: v for key, part in pairs for k, v in leaves(part, f"{path}.{key}").items()}


@pytest.mark.slow
def test_wheel_diagnoses_as_the_checkout_does(installed, tmp_path):
    """The set that the package ships: both names, and the bytes of the checkout."""
    options = outside(installed)
    run(installed / "ges", "recordings", "fetch", "example", "--out", "flights", **options)
    run(installed / "ges", "diagnose", "flights/example", "--out", "out", **options)
    found = json.loads((options["cwd"] / "out/diagnosis.json").read_text())
    assert {f["name"] for f in found["findings"]} == {"ground_effect", "rotor_drag"}
    shipped = resources.files("ges.recordings") / "example"
    run(UV.with_name("ges"), "diagnose", shipped, "--out", tmp_path)
    ours = json.loads((tmp_path / "diagnosis.json").read_text())
    ours, found = leaves({**ours, "origin": None}), leaves({**found, "origin": None})
    assert {k: (found.get(k), v) for k, v in ours.items() if found.get(k) != v} == {}
    assert found.keys() == ours.keys()
