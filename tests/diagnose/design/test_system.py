"""The linear system: columns are what a flight of the effect would change, nuisances are what the
file and the log leave free.
"""

import dataclasses

import numpy as np
import pytest

from ges.conventions import BODY_RATE, command, rotor_speed
from ges.diagnose.design.columns import _step_parameter, nuisances
from ges.diagnose.design.residual import residual
from ges.diagnose.design.system import (
    build,
    channels_of_any,
    half_waves,
    residuals_with,
    thrust_change,
    window_length_s,
    with_trims_of,
)
from ges.diagnose.library.candidates import Variant, amplitude_of
from ges.diagnose.prepare.align import CommandHold
from ges.diagnose.settings import settings, using
from ges.diagnose.types.model import SPEED
from ges.simulator import effects as effect_table

from ..synthetic import (
    MODEL,
    NUMBERS,
    amplitude,
    hovering,
    manoeuvre,
    nuisance,
    rows_of,
    system_of,
    times,
    windows_of,
)

COMMAND, ROTOR_SPEED = command(4), rotor_speed(4)

FORCES = ("force_x", "force_y", "force_z")


def _variant(effect, *parameters, **shape):
    return Variant(effect, shape, tuple(amplitude_of(effect, p) for p in parameters))


@pytest.mark.parametrize("earlier", [True, False])
def test_a_channel_with_gaps_has_no_endogenous_parts_earlier_or_now(earlier):
    """Of those that it has all flights have parts of the same columns."""
    start = build([manoeuvre(), manoeuvre()], MODEL, [])
    (whole, gappy), at = start.flights, start.names.index("moment_x")
    y = gappy.y.copy()
    y[5, at] = np.nan
    with_gap = dataclasses.replace(gappy, y=y, endogenous={} if earlier else gappy.endogenous)
    like = dataclasses.replace(start, flights=(whole, with_gap))
    flights = like.recordings
    if not earlier:
        gyro = flights[1].columns["omega_x_rad_s"].copy()
        like, gyro[100:120] = start, np.nan
        broken = {**flights[1].columns, "omega_x_rad_s": gyro}
        flights = [flights[0], dataclasses.replace(flights[1], columns=broken)]
    system = build(flights, MODEL, [_variant("rotor_drag", "k_kg")], like)
    first, second = (rows.endogenous for rows in system.flights)
    assert any(c == at for _, c in first) and not any(c == at for _, c in second)
    keys = {kind: list(parts) for (kind, _), parts in first.items()}
    assert second and all(list(parts) == keys[kind] for (kind, _), parts in second.items())


@pytest.mark.parametrize(
    "variant",
    [
        _variant("rotor_drag", "k_kg"),
        _variant("ground_effect", "c_a", form=3.0, amplitude=1.0, high=10.0, decay=1.0),
        _variant("cg_offset", "x_m", "y_m"),
        _variant("attitude_bias", "x_rad"),
        _variant("motor_lag", "up_s", "down_s"),
        _variant("slung_load", "mass_kg", length_m=0.5, below_m=20.0),
        _variant("rangefinder_bias", "bias_m"),
    ],
    ids=lambda variant: variant.effect,
)
def test_a_column_is_minus_the_change_of_the_residual_by_its_step(variant):
    """The Jacobian against differences of whole evaluations, in every channel that it acts on."""
    flight = manoeuvre(range_m=1.4)
    system = build([flight], MODEL, [variant])
    (rows,) = system.flights
    windows, names = windows_of(flight, half_waves(flight, system.length_s)), system.names
    neutral = {variant.effect: variant.parameters({})}
    with using({"design.instruments": False}):
        before = residual(flight, windows, MODEL, names, neutral)
    columns = [k for k, c in enumerate(system.columns) if c.variant is not None]
    assert columns
    for k in columns:
        column = system.columns[k]
        a = variant.amplitudes[column.amplitude]
        moved = {variant.effect: variant.parameters({a.parameter: a.neutral + a.step})}
        change = (before - residual(flight, windows, MODEL, names, moved)) / a.step
        for c, name in enumerate(names):
            is_moment = name.startswith("moment")
            mine = not column.part or (column.part == "moment") == is_moment
            expected = change[:, c] if mine else np.zeros(len(rows.y))
            if effect_table.get(variant.effect).feedback == "dynamic" and is_moment:
                continue  # its trim is taken out of it
            np.testing.assert_allclose(
                rows.x.of(c, [k])[:, 0], expected, atol=1e-8 * max(1.0, np.abs(change).max())
            )
    assert any(np.abs(rows.x.of(c, columns)).max() > 0.0 for c in range(len(names)))


