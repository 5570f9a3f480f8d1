"""Streams on a grid, and which samples fly."""

import numpy as np
import pandas as pd
import pytest

from ges.conventions import QUATERNION, command, rotor_speed
from ges.diagnose.prepare.align import (
    CommandHold,
    airborne,
    gaps,
    grid_step_s,
    lifting,
    no_attitude_derived,
    regrid,
    resting_m,
    thrust_over_usual,
    thrust_over_weight,
)
from ges.diagnose.settings import settings
from ges.errors import GesError

from ..synthetic import MODEL, hovering

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

T = np.arange(0.0, 8.0, 0.01)


def _frame(**columns):
    return pd.DataFrame({"t_s": T, **columns})


def test_a_straight_line_comes_through_any_grid():
    frame = _frame(p_z_m=1.0 + 0.3 * T, battery_V=16.0 - 0.1 * T)
    for step_s in (0.004, 0.01, 0.037):
        flight = regrid(frame, step_s)
        assert flight.dt_s == pytest.approx(step_s)
        np.testing.assert_allclose(flight.columns["p_z_m"], 1.0 + 0.3 * flight.t_s, atol=1e-9)
        np.testing.assert_allclose(flight.columns["battery_V"], 16.0 - 0.1 * flight.t_s, atol=1e-9)


def test_a_slow_stream_is_a_line_between_its_news_and_says_how_slow_it_is():
    """Values that are repeated until the next one comes."""
    held = np.floor(T / 0.1 + 1e-9) * 0.1
    flight = regrid(_frame(p_z_m=2.0 * held), 0.01)
    inside = flight.t_s < 7.8
    np.testing.assert_allclose(flight.columns["p_z_m"][inside], 2.0 * flight.t_s[inside], atol=1e-6)
    assert flight.update_s["position"] == pytest.approx(0.1)


def test_a_value_that_stood_for_long_stands_until_its_next_news():
    """A lost link is no straight line from before it to after it."""
    value = np.where(T < 3.0, T, np.where(T < 5.0, 3.0, T))
    flight = regrid(_frame(p_z_m=value), 0.01)
    assert np.interp(4.5, flight.t_s, flight.columns["p_z_m"]) == pytest.approx(3.0, abs=0.02)


def test_a_constant_stream_is_itself_and_has_no_news():
    flight = regrid(_frame(battery_V=np.full(len(T), 15.5)), 0.01)
    assert (flight.columns["battery_V"] == 15.5).all() and flight.update_s["battery"] == np.inf


def test_quaternions_keep_their_sign_and_their_length():
    half = 0.4 * T
    q = np.column_stack([np.cos(half), np.zeros_like(T), np.zeros_like(T), np.sin(half)])
    q *= np.where(np.arange(len(T)) % 3 == 0, -2.0, 2.0)[:, None]
    flight = regrid(_frame(**dict(zip(QUATERNION, q.T, strict=True))), 0.01)
    told = flight.stack("attitude")
    np.testing.assert_allclose(np.linalg.norm(told, axis=1), 1.0)
    assert ((told[1:] * told[:-1]).sum(axis=1) > 0.999).all()
    turned = np.abs(
        (
            told
            * np.column_stack(
                [np.cos(0.4 * flight.t_s), *[0.0 * flight.t_s] * 2, np.sin(0.4 * flight.t_s)]
            )
        ).sum(axis=1)
    )
    np.testing.assert_allclose(turned, 1.0, atol=1e-5)


def test_half_of_a_stream_is_no_stream_but_of_positions():
    turning = dict.fromkeys(rotor_speed(4), 500.0 + T)
    flight = regrid(_frame(p_z_m=T, v_x_m_s=T, u_1=0.5 + 0.01 * T, **turning), 0.01)
    assert set(flight.columns) == {"p_z_m", *turning} and not flight.has("position")


def test_a_rangefinder_out_of_its_range_is_silent_where_the_height_is_known():
    range_m = np.where((T > 3.0) & (T < 5.0), np.nan, 1.0 + 0.01 * T)
    told = regrid(_frame(range_m=range_m, p_z_m=T), 0.01)
    silent = np.isnan(told.columns["range_m"])
    assert told.t_s[silent].min() == pytest.approx(3.0, abs=0.02)
    assert told.t_s[silent].max() == pytest.approx(5.0, abs=0.02)
    short = regrid(_frame(range_m=np.where((T > 3.0) & (T < 3.3), np.nan, 1.0), p_z_m=T), 0.01)
    assert not np.isnan(short.columns["range_m"]).any(), "a short hole is bridged"


