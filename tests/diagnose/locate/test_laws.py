"""Laws from residuals: what a fit of few terms may and may not be changed by."""

import numpy as np
import pytest

from ges.diagnose.design.system import build
from ges.diagnose.locate.laws import (
    candidate_places,
    candidate_terms,
    neighbouring_terms,
    rival_law,
    sparse_form,
    term_columns,
)
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.settings import settings
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres
from ges.simulator.laws import CHANNELS, LAW, Term

ROWS, FLIGHTS = 600, 3
BLOCKS = [np.arange(ROWS) // 25 + 100 * f for f in range(FLIGHTS)]
GROUPS = ("V_x/v_h", "V_y/v_h", "V_z/v_h", "R/h", "p/w_g", "q/w_g", "r/w_g", "x/L")


def _terms(count=5, seed=0):
    terms = [Term.of("force_x", "m g", {g: 1}) for g in GROUPS[:count]]
    rng = np.random.default_rng(seed)
    return terms, [rng.standard_normal((ROWS, count)) for _ in range(FLIGHTS)]


def _noise(seed=9):
    rng = np.random.default_rng(seed)
    return [0.1 * rng.standard_normal(ROWS) for _ in range(FLIGHTS)]


def _residual(x, coefficients, noise):
    return [v @ coefficients + n for v, n in zip(x, noise, strict=False)]


def test_the_terms_come_back_and_what_they_predict_of_other_blocks():
    terms, x = _terms()
    e = _residual(x, [0.0, 0.8, 0.0, -0.3, 0.0], _noise())
    form = sparse_form(e, x, terms, BLOCKS)
    assert set(form.terms) == {terms[1], terms[3]}
    assert form.r2 == pytest.approx(1.0 - 0.01 / np.var(e), abs=0.01)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_form_does_not_know_the_unit_of_its_channel(unit):
    terms, x = _terms()
    e = _residual(x, [0.0, 0.8, 0.0, 0.0, 0.0], _noise())
    plain, scaled = (sparse_form([u * v for v in e], x, terms, BLOCKS) for u in (1.0, unit))
    assert scaled.terms == plain.terms and scaled.r2 == pytest.approx(plain.r2)


def test_no_more_terms_than_a_reader_reads_and_none_that_gains_nothing():
    terms, x = _terms(8)
    assert len(sparse_form(_residual(x, np.ones(8), _noise()), x, terms, BLOCKS).terms) == (
        settings.report.terms
    )
    one = sparse_form(_residual(x, np.eye(8)[0], _noise()), x, terms, BLOCKS)
    assert one.terms == (terms[0],)


def _against(e, name, numbers=1):
    terms, x = _terms(8)
    return terms, rival_law("force_x", e, name, x, terms, BLOCKS, numbers, 30)


def test_a_name_of_the_right_form_leads_the_law_of_as_many_numbers():
    _, x = _terms(8)
    acted = [v[:, 0] * v[:, 1] for v in x]
    _, law = _against([a + n for a, n in zip(acted, _noise(), strict=True)], acted)
    assert law.log_odds < -100.0


def test_a_law_leads_a_name_that_only_resembles_what_acted_and_says_what_did():
    _, x = _terms(8)
    e = _residual(x, 0.8 * np.eye(8)[2], _noise())
    terms, law = _against(e, [v[:, 2] ** 3 for v in x])
    assert law.log_odds > 100.0
    assert law.coefficients == {terms[2]: pytest.approx(0.8, abs=0.01)}


def test_of_a_law_that_is_the_name_only_the_price_of_its_search_is_left():
    _, x = _terms(8)
    e = _residual(x, 0.8 * np.eye(8)[2], _noise())
    _, law = _against(e, [0.8 * v[:, 2] for v in x])
    assert law.log_odds == pytest.approx(np.log(30 / 8), abs=0.1)


def test_a_rival_law_has_no_more_numbers_than_the_name():
    _, x = _terms(8)
    e = _residual(x, np.ones(8), _noise())
    for numbers in (1, 3):
        assert len(_against(e, [v[:, 0] for v in x], numbers)[1].coefficients) == numbers


def test_a_term_that_stood_for_two_others_is_exchanged_for_them():
    terms, x = _terms(3)
    # the third is nearly the sum of the others, and alone the best of all
    for v in x:
        v[:, 2] = v[:, 0] + v[:, 1] + 0.3 * np.random.default_rng(5).standard_normal(ROWS)
    form = sparse_form(_residual(x, [1.0, 1.0, 0.0], _noise()), x, terms, BLOCKS)
    assert set(form.terms) == {terms[0], terms[1]}


def test_noise_has_no_form():
    terms, x = _terms(8)
    assert not any(sparse_form(_noise(seed), x, terms, BLOCKS).terms for seed in range(20))


def test_what_has_another_sign_in_other_flights_predicts_nothing():
    terms, x = _terms(1)
    turning = [(-1.0) ** f * v[:, 0] for f, v in enumerate(x[:2])]
    assert not sparse_form(turning, x[:2], terms, BLOCKS[:2]).terms
    assert sparse_form([v[:, 0] for v in x], x, terms, BLOCKS).r2 > 0.99


@pytest.mark.parametrize("flights", [1, FLIGHTS])
def test_what_one_flight_alone_excites_is_seen(flights):
    terms, x = _terms(1)
    still = [v * (1.0 if f == 0 else 1e-3) for f, v in enumerate(x[:flights])]
    e = _residual(still, [0.8], _noise())[:flights]
    assert sparse_form(e, still, terms, BLOCKS[:flights]).terms == tuple(terms)


def test_what_is_absent_takes_no_part():
    terms, x = _terms()
    e = _residual(x, [0.0, 0.8, 0.0, 0.0, 0.0], _noise())
    for v in e:
        v[::3] = np.nan
    assert sparse_form(e, x, terms, BLOCKS).terms == (terms[1],)


@pytest.fixture(scope="module")
def system(sheet, flown, with_rates):
    vehicle = sheet()
    plans = (manoeuvres.straight_runs(20.0), manoeuvres.height_staircase(20.0))
    flights = [flown(vehicle, {}, p, k, with_rates) for k, p in enumerate(plans)]
    model = from_vehicle(vehicle)
    return build(list(pass_gate(flights, model).flights.values()), model, [])


@pytest.mark.parametrize("channel", CHANNELS)
def test_terms_are_those_of_the_channel_that_the_flights_can_speak_about(system, channel):
    terms = candidate_terms(channel, system)
    assert len(terms) > 40 and {t.channel for t in terms} == {channel}
    assert not any("U/U_0" in t.text for t in terms), "no battery was logged"


def test_columns_are_what_the_simulator_flies(system):
    """A term's column is the change of the model's force, as :mod:`ges.diagnose.design` has it."""
    from ges.diagnose.design.residual import residual

    terms = candidate_terms("force_x", system)[::9]
    for k, term in enumerate(terms):
        more = system.model.with_effects({LAW: {term.key: 0.5}})
        for rows, x in zip(system.flights, term_columns(terms, system, system.model), strict=True):
            without, having = (
                residual(rows.flight, rows.windows, m, ("force_x",))[:, 0]
                for m in (system.model, more)
            )
            assert 0.5 * x[:, k] == pytest.approx(without - having, rel=1e-6, abs=1e-9)


def test_places_lie_where_the_flights_went(system):
    """A grid in three widths, each place within a width of where somebody flew."""
    found = candidate_places(system)
    flown = [rows.flight.columns for rows in system.flights]
    path = np.concatenate([np.stack([c["p_x_m"], c["p_y_m"]], axis=1) for c in flown])
    widths = sorted({w for *_, w in found})
    assert len(widths) == 3 and widths[2] == pytest.approx(4.0 * widths[0], rel=0.02)
    assert all(np.hypot(*(path - (x, y)).T).min() < width for x, y, width in found)
    local = Term.of("force_z", "m g", {}, near_m=found[0])
    assert local in candidate_terms("force_z", system)


def test_a_place_is_moved_by_half_a_width_and_halved_or_doubled_over_the_path(system):
    """Not away from it: the slope of a bell that stands elsewhere tells nothing of its height."""
    columns = system.flights[0].flight.columns
    x, y = float(columns["p_x_m"][50]), float(columns["p_y_m"][50])
    over = Term.of("force_z", "m g", {}, near_m=(x, y, 0.4))
    moved = {t.near_m for t in neighbouring_terms(over, system)}
    assert {w for *_, w in moved} == {0.2, 0.4, 0.8} and len(moved) <= 27
    assert any(abs(a - x) > 0.1 or abs(b - y) > 0.1 for a, b, _ in moved)
    away = Term.of("force_z", "m g", {}, near_m=(x + 50.0, y, 0.4))
    assert not neighbouring_terms(away, system)
