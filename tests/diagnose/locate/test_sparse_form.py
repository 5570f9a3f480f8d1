"""Sparse forms: what a fit of few terms may and may not be changed by."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.conventions import FORCE, LENGTH, NUMBER, SPEED
from ges.diagnose.locate.hypothesis import Factor, Form, sparse_form
from ges.diagnose.settings import settings

ROWS = 600
BLOCK = np.arange(ROWS) // 25


def _terms(count=5, seed=0):
    rng = np.random.default_rng(seed)
    return [Factor(f"t{k}", FORCE, rng.standard_normal(ROWS)) for k in range(count)]


def _noise(seed=9):
    return 0.1 * np.random.default_rng(seed).standard_normal(ROWS)


@given(st.floats(-3.0, 3.0), st.integers(1, 3))
def test_dimensions_add_up_and_powers_multiply(value, n):
    speed = Factor("V", SPEED, np.array([value or 1.0]))
    length = Factor("L", LENGTH, np.array([2.0]))
    assert (speed * length).dimension == (0, 2, -1)
    assert speed.over(length).dimension == (0, 0, -1)
    assert speed.over(speed).dimension == NUMBER and speed.over(speed).values[0] == 1.0
    assert speed.power(n).dimension == (0, n, -n)
    assert speed.power(n).values[0] == pytest.approx((value or 1.0) ** n)


def test_terms_and_coefficients_come_back_with_honest_intervals():
    terms = _terms()
    e = 0.8 * terms[1].values - 0.3 * terms[3].values + 5.0 + _noise()
    form = sparse_form("force_x", e, terms, BLOCK)
    assert form.terms == ("t1", "t3"), "the larger first, and the constant is no term"
    assert form.coefficients == pytest.approx((0.8, -0.3), abs=0.02)
    assert form.sd == pytest.approx((0.1 / np.sqrt(ROWS),) * 2, rel=0.4)
    assert form.r2 == pytest.approx(1.0 - 0.01 / e.var(), abs=0.01)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_form_does_not_know_the_unit_of_its_channel(unit):
    terms = _terms()
    e = 0.8 * terms[1].values + _noise()
    plain, scaled = (sparse_form("force_x", u * e, terms, BLOCK) for u in (1.0, unit))
    assert scaled.terms == plain.terms and scaled.r2 == pytest.approx(plain.r2)
    assert scaled.coefficients[0] == pytest.approx(unit * plain.coefficients[0])


def test_no_more_terms_than_a_reader_reads_and_none_that_gains_nothing():
    terms = _terms(8)
    e = sum(t.values for t in terms) + _noise()
    assert len(sparse_form("force_x", e, terms, BLOCK).terms) == settings.report.terms
    one = sparse_form("force_x", terms[0].values + _noise(), terms, BLOCK)
    assert one.terms == ("t0",)


def test_noise_and_what_only_one_block_shows_have_no_form():
    terms = _terms()
    assert sparse_form("force_x", _noise(), terms, BLOCK) is None
    burst = np.where(BLOCK == 4, 20.0 * terms[2].values, 0.0) + _noise()
    form = sparse_form("force_x", burst, terms, BLOCK)
    assert form is None or form.r2 < 0.3


def test_what_has_another_sign_in_other_blocks_predicts_nothing():
    (term,) = _terms(1)
    turning = np.where(BLOCK % settings.statistics.folds < 2, 1.0, -1.0) * term.values
    assert sparse_form("force_x", turning, [term], BLOCK) is None
    assert sparse_form("force_x", term.values, [term], BLOCK).r2 > 0.99


def test_what_is_absent_takes_no_part():
    terms = _terms()
    e = 0.8 * terms[1].values + _noise()
    e[::3] = np.nan
    form = sparse_form("force_x", e, terms, BLOCK)
    assert form.terms == ("t1",) and form.coefficients[0] == pytest.approx(0.8, abs=0.02)


def test_a_form_is_written_with_its_signs():
    told = Form("force_x", ("a", "b"), (-0.25, 1.5), (0.1, 0.2), 0.7).content()
    assert told["form"] == "force_x = - 0.25 a + 1.5 b" and told["r2"] == 0.7
    assert told["terms"][1] == {"term": "b", "coefficient": 1.5, "sd": 0.2, "unit": "1"}
