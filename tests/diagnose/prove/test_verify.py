"""Errors of flights that took no part: their rms, intervals, and where they got worse."""

import numpy as np
import pytest

from ges.conventions import POSITION
from ges.diagnose.design.weak import block_windows
from ges.diagnose.prepare.channels import FORCE, MOMENT, drive
from ges.diagnose.prove.proof import prove
from ges.diagnose.prove.verify import (
    channel_table,
    errors_elsewhere,
    finite_rollouts,
    horizon_times_s,
    recalibration_warnings,
    reduction_ci95,
    rms,
    rms_table,
    rollout_errors,
    rollout_errors_by_stage,
    rollout_table,
    stage_errors,
    stages_row,
)
from ges.diagnose.settings import settings

from ..synthetic import MODEL, WINDOW_S, hovering, times

SPACING_S = 0.5 * WINDOW_S
HEAVY = MODEL.with_number("mass_kg", 1.1)
FALL_M_S2 = MODEL.number("gravity_m_s2") * (1.0 - 1.0 / 1.1)


def _noise(count, seed=0):
    return np.random.default_rng(seed).standard_normal(count)


def test_rms_is_over_all_windows_that_are_there():
    assert rms([np.array([3.0, np.nan]), np.array([4.0, np.nan, np.nan])]) == pytest.approx(
        np.sqrt(12.5)
    )


@pytest.mark.parametrize("share", [0.5, 1.0, 1.2])
def test_an_error_that_is_a_share_everywhere_has_an_interval_of_nothing(share):
    before = [_noise(300), _noise(200, 1)]
    low, high = reduction_ci95(before, [share * e for e in before], 20)
    assert low == pytest.approx(1.0 - share) and high == pytest.approx(1.0 - share)


def test_an_interval_holds_the_share_and_is_as_wide_as_blocks_are_few():
    before, after = [_noise(2000)], [0.5 * _noise(2000, 1)]
    narrow, wide = (reduction_ci95(before, after, block) for block in (1, 250))
    for low, high in (narrow, wide):
        assert low < 0.5 < high
    assert narrow[1] - narrow[0] == pytest.approx(4.0 * 0.5 / np.sqrt(2000), rel=0.3)
    # a slow change of size: blocks of time tell its scatter, rows do not
    slow = np.repeat(0.2 + _noise(8, 2) ** 2, 250)
    one, all_of_it = (reduction_ci95(before, [slow * before[0]], block) for block in (1, 250))
    assert all_of_it[1] - all_of_it[0] > 3.0 * (one[1] - one[0])


def test_absent_windows_take_no_part_in_an_interval():
    before = _noise(200)
    after = 0.5 * before
    holes = np.arange(200) % 3 == 0
    sparse = [np.where(holes, np.nan, e) for e in (before, after)]
    assert reduction_ci95([sparse[0]], [sparse[1]], 10) == pytest.approx([0.5, 0.5])


def _stages(before, recalibrated, after):
    return {"before": before, "recalibrated": recalibrated, "after": after}


def test_a_row_of_stages_is_their_rms_and_the_last_step():
    e = [_noise(100)]
    told = stages_row(_stages([3.0 * e[0]], [2.0 * e[0]], e), 10)
    assert told["before"] == pytest.approx(3.0 * rms(e)) and told["after"] == pytest.approx(rms(e))
    assert told["reduction_ci95"] == pytest.approx([0.5, 0.5])


def test_a_table_has_the_channels_that_are_there_with_their_units():
    e = np.column_stack([_noise(100), np.full(100, np.nan), 2.0 * _noise(100, 1)])
    told = channel_table(_stages([e], [e], [0.5 * e]), ("force_x", "range", "moment_y"), SPACING_S)
    assert set(told) == {"force_x_N", "moment_y_Nm"}
    assert told["moment_y_Nm"]["after"] == pytest.approx(0.5 * told["moment_y_Nm"]["before"])
    table = rms_table([e], ("force_x", "range", "moment_y"))
    assert set(table) == set(told) and table["force_x_N"] == told["force_x_N"]["before"]


