"""Held-out flights flown again in closed loop, and the regimes that a finding must leave alone."""

import numpy as np
import pytest

from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.prove.closed_loop import LEAN, closed_loop, lean
from ges.diagnose.prove.verify import errors_elsewhere
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres

LENGTH_S = 0.2
DRAG = {"rotor_drag": {"k_kg": 1.5e-4}}


@pytest.fixture(scope="module")
def runs(sheet, flown, with_rates):
    """A flight with rotor drag along straight lines, and models without and with it."""
    vehicle = sheet()
    frame = flown(vehicle, DRAG, manoeuvres.straight_runs(20.0), 1, with_rates)
    bare = from_vehicle(vehicle)
    return frame, bare, {"before": bare, "recalibrated": bare, "after": bare.with_effects(DRAG)}


def test_lean_is_the_tilt_of_the_thrust_axis():
    half = 0.5 * 0.2
    pitched = np.array([[np.cos(half), 0.0, np.sin(half), 0.0]])  # nose down: thrust leans forward
    rolled = np.array([[np.cos(half), -np.sin(half), 0.0, 0.0]])  # left side down
    assert lean(pitched) == pytest.approx(np.array([[0.2, 0.0]]), abs=1e-9)
    assert lean(rolled) == pytest.approx(np.array([[0.0, 0.2]]), abs=1e-9)


def test_the_true_model_leans_as_the_vehicle_did(runs):
    frame, bare, models = runs
    told = closed_loop([pass_gate([frame], bare).flights[0]], models, LENGTH_S)
    assert told["flights"] == 1 and {*LEAN, "rotor_speed_rad_s", "p_x_m"} <= set(told["channels"])
    forward = told["channels"][LEAN[0]]
    assert (
        forward["after"] < 0.5 * forward["before"] and forward["before"] == forward["recalibrated"]
    )
    low, high = forward["reduction_ci95"]
    assert 0.3 < low < 1.0 - forward["after"] / forward["recalibrated"] < high


def test_without_references_there_is_no_loop_to_close(runs):
    frame, bare, models = runs
    silent = frame.drop(columns=[c for c in frame if "_ref_" in c])
    assert closed_loop([pass_gate([silent], bare).flights[0]], models, LENGTH_S) == {}


def _errors(after_outside):
    """Two hundred windows, low for the first half, where the finding halves the error; outside as
    given.
    """
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 1.0, (200, 1))
    low = np.arange(200)[:, None] < 100
    told = {"recalibrated": [noise], "after": [np.where(low, 0.5, after_outside) * noise]}
    return told, [{"height_over_radius": 0.05 * np.arange(200)}]


@pytest.mark.parametrize("factor, worse", [(1.0, False), (1.3, True), (0.8, False)])
def test_what_gets_worse_elsewhere_is_told(factor, worse):
    told, regimes = _errors(factor)
    located = [{"channel": "force_z", "regime": {"height_over_radius": [0.0, 4.97]}}]
    entry = errors_elsewhere(told, ("force_z",), located, regimes, 0.5 * LENGTH_S)["force_z_N"]
    assert entry["worse"] is worse
    assert entry["after"] / entry["recalibrated"] == pytest.approx(factor, rel=0.02)
    assert errors_elsewhere(told, ("force_z",), [], regimes, 0.5 * LENGTH_S) == {}
