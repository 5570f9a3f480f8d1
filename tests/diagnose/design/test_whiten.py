"""Noise of a channel: what is coloured comes out white, what is predicted is not noise, and neither
units nor the order of flights matter.
"""

import dataclasses
from statistics import median

import numpy as np
import pytest
from scipy.signal import lfilter

from ges.diagnose.design.noise import (
    NoiseModel,
    estimate_noise,
    noise_residuals,
    variance_covariate,
)
from ges.diagnose.design.whiten import FeedbackErrors, whiten
from ges.diagnose.settings import settings, using

from ..synthetic import MODEL, amplitude, endogenous_part, nuisance, rows_of, system_of, white_part

WINDOWS = 1500
DRAG = amplitude("rotor_drag.k_kg")


def _coloured(correlation, size=0.1, seed=0, count=WINDOWS):
    """An AR(1) process whose innovations have this sd."""
    white = size * np.random.default_rng(seed).standard_normal(count)
    return lfilter([1.0], [1.0, -correlation], white)


def _alone(*signals, columns=(), acting=None, names=("force_z",), **more):
    """A system of one channel from residuals (m,) by flight."""
    flights = [rows_of(np.asarray(e)[:, None], acting or (), **more) for e in signals]
    return system_of(names, columns, flights)


def _whitened(system, noise):
    return whiten(system.flights, noise, variance_covariate(system.flights))


@pytest.mark.parametrize("correlation", [-0.5, 0.0, 0.9])
def test_a_first_order_process_comes_out_white_and_of_unit_size(correlation):
    system = _alone(_coloured(correlation))
    noise = estimate_noise(system)
    ((part,),) = (w.groups for w in _whitened(system, noise))
    assert noise.ar[0] == pytest.approx([correlation, 0.0, 0.0], abs=0.08)
    assert noise.sd[0] == pytest.approx(0.1, rel=0.05)
    (y,) = part.y
    assert np.std(y) == pytest.approx(1.0, rel=0.01)
    chance = 3.5 / np.sqrt(len(y))
    for lag in (1, 2, 3, 5):
        assert abs(np.corrcoef(y[lag:], y[:-lag])[0, 1]) < chance, lag


def test_columns_go_through_the_filter_of_the_residuals():
    y = _coloured(0.7)
    system = _alone(y, columns=[DRAG], acting=[{0: -2.5 * y}])
    ((part,),) = (w.groups for w in _whitened(system, estimate_noise(_alone(y))))
    np.testing.assert_allclose(part.of([0])[:, 0], -2.5 * part.y)
    ((xx, _), (_, yy)) = part.products[0][0]
    assert xx == pytest.approx(6.25 * yy)


def test_whitened_numbers_do_not_know_the_unit_of_their_channel():
    y, x = _coloured(0.6), _coloured(0.2, seed=1)
    made = []
    for unit in (1.0, 1000.0):
        system = _alone(unit * y, columns=[DRAG], acting=[{0: unit * x}])
        ((part,),) = (w.groups for w in _whitened(system, estimate_noise(system)))
        made.append(part)
    np.testing.assert_allclose(made[0].y, made[1].y, rtol=1e-6)
    np.testing.assert_allclose(made[0].of([0]), made[1].of([0]), rtol=1e-6)


def test_the_order_of_flights_does_not_matter():
    signals = [_coloured(0.5, seed=k, count=400) for k in range(3)]
    forth, back = estimate_noise(_alone(*signals)), estimate_noise(_alone(*signals[::-1]))
    for field in dataclasses.fields(NoiseModel):
        np.testing.assert_allclose(getattr(forth, field.name), getattr(back, field.name))