@pytest.mark.parametrize(("spacing_s", "count"), [(0.1, 50), (0.2, 25), (60.0, 1)])
def test_a_block_is_as_many_windows_as_five_seconds_hold(spacing_s, count):
    assert block_windows(spacing_s) == count


@pytest.mark.parametrize(("share", "is_warned"), [(0.9, False), (1.1, True)])
def test_a_recalibration_that_makes_it_worse_by_what_matters_is_one_sentence(share, is_warned):
    growth = share * settings.decide.least_thrust_share * MODEL.weight_N
    errors = {"before": 0.2, "recalibrated": 0.2 + growth}
    found = recalibration_warnings({"force_x_N": errors}, MODEL)
    assert bool(found) == is_warned
    if is_warned:
        assert found[0].startswith(
            f"on the flights that took no part the force forward is {0.2 + growth:.3f} N off with"
        )
        assert "0.200 as given" in found[0]


def test_elsewhere_is_outside_all_regimes_of_its_channel():
    """Inside nothing is left; outside the error doubles in one channel and stays in another."""
    low = np.arange(400) < 200
    base = np.column_stack([_noise(400), _noise(400, 1)])
    after = np.where(low[:, None], 0.0, base * [2.0, 1.0])
    told = {"recalibrated": [base], "after": [after]}
    regimes = [{"height_over_radius": np.where(low, 1.0, 5.0)}]
    bounds = {"height_over_radius": [0.5, 1.5]}
    located = [{"channel": n, "regime": bounds} for n in ("force_z", "moment_x")]
    table = errors_elsewhere(told, ("force_z", "moment_x"), located, regimes, SPACING_S)
    assert table["force_z_N"]["worse"] and not table["moment_x_Nm"]["worse"]
    assert table["force_z_N"]["change_ci95"] == pytest.approx([1.0, 1.0])
    assert table["moment_x_Nm"]["change_ci95"] == pytest.approx([0.0, 0.0])
    everywhere = [{"channel": "force_z", "regime": {"height_over_radius": [0.0, 9.0]}}]
    assert errors_elsewhere(told, ("force_z",), everywhere, regimes, SPACING_S) == {}
    unknown = [{"channel": "force_z", "regime": {"battery_V": [0.0, 9.0]}}]
    whole = errors_elsewhere(told, ("force_z",), unknown, regimes, SPACING_S)["force_z_N"]
    assert whole["recalibrated"] == pytest.approx(rms([base[:, 0]]))


def test_errors_are_residuals_by_stage_absent_where_a_channel_is():
    flights = [hovering(), hovering(acc_z_m_s2=9.80665)]
    names = (*FORCE, *MOMENT, *drive(4), "acc_z")
    force, acc = names.index("force_z"), names.index("acc_z")
    told = stage_errors(flights, {"before": HEAVY, "after": MODEL}, names, WINDOW_S)
    first, second = told["before"]
    more_N = 0.1 * MODEL.weight_N
    np.testing.assert_allclose(first[:, force], more_N, rtol=1e-6)
    assert np.isnan(first[:, acc]).all()
    np.testing.assert_allclose(second[:, acc], 1.1 * 9.80665 - MODEL.weight_N, rtol=1e-6)
    np.testing.assert_allclose(told["after"][1][:, [force, acc]], 0.0, atol=1e-9)


def test_a_rollout_s_error_starts_at_nothing_and_grows_as_a_fall():
    told = rollout_errors(hovering(), HEAVY)
    clock = horizon_times_s()
    assert clock[0] == 0.0 and clock[-1] == settings.report.horizon_s
    assert told["p_z_m"].shape == (3, len(clock))
    np.testing.assert_allclose(
        told["p_z_m"], np.tile(-0.5 * FALL_M_S2 * clock**2, (3, 1)), atol=5e-3
    )
    np.testing.assert_allclose(told["v_z_m_s"], np.tile(-FALL_M_S2 * clock, (3, 1)), atol=1e-3)
    np.testing.assert_allclose(told["p_x_m"], 0.0, atol=1e-9)
    assert rollout_errors(hovering(0.5), MODEL) == {}


