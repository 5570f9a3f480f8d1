"""The sparse form of what no effect explains: dimensions hold, a planted form comes back, noise
gives none.
"""

import numpy as np
import pytest

from ges.conventions import FORCE, MOMENT, SPEED
from ges.diagnose.design.system import build
from ges.diagnose.locate.hypothesis import Factor, library, sparse_form
from ges.diagnose.locate.regimes import regimes_of
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres


@pytest.fixture(scope="module")
def flights(sheet, flown, with_rates):
    """System and regimes of two flights, and the block of time of every window."""
    vehicle = sheet()
    plans = (manoeuvres.straight_runs(20.0), manoeuvres.height_staircase(20.0))
    prepared = pass_gate(
        [flown(vehicle, {}, p, k, with_rates) for k, p in enumerate(plans)], from_vehicle(vehicle)
    ).flights
    system = build(prepared, from_vehicle(vehicle), [])
    return system, regimes_of(system), np.concatenate(system.blocks(2.5))


def test_dimensions_of_products_and_ratios():
    force, speed = Factor("F", FORCE, np.ones(3)), Factor("V", SPEED, np.full(3, -2.0))
    assert (force * speed.over(speed)).dimension == FORCE
    assert (force * speed).dimension == (1, 2, -3)
    assert speed.squared().dimension == (0, 2, -2) and speed.squared().values == pytest.approx(
        np.full(3, -4.0)
    )
    assert speed.power(2).values == pytest.approx(np.full(3, 4.0))


def test_forces_have_no_arm_and_moments_have_one(flights):
    system, told, _ = flights
    forces, moments = library(system, told, FORCE), library(system, told, MOMENT)
    assert len(forces) > 20 and all(t.dimension == FORCE and " L " not in t.text for t in forces)
    assert len(moments) > 20 and all(t.dimension == MOMENT and " L " in t.text for t in moments)


def test_a_planted_form_comes_back_with_its_coefficients(flights):
    system, told, block = flights
    terms = {t.text: t for t in library(system, told, FORCE)}
    rng = np.random.default_rng(0)
    drag, cushion = terms["m g (V_x/v_h)|V_x/v_h|"], terms["T (R/h)^2"]
    noise = rng.normal(0.0, 0.1 * np.std(drag.values), len(block))
    form = sparse_form(
        "force_x",
        -0.05 * drag.values + 0.04 * cushion.values + 0.05 * noise + 0.3,
        list(terms.values()),
        block,
    )
    found = dict(zip(form.terms, form.coefficients, strict=True))
    assert found[drag.text] == pytest.approx(-0.05, rel=0.1) and form.r2 > 0.8
    assert all(abs(c) > 2.0 * s for c, s in zip(form.coefficients, form.sd, strict=True))
    told = form.content()
    assert told["form"].startswith("force_x = ") and "m g (V_x/v_h)|V_x/v_h|" in told["form"]
    assert {t["unit"] for t in told["terms"]} == {"1"}


def test_noise_has_no_form(flights):
    system, told, block = flights
    terms = library(system, told, MOMENT)
    draws = [np.random.default_rng(k).normal(size=len(block)) for k in range(10)]
    assert sum(sparse_form("moment_x", e, terms, block) is not None for e in draws) == 0
