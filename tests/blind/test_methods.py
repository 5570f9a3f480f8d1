"""Baselines on a problem whose answer is known, oracle and limits, a run that is interrupted, real
flights as cases.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from ges.blind.protocol import baselines, run, seal
from ges.blind.score import figures, score
from ges.blind.score.coefficients import _relative
from ges.blind.score.opened import _over_limit
from ges.blind.score.oracle import Oracle
from ges.errors import UsageError
from ges.recordings.recording import load_set

ROOT = Path(__file__).resolve().parents[2]


def _column(name: str) -> SimpleNamespace:
    return SimpleNamespace(variant=SimpleNamespace(effect=name), nuisance=None)


def _problem(coefficients: dict[str, float], noise: float = 1.0) -> baselines.Problem:
    """Three flights of independent columns, residual = columns times coefficients + white noise;
    calibration has no part.
    """
    names = ("rotor_drag", "wind", "axial_inflow", "tether")
    rng = np.random.default_rng(3)
    beta = np.array([coefficients.get(n, 0.0) for n in names])
    nuisance = SimpleNamespace(
        nuisance=SimpleNamespace(effect="thrust_scale", sd=0.1, flight_sd=0.0)
    )

    def rows(n: int) -> baselines.Rows:
        x, free = rng.standard_normal((n, 4)), rng.standard_normal((n, 1))
        y = x @ beta + noise * rng.standard_normal(n)
        return baselines.Rows(
            y, y + 0.5 * free[:, 0], x, free, x.copy(), np.arange(n) % 2, np.arange(n) % 3
        )

    columns = tuple(_column(n) for n in names)
    return baselines.Problem(
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
    assert {"rotor_drag", "tether"} <= set(named) and named["rotor_drag"] > 0.99
    problem = _problem({"rotor_drag": 0.5})
    left = problem.held.y - baselines.stepwise(problem)[1](problem.held)
    assert np.var(left) < 0.85 * np.var(problem.held.y)


def test_stepwise_p_values_are_those_of_least_squares():
    import statsmodels.api as sm

    problem = _problem({"wind": 0.05})
    named, _ = baselines.stepwise(problem)
    alone = sm.OLS(problem.train.y, problem.train.x[:, [1]]).fit()
    assert 1.0 - named["wind"] == pytest.approx(alone.pvalues[0], rel=0.02)


def test_sindy_finds_strong_columns():
    pytest.importorskip("pysindy", reason="the extra 'baselines' is not installed")
    assert set(baselines.sindy(_problem({"rotor_drag": 0.5, "wind": 0.4}, noise=0.1))[0]) == {
        "rotor_drag",
        "wind",
    }


def test_parameter_fit_names_what_is_outside_its_tolerance():
    """The nuisance is 0.5 with a tolerance of 0.1: named; within five times the tolerance: not."""
    problem = _problem({})
    assert set(baselines.parameters(problem)[0]) == {"thrust_scale"}
    wide = SimpleNamespace(nuisance=SimpleNamespace(effect="thrust_scale", sd=0.5, flight_sd=0.0))
    assert not baselines.parameters(dataclasses.replace(problem, nuisances=(wide,)))[0]


def test_boosting_learns_and_names_nothing():
    problem = _problem({"rotor_drag": 2.0})
    named, predict = baselines.boosting(problem)
    assert not named and np.var(problem.held.y - predict(problem.held)) < 0.5 * np.var(
        problem.held.y
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


@pytest.mark.parametrize("method", ["stepwise", "parameters", "boosting"])
def test_baselines_answer_on_a_whole_case(proof, method):
    answer = baselines.diagnose(load_set(proof / "cases" / seal.cases(proof)[0]), method)
    assert answer["verdict"] in ("nothing_proven", "physics", "parameter", "sensor")
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


def test_interrupted_run_goes_on_and_ends_the_same(tmp_path, proof):
    """Killed between two cases and started again: the finished case is kept, and the verdicts are
    those of one run.
    """
    import shutil

    folder = Path(
        shutil.copytree(
            proof, tmp_path / "proof", ignore=shutil.ignore_patterns("diagnosed", "scores")
        )
    )
    code = (
        "from pathlib import Path; from ges.blind.protocol.run import run_cases;"
        f" run_cases(Path({str(folder)!r}), 1, out='cut')"
    )
    killed = subprocess.Popen([sys.executable, "-c", code])
    first, last = (folder / "cut" / n for n in seal.cases(folder))
    for _ in range(1200):
        time.sleep(0.1)
        if first.exists() or killed.poll() is not None:
            break
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    stamp = (first / "run.json").stat().st_mtime_ns
    assert not last.exists()
    assert run.run_cases(folder, 1, out="cut") == 1
    assert (first / "run.json").stat().st_mtime_ns == stamp
    assert json.loads((last / "run.json").read_text())["ended"] == "well"
    assert score.read_verdict(last)["verdict"] != "failed"


def test_real_flights_become_cases(tmp_path, recordings_dir):
    """Every published change is a sealed case; nothing in a case's folder names what was done."""
    from ges.blind.foreign.real import CHANGES, make_real

    count = make_real(tmp_path / "real", recordings_dir)
    names = seal.cases(tmp_path / "real")
    assert len(names) == count == len(CHANGES) + 4 + 2
    for path in (tmp_path / "real" / "cases").rglob("*"):
        assert not any(
            word in str(path.relative_to(tmp_path))
            for word in ("cut", "tape", "string", "weight", "normal", "E8", "E9")
        )
    truths = [seal.truth(tmp_path / "real", n) for n in names]
    assert sum(t["verdict"] == "nothing_proven" for t in truths) == 5


