"""Normal equations, nuisances integrated out of them, and priors of coefficients."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, norm

from ges.diagnose.design.whiten import White
from ges.diagnose.select.evidence import (
    Gram,
    Posterior,
    Prior,
    contribution_of,
    flight_grams,
    gram_of,
    make_regression,
    posterior,
    posteriors,
    rms_of,
    whiten_system,
)
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table

from ..synthetic import MODEL, amplitude, nuisance, rows_of, system_of, white_part

SEEDS = st.integers(0, 2**31)
ROWS = 50


def _drawn(seed, columns=3):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((ROWS, columns)), rng.standard_normal(ROWS)


def _gram(x, y):
    return Gram(x.T @ x, x.T @ y, float(y @ y), float(len(y)))


def _free(count, mean=0.0, sd=1.0):
    return Prior(
        np.full(count, mean), np.full(count, sd), np.full(count, -np.inf), np.full(count, np.inf)
    )


def _same(a: Gram, b: Gram):
    for field in dataclasses.fields(Gram):
        np.testing.assert_allclose(getattr(a, field.name), getattr(b, field.name), atol=1e-8)


@given(SEEDS)
def test_rows_counted_apart_and_together_are_the_same(seed):
    x, y = _drawn(seed)
    first, second = _gram(x[:20], y[:20]), _gram(x[20:], y[20:])
    _same(first + second, _gram(x, y))
    _same(first + second - second, first)
    _same(_gram(x, y).scale(2.0), _gram(np.vstack([x, x]), np.r_[y, y]))


@given(SEEDS)
def test_coefficients_counted_from_a_mean_move_the_residual(seed):
    x, y = _drawn(seed)
    at, mean = np.array([0, 2]), np.array([0.4, -1.3])
    _same(_gram(x, y).about(at, mean), _gram(x, y - x[:, at] @ mean))


@given(SEEDS)
def test_the_order_in_which_nuisances_are_integrated_out_does_not_matter(seed):
    x, y = _drawn(seed)
    sd = np.array([0.5, 2.0])
    both = _gram(x, y).without(np.array([0, 1]), sd)
    one = _gram(x, y).without(np.array([1]), sd[1:]).without(np.array([0]), sd[:1])
    kept = np.array([2])
    _same(both.take(kept), one.take(kept))
    assert _gram(x, y).without(np.array([], dtype=int), np.zeros(0)).yy == pytest.approx(y @ y)


@given(SEEDS)
def test_what_is_integrated_out_is_noise_of_its_covariance(seed):
    """The normal equations are those of generalised least squares under I + x S x'."""
    x, y = _drawn(seed)
    inverse = np.linalg.inv(np.eye(ROWS) + 0.49 * np.outer(x[:, 0], x[:, 0]))
    left = _gram(x, y).without(np.array([0]), np.array([0.7])).take(np.array([1, 2]))
    rest = x[:, 1:]
    _same(left, Gram(rest.T @ inverse @ rest, rest.T @ inverse @ y, y @ inverse @ y, ROWS))


@given(SEEDS, st.floats(0.05, 3.0))
def test_evidence_is_the_marginal_likelihood_of_a_linear_gaussian_model(seed, sd):
    x, y = _drawn(seed, 2)
    prior = _free(2, mean=0.3, sd=sd)
    found = posterior(_gram(x, y), (0, 1), prior)
    marginal = multivariate_normal(x @ prior.mean, np.eye(ROWS) + sd**2 * x @ x.T)
    assert found.log_evidence == pytest.approx(
        marginal.logpdf(y) - norm.logpdf(y).sum(), rel=1e-6, abs=1e-6
    )
    inverse = np.linalg.inv(x.T @ x + np.eye(2) / sd**2)
    np.testing.assert_allclose(found.covariance, inverse)
    np.testing.assert_allclose(found.mean, inverse @ (x.T @ y + prior.mean / sd**2))
    np.testing.assert_allclose(found.sd**2, np.diag(inverse))


@given(SEEDS, st.floats(1e-4, 1e4))
def test_evidence_does_not_know_the_unit_of_a_coefficient(seed, unit):
    x, y = _drawn(seed, 2)
    scale = np.array([unit, 1.0])
    prior = Prior(np.array([0.2, 0.1]), np.ones(2), np.array([-1.0, -2.0]), np.array([1.0, 2.0]))
    other = Prior(*(getattr(prior, f.name) / scale for f in dataclasses.fields(Prior)))
    found, scaled = (
        posterior(_gram(x, y), (0, 1), prior),
        posterior(_gram(x * scale, y), (0, 1), other),
    )
    assert scaled.log_evidence == pytest.approx(found.log_evidence, abs=1e-5)
    np.testing.assert_allclose(scaled.mean * scale, found.mean, rtol=1e-5)


