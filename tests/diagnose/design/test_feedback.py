"""What a controller may have done to columns: endogenous without instruments, explained by
them.
"""

import numpy as np
import pytest

from ges.diagnose.design.feedback import (
    OWN_MOMENT,
    FlightInstruments,
    _are_strong,
    endogenous_parts,
    feedback_of,
    flight_instruments,
    instrument_strengths,
    merge_endogenous_parts,
    moves_a_speed,
    near_ground_gain,
)
from ges.diagnose.design.instruments import directions
from ges.diagnose.design.table import table_of

from ..synthetic import MODEL, hovering, made, windows_of

COUNT, LENGTH_S = 600, 0.2
T = 0.1 * np.arange(COUNT)
THRUST = 10.0 + np.sin(0.3 * T) + np.sin(9.0 * T)
AIR = np.ones(COUNT, bool)


def _told(names, strong=0.0, z=None):
    """What instruments say: nothing, or as ``strong`` as given by the columns ``z`` (m, k)."""
    spanned = {} if z is None else dict.fromkeys(names, directions(z))
    return FlightInstruments(spanned, dict.fromkeys(names, THRUST), dict.fromkeys(names, strong))


def _endogenous(keys, names, columns, told=None, air=AIR, **more):
    x = table_of([dict.fromkeys(range(len(names)), c) for c in columns], COUNT, len(names))
    return made(
        endogenous_parts(
            keys, x, LENGTH_S, dict(enumerate(names)), told or _told(names), air, **more
        )
    )


def test_how_the_controller_shows_is_what_the_descriptor_says():
    assert feedback_of("motor_lag.up_s") == "dynamic" and feedback_of("rotor_drag.k_kg") == "none"
    assert feedback_of("vehicle.max_rotor_speed_rad_s") == "none"
    assert near_ground_gain("ground_effect.c_a") and near_ground_gain("fountain_lift.c_b")
    assert not near_ground_gain("thrust_scale.scale"), "it does not depend on the height"
    assert not near_ground_gain("nothing.known")


def test_what_no_controller_moves_is_never_loose():
    assert not _endogenous(
        ("rotor_tilt.x_rad", "cg_offset.x_m"), ("force_x", "moment_x"), [THRUST] * 2
    )


def test_strong_instruments_vouch_for_what_they_explain():
    known, rest = np.sin(0.5 * T), np.sin(9.0 * T)
    z = np.column_stack([known])
    names = ("moment_x",)
    (part,) = _endogenous(("motor_lag.up_s",), names, [known + rest], _told(names, 0.9, z)).values()
    left = part["motor_lag.up_s"]
    assert abs(left @ known) < 1e-9 * COUNT
    assert np.corrcoef(left, rest)[0, 1] > 0.99


def test_weak_instruments_vouch_for_nothing():
    known, names = np.sin(0.5 * T), ("moment_y",)
    for z, left in ((known[:, None], 0.0), (None, 1.0)):
        (part,) = _endogenous(("motor_lag.up_s",), names, [known], _told(names, 0.5, z)).values()
        assert np.abs(part["motor_lag.up_s"]).max() == pytest.approx(left, abs=1e-2)


def test_instruments_are_strong_by_their_f_statistic():
    """Of one, and 102 windows of which every second is independent, F is 50 s / (1 - s)."""
    one = directions(np.sin(np.arange(102.0))[:, None])
    strong = 10.0 / 60.0
    assert _are_strong(strong + 0.01, one) and not _are_strong(strong - 0.01, one)
    many = directions(np.random.default_rng(0).standard_normal((102, 20)))
    assert not _are_strong(0.5, many), "many predict much by chance"


def test_of_a_gain_what_it_does_by_fast_changes_of_thrust_is_loose():
    """Slow changes of thrust carry a height; the gain's force is that share of them."""
    gain = 0.1 * THRUST
    found = _endogenous(("thrust_scale.scale",), ("force_z",), [gain])
    part, middle = found["thrust_gain", 0]["thrust_scale.scale"], slice(60, -60)
    np.testing.assert_allclose(part[middle], 0.1 * np.sin(9.0 * T)[middle], atol=0.01)


def test_of_a_cushion_s_moment_what_changes_is_loose_and_of_another_gain_s_nothing():
    """While it is searched, the moment of the gain counts in full."""
    x = 3.0 + np.sin(T)
    keys = (f"ground_effect.c_a{OWN_MOMENT}", "thrust_scale.scale", "ground_effect.c_a")
    found = _endogenous(keys, ("moment_x",), [x, x, x])
    part = found["thrust_gain", 0]
    np.testing.assert_allclose(part[keys[0]], x - x.mean())
    np.testing.assert_array_equal(part["thrust_scale.scale"], 0.0)
    np.testing.assert_array_equal(part["ground_effect.c_a"], 0.0)


def test_a_rangefinder_s_scale_is_loose_where_heights_change():
    x = 1.5 + 0.3 * np.sin(T)
    found = _endogenous(("rangefinder_bias.scale",), ("range", "force_z"), [x])
    assert set(found) == {("height", 0)}
    np.testing.assert_allclose(found["height", 0]["rangefinder_bias.scale"], x - x.mean())


@pytest.mark.parametrize("measured", [True, False])
def test_a_rotor_in_yaw_is_loose_under_faster_functions_where_no_turning_was_measured(measured):
    names = ("moment_z", "moment_z/1")
    x = 2.0 + np.sin(T)
    found = _endogenous(("weak_rotor.loss_2",), names, [x], rates_measured=measured)
    assert set(found) == (set() if measured else {("rotor", 1)})