def test_rotorpy_flies_its_own_physics(tmp_path):
    """A hover of RotorPy's own vehicle: the specific force is gravity, the rotors carry the weight,
    the file is honest.
    """
    pytest.importorskip("rotorpy", reason="the extra 'simulators' is not installed")
    from ges.blind.foreign import rotorpy as rotorpy_cases

    numbers = rotorpy_cases._parameters("hummingbird", ("k_d",), {})
    reference = np.zeros((11, 500))
    reference[2] = 1.0
    flown = rotorpy_cases._fly(numbers, reference, np.zeros(3))
    assert flown["specific_force"][-1] == pytest.approx([0.0, 0.0, 9.81], abs=0.01)
    assert 4.0 * numbers["k_eta"] * flown["rotor_speed"][-1].mean() ** 2 == pytest.approx(
        numbers["mass"] * 9.81, rel=1e-3
    )
    assert numbers["k_d"] > 0.0 and numbers["k_z"] == numbers["k_h"] == numbers["c_Dx"] == 0.0


CRAZYFLOW = """
import sys
import numpy as np
from ges.blind.foreign import crazyflow as c
numbers = c._parameters("cf2x_L250", c.CASES[0])
craft = c._airframe("cf2x_L250", numbers, c.CASES[0], np.random.default_rng(1))
reference = np.zeros((11, 1500))
reference[2], reference[0], reference[9] = 1.0, 0.1, 0.3
flown = c._fly(numbers, craft, reference)
assert np.abs(flown["p"][-1, :2] - [0.1, 0.0]).max() < 0.02, flown["p"][-1]
assert abs(flown["specific_force"][-1, 2] / 9.81 - 1.0) < 0.02, flown["specific_force"][-1]
"""


def test_crazyflow_flies_its_own_physics():
    """Its Crazyflie holds a hover under our controller: geometry, spins and signs are translated
    rightly.

    In a process of its own, because the package wants to be imported before scipy.
    """
    if not importlib.util.find_spec("drone_models"):
        pytest.skip("the extra 'simulators' is not installed")
    done = subprocess.run([sys.executable, "-c", CRAZYFLOW], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_missing_simulators_are_said(monkeypatch, tmp_path):
    from ges.blind.foreign import crazyflow as crazyflow_cases
    from ges.blind.foreign import rotorpy as rotorpy_cases
    from ges.errors import GesError

    monkeypatch.setitem(sys.modules, "rotorpy.vehicles", None)
    monkeypatch.setitem(sys.modules, "drone_models", None)
    for make in (rotorpy_cases.make_rotorpy, crazyflow_cases.make_crazyflow):
        with pytest.raises(GesError, match="pip install 'ges.simulators.'"):
            make(tmp_path / make.__name__, 1)
