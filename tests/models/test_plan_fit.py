"""The published plan's numbers are those that the fit found, on seeds that serve nothing else."""

import json
from pathlib import Path

import pytest

from ges.study import config
from ges.study.datasets import plan as fit

ROOT = Path(__file__).resolve().parents[2]
STUDY = config.load(ROOT / "config/default.yaml")
PUBLISHED = STUDY.data.plans["published"]


@pytest.fixture(scope="module")
def report():
    return json.loads((ROOT / "config/plan.json").read_text())


def test_configuration_holds_what_was_fitted(report):
    flat = {**STUDY.simulator.parameters(), **PUBLISHED.model_dump(exclude={"mode"})}
    for name, value in report["fitted"].items():
        assert flat[name] == pytest.approx(value, rel=5e-3), name


def test_only_the_plans_own_seeds_were_used(report):
    assert report["seeds"] == STUDY.seeds.plan.list()


def test_fit_is_inside_its_bounds(report):
    for name, (low, high) in report["bounds"].items():
        value = (
            report["fitted"]["descent_duration_s"] / report["fitted"]["descent_period_s"]
            if name == "descent_share"
            else report["fitted"][name]
        )
        assert low + 0.02 * (high - low) < value < high - 0.02 * (high - low), name


def test_errors_can_be_flown_again(report):
    records = fit.fly_plan(
        STUDY.simulator,
        PUBLISHED,
        report["fitted"],
        report["seeds"],
        STUDY.data.duration_s,
        STUDY.data.rate_hz,
    )
    errors = fit.formula_errors(records, STUDY.simulator.vehicle.parameters(), STUDY.data.rate_hz)
    assert errors == pytest.approx(report["flown"], rel=2e-2)
    assert fit.misfit(errors) == pytest.approx(report["misfit"], rel=0.2, abs=0.5)


def test_a_shallower_plan_fits_worse(report):
    moved = {**report["fitted"], "descent_m": 0.5 * report["fitted"]["descent_m"]}
    here, there = (
        fit.misfit(
            fit.formula_errors(
                fit.fly_plan(
                    STUDY.simulator,
                    PUBLISHED,
                    numbers,
                    report["seeds"][:10],
                    STUDY.data.duration_s,
                    STUDY.data.rate_hz,
                ),
                STUDY.simulator.vehicle.parameters(),
                STUDY.data.rate_hz,
            )
        )
        for numbers in (report["fitted"], moved)
    )
    assert there > 2 * here
