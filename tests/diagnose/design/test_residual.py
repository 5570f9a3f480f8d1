"""Residuals of flights whose forces and moments are known from a textbook, and what may not change
them.
"""

import dataclasses

import numpy as np
import pytest

from ges.conventions import QUATERNION, command, rotor_speed
from ges.diagnose.design.drives import (
    acting_speeds,
    affects_drive,
    commanded_speeds,
    motor_commands,
)
from ges.diagnose.design.motion import height_columns
from ges.diagnose.design.residual import (
    depend_on_path_alone,
    evaluate,
    replay_with_each,
    residual,
    with_higher_orders,
)
from ges.simulator.terrain import Terrain

from ..synthetic import (
    MODEL,
    NUMBERS,
    hovering,
    manoeuvre,
    times,
    turned,
    windows_of,
)

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

FORCE, MOMENT = ("force_x", "force_y", "force_z"), ("moment_x", "moment_y", "moment_z")
WEIGHT_N = MODEL.weight_N


def _left(flight, names, model=MODEL, more=None, higher_orders=0):
    return residual(flight, windows_of(flight, higher_orders), model, names, more)


def test_a_hover_that_the_file_explains_leaves_nothing():
    np.testing.assert_allclose(_left(hovering(), (*FORCE, *MOMENT)), 0.0, atol=1e-9)


def test_rotors_that_push_more_than_the_weight_leave_the_difference():
    speeds = dict.fromkeys(ROTOR_SPEED, 1.1 * MODEL.hover_rad_s)
    left = _left(hovering(**speeds), FORCE)
    np.testing.assert_allclose(left[:, 2], WEIGHT_N - 1.21 * WEIGHT_N)
    np.testing.assert_allclose(left[:, :2], 0.0, atol=1e-9)


def test_a_free_fall_has_no_force():
    t = times()
    still = dict.fromkeys(ROTOR_SPEED, 0.0)
    falling = hovering(p_z_m=1e3, v_z_m_s=-MODEL.number("gravity_m_s2") * t, **still)
    np.testing.assert_allclose(_left(falling, FORCE), 0.0, atol=1e-9)


def test_a_push_is_its_mass_times_the_acceleration_in_body_axes():
    """An eastward acceleration with the nose to the north is a push to the right."""
    t, half = times(), np.sqrt(0.5)
    flight = hovering(v_x_m_s=0.7 * t, q_w=half, q_z=half)
    left = _left(flight, FORCE)
    np.testing.assert_allclose(left[:, 1], -0.7 * MODEL.number("mass_kg"), atol=1e-6)
    np.testing.assert_allclose(left[:, 0], 0.0, atol=1e-6)


def test_a_steady_speed_takes_no_force_however_the_nose_turns():
    yaw_rad = 0.8 * times()
    flight = hovering(
        v_x_m_s=1.0,
        v_y_m_s=-0.5,
        q_w=np.cos(0.5 * yaw_rad),
        q_z=np.sin(0.5 * yaw_rad),
        omega_z_rad_s=0.8,
    )
    np.testing.assert_allclose(_left(flight, FORCE), 0.0, atol=2e-3)


def test_an_attitude_that_is_read_wrong_is_put_right_by_its_error():
    read = hovering(q_w=np.cos(0.01), q_x=np.sin(0.01))
    assert np.abs(_left(read, FORCE)).max() > 0.1
    left = _left(read, FORCE, more={"attitude_bias": {"x_rad": 0.02}})
    np.testing.assert_allclose(left, 0.0, atol=1e-3)


def test_a_tilted_hover_needs_the_part_of_its_weight_that_thrust_does_not_bear():
    tilt = 0.2
    flight = hovering(q_w=np.cos(0.5 * tilt), q_x=np.sin(0.5 * tilt))
    left = _left(flight, FORCE)
    np.testing.assert_allclose(left[:, 1], WEIGHT_N * np.sin(tilt), atol=1e-9)
    np.testing.assert_allclose(left[:, 2], WEIGHT_N * (np.cos(tilt) - 1.0), atol=1e-9)


@pytest.mark.parametrize(("k", "axis"), list(enumerate("xyz")))
def test_a_rate_that_grows_takes_inertia_times_its_slope(k, axis):
    flight = hovering(**{f"omega_{axis}_rad_s": 0.3 * times()})
    left = _left(flight, MOMENT)
    expected = np.zeros(3)
    expected[k] = 0.3 * MODEL.number(f"i{axis}{axis}_kg_m2")
    np.testing.assert_allclose(left, np.tile(expected, (len(left), 1)), atol=1e-9)


def test_steady_rates_about_two_axes_precess():
    """Omega x I Omega: 2 and 3 rad/s about x and z want (Ix - Iz) times their product about y."""
    left = _left(hovering(omega_x_rad_s=2.0, omega_z_rad_s=3.0), MOMENT)
    np.testing.assert_allclose(left[:, 1], (0.01 - 0.018) * 6.0, atol=1e-9)
    np.testing.assert_allclose(left[:, [0, 2]], 0.0, atol=1e-9)