def test_columns_of_top_speed_are_differences_of_the_vehicle_itself():
    model = dataclasses.replace(MODEL, prior_sds={SPEED: 30.0})
    flight = manoeuvre()
    system = build([flight], model, [])
    (rows,), k = system.flights, system.nuisances[SPEED]
    c = system.names.index("drive_2")
    faster = model.with_number("max_rotor_speed_rad_s", 1030.0)
    windows, names = windows_of(flight), ("drive_1", "drive_2", "drive_3", "drive_4")
    lost, other = (residual(flight, windows, m, names)[:, 1] for m in (model, faster))
    change = (lost - other) / 30.0
    np.testing.assert_allclose(rows.x.of(c, [k])[:, 0], change, atol=1e-9)
    assert rows.x.of(c, [k]).mean() == pytest.approx(MODEL.hover_rad_s / 1000.0, rel=0.05)


def test_nuisance_columns_stay_as_they_were_beside_an_effect():
    """Taken out once more, with the thrust that the effect makes, a trim would not be the same."""
    flight = manoeuvre()
    by_commands = {n: v for n, v in flight.columns.items() if n not in rotor_speed(4)}
    flights = [flight.replace(columns=by_commands)]
    before = build(flights, MODEL, [])
    after = build(flights, MODEL.with_effects({"thrust_curve": {"c": 0.8}}), [], before)
    for one, other in zip(before.flights, after.flights, strict=True):
        for c in range(len(before.names)):
            assert np.array_equal(one.x.all_of(c), other.x.all_of(c))


@pytest.mark.parametrize(
    ("effect", "values", "parameter", "step", "most"),
    [
        ("inertia", {"xx": 0.5}, "xx", 0.01, 0.05),
        # the lag moves the thrust that a trim goes with
        ("motor_lag", {"up_s": 0.06, "down_s": 0.05}, "up_s", 0.0005, 0.01),
    ],
)
def test_a_residual_is_without_the_trim_that_its_column_is_without(
    effect, values, parameter, step, most
):
    """Else a step along the column would not do what the column says."""
    flight = manoeuvre()
    by_commands = {n: v for n, v in flight.columns.items() if n not in rotor_speed(4)}
    start = build([flight.replace(columns=by_commands)], MODEL, [])
    variant = Variant(effect, {}, (amplitude_of(effect, parameter),))
    one, other = (
        build(start.recordings, MODEL.with_effects({effect: v}), [variant], start)
        for v in (values, {**values, parameter: values[parameter] + step})
    )
    c = one.names.index("moment_x")
    k = next(k for k, column in enumerate(one.columns) if column.variant is not None)
    rows = one.flights[0]
    expected = step * rows.x.of(c, [k])[:, 0]
    moved = [
        a.flights[0].y[:, c] - b.flights[0].y[:, c]
        for a, b in ((one, other), [with_trims_of(s, MODEL, start) for s in (one, other)])
    ]
    off = [np.abs(m - expected)[rows.air].max() for m in moved]
    assert off[1] < most * np.abs(expected).max() < 0.2 * off[0]


def test_residuals_with_a_model_are_those_of_its_own_system():
    flights = [manoeuvre(), manoeuvre(5.0)]
    heavier = MODEL.with_number("mass_kg", 1.1)
    system, other = (build(flights, m, []) for m in (MODEL, heavier))
    for told, rows in zip(residuals_with(system, heavier), other.flights, strict=True):
        np.testing.assert_allclose(told, rows.y)