def test_a_column_of_zeros_leaves_its_prior_and_no_evidence():
    _, y = _drawn(0)
    found = posterior(_gram(np.zeros((ROWS, 1)), y), (0,), _free(1, mean=0.4, sd=0.2))
    assert found.log_evidence == pytest.approx(0.0, abs=1e-12)
    assert found.mean[0] == pytest.approx(0.4) and found.sd[0] == pytest.approx(0.2)


def test_sets_at_once_are_the_sets_one_by_one():
    x, y = _drawn(3, 4)
    sets, prior = [(0, 1), (3, 2), (1, 3)], _free(4)
    mean, covariance, told = posteriors(_gram(x, y), sets, prior)
    for i, columns in enumerate(sets):
        alone = posterior(_gram(x, y), columns, prior)
        np.testing.assert_allclose(mean[i], alone.mean)
        np.testing.assert_allclose(covariance[i], alone.covariance)
        assert told[i] == pytest.approx(alone.log_evidence)
    assert prior.take(np.array([1])).sd.tolist() == [1.0]


def _white(x, y, answer=None):
    return White((white_part(range(x.shape[1]), y, x, answer),), x.shape[1])


def test_tempering_counts_every_window_by_a_share():
    x, y = _drawn(4)
    _same(gram_of(_white(x, y), 0.25), _gram(x, y).scale(0.25))


def test_an_answer_of_unit_sd_is_integrated_out():
    x, y = _drawn(5)
    answer = 2.0 * x[:, :1]
    inverse = np.linalg.inv(np.eye(ROWS) + answer @ answer.T)
    told = gram_of(_white(x, y, answer))
    _same(told, Gram(x.T @ inverse @ x, x.T @ inverse @ y, y @ inverse @ y, ROWS))
    assert told.xx[0, 0] < 0.3, "of what the controller may have made little is left"


def test_what_differs_from_flight_to_flight_is_integrated_out_of_each_by_itself():
    """One flight cannot tell a common number from its own; many flights can."""
    x = np.ones((ROWS, 1))
    columns, count = [nuisance("thrust_scale.scale", 1.0, flight_sd=0.2)], 5
    whites = [_white(x, 0.6 * np.ones(ROWS)) for _ in range(count)]
    grams = flight_grams(whites, columns, 1.0)
    found = posterior(sum(grams[1:], grams[0]), (0,), _free(1, sd=100.0))
    assert found.sd[0] == pytest.approx(np.sqrt((1.0 / ROWS + 0.2**2) / count), rel=1e-3)
    assert found.mean[0] == pytest.approx(0.6, rel=1e-3)
    same = flight_grams(whites, [nuisance("thrust_scale.scale", 1.0)], 1.0)
    assert same[0].xx[0, 0] == pytest.approx(ROWS)


def _system(y, columns, acting, names=("force_z",)):
    return system_of(names, columns, [rows_of(e, acting) for e in y])


def test_rms_of_columns_is_over_the_windows_that_have_the_channel():
    y = np.array([[0.0, np.nan], [0.0, 0.0], [0.0, 0.0]])
    acting = [{0: np.array([1.0, 2.0, 2.0]), 1: np.array([50.0, 3.0, 4.0])}, {}]
    system = _system([y], [amplitude("rotor_drag.k_kg")] * 2, acting, ("force_x", "moment_y"))
    np.testing.assert_allclose(rms_of(system), [[np.sqrt(3.0), 0.0], [np.sqrt(12.5), 0.0]])


def test_a_coefficient_s_prior_is_the_size_at_which_it_makes_a_share_of_the_weight():
    """In its greatest channel, whatever the unit of the coefficient."""
    share = settings.evidence.prior_share
    y = np.random.default_rng(0).standard_normal((200, 2))
    for unit in (1.0, 1e-3):
        acting = [{0: np.full(200, 5.0 * unit), 1: np.full(200, 2.0 * unit)}]
        system = _system(
            [y], [amplitude("cg_offset.x_m", low=-1e9, high=1e9)], acting, ("force_z", "moment_y")
        )
        regression = make_regression(system)
        sizes = (MODEL.weight_N / 5.0, MODEL.weight_N * MODEL.arm_m / 2.0)
        assert regression.prior.sd[0] == pytest.approx(share * min(sizes) / unit)


