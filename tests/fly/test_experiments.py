"""Every experiment in its tiny version: what it flies, with which seeds, and that its numbers are
what they claim.
"""

import itertools
import json
import re

import numpy as np
import pandas as pd
import pytest

from ges.errors import GesError, UsageError
from ges.study import config
from ges.study.fly import (
    bias,
    causes,
    clamp,
    comparison,
    ensemble,
    flights,
    forms,
    grid,
    networks,
    pulse,
    winner,
)
from ges.study.stats.paired import means


@pytest.fixture(scope="session")
def flown(tiny, tmp_path_factory):
    """Folder with the outputs of every experiment."""
    folder = tmp_path_factory.mktemp("closed_loop")
    world, plan, seeds = tiny.simulator, tiny.closed_loop, tiny.seeds
    modes, large = plan.modes, seeds.closed_loop
    at, choice = folder.joinpath, folder / "clamp.json"
    clamp.choose_clamp(
        world, plan, plan.clamp_thresholds, seeds.validation, at("clamp.csv"), choice
    )
    names = ("comparison.csv", "comparison_summary.csv", "restricted_summary.csv")
    comparison.fly_comparison(
        world, plan, modes, seeds.closed_loop_small, large, choice, *map(at, names)
    )
    names = ("bias.csv", "bias_summary.csv", "bias_tests.csv")
    bias.fly_bias(world, plan, plan.biases, large, *map(at, names))
    comparison.write_table2(at("comparison_summary.csv"), at("bias_summary.csv"), at("table2.csv"))
    names = ("pulse.csv", "pulse_tests.csv", "pulse_trace.csv", "pulse_response.json")
    pulse.fly_pulse(world, plan, plan.pulse, large, *map(at, names))
    names = ("pulse_map.csv", "pulse_map_summary.csv", "pulse_map_limits.csv")
    pulse.fly_pulse_map(world, plan, plan.pulse.start_s, plan.pulse_map, large, *map(at, names))
    causes.fly_causes(
        world,
        plan,
        seeds.closed_loop,
        at("causes.csv"),
        at("causes_summary.csv"),
        at("causes_tests.csv"),
    )
    winner.choose_gains(
        world, plan, modes, plan.retune, seeds.validation, choice, at("gains.csv"), at("gains.json")
    )
    names = ("winner.csv", "winner_summary.csv", "winner_tests.csv")
    winner.fly_winner(world, plan, modes, large, choice, at("gains.json"), *map(at, names))
    return folder


def _table(folder, name):
    return pd.read_csv(folder / name)


@pytest.mark.parametrize("name", ["clamp", "gains"])
def test_choices_see_validation_seeds_alone(tiny, flown, name):
    validation = set(tiny.seeds.validation.list())
    assert set(_table(flown, f"{name}.csv")["seed"]) == validation
    assert json.loads((flown / f"{name}.json").read_text())["seeds"] == sorted(validation)


@pytest.mark.parametrize("name", ["comparison", "bias", "pulse", "pulse_map", "causes", "winner"])
def test_evaluations_see_closed_loop_seeds_alone(tiny, flown, name):
    allowed = {
        *tiny.seeds.closed_loop.list(),
        *(tiny.seeds.closed_loop_small.list() if name == "comparison" else []),
    }
    assert set(_table(flown, f"{name}.csv")["seed"]) == allowed
    assert not allowed & {*tiny.seeds.data(), *tiny.seeds.calibration.list()}


def test_rules_that_choose_are_given_validation_seeds_alone(root):
    text = (root / "workflow/rules/closed_loop.smk").read_text()
    for rule in re.split(r"\nrule ", text)[1:]:
        seeds = set(re.findall(r'part\("(seeds[\w.]*)"\)', rule))
        wanted = (
            {"seeds.validation"}
            if rule.startswith("choose")
            else {"seeds.closed_loop", "seeds.closed_loop_small"}
        )
        wanted = (
            {"seeds.calibration"}
            if rule.startswith(("fly_ensemble", "calibrate", "fit_profile", "fly_profile"))
            else wanted
        )
        assert seeds <= wanted, rule.split(":")[0]


def test_choice_is_the_best_candidate(flown):
    chosen = json.loads((flown / "clamp.json").read_text())
    mean = _table(flown, "clamp.csv").groupby("threshold")["agl_rms_m"].mean()
    assert mean[chosen["threshold"]] == mean.min()
    gains = json.loads((flown / "gains.json").read_text())["gains"]
    mean = (
        _table(flown, "gains.csv").groupby(["mode", "kp_factor", "kd_factor"])["agl_rms_m"].mean()
    )
    for mode, best in gains.items():
        assert mean[mode].min() == pytest.approx(
            mean[mode, best["kp_factor"], best["kd_factor"]]
        ), mode


