"""Mass of Gaussians between bounds, against the distribution functions of scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, norm

from ges.diagnose.select.bounded import log_mass, log_mass_within

NUMBERS = st.floats(-6.0, 6.0)


@given(NUMBERS, st.floats(0.01, 5.0))
def test_mass_between_bounds_is_the_difference_of_distributions(low, width):
    told = float(log_mass(np.array(low), np.array(low + width)))
    assert np.exp(told) == pytest.approx(norm.cdf(low + width) - norm.cdf(low), rel=1e-6, abs=1e-15)


@given(NUMBERS, st.floats(0.01, 5.0))
def test_mass_is_the_same_on_the_other_side(low, width):
    high = low + width
    mirrored = log_mass(np.array(-high), np.array(-low))
    assert float(mirrored) == pytest.approx(float(log_mass(np.array(low), np.array(high))))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_far_in_a_tail_the_mass_is_that_of_the_nearer_bound(sign):
    """Where the difference of the distributions is nothing but rounding."""
    low, high = sorted((sign * 30.0, sign * 40.0))
    assert float(log_mass(np.array(low), np.array(high))) == pytest.approx(norm.logsf(30.0))


def test_without_bounds_all_mass_is_within():
    assert float(log_mass(np.array(-np.inf), np.array(np.inf))) == 0.0


def _within(low, high, mean, covariance):
    sets = (np.atleast_2d(np.asarray(v, dtype=float)) for v in (low, high, mean))
    return float(log_mass_within(*sets, np.asarray(covariance, dtype=float)[None])[0])


def test_coefficients_that_are_not_tied_multiply():
    told = _within([-1.0, 0.5], [2.0, np.inf], [0.3, 0.0], np.diag([4.0, 0.25]))
    alone = [norm.cdf(0.85) - norm.cdf(-0.65), norm.sf(1.0)]
    assert told == pytest.approx(np.log(alone).sum(), abs=1e-9)


@pytest.mark.parametrize("tied", [-0.8, 0.5, 0.9])
def test_two_tied_coefficients_are_as_the_bivariate_normal_has_them(tied):
    covariance = np.array([[1.0, tied], [tied, 1.0]])
    told = _within([-np.inf, -np.inf], [0.4, -0.3], [0.0, 0.0], covariance)
    assert told == pytest.approx(
        np.log(multivariate_normal([0.0, 0.0], covariance).cdf([0.4, -0.3])), abs=0.02
    )


def test_an_unbounded_coefficient_changes_nothing_however_it_is_tied():
    covariance = np.array([[1.0, 0.7], [0.7, 2.0]])
    told = _within([0.5, -np.inf], [2.0, np.inf], [0.2, 3.0], covariance)
    assert told == pytest.approx(float(log_mass(np.array(0.3), np.array(1.8))), abs=1e-9)


@given(st.integers(0, 2**31), st.floats(1e-3, 1e3))
def test_mass_does_not_know_units_or_the_order_of_coefficients(seed, unit):
    rng = np.random.default_rng(seed)
    mixed = rng.standard_normal((3, 5))
    covariance, mean = mixed @ mixed.T / 5.0 + 0.05 * np.eye(3), rng.standard_normal(3)
    low = mean - rng.uniform(0.1, 2.0, 3)
    high = mean + rng.uniform(0.1, 2.0, 3)
    told = _within(low, high, mean, covariance)
    scaled = _within(unit * low, unit * high, unit * mean, unit**2 * covariance)
    assert scaled == pytest.approx(told, abs=1e-6)
    order = [2, 0, 1]
    turned = _within(low[order], high[order], mean[order], covariance[np.ix_(order, order)])
    assert turned == pytest.approx(told, abs=0.05)


@given(st.integers(0, 2**31))
def test_together_there_is_no_more_mass_than_of_each_alone(seed):
    rng = np.random.default_rng(seed)
    mixed = rng.standard_normal((3, 4))
    covariance, mean = mixed @ mixed.T + 0.01 * np.eye(3), 2.0 * rng.standard_normal(3)
    sd = np.sqrt(np.diag(covariance))
    told = _within([-1.0] * 3, [1.0] * 3, mean, covariance)
    assert told <= log_mass((-1.0 - mean) / sd, (1.0 - mean) / sd).min() + 1e-12


def test_nor_where_means_are_so_far_beyond_that_rounding_leaves_little_of_them():
    rng = np.random.default_rng(7)
    mixed = rng.standard_normal((200, 4, 4))
    covariance = mixed @ mixed.transpose(0, 2, 1) + 1e-7 * np.eye(4)
    mean, low, high = 10.0 ** rng.uniform(0, 5, (200, 4)), np.full((200, 4), -1.0), 0.5
    told = log_mass_within(low, np.full((200, 4), high), mean, covariance)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    alone = log_mass((low - mean) / sd, (high - mean) / sd).min(axis=1)
    assert (told <= alone + 1e-9 * np.abs(alone)).all()


def test_sets_are_weighed_each_for_itself():
    rng = np.random.default_rng(0)
    mixed = rng.standard_normal((6, 2, 4))
    covariance = mixed @ mixed.transpose(0, 2, 1)
    mean, low, high = rng.standard_normal((6, 2)), np.full((6, 2), -0.5), np.full((6, 2), 1.0)
    together = log_mass_within(low, high, mean, covariance)
    alone = [_within(*numbers) for numbers in zip(low, high, mean, covariance, strict=True)]
    np.testing.assert_allclose(together, alone)
