"""The smallest size that shows, and the flight that tells most."""

import dataclasses

import numpy as np
import pytest
from scipy.special import ndtri

from ges.diagnose.advise import recommend
from ges.diagnose.advise.detect import DetectedEffect, expected_evidence, smallest_detectable
from ges.diagnose.advise.next_flight import next_flight
from ges.diagnose.advise.recommend import Option, Rival, as_rivals, open_sets, rank
from ges.diagnose.decide.accept import Accepted
from ges.diagnose.select.evidence import Gram, Posterior, Prior, make_regression, posterior
from ges.diagnose.select.search import Hypothesis, SearchResult
from ges.diagnose.settings import settings

from ..synthetic import amplitude, hovering, rows_of, system_of

ROWS = 300


def _regression(noise=0.1, keys=("axial_inflow.k_kg", "tether.weight_N_m"), alike=0.0, flights=2):
    """Noise along thrust and columns of 1 N per unit; the second as like the first as asked."""
    rng, columns = np.random.default_rng(0), [amplitude(k, low=0.0, high=50.0) for k in keys]
    made = []
    for _ in range(flights):
        x = rng.standard_normal((len(keys), ROWS))
        x[1:] = alike * x[0] + np.sqrt(1.0 - alike**2) * x[1:]
        y = noise * rng.standard_normal((ROWS, 1))
        made.append(rows_of(y, [{0: row} for row in x]))
    return make_regression(system_of(("force_z",), columns, made))


def test_expected_evidence_is_that_of_a_flight_without_noise():
    """gain size^2 - cost: the closed form of the evidence at the residual that the column makes."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((80, 3))
    prior = Prior(np.zeros(3), np.array([0.5, 2.0, 1.0]), np.full(3, -np.inf), np.full(3, np.inf))
    gram = Gram(x.T @ x, np.zeros(3), 0.0, 80.0)
    gain, cost = expected_evidence(gram, (0, 1), prior.sd)
    for true in range(3):
        for size in (0.0, 0.7):
            y = size * x[:, true]
            seen = Gram(x.T @ x, x.T @ y, float(y @ y), 80.0)
            told = posterior(seen, (0, 1), prior).log_evidence
            assert gain[true] * size**2 - cost == pytest.approx(told)


def test_more_flights_show_less_and_more_noise_more():
    sizes = {}
    for name, more in (("usual", {}), ("loud", {"noise": 0.4}), ("many", {"flights": 8})):
        told = smallest_detectable(_regression(**more))["tether"]
        assert told["parameter"] == "weight_N_m" and told["unit"] == "N/m"
        sizes[name] = told["smallest"]
    assert sizes["many"] < sizes["usual"] < sizes["loud"]
    assert sizes["loud"] == pytest.approx(4.0 * sizes["usual"], rel=0.25)


def test_a_rival_that_looks_alike_hides_an_effect_and_is_named():
    alone = smallest_detectable(_regression())["tether"]
    hidden = smallest_detectable(_regression(alike=0.99))["tether"]
    assert alone["limited_by"] == "" and hidden["limited_by"] == "axial_inflow"
    assert hidden["smallest"] > 2.0 * alone["smallest"]


def test_what_was_found_is_seen_and_no_rival_of_others():
    regression = _regression(alike=0.99)
    variant = regression.system.columns[0].variant
    tiny = {"axial_inflow": DetectedEffect(variant, {"k_kg": 1e-6})}
    told = smallest_detectable(regression, tiny)
    assert told["axial_inflow"]["smallest"] == 1e-6
    assert told["tether"]["limited_by"] == "", "beside what is accepted nothing is hidden by it"


def test_no_smaller_size_is_detectable_than_what_matters():
    quiet = smallest_detectable(_regression(noise=1e-6))["tether"]["smallest"]
    regression = _regression(noise=1e-6)
    rms = np.sqrt(np.mean([np.mean(r.x.of(0, [1]) ** 2) for r in regression.system.flights]))
    least = settings.decide.least_thrust_share * regression.system.model.weight_N
    assert quiet == pytest.approx(least / rms)


@pytest.mark.parametrize(
    ("expected", "gain", "flights"),
    [(5.0, 1.0, 1), (0.0, 1.1, 3), (0.0, 0.0, None), (0.0, -1.0, None), (0.0, 0.01, None)],
)
def test_a_flight_is_flown_until_the_odds_of_an_acceptance_are_expected(expected, gain, flights):
    assert settings.statistics.acceptance_log_odds == pytest.approx(np.log(9.0))
    option = Option("hover", ("a", "b"), (), expected, 0.0, gain)
    assert option.flights == flights
    assert option.content()["manoeuvre"] == ("hover" if flights else None)
    assert ndtri(settings.advise.power) > 1.0


def _search(sets, inclusion):
    listed = [Hypothesis(n, (), Posterior.empty(), log, p) for n, (log, p) in sets.items()]
    return SearchResult(tuple(sorted(listed, key=lambda h: -h.log_evidence)), inclusion)


def test_open_are_the_best_set_with_each_name_in_question_and_nothing_where_that_may_be():
    sets = {
        ("wind",): (5.0, 0.5),
        ("tether",): (4.0, 0.3),
        ("tether", "wind"): (1.0, 0.0),
        (): (3.0, 0.2),
        ("cg_offset",): (-9.0, 0.0),
    }
    found = _search(sets, {"wind": 0.5, "tether": 0.3, "cg_offset": 0.0})
    assert [h.names for h in open_sets(found, ())] == [("wind",), ("tether",), ()]
    assert [h.names for h in open_sets(found, ("wind",))] == [("tether",), ("wind",)]
    sure = _search({("wind",): (5.0, 1.0), (): (-9.0, 0.0)}, {"wind": 1.0})
    assert [h.names for h in open_sets(sure, ("wind",))] == [("wind",)]
    assert as_rivals(None, [h for h in open_sets(found, ()) if not h.names]) == [Rival((), {}, ())]


RIVALS = [
    Rival(("axial_inflow",), {"axial_inflow": {"k_kg": 1.0}}, (0,)),
    Rival(("tether",), {"tether": {"weight_N_m": 1.0}}, (1,)),
]


def _flying(monkeypatch, told):
    """Menus whose flights show the rivals' columns with sizes by plan, alike or apart."""

    def simulate(model, rival, plan, logged):
        return None if told[plan] is None else plan

    def grams(regression, flights, plan, keep, rivals):
        x = told[plan] * np.random.default_rng(1).standard_normal((40, 2))
        return [Gram(x.T @ x, x.T @ y, float(y @ y), 40.0) for y in x.T]

    monkeypatch.setattr(recommend, "simulate", simulate)
    monkeypatch.setattr(recommend, "_grams", grams)


