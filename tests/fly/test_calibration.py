"""The simulator's free numbers are those that the calibration found, on seeds that serve nothing
else.
"""

import json

import pytest

from ges.study import config
from ges.study.fly import calibrate


@pytest.fixture(scope="module")
def study(root):
    return config.load(root / "config/default.yaml")


@pytest.fixture(scope="module")
def world(study):
    return study.simulator, study.closed_loop


@pytest.fixture(scope="module")
def report(root):
    return json.loads((root / "config/calibration.json").read_text())


def test_configuration_holds_what_was_fitted(study, report):
    flat = {**study.simulator.parameters(), "cruise_m_s": study.closed_loop.cruise_m_s}
    for name, value in report["fitted"].items():
        assert flat[name] == pytest.approx(value, rel=5e-3), name


def test_nothing_but_the_calibration_list_was_used(study, report):
    assert report["seeds"] == study.seeds.calibration.list()


def test_operating_point_can_be_flown_again(world, report):
    flown = calibrate.operating_point(
        *world, calibrate.fly_arms(*world, report["fitted"], report["seeds"])
    )
    assert flown == pytest.approx(report["flown"], rel=1e-6, abs=1e-9)


def test_misfit_is_worse_away_from_the_fit(world, report):
    moved = {**report["fitted"], "altitude_ki": 0.5}
    arms = [
        calibrate.fly_arms(*world, numbers, report["seeds"][:2])
        for numbers in (report["fitted"], moved)
    ]
    here, there = (calibrate.misfit(calibrate.operating_point(*world, a)) for a in arms)
    assert there > 2 * here


def test_search_writes_what_it_found(world, study, tmp_path, monkeypatch):
    monkeypatch.setattr(calibrate, "GENERATIONS", 1)
    monkeypatch.setattr(
        calibrate,
        "FREE",
        {name: calibrate.FREE[name] for name in ("altitude_ki", "terrain_amplitude_max_m")},
    )
    short = world[1].model_copy(update={"duration_s": 32.0})
    calibrate.calibrate(
        world[0],
        short,
        study.seeds.calibration.model_copy(update={"count": 1}),
        tmp_path / "found.json",
    )
    found = json.loads((tmp_path / "found.json").read_text())
    assert (
        found["misfit"] == pytest.approx(calibrate.misfit(found["flown"]))
        and found["evaluations"] > 10
    )
    assert set(found["fitted"]) == {
        "altitude_ki",
        "terrain_amplitude_max_m",
        "terrain_amplitude_min_m",
    }
