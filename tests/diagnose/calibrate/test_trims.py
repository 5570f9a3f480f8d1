"""Trims in sessions: posterior, gauge and spreads, by arithmetic alone."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ges.diagnose.calibrate import trims as module
from ges.diagnose.calibrate.trims import TRIMS
from ges.diagnose.detectors.balance import CANT, LOSSES
from ges.diagnose.select.evidence import Gram
from ges.diagnose.settings import settings

from ..synthetic import MODEL


def _flights(count=4, rows=6, k=2, flight_sd=0.0, seed=0):
    """Designs and unit-noise readings of flights whose numbers differ by a spread."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        x = rng.standard_normal((rows, k))
        beta = np.array([0.5, -0.3])[:k] + flight_sd * rng.standard_normal(k)
        made.append((x, x @ beta + rng.standard_normal(rows)))
    return made


def _grams(flights):
    return [Gram(x.T @ x, x.T @ y, float(y @ y), float(len(y))) for x, y in flights]


def test_likelihood_of_flights_is_the_normal_with_spreads_and_prior_in_it():
    """Up to the noise's own constant, of all readings together: three flights on one day, one on
    another.
    """
    flights, mean, sd = _flights(), np.array([0.2, 0.0]), np.array([0.7, 1.5])
    spread, session = np.array([0.3, 0.1]), np.array([0.2, 0.6])
    days = np.array([0, 0, 0, 1])
    grams = _grams(flights)
    told = module.posterior_of_trims([grams[:3], grams[3:]], mean, sd, spread, session)
    x = np.concatenate([x for x, _ in flights])
    y = np.concatenate([y for _, y in flights])
    flight = np.repeat(np.arange(len(flights)), [len(own) for own, _ in flights])
    same_flight, same_day = (np.equal.outer(k, k) for k in (flight, days[flight]))
    noise = np.eye(len(y)) + same_flight * ((x * spread**2) @ x.T)
    noise += same_day * ((x * session**2) @ x.T)
    expected = multivariate_normal(x @ mean, noise + (x * sd**2) @ x.T).logpdf(y)
    constant = -0.5 * len(y) * np.log(2.0 * np.pi)
    assert told.log_likelihood == pytest.approx(expected - constant)
    inverse = np.linalg.inv(x.T @ np.linalg.solve(noise, x) + np.diag(sd**-2))
    np.testing.assert_allclose(told.covariance, inverse, rtol=1e-6)
    right = x.T @ np.linalg.solve(noise, y) + mean / sd**2
    np.testing.assert_allclose(told.mean, inverse @ right, rtol=1e-6)


def test_the_order_of_flights_and_sessions_does_not_matter():
    grams = _grams(_flights())
    args = np.zeros(2), np.ones(2), np.full(2, 0.2), np.full(2, 0.4)
    forth = module.posterior_of_trims([grams[:1], grams[1:]], *args)
    back = module.posterior_of_trims([grams[:0:-1], grams[:1]], *args)
    np.testing.assert_allclose(forth.mean, back.mean)
    assert forth.log_likelihood == pytest.approx(back.log_likelihood)


def _spreads_of(sessions, unit=0.2):
    trims = module.TrimBalance(
        ("a", "b"), np.ones(2), np.full(2, unit), tuple(map(tuple, sessions))
    )
    return module.fit_spreads(trims, np.zeros(2), 1.0)


def test_a_spread_between_flights_is_found_back():
    grams = _grams(_flights(200, 40, 2, flight_sd=0.6, seed=1))
    flight, session = _spreads_of([grams])
    assert flight.estimate == pytest.approx(3.0, rel=0.15)
    assert np.isnan(session.estimate) and session.later_sd == 0.0, "one set has one spread"
    alike = _grams(_flights(200, 40, 2, flight_sd=0.0, seed=1))
    assert _spreads_of([alike])[0].estimate < 0.5


def test_a_spread_between_sessions_is_told_from_that_between_flights():
    """Forty days of three flights, ten times as far apart as the flights of a day."""
    rng, days = np.random.default_rng(5), []
    for _ in range(40):
        moved, day = 0.6 * rng.standard_normal(2), []
        for _ in range(3):
            x = rng.standard_normal((40, 2))
            own = moved + 0.06 * rng.standard_normal(2)
            day.append((x, x @ own + 0.1 * rng.standard_normal(40)))
        days.append([Gram(100 * g.xx, 100 * g.xy, 100 * g.yy, g.n) for g in _grams(day)])
    flight, session = _spreads_of(days)
    assert flight.estimate == pytest.approx(0.3, rel=0.2)
    assert session.estimate == pytest.approx(3.0, rel=0.2)