def test_no_row_leans_on_what_was_before_a_break():
    y = _coloured(0.8, count=300)
    system = _alone(y)
    noise = estimate_noise(system)
    (rows,) = system.flights
    keep = np.ones(len(y), bool)
    keep[100:110] = False
    center = rows.windows.center.copy()
    windows = rows.windows.select(keep)
    broken = dataclasses.replace(
        rows,
        windows=windows,
        y=rows.y[keep],
        x=dataclasses.replace(rows.x, shape=(290, 1, 0), values=(np.zeros((290, 0)),)),
        covariate=rows.covariate[keep],
        air=rows.air[keep],
    )
    assert not broken.follows[100] and broken.follows[1:100].all() and len(center) == 300
    shouted = dataclasses.replace(broken, y=broken.y + 1e3 * (np.arange(290) < 100)[:, None])
    parts = [whiten([r], noise, variance_covariate([r]))[0].groups[0] for r in (broken, shouted)]
    after = parts[0].at >= 100
    assert 100 not in parts[0].at and parts[0].at[after][0] == 103, "a full past first"
    np.testing.assert_array_equal(parts[0].y[:, after], parts[1].y[:, after])


def test_a_row_that_is_not_there_is_missing_and_those_after_it_wait_for_their_past():
    y = _coloured(0.8, count=200)
    y[50] = np.nan
    system = _alone(y)
    (part,) = _whitened(system, estimate_noise(system))[0].groups
    assert np.isfinite(part.y).all()
    assert not set(range(50, 54)) & set(part.at) and {49, 54} <= set(part.at)


@pytest.mark.parametrize("growth", [0.0, 1.0])
def test_noise_that_grows_where_a_stream_is_slow_is_taken_off_there(growth):
    rng = np.random.default_rng(2)
    covariate = np.abs(rng.standard_normal(WINDOWS)) + 0.1
    relative = covariate / median(covariate)
    y = 0.1 * np.sqrt(1.0 + growth * relative**2) * rng.standard_normal(WINDOWS)
    system = _alone(y, noise=covariate)
    noise = estimate_noise(system)
    assert noise.growth[0] == growth and noise.sd[0] == pytest.approx(0.1, rel=0.05)
    ((part,),) = (w.groups for w in _whitened(system, noise))
    noisy = relative[part.at] > 2.0
    assert np.std(part.y[:, noisy]) == pytest.approx(1.0, rel=0.1)
    assert np.std(part.y[:, ~noisy]) == pytest.approx(1.0, rel=0.1)


def test_what_a_doubt_explains_is_not_noise_and_what_is_beyond_it_is():
    x, noise = _coloured(0.0, 1.0, seed=3), _coloured(0.0, 0.1, seed=4)
    column, acting = [nuisance("thrust_scale.scale", 0.5)], [{0: x}]
    within = _alone(0.4 * x + noise, columns=column, acting=acting)
    ((left,),) = noise_residuals(within, [0])
    assert np.std(left) == pytest.approx(0.1, rel=0.1)
    narrow = [nuisance("thrust_scale.scale", 1e-4)]
    ((left,),) = noise_residuals(_alone(0.4 * x + noise, columns=narrow, acting=acting), [0])
    assert np.std(left) > 0.3


def test_a_candidate_is_noise_until_it_is_chosen_and_a_mean_never_is():
    x, noise = _coloured(0.0, 1.0, seed=3), _coloured(0.0, 0.1, seed=4)
    system = _alone(7.0 + 0.4 * x + noise, columns=[DRAG], acting=[{0: x}])
    assert np.std(noise_residuals(system, [0])[0]) == pytest.approx(0.41, rel=0.1)
    assert np.std(noise_residuals(system, [0], (0,))[0]) == pytest.approx(0.1, rel=0.1)
    assert abs(noise_residuals(system, [0])[0].mean()) < 1e-9
    assert estimate_noise(system).sd[0] > 3.0 * estimate_noise(system, (0,)).sd[0]


