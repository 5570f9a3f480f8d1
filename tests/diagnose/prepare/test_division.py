"""Which flights are held out, how long ones are cut, and channels of a log."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.conventions import BODY_RATE, VELOCITY, command, rotor_speed
from ges.diagnose.prepare.channels import ACC, FORCE, MOMENT, channels, drive
from ges.diagnose.prepare.gate import (
    Gate,
    with_flown_voltage,
    with_stated_voltage,
    with_thrust_direction,
)
from ges.diagnose.prepare.kinematics import to_body
from ges.diagnose.prepare.problem import Problem
from ges.diagnose.prepare.split import cut, digest, split
from ges.errors import GesError
from ges.vehicle.file import Estimate

from ..synthetic import MODEL, hovering, times

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)


@given(st.sets(st.integers(0, 30), min_size=0, max_size=12), st.integers(0, 99))
def test_a_quarter_is_held_out_and_no_flight_is_lost(usable, seed):
    usable = sorted(usable)
    digests = [f"{v:x}" for v in np.random.default_rng(seed).integers(0, 2**60, 31)]
    train, held = split(digests, usable, None)
    assert sorted([*train, *held]) == usable
    assert len(held) == (max(1, len(usable) // 4) if len(usable) > 1 else 0)


def test_what_is_held_out_depends_on_the_flights_and_not_on_their_order():
    digests = ["c", "a", "d", "b", "f", "e", "h", "g"]
    _, held = split(digests, range(8), None)
    order = [3, 1, 7, 0, 2, 6, 4, 5]
    _, other = split([digests[i] for i in order], range(8), None)
    assert {digests[i] for i in held} == {digests[order[i]] for i in other} == {"a", "b"}


def test_a_request_is_met_among_the_flights_of_use():
    assert split(list("abcd"), [0, 2, 3], [2, 1]) == ([0, 3], [2])
    assert split(list("ab"), [0, 1], []) == ([0, 1], [])


def test_a_digest_is_of_the_numbers_and_not_of_the_order_of_columns():
    frame = pd.DataFrame({"t_s": [0.0, 1.0], "u_1": [0.5, 0.6]})
    assert digest(frame) == digest(frame[["u_1", "t_s"]])
    assert digest(frame) != digest(frame.assign(u_1=[0.5, 0.6000001]))


def _frame(duration_s):
    return pd.DataFrame({"t_s": times(duration_s), **hovering(duration_s).columns})


@pytest.mark.parametrize(("duration_s", "count"), [(8.0, 2), (13.0, 2), (19.0, 3), (60.0, 4)])
def test_a_long_recording_is_cut_into_parts_that_fly_as_long(duration_s, count):
    frame = _frame(duration_s)
    parts = cut("log", frame, MODEL)
    assert [name for name, _ in parts] == [f"log_part{k}" for k in range(1, count + 1)]
    lengths = [len(part) for _, part in parts]
    assert sum(lengths) == len(frame) and np.ptp(lengths) <= 0.1 * len(frame)
    np.testing.assert_array_equal(np.concatenate([p["t_s"] for _, p in parts]), frame["t_s"])


def test_a_short_recording_is_not_cut_but_said():
    with pytest.raises(GesError, match=r"log is 5.0 s in the air; .* takes 6 s or more"):
        cut("log", _frame(5.0), MODEL)


def _lacking(*names):
    full = hovering(range_m=1.5, **{f"{a}_m_s2": 0.0 for a in ACC})
    return full.replace(columns={n: v for n, v in full.columns.items() if n not in names})


@pytest.mark.parametrize(
    ("flight", "expected"),
    [
        (_lacking(), (*FORCE, *ACC, *MOMENT, *drive(4), "range")),
        (_lacking(*COMMAND), (*FORCE, *ACC, *MOMENT, "range")),
        (_lacking(*COMMAND, *ROTOR_SPEED), ("range",)),
        (_lacking(*VELOCITY), (*ACC, *MOMENT, *drive(4), "range")),
        (_lacking("q_w"), (*ACC, *MOMENT, *drive(4))),
        (_lacking("q_w", *BODY_RATE, "acc_x_m_s2"), (*ACC[1:], *drive(4))),
        (_lacking("range_m"), (*FORCE, *ACC, *MOMENT, *drive(4))),
        (
            _lacking().replace(derived=frozenset({"attitude"})),
            ("force_z", *ACC, *MOMENT, *drive(4), "range"),
        ),
    ],
)
def test_a_log_speaks_about_what_it_holds(flight, expected):
    assert channels(flight, MODEL) == expected


def test_moments_are_heard_where_the_file_states_what_they_turn():
    bare = dataclasses.replace(MODEL, stated_parts=frozenset())
    assert not set(MOMENT) & set(channels(hovering(), bare))
    some = dataclasses.replace(MODEL, stated_parts=frozenset({"moments_of_inertia"}))
    assert set(MOMENT) & set(channels(hovering(), some)) == set(MOMENT[:2])


@pytest.mark.parametrize("yaw_rad", [0.0, 0.9])
def test_thrust_points_where_the_acceleration_says(yaw_rad):
    """A push to the east and half as much to the south leans the thrust axis there."""
    t = times()
    flight = hovering(v_x_m_s=0.2 * 9.80665 * t, v_y_m_s=-0.1 * 9.80665 * t, q_w=None)
    frame = pd.DataFrame({"t_s": t, "yaw_rad": np.full(len(t), yaw_rad)})
    told = with_thrust_direction(flight, frame)
    assert told.derived == {"attitude"} and told.update_s["attitude"] > flight.update_s["gyro"]
    q = told.stack("attitude")[100:300]
    push = np.array([0.2, -0.1, 1.0]) / np.sqrt(0.2**2 + 0.1**2 + 1.0)
    np.testing.assert_allclose(
        to_body(q, np.tile(push, (200, 1))), np.tile([0, 0, 1.0], (200, 1)), atol=1e-3
    )
    nose = to_body(q * [1.0, -1.0, -1.0, -1.0], np.tile([1.0, 0.0, 0.0], (200, 1)))
    assert np.arctan2(nose[:, 1], nose[:, 0]) == pytest.approx(np.full(200, yaw_rad), abs=0.03)
    assert with_thrust_direction(hovering(), frame).derived == frozenset()


def test_the_usual_voltage_is_what_was_flown_unless_the_file_models_it():
    flights = [hovering(battery_V=15.0), hovering(battery_V=13.0), hovering()]
    assert with_flown_voltage(MODEL, flights).number("battery_nominal_V") == 14.0
    sagging = MODEL.with_effects({"battery_sag": {"sensitivity": 1.0}})
    assert with_flown_voltage(sagging, flights) is sagging
    assert with_flown_voltage(MODEL, [hovering()]) is MODEL
    flying = np.arange(400) < 100
    volts = np.where(flying, 15.0, 9.0)
    landed = hovering(battery_V=volts).replace(flying=flying)
    assert with_flown_voltage(MODEL, [landed]).number("battery_nominal_V") == 15.0


def test_a_problem_knows_which_flights_it_fits():
    a, b = hovering(), hovering(5.0)
    posed = Problem(None, MODEL, Gate({}, (), ()), {"one": a}, {"two": b}, {}, ())
    assert posed.train == [a] and posed.flights == [a, b]


def test_a_file_states_the_voltage_from_which_a_sensitivity_counts():
    """About a median of 3.7 V it would be nonsense from the simulator's usual 16 V."""
    effects = {
        "battery_sag": {"sensitivity": Estimate(value=0.9)},
        "rotor_drag": {"k_kg": Estimate(value=1e-4)},
    }
    model = MODEL.with_number("battery_nominal_V", 3.7)
    stated = with_stated_voltage(effects, model)
    assert stated["battery_sag"]["nominal_V"].value == 3.7
    assert stated["battery_sag"]["sensitivity"].value == 0.9
    assert stated["rotor_drag"] == effects["rotor_drag"]
    again = with_stated_voltage(stated, MODEL.with_number("battery_nominal_V", 4.1))
    assert again == stated, "what a file states already stays"