def test_two_flights_with_different_logs_are_told_in_the_channels_that_each_has():
    blind = manoeuvre(**dict.fromkeys(BODY_RATE))
    system = build([hovering(range_m=1.5), blind], MODEL, [])
    first, second = (np.isfinite(r.y).all(axis=0) for r in system.flights)
    assert first.all() and "range" in system.names
    told = dict(zip(system.names, second, strict=True))
    assert not told["range"] and told["force_z"] and told["moment_x"]


def test_channels_in_common_keep_the_order_of_the_fullest_log():
    few = hovering(**dict.fromkeys(COMMAND), **dict.fromkeys(BODY_RATE))
    many = hovering(range_m=1.5)
    assert channels_of_any([few, many], MODEL) == channels_of_any([many, few], MODEL)
    assert channels_of_any([few], MODEL)[-1] == "moment_z"


def test_stated_sds_are_free_and_unstated_numbers_are_not():
    flights = [hovering(battery_V=16.0)]
    names = channels_of_any(flights, MODEL)
    usual = {f"{n.effect}.{n.parameter}": n for n in nuisances(MODEL, names, flights)}
    assert "inertia.xx" not in usual and SPEED not in usual
    sure = dataclasses.replace(
        MODEL, prior_sds={"inertia.xx": 0.1, "weak_rotor.loss_1": 0.0, SPEED: 20.0}
    )
    told = {f"{n.effect}.{n.parameter}": n for n in nuisances(sure, names, flights)}
    assert told["inertia.xx"].sd == 0.1
    assert told["inertia.xx"].step == pytest.approx(settings.statistics.clear_sds * 0.1)
    assert told[SPEED].sd == told[SPEED].step == 20.0
    assert told["weak_rotor.loss_1"].sd == 0.0 and told["weak_rotor.loss_1"].flight_sd > 0.0


def test_a_battery_that_nobody_read_has_a_level_and_a_sag_in_each_flight():
    flights = [hovering()]
    names = channels_of_any(flights, MODEL)
    free = {n.key: n for n in nuisances(MODEL, names, flights)}
    half = 0.5 * effect_table.get("thrust_scale").parameter("scale").prior.unlogged_voltage_sd
    top = MODEL.number("max_rotor_speed_rad_s")
    # by half of the variance flights of a day are alike
    assert free[SPEED].sd == free[SPEED].flight_sd == pytest.approx(half * top / np.sqrt(2.0))
    columns = build(flights, MODEL, []).flights[0].x
    keys = {c.key: k for k, c in enumerate(build(flights, MODEL, []).columns)}
    drives = [names.index(n) for n in names if n.startswith("drive")]
    for key in ("battery_sag.load_V", "battery_sag.drop_V_s"):
        sag = free[key]
        assert sag.sd == 0.0 < sag.flight_sd and sag.given["battery_sag"]["sensitivity"] == 1.0
    t_s = build(flights, MODEL, []).flights[0].windows.mean @ flights[0].t_s
    volt = -top * flights[0].columns["u_1"][0] / MODEL.number("battery_nominal_V")
    late = t_s > 1.0
    for c in drives:
        load, drop = (
            columns.of(c, [keys[f"battery_sag.{p}"]])[:, 0] for p in ("load_V", "drop_V_s")
        )
        # a sagging battery is loaded less: an eighth here
        np.testing.assert_allclose(load[late], volt, rtol=0.15)
        np.testing.assert_allclose(drop[late] / load[late], t_s[late], rtol=0.15)
    listed = nuisances(MODEL, names, [hovering(battery_V=16.0)])
    assert not {"load_V", "drop_V_s"} & {n.parameter for n in listed if n.flight_sd or n.sd}