def test_a_stronger_rotor_leaves_minus_its_moments():
    """Rotor 1 stands in front on the right: more thrust there lifts the nose and the right side,
    and its drag turns the body against its spin.
    """
    speeds = {ROTOR_SPEED[0]: 1.1 * MODEL.hover_rad_s}
    more_N = 0.21 * WEIGHT_N / 4.0
    arm_m = MODEL.number("rotor_1_x_m")
    yaw_Nm = more_N * MODEL.number("torque_coefficient_Nm_s2") / 6e-6
    left = _left(hovering(**speeds), MOMENT)
    np.testing.assert_allclose(left[:, 0], more_N * arm_m, rtol=1e-6)
    np.testing.assert_allclose(left[:, 1], more_N * arm_m, rtol=1e-6)
    np.testing.assert_allclose(np.abs(left[:, 2]), yaw_Nm, rtol=1e-6)


def test_an_accelerometer_reads_the_thrust_over_the_mass():
    gravity = MODEL.number("gravity_m_s2")
    flight = hovering(acc_x_m_s2=0.0, acc_y_m_s2=0.2, acc_z_m_s2=gravity + 0.5)
    left = _left(flight, ("acc_x", "acc_y", "acc_z"))
    np.testing.assert_allclose(left, np.tile([0.0, 0.2, 0.5], (len(left), 1)), atol=1e-9)


def test_a_rangefinder_over_flat_ground_reads_the_height_over_the_tilt():
    flight = hovering(range_m=1.5 + 0.07)
    np.testing.assert_allclose(_left(flight, ("range",)), 0.07, atol=1e-9)
    tilted = hovering(q_w=np.cos(0.1), q_y=np.sin(0.1), range_m=1.5 / np.cos(0.2))
    np.testing.assert_allclose(_left(tilted, ("range",)), 0.0, atol=1e-9)


def test_speeds_that_do_not_reach_what_is_asked_are_lost():
    flight = hovering(**{ROTOR_SPEED[2]: MODEL.hover_rad_s - 12.0})
    left = _left(flight, ("drive_1", "drive_2", "drive_3", "drive_4"))
    # the first window has the way from where the rotor was logged to what was asked
    lost = np.tile([0.0, 0.0, -12.0, 0.0], (len(left) - 1, 1))
    np.testing.assert_allclose(left[1:], lost, atol=0.01)


@pytest.mark.parametrize("yaw_rad", [0.5, -2.0, np.pi])
def test_body_axes_do_not_know_where_north_is(yaw_rad):
    flight = manoeuvre()
    names = (*FORCE, *MOMENT)
    more = {"rotor_drag": {"k_kg": 1e-4}, "cg_offset": {"x_m": 0.01, "y_m": 0.0}}
    before, after = (_left(f, names, more=more) for f in (flight, turned(flight, yaw_rad)))
    assert np.abs(before).max() > 0.1
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_it_does_not_matter_which_rotor_is_called_the_first():
    order = (3, 1, 4, 2)
    numbers = {
        f"rotor_{new}_{what}": MODEL.number(f"rotor_{old}_{what}")
        for new, old in enumerate(order, 1)
        for what in ("x_m", "y_m", "z_m", "radius_m", "spin")
    }
    flight = manoeuvre()
    columns = {
        names[new]: flight.columns[names[old - 1]]
        for names in (ROTOR_SPEED, COMMAND)
        for new, old in enumerate(order)
    }
    other = flight.replace(columns={**flight.columns, **columns})
    named = dataclasses.replace(MODEL, parameters={**NUMBERS, **numbers})
    names = (*FORCE, *MOMENT)
    np.testing.assert_allclose(_left(other, names, named), _left(flight, names), atol=1e-9)


def test_a_sign_of_the_quaternion_turns_nothing():
    flight = manoeuvre()
    negative = {name: -flight.columns[name] for name in QUATERNION}
    other = flight.replace(columns={**flight.columns, **negative})
    names = (*FORCE, *MOMENT)
    np.testing.assert_allclose(_left(other, names), _left(flight, names), atol=1e-9)


@pytest.mark.parametrize(
    "more",
    [
        {"rotor_drag": {"k_kg": 1e-4}},
        {"attitude_bias": {"x_rad": 0.02}},
        {"motor_lag": {"up_s": 0.03, "down_s": 0.03}},
        {"rangefinder_bias": {"bias_m": 0.05, "scale": 0.0}},
    ],
    ids=lambda more: next(iter(more)),
)
def test_an_evaluation_that_leans_on_another_is_the_same_as_one_of_its_own(more):
    flight = manoeuvre(range_m=1.4)
    names = with_higher_orders((*FORCE, *MOMENT, "drive_1", "drive_2", "drive_3", "drive_4"), 2)
    names = (*names, "range")
    windows = windows_of(flight, 1)
    like = evaluate(flight, windows, MODEL, names)
    leaning = evaluate(flight, windows, MODEL, names, more, like).stack(names)
    alone = evaluate(flight, windows, MODEL, names, more).stack(names)
    assert not np.allclose(alone, like.stack(names))
    np.testing.assert_allclose(leaning, alone, atol=1e-12)


