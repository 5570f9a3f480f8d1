"""A shifted balance: what one rotor lost, or a mass at its hub, is found back in means made by
hand.
"""

import dataclasses

import numpy as np
import pytest

from ges.diagnose.detectors.balance import (
    CHANNELS,
    LOSSES,
    MASS,
    Cause,
    Shift,
    _balance_of,
    balance_shift,
    causes_of,
    variance_of_means,
    without_mean_balance,
)
from ges.diagnose.select.probability import calibrated_probability
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model

from ..synthetic import MODEL, NUMBERS, nuisance, rows_of, system_of

COUNT, FLIGHTS = 500, 3
CALIBRATED = Model(NUMBERS, effects={"weak_rotor": dict.fromkeys(("loss_1",), 0.0)})
GAINS = (*LOSSES[:4], *MASS)
WEIGHT_N, ARM_M = MODEL.weight_N, MODEL.number("rotor_1_x_m")
YAW_M = MODEL.number("torque_coefficient_Nm_s2") / MODEL.number("thrust_coefficient_N_s2")


def _columns() -> list[np.ndarray]:
    """Means of thrust, roll, pitch and yaw that a unit of each number leaves, in a hover."""
    quarter, made = WEIGHT_N / 4.0, []
    for i in range(1, 5):
        x, y, spin = (MODEL.number(f"rotor_{i}_{n}") for n in ("x_m", "y_m", "spin"))
        made.append(-quarter * np.array([1.0, y, -x, -spin * YAW_M]))
    made.append(WEIGHT_N * np.array([0.0, 0.0, 1.0, 0.0]))
    made.append(WEIGHT_N * np.array([0.0, -1.0, 0.0, 0.0]))
    return [*made, WEIGHT_N * np.array([1.0, 0.0, 0.0, 0.0])]


def _system(shift, sd=1e-3, flight_sd=1e-3, model=CALIBRATED, noise=1e-3, keys=GAINS):
    """Flights whose balance moved by ``shift`` (4,)."""
    rng = np.random.default_rng(0)
    columns = [nuisance(key, sd, flight_sd) for key in keys]
    flights = []
    for _ in range(FLIGHTS):
        y = shift + noise * rng.standard_normal((COUNT, 4))
        acting = [{c: np.full(COUNT, v) for c, v in enumerate(column)} for column in _columns()]
        flights.append(rows_of(y, acting[: len(keys)]))
    return system_of(CHANNELS, columns, flights, model)


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_a_loss_is_found_back_at_its_rotor_with_its_size(rotor):
    weighed = causes_of(_system(0.15 * _columns()[rotor - 1]))
    loss, mass = max(weighed, key=lambda pair: pair[0].distance_explained)
    assert loss.rotor == rotor and loss.value == pytest.approx(0.15, rel=0.02)
    low, high = loss.ci95
    assert low < 0.15 < high and loss.distance_explained > mass.distance_explained


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_a_mass_at_a_hub_is_found_back_there_in_kilograms(rotor):
    """The centre of gravity moves towards it, and thrust bears more."""
    kg, columns = 0.02, _columns()
    x, y = (MODEL.number(f"rotor_{rotor}_{a}_m") for a in "xy")
    shift = kg * (x * columns[4] + y * columns[5] - columns[6]) / MODEL.number("mass_kg")
    weighed = causes_of(_system(shift))
    loss, mass = max(weighed, key=lambda pair: pair[1].distance_explained)
    assert mass.rotor == rotor and mass.value == pytest.approx(kg, rel=0.02)
    assert mass.distance_explained >= loss.distance_explained


def test_what_would_be_a_gain_or_a_negative_mass_explains_nothing():
    weighed = causes_of(_system(-0.15 * _columns()[0]))
    loss, mass = weighed[0]
    assert loss.value < 0.0 and loss.distance_explained == 0.0 and mass.distance_explained == 0.0


def test_a_shift_within_what_the_file_allows_is_none():
    shift = 0.02 * _columns()[0]
    assert balance_shift(_system(shift, sd=0.05)) is None
    (loss, _), *_ = causes_of(_system(shift, sd=0.05, flight_sd=0.03))
    assert loss.sd > np.hypot(0.05, 0.03 / np.sqrt(FLIGHTS)) and loss.distance_explained < 1.0
    assert balance_shift(_system(0.0 * shift)) is None


def test_a_shift_whose_cause_is_open_is_told_towards_its_rotor():
    """A doubt on yaw hides what tells a loss from a mass."""
    system = _system(0.15 * _columns()[2])
    blind = [
        dataclasses.replace(r, y=r.y * [1.0, 1.0, 1.0, 0.0] + [0.0, 0.0, 0.0, 1.0] * y)
        for r, y in zip(
            system.flights,
            np.random.default_rng(1).standard_normal((FLIGHTS, COUNT, 1)),
            strict=True,
        )
    ]
    shift = balance_shift(dataclasses.replace(system, flights=tuple(blind)))
    assert (
        shift is not None
        and shift.loss.rotor == shift.mass.rotor == 3
        and shift.distance_explained > 9.0
    )
    assert "A rotor 3 that lost 15 +-" in shift.sentence() and "near rotor 3" in shift.sentence()


def test_a_loss_that_yaw_tells_is_the_likelier_cause():
    shift = balance_shift(_system(0.15 * _columns()[2], noise=1e-6, sd=1e-5, flight_sd=1e-5))
    assert "more than 999:1 for the loss" in shift.sentence()
    assert next(iter(shift.effects())) == "weak_rotor"
    (finding,) = shift.findings()
    assert finding.name == "weak_rotor" and finding.probability > 0.97 and not finding.is_open


