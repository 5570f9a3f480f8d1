"""Spread between flights, trims and corrections of a vehicle file, by arithmetic alone."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ges.diagnose.calibrate import calibrate as module
from ges.diagnose.calibrate.calibrate import TRIMS, Number
from ges.diagnose.detectors.balance import CANT, LOSSES
from ges.diagnose.select.evidence import Gram
from ges.diagnose.settings import settings
from ges.diagnose.types.model import SPEED
from ges.errors import GesError
from ges.vehicle.file import parse_vehicle

from ..synthetic import MODEL, hovering

SHEET = {
    "name": "quad",
    "mass_kg": {"value": 1.0, "sd": 0.02},
    "inertia_kg_m2": {"xx": 0.01, "yy": 0.01, "zz": 0.018, "sd_rel": 0.1},
    "rotors": [
        {"x_m": 0.1 * x, "y_m": 0.1 * y, "radius_m": 0.1, "spin": spin}
        for x, y, spin in ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw"))
    ],
    "thrust_coefficient_N_s2": {"value": 6e-6, "sd_rel": 0.03},
    "torque_coefficient_Nm_s2": {"value": 1e-7, "sd_rel": 0.1},
    "max_rotor_speed_rad_s": {"value": 1000.0, "sd": 20.0},
}


def _number(value, later_sd=0.01, declared_sd=0.05):
    return Number(value, 0.5 * later_sd, 0.0, 0.0, declared_sd, later_sd)


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
    told = module._posterior([grams[:3], grams[3:]], mean, sd, spread, session)
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
    forth = module._posterior([grams[:1], grams[1:]], *args)
    back = module._posterior([grams[:0:-1], grams[:1]], *args)
    np.testing.assert_allclose(forth.mean, back.mean)
    assert forth.log_likelihood == pytest.approx(back.log_likelihood)


def _spreads_of(sessions, unit=0.2):
    trims = module._Trims(("a", "b"), np.ones(2), np.full(2, unit), tuple(map(tuple, sessions)))
    return module._fit_spreads(trims, np.zeros(2), 1.0)


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
    turn = module._gauge(keys, MODEL)
    told = dict(zip(keys, turn @ np.array([0.05, 0.1, 0.1, 0.1, 0.1]), strict=True))
    assert told[TRIMS[0]] == pytest.approx(0.05 - 0.1)
    assert all(told[key] == pytest.approx(0.0) for key in LOSSES[:4])
    one = turn @ np.array([0.0, 0.2, 0.0, 0.0, 0.0])
    assert one[1:].sum() == pytest.approx(0.0) and one[0] == pytest.approx(-0.05)
    np.testing.assert_allclose(turn @ turn, turn, atol=1e-12)
    np.testing.assert_array_equal(module._gauge(LOSSES[:4], MODEL), np.eye(4))
    np.testing.assert_array_equal(module._gauge(TRIMS[:2], MODEL), np.eye(2))


def test_a_loss_of_the_rotors_that_turn_one_way_is_a_cant():
    """The yaw moment and the thrust of the balance stay what they were: of rotors by their torque,
    of a cant by its lever.
    """
    keys = (TRIMS[0], *LOSSES[:4], CANT)
    turn = module._gauge(keys, MODEL)
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


def test_what_commands_alone_tell_is_one_number():
    told = module._with_free_trims(MODEL, [hovering()]).prior_sds
    assert {told[key] for key in LOSSES[:4]} == {settings.calibrate.loss_sd}
    assert told["cg_offset.x_m"] == 0.0 and SPEED not in told
    commanded = hovering(**{f"rotor_speed_{i}_rad_s": None for i in range(1, 5)})
    told = module._with_free_trims(MODEL, [commanded]).prior_sds
    assert told[SPEED] == 0.0 and told["thrust_curve.c"] == 0.0


@pytest.mark.parametrize(("value", "flown"), [(0.2, 0.2), (-0.72, -0.7)])
def test_a_correction_that_is_beyond_by_noise_is_at_its_bound(value, flown):
    assert module._within_flown_bounds("inertia.xx", value, 0.01, MODEL) == pytest.approx(flown)
    assert module._within_flown_bounds("esc_delay.delay_s", -0.05, 1e-3, MODEL) == 0.0, (
        "no nominal parameter"
    )


def test_a_correction_that_is_clearly_beyond_is_refused_in_one_sentence():
    with pytest.raises(GesError, match=r"need inertia\.xx corrected by -0\.9, and the simulator"):
        module._within_flown_bounds("inertia.xx", -0.9, 0.01, MODEL)


def test_corrections_are_folded_into_the_numbers_that_they_correct():
    vehicle = parse_vehicle(SHEET)
    numbers = {
        "thrust_scale.scale": _number(-0.1, 0.02),
        "inertia.xx": _number(0.2, 0.03),
        "inertia.zz": _number(-0.1, 0.04),
        SPEED: _number(25.0, 5.0),
    }
    told = module._corrected_fields(vehicle, numbers)
    assert told["thrust_coefficient_N_s2"].value == pytest.approx(5.4e-6)
    assert told["thrust_coefficient_N_s2"].sd == pytest.approx(0.02 * 6e-6)
    assert told["mass_kg"].value == 1.0 and told["mass_kg"].sd == 0.0, "one of the two takes it"
    inertia = told["inertia_kg_m2"]
    assert (inertia.xx, inertia.yy, inertia.zz) == pytest.approx((0.012, 0.01, 0.0162))
    assert inertia.sd_rel == pytest.approx(0.04), "the widest of them"
    assert told["max_rotor_speed_rad_s"].value == 1025.0
    assert told["max_rotor_speed_rad_s"].sd == 5.0


def test_trims_are_written_as_effects_about_what_the_file_had():
    vehicle = parse_vehicle({**SHEET, "effects": {"weak_rotor": {"loss_1": {"value": 0.02}}}})
    numbers = {LOSSES[0]: _number(0.03), LOSSES[1]: _number(-0.01), "inertia.xx": _number(0.2)}
    told = module._effects(vehicle, numbers)
    loss = told["weak_rotor"]["loss_1"]
    assert loss.value == pytest.approx(0.05) and loss.sd == 0.01
    assert loss.ci95 == pytest.approx((0.05 - 1.96 * 0.005, 0.05 + 1.96 * 0.005))
    assert told["weak_rotor"]["loss_2"].value == pytest.approx(-0.01)
    assert told["cg_offset"]["x_m"].value == 0.0 and "inertia" not in told


def test_a_number_far_from_its_declared_doubt_is_said_and_trims_are_not():
    far = module._moved_warnings(
        {"inertia.xx": _number(0.4), "inertia.yy": _number(0.1), LOSSES[0]: _number(0.4)}
    )
    assert len(far) == 1 and far[0].startswith("inertia.xx moved by 0.4, 8.0 times its prior sd")
    low, high = _number(0.1, 0.02).ci95
    assert (low, high) == pytest.approx((0.1 - 0.0196, 0.1 + 0.0196))


def test_a_top_speed_is_no_surer_in_later_flights_than_thrust_by_commands():
    """Gains by commands spread by 2 % between flights, and speed goes as the root of thrust."""
    assert module._usual_sd(SPEED, MODEL) == pytest.approx(
        0.01 * MODEL.number("max_rotor_speed_rad_s")
    )
    assert module._usual_sd("battery_sag.sensitivity", MODEL) > 0.0
    assert module._usual_sd("inertia.xx", MODEL) == 0.0
