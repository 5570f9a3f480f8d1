"""Delays of one stream against another, found to a fraction of a step, and offsets of a gyro."""

import dataclasses

import numpy as np
import pytest

from ges.conventions import BODY_RATE, QUATERNION, command, rotor_speed
from ges.diagnose.prepare.delays import (
    clock_drift,
    drive_delay,
    estimate_command_hold,
    gyro_bias,
    pose_delay,
    without_delay,
    without_gyro_bias,
)
from ges.diagnose.prepare.kinematics import body_rates, quaternion_product, to_body, turn_rates
from ges.diagnose.prepare.steady import lag_matrix, with_steady_position, with_steady_voltage
from ges.simulator import effects as effect_table

from ..synthetic import MODEL, hovering, times

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

DURATION_S = 16.0
T = times(DURATION_S)
TONES = (2.1, 3.3, 5.2, 7.9)


def _signal(t, seed):
    phase = np.random.default_rng(seed).uniform(0.0, 6.0, len(TONES))
    return sum(np.sin(w * t + p) for w, p in zip(TONES, phase, strict=True))


def _turning(late_s=0.0, bias=(0.0, 0.0, 0.0), seed=0, noise=0.0):
    """A flight that rolls to and fro, its attitude read late, its gyro with an offset."""
    phase = np.random.default_rng(seed).uniform(0.0, 6.0, len(TONES))
    roll = sum(0.05 * np.sin(w * (T - late_s) + p) for w, p in zip(TONES, phase, strict=True))
    rate = sum(0.05 * w * np.cos(w * T + p) for w, p in zip(TONES, phase, strict=True))
    rng = np.random.default_rng(seed + 100)
    q = {"q_w": np.cos(0.5 * roll), "q_x": np.sin(0.5 * roll)}
    gyro = {
        name: b + noise * rng.standard_normal(len(T))
        for name, b in zip(BODY_RATE, bias, strict=True)
    }
    gyro["omega_x_rad_s"] = gyro["omega_x_rad_s"] + rate
    return hovering(DURATION_S, **q, **gyro)


@pytest.mark.parametrize("late_s", [0.0, 0.013, 0.047, -0.032])
def test_a_late_attitude_is_found_to_a_fraction_of_a_sample(late_s):
    found = pose_delay([_turning(late_s, seed=k, noise=0.02) for k in range(3)])
    assert found.stream == "attitude"
    assert found.delay_s == pytest.approx(late_s, abs=0.0015)
    assert found.sd_s < 0.002 and found.correlation > 0.9


def test_delays_of_flights_that_differ_are_as_doubtful_as_they_scatter():
    found = pose_delay([_turning(s, seed=k) for k, s in enumerate((0.02, 0.04, 0.06))])
    assert found.delay_s == pytest.approx(0.04, abs=0.01)
    assert 0.007 < found.sd_s < 0.02


def _answering(seed):
    """A hover that nothing moves but a controller which answers the noise of its gyro."""
    noise = 0.02 * np.random.default_rng(seed).standard_normal(len(T))
    rate = np.zeros(len(T))
    # dw/dt = -k (w + n), a rotor lag of 30 ms behind it
    asked, step_s = 0.0, T[1] - T[0]
    for k in range(1, len(T)):
        asked += step_s / 0.03 * (-6.0 * (rate[k - 1] + noise[k - 1]) - asked)
        rate[k] = rate[k - 1] + step_s * asked
    roll = np.cumsum(rate) * step_s
    q = {"q_w": np.cos(0.5 * roll), "q_x": np.sin(0.5 * roll)}
    return hovering(DURATION_S, **q, omega_x_rad_s=rate + noise)


def test_noise_that_the_controller_answers_is_no_late_attitude():
    assert pose_delay([_answering(seed) for seed in range(3)]) is None


def test_flights_that_agree_by_luck_know_no_more_than_their_noise_lets_them():
    """Over many pairs of flights the errors are as large as the stated sd says, or smaller."""
    found = [
        pose_delay(
            [_turning(0.02, seed=2 * k, noise=0.25), _turning(0.02, seed=2 * k + 1, noise=0.25)]
        )
        for k in range(12)
    ]
    errors = np.array([(f.delay_s - 0.02) / f.sd_s for f in found])
    assert np.mean(errors**2) < 2.0 and np.abs(errors).max() < 3.0


@pytest.mark.filterwarnings("error")
def test_what_does_not_move_tells_no_delay():
    assert pose_delay([hovering(DURATION_S)]) is None
    assert pose_delay([]) is None
    derived = _turning(0.03).replace(derived=frozenset({"attitude"}))
    assert pose_delay([derived]) is None