@pytest.mark.parametrize(("step_s", "told_s"), [(0.001, 0.005), (0.02, 0.02), (0.3, 0.05)])
def test_a_grid_is_as_fine_as_the_rows_within_bounds(step_s, told_s):
    assert grid_step_s(pd.DataFrame({"t_s": step_s * np.arange(50)})) == pytest.approx(told_s)


@pytest.mark.parametrize(
    ("t_s", "said"),
    [
        ([0.0, 1.0], "flight 3: 2 rows are less than 3 s"),
        ([0.0], "flight 3: 1 rows"),
        ([0.0, 5.0, 4.0, 9.0], "flight 3: t_s does not increase at row 2; sort the recording"),
        ([0.0, 1e7, 2e7, 3e7], "flight 3: rows are 1e\\+07 s apart, and 0.5 s are a gap; t_s has"),
    ],
)
def test_what_is_no_flight_is_refused_in_one_sentence(t_s, said):
    with pytest.raises(GesError, match=said):
        regrid(pd.DataFrame({"t_s": t_s}), 0.01, 3)


def test_gaps_are_where_no_row_and_no_motion_was_logged():
    rows = _frame(v_x_m_s=T, v_y_m_s=T, v_z_m_s=T)
    rows = rows[(rows.t_s < 2.0) | (rows.t_s > 3.0)]
    told = T[gaps(rows, T)]
    assert told.min() == pytest.approx(2.0, abs=0.02) and told.max() == pytest.approx(3.0, abs=0.02)
    lost = _frame(v_x_m_s=np.where(T < 4.0, T, np.nan))
    assert gaps(lost, T)[T > 4.1].all() and not gaps(lost, T)[T < 3.9].any()
    assert not gaps(_frame(), T).any()


def _working(*levels):
    """Thrust over its usual, each level for two seconds, 100 Hz."""
    return np.repeat(np.array(levels, dtype=float), 200)


def test_lift_is_thrust_over_weight_from_speeds_or_from_commands():
    flight = hovering()
    np.testing.assert_allclose(thrust_over_weight(flight, MODEL), 1.0)
    commanded = hovering(**dict.fromkeys(ROTOR_SPEED))
    np.testing.assert_allclose(thrust_over_weight(commanded, MODEL), 1.0)
    silent = hovering(**dict.fromkeys((*ROTOR_SPEED, *COMMAND)))
    assert thrust_over_weight(silent, MODEL) is None
    np.testing.assert_array_equal(thrust_over_usual(silent, None), 1.0)


@pytest.mark.parametrize("wrong", [0.5, 1.0, 3.0])
def test_a_wrong_thrust_coefficient_does_not_matter(wrong):
    flight, ratio = hovering(8.0), _working(0.1, 1.0, 1.02, 0.1)
    np.testing.assert_allclose(thrust_over_usual(flight, wrong * ratio), ratio / 1.01, rtol=0.02)
    assert not thrust_over_usual(flight, np.zeros(800)).any(), "a drive that never runs"


def test_the_air_is_where_the_drive_works_and_the_vehicle_is_off_its_rest():
    flight, working = hovering(8.0), _working(0.1, 1.0, 1.0, 0.1)
    margin = int(settings.prepare.pause_s / 0.01)
    up = airborne(flight, working, None)
    assert up[200 + margin + 2 : 600 - margin - 2].all()
    assert not up[: 200 + margin - 2].any() and not up[600 - margin + 2 :].any()
    above_m = np.where(np.arange(800) < 400, 0.0, 1.0)
    late = airborne(flight, working, above_m)
    assert not late[: 400 + margin - 2].any() and late[400 + margin + 2 : 600 - margin - 2].all()


def test_a_brisk_descent_flies_well_above_the_ground_alone():
    flight, working = hovering(6.0), _working(1.0, 0.5, 1.0)
    assert airborne(flight, working, np.full(600, 2.0)).all()
    low = airborne(flight, working, np.full(600, 0.2))
    assert not low[250:350].any()