def test_rollouts_of_all_flights_are_pooled_and_told_at_the_end_of_the_horizon():
    flights = [hovering(), hovering(2.5), hovering(q_w=None)]
    told = rollout_errors_by_stage(flights, {"before": HEAVY, "after": MODEL})
    assert told["p_z_m"]["before"].shape[0] == 5, (
        "three and two horizons, and none without attitude"
    )
    table = rollout_table(told)
    assert table["channels"]["p_z_m"]["before"] == pytest.approx(0.5 * FALL_M_S2, abs=5e-3)
    assert table["channels"]["p_z_m"]["after"] < 1e-6
    assert rollout_table({}) == {}


def test_rollouts_that_stop_being_finite_count_in_no_stage_and_are_told():
    end_m = {"before": [[0.0, 1.0], [0.0, 3.0]], "after": [[0.0, 0.5], [0.0, np.inf]]}
    errors = {"p_z_m": {stage: np.array(e) for stage, e in end_m.items()}}
    finite, warnings = finite_rollouts(errors)
    table = rollout_table(finite)["channels"]["p_z_m"]
    assert table == {"before": 1.0, "after": 0.5}
    (warning,) = warnings
    assert warning.startswith("1 of 2 simulations") and "with the findings" in warning
    nothing = {"p_z_m": {"after": np.full((2, 2), np.nan)}}
    assert finite_rollouts(nothing)[0] == {} and len(finite_rollouts(nothing)[1]) == 1
    assert finite_rollouts({}) == ({}, [])


def test_nothing_held_out_proves_nothing():
    told = prove({}, {}, {}, (), WINDOW_S)
    assert told.fit["holdout_flights"] == [] and told.fit["channels"] == {}


@pytest.mark.filterwarnings("ignore:All-NaN")
def test_a_proof_compares_the_stages_on_what_was_held_out():
    models = {"before": HEAVY, "recalibrated": HEAVY, "after": MODEL}
    told = prove(
        {"last": hovering(p_z_m=1.5 + 0.1 * times())}, models, {"tether": HEAVY}, (), WINDOW_S
    )
    force = told.fit["channels"]["force_z_N"]
    assert force["before"] == pytest.approx(0.1 * MODEL.weight_N) and force["after"] < 1e-9
    assert force["reduction_ci95"] == pytest.approx([1.0, 1.0])
    assert told.fit["alternatives"]["tether"]["force_z_N"] == pytest.approx(force["before"])
    assert told.fit["elsewhere"] == {} and told.fit["closed_loop"] == {}
    assert set(told.fit["rollout"]["channels"]) >= set(POSITION)
    assert told.fit["holdout_flights"] == ["last"] and told.length_s == WINDOW_S
    assert "5 s" in told.fit["metric"]


@pytest.mark.filterwarnings("ignore:All-NaN")
def test_intervals_of_a_proof_are_over_blocks_of_five_seconds():
    noise = 0.02 * _noise(2000)
    flights = [hovering(20.0, v_z_m_s=noise)]
    models = {"before": HEAVY, "recalibrated": HEAVY, "after": MODEL}
    told = prove({"last": flights[0]}, models, {}, (), WINDOW_S)
    names = (*FORCE, *MOMENT, *drive(4))
    left = stage_errors(flights, models, names, WINDOW_S)
    own = channel_table(left, names, SPACING_S)["force_z_N"]
    assert told.fit["channels"]["force_z_N"] == own
    assert own["reduction_ci95"] != channel_table(left, names, 60.0)["force_z_N"]["reduction_ci95"]
