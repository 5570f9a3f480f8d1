"""Where the search is linearised once an effect is accepted."""

import pytest

from ges.diagnose.locate.stages import recalibrate, relinearise
from ges.diagnose.prepare.problem import pose_problem
from ges.simulator import manoeuvres

from ..conftest import NOISE, fly
from ..test_planted import LOGGED

DRAG = {"rotor_drag": {"k_kg": 1e-4}}


def _start(vehicle, effects, monkeypatch):
    for name, sd in NOISE.items():
        monkeypatch.setitem(NOISE, name, 0.1 * sd)
    plans = [manoeuvres.MENU[name](10.0) for name in ("straight_runs", "yaw_turn", "multisine")]
    frames = [fly(vehicle, effects, plan, seed, LOGGED) for seed, plan in enumerate(plans)]
    problem = pose_problem(frames, vehicle, None, ".")
    return recalibrate(problem.train, problem.model)


def test_a_file_within_its_prior_sds_moves_nothing(sheet, monkeypatch):
    assert relinearise(_start(sheet(), DRAG, monkeypatch), DRAG) is None


def test_columns_are_made_where_the_number_is_with_the_effect(sheet, monkeypatch):
    """An inertia divides the moments of a drag: 30 % of them is far from a column at zero."""
    acting = {**DRAG, "inertia": {"xx": 0.3, "yy": 0.3, "zz": 0.3}}
    moved = relinearise(_start(sheet(), acting, monkeypatch), DRAG)
    assert moved.system.model.corrections["inertia.xx"] == pytest.approx(0.3, abs=0.05)
    assert "rotor_drag" not in moved.system.model.effects