def _rank(monkeypatch, told):
    regression = _regression()
    columns = {name: np.zeros(400) for name in ("v_z_m_s",)}
    flights = [
        dataclasses.replace(r, flight=hovering(**columns)) for r in regression.system.flights
    ]
    _flying(monkeypatch, told)
    return rank(regression.without_rows(), flights, RIVALS, plans=tuple(told))


def test_the_manoeuvre_with_the_larger_gain_is_first_and_what_cannot_be_flown_is_none(monkeypatch):
    told = _rank(monkeypatch, {"hover": 0.01, "climbs": 2.0, "multisine": None, "yaw_turn": 0.1})
    assert [o.manoeuvre for o in told] == ["climbs", "yaw_turn", "hover"]
    best, *_, last = told
    assert (
        best.log_odds_per_flight > last.log_odds_per_flight
        and best.expected_log_odds > last.expected_log_odds
    )
    assert set(best.separates) == {"axial_inflow", "tether"} and best.stays_open == ()
    assert best.expected_log_odds <= settings.advise.settled_log_odds
    assert last.log_odds_per_flight == pytest.approx(0.0, abs=0.1)


def test_what_is_settled_is_not_counted_twice(monkeypatch):
    one, other = _rank(monkeypatch, {"hover": 20.0, "climbs": 40.0})
    assert one.expected_log_odds == other.expected_log_odds == settings.advise.settled_log_odds


def test_without_anything_open_no_flight_is_asked_for():
    found = _search({(): (0.0, 1.0)}, {"wind": 0.001, "tether": 0.999})
    assert next_flight(Accepted((), found, None, None, None, {}, ()), None) == {}
