"""The simulator's free numbers are those that the calibration found, on seeds that serve nothing
else.
"""

import json

import numpy as np
import pandas as pd
import pytest

from ges.study import config
from ges.study.datasets.ground import ground_of
from ges.study.fly import calibrate, ensemble, profile


@pytest.fixture(scope="module")
def study(root):
    return config.load(root / "config/default.yaml")


@pytest.fixture(scope="module")
def world(study):
    return study.simulator, study.closed_loop, study.closed_loop.pulse


@pytest.fixture(scope="module")
def report(root):
    return json.loads((root / "config/calibration.json").read_text())


def test_configuration_holds_what_was_fitted(study, report):
    flat = {
        **study.simulator.parameters(),
        **study.simulator.ground_effect.parameters(),
        "cruise_m_s": study.closed_loop.cruise_m_s,
    }
    for name, value in report["fitted"].items():
        assert flat[name] == pytest.approx(value, rel=5e-3), name


def test_nothing_but_the_calibration_list_was_used(study, report):
    assert report["seeds"] == study.seeds.calibration.list()


def test_every_number_lies_inside_its_bounds(report):
    for name, (low, high) in report["bounds"].items():
        share = (report["fitted"][name] - low) / (high - low)
        assert 0.05 < share < 0.95, f"{name} stands at {share:.2f} of its bounds"


def _flown(world, numbers, seeds):
    simulator, plan, pulse = world
    arms = calibrate.fly_arms(simulator, plan, pulse, numbers, seeds)
    return calibrate.operating_point(simulator, pulse, arms)


def test_operating_point_can_be_flown_again(world, report):
    flown = _flown(world, report["fitted"], report["seeds"])
    assert flown == pytest.approx(report["flown"], rel=1e-6, abs=1e-9)


def test_misfit_is_worse_away_from_the_fit(world, report):
    moved = {**report["fitted"], "altitude_ki": 0.5}
    here, there = (
        calibrate.misfit(_flown(world, numbers, report["seeds"][:2]))
        for numbers in (report["fitted"], moved)
    )
    assert there > 2 * here


def test_search_finds_numbers_that_fit_better(world, study, tmp_path, monkeypatch):
    monkeypatch.setattr(calibrate, "EVALUATIONS", 3)
    monkeypatch.setattr(
        calibrate,
        "FREE",
        {name: calibrate.FREE[name] for name in ("altitude_ki", "terrain_amplitude_max_m")},
    )
    short = world[1].model_copy(update={"duration_s": 32.0})
    detuned = world[0].model_copy(
        update={"controller": world[0].controller.model_copy(update={"altitude_ki": 1.0})}
    )
    one = study.seeds.calibration.model_copy(update={"count": 1})
    calibrate.calibrate(detuned, short, world[2], one, tmp_path / "found.json")
    found = json.loads((tmp_path / "found.json").read_text())
    start = _flown((detuned, short, world[2]), {}, one.list())
    assert found["misfit"] == pytest.approx(calibrate.misfit(found["flown"]))
    assert found["misfit"] < 0.5 * calibrate.misfit(start)
    assert set(found["fitted"]) == {
        "altitude_ki",
        "terrain_amplitude_max_m",
        "terrain_amplitude_min_m",
    }


def test_laplacian_is_that_of_finite_differences_over_a_rotor(study):
    """Over a rotor's radius the paper's finite differences give the exact Laplacian to a few per
    cent, so that their step changes no verdict.
    """
    ground, step = (
        ground_of(3001, study.simulator.terrain),
        study.simulator.vehicle.rotor_radius_m,
    )
    x, y = np.linspace(100.0, 200.0, 20001), np.zeros(20001)
    here = ground.at(x, y)
    around = sum(
        ground.at(x + dx, y + dy).height_m
        for dx, dy in ((step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))
    )
    differences = (around - 4.0 * here.height_m) / step**2
    slope = np.dot(differences, here.curvature_1_m) / np.dot(here.curvature_1_m, here.curvature_1_m)
    assert np.corrcoef(differences, here.curvature_1_m)[0, 1] > 0.97
    assert slope == pytest.approx(1.0, abs=0.12)


def test_refits_hold_the_gains_of_the_configuration(study, root):
    report = json.loads((root / "config/gain_profile.json").read_text())
    assert report["seeds"] == study.seeds.calibration.list()
    gains = [numbers["curvature_gain_m"] for numbers in report["refitted"]]
    assert gains == study.closed_loop.profile_gains_m


def test_a_refit_makes_up_for_another_gain(world, study, root, tmp_path, monkeypatch):
    """One free number beside the gain: the refit is better than the calibration with the gain
    moved, and what is flown is what was found.
    """
    monkeypatch.setattr(
        calibrate,
        "FREE",
        {n: calibrate.FREE[n] for n in ("terrain_amplitude_max_m", "curvature_gain_m")},
    )
    simulator, plan, pulse = world
    short = plan.model_copy(update={"duration_s": 32.0})
    one = study.seeds.calibration.model_copy(update={"count": 1})
    calibration, found, flown = (
        root / "config/calibration.json",
        tmp_path / "p.json",
        tmp_path / "p.csv",
    )
    profile.fit_profile(simulator, short, pulse, [0.6, 0.1], one, calibration, found)
    profile.fly_profile(simulator, short, pulse, one, calibration, found, flown)
    table = pd.read_csv(flown)
    assert list(table["curvature_gain_m"]) == [0.1, 0.6]
    assert (table["refitted"] < table["held"]).any()
    assert list(table["within"]) == list((table["refitted"] < table["figures"]).astype(int))
    numbers = json.loads(found.read_text())["refitted"][1]
    again = calibrate.misfit(_flown((simulator, short, pulse), numbers, one.list()))
    assert table["refitted"][1] == pytest.approx(again, rel=1e-6)
    assert set(ensemble.CLAIMED_SIGN) < set(table.columns)