def test_no_gains_without_a_phase_margin(tiny, flown):
    chosen = json.loads((flown / "gains.json").read_text())
    least = tiny.closed_loop.retune.phase_margin_deg
    assert (_table(flown, "gains.csv")["phase_margin_deg"] >= least).all() and chosen[
        "published_phase_margin_deg"
    ] < least
    greedy = tiny.closed_loop.retune.model_copy(update={"phase_margin_deg": 60.0})
    with pytest.raises(UsageError, match="phase margin of 60 degrees; the best has 3"):
        winner.sound_gains(tiny.simulator, greedy)


def test_same_seed_same_world(tiny, flown):
    """No bias in the bias experiment is the oracle of the comparison, and of the causes: one
    flight, one set of numbers.
    """
    oracle = _table(flown, "comparison.csv").query(
        "condition == 'oracle' and seed_list == 'closed_loop'"
    )
    unbiased = _table(flown, "bias.csv").query("bias == 0")
    published = _table(flown, "causes.csv").query("condition == 'oracle, as published'")
    for other in (unbiased, published):
        np.testing.assert_array_equal(oracle["agl_rms_m"], other["agl_rms_m"])


def test_rows_do_not_depend_on_the_batch(tiny, flown, monkeypatch):
    monkeypatch.setattr(flights, "AT_ONCE", 5)
    seeds = tiny.seeds.closed_loop.list()
    again = flights.fly_conditions(
        bias.bias_conditions(tiny.closed_loop.biases), seeds, tiny.simulator, tiny.closed_loop
    )
    assert again.to_csv(index=False) == (flown / "bias.csv").read_text()


def test_oracle_knows_the_truth_and_bias_is_added_to_it(flown):
    table = _table(flown, "bias.csv")
    assert table["estimate_mae"].to_numpy() == pytest.approx(
        np.abs(table["bias"]).to_numpy(), abs=1e-5
    )


def test_overprediction_costs_clearance(flown):
    tests = _table(flown, "bias_tests.csv").set_index(["metric", "condition"])
    assert tests.loc[("clearance_mean_m", 0.02), "high"] < 0
    assert set(tests["p_holm"] >= tests["p"]) == {True}


def test_table2_quotes_the_summaries(flown):
    table = _table(flown, "table2.csv")
    small = table.query("experiment == 'modes' and seed_list == 'closed_loop_small'").set_index(
        "condition"
    )
    flown_small = _table(flown, "comparison.csv").query("seed_list == 'closed_loop_small'")
    for name, rows in flown_small.groupby("condition"):
        assert small.loc[name, "mean"] == pytest.approx(rows["agl_rms_m"].mean()), name
    assert len(table) == 2 * 6 + 5


def test_restricted_summary_is_of_the_large_list(flown):
    rows = _table(flown, "comparison.csv").query("seed_list == 'closed_loop'")
    summary = (
        _table(flown, "restricted_summary.csv")
        .query("metric == 'agl_rms_restricted_m'")
        .set_index("condition")
    )
    for name, group in rows.groupby("condition"):
        assert summary.loc[name, "mean"] == pytest.approx(group["agl_rms_restricted_m"].mean())


def test_nothing_happens_before_the_pulse(tiny, flown):
    trace = _table(flown, "pulse_trace.csv")
    before = trace["after_s"] < -tiny.closed_loop.pulse.duration_s
    assert before.any() and (trace.loc[before, "change_m"] == 0).all()
    assert trace.loc[trace["after_s"].between(0, 0.5), "change_m"].mean() < -1e-3


def test_pulse_windows_hold_the_trace(tiny, flown):
    first = (
        _table(flown, "pulse_tests.csv")
        .query("metric == 'clearance_m' and window_s == '0-0.5'")["difference"]
        .item()
    )
    trace = _table(flown, "pulse_trace.csv")
    assert first == pytest.approx(
        trace.loc[trace["after_s"].between(0, 0.49), "change_m"].mean(), rel=0.02
    )


def test_response_of_a_damped_wave():
    after = np.arange(0, 10, 0.02)
    wave = -0.004 * np.exp(-0.5 * after) * np.sin(3.0 * after)
    found = pulse._response(after, wave)
    peak = np.arctan(3.0 / 0.5) / 3.0
    assert found["lowest_after_s"] == pytest.approx(peak, abs=0.02)
    assert found["rebound_after_s"] == pytest.approx(peak + np.pi / 3.0, abs=0.02)
    assert found["rebound_m"] == pytest.approx(
        -found["lowest_m"] * np.exp(-0.5 * np.pi / 3.0), rel=0.01
    )
    assert 3.5 < found["settled_after_s"] < 6.0


