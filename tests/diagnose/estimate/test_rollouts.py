"""Rollouts: pieces of a flight flown again, each from where the recording was."""

import dataclasses

import numpy as np
import pytest

from ges.conventions import VELOCITY, command, rotor_speed
from ges.diagnose.estimate.shoot import (
    can_roll_out,
    fly_rollouts,
    rollout_starts,
    with_rollout_path,
)

from ..synthetic import MODEL, NUMBERS, hovering, times

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)


def test_a_rollout_needs_a_place_a_motion_and_a_drive():
    undriven = dict.fromkeys((*ROTOR_SPEED, *COMMAND))
    assert can_roll_out(hovering()) and can_roll_out(hovering(**dict.fromkeys(ROTOR_SPEED)))
    assert not can_roll_out(hovering(**undriven)) and not can_roll_out(
        hovering(**dict.fromkeys(VELOCITY))
    )
    assert not can_roll_out(hovering(p_x_m=None)) and not can_roll_out(hovering(q_w=None))


def test_horizons_follow_each_other_where_all_of_one_flies():
    flight = hovering()
    assert rollout_starts(flight, 100).tolist() == [0, 100, 200]
    flying = flight.flying.copy()
    flying[150] = False
    assert rollout_starts(flight.replace(flying=flying), 100).tolist() == [0, 200]
    assert not len(rollout_starts(flight, 1000))


def test_a_hover_stands_still():
    rolled = fly_rollouts(hovering(), MODEL, 100)
    assert len(rolled.flown) == 3
    for record in rolled.flown:
        np.testing.assert_allclose(record["p_z_m"], 1.5, atol=1e-6)
        np.testing.assert_allclose(record["v_x_m_s"], 0.0, atol=1e-6)
        assert record["t_s"][-1] - record["t_s"][0] == pytest.approx(1.0, abs=0.011)


def test_a_heavier_vehicle_falls_as_far_as_its_weight_says():
    heavy = dataclasses.replace(MODEL, parameters={**NUMBERS, "mass_kg": 1.1})
    record = fly_rollouts(hovering(), heavy, 100).flown[0]
    fall = MODEL.number("gravity_m_s2") * (1.0 - 1.0 / 1.1)
    t = record["t_s"] - record["t_s"][0]
    np.testing.assert_allclose(record["p_z_m"], 1.5 - 0.5 * fall * t**2, atol=2e-3)
    np.testing.assert_allclose(record["v_z_m_s"], -fall * t, atol=1e-3)


def test_every_piece_starts_from_the_recording():
    t = times()
    flight = hovering(p_x_m=0.7 * t, v_x_m_s=0.7)
    rolled = fly_rollouts(flight, MODEL, 100)
    assert rolled.starts.tolist() == [0, 100, 200]
    for start, record in zip(rolled.starts[1:], rolled.flown[1:], strict=True):
        late_s = record["t_s"] - record["t_s"][0]
        np.testing.assert_allclose(record["p_x_m"], 0.7 * (t[start] + late_s), atol=1e-6)


def test_the_shot_path_is_the_flown_one_and_the_recorded_one_where_none_is_flown():
    flying = np.ones(400, bool)
    flying[:150] = False
    flight = hovering().replace(flying=flying)
    heavy = dataclasses.replace(MODEL, parameters={**NUMBERS, "mass_kg": 1.1})
    path = with_rollout_path(flight, heavy).path
    assert set(path) == {"p_x_m", "p_y_m", "p_z_m", *VELOCITY}
    np.testing.assert_allclose(path["p_z_m"][:150], 1.5)
    fall = MODEL.number("gravity_m_s2") * (1.0 - 1.0 / 1.1)
    (first, *_) = rollout_starts(flight, 20)
    clock = 0.01 * np.arange(20)
    np.testing.assert_allclose(path["v_z_m_s"][first : first + 20], -fall * clock, atol=1e-3)
    same = with_rollout_path(flight, MODEL).path
    np.testing.assert_allclose(same["p_z_m"], 1.5, atol=1e-6)


def test_a_slow_drive_or_no_place_leaves_the_recorded_path():
    flight = hovering()
    slow = flight.replace(update_s={**flight.update_s, "rotor_speed": 0.2})
    assert with_rollout_path(slow, MODEL) is slow
    blind = hovering(p_x_m=None)
    assert with_rollout_path(blind, MODEL) is blind
