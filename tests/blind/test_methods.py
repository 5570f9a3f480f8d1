"""Baselines on a problem whose answer is known, oracle and limits, a run that is interrupted, real
flights as cases.
"""

from __future__ import annotations

import dataclasses
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from ges.blind.protocol import arithmetic, baselines, run, seal
from ges.blind.score import figures
from ges.blind.score.coefficients import _relative
from ges.blind.score.opened import _over_limit
from ges.blind.score.oracle import Oracle
from ges.blind.score.verdicts import read_verdict
from ges.errors import UsageError
from ges.recordings.recording import load_set
from ges.vehicle.file import parse_vehicle

ROOT = Path(__file__).resolve().parents[2]


def _column(name: str) -> SimpleNamespace:
    return SimpleNamespace(variant=SimpleNamespace(effect=name), nuisance=None)


def _problem(coefficients: dict[str, float], noise: float = 1.0) -> baselines.BaselineProblem:
    """Three flights of independent columns, residual = columns times coefficients + white noise;
    calibration has no part.
    """
    names = ("rotor_drag", "wind", "axial_inflow", "tether")
    rng = np.random.default_rng(3)
    beta = np.array([coefficients.get(n, 0.0) for n in names])
    nuisance = SimpleNamespace(
        nuisance=SimpleNamespace(effect="thrust_scale", sd=0.1, flight_sd=0.0)
    )

    def rows(n: int) -> baselines.BaselineRows:
        x, free = rng.standard_normal((n, 4)), rng.standard_normal((n, 1))
        y = x @ beta + noise * rng.standard_normal(n)
        return baselines.BaselineRows(
            y, y + 0.5 * free[:, 0], x, free, x.copy(), np.arange(n) % 2, np.arange(n) % 3
        )

    columns = tuple(_column(n) for n in names)
    return baselines.BaselineProblem(
        ("force_x", "force_y"),
        np.ones(2),
        columns,
        (nuisance,),
        rows(3000),
        rows(1000),
        ("flight_1",),
    )


def test_stepwise_finds_strong_columns():
    named, predict = baselines.stepwise(_problem({"rotor_drag": 0.5, "tether": -0.3}))
    assert {"rotor_drag", "tether"} <= set(named) and named["rotor_drag"].probability > 0.99
    problem = _problem({"rotor_drag": 0.5})
    left = problem.held_out.y - baselines.stepwise(problem)[1](problem.held_out)
    assert np.var(left) < 0.85 * np.var(problem.held_out.y)


def test_stepwise_p_values_are_those_of_least_squares():
    import statsmodels.api as sm

    problem = _problem({"wind": 0.05})
    named, _ = baselines.stepwise(problem)
    alone = sm.OLS(problem.train.y, problem.train.x[:, [1]]).fit()
    assert 1.0 - named["wind"].probability == pytest.approx(alone.pvalues[0], rel=0.02)
    assert named["wind"].statistic == pytest.approx(abs(alone.tvalues[0]), rel=0.02)


def test_sindy_finds_strong_columns():
    pytest.importorskip("pysindy", reason="the extra 'baselines' is not installed")
    assert set(baselines.sindy(_problem({"rotor_drag": 0.5, "wind": 0.4}, noise=0.1))[0]) == {
        "rotor_drag",
        "wind",
    }


def test_parameter_fit_names_what_is_outside_its_tolerance():
    """The nuisance is 0.5 with a tolerance of 0.1: named; within five times the tolerance: not."""
    problem = _problem({}, noise=0.1)
    claims = baselines.parameters(problem)[0]
    assert set(claims) == {"thrust_scale"}
    assert claims["thrust_scale"].statistic == pytest.approx(5.0, rel=0.05)
    wide = SimpleNamespace(nuisance=SimpleNamespace(effect="thrust_scale", sd=0.5, flight_sd=0.0))
    assert not baselines.parameters(dataclasses.replace(problem, nuisances=(wide,)))[0]


def test_boosting_learns_and_names_nothing():
    problem = _problem({"rotor_drag": 2.0})
    named, predict = baselines.boosting(problem)
    assert not named and np.var(problem.held_out.y - predict(problem.held_out)) < 0.5 * np.var(
        problem.held_out.y
    )


def test_size_over_stated_limit():
    """Of loads, whichever rotor is weak and whatever the shape; of numbers from neutral where there
    are no loads.
    """
    weak = {f"loss_{i}": 0.2 * (i == 2) for i in range(1, 5)}
    drive = {"motor_lag": {"up_s": 0.03, "down_s": 0.04}, "rotor_saturation": {"share": 0.7}}
    best = Oracle({"weak_rotor": weak, **drive}, 1.0)
    seen = SimpleNamespace(
        loads=lambda e: np.array([v for values in e.values() for v in values.values()])
    )
    told = {
        "weak_rotor": {"parameter": "loss_4", "smallest": 0.1, "shape": {}},
        "motor_lag": {"parameter": "up_s", "smallest": 0.01},
        "rotor_saturation": {"parameter": "share", "smallest": 0.15},
    }
    assert _over_limit(seen, "weak_rotor", best, told) == pytest.approx(2.0)
    assert _over_limit(seen, "motor_lag", best, told) == pytest.approx(5.0)
    assert _over_limit(seen, "rotor_saturation", best, told) == pytest.approx(2.0)
    assert _over_limit(seen, "weak_rotor", best, {}) is None
    assert _over_limit(seen, "rotor_drag", best, told) is None


def test_coefficient_error_of_a_vector():
    told = {"x_m": {"value": 3.0}, "y_m": {"value": 0.0}}
    assert _relative({"x_m": 3.0, "y_m": 4.0}, told) == pytest.approx(0.8)