def test_interval_of_a_response_is_that_of_its_seeds():
    """Depths of 20 seeds spread by a tenth: the interval of the mean's depth is about two standard
    errors each way.
    """
    after, rng = np.arange(0, 10, 0.02), np.random.default_rng(5)
    wave = np.exp(-0.5 * after) * np.sin(3.0 * after)
    seeds = -0.004 * (1 + 0.1 * rng.normal(size=(20, 1))) * wave
    found = pulse._mean_response(after, seeds)
    half = 1.96 * seeds.min(axis=1).std(ddof=1) / np.sqrt(20)
    assert found["lowest_m_low"] < found["lowest_m"] < found["lowest_m_high"]
    assert found["lowest_m_high"] - found["lowest_m_low"] == pytest.approx(2 * half, rel=0.2)
    assert found["rebound_after_s_low"] == found["rebound_after_s_high"] == found["rebound_after_s"]


def test_no_response_settles_at_once():
    assert pulse._response(np.array([0.0, 1.0]), np.zeros(2))["settled_after_s"] == 0.0


def test_a_pulse_too_late_for_its_windows_is_a_sentence(root):
    over = {"closed_loop": {"duration_s": 20.0}}
    with pytest.raises(UsageError, match="last window after the pulse ends at 40.1 s"):
        config.validate(config.merged(config.read(root / "config/default.yaml"), over))


def test_limits_stop_at_the_first_pulse_that_fails():
    shares = pd.DataFrame(
        {
            "bias": [0.1, 0.2, 0.5, -0.1],
            "duration_s": 1.0,
            "returned": [1, 0.9, 1, 1],
            "touched": [0, 0, 0, 0.1],
        }
    )
    found = pulse._limits(shares).set_index("sign")
    assert (found.loc["+", "returns_up_to"], found.loc["+", "untouched_up_to"]) == (0.1, 0.5)
    assert (found.loc["-", "returns_up_to"], found.loc["-", "untouched_up_to"]) == (0.1, 0.0)


def test_a_perfect_oracle_flies_as_if_there_were_no_ground_effect(flown):
    table = (
        _table(flown, "causes.csv")
        .query("cause == 'all'")
        .pivot(index="seed", columns="mode", values="agl_rms_m")
    )
    np.testing.assert_allclose(table["oracle"], table[causes.FLOOR], rtol=5e-3)
    assert (table["none"] - table[causes.FLOOR]).abs().max() > 1e-4


def test_every_mode_is_set_against_the_vehicle_without_ground_effect(flown):
    tests, flights_ = _table(flown, "causes_tests.csv"), _table(flown, "causes.csv")
    mean = flights_.groupby(["cause", "mode"])["agl_rms_m"].mean()
    floor = tests[
        tests["reference"].str.startswith(causes.FLOOR) & (tests["metric"] == "agl_rms_m")
    ]
    assert len(floor) == 3 * flights_["cause"].nunique()
    for row in floor.itertuples():
        name, _, cause = row.condition.partition(", ")
        assert row.difference == pytest.approx(mean[cause, name] - mean[cause, causes.FLOOR])


def test_networks_are_summarised_by_training_and_over_trainings(tiny, tmp_path):
    made = []
    for plan, training in itertools.product(("published", "consistent"), (1, 2)):
        made.append(tmp_path / f"{plan}{training}.csv")
        networks.fly_network(
            tiny.simulator,
            tiny.closed_loop,
            tiny.seeds.closed_loop,
            plan,
            training,
            made[-1],
        )
    moved = pd.read_csv(made[1])
    hybrid = moved["condition"] == "ml"
    moved.loc[hybrid, "agl_rms_m"] += 0.002
    moved.to_csv(made[1], index=False)
    networks.summarise_networks(made, tmp_path / "networks.csv", tmp_path / "summary.csv")
    table = pd.read_csv(tmp_path / "summary.csv").query("metric == 'agl_rms_m'")
    found = table.set_index(["trained_on", "training", "condition"])["difference"]
    first, second, mean = (found["published", t, "ml"] for t in ("1", "2", "mean"))
    assert second == pytest.approx(first + 0.002) and mean == pytest.approx(first + 0.001)
    assert found["consistent", "mean", "ml"] == pytest.approx(first)
    assert set(table["trainings"]) == {2}
    assert len(pd.read_csv(tmp_path / "networks.csv")) == 4 * 3 * tiny.seeds.closed_loop.count