def test_a_gyro_that_never_changes_has_no_delay_and_no_drift():
    stuck = hovering(DURATION_S, **dict.fromkeys(BODY_RATE, 0.1))
    stuck.update_s["gyro"] = np.inf
    assert clock_drift(stuck) == 0.0 and pose_delay([stuck]) is None


def test_a_stream_that_is_moved_back_by_its_delay_is_on_time():
    late = _turning(0.05)
    on_time = without_delay(late, "attitude", 0.05)
    inside = slice(0, -20)
    np.testing.assert_allclose(
        on_time.stack("attitude")[inside], _turning(0.0).stack("attitude")[inside], atol=1e-4
    )
    np.testing.assert_array_equal(on_time.stack("gyro"), late.stack("gyro"))
    assert abs(pose_delay([on_time]).delay_s) < 0.002


def _climbing(late_s):
    """A flight that climbs and sinks by its thrust, the rotor speeds logged late."""
    push = 0.05 * _signal(T, 1)
    climb = (np.cumsum(push) - 0.5 * push) * 0.01 * MODEL.number("gravity_m_s2")
    later = 1.0 + 0.05 * _signal(T - late_s, 1)
    speeds = MODEL.hover_rad_s * np.sqrt(later)
    asked = MODEL.hover_rad_s / 1000.0 * np.sqrt(1.0 + 0.05 * _signal(T + 0.02, 1))
    return hovering(
        DURATION_S,
        v_z_m_s=climb,
        **dict.fromkeys(ROTOR_SPEED, speeds),
        **dict.fromkeys(COMMAND, asked),
    )


@pytest.mark.parametrize("late_s", [0.05, 0.123, 0.4])
def test_late_rotor_speeds_are_found_against_the_motion(late_s):
    found = drive_delay([_climbing(late_s)], MODEL)
    assert found.delay_s == pytest.approx(late_s, abs=0.004)


def test_rotor_speeds_on_time_or_unlogged_have_no_delay():
    assert (
        drive_delay([_climbing(0.0)], MODEL) is None
        or abs(drive_delay([_climbing(0.0)], MODEL).delay_s) < 0.004
    )
    silent = _climbing(0.1).replace(columns={"v_z_m_s": T})
    assert drive_delay([silent], MODEL) is None


@pytest.mark.parametrize("held", [True, False])
def test_a_held_command_shows_a_row_later(held):
    """Speeds of a first-order motor: a command that is held acts after its row, another in it."""
    rng = np.random.default_rng(0)
    fine = 10
    u = 0.6 + 0.05 * rng.standard_normal((4, len(T)))
    late = 0 if held else fine // 2
    asked = np.repeat(u, fine, axis=1)
    asked = np.roll(asked, -late, axis=1)
    speed, now = np.empty_like(u), u[:, 0].copy()
    for row in range(len(T)):
        speed[:, row] = now
        for step in range(fine):
            now = now + (asked[:, row * fine + step] - now) * (0.001 / 0.02)
    columns = dict(zip(COMMAND, u, strict=True)) | dict(
        zip(ROTOR_SPEED, 1000.0 * speed, strict=True)
    )
    flight = hovering(DURATION_S, **columns)
    found = estimate_command_hold([flight])
    assert found.delay_rows == (0.5 if held else 0.0)
    assert found.bound_rows == 0.0
    slow = flight.replace(update_s={**flight.update_s, "command": 0.05})
    assert estimate_command_hold([slow]).bound_rows > found.bound_rows, (
        "rows without news tell nothing"
    )


def test_a_gyro_s_offset_is_found_with_the_scatter_of_flights():
    flights = [_turning(bias=(0.03, -0.01, 0.005 * k), seed=k) for k in range(3)]
    mean, sd = gyro_bias(flights)
    np.testing.assert_allclose(mean, [0.03, -0.01, 0.005], atol=1e-3)
    least = effect_table.get("gyro_bias").parameter("x_rad_s").prior.sd
    np.testing.assert_allclose(sd[:2], least, rtol=0.1)
    assert sd[2] == pytest.approx(np.hypot(least, 0.005 / np.sqrt(3.0)), rel=0.05)
    assert gyro_bias(flights[:1]) is None, "one flight has no scatter"
    mended = without_gyro_bias(flights[0], mean)
    assert mended.columns["omega_y_rad_s"].mean() == pytest.approx(0.0, abs=1e-3)
    unmeasured = hovering(**dict.fromkeys(BODY_RATE))
    assert without_gyro_bias(unmeasured, mean) is unmeasured