def test_a_vehicle_rests_where_its_drive_idles_at_an_end():
    flight, working = hovering(8.0), _working(0.1, 1.0, 1.0, 1.0)
    height_m = np.where(np.arange(800) < 200, 0.12, 1.5)
    assert resting_m(flight, working, height_m) == pytest.approx(0.12)
    assert resting_m(flight, np.ones(800), height_m) == np.inf, "it begins and ends in the air"
    assert resting_m(flight, working, None) == np.inf
    table = np.where(np.arange(800) < 200, 0.8, 0.3)
    assert resting_m(flight, working, table) == np.inf, "a table is left for what is below"


def test_a_drive_lifts_where_it_pushes_most_of_its_usual_in_flight():
    push = np.sqrt(_working(0.1, 0.9, 1.0, 1.0))
    speeds = dict.fromkeys(ROTOR_SPEED, MODEL.hover_rad_s * push)
    flight = hovering(8.0, **speeds)
    flying = np.arange(800) >= 400
    told = lifting(flight, flying)
    margin = int(settings.design.half_window_s / 0.01)
    assert told[200 + margin + 1 :].all() and not told[: 200 + margin - 1].any()
    silent = hovering(8.0, **dict.fromkeys(COMMAND))
    assert lifting(silent, flying) is flying


def test_a_flight_knows_its_streams_and_what_was_left_out():
    ground = np.arange(400) < 150
    flight = hovering().replace(excluded={"on_ground": ground, "gaps": np.zeros(400, bool)})
    assert flight.left_out == {"on_ground": pytest.approx(1.5)}
    assert flight.has("attitude") and not flight.has("battery")
    assert flight.stack("position").shape == (400, 3)
    assert flight.steps(0.0025) == 4 and flight.steps(1.0) == 1
    assert flight.driven is flight.flying
    assert no_attitude_derived([flight])
    assert not no_attitude_derived([flight, flight.replace(derived=frozenset({"attitude"}))])


def test_a_command_that_may_be_held_is_late_by_the_mean_of_both_and_within_them():
    held = CommandHold()
    draws = np.where(np.random.default_rng(0).random(200_000) < 0.5, 0.5, 0.0)
    assert held.delay_rows == pytest.approx(draws.mean(), abs=3e-3)
    assert held.bound_rows == np.abs(draws - held.delay_rows).max()


def test_a_faster_stream_is_averaged_and_what_is_too_fast_for_the_grid_stays_out():
    t_s = np.arange(0.0, 6.0, 0.001)
    # 190 Hz would fold to 10 Hz on a grid of 5 ms
    slow, fast = np.sin(2.0 * t_s), np.sin(2.0 * np.pi * 190.0 * t_s)
    flight = regrid(pd.DataFrame({"t_s": t_s, "p_z_m": slow + fast}), 0.005)
    inner = slice(2, -2)
    left = flight.columns["p_z_m"] - np.sin(2.0 * flight.t_s)
    assert np.abs(left[inner]).max() < 0.1 and np.abs(fast[::5]).max() > 0.9


@pytest.mark.parametrize("row_s", [0.005, 0.01])
def test_rows_as_fast_as_the_grid_are_taken_as_they_are_however_their_times_round(row_s):
    rng = np.random.default_rng(4)
    for start_s in np.arange(0.1, 20.0, 0.7):
        t_s = start_s + row_s * np.arange(900)
        values = rng.normal(0.0, 1.0, len(t_s))
        frame = pd.DataFrame({"t_s": t_s, "p_z_m": values})
        flight = regrid(frame, grid_step_s(frame))
        read = np.interp(flight.t_s, t_s, values)
        np.testing.assert_array_equal(flight.columns["p_z_m"], read)


@pytest.mark.filterwarnings("error")
def test_a_quaternion_of_zeros_is_no_attitude():
    """An estimator that has not begun, and one that never does."""
    attitude = {name: np.where(T < 1.0, 0.0, float(k == 0)) for k, name in enumerate(QUATERNION)}
    flight = regrid(_frame(**attitude), 0.01)
    np.testing.assert_array_equal(flight.columns["q_w"], 1.0)
    none = regrid(_frame(p_z_m=T, **dict.fromkeys(QUATERNION, np.zeros(len(T)))), 0.01)
    assert not none.has("attitude") and "p_z_m" in none.columns