def test_grid_changes_the_truth_alone(tiny, flown, tmp_path):
    world, plan, seeds, choice = (
        tiny.simulator,
        tiny.closed_loop,
        tiny.seeds.closed_loop,
        flown / "clamp.json",
    )
    cells = [tmp_path / f"cell{factor}.csv" for factor in (1.0, 1.5)]
    for cell, factor in zip(cells, (1.0, 1.5), strict=True):
        grid.fly_grid_cell(world, plan, plan.modes, seeds, choice, 1.0, factor, cell)
    grid.summarise_grid(cells, tmp_path / "grid.csv", tmp_path / "grid_summary.csv")
    same, other = (pd.read_csv(cell).query("condition == 'none'")["agl_rms_m"] for cell in cells)
    reference = _table(flown, "comparison.csv").query(
        "condition == 'none' and seed_list == 'closed_loop'"
    )["agl_rms_m"]
    np.testing.assert_array_equal(same, reference)
    assert (other.to_numpy() != reference.to_numpy()).all()


@pytest.mark.slow
def test_worlds_differ_and_the_fitted_one_flies_where_it_was_fitted(tiny, flown, tmp_path):
    arms = ["analytical", "oracle"], [-0.02, 0.02]
    one = tiny.seeds.closed_loop.model_copy(update={"count": 2})
    outputs = [tmp_path / name for name in ("worlds.csv", "summary.csv", "tests.csv")]
    found = {}
    for name, rows in (("none", ""), ("fitted", "hayden,0.05,,,2\nexponential,0.0,0.12,0.7,1\n")):
        (tmp_path / f"{name}.csv").write_text("form,offset_m,c_a,decay,rank\n" + rows)
        forms.fly_worlds(
            tiny.simulator,
            tiny.closed_loop,
            *arms,
            one,
            flown / "clamp.json",
            tmp_path / f"{name}.csv",
            *outputs,
        )
        found[name] = pd.read_csv(outputs[0])
        assert (
            set(pd.read_csv(outputs[1])["form"])
            == set(found[name]["form"])
            == set(pd.read_csv(outputs[2])["form"])
        )
    assert set(found["none"]["form"]) == set(forms.FORMS)
    assert set(found["fitted"]["form"]) == {*forms.FORMS, forms.FITTED}
    oracle = (
        found["fitted"]
        .query("condition == 'oracle'")
        .groupby(["form", "mapping"])["agl_rms_m"]
        .mean()
    )
    assert oracle.nunique() == 9


def test_ensemble_starts_at_the_fit_and_keeps_what_fits(tiny, root, tmp_path):
    outputs = [tmp_path / "ensemble.csv", tmp_path / "summary.csv"]
    two = tiny.seeds.calibration.model_copy(update={"count": 2})
    plan = tiny.closed_loop
    ensemble.fly_ensemble(
        tiny.simulator,
        plan,
        plan.pulse,
        plan.ensemble,
        two,
        root / "config/calibration.json",
        *outputs,
    )
    walk, summary = map(pd.read_csv, outputs)
    fitted = json.loads((root / "config/calibration.json").read_text())["fitted"]
    assert {name: walk.loc[0, name] for name in fitted} == pytest.approx(fitted)
    assert len(walk) == tiny.closed_loop.ensemble.steps + 1
    assert ((summary["low"] <= summary["median"]) & (summary["median"] <= summary["high"])).all()
    assert set(summary["effect"]) == set(ensemble.CLAIMED_SIGN) <= set(walk.columns)


def test_means_name_every_condition(flown):
    summary = means(_table(flown, "winner.csv"), ["agl_rms_m"])
    assert len(summary) == 2 * 7 and (summary["seeds"] == 3).all()


def test_a_flight_that_fails_is_a_sentence(tiny):
    wild = flights.mode(
        "none",
        attitude_kp=1e5,
        attitude_kd=0.0,
        altitude_kp=0.0,
        gear_stiffness_N_m=1e7,
        gear_height_m=10.0,
    )
    with pytest.raises(GesError, match="cannot be flown|not finite"):
        flights.fly_conditions([wild], [2001], tiny.simulator, tiny.closed_loop)


def test_unknown_mode_is_a_sentence(tiny):
    with pytest.raises(UsageError, match="did you mean 'oracle'"):
        flights.fly_conditions([flights.mode("orakle")], [2001], tiny.simulator, tiny.closed_loop)
