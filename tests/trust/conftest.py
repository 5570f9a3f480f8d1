"""A recording set that is diagnosed in seconds, and its diagnosis."""

import sys
from pathlib import Path

import pytest
from command_line import EXAMPLE, contents, run

from ges.recordings.recording import load_set, write_set

SECONDS = 8.0
# logs, a diagnosis and models that the tests of those rooms write
sys.path += [str(Path(__file__).parents[1] / room) for room in ("recordings", "report", "vehicle")]


@pytest.fixture(scope="session")
def small(tmp_path_factory) -> Path:
    """Two of the shipped flights, cut short."""
    whole, folder = load_set(EXAMPLE), tmp_path_factory.mktemp("trust") / "set"
    some = whole.flights[:2]
    write_set(folder, whole.vehicle, [(f.name, f.frame[f.frame["t_s"] < SECONDS]) for f in some])
    return folder


@pytest.fixture(scope="session")
def known(small, tmp_path_factory) -> dict[str, bytes]:
    """Every file of its diagnosis."""
    folder = tmp_path_factory.mktemp("known")
    assert run("diagnose", small, "--out", "out", cwd=folder).returncode == 0
    return contents(folder / "out")
