"""Where the nominal parameters are so far off that one linear step does not do."""

import dataclasses

import numpy as np
import pytest

from ges.conventions import command, rotor_speed
from ges.diagnose.design.drives import commanded_speeds
from ges.diagnose.design.system import build, residuals_with
from ges.diagnose.estimate.joint import null_fit
from ges.diagnose.estimate.recalibrate import _cost, _relinearise, operating_point
from ges.diagnose.library.candidates import Variant, amplitude_of
from ges.diagnose.locate.stages import recalibrate
from ges.diagnose.types.model import SPEED

from ..synthetic import MODEL, hovering, times

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

BEND = "thrust_curve.c"


def _fly_motors(top_rad_s, bend, noise_rad_s=1.0, battery_V=16.0, swing=0.35):
    """A flight whose speeds a drive of another top speed and bend has made of the commands."""
    t, rng = times(8.0), np.random.default_rng(0)
    u = {name: 0.55 + swing * np.sin((0.8 + 0.2 * i) * t + i) for i, name in enumerate(COMMAND)}
    flight = hovering(8.0, battery_V=battery_V, **u)
    other = MODEL.with_number("max_rotor_speed_rad_s", top_rad_s)
    (speeds,) = commanded_speeds([flight], other, {"thrust_curve": {"c": bend}} if bend else {})
    speeds = speeds + rng.normal(0.0, noise_rad_s, speeds.shape)
    columns = dict(zip(ROTOR_SPEED, speeds.T, strict=True))
    blind = {name for name in flight.columns if name[:2] in ("p_", "v_", "q_", "om")}
    kept = {n: v for n, v in flight.columns.items() if n not in blind}
    return flight.replace(columns={**kept, **columns})


def _found(flight, speed_sd_rad_s=300.0, bend_sd=0.3):
    late = ("motor_lag.up_s", "motor_lag.down_s", "esc_delay.delay_s", "battery_sag.sensitivity")
    alike = tuple(f"slow_motor.loss_{i}" for i in range(1, 5))
    sds = {SPEED: speed_sd_rad_s, BEND: bend_sd, **dict.fromkeys((*late, *alike), 0.0)}
    declared = dataclasses.replace(MODEL, prior_sds=sds)
    system = build([flight], declared, [])
    assert system.main == ("drive_1", "drive_2", "drive_3", "drive_4")
    return operating_point(*null_fit(system), declared)


def test_where_the_linear_step_does_what_it_predicts_nothing_moves():
    assert _found(_fly_motors(1010.0, 0.0)) == {}


def test_numbers_that_multiply_each_other_are_found_beyond_the_linear_step():
    found = _found(_fly_motors(1800.0, 0.9))
    assert found[SPEED] == pytest.approx(800.0, abs=25.0)
    assert found[BEND] == pytest.approx(0.9, abs=0.05)


def test_a_number_beyond_its_prior_is_left_to_the_search():
    assert set(_found(_fly_motors(1200.0, 0.3), bend_sd=0.06)) == {SPEED}


@pytest.mark.parametrize("tops", [(960.0, 960.0, 960.0), (950.0, 960.0, 970.0)])
def test_flights_to_come_have_the_speed_that_flights_had_in_the_mean(tops):
    """Without a voltage each flight has a level and a sag of its own, unknown to the next one."""
    flights = [_fly_motors(top, 0.0, battery_V=None) for top in tops]
    start = recalibrate(flights, MODEL)
    top_rad_s = start.first.model.number("max_rotor_speed_rad_s")
    assert top_rad_s == pytest.approx(960.0, abs=1.0)
    own = set(start.first.joint.by_flight[0])
    assert {"battery_sag.load_V", "battery_sag.drop_V_s"} < own
    to_come = build([_fly_motors(960.0, 0.0, battery_V=None)], MODEL, [])
    (left,) = residuals_with(to_come, start.first.model)
    rms_rad_s = np.sqrt(np.nanmean(left[:, :4] ** 2))
    assert rms_rad_s < 2.0


