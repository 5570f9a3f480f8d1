"""Structure in residuals: functions of a regime, their statistic, and what may not change it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.diagnose.locate.structure import (
    Structure,
    hat_functions,
    pool_variables,
    structures,
    varied_regimes,
    without_mean,
)
from ges.diagnose.settings import settings

WINDOWS, BLOCK = 200, 25
TIME_S = 0.1 * np.arange(WINDOWS)


def _flights(count=3, seed=0):
    rng = np.random.default_rng(seed)
    return [
        {
            "forward_m_s": 2.0 * np.sin(0.8 * TIME_S + rng.uniform(0, 6)),
            "left_m_s": 2.0 * np.sin(0.5 * TIME_S + rng.uniform(0, 6)),
        }
        for _ in range(count)
    ]


def _blocks(count=3):
    return [np.arange(WINDOWS) // BLOCK + 100 * f for f in range(count)]


def _noise(count=3, channels=1, seed=1, size=0.1):
    rng = np.random.default_rng(seed)
    return [size * rng.standard_normal((WINDOWS, channels)) for _ in range(count)]


def _found(residuals, told, names=("force_x",)):
    resolved = [np.zeros_like(r) for r in residuals]
    found = structures(residuals, told, names, _blocks(len(residuals)), resolved)
    return {(s.channel, s.regime, s.of_size): s for s in found}


@given(st.floats(-5.0, 5.0))
def test_hats_add_up_to_one_and_reproduce_straight_lines(value):
    knots, value = np.linspace(-5.0, 5.0, 7), np.array([value, -value])
    x = hat_functions(value, knots)
    np.testing.assert_allclose(x.sum(axis=1), 1.0)
    np.testing.assert_allclose(x @ knots, value, atol=1e-12)
    np.testing.assert_allclose(hat_functions(knots, knots), np.eye(7))
    np.testing.assert_allclose(hat_functions(np.array([9.0]), knots)[0], np.eye(7)[-1])


def test_a_function_of_a_regime_is_predicted_and_its_peak_and_size_are_told():
    told, noise = _flights(), _noise()
    residuals = [
        e + 0.5 * np.maximum(t["forward_m_s"], 0.0)[:, None]
        for e, t in zip(noise, told, strict=True)
    ]
    found = _found(residuals, told)
    mean = found["force_x", ("forward_m_s",), False]
    assert mean.q_value == pytest.approx(1.0 / (1.0 + settings.statistics.resamples))
    signal = np.concatenate([without_mean(r) for r in residuals])
    assert mean.r2 == pytest.approx(1.0 - 0.01 / signal.var(), abs=0.05)
    assert mean.rms == pytest.approx(np.sqrt(signal.var() - 0.01), rel=0.05)
    assert mean.bounds["forward_m_s"][1] == pytest.approx(2.0, abs=0.05), "at the fastest"
    assert found["force_x", ("left_m_s",), False].q_value > 0.05


@pytest.mark.parametrize("unit", [1e-3, 1e4])
def test_a_statistic_does_not_know_the_unit_of_its_channel(unit):
    told, residuals = _flights(), _noise()
    residuals = [e + 0.05 * t["left_m_s"][:, None] for e, t in zip(residuals, told, strict=True)]
    plain, scaled = _found(residuals, told), _found([unit * e for e in residuals], told)
    for key, s in plain.items():
        assert scaled[key].r2 == pytest.approx(s.r2, abs=1e-9)
        assert scaled[key].q_value == s.q_value
        assert scaled[key].rms == pytest.approx(unit * s.rms)


def test_a_push_near_the_ground_shows_in_flights_that_are_mostly_high():
    """Between knots of equal steps it rises, falls and is over before the second of them."""
    rng, heights = np.random.default_rng(3), []
    for _ in range(3):
        low = 2.0 + 1.5 * np.sin(1.3 * TIME_S + rng.uniform(0, 6))
        heights.append(np.where(TIME_S % 5.0 < 2.0, low, 20.0 + 5.0 * np.sin(0.7 * TIME_S)))
    residuals = [
        e + 0.5 * np.exp(-(((h - 2.0) / 0.5) ** 2))[:, None]
        for e, h in zip(_noise(), heights, strict=True)
    ]
    found = _found(residuals, [{"height_over_radius": h} for h in heights])
    mean = found["force_x", ("height_over_radius",), False]
    assert mean.q_value <= settings.statistics.chance and mean.r2 > 0.4
    (low, high) = mean.bounds["height_over_radius"]
    assert 0.5 < low < 2.0 < high < 4.0


def test_noise_has_no_structure_as_often_as_is_said():
    """Of six draws none is below a fiftieth, and their chances are not all alike."""
    told = _flights()
    least = [
        min(s.q_value for s in _found(_noise(seed=10 + k), told).values() if not s.of_size)
        for k in range(6)
    ]
    assert min(least) > 0.02 and max(least) > 0.3


def test_channels_that_one_cause_moves_are_judged_together():
    """Neither of two is clear alone; both are."""
    told = _flights(2, seed=3)
    names = ("force_x", "acc_x")
    push = [0.028 * t["forward_m_s"][:, None] * np.ones((1, 2)) for t in told]
    residuals = [e + p for e, p in zip(_noise(2, 2, seed=5), push, strict=True)]
    together = _found(residuals, told, names)
    apart = [_found([r[:, [c]] for r in residuals], told, (n,)) for c, n in enumerate(names)]
    for c, name in enumerate(names):
        key = (name, ("forward_m_s",), False)
        assert together[key].q_value <= apart[c][key].q_value + 0.01


def test_a_size_that_follows_a_regime_is_no_mean():
    told = _flights()
    residuals = [
        e * np.where(t["forward_m_s"] > 0.5, 4.0, 1.0)[:, None]
        for e, t in zip(_noise(), told, strict=True)
    ]
    found = _found(residuals, told)
    size = found["force_x", ("forward_m_s",), True]
    assert size.q_value < 0.01 and found["force_x", ("forward_m_s",), False].q_value > 0.02
    fast = size.bounds["forward_m_s"][0] > 0.0
    assert size.rms == pytest.approx(0.4 if fast else 0.1, rel=0.15)
    assert size.key == "force_x_size"


def test_what_is_absent_counts_nowhere():
    told, residuals = _flights(), _noise(channels=2)
    residuals = [e + 0.3 * t["forward_m_s"][:, None] for e, t in zip(residuals, told, strict=True)]
    for e in residuals:
        e[:, 1] = np.nan
    found = _found(residuals, told, ("force_x", "range"))
    assert {key[0] for key in found} == {"force_x"}


def test_too_few_windows_tell_nothing():
    told = [{name: v[:20] for name, v in t.items()} for t in _flights(1)]
    few, blocks = [_noise(1)[0][:20]], [np.arange(20) // 5]
    assert structures(few, told, ("force_x",), blocks, [np.zeros_like(few[0])]) == []


def test_flights_less_their_mean_keep_their_holes():
    e = np.array([[1.0, np.nan], [3.0, 5.0]])
    np.testing.assert_array_equal(without_mean(e), [[-1.0, np.nan], [1.0, 0.0]])
    assert np.isnan(without_mean(np.full((2, 1), np.nan))).all()


def test_regimes_are_shared_that_every_flight_has():
    pooled = pool_variables([{"a": np.ones(2), "b": np.ones(2)}, {"b": np.zeros(1)}])
    assert list(pooled) == ["b"] and pooled["b"].tolist() == [1.0, 1.0, 0.0]


@pytest.mark.parametrize(("spread", "counts"), [(0.4, False), (0.7, True)])
def test_a_place_counts_where_it_was_flown_over_half_a_metre(spread, counts):
    values = np.linspace(0.0, spread, 500)
    assert (varied_regimes({"east_m": values}) == ["east_m"]) == counts
    assert varied_regimes({"battery_V": 1e-3 * values}) == ["battery_V"]


def test_one_outlier_is_no_range():
    values = np.zeros(500)
    values[7] = 30.0
    assert varied_regimes({"climb_m_s": values}) == []


def test_a_structure_writes_its_bounds_by_variable():
    s = Structure("force_z", ("east_m", "north_m"), (0.0, 1.0), (2.0, 3.0), 0.3, 0.01, 0.1)
    assert s.bounds == {"east_m": [0.0, 2.0], "north_m": [1.0, 3.0]} and s.key == "force_z"
