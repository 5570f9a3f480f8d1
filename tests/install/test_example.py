"""The recording set that the package ships is what its script simulates."""

import runpy
from importlib import metadata, resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ges
from ges.recordings.recording import load_set

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(str(resources.files("ges.recordings") / "example"))


@pytest.fixture(scope="module")
def simulated() -> dict[str, pd.DataFrame]:
    return runpy.run_path(str(ROOT / "examples/make_example.py"))["fly"]()


def test_shipped_flights_are_those_that_the_script_simulates(simulated):
    shipped = {flight.name: flight.frame for flight in load_set(FOLDER).flights}
    assert set(shipped) == set(simulated)
    for name, frame in simulated.items():
        assert list(frame) == list(shipped[name])
        assert np.array_equal(frame, shipped[name], equal_nan=True)


def test_shipped_set_is_small_and_says_that_it_is_simulated():
    assert sum(file.stat().st_size for file in FOLDER.iterdir()) < 260_000
    assert "no real vehicle flew" in (FOLDER / "README.md").read_text()


def test_one_version():
    assert metadata.version("ges") == ges.__version__
