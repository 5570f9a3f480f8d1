"""Judging and scoring, against answers worked out by hand."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ges.blind.protocol import run, seal
from ges.blind.score import figures, opened, oracle, score
from ges.blind.score.judge import category_of, judge
from ges.blind.score.statistics import calibration_error, proportion
from ges.blind.score.verdicts import read_verdict
from ges.errors import GesError


def _truth(*names: str, verdict: str = "physics", **more) -> dict:
    return {
        "verdict": verdict,
        "findings": [{"name": n, "parameters": {}} for n in names],
        "severity": "weak",
        **more,
    }


def _diagnosis(*names: str, verdict: str = "physics", probability: float = 0.97, **more) -> dict:
    return {
        "verdict": verdict,
        "findings": [{"name": n, "probability": probability, "parameters": {}} for n in names],
        **more,
    }


NOTHING = _diagnosis(verdict="nothing_proven")
NULL = _truth(verdict="nothing_proven")
UNKNOWN = _truth(verdict="unknown")
OPEN = _truth("cg_offset", verdict="ambiguous", also_acceptable=[["weak_rotor"]])


@pytest.mark.parametrize(
    ("truth", "diagnosis", "outcome", "wrong"),
    [
        (_truth("rotor_drag"), _diagnosis("rotor_drag"), "exact", ()),
        (_truth("rotor_drag"), NOTHING, "nothing", ()),
        (_truth("rotor_drag"), _diagnosis("wind"), "wrong", ("wind",)),
        (_truth("rotor_drag"), _diagnosis("rotor_drag", "wind"), "extra", ("wind",)),
        (_truth("rotor_drag", "wind"), _diagnosis("rotor_drag"), "partial", ()),
        (_truth("rotor_drag", "wind", also_acceptable=[["wind"]]), _diagnosis("wind"), "exact", ()),
        (
            _truth("rotor_drag"),
            _diagnosis("rotor_drag", "wind", verdict="ambiguous", probability=0.5),
            "hedged",
            (),
        ),
        (_truth("rotor_drag"), _diagnosis("rotor_drag", verdict="unknown"), "partial", ()),
        (_truth("rotor_drag"), {"verdict": "failed", "findings": []}, "failed", ()),
        (NULL, NOTHING, "exact", ()),
        (NULL, _diagnosis("wind"), "wrong", ("wind",)),
        (NULL, _diagnosis(verdict="unknown"), "unknown", ()),
        (UNKNOWN, _diagnosis(verdict="unknown"), "exact", ()),
        (UNKNOWN, _diagnosis(verdict="law"), "exact", ()),
        (NULL, _diagnosis(verdict="law"), "unknown", ()),
        (UNKNOWN, NOTHING, "nothing", ()),
        (UNKNOWN, _diagnosis("wind", verdict="unknown"), "wrong", ("wind",)),
        (
            OPEN,
            _diagnosis("cg_offset", "weak_rotor", verdict="ambiguous", probability=0.5),
            "exact",
            (),
        ),
        (OPEN, _diagnosis("cg_offset"), "partial", ()),
        (OPEN, _diagnosis("wind", verdict="physics"), "wrong", ("wind",)),
        (OPEN, NOTHING, "nothing", ()),
    ],
)
def test_outcomes(truth, diagnosis, outcome, wrong):
    judged = judge("a", truth, diagnosis)
    assert (judged.outcome, judged.wrong) == (outcome, wrong)


@pytest.mark.parametrize(
    ("truth", "category"),
    [
        (NULL, "null"),
        (UNKNOWN, "unknown"),
        (OPEN, "confounded"),
        (_truth("wind"), "single"),
        (_truth("a", "b"), "pair"),
        (_truth("a", "b", "c"), "triple"),
        (_truth("time_offset", verdict="sensor"), "sensor"),
        (_truth("inertia", verdict="parameter"), "parameter"),
        (_truth("rotor_drag", "wind", category="single"), "single"),
    ],
)
def test_category_of_a_truth_that_states_none(truth, category):
    assert category_of(truth) == category


def test_of_confounded_names_the_other_one_is_not_true():
    answers = [
        _diagnosis("cg_offset"),
        _diagnosis("weak_rotor"),
        _diagnosis("cg_offset", "weak_rotor", verdict="ambiguous", probability=0.5),
    ]
    assert [score.only_true(judge("a", OPEN, diagnosis)) for diagnosis in (*answers, NOTHING)] == [
        True,
        False,
        None,
        None,
    ]


def test_alarm_on_a_null_is_any_other_answer():
    answers = [
        NOTHING,
        _diagnosis("wind"),
        _diagnosis(verdict="unknown"),
        _diagnosis("a", "b", verdict="ambiguous", probability=0.5),
    ]
    assert [judge("a", NULL, s).alarm for s in answers] == [False, True, True, True]


def test_location_counts():
    """acc_z speaks of the same force as force_z; a trace is neither demanded nor a mistake."""
    truth = _truth(
        "rotor_drag", located=["force_x", "force_y"], traces=["force_x", "force_y", "moment_x"]
    )
    diagnosis = _diagnosis(
        "rotor_drag",
        located=[{"channel": c} for c in ("acc_x", "force_x", "moment_x", "moment_z", "drive_2")],
    )
    assert judge("a", truth, diagnosis).located == (1, 2, 1)
    assert score.f1(np.array([[1, 2, 1], [1, 0, 0]])) == pytest.approx(2 * 2 / (2 * 2 + 2 + 1))


def test_location_on_a_null_is_one_too_many_and_a_sensor_fault_is_not_scored():
    diagnosis = _diagnosis(
        located=[{"channel": "acc_x"}, {"channel": "force_x"}, {"channel": "moment_z"}]
    )
    assert judge("a", NULL | {"located": [], "traces": []}, diagnosis).located == (0, 2, 0)
    assert judge(
        "a", _truth("gyro_bias", verdict="sensor", located=[], traces=[]), diagnosis
    ).located == (0, 0, 0)


def test_clopper_pearson():
    """0 of 300: the upper end is 1 - 0.025^(1/300); 9 of 10 from the tables."""
    value, low, high = proportion([False] * 300)
    assert (value, low) == (0.0, 0.0) and high == pytest.approx(
        1.0 - 0.025 ** (1.0 / 300.0), rel=1e-6
    )
    assert proportion([True] * 9 + [False]) == pytest.approx((0.9, 0.5550, 0.9975), abs=1e-4)


def test_calibration_error():
    """Ten names stated at 0.95 of which half are true: 0.45."""
    stated = np.array([[0.95, k % 2] for k in range(10)])
    assert calibration_error(stated) == pytest.approx(0.45)


def _foreign(folder: Path, proof: Path, cases: int = 1) -> Path:
    """A folder by somebody else: contract files alone, hashes of the truths alone, names of their
    own.
    """
    lines = []
    (folder / "sealed").mkdir(parents=True)
    for k, case in enumerate(sorted((proof / "cases").iterdir())[:cases]):
        shutil.copytree(case, folder / "cases" / f"theirs-{k}")
        path = folder / "sealed" / f"theirs-{k}.json"
        path.write_text(json.dumps(_truth("rotor_drag")))
        lines.append(f"{seal.sha256(path)}  {path.name}\n")
    (folder / "sealed" / seal.SUMS).write_text("".join(lines))
    return folder


@pytest.mark.slow
def test_folder_of_somebody_else_runs_and_scores(tmp_path, proof):
    """Run, resumed without running again, scored, drawn: strong rotor drag in two short flights is
    found.
    """
    folder = _foreign(tmp_path / "theirs", proof)
    assert run.run_cases(folder, processes=1) == (1, 0)
    assert run.run_cases(folder, processes=1) == (0, 0)
    about = json.loads((folder / "diagnosed" / "theirs-0" / "run.json").read_text())
    diagnosis = read_verdict(folder / "diagnosed" / "theirs-0")
    assert about["ended"] == "well", diagnosis["sentence"]
    report = score.score_cases(folder)
    scores = {row["score"]: row for row in report["scores"]}
    assert scores["singles exactly right"]["n"] == 1
    assert scores["false alarms on nulls"]["value"] is None
    for name in (
        "cases.csv",
        "scores.csv",
        "confusion_matrix.png",
        "detection.pdf",
        "outcomes.png",
    ):
        assert (folder / "scores" / name).stat().st_size > 0


def test_missing_verdict_is_diagnosis(tmp_path, proof):
    folder = _foreign(tmp_path / "theirs", proof)
    with pytest.raises(GesError, match="no verdict; run ges blind run first"):
        score.score_cases(folder)


@pytest.mark.parametrize("content", ["", "{", '{"verdict": "physics"}', "[1]"])
def test_bad_verdict_is_diagnosis(tmp_path, content):
    (tmp_path / "diagnosis.json").write_text(content)
    with pytest.raises(GesError, match="is not a diagnosis"):
        read_verdict(tmp_path)


def test_oracle_recovers_what_was_concealed(proof):
    """Fitted to the noise-free forces, the library's rotor drag explains nearly all of a blade
    element rotor's.
    """
    case = sorted(p.stem for p in (proof / "sealed").glob("*.npz"))[0]
    truth = json.loads((proof / "sealed" / f"{case}.json").read_text())
    best = oracle.fit(oracle.witness(proof, case, truth), ["rotor_drag"])
    assert best.reach > 0.95
    assert best.parameters["rotor_drag"]["k_kg"] > 0


def test_the_oracle_of_a_drive_is_not_led_by_a_file_that_is_wrong_about_its_lag(proof):
    """The library's own drive, a fifth slower and 3 % faster at the top than the file has it, 20 ms
    late.
    """
    case = next(p.stem for p in sorted((proof / "sealed").glob("*.npz")))
    seen, rng, n = (
        oracle.witness(proof, case, seal.truth(proof, case)),
        np.random.default_rng(0),
        2500,
    )
    u = 0.6 + np.cumsum(rng.normal(0.0, 0.1 / np.sqrt(n), (n, 4)), axis=0)
    drive = {"fast_u": u.clip(0.3, 0.9), "fast_battery": np.ones((n, 1)), "full_V": 16.0}
    slower = dict(seen.numbers, motor_time_constant_s=1.2 * seen.numbers["motor_time_constant_s"])
    true = dataclasses.replace(seen, numbers=slower, flights=(drive,)).speeds(
        {"esc_delay": {"delay_s": 0.02}}
    )
    drive["fast_rotor_speed"] = 1.03 * seen.numbers["max_rotor_speed_rad_s"] * true
    best = oracle.fit(dataclasses.replace(seen, flights=(drive,)), ["esc_delay"])
    assert best.parameters["esc_delay"]["delay_s"] == pytest.approx(0.02, rel=0.03)


def test_what_scoring_worked_out_is_kept_until_its_sources_change(proof, monkeypatch):
    """An interrupted scoring goes on: the oracle and the diagnosis that is told the truth are not
    asked twice.
    """
    case = next(
        p.stem
        for p in sorted((proof / "sealed").glob("*.npz"))
        if seal.truth(proof, p.stem)["findings"]
    )
    truth = seal.truth(proof, case)
    seen, asked = oracle.witness(proof, case, truth), []
    monkeypatch.setattr(
        opened,
        "diagnose_true_names",
        lambda *_: asked.append(1) or {"detectable": {}, "sentence": "no part of it"},
    )
    first, again = (opened.open_case(proof, case, truth, seen) for _ in range(2))
    assert asked == [1] and first == again and again.of_true_names == {"detectable": {}}
    monkeypatch.setattr(opened, "_made_of", lambda _: "other sources")
    opened.open_case(proof, case, truth, seen)
    assert asked == [1, 1]
    shutil.rmtree(proof / opened.KEPT)


def test_a_pair_is_above_its_limits_when_each_of_its_effects_is(proof, monkeypatch):
    """Of a pair the smaller of both sizes over limits is told, and none where one has no limit."""
    case = next(
        p.stem
        for p in sorted((proof / "sealed").glob("*.npz"))
        if seal.truth(proof, p.stem)["findings"]
    )
    truth = (
        seal.truth(proof, case)
        | _truth("rotor_drag", "wind")
        | {"concealed": {"rotor_drag": {}, "wind": {}}}
    )
    limits = iter((3.0, 2.0, 3.0, None))
    monkeypatch.setattr(opened, "_over_limit", lambda *_: next(limits))
    monkeypatch.setattr(opened, "diagnose_true_names", lambda *_: {})
    monkeypatch.setattr(oracle, "fit", lambda *_: oracle.Oracle({}, np.nan))
    assert [opened._work_out(proof, case, truth, None).over_limit for _ in range(2)] == [2.0, None]


def test_confusion_counts_every_case_once():
    judged = [
        judge("a", _truth("rotor_drag"), _diagnosis("rotor_drag")),
        judge("b", _truth("rotor_drag"), _diagnosis("wind")),
        judge("c", NULL, NOTHING),
    ]
    table = score.confusion(judged).set_index(["concealed", "answer"])["cases"]
    expected = {
        ("rotor_drag", "rotor_drag"): 1,
        ("rotor_drag", "wind"): 1,
        ("null", "nothing_proven"): 1,
    }
    assert table.to_dict() == expected
    assert isinstance(table, pd.Series)


def test_every_figure_is_drawn_even_of_nothing(tmp_path):
    """A workflow promises the files; where no case states a probability, the picture says so."""
    names = ("confusion", "singles", "reliability", "categories", "cases", "power")
    figures.draw_all(tmp_path, dict.fromkeys(names, pd.DataFrame({"n": []})))
    drawn = [{f.stem for f in tmp_path.glob(f"*.{kind}")} for kind in ("pdf", "png", "csv")]
    assert drawn[0] == drawn[1] == drawn[2] and len(drawn[0]) == len(names)