def test_what_acts_together_keeps_its_proportions():
    """A channel that asks for other coefficients, as noise in a reading does, may not choose them,
    but forms are wrong by a factor.
    """
    one, other = _coloured(0.0, 1.0, seed=3), _coloured(0.0, 1.0, seed=4)
    noise, columns = _coloured(0.0, 0.1, seed=5), [DRAG, amplitude("axial_inflow.k_kg")]

    def left(a, b, **known):
        acting = [{0: one}, {0: other}]
        system = _alone(a * one + b * other + noise, columns=columns, acting=acting)
        return np.std(noise_residuals(system, [0], **known)[0])

    assert left(3.0, 1.5, together={0: 0.2, 1: 0.1}) == pytest.approx(0.1, rel=0.1)
    assert left(3.0, -1.5, together={0: 0.2, 1: 0.1}) > 1.0
    assert left(3.0, -1.5, chosen=(0, 1)) == pytest.approx(0.1, rel=0.1)


def test_what_is_not_in_the_air_is_not_left_over():
    air = np.arange(300) >= 100
    ((left,),) = noise_residuals(_alone(_coloured(0.2, count=300), air=air), [0])
    assert np.isnan(left[:100]).all() and np.isfinite(left[100:]).all()


def test_no_noise_is_smaller_than_the_least_share_of_the_whole():
    assert estimate_noise(_alone(np.zeros(100))).sd[0] == pytest.approx(
        settings.noise.least_share * MODEL.weight_N
    )


def test_a_channel_too_short_for_its_filter_is_left_as_it_is():
    noise = estimate_noise(_alone(_coloured(0.9, count=10)))
    assert not noise.ar.any() and noise.sd[0] == 1.0 and noise.growth[0] == 0.0


def test_without_whitening_every_window_counts_by_the_rms_alone():
    y = _coloured(0.9)
    with using({"noise.whitening": False}):
        noise = estimate_noise(_alone(y))
    assert not noise.ar.any()
    assert noise.sd[0] == pytest.approx(np.sqrt(np.mean((y - y.mean())[3:] ** 2)), rel=1e-3)


@pytest.mark.parametrize("copies", [1, 4])
def test_an_answer_counts_once_however_many_flights_show_it(copies):
    """The error of a coefficient has one cause: over its size in noise it is the correlation, and
    no number of flights averages it away.
    """
    x = np.random.default_rng(5).standard_normal(400)
    rows = dataclasses.replace(
        rows_of(np.zeros((400, 1)), [{0: x}]),
        endogenous={("dynamic", 0): {"motor_lag.up_s": endogenous_part("motor_lag.up_s", x)}},
    )
    noise = NoiseModel(np.zeros((1, 3)), np.array([0.5]), np.zeros(1), np.array([2.0]))
    whites = whiten([rows] * copies, noise, [np.zeros(400)] * copies)
    parts = [w.groups[0] for w in whites]
    answers = [part.errors.columns()[0, 0] for part in parts]
    sd = 1.0 / np.sqrt(3.0)
    for part, answer in zip(parts, answers, strict=True):
        share = answer / part.of([0])[0, 0]
        assert np.ptp(share) < 1e-9
        size = np.sqrt(np.mean(part.of([0])[0, 0] ** 2))
        assert share[0] == pytest.approx(2.0 * sd * np.sqrt(copies) / size)


def test_a_part_takes_more_answers_beside_those_that_it_has():
    part, sd = white_part([0], np.ones(3), np.ones((3, 1))), 1.0 / np.sqrt(3.0)
    own = endogenous_part("motor_lag.up_s", np.ones(3))
    one, two = (
        FeedbackErrors(((own,),), np.array([[b]]), np.array([1.0 / sd])) for b in (1.0, 2.0)
    )
    both = part.with_feedback_errors(one).with_feedback_errors(two)
    np.testing.assert_allclose(both.errors.columns(), [[[1.0] * 3, [2.0] * 3]])
    assert part.errors.columns().shape == (1, 0, 3)


def test_unrest_is_over_the_middle_of_all_flights():
    one, two = (rows_of(np.zeros((5, 1)), noise=np.full(5, v)) for v in (1.0, 3.0))
    assert [u[0] for u in variance_covariate([one, two])] == [0.5, 1.5]
    assert variance_covariate([rows_of(np.zeros((5, 1)))])[0].tolist() == [0.0] * 5