def test_a_prior_is_no_wider_than_half_of_the_room_nor_than_what_is_plausible():
    y = np.random.default_rng(0).standard_normal((200, 1))
    tiny = [{0: np.full(200, 1e-9)}]
    regression = make_regression(_system([y], [amplitude("rotor_drag.k_kg")], tiny))
    assert regression.prior.sd[0] == pytest.approx(0.5 * 0.01)
    cushion = make_regression(_system([y], [amplitude("ground_effect.c_a")], tiny))
    plausible = effect_table.get("ground_effect").parameter("c_a").plausible
    assert cushion.prior.sd[0] == pytest.approx(plausible)
    declared = make_regression(_system([y], [amplitude("inertia.xx")], [{0: np.full(200, 1e3)}]))
    assert declared.prior.sd[0] == pytest.approx(
        effect_table.get("inertia").parameter("xx").plausible
    ), "a nominal parameter is as wrong as such numbers are, however well the flights show it"


def test_a_level_stands_within_a_factor_of_itself_and_bounds_leave_what_is_left():
    y, acting = np.random.default_rng(0).standard_normal((200, 1)), [{0: np.ones(200)}]
    columns = [
        amplitude("motor_lag.up_s", level=0.02),
        amplitude("rotor_saturation.share", level=-0.2),
        amplitude("rotor_drag.k_kg"),
        amplitude("rotor_drag.k_kg", part="moment"),
        nuisance("thrust_scale.scale", 0.05, mean=-0.1),
    ]
    prior = make_regression(_system([y], columns, acting * 5)).prior
    reach = settings.evidence.level_reach
    np.testing.assert_allclose(prior.mean, [0.02, -0.2, 0.0, 0.0, -0.1])
    np.testing.assert_allclose(prior.low, [0.02 / reach, -0.2 * reach, 0.0, -np.inf, -np.inf])
    np.testing.assert_allclose(prior.high, [0.02 * reach, -0.2 / reach, 0.01, np.inf, np.inf])
    assert prior.sd[3] == prior.sd[2] and prior.sd[4] == 0.05


def test_what_no_flight_shows_has_no_prior_and_is_no_variant_of_the_board():
    y = np.random.default_rng(0).standard_normal((200, 1))
    columns = [amplitude("rotor_drag.k_kg"), amplitude("tether.weight_N_m")]
    regression = make_regression(_system([y], columns, [{0: np.ones(200)}, {}]))
    assert regression.prior.sd[1] == 0.0
    assert [name for name, _ in regression.by_variant()] == ["rotor_drag"]


def test_all_flights_together_are_their_sum_with_common_nuisances_integrated_out_once():
    rng = np.random.default_rng(1)
    y = [rng.standard_normal((150, 1)) for _ in range(3)]
    x = rng.standard_normal((2, 150))
    columns = [nuisance("thrust_scale.scale", 0.3, mean=0.2), amplitude("rotor_drag.k_kg")]
    regression = make_regression(_system(y, columns, [{0: x[0]}, {0: x[1]}]))
    total = sum(regression.by_flight[1:], regression.by_flight[0])
    at = np.array([0])
    _same(regression.pool(), total.about(at, np.array([0.2])).without(at, np.array([0.3])))
    _same(regression.pool((0,)), total)
    known = whiten_system(regression.system, regression.noise)
    assert known.by_flight == () and known.prior.sd.tolist() == regression.prior.sd.tolist()


def test_the_order_of_flights_does_not_matter():
    rng = np.random.default_rng(2)
    y = [rng.standard_normal((100, 1)) for _ in range(3)]
    columns, acting = [amplitude("rotor_drag.k_kg")], [{0: rng.standard_normal(100)}]
    _same(*(make_regression(_system(e, columns, acting)).pool() for e in (y, y[::-1])))


def test_acts_are_columns_by_their_coefficients_of_the_names_that_are_asked():
    columns = [amplitude("rotor_drag.k_kg"), amplitude("tether.weight_N_m")]
    system = _system([np.zeros((3, 1))] * 2, columns, [{0: np.ones(3)}, {0: np.arange(3.0)}])
    found = Posterior((0, 1), np.array([2.0, -1.0]), np.eye(2), 0.0)
    assert contribution_of(found, {"rotor_drag"}, system).ravel().tolist() == [2.0] * 6
    both = contribution_of(found, {"rotor_drag", "tether"}, system)
    assert both.ravel().tolist() == [2.0, 1.0, 0.0] * 2