def test_a_lever_is_doubted_by_a_share_of_the_arm():
    names, wide = channels_of_any([hovering()], MODEL), dict(NUMBERS)
    for i in range(1, 5):
        for axis in "xy":
            wide[f"rotor_{i}_{axis}_m"] = 3.0 * MODEL.number(f"rotor_{i}_{axis}_m")
    sds = [
        next(n for n in nuisances(m, names, [hovering()]) if n.parameter == "x_m")
        for m in (MODEL, dataclasses.replace(MODEL, parameters=wide))
    ]
    assert sds[1].sd == pytest.approx(3.0 * sds[0].sd)
    assert sds[1].flight_sd == pytest.approx(3.0 * sds[0].flight_sd)
    assert sds[1].step == pytest.approx(3.0 * sds[0].step)


def test_a_number_that_was_moved_keeps_its_doubt_about_the_vehicle_file():
    moved = dataclasses.replace(
        MODEL, prior_sds={"thrust_scale.scale": 0.05}, corrections={"thrust_scale.scale": 0.3}
    )
    names = channels_of_any([hovering()], MODEL)
    found = next(n for n in nuisances(moved, names, [hovering()]) if n.effect == "thrust_scale")
    assert found.mean == pytest.approx(-0.3) and found.sd == 0.05


def test_what_was_not_logged_frees_no_number_that_only_it_shows():
    derived = hovering().replace(derived=frozenset({"attitude"}))
    unmeasured = hovering(**dict.fromkeys(ROTOR_SPEED))
    charged = hovering(battery_V=16.0)

    def free(flight):
        names = channels_of_any([flight], MODEL)
        return {n.effect for n in nuisances(MODEL, names, [flight])}

    def parameters(flight):
        listed = nuisances(MODEL, channels_of_any([flight], MODEL), [flight])
        return {n.parameter for n in listed if n.effect == "battery_sag"}

    assert "attitude_bias" in free(hovering()) and "attitude_bias" not in free(derived)
    assert "thrust_curve" in free(unmeasured), "it makes the speeds"
    assert "sensitivity" in parameters(charged) and "sensitivity" not in parameters(hovering())


def _delay_of_two_poles_s():
    """Delay that stands for two poles alike: the mean of their impulse response less its sd."""
    a, t_s = 0.5 * MODEL.number("motor_time_constant_s"), np.linspace(0.0, 1.0, 100_001)
    h = t_s * np.exp(-t_s / a)
    mean_s = (t_s @ h) / h.sum()
    return mean_s - np.sqrt(((t_s - mean_s) ** 2 @ h) / h.sum())


def test_a_delay_is_as_doubtful_as_commands_are_held_and_a_second_pole_is_late():
    names = channels_of_any([hovering()], MODEL)

    def prior_sd(flight):
        (found,) = (n for n in nuisances(MODEL, names, [flight]) if n.effect == "esc_delay")
        return found.sd

    own = effect_table.get("esc_delay").parameter("delay_s").prior.sd
    certain = settings.statistics.certain_sds
    pole = _delay_of_two_poles_s() / certain
    assert prior_sd(hovering()) == pytest.approx(np.hypot(own, pole), rel=1e-4)
    held = hovering().replace(command_hold=CommandHold(0.5, 0.4))
    assert prior_sd(held) == pytest.approx(
        np.sqrt(own**2 + pole**2 + (0.4 * 0.01 / certain) ** 2), rel=1e-4
    )


def test_windows_are_as_long_as_the_slowest_stream_asks():
    flight = hovering()
    assert window_length_s([flight]) == settings.design.window_shortest_s
    slow = flight.replace(update_s={**flight.update_s, "attitude": 0.1})
    assert window_length_s([flight, slow]) == pytest.approx(settings.design.window_updates * 0.1)
    never = flight.replace(update_s={**flight.update_s, "command": np.inf})
    assert window_length_s([never]) == settings.design.window_shortest_s


@pytest.mark.parametrize(("update_s", "count"), [(0.01, 3), (0.03, 2), (0.05, 1), (0.07, 0)])
def test_half_waves_are_as_many_as_the_slowest_stream_can_follow(update_s, count):
    flight = hovering()
    slow = flight.replace(update_s={**flight.update_s, "rotor_speed": update_s})
    assert half_waves(slow, 0.2) == count


