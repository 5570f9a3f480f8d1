"""Where a mismatch lives: regimes of windows, cells, and where findings act."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.diagnose.locate.regimes import (
    Cell,
    bin_edges,
    clear_structures,
    located_by_findings,
    located_by_residuals,
    regime_cells,
    regime_variables,
    strongest_entries,
    unresolved_variances,
    with_known_speeds,
)
from ges.diagnose.locate.structure import Structure
from ges.diagnose.prepare.channels import ACC, FORCE, MOMENT, drive
from ges.diagnose.prove.closed_loop import lean
from ges.diagnose.prove.traces import excluded_spans, recorded_signals, trace
from ges.diagnose.settings import settings

from ..synthetic import (
    MODEL,
    ROTOR_SPEED,
    WINDOW_S,
    hovering,
    rows_of,
    system_of,
    times,
    turned,
    windows_of,
)

COUNT = 600
HEIGHT = 7.0 - 6.0 * np.cos(2.0 * np.pi * np.arange(COUNT) / 73.0)


def test_regimes_are_the_state_at_the_middle_of_a_window():
    t, half = times(), np.sqrt(0.5)
    flight = hovering(
        v_x_m_s=3.0, v_y_m_s=4.0, v_z_m_s=0.5, p_x_m=3.0 * t, q_w=half, q_z=half, battery_V=16.0 - t
    )
    windows = windows_of(flight)
    told = regime_variables(flight, windows, MODEL)
    clock = t[windows.center]
    np.testing.assert_allclose(told["airspeed_m_s"], 5.0)
    np.testing.assert_allclose(told["climb_m_s"], 0.5)
    np.testing.assert_allclose(told["forward_m_s"], 4.0)
    np.testing.assert_allclose(told["left_m_s"], -3.0)
    np.testing.assert_allclose(told["along_thrust_m_s"], 0.5)
    np.testing.assert_allclose(told["height_over_radius"], 15.0)
    np.testing.assert_allclose(told["east_m"], 3.0 * clock)
    np.testing.assert_allclose(told["battery_V"], 16.0 - clock)
    np.testing.assert_allclose(told["time_s"], clock)


@pytest.mark.parametrize("yaw_rad", [1.0, -2.5])
def test_regimes_in_body_axes_do_not_know_where_north_is(yaw_rad):
    flight = hovering(v_x_m_s=3.0, v_y_m_s=-1.0)
    one, other = (
        regime_variables(f, windows_of(f), MODEL) for f in (flight, turned(flight, yaw_rad))
    )
    for name in ("forward_m_s", "left_m_s", "airspeed_m_s", "height_over_radius"):
        np.testing.assert_allclose(other[name], one[name], atol=1e-9)


def test_what_was_not_logged_is_no_regime():
    flight = hovering(v_x_m_s=None, p_x_m=None).replace(derived=frozenset({"attitude"}))
    told = set(regime_variables(flight, windows_of(flight), MODEL))
    assert told == {"time_s", "height_over_radius", "yaw_rate_rad_s"}
    still = hovering(v_x_m_s=None, p_x_m=None, omega_z_rad_s=None)
    still = still.replace(derived=frozenset({"attitude"}))
    told = set(regime_variables(still, windows_of(still), MODEL))
    assert told == {"time_s", "height_over_radius"}


def test_rows_leave_open_what_their_readings_differ_by():
    """One rotor turns faster for one row, as a controller asks at a new set-point. What acted in a
    row is anything between the readings at its ends.
    """
    kick = 1.0 + 0.3 * (np.arange(len(times())) == 200)
    flight = hovering(rotor_speed_1_rad_s=MODEL.hover_rad_s * kick)
    windows, names = windows_of(flight), (*FORCE, *ACC, *MOMENT, *drive(4))
    system = SimpleNamespace(
        model=MODEL, main=names, flights=[SimpleNamespace(flight=flight, windows=windows)]
    )
    (variances,) = unresolved_variances(system)
    thrust_N = 0.25 * MODEL.weight_N * kick**2
    at = np.random.default_rng(1).random((4000, len(kick) - 1))
    acted_N = thrust_N[:-1] + np.diff(thrust_N) * at
    expected = (acted_N @ windows.mean[:, :-1].T).var(axis=0)
    around = np.abs(windows.center - 200) <= 10
    force, acc = (variances[:, names.index(n)] for n in ("force_z", "acc_z"))
    np.testing.assert_allclose(force[around], expected[around], rtol=0.1)
    np.testing.assert_array_equal(acc, force)
    assert not variances[~around].any()
    assert not variances[:, [names.index(n) for n in (*drive(4), "force_x")]].any()
    assert variances[around][:, names.index("moment_z")].max() > 0.0


def test_speeds_before_the_first_command_are_forgotten_where_none_were_logged():
    """The drive of a log that begins in the air starts where its first command has it."""
    logged, alone = hovering(), hovering(**dict.fromkeys(ROTOR_SPEED))
    flights = [SimpleNamespace(flight=f, windows=windows_of(f)) for f in (logged, alone)]
    residuals = [np.zeros((len(f.windows.center), 2)) for f in flights]
    system = SimpleNamespace(model=MODEL, flights=flights)
    with_speeds, by_commands = with_known_speeds(residuals, system)
    np.testing.assert_array_equal(with_speeds, residuals[0])
    left_out = np.isnan(by_commands).all(axis=1)
    np.testing.assert_array_equal(left_out, np.isnan(by_commands).any(axis=1))
    starts_s = flights[1].windows.center_s - 0.5 * flights[1].windows.length_s
    share = np.exp(-(starts_s - alone.t_s[0]) / MODEL.number("motor_time_constant_s"))
    assert 0 < left_out.sum() < 5
    np.testing.assert_array_equal(left_out, share >= settings.decide.least_thrust_share)


@pytest.mark.parametrize("shape", [1.0, 5.0])
def test_bins_hold_as_many_windows_each(shape):
    values = np.random.default_rng(0).random(300) ** shape
    limits = bin_edges(values)
    count, _ = np.histogram(values, limits)
    assert len(limits) == settings.report.bins + 1
    assert count.sum() == 300 and np.ptp(count) <= 1
    assert len(bin_edges(np.ones(50))) == 1, "what does not vary has no bins"


def _system(y, names=("force_z", "moment_x")):
    return system_of(names, (), [rows_of(y)])


def _planted(size=0.5):
    """Residuals that are large below three radii, along thrust alone."""
    rng = np.random.default_rng(0)
    e = 0.05 * rng.standard_normal((COUNT, 2))
    e[:, 0] += np.where(HEIGHT < 3.0, size, 0.0)
    return e


CLEAR = Structure("force_z", ("height_over_radius",), (1.0,), (3.0,), 0.8, 0.002, 0.2)


def test_cells_are_means_of_bins_with_errors_over_blocks_of_time():
    e = _planted()
    made = regime_cells(_system(e), [e], [{"height_over_radius": HEIGHT}], [CLEAR])
    first = made[0]
    assert first.channel == "force_z" and first.low == pytest.approx(1.0, abs=0.01)
    inside = first.high >= HEIGHT
    assert first.mean == pytest.approx((e - e.mean(axis=0))[inside, 0].mean(), abs=0.02)
    shares = [c.share for c in made if c.channel == "force_z"]
    assert sum(shares) == pytest.approx(1.0) and max(shares) == first.share
    assert first.q_value == CLEAR.q_value
    assert all(c.q_value == 1.0 for c in made if c.channel == "moment_x")
    assert [c.windows for c in made[:6]] == pytest.approx([100] * 6, abs=8)


def test_a_cell_s_error_is_that_of_its_blocks_of_time():
    """Windows that are alike within a block are one piece of news, however many they are."""
    (block,) = _system(np.zeros((COUNT, 2))).blocks(settings.statistics.block_s)
    level = np.random.default_rng(3).standard_normal(block.max() + 1)
    e = np.column_stack([level[block], np.zeros(COUNT)])
    made = regime_cells(_system(e), [e], [{"climb_m_s": (block % 3).astype(float)}], [])
    (cell,) = (c for c in made if c.channel == "force_z" and c.low <= 1.0 < c.high)
    assert cell.windows == 200
    assert cell.sd == pytest.approx(np.std(level[[1, 4, 7, 10]], ddof=1) / 2.0)


def test_neighbouring_cells_of_one_sign_are_one_entry():
    e = _planted()
    system = _system(e)
    made = regime_cells(system, [e], [{"height_over_radius": HEIGHT}], [CLEAR])
    entries = located_by_residuals(made, [CLEAR], system)
    low, high = entries[0]["regime"]["height_over_radius"]
    assert (
        entries[0]["channel"] == "force_z"
        and low == pytest.approx(1.0, abs=0.01)
        and 1.5 < high < 4.5
    )
    assert {item["channel"] for item in entries} == {"force_z"}
    signs = [np.sign(item["mean"]) for item in entries]
    assert signs[:2] == [1.0, -1.0] and "energy" not in entries[0]


def test_a_place_that_no_single_variable_shows_is_an_entry_of_its_own():
    place = Structure("moment_x", ("east_m", "north_m"), (0.0, 1.0), (2.0, 3.0), 0.6, 0.002, 0.1)
    (entry,) = located_by_residuals([], [place], _system(_planted()))
    assert entry["regime"] == {"east_m": [0.0, 2.0], "north_m": [1.0, 3.0]}
    assert entry["mean"] == 0.1 and entry["share_of_excess"] == 0.6


@pytest.mark.parametrize(
    ("change", "counts"),
    [
        ({}, True),
        ({"q_value": 0.02}, False),
        ({"r2": 0.05}, False),
        ({"rms": 0.001}, False),
        ({"of_size": True, "r2": 0.2}, False),
        ({"of_size": True, "r2": 0.2, "regime": ("east_m",)}, True),
        ({"channel": "unheard_of"}, False),
    ],
)
def test_a_structure_is_clear_if_it_is_no_chance_explains_and_matters(change, counts):
    s = dataclasses.replace(CLEAR, **change)
    found = clear_structures([s], MODEL, settings.locate.r2_least)
    assert bool(found) == counts


def test_what_flights_of_the_calibration_leave_too_is_no_news():
    known = dataclasses.replace(MODEL, left_unexplained={"force_z": 0.1})
    assert not clear_structures([CLEAR], known, 0.1)
    few = dataclasses.replace(MODEL, left_unexplained={"force_z": 0.05})
    assert clear_structures([CLEAR], few, 0.1)


def test_a_finding_is_located_by_the_regime_that_it_follows():
    acts = np.zeros((COUNT, 2))
    acts[:, 0] = np.exp(-HEIGHT)
    left = 0.01 * np.random.default_rng(1).standard_normal((COUNT, 2))
    told = [{"height_over_radius": HEIGHT, "time_s": np.random.default_rng(2).permutation(HEIGHT)}]
    found = {"ground_effect": [acts], "rotor_drag": [1e-9 * acts]}
    chance = {"ground_effect": 0.99, "rotor_drag": 0.95}
    (entry,) = located_by_findings(found, [left], chance, told, _system(left))
    assert entry["finding"] == "ground_effect" and entry["channel"] == "force_z"
    low, high = entry["regime"]["height_over_radius"]
    assert low == pytest.approx(1.0, abs=0.01) and high < 4.0 and entry["share_of_excess"] > 0.9
    assert entry["q_value"] == pytest.approx(0.01)


def test_of_many_entries_the_first_of_each_channel_come_first():
    listed = [{"channel": c, "n": n} for n in range(5) for c in ("force_x", "moment_x")]
    told = strongest_entries([*listed, {"channel": "acc_x", "n": 0}, {"channel": "acc_y", "n": 0}])
    assert [(t["channel"], t["n"]) for t in told[:3]] == [
        ("force_x", 0),
        ("moment_x", 0),
        ("acc_y", 0),
    ]
    assert sum(t["channel"] == "force_x" for t in told) == settings.report.entries_by_channel


def test_cells_are_of_one_channel_and_one_variable():
    made = Cell("force_z", "climb_m_s", 0.0, 1.0, 0.2, 0.1, 1.0, 0.01, 30)
    entries = located_by_residuals(
        [made],
        [Structure("force_z", ("climb_m_s",), (0.0,), (1.0,), 0.5, 0.01, 0.2)],
        _system(_planted()),
    )
    assert entries[0]["mean"] == pytest.approx(0.2) and entries[0]["q_value"] == 0.01


@given(st.floats(-0.6, 0.6), st.floats(-3.0, 3.0))
def test_a_lean_does_not_know_the_heading(tilt, yaw):
    q = np.array([[np.cos(0.5 * tilt), 0.0, np.sin(0.5 * tilt), 0.0]])
    c, s = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    w, x, y, z = q[0]
    turned_q = np.array([[c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w]])
    assert lean(q)[0, 0] == pytest.approx(tilt, abs=1e-9)
    np.testing.assert_allclose(lean(turned_q), lean(q), atol=1e-9)


def test_stretches_that_are_left_out_are_told_in_order_with_their_reasons():
    ground, gap = np.zeros(400, bool), np.zeros(400, bool)
    ground[:100] = ground[300:] = True
    gap[150:200] = True
    flight = hovering().replace(excluded={"gaps": gap, "on_ground": ground})
    told = [(s.start_s, s.end_s, s.reason) for s in excluded_spans(flight)]
    expected = [(0.0, 1.0, "on_ground"), (1.5, 2.0, "gaps"), (3.0, 4.0, "on_ground")]
    assert [r for *_, r in told] == [r for *_, r in expected]
    np.testing.assert_allclose([s[:2] for s in told], [s[:2] for s in expected], atol=1e-9)
    assert excluded_spans(hovering()) == ()


def test_what_a_recording_shows_is_the_force_that_moved_the_mass():
    flight = hovering(v_x_m_s=0.5 * times(), omega_y_rad_s=0.2 * times())
    names = (*FORCE, *MOMENT, *drive(4))
    shown = dict(
        zip(names, recorded_signals(flight, windows_of(flight), MODEL, names).T, strict=True)
    )
    np.testing.assert_allclose(shown["moment_y"], 0.2 * MODEL.number("iyy_kg_m2"), rtol=1e-6)
    np.testing.assert_allclose(shown["drive_1"], MODEL.hover_rad_s)
    # v x omega adds to the climb what the nose takes from it
    np.testing.assert_allclose(shown["force_x"], 0.5, atol=1e-6)
    early = shown["force_z"][:4] - MODEL.weight_N
    np.testing.assert_allclose(early, -0.1 * windows_of(flight).center_s[:4] ** 2, atol=2e-3)


def test_a_trace_is_recorded_and_simulated_in_the_windows_that_fly():
    flying = np.ones(400, bool)
    flying[:100] = False
    flight = hovering().replace(flying=flying)
    heavy = MODEL.with_number("mass_kg", 1.1)
    told = trace(flight, "first", True, {"before": heavy, "after": MODEL}, WINDOW_S)
    c = told.channels.index("force_z_N")
    assert np.isnan(told.simulated["after"][~told.used, c]).all() and told.held_out
    np.testing.assert_allclose(told.simulated["after"][told.used, c], 1.1 * MODEL.weight_N)
    np.testing.assert_allclose(told.simulated["before"][told.used, c], MODEL.weight_N)
    np.testing.assert_allclose(told.recorded[:, c], 1.1 * MODEL.weight_N, rtol=1e-6)
    z = told.channels.index("p_z_m")
    flown = told.simulated["before"][:, z]
    assert "p_z_m" in told.ahead and np.nanmin(flown) < 1.3
    np.testing.assert_allclose(told.recorded[:, z], 1.5)