def test_shapes_of_one_parameter_are_loose_alike_by_the_first():
    one, two = np.sin(T), np.cos(T)
    found = _endogenous(
        ("motor_lag.up_s", "esc_delay.delay_s", "motor_lag.up_s"), ("moment_x",), [one, two, two]
    )
    part = found["dynamic", 0]
    assert set(part) == {"motor_lag.up_s", "esc_delay.delay_s"}
    np.testing.assert_array_equal(part["motor_lag.up_s"], one)


def test_of_a_parameter_in_parts_the_one_that_acts_in_a_channel_is_endogenous_there():
    """A drag's force and moment have a coefficient each; both are of one key."""
    force, moment = 0.1 * THRUST, 3.0 + np.sin(T)
    names = ("force_z", "moment_x")
    x = table_of([{0: force}, {1: moment}], COUNT, len(names))
    keys = ("rotor_drag.k_kg",) * 2
    found = made(endogenous_parts(keys, x, LENGTH_S, dict(enumerate(names)), _told(names), AIR))
    np.testing.assert_allclose(found["motion", 1]["rotor_drag.k_kg"], moment - moment.mean())
    assert set(found) == {("motion", 1)}


@pytest.mark.parametrize("key", ["rotor_drag.k_kg", "law.moment_y: m g L (q/w_g)"])
def test_what_rates_make_of_a_moment_is_endogenous_and_of_a_force_is_not(key):
    """A gust turns the vehicle, so that damping of rates goes with the gust's moment."""
    x = 2.0 + np.sin(T)
    names = ("force_x", "force_z", "moment_y")
    found = _endogenous((key, "rotor_tilt.x_rad"), names, [x, x])
    assert set(found) == {("motion", 2)}
    assert set(found["motion", 2]) == {key}
    np.testing.assert_allclose(found["motion", 2][key], x - x.mean())


def test_on_the_ground_nothing_is_loose():
    air = T > 10.0
    told = FlightInstruments({}, {"moment_x": THRUST[air]}, {"moment_x": 0.0})
    part = _endogenous(("motor_lag.up_s",), ("moment_x",), [np.sin(T)], told, air)["dynamic", 0]
    np.testing.assert_array_equal(part["motor_lag.up_s"], np.where(air, np.sin(T), 0.0))


def test_new_parts_replace_known_ones_and_a_cushion_that_is_on_keeps_none_of_another():
    a, b = np.ones(3), np.zeros(3)
    known = {("dynamic", 0): {"motor_lag.up_s": a}, ("thrust_gain", 1): {"fountain_lift.c_b": a}}
    new = {("dynamic", 0): {"motor_lag.up_s": b, "esc_delay.delay_s": b}}
    merged = merge_endogenous_parts(known, new, ())
    assert merged["dynamic", 0]["motor_lag.up_s"] is b and len(merged) == 2
    beside = merge_endogenous_parts(known, new, ("ground_effect.c_a",))
    assert ("thrust_gain", 1) not in beside and beside["dynamic", 0]["esc_delay.delay_s"] is b
    assert merge_endogenous_parts({}, {}, ()) == {}


def test_strengths_are_means_over_the_flights_that_heard_a_channel():
    strong = {"force_z": directions(THRUST[:, None])}
    one = FlightInstruments(strong, {}, {"force_z": 0.5, "moment_x": 0.1})
    two = FlightInstruments({}, {}, {"force_z": 0.1})
    told = {
        s["channel"]: s
        for s in instrument_strengths([one, two], ("force_z", "moment_x", "moment_y"))
    }
    assert set(told) == {"force_z", "moment_x"}
    assert told["force_z"]["share"] == pytest.approx(0.3)
    assert (told["force_z"]["flights_strong"], told["force_z"]["flights"]) == (1, 2)
    assert (told["moment_x"]["flights_strong"], told["moment_x"]["flights"]) == (0, 1)


def test_what_moves_a_rotor_s_speed_is_of_its_drive():
    assert moves_a_speed("battery_sag.sensitivity") and moves_a_speed("motor_lag.up_s")
    assert moves_a_speed("vehicle.max_rotor_speed_rad_s")
    assert not moves_a_speed("weak_rotor.loss_1") and not moves_a_speed("vehicle.mass_kg")


def test_of_a_drive_what_its_neighbours_do_not_know_is_noise_of_the_commands():
    """Of every number that moves a speed, whoever answers it; a level is no noise."""
    rng = np.random.default_rng(4)
    slow, noise = np.sin(0.5 * T), rng.normal(size=COUNT)
    keys, names = ("vehicle.max_rotor_speed_rad_s", "motor_lag.up_s"), ("drive_2",)
    known = _told(names, strong=0.9, z=np.column_stack([slow]))
    (parts,) = _endogenous(keys, names, [3.0 + slow + noise] * 2, known).values()
    for key in keys:
        assert np.corrcoef(parts[key], noise)[0, 1] > 0.99
        assert abs(parts[key].mean()) < 0.1


def test_only_channels_that_are_there_and_answer_are_vouched_for():
    flight = hovering()
    names = ("force_x", "force_z", "moment_x", "drive_1")
    windows = windows_of(flight)
    y = np.zeros((len(windows), 4))
    y[3, 2] = np.nan
    told = flight_instruments(flight, windows, MODEL, names, y, flight.stack("rotor_speed"))
    assert told.strength == {"force_z": 0.0, "drive_1": 0.0}, "nothing moved"
    np.testing.assert_allclose(told.signal["force_z"], MODEL.weight_N)