def test_unrest_is_the_change_of_thrust_between_two_readings_over_the_weight():
    flight, t = hovering(), times()
    slow = flight.replace(update_s={**flight.update_s, "rotor_speed": 0.05})
    thrust = MODEL.weight_N * (1.0 + 0.3 * t)
    for told, every_s in ((flight, 0.01), (slow, 0.05)):
        found = thrust_change(told, windows_of(flight), MODEL, thrust)
        np.testing.assert_allclose(found, 0.3 * every_s)


def test_parts_split_a_column_between_forces_and_moments_and_lose_nothing():
    names = ("force_x", "moment_y", "acc_z")
    whole = {0: np.ones(3), 1: 2.0 * np.ones(3), 2: 3.0 * np.ones(3)}
    force, moment = (amplitude("rotor_drag.k_kg", part) for part in ("force", "moment"))
    assert set(force.own_changes(whole, names)) == {0, 2}
    assert set(moment.own_changes(whole, names)) == {1}
    assert amplitude("rotor_drag.k_kg").own_changes(whole, names) is whole
    assert force.recipe == moment.recipe and force.key == moment.key == "rotor_drag.k_kg"


def test_a_cushion_a_drag_and_an_inflow_have_moments_of_their_own():
    flight = [hovering()]
    drag, inflow = _variant("rotor_drag", "k_kg"), _variant("axial_inflow", "k_kg")
    parts = [c.part for c in build(flight, MODEL, [drag, inflow]).columns if c.variant]
    assert parts == ["force", "moment", "force", "moment"]
    silent = dataclasses.replace(MODEL, stated_parts=frozenset())
    parts = [c.part for c in build(flight, silent, [drag]).columns if c.variant]
    assert parts == [""], "no moment is heard"
    cushion = _variant("ground_effect", "c_a", form=3.0, amplitude=1.0, decay=1.0)
    lever = _variant("ground_effect_moment", "q")
    parts = [c.part for c in build(flight, MODEL, [cushion, lever]).columns if c.variant]
    assert parts == ["force", ""], "its moment is free beside it"


def test_a_gain_of_the_moment_is_of_one_column_with_the_force():
    shape = {"form": 3.0, "amplitude": 1.0, "high": 10.0, "decay": 0.5}
    flight, plain = manoeuvre(), _variant("ground_effect", "c_a", **shape)
    twice = dataclasses.replace(plain, moment_gain=2.0)
    parts, whole = build([flight], MODEL, [plain]), build([flight], MODEL, [twice])
    force, moment = (k for k, c in enumerate(parts.columns) if c.variant)
    (both,) = (k for k, c in enumerate(whole.columns) if c.variant)
    count = len(parts.main)
    one, other = parts.flights[0], whole.flights[0]
    got = other.weighted_columns({both: 1.0}, count)
    expected = one.weighted_columns({force: 1.0, moment: 2.0}, count)
    np.testing.assert_allclose(got, expected)
    acts = {c for c, column in zip(parts.main, got.T, strict=True) if np.nanmax(np.abs(column)) > 0}
    assert {"force_z", "moment_y"} <= acts


def test_columns_are_about_the_effect_that_is_on():
    """With a drag in the file, the column of its amplitude moves that drag and adds no other."""
    on = MODEL.with_effects({"rotor_drag": {"k_kg": 2e-4}})
    flight, variant = manoeuvre(), _variant("rotor_drag", "k_kg")
    system = build([flight], on, [variant])
    k = next(k for k, c in enumerate(system.columns) if c.variant and c.part == "force")
    step = variant.amplitudes[0].step
    more = on.with_effects({"rotor_drag": {"k_kg": 2e-4 + step}})
    windows = windows_of(flight)
    change = (residual(flight, windows, on, FORCES) - residual(flight, windows, more, FORCES)) / (
        step
    )
    for c, name in enumerate(FORCES):
        told = system.flights[0].x.of(system.names.index(name), [k])[:, 0]
        np.testing.assert_allclose(told, change[:, c], atol=1e-6)