def _rotations(seed, count=8):
    q = np.random.default_rng(seed).standard_normal((count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_a_rotation_keeps_lengths_and_angles_and_its_opposite_undoes_it():
    q, rng = _rotations(0), np.random.default_rng(1)
    a, b = rng.standard_normal((2, 8, 3))
    told = [to_body(q, v) for v in (a, b)]
    np.testing.assert_allclose((told[0] * told[1]).sum(axis=1), (a * b).sum(axis=1))
    conjugate = q * [1.0, -1.0, -1.0, -1.0]
    np.testing.assert_allclose(to_body(conjugate, told[0]), a)
    np.testing.assert_allclose(np.cross(told[0], told[1]), to_body(q, np.cross(a, b)), atol=1e-12)


def test_rotations_after_each_other_are_their_product():
    p, q, v = _rotations(0), _rotations(1), np.random.default_rng(2).standard_normal((8, 3))
    np.testing.assert_allclose(to_body(quaternion_product(p, q), v), to_body(q, to_body(p, v)))
    east = np.array([[np.cos(0.25 * np.pi), 0.0, 0.0, np.sin(0.25 * np.pi)]])
    np.testing.assert_allclose(
        to_body(east, np.array([[0.0, 1.0, 0.0]])), [[1.0, 0.0, 0.0]], atol=1e-12
    )


def test_rates_come_back_from_the_attitude_that_they_turn():
    flight = _turning()
    q = flight.stack("attitude")
    rates = turn_rates(q, np.gradient(q, 0.01, axis=0))
    np.testing.assert_allclose(rates[2:-2], flight.stack("gyro")[2:-2], atol=2e-3)
    assert body_rates(flight) is not None and (body_rates(flight) == flight.stack("gyro")).all()
    derived = hovering(DURATION_S, **{**dict.fromkeys(BODY_RATE), "q_w": q[:, 0], "q_x": q[:, 1]})
    np.testing.assert_allclose(body_rates(derived)[20:-20], flight.stack("gyro")[20:-20], atol=0.02)
    blind = hovering(**dict.fromkeys((*BODY_RATE, *QUATERNION)))
    assert not body_rates(blind).any()


def test_the_past_of_a_row_is_itself_and_what_was_before():
    told = lag_matrix(np.array([1.0, 2.0, 3.0]), 2)
    np.testing.assert_array_equal(told, [[1.0, 0.0], [2.0, 1.0], [3.0, 2.0]])


def test_a_position_moves_as_its_velocity_and_stays_where_it_was_read():
    x = 5.0 + 2.0 * np.sin(0.4 * T)
    rng = np.random.default_rng(0)
    read = x + 0.05 * rng.standard_normal(len(T))
    flight = hovering(DURATION_S, p_x_m=read, v_x_m_s=0.8 * np.cos(0.4 * T))
    told = with_steady_position(flight).columns["p_x_m"]
    assert np.std(told - x) < 0.3 * np.std(read - x)
    exact = with_steady_position(hovering(DURATION_S, p_x_m=x, v_x_m_s=0.8 * np.cos(0.4 * T)))
    np.testing.assert_allclose(exact.columns["p_x_m"], x, atol=5e-3)
    still = dataclasses.replace(flight, flying=np.zeros(len(T), bool))
    np.testing.assert_array_equal(with_steady_position(still).columns["p_x_m"], read)


def test_a_voltage_is_as_noisy_as_its_drive():
    work = 1.0 + 0.05 * _signal(T, 3)
    sag = 16.0 - 0.02 * T - 2.0 * work
    rng = np.random.default_rng(0)
    read = sag + 0.1 * rng.standard_normal(len(T))
    speeds = dict.fromkeys(ROTOR_SPEED, MODEL.hover_rad_s * work)
    told = with_steady_voltage(hovering(DURATION_S, battery_V=read, **speeds)).columns["battery_V"]
    assert np.std(told - sag) < 0.4 * 0.1
    silent = hovering(DURATION_S, **speeds)
    assert with_steady_voltage(silent) is silent


def test_a_log_is_as_late_as_it_is_behind_its_commands_at_most():
    """Behind them by the motors' 20 ms and 60 more, or 20, and against the motion by 100."""
    late = _climbing(0.1)
    expected_s = {0.06: 0.06, 0.02: None}
    for room_s, delay_s in expected_s.items():
        asked = np.sqrt(1.0 + 0.05 * _signal(T - 0.1 + 0.02 + room_s, 1))
        asked = MODEL.hover_rad_s / 1000.0 * asked
        flight = late.replace(columns={**late.columns, **dict.fromkeys(COMMAND, asked)})
        found = drive_delay([flight], MODEL)
        assert (found and found.delay_s) == (delay_s and pytest.approx(delay_s, abs=0.003))
