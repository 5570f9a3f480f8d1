"""Windows: what they average, what they differentiate, and which samples they see."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.diagnose.design.weak import (
    all_allowed,
    blocks_of,
    bump,
    higher_order_functions,
    make_windows,
)

HALVES = st.integers(min_value=2, max_value=40)
STEPS_S = st.floats(min_value=1e-3, max_value=0.05)


@given(HALVES, STEPS_S, st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_averages_and_rates_of_ramps_are_exact_whatever_the_step(half, step_s, level, slope):
    t_s = step_s * np.arange(-half, half + 1)
    mean, rate = bump(half, step_s)
    ramp = level + slope * t_s
    assert mean @ ramp == pytest.approx(level, abs=1e-9)
    assert rate @ ramp == pytest.approx(slope, abs=1e-9)


@given(HALVES, STEPS_S)
def test_an_average_does_not_know_the_direction_of_time_and_a_rate_turns_with_it(half, step_s):
    mean, rate = bump(half, step_s)
    np.testing.assert_allclose(mean, mean[::-1])
    np.testing.assert_allclose(rate, -rate[::-1], atol=1e-12)
    assert (mean > 0.0).all()


@given(HALVES, st.integers(min_value=1, max_value=3))
def test_faster_test_functions_see_white_noise_as_the_average_does_and_each_its_own(half, count):
    """Orthogonal to each other and to the bump, all as long as it."""
    functions = [
        bump(half, 0.01)[0],
        *(weights for weights, _ in higher_order_functions(half, 0.01, count)),
    ]
    if len(functions) > half:
        return
    gram = np.array([[a @ b for b in functions] for a in functions])
    np.testing.assert_allclose(gram, gram[0, 0] * np.eye(len(functions)), atol=1e-9 * gram[0, 0])


@pytest.mark.parametrize("number", range(4))
def test_rate_weights_of_a_faster_function_are_those_of_the_derivative(number):
    """integral(phi x') = -integral(phi' x): what the rate weights make of a signal, the weights
    make of its derivative.
    """
    half, step_s = 60, 1e-3
    t_s = step_s * np.arange(-half, half + 1)
    weights, rates = higher_order_functions(half, step_s, 2)[number]
    for signal, derivative in (
        (np.sin(30.0 * t_s + 0.4), 30.0 * np.cos(30.0 * t_s + 0.4)),
        (np.exp(9.0 * t_s), 9.0 * np.exp(9.0 * t_s)),
    ):
        size = np.linalg.norm(weights) * np.linalg.norm(derivative)
        assert rates @ signal == pytest.approx(weights @ derivative, abs=1e-3 * size)


def test_the_rate_of_an_average_is_the_average_of_the_rate():
    t_s = 0.01 * np.arange(500)
    windows = make_windows(t_s, np.ones(500, bool), 0.2)
    signal = np.sin(2.0 * t_s)
    rate, mean = windows.rate @ signal, windows.mean @ (2.0 * np.cos(2.0 * t_s))
    np.testing.assert_allclose(rate, mean, atol=2e-3)


@given(st.sets(st.integers(0, 59), max_size=4), st.integers(2, 6))
def test_no_window_touches_a_sample_that_is_not_allowed_and_none_is_left_out(bad, half):
    flying, step_s = ~np.isin(np.arange(60), list(bad)), 0.01
    t_s = step_s * np.arange(len(flying))
    windows = make_windows(t_s, flying, 2.0 * half * step_s)
    every = range(half, len(flying) - half, half)
    expected = [c for c in every if flying[c - half : c + half + 1].all()]
    assert windows.center.tolist() == expected
    everywhere = make_windows(t_s, np.ones(len(t_s), bool), 2.0 * half * step_s)
    assert everywhere.center[everywhere.within(flying)].tolist() == expected


def test_windows_overlap_by_half_and_none_is_shorter_than_five_samples():
    windows = make_windows(0.01 * np.arange(100), np.ones(100, bool), 0.2)
    assert np.unique(np.diff(windows.center)).tolist() == [10]
    assert windows.half == 10 and windows.length_s == pytest.approx(0.21)
    assert make_windows(0.05 * np.arange(40), np.ones(40, bool), 0.05).half == 2


def test_some_windows_are_those_rows_of_all_their_weights():
    windows = make_windows(0.01 * np.arange(100), np.ones(100, bool), 0.2, 1)
    which = np.arange(len(windows)) % 2 == 0
    few, signal = windows.select(which), np.random.default_rng(0).normal(size=100)
    assert windows.select(np.ones(len(windows), bool)) is windows
    assert set(few.functions) == {"", "/1", "/2"}
    for mark, (mean, rate) in few.functions.items():
        np.testing.assert_array_equal(mean @ signal, (windows.functions[mark][0] @ signal)[which])
        np.testing.assert_array_equal(rate @ signal, (windows.functions[mark][1] @ signal)[which])
    np.testing.assert_array_equal(few.center_s, windows.center_s[which])


def test_a_range_of_samples_counts_where_all_of_them_do():
    allowed = np.array([True, True, False, True, True])
    first, past = np.array([0, 1, 3, 0]), np.array([2, 3, 5, 0])
    assert all_allowed(allowed, first, past).tolist() == [True, False, True, True]


@pytest.mark.parametrize("start_s", [0.0, 1234.5])
def test_blocks_of_time_are_shared_by_no_two_flights_whatever_their_clocks(start_s):
    t_s = start_s + 0.01 * np.arange(1000)
    windows = make_windows(t_s, np.ones(1000, bool), 0.2)
    one, two = blocks_of([(windows, t_s[0])] * 2, 2.5)
    assert one.tolist() == ((windows.center_s - start_s) // 2.5).astype(int).tolist()
    assert set(one) == {0, 1, 2, 3} and set(two) == {4, 5, 6, 7}