def test_a_mass_at_the_centre_is_found_there():
    """No hub carries it: nothing but thrust is missing."""
    kg, columns = 0.05, _columns()
    shift = balance_shift(_system(-kg / MODEL.number("mass_kg") * columns[6]))
    assert shift.mass.rotor == 0 and shift.mass.value == pytest.approx(kg, rel=0.02)
    assert shift.effects()["thrust_scale"] == {
        "thrust_scale": {"scale": pytest.approx(-kg / MODEL.number("mass_kg"), rel=0.02)}
    }
    assert "at the centre" in shift.sentence()


@pytest.mark.parametrize(("model", "keys"), [(MODEL, GAINS), (CALIBRATED, GAINS[:-1])])
def test_without_a_calibrated_file_there_is_no_balance_to_shift(model, keys):
    system = _system(0.15 * _columns()[0], model=model, keys=keys)
    assert causes_of(system) == [] and balance_shift(system) is None
    left = [np.ones((3, 4))]
    assert without_mean_balance(left, system)[0] is left[0]


def test_where_the_balance_judges_means_they_are_taken_off_over_all_flights():
    rng = np.random.default_rng(0)
    left = [rng.standard_normal((50, 4)) + k for k in range(2)]
    left[0][3, 1] = np.nan
    told = without_mean_balance(left, _system(np.zeros(4)))
    assert np.nanmean(np.concatenate(told), axis=0) == pytest.approx(np.zeros(4), abs=1e-12)
    assert told[1].mean() - np.nanmean(told[0]) == pytest.approx(1.0, abs=0.2), "not of each"
    assert np.isnan(told[0][3, 1])


def test_the_variance_of_a_mean_is_that_of_blocks_of_time():
    """White rows: their variance over their number. Rows that go in blocks: over the blocks'."""
    rng = np.random.default_rng(2)
    length_s = rows_of(np.zeros((2, 1))).windows.length_s
    block = round(2.0 * settings.statistics.block_s / length_s)
    white = rng.standard_normal((5000, 1))
    slow = np.repeat(rng.standard_normal((100, 1)), block, axis=0)
    for e, expected in ((white, 1.0 / 5000), (slow, slow.var() / 100)):
        system = system_of(("force_z",), (), [rows_of(e)])
        assert variance_of_means(system, [0])[0] == pytest.approx(expected, rel=0.3)


@pytest.mark.filterwarnings("error")
def test_flights_of_a_single_block_have_no_balance_to_shift():
    system = _system(0.15 * _columns()[0])
    short = [
        rows_of(
            r.y[:4], [{c: np.full(4, v) for c, v in enumerate(column)} for column in _columns()]
        )
        for r in system.flights
    ]
    system = dataclasses.replace(system, flights=tuple(short))
    assert np.isnan(variance_of_means(system, range(4))).all()
    assert balance_shift(system) is None
    assert all(cause.distance_explained == 0.0 for pair in causes_of(system) for cause in pair)


def _shift(loss=30.0, mass=28.0, effects=None, seen=True):
    model = Model(NUMBERS, effects=effects or {})
    system = system_of(CHANNELS, (), (), model)
    return Shift(system, Cause(2, 0.1, 0.02, loss), Cause(2, 0.03, 0.005, mass), seen)


def test_both_causes_are_told_in_the_library_s_names_and_numbers():
    found = {f.name: f for f in _shift().findings()}
    assert set(found) == {"weak_rotor", "cg_offset", "thrust_scale"}
    share = 1.0 / (1.0 + np.exp(-settings.search.log_odds_slope))
    sure = calibrated_probability(1.0)
    assert found["weak_rotor"].probability == pytest.approx(sure * share)
    assert found["cg_offset"].probability == pytest.approx(sure * (1.0 - share))
    assert found["weak_rotor"].parameters["loss_2"].value == pytest.approx(0.1)
    moved = found["cg_offset"].parameters
    assert moved["x_m"].value == pytest.approx(0.03 * MODEL.number("rotor_2_x_m"))
    assert found["thrust_scale"].parameters["scale"].value == pytest.approx(-0.03)
    low, high = found["thrust_scale"].parameters["scale"].ci95
    assert low < -0.03 < high and high - low == pytest.approx(2.0 * 1.96 * 0.005)
    assert all(f.is_open for f in found.values())
    hung = {f.name: f for f in _shift(seen=False).findings()}
    assert hung["slung_load"].parameters["mass_kg"].value == pytest.approx(0.03)


def test_what_the_file_has_already_is_added_to():
    known = {"weak_rotor": {"loss_2": 0.04}, "thrust_scale": {"scale": 0.01}}
    found = {f.name: f for f in _shift(effects=known).findings()}
    told = found["weak_rotor"].parameters["loss_2"]
    assert told.value == pytest.approx(0.14) and "vehicle file has 0.04" in told.note
    assert found["thrust_scale"].parameters["scale"].value == pytest.approx(-0.02)


def test_a_new_propeller_is_worth_what_a_healthy_balance_would_be():
    told = _shift(30.0, 26.0).next_flight()
    assert told["expected_log_odds"] == pytest.approx(15.0)
    assert told["so_far_log_odds"] == pytest.approx(2.0) and "rotor 2" in told["preparation"]


def test_the_p_value_of_any_cause_is_that_of_draws():
    """An upper bound, and near: Bonferroni's is half as much again."""
    balance = _balance_of(_system(np.zeros(4), sd=0.01, flight_sd=0.01))
    root = np.linalg.cholesky(balance.precision)
    directions = np.array([root.T @ d for d in (*balance.losses, *balance.masses)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    drawn = (np.random.default_rng(0).standard_normal((400_000, 4)) @ directions.T).max(axis=1)
    for sds in (2.5, 3.0):
        p_value = (drawn > sds).mean()
        assert p_value * 0.97 < balance.p_value(sds) < 1.15 * p_value
