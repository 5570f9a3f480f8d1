"""What is told of names that are open."""

from types import SimpleNamespace

import numpy as np
import pytest

from ges.diagnose.report.findings import _alternatives_of, _lever_note, open_findings
from ges.diagnose.select.probability import calibrated_probability
from ges.diagnose.types.finding import FittedParameter
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


@pytest.mark.parametrize(
    ("inclusion", "shares"),
    [
        ({"rotor_drag": 0.7, "wind": 0.25}, [0.7, 0.25]),
        # the best set has both: one of two that are as likely
        ({"rotor_drag": 0.999, "parasitic_drag": 0.999}, [0.5, 0.5]),
    ],
)
def test_of_names_of_which_one_is_needed_no_more_is_stated_than_one(inclusion, shares):
    nothing = SimpleNamespace(columns=(), mean=np.zeros(0), sd=np.zeros(0))
    found = SimpleNamespace(
        inclusion=inclusion, best_with=lambda *_: SimpleNamespace(posterior=nothing)
    )
    told = open_findings(
        SimpleNamespace(result=found, rivals=tuple(inclusion), alternatives={}, regression=None),
        Model({}),
    )
    assert [f.probability for f in told] == pytest.approx(
        [calibrated_probability(p) for p in shares]
    )
    assert all(f.is_open for f in told)


@pytest.mark.parametrize(
    ("values", "nominal", "note"),
    [
        ({"k_kg": 1e-5, "lever": 1.0}, {}, ""),
        ({"k_kg": 1e-5, "lever": 0.02}, {}, "its lever is 0.02"),
        ({"k_kg": 1e-5, "lever": 0.02}, {"k_kg": 1e-6, "lever": 0.02}, ""),
        ({"k_kg": 1e-5, "lever": 1.0}, {"k_kg": 1e-6, "lever": 0.0}, "its lever is 1"),
    ],
)
def test_a_drag_says_where_it_acts_if_that_is_not_where_the_file_has_it(values, nominal, note):
    assert _lever_note(values, "rotor_drag", nominal) == note


def _set(log_evidence, *names):
    return SimpleNamespace(names=names, log_evidence=log_evidence)


def test_nothing_is_weighed_against_a_name_that_a_later_round_accepted():
    """The first search had it beside none of what the later round accepted before."""
    best = _set(50.0, "rotor_drag")
    sets = (best, _set(40.0, "parasitic_drag"), _set(1.0, "wind"))
    accepted = SimpleNamespace(
        names=("rotor_drag", "wind"),
        result=SimpleNamespace(hypotheses=sets, best=best),
        alike={},
    )
    assert _alternatives_of(accepted, "wind") == ()
    assert _alternatives_of(accepted, "rotor_drag") == (
        {"name": "parasitic_drag", "log_odds": -10.0},
    )


@pytest.mark.parametrize(
    ("key", "value", "sd", "interval"),
    [
        ("inertia.zz", 0.5, 0.1, (0.304, 0.696)),
        # no inertia is negative, and no surface rougher than smooth
        ("inertia.zz", 0.5, 2.0, (effect_table.get("inertia").parameter("zz").low, 3.0)),
        ("wind.roughness_m", 0.0, 0.1, (0.0, 0.196)),
    ],
)
def test_an_interval_ends_where_its_number_cannot_go(key, value, sd, interval):
    high = effect_table.get("inertia").parameter("zz").high
    assert high == 3.0
    assert FittedParameter.of(key, value, sd).ci95 == pytest.approx(interval, abs=1e-3)