def test_what_remembers_the_path_says_the_same_in_a_batch():
    flight = manoeuvre()
    loads = [{"slung_load": {"mass_kg": 0.05, "length_m": length}} for length in (0.4, 0.8)]
    like = evaluate(flight, windows_of(flight), MODEL, FORCE)
    for load, said in zip(loads, replay_with_each(flight, MODEL, like, loads), strict=True):
        alone = evaluate(flight, windows_of(flight), MODEL, FORCE, load)
        np.testing.assert_allclose(said.force_N, alone.output.force_N, atol=1e-9)


def test_a_drive_lags_its_commands_by_the_motor_s_time():
    """After one lag a step has done 63 % of its way."""
    t = times(2.0)
    u = np.where(t < 1.0, 0.5, 0.6)
    flight = hovering(2.0, **dict.fromkeys(COMMAND, u), **dict.fromkeys(ROTOR_SPEED))
    slow = dataclasses.replace(MODEL, parameters={**NUMBERS, "motor_time_constant_s": 0.1})
    (speeds,) = commanded_speeds([flight], slow, {})
    done = (speeds[:, 0] - 500.0) / 100.0
    # the step is between two rows
    late_s = 0.1 - 0.5 * 0.01
    assert np.interp(1.0 + late_s, t, done) == pytest.approx(1.0 - np.exp(-1.0), abs=0.01)
    assert done[-1] == pytest.approx(1.0, abs=1e-3) and abs(done[90]) < 1e-9


def test_rotors_start_as_they_were_logged():
    """A recording that begins while they are still on their way is no ceiling of theirs."""
    flight = hovering(2.0, **dict.fromkeys(COMMAND, 0.9), **dict.fromkeys(ROTOR_SPEED, 400.0))
    (speeds,) = commanded_speeds([flight], MODEL, {})
    # one lag of 20 ms later 63 % of the way from 400 to 900 rad/s
    assert speeds[0] == pytest.approx(400.0, abs=1e-6)
    assert speeds[2] == pytest.approx(900.0 - 500.0 * np.exp(-1.0), rel=0.02)
    unlogged = hovering(2.0, **dict.fromkeys(COMMAND, 0.9), **dict.fromkeys(ROTOR_SPEED))
    assert commanded_speeds([unlogged], MODEL, {})[0][0] == pytest.approx(900.0)


def test_commands_beyond_their_range_do_no_more_than_its_ends():
    flight = hovering(u_1=1.4, u_2=-0.2)
    at_work = motor_commands(flight, MODEL, {})
    assert (at_work[:, 0] == 1.0).all() and (at_work[:, 1] == 0.0).all()


def test_measured_speeds_turn_the_air_and_commands_where_none_are():
    flight = hovering(**{ROTOR_SPEED[0]: 123.0})
    assert (acting_speeds(flight, MODEL, {})[:, 0] == 123.0).all()
    unmeasured = hovering(**dict.fromkeys(ROTOR_SPEED))
    np.testing.assert_allclose(acting_speeds(unmeasured, MODEL, {}), MODEL.hover_rad_s, atol=0.01)


def test_sag_hides_in_speeds_where_no_command_was_logged():
    t = times()
    flight = hovering(battery_V=16.0 - 0.5 * t, **dict.fromkeys(COMMAND))
    sag = {"battery_sag": {"sensitivity": 1.0}}
    speeds = acting_speeds(flight, MODEL, sag)[:, 0] / MODEL.hover_rad_s
    assert speeds[0] > 1.02 and speeds[-1] < 0.98 and (np.diff(speeds) < 0.0).all()
    assert speeds[len(t) // 2] == pytest.approx(1.0, abs=1e-3), "at the middle voltage as logged"


def test_heights_are_over_the_logged_ground_where_the_file_has_none():
    flight = hovering(ground_z_m=0.4)
    np.testing.assert_allclose(height_columns(flight, MODEL)["p_z_m"], 1.1)
    raised = dataclasses.replace(MODEL, terrain=Terrain.flat(0.25))
    np.testing.assert_allclose(height_columns(flight, raised)["p_z_m"], 1.35)
    blind = hovering(p_z_m=None, range_m=0.8)
    np.testing.assert_allclose(height_columns(blind, MODEL)["p_z_m"], 0.8)


def test_faster_test_functions_are_asked_of_moments_and_drives_alone():
    assert with_higher_orders(("force_x", "moment_x", "drive_2"), 2) == (
        "force_x",
        "moment_x",
        "drive_2",
        "moment_x/1",
        "drive_2/1",
        "moment_x/2",
        "drive_2/2",
    )


def test_what_changes_speeds_and_what_remembers_its_path_are_known():
    cushion = {"ground_effect": {}}
    assert affects_drive({"motor_lag": {}}) and not affects_drive(cushion)
    assert affects_drive(cushion, {"actuator_mapping": {}}), "a mapping that is on acts upon it"
    assert depend_on_path_alone({"slung_load": {}}, {})
    assert not depend_on_path_alone({"slung_load": {}, "attitude_bias": {}}, {})
    assert not depend_on_path_alone({"rotor_drag": {}}, {})