def test_rows_follow_each_other_within_a_stretch_alone():
    rows = rows_of(np.zeros((6, 1)))
    assert rows.follows.tolist() == [False] + [True] * 5
    gap = dataclasses.replace(
        rows,
        windows=rows.windows.select(np.array([True, True, False, True, True, True])),
    )
    assert gap.follows.tolist() == [False, True, False, True, True]


def test_columns_add_up_and_are_absent_where_the_channel_is():
    y = np.array([[0.0, np.nan], [0.0, 0.0]])
    rows = rows_of(y, [{0: np.array([1.0, 2.0])}, {0: np.ones(2), 1: np.array([5.0, 6.0])}])
    np.testing.assert_array_equal(
        rows.weighted_columns({0: 2.0, 1: -1.0}, 2), [[1.0, np.nan], [3.0, -6.0]]
    )
    np.testing.assert_array_equal(rows.mean_columns([0, 1], [0, 1]), [[1.5, 1.0], [0.0, 5.5]])


def test_means_are_of_the_air_alone():
    air = np.array([False, True, True])
    rows = rows_of(np.array([[9.0], [1.0], [2.0]]), [{0: np.array([9.0, 3.0, 5.0])}], air)
    assert rows.in_air([0]).ravel().tolist() == [1.0, 2.0]
    assert rows.mean_columns([0], [0]).tolist() == [[4.0]]


def test_a_system_knows_its_plain_channels_nuisances_and_blocks():
    columns = [nuisance("thrust_scale.scale", 0.1), amplitude("rotor_drag.k_kg")]
    names = ("force_z", "moment_x", "moment_x/1")
    flights = [rows_of(np.zeros((60, 3)), start_s=s) for s in (0.0, 500.0)]
    system = system_of(names, columns, flights)
    assert system.main == ("force_z", "moment_x")
    assert system.nuisances == {"thrust_scale.scale": 0}
    one, two = system.blocks(2.5)
    assert set(one) == {0, 1, 2} and set(two) == {3, 4, 5}
    assert system.recordings == [r.flight for r in flights]


@pytest.mark.parametrize(("at", "step"), [(-0.7, -0.3), (3.0, 0.3), (-0.6, -0.3)])
def test_a_column_at_an_end_of_its_range_steps_inward(at, step):
    """A recalibration may have left a number there."""
    model = MODEL.with_effects({"inertia": {"xx": 0.0, "yy": 0.0, "zz": at}})
    stepped, taken = _step_parameter(model, "inertia", {}, "zz", step)
    assert taken == -step and stepped["inertia"]["zz"] == pytest.approx(at - step)


@pytest.mark.parametrize(("at", "taken"), [(0.06, 0.44), (0.3, -0.5)])
def test_a_step_longer_than_either_room_ends_at_the_farther_bound(at, taken):
    """Levels of a lag are multiples of the nominal one, which a slow motor has long."""
    model = MODEL.with_effects({"motor_lag": {"up_s": at, "down_s": at}})
    stepped, step = _step_parameter(model, "motor_lag", {}, "down_s", 0.6)
    assert step == pytest.approx(taken)
    assert stepped["motor_lag"]["down_s"] == pytest.approx(at + taken)


def test_a_lag_is_doubtful_by_what_a_command_does_between_two_rows():
    flights = [hovering()]
    by_sd = {}
    for sd in (0.0, 1e-3):
        model = dataclasses.replace(MODEL, prior_sds={"motor_lag.up_s": sd, "motor_lag.down_s": sd})
        found = {n.key: n.sd for n in nuisances(model, ("drive_1",), flights)}
        by_sd[sd] = found.get("motor_lag.up_s")
    pole_s = _delay_of_two_poles_s() / settings.statistics.certain_sds
    # uniform over a row of 10 ms
    assert by_sd[1e-3] == pytest.approx(np.sqrt(1e-3**2 + 0.01**2 / 12.0 + pole_s**2), rel=1e-4)
    assert by_sd[0.0] is None, "what a file knows exactly stays so"