def test_a_level_of_each_flight_makes_up_for_no_error_of_a_step_that_all_share():
    """A top speed and a bend multiply each other. Each flight's own level hid that, and unseen
    speeds of three flights were 128 rad/s off that had been 31 as given.
    """
    flights = [_fly_motors(800.0, 0.1, 5.0, battery_V=None, swing=0.03) for _ in range(3)]
    start = recalibrate(flights, MODEL)
    flown, fitted = (
        np.sqrt(np.nanmean(np.concatenate(residuals)[:, :4] ** 2))
        for residuals in (residuals_with(start.system, start.first.model), start.first.residuals)
    )
    assert flown < 1.1 * fitted


def test_a_number_that_no_effect_tells_moves_beyond_its_prior():
    """The search has no name for another top speed: left in the file, others would stand for it."""
    found = _found(_fly_motors(1200.0, 0.3), speed_sd_rad_s=30.0)
    assert found[SPEED] == pytest.approx(200.0, abs=10.0)


def test_costs_compare_from_one_linearisation_to_the_next():
    """Feedback errors of columns made anew would be another likelihood: steps ran in circles."""
    declared = dataclasses.replace(MODEL, prior_sds={SPEED: 300.0, BEND: 0.3})
    regression, joint = null_fit(build([_fly_motors(1500.0, 0.5)], declared, []))
    there = _relinearise(regression, declared, joint.common)
    # what differs between flights is linearised anew, too
    assert _cost(there, {}) == pytest.approx(_cost(regression, joint.common), rel=5e-4)


def test_quiet_sensors_tell_the_error_of_a_step_that_gains_nearly_all():
    """The same numbers need no second linearisation where noise hides its error."""
    top_rad_s, bend = 1100.0, 0.1
    assert _found(_fly_motors(top_rad_s, bend, noise_rad_s=100.0)) == {}
    found = _found(_fly_motors(top_rad_s, bend, noise_rad_s=0.01))
    assert found[SPEED] == pytest.approx(top_rad_s - 1000.0, rel=1e-3)
    assert found[BEND] == pytest.approx(bend, rel=1e-3)


def _drive_form_error(flight):
    """The same question to a vehicle whose curve may not bend as far as the flight's."""
    late = ("motor_lag.up_s", "motor_lag.down_s", "esc_delay.delay_s", "battery_sag.sensitivity")
    model = MODEL.with_effects({"thrust_curve": {"c": 0.95}})
    sds = {SPEED: 300.0, BEND: 0.3, **dict.fromkeys(late, 0.0)}
    return [flight], dataclasses.replace(model, prior_sds=sds)


def test_no_number_is_moved_beyond_the_bounds_of_the_library():
    """The commands go with the square of the speeds and more: the bend stands at its bound, and the
    vehicle is recalibrated as it flies there.
    """
    t = times(8.0)
    u = {name: 0.55 + 0.35 * np.sin((0.8 + 0.2 * i) * t + i) for i, name in enumerate(COMMAND)}
    speeds = {n: 1000.0 * u[c] ** 0.4 for n, c in zip(ROTOR_SPEED, COMMAND, strict=True)}
    flight = hovering(8.0, battery_V=16.0, **u)
    kept = {n: v for n, v in flight.columns.items() if n[:2] not in ("p_", "v_", "q_", "om")}
    start = recalibrate(*_drive_form_error(flight.replace(columns={**kept, **speeds})))
    told = start.first.joint.common
    assert told[BEND] == pytest.approx(0.05, abs=1e-9)
    flown = residuals_with(start.system, start.first.model)[0][:, :4]
    assert flown == pytest.approx(
        start.first.residuals[0], abs=0.1 * np.abs(start.first.residuals[0]).max()
    )


def test_columns_of_a_number_at_its_bound_step_inward():
    """Where a step outward would leave the bounds, the column is that of one inward."""
    flight = _fly_motors(1000.0, 0.0)
    model = dataclasses.replace(MODEL, prior_sds={BEND: 0.3})
    variant = Variant("thrust_curve", {}, (amplitude_of("thrust_curve", "c"),))
    columns = []
    for c in (0.98, 1.0):
        system = build([flight], model.with_effects({"thrust_curve": {"c": c}}), [variant])
        k = next(k for k, column in enumerate(system.columns) if column.variant is not None)
        columns.append(np.concatenate(list(system.flights[0].x.columns([k])[0].values())))
    inside, bound = columns
    assert bound == pytest.approx(inside, abs=0.1 * np.abs(inside).max())