@pytest.mark.parametrize(
    "method", ["stepwise", "parameters", pytest.param("boosting", marks=pytest.mark.slow)]
)
def test_baselines_answer_on_a_whole_case(proof, method):
    answer = baselines.diagnose(load_set(proof / "cases" / seal.cases(proof)[0]), method)
    assert answer["verdict"] in ("nothing_proven", "physics", "parameter", "sensor")
    assert all(f["statistic"] > 0.0 for f in answer["findings"])
    assert answer["fit"]["channels"]["force_z_N"]["recalibrated"] > 0.0
    assert not any("/" in name for name in answer["fit"]["channels"])


def test_unknown_method_is_said():
    with pytest.raises(UsageError, match="did you mean 'stepwise'"):
        run.method_options("stepwize")


def test_limit_figure_draws():
    table = pd.DataFrame(
        {
            "category": ["single"] * 8,
            "truth": list("aabbccdd"),
            "over_limit": np.geomspace(0.2, 20, 8),
            "outcome": ["nothing"] * 3 + ["exact"] * 5,
        }
    )
    axes = figures.draw_limit(table).axes[0]
    assert [len(line.get_xdata()) for line in axes.lines[1:3]] == [5, 3]


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_and_ends_the_same(tmp_path, proof):
    """Killed at random moments: verdicts that are there are whole and kept, and all are those of
    one run to the last byte.
    """
    left_out = shutil.ignore_patterns("diagnosed", "scores")
    folder = Path(shutil.copytree(proof, tmp_path / "proof", ignore=left_out))

    def verdicts(out: str) -> dict[str, tuple[bytes, int]]:
        """Diagnosis of each case, and when it was made."""
        found = {n: folder / out / n / "diagnosis.json" for n in seal.cases(folder)}
        return {n: (p.read_bytes(), p.stat().st_mtime_ns) for n, p in found.items() if p.exists()}

    code = (
        "from pathlib import Path; from ges.blind.protocol.run import run_cases;"
        f" run_cases(Path({str(folder)!r}), 1, out='cut')"
    )
    assert run.run_cases(folder, 1) == (2, 0)
    whole, draw = verdicts(run.OUT), random.Random(43)
    kept: dict[str, tuple[bytes, int]] = {}
    for _ in range(4):
        killed = subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
        time.sleep(draw.uniform(1.0, 12.0))
        os.killpg(killed.pid, signal.SIGKILL)
        killed.wait()
        assert kept.items() <= verdicts("cut").items()
        kept = verdicts("cut")
        assert all(said == whole[n][0] for n, (said, _) in kept.items())
    assert run.run_cases(folder, 1, out="cut") == (2 - len(kept), 0)
    ended = verdicts("cut")
    assert {n: said for n, (said, _) in ended.items()} == {
        n: said for n, (said, _) in whole.items()
    }
    assert kept.items() <= ended.items() and read_verdict(folder / "cut" / min(ended))


def _hovering(losses=(0.0, 0.0, 0.0, 0.0), heavier: float = 0.0):
    """Two flights that hover level, balanced exactly, with rotors that have lost thrust."""
    vehicle = parse_vehicle(
        {
            "name": "level",
            "mass_kg": 1.0,
            "rotors": [
                {"x_m": 0.1 * x, "y_m": 0.1 * y, "z_m": 0.0, "radius_m": 0.06, "spin": s}
                for x, y, s in ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw"))
            ],
            "thrust_coefficient_N_s2": 1e-6,
            "torque_coefficient_Nm_s2": 1e-8,
        },
        "the test's vehicle",
    )
    share = (1.0 + heavier) * 9.80665 / 4.0 / (1.0 - np.array(losses))
    n = 100
    columns = {"t_s": np.arange(n) * 0.01}
    for k in range(4):
        columns[f"rotor_speed_{k + 1}_rad_s"] = np.full(n, np.sqrt(share[k] / 1e-6))
    columns["acc_z_m_s2"] = np.full(n, 9.80665 * (1.0 + heavier))
    frame = pd.DataFrame(columns)
    flights = tuple(SimpleNamespace(name=f"flight_{k}", frame=frame) for k in (1, 2))
    return SimpleNamespace(vehicle=vehicle, flights=flights, folder=None)


def test_arithmetic_of_means_finds_the_rotor_that_is_weak():
    (finding,) = arithmetic.largest_loss(_hovering((0.0, 0.0, 0.15, 0.0)))
    assert (finding["name"], finding["place"]) == ("weak_rotor", "rotor 3")
    assert finding["statistic"] == pytest.approx(0.15, rel=1e-6)
    (none,) = arithmetic.largest_loss(_hovering())
    assert none["statistic"] == pytest.approx(0.0, abs=1e-9)


def test_distance_of_means_is_that_of_rotor_speeds():
    (none,) = arithmetic.mean_distance(_hovering())
    assert none["statistic"] == pytest.approx(0.0, abs=1e-9) and none["name"] == ""
    (one,) = arithmetic.mean_distance(_hovering((0.19, 0.0, 0.0, 0.0)))
    assert one["statistic"] == pytest.approx(1.0 / 0.9 - 1.0, rel=1e-6)


def test_a_run_in_pieces_stops_by_the_clock(tmp_path, proof):
    folder = Path(
        shutil.copytree(
            proof, tmp_path / "proof", ignore=shutil.ignore_patterns("diagnosed*", "scores")
        )
    )
    assert run.run_cases(folder, 1, minutes=1e-9) == (0, 2)
    options = run.method_options("means")
    assert run.run_cases(folder, 1, out="diagnosed-means", options=options) == (2, 0)
    said = read_verdict(folder / "diagnosed-means" / seal.cases(folder)[0])
    assert said["findings"][0]["statistic"] >= 0.0
