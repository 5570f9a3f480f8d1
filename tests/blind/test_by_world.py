"""Scores by world, against answers worked out by hand."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from ges.blind.protocol import seal
from ges.blind.score import by_world
from ges.blind.score.by_world import outcome_of


def _truth(*names: str, world: str = "abroad", **more) -> dict:
    verdict = "physics" if names else "nothing_proven"
    return {
        "verdict": verdict,
        "findings": [{"name": n, "parameters": {}} for n in names],
        "severity": "weak",
        "situation": {"world": world},
        **more,
    }


def _diagnosis(*names: str, verdict: str = "", probability: float = 0.97, **more) -> dict:
    verdict = verdict or ("physics" if names else "nothing_proven")
    findings = [{"name": n, "probability": probability, "parameters": {}} for n in names]
    return {"verdict": verdict, "findings": findings, **more}


NULL = _truth()
UNLISTED = _truth(verdict="unknown", category="unknown")
OTHER = {"also_acceptable": [["wind"], ["rotor_drag", "axial_inflow"]]}
TWO_CUT = _truth("weak_rotor", also_acceptable=[["weak_rotor", "torque_coefficient"]])
TWO_CUT["findings"] = [
    {"name": "weak_rotor", "parameters": {}, "place": f"rotor {k}"} for k in (1, 2)
]


def _losses(*values: float) -> dict:
    parameters = {f"loss_{k}": {"value": v} for k, v in enumerate(values, 1)}
    finding = {"name": "weak_rotor", "probability": 0.99, "parameters": parameters}
    return {"verdict": "physics", "findings": [finding]}


def _cut(*places: str) -> dict:
    findings = [
        {"name": "weak_rotor", "probability": 0.99, "parameters": {}, "place": p} for p in places
    ]
    return {"verdict": "physics", "findings": findings}


@pytest.mark.parametrize(
    ("truth", "diagnosis", "answer", "alarm"),
    [
        (NULL, _diagnosis(), "right", False),
        (NULL, _diagnosis("wind"), "wrong", True),
        (NULL, _diagnosis(verdict="unknown"), "unknown", True),
        (NULL, _diagnosis("a", "b", verdict="ambiguous", probability=0.5), "wrong", True),
        (_truth(also_acceptable=[["rotor_drag"]]), _diagnosis("rotor_drag"), "acceptable", False),
        (_truth("rotor_drag", **OTHER), _diagnosis("rotor_drag"), "right", True),
        (_truth("rotor_drag", **OTHER), _diagnosis("wind"), "acceptable", True),
        (_truth("rotor_drag", **OTHER), _diagnosis(), "partly", False),
        (_truth("rotor_drag", **OTHER), _diagnosis("axial_inflow"), "partly", True),
        (_truth("rotor_drag", **OTHER), _diagnosis("rotor_drag", "tether"), "wrong", True),
        (_truth("rotor_drag"), _diagnosis(verdict="unknown"), "unknown", True),
        (_truth("rotor_drag"), {"verdict": "failed", "findings": []}, "failed", False),
        (UNLISTED, _diagnosis(verdict="unknown"), "right", True),
        (UNLISTED, _diagnosis(verdict="law"), "right", True),
        (UNLISTED, _diagnosis(), "partly", False),
        (UNLISTED, _diagnosis("wind", verdict="unknown"), "wrong", True),
        (TWO_CUT, _losses(0.2, 0.15, 0.0, 0.01), "right", True),
        (TWO_CUT, _losses(0.2, 0.0, 0.0, 0.0), "partly", True),
        (TWO_CUT, _losses(0.2, 0.0, 0.18, 0.0), "wrong", True),
        (TWO_CUT, _cut("rotor 1", "rotor 2"), "right", True),
        (TWO_CUT, _cut("rotor 4"), "wrong", True),
    ],
)
def test_answers(truth, diagnosis, answer, alarm):
    found = outcome_of("a", truth, diagnosis)
    assert (found.outcome, found.alarm) == (answer, alarm)


def _limited(nats: float, diagnosis: dict, *names: str):
    truth = _truth(*names, detectable={"whole": nats, "without": dict.fromkeys(names, nats)})
    return outcome_of("a", truth, diagnosis)


def test_what_is_told_is_held_against_what_any_method_could():
    """Two sets that shout, of which one is told, and two that no test could tell from nothing."""
    answers = [
        _limited(500.0, _diagnosis("wind"), "wind"),
        _limited(500.0, _diagnosis(), "wind"),
        _limited(0.0, _diagnosis(), "wind"),
        _limited(0.0, _diagnosis(), "wind"),
    ]
    found = by_world.scores(answers)["right or acceptable, of what any method could tell"]
    assert found[0] == pytest.approx(1.0 / (2.0 + 2.0 * by_world.FALSE_ALARM_RATE), rel=1e-6)
    assert found[3] == 4


def test_power_table_counts_names_not_sets():
    answers = [
        _limited(30.0, _diagnosis("wind"), "wind", "tether"),
        _limited(30.0, _diagnosis("wind", "tether"), "wind", "tether"),
        outcome_of("n", NULL, _diagnosis()),
    ]
    table = by_world.power_table(answers)
    assert len(table) == 1
    assert (table["names"][0], table["named"][0]) == (4, 0.75)
    assert table["best_method"][0] > 0.99


def test_table_has_a_row_for_each_world_and_one_for_all():
    answers = [
        outcome_of("a", _truth("wind", world="x"), _diagnosis("wind")),
        outcome_of("b", _truth("wind", world="y"), _diagnosis("tether", probability=0.99)),
        outcome_of("c", _truth(world="y"), _diagnosis("wind", probability=0.6)),
    ]
    table = by_world.table(answers).set_index("world")
    assert list(table.index) == ["x", "y", "all"]
    assert (table["right"]["x"], table["wrong"]["y"], table["false_alarms"]["all"]) == (1, 1, 1)
    assert (table["sure_names"]["all"], table["sure_names_true"]["all"]) == (2, 1)


def test_scores_are_told_by_number_of_rotors():
    of_six = _truth("wind") | {"situation": {"world": "x", "rotors": 6}}
    answers = [
        outcome_of("a", _truth("wind"), _diagnosis("wind")),
        outcome_of("b", of_six, _diagnosis("wind")),
        outcome_of("c", of_six, _diagnosis("tether")),
    ]
    table = by_world.by_rotors(answers).set_index("rotors")
    assert list(table.index) == [4, 6]
    assert (table["good"][6], table["wrong"][6], table["sets"][4]) == (0.5, 1, 1)
    assert table["low"][6] < 0.5 < table["high"][6]


def _claims(*claims: tuple[str, float]) -> dict:
    findings = [
        {"name": n, "probability": 1.0, "statistic": s, "parameters": {}} for n, s in claims
    ]
    return {"verdict": "physics", "findings": findings}


def test_baselines_are_cut_at_the_alarms_of_the_tool():
    """With one false alarm allowed, what stays is above the second largest statistic of a null."""
    truths = {"n1": NULL, "n2": NULL, "n3": NULL, "a": _truth("wind"), "b": _truth("wind")}
    claims = {
        "n1": _claims(("wind", 9.0)),
        "n2": _claims(("wind", 4.0)),
        "n3": _claims(),
        "a": _claims(("wind", 5.0), ("tether", 3.0)),
        "b": _claims(("", 6.0)),
    }
    kept = by_world.at_same_alarms(truths, claims, alarms=1)
    names = {n: [f["name"] for f in d["findings"]] for n, d in kept.items()}
    assert names == {"n1": ["wind"], "n2": [], "n3": [], "a": ["wind"], "b": []}
    # a change without a name is an alarm all the same
    assert kept["b"]["verdict"] == "unknown" and kept["n2"]["verdict"] == "nothing_proven"
    none = by_world.at_same_alarms(truths, claims, alarms=0)
    assert not [f for d in none.values() for f in d["findings"]]


def test_worlds_are_scored_beside_the_baselines_that_were_run(tmp_path):
    folder = tmp_path / "abroad"
    (folder / "sealed").mkdir(parents=True)
    truths = {"aa": _truth("wind", world="x"), "bb": _truth(world="x")}
    for name, truth in truths.items():
        (folder / "cases" / name).mkdir(parents=True)
        (folder / "cases" / name / "vehicle.yaml").write_text("name: v\n")
        (folder / "sealed" / f"{name}.json").write_text(json.dumps(truth))
        for method, diagnosis in (
            ("diagnosed", _diagnosis(*(f["name"] for f in truth["findings"]))),
            ("diagnosed-means", _claims(("", 1.0 if truth["findings"] else 0.5))),
        ):
            (folder / method / name).mkdir(parents=True)
            (folder / method / name / "diagnosis.json").write_text(json.dumps(diagnosis))
    made = {"half": "development", "worlds": {"x": 2}, "skipped": {"y": "not installed"}}
    (folder / "sealed" / "made.json").write_text(json.dumps(made))
    seal.close(folder)
    assert by_world.made_of_worlds(folder)
    report = by_world.score_worlds(folder, folder / "scores")
    table = pd.read_csv(folder / "scores" / "worlds.csv").set_index("method")
    assert (table["right"]["ges"], table["detected"]["means"]) == (1, 1)
    assert pd.read_csv(folder / "scores" / "skipped.csv")["why"][0] == "not installed"
    alarms = {r["method"]: r["value"] for r in report["scores"] if r["score"] == "false alarms"}
    assert alarms == {"ges": 0.0, "means": 0.0}
    assert (folder / "scores" / "power.png").stat().st_size > 0
    assert np.isnan(pd.read_csv(folder / "scores" / "sets.csv")["best_method"]).all()
