"""Sets of names and their priors: what is planted is found, and probabilities are probabilities."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from ges.diagnose.library.candidates import Candidate
from ges.diagnose.select.evidence import Posterior, make_regression
from ges.diagnose.select.probability import calibrated_probability, log_odds, uncalibrated_log_odds
from ges.diagnose.select.search import (
    Hypothesis,
    SearchResult,
    _normalise,
    cause_count,
    evaluate_exactly,
    log_evidence_over_plain,
    log_odds_against_one_of,
    log_rarity,
    search,
)
from ges.diagnose.select.stable import search_until_stable
from ges.diagnose.settings import settings

from ..synthetic import amplitude, rows_of, system_of

KEYS = ("rotor_drag.k_kg", "tether.weight_N_m", "axial_inflow.k_kg", "translational_lift.c")
NAMES = tuple(k.split(".")[0] for k in KEYS)
ROWS = 300


def _regression(planted: dict[str, float], keys=KEYS, seed=0, flights=2):
    """Noise of 0.1 N, with effects planted in newtons rms."""
    rng, columns = np.random.default_rng(seed), [amplitude(k) for k in keys]
    made = []
    for _ in range(flights):
        x = np.abs(rng.standard_normal((len(keys), ROWS)))
        y = 0.1 * rng.standard_normal(ROWS)
        y += sum(size * x[list(keys).index(k)] for k, size in planted.items())
        scale = [1e-4 if "k_kg" in k else 1.0 for k in keys]
        made.append(rows_of(y[:, None], [{0: row / s} for row, s in zip(x, scale, strict=True)]))
    regression = make_regression(system_of(("force_z",), columns, made))
    listed = [Candidate(c.variant.effect, "physics", (c.variant,)) for c in columns]
    return regression, listed


def test_nothing_is_found_in_noise_and_probabilities_add_up():
    regression, listed = _regression({})
    found = search(regression, listed)
    assert found.best.names == () and found.null() is found.best
    assert sum(h.probability for h in found.hypotheses) == pytest.approx(1.0)
    assert max(found.inclusion.values()) < 0.1
    for name, p in found.inclusion.items():
        parts = [h.probability for h in found.hypotheses if name in h.names]
        assert p == pytest.approx(sum(parts))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_is_planted_is_found_and_nothing_else(count):
    planted = dict.fromkeys(KEYS[:count], 0.3)
    regression, listed = _regression(planted)
    found = search(regression, listed)
    assert found.best.names == tuple(sorted(NAMES[:count]))
    assert all(found.inclusion[n] > 0.99 for n in NAMES[:count])
    assert all(found.inclusion[n] < 0.2 for n in NAMES[count:])
    own = dict(zip(found.best.posterior.columns, found.best.posterior.mean, strict=True))
    for k in range(count):
        unit = 1e-4 if "k_kg" in KEYS[k] else 1.0
        assert own[k] == pytest.approx(0.3 * unit, rel=0.1)


def test_every_pair_is_weighed_and_no_set_twice():
    regression, listed = _regression({})
    found = search(regression, listed)
    sets = [h.names for h in found.hypotheses]
    assert len(set(sets)) == len(sets)
    assert sum(len(names) == 2 for names in sets) == 6 and sum(len(n) == 1 for n in sets) == 4
    assert max(map(len, sets)) == len(settings.search.size_probabilities) - 1


def test_no_set_has_two_shapes_of_one_name():
    plain, rng = amplitude("parasitic_drag.area_m2"), np.random.default_rng(0)
    variants = [dataclasses.replace(plain.variant, shape={"vertical_ratio": r}) for r in (1.0, 1.7)]
    columns = [dataclasses.replace(plain, variant=v) for v in variants]
    rows = rows_of(rng.standard_normal((ROWS, 1)), [{0: x} for x in rng.standard_normal((2, ROWS))])
    regression = make_regression(system_of(("force_z",), columns, [rows]))
    found = search(regression, [Candidate("parasitic_drag", "physics", tuple(variants))])
    assert sorted(h.names for h in found.hypotheses) == [(), ("parasitic_drag",)]


def test_prior_of_one_cause_is_shared_among_all_of_them():
    """A column that says nothing gets its prior back: sizes of sets by the settings, names by how
    many there are.
    """
    regression, listed = _regression({}, KEYS[:2], flights=1)
    found = search(regression, listed)
    size = settings.search.size_probabilities
    for h in found.hypotheses:
        count = {0: 1.0, 1: 2.0, 2: 1.0}[len(h.names)]
        assert h.log_prior == pytest.approx(np.log(size[len(h.names)] / count))
        flights = h.posterior.log_evidence if h.posterior else 0.0
        assert h.log_evidence == pytest.approx(h.log_prior + flights)
        assert h.flight_evidence == pytest.approx(flights)
    assert log_odds_against_one_of(2) == pytest.approx(np.log(size[0] / (size[1] / 2.0)))


def test_what_is_rarely_met_takes_more_of_the_flights():
    keys = ("thrust_scale.scale", "tether.weight_N_m")
    regression, listed = _regression({}, keys)
    found = search(regression, listed)
    rare = found.best_with("thrust_scale", ("tether",))
    flights = rare.posterior.log_evidence
    assert rare.log_evidence == pytest.approx(rare.log_prior + np.log(0.1) + flights)
    assert rare.flight_evidence == pytest.approx(flights)
    assert log_rarity(("thrust_scale", "inertia")) == pytest.approx(2.0 * np.log(0.1))
    assert log_rarity(()) == 0.0


def test_what_acts_through_another_of_the_set_is_no_cause_more():
    assert cause_count(("rotor_drag", "tether")) == 2
    assert cause_count(("ground_effect", "ground_effect_lag")) == 1
    assert cause_count(("ground_effect_lag",)) == 1


@pytest.mark.parametrize("base", [(), ("ground_effect",)])
def test_what_needs_a_carrier_is_weighed_beside_one_alone(base):
    keys = ("ground_effect_lag.c", "tether.weight_N_m")
    regression, listed = _regression({}, keys)
    sets = {h.names for h in search(regression, listed, base).hypotheses}
    assert (("ground_effect_lag",) in sets) == bool(base)
    assert ("tether",) in sets


def test_exactly_these_names_and_nothing_else():
    regression, listed = _regression({KEYS[0]: 0.3})
    found = evaluate_exactly(regression, listed[:2])
    assert [h.names for h in found.hypotheses] == [tuple(sorted(NAMES[:2]))]
    assert found.best.probability == 1.0 and found.inclusion[NAMES[1]] == 1.0
    assert evaluate_exactly(regression, []).best.names == ()


def test_a_set_without_modifiers_is_its_own_plain_form():
    regression, listed = _regression({KEYS[0]: 0.3})
    assert log_evidence_over_plain(
        regression, listed, search(regression, listed).best
    ) == pytest.approx(0.0)


def _weighed(evidence):
    ranked = sorted(evidence.items(), key=lambda item: -item[1])
    return SearchResult(tuple(Hypothesis(n, (), Posterior.empty(), v) for n, v in ranked), {})


def test_the_best_with_a_name_has_none_of_the_others_where_it_can():
    found = _weighed({("a", "b"): 5.0, ("a", "c"): 4.0, ("b",): 3.0, (): 0.0})
    assert found.best_with("a").names == ("a", "b")
    assert found.best_with("a", ("a", "b")).names == ("a", "c")
    assert found.best_with("c", ("a",)).names == ("a", "c"), "there is no other"
    assert found.null().names == ()


def test_a_search_that_agrees_with_its_noise_stays():
    regression, listed = _regression({KEYS[0]: 1.0})
    again, found, chosen = search_until_stable(regression, listed, ())
    assert found.best.names == (NAMES[0],) and chosen == (0,)
    assert again.noise.sd[0] == pytest.approx(0.1, rel=0.1)
    assert regression.noise.sd[0] > 3.0 * again.noise.sd[0]
    assert found.inclusion[NAMES[0]] > 0.999
    nothing = _regression({})
    assert search_until_stable(*nothing, ())[2] == ()


@pytest.mark.parametrize("others", [1e-3, 1.0], ids=["one flight alone", "all flights"])
def test_what_moves_flights_slowly_is_no_noise(others):
    """To the first noise it is all that is left, and coloured as it is: from there nothing is
    found. The search starts once more from the noise without it.
    """
    rng, signals = np.random.default_rng(0), []
    for f in range(3):
        x = gaussian_filter1d(rng.standard_normal((2, ROWS)), 20.0, axis=1)
        x /= x.std(axis=1, keepdims=True)
        x[1] *= others if f else 1.0
        signals.append((0.1 * rng.standard_normal(ROWS) + 20.0 * x[1], x))
    regression, listed = _slow(signals)
    assert search(regression, listed).best.names == ()
    _, found, chosen = search_until_stable(regression, listed, ())
    assert chosen == (1,) and found.best.names == ("tether",)


def test_a_drift_that_an_effect_happens_to_follow_stays_noise():
    """Without most of it the noise is as slow as before, and finds nothing."""
    rng, signals = np.random.default_rng(0), []
    for _ in range(3):
        walk = np.cumsum(rng.standard_normal(ROWS))
        x = gaussian_filter1d(rng.standard_normal((2, ROWS)), 20.0, axis=1)
        x /= x.std(axis=1, keepdims=True)
        x[1] = gaussian_filter1d(walk - walk.mean(), 20.0) / walk.std() + 0.6 * x[1]
        signals.append((walk, x))
    regression, listed = _slow(signals)
    share = [np.corrcoef(y, x[1])[0, 1] ** 2 for y, x in signals]
    assert min(share) > 0.5
    assert search_until_stable(regression, listed, ())[2] == ()


def _slow(signals):
    """Regression of residuals and two columns (2, m) by flight, and its candidates."""
    rows = [rows_of(y[:, None], [{0: row} for row in x]) for y, x in signals]
    wide = {"low": -1e9, "high": 1e9}
    columns = [amplitude(key, **wide) for key in ("rotor_drag.k_kg", "tether.weight_N_m")]
    regression = make_regression(system_of(("force_z",), columns, rows))
    return regression, [Candidate(c.variant.effect, "physics", (c.variant,)) for c in columns]


def test_what_one_of_a_family_does_is_no_noise_though_none_is_told():
    """Columns of two drags and of an inflow are all but one."""
    rng = np.random.default_rng(0)
    x, idle = np.abs(rng.standard_normal((2, ROWS)))
    alike = [x * (1.0 + 1e-3 * rng.standard_normal(ROWS)) for _ in range(2)]
    y = (0.1 * rng.standard_normal(ROWS) + 0.15 * x)[:, None]
    keys = ("rotor_drag.k_kg", "parasitic_drag.area_m2", "axial_inflow.k_kg", "tether.weight_N_m")
    rows = [1e4 * x, alike[0], 1e4 * alike[1], idle]
    columns = [amplitude(key) for key in keys]
    regression = make_regression(
        system_of(("force_z",), columns, [rows_of(y, [{0: r} for r in rows])])
    )
    listed = [Candidate(c.variant.effect, "physics", (c.variant,)) for c in columns]
    settled, found, chosen = search_until_stable(regression, listed, ())
    assert max(found.inclusion.values()) < 0.5 and found.null().probability < 1e-3
    assert len(chosen) == 1 and settled.noise.sd[0] == pytest.approx(0.1, rel=0.1)


def test_asked_for_names_are_fitted_whether_they_are_there_or_not():
    regression, listed = _regression({})
    _, found, chosen = search_until_stable(regression, listed[:1], (), only=NAMES[:1])
    assert found.best.names == NAMES[:1] and chosen == (0,)


@given(st.floats(1e-3, 0.999), st.floats(1e-3, 0.999))
def test_told_probabilities_keep_their_order_and_say_less_than_the_search(a, b):
    low, high = sorted((a, b))
    assert calibrated_probability(low) <= calibrated_probability(high)
    away = abs(log_odds(calibrated_probability(high)) - settings.search.log_odds_offset)
    assert away <= abs(log_odds(high)) + 1e-9
    assert uncalibrated_log_odds(calibrated_probability(a)) == pytest.approx(log_odds(a), abs=1e-9)


@pytest.mark.parametrize("p", [0.0, 1.0, 1.5, -0.1])
def test_certainty_has_an_end(p):
    most = settings.statistics.certain_log_odds
    assert abs(log_odds(p)) == pytest.approx(most) and 0.0 < calibrated_probability(p) < 1.0


def test_probabilities_sum_to_one_however_large_evidences_are():
    """Rounding of thousands of nats was a chance of 1e-12 on one processor and none on another."""
    evidences = 9876.54321 - np.random.default_rng(0).exponential(3.0, 200)
    hypotheses = [
        Hypothesis((f"effect_{i}",), (), Posterior.empty(), e) for i, e in enumerate(evidences)
    ]
    result = _normalise(hypotheses)
    assert abs(sum(h.probability for h in result.hypotheses) - 1.0) < 1e-15
