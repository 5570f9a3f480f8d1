"""Cruise: where the flight begins on its track, and descents that are level between each other."""

import numpy as np
import pytest

from ges.simulator import flight as sim
from ges.simulator.terrain import Terrain

CALM = {"duration_s": 20.0, "cruise_m_s": 0.5, "mode": "none"}
COLUMNS = ("t_s", "p_x_m", "p_ref_x_m", "p_ref_z_m", "agl_m")


def fly(**numbers: float) -> sim.Record:
    return sim.fly([sim.Flight({**CALM, **numbers}, {}, Terrain.flat())], COLUMNS)[0]


def test_track_start_moves_vehicle_and_reference():
    record = fly(track_start_m=100.0)
    assert record["p_x_m"][0] == 100.0
    assert record["p_ref_x_m"] == pytest.approx(100.0 + 0.5 * record["t_s"], abs=3e-3)
    assert np.abs(record["p_x_m"] - record["p_ref_x_m"]).max() < 0.1


def test_descent_is_level_after_its_duration():
    record = fly(agl_ref_m=1.0, descent_m=0.4, descent_period_s=10.0, descent_duration_s=4.0)
    t, height = record["t_s"] % 10.0, record["p_ref_z_m"]
    assert height[t > 4.0] == pytest.approx(1.0, abs=2e-4)
    assert height[np.isclose(t, 2.0)] == pytest.approx(0.6, abs=2e-4)
    assert height[np.isclose(t, 1.0)] == pytest.approx(0.8, abs=2e-4)


def test_descent_that_fills_its_period_goes_down_half_of_the_time():
    record = fly(agl_ref_m=1.0, descent_m=0.4, descent_period_s=10.0, descent_duration_s=10.0)
    assert np.mean(record["p_ref_z_m"] < 0.8) == pytest.approx(0.5, abs=0.01)