def test_single_flights_of_several_days_tell_nothing_of_one_day():
    grams = _grams(_flights(30, 40, 2, flight_sd=0.6, seed=1))
    flight, session = _spreads_of([[g] for g in grams])
    assert np.isnan(flight.estimate) and flight.pooled == settings.calibrate.smaller_spread
    assert session.estimate == pytest.approx(3.0, rel=0.25)


def test_spreads_are_pooled_by_their_degrees_of_freedom():
    worth = 4.0
    alone = module._pool(2.0, 0.0, 0.5, worth)
    assert alone.pooled == pytest.approx(0.5) and alone.freedom == worth
    many = module._pool(2.0, 1e9, 0.5, worth)
    assert many.pooled == pytest.approx(2.0, rel=1e-6)
    assert many.later_sd == pytest.approx(2.0, rel=1e-4), "no Student's tail of so many"
    assert module._pool(2.0, worth, 0.0, worth).pooled == pytest.approx(np.sqrt(2.0))
    assert alone.later_sd > 1.2 * alone.pooled


def test_a_loss_of_all_motors_is_a_thrust_scale():
    keys = (TRIMS[0], *LOSSES[:4])
    turn = module.gauge_of_trims(keys, MODEL)
    told = dict(zip(keys, turn @ np.array([0.05, 0.1, 0.1, 0.1, 0.1]), strict=True))
    assert told[TRIMS[0]] == pytest.approx(0.05 - 0.1)
    assert all(told[key] == pytest.approx(0.0) for key in LOSSES[:4])
    one = turn @ np.array([0.0, 0.2, 0.0, 0.0, 0.0])
    assert one[1:].sum() == pytest.approx(0.0) and one[0] == pytest.approx(-0.05)
    np.testing.assert_allclose(turn @ turn, turn, atol=1e-12)
    np.testing.assert_array_equal(module.gauge_of_trims(LOSSES[:4], MODEL), np.eye(4))
    np.testing.assert_array_equal(module.gauge_of_trims(TRIMS[:2], MODEL), np.eye(2))


def test_a_loss_of_the_rotors_that_turn_one_way_is_a_cant():
    """The yaw moment and the thrust of the balance stay what they were: of rotors by their torque,
    of a cant by its lever.
    """
    keys = (TRIMS[0], *LOSSES[:4], CANT)
    turn = module.gauge_of_trims(keys, MODEL)
    spin = np.array([MODEL.number(f"rotor_{i}_spin") for i in range(1, 5)])
    torque_m = MODEL.number("torque_coefficient_Nm_s2") / MODEL.number("thrust_coefficient_N_s2")

    def yaw_over_thrust_m(numbers):
        losses, angle = numbers[1:5], numbers[5]
        return torque_m * np.mean(spin * losses) + MODEL.arm_m * angle

    given = np.array([0.02, 0.1, 0.04, 0.0, 0.03, 0.005])
    told = turn @ given
    assert yaw_over_thrust_m(told) == pytest.approx(yaw_over_thrust_m(given))
    assert spin @ told[1:5] == pytest.approx(0.0) and told[1:5].sum() == pytest.approx(0.0)
    np.testing.assert_allclose(turn @ turn, turn, atol=1e-12)


def test_trims_spread_by_their_doubts_and_thrust_where_motors_cannot_be_told_apart():
    share, keys = settings.calibrate.spread, (TRIMS[0], *LOSSES[:4], CANT)
    assert module._usual_spread(LOSSES[0], keys) == share * settings.calibrate.loss_sd
    assert module._usual_spread(CANT, keys) == share * settings.calibrate.cant_sd_rad
    assert module._usual_spread(TRIMS[0], keys) == 0.0
    of_four = share * settings.calibrate.loss_sd / np.sqrt(4.0)
    assert module._usual_spread(TRIMS[0], keys[:1]) == pytest.approx(of_four)
