"""Where the declared numbers are so far off that one linear step does not do."""

import dataclasses

import numpy as np
import pytest

from ges.conventions import COMMAND, ROTOR_SPEED
from ges.diagnose.design.residual import driven_speeds
from ges.diagnose.design.system import build
from ges.diagnose.estimate.fit import null_fit
from ges.diagnose.estimate.recalibrate import operating_point
from ges.diagnose.types.model import SPEED

from ..synthetic import MODEL, hovering, times

BEND = "thrust_curve.c"


def _flown(top_rad_s, bend):
    """A flight whose speeds a drive of another top speed and bend has made of the commands."""
    t, rng = times(8.0), np.random.default_rng(0)
    u = {name: 0.55 + 0.35 * np.sin((0.8 + 0.2 * i) * t + i) for i, name in enumerate(COMMAND)}
    flight = hovering(8.0, **u)
    other = MODEL.with_number("max_rotor_speed_rad_s", top_rad_s)
    (speeds,) = driven_speeds([flight], other, {"thrust_curve": {"c": bend}} if bend else {})
    speeds = speeds + rng.normal(0.0, 1.0, speeds.shape)
    columns = dict(zip(ROTOR_SPEED, speeds.T, strict=True))
    blind = {name for name in flight.columns if name[:2] in ("p_", "v_", "q_", "om")}
    kept = {n: v for n, v in flight.columns.items() if n not in blind}
    return flight.replaced(columns={**kept, **columns})


def _found(flight):
    late = ("motor_lag.up_s", "motor_lag.down_s", "esc_delay.delay_s")
    doubts = {SPEED: 300.0, BEND: 0.3, **dict.fromkeys(late, 0.0)}
    system = build([flight], dataclasses.replace(MODEL, doubts=doubts), [])
    assert system.main == ("drive_1", "drive_2", "drive_3", "drive_4")
    return operating_point(*null_fit(system))


def test_where_the_linear_step_does_what_it_foretells_nothing_moves():
    assert _found(_flown(1010.0, 0.0)) == {}


def test_numbers_that_multiply_each_other_are_found_beyond_the_linear_step():
    found = _found(_flown(1800.0, 0.9))
    assert found[SPEED] == pytest.approx(800.0, abs=25.0)
    assert found[BEND] == pytest.approx(0.9, abs=0.05)
