"""``ges.diagnose`` in Python takes what the command line takes, and says what else it cannot."""

import pydoc
from pathlib import Path

import pandas as pd
import pytest

import ges
from ges.diagnose.pipeline import diagnose
from ges.diagnose.prepare.problem import pose_problem
from ges.errors import UsageError
from ges.recordings.recording import load_set
from ges.vehicle.load import load_vehicle

EXAMPLE = Path(ges.__file__).parent / "recordings" / "example"
LOG = EXAMPLE / "runs_fast.parquet"


@pytest.fixture
def asked(monkeypatch):
    """What reaches the pipeline, in place of a diagnosis."""
    calls = []

    def pipeline(recordings, vehicle=None, **options):
        calls.append((recordings, vehicle, options))

    monkeypatch.setattr("ges.diagnose.pipeline.diagnose", pipeline)
    return calls


@pytest.mark.parametrize("folder", [EXAMPLE, str(EXAMPLE)])
def test_the_path_of_a_set_is_read(asked, folder):
    ges.diagnose(folder, holdout="runs_slow")
    ((recordings, vehicle, options),) = asked
    assert len(recordings.flights) == 4 and vehicle is None and options == {"holdout": "runs_slow"}


@pytest.mark.parametrize(
    "vehicle", [EXAMPLE / "vehicle.yaml", load_vehicle(EXAMPLE / "vehicle.yaml")]
)
def test_paths_of_logs_are_read(asked, vehicle):
    ges.diagnose(str(LOG), vehicle)
    ges.diagnose([LOG, EXAMPLE / "runs_slow.parquet"], vehicle)
    cut, whole = ([f.name for f in recordings.flights] for recordings, _, _ in asked)
    assert cut[0] == "runs_fast_part1" and whole == ["runs_fast", "runs_slow"]
    assert asked[0][0].vehicle.name == "example quadrotor"


def test_a_log_is_diagnosed_with_what_was_weighed():
    with pytest.raises(UsageError, match="give --mass KG and --prop SIZE, or --vehicle"):
        ges.diagnose(LOG, mass_kg=1.2)
    with pytest.raises(UsageError, match="propeller 'banana' is no size"):
        ges.diagnose(LOG, mass_kg=1.2, prop="banana")


def test_a_vehicle_may_be_a_name():
    recordings = load_set(EXAMPLE)
    assert pose_problem(recordings, "x500", None, ".").vehicle.name == "x500"
    with pytest.raises(UsageError, match="unknown vehicle 'crazyflie-2.2'; did you mean"):
        diagnose(recordings, "crazyflie-2.2")


def test_one_flight_may_be_held_out_by_its_name():
    problem = pose_problem(load_set(EXAMPLE), None, "runs_slow", ".")
    assert list(problem.held_out) == ["runs_slow"]


@pytest.mark.parametrize(
    "wrong", [123, pd.DataFrame({"t_s": [0.0]}), [1, 2], {"a": None}, ["a", 1]]
)
def test_what_is_no_recording_says_what_is(wrong):
    with pytest.raises(UsageError, match="allowed are a recording set .* and tables in a list"):
        ges.diagnose(wrong)


def test_what_is_no_vehicle_says_what_is():
    with pytest.raises(UsageError, match="the vehicle is of type int; allowed is a Vehicle"):
        diagnose(load_set(EXAMPLE), 123)


def test_help_is_that_of_the_function():
    text = pydoc.render_doc(ges.diagnose, renderer=pydoc.plaintext)
    assert "Find what a simulator lacks, from recorded flights." in text
    assert "holdout : name or names of flights" in text
