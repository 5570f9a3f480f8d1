"""Names that the flights cannot tell apart: each is fitted, and each is held against flights that
took no part.
"""

import re

import numpy as np
import pytest

import ges
from ges.diagnose.report.page import render
from ges.diagnose.types import words
from ges.simulator import manoeuvres

ALIKE = {"wind", "rotor_tilt", "attitude_bias"}
EAST_M_S, DRAG_KG = 3.0, 6e-5


@pytest.fixture(scope="module")
def found(flown, sheet):
    """Wind over a known drag in hover at one heading, where it is as good as a tilt."""
    known = {
        "mass_kg": {"value": 1.0, "sd": 0.01},
        "thrust_coefficient_N_s2": {"value": 6e-6, "sd_rel": 0.01},
    }
    vehicle = sheet(
        **known, torque_coefficient_Nm_s2=None, effects={"rotor_drag": {"k_kg": DRAG_KG}}
    )
    rates = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
    frames = [
        flown(
            vehicle, {"wind": {"east_m_s": EAST_M_S}}, manoeuvres.make("hover", 15.0), seed, rates
        )
        for seed in (1, 2, 3)
    ]
    return ges.diagnose(frames, vehicle, holdout=["flight3"])


def test_each_is_fitted_in_full_and_what_then_does_nothing_is_none_of_them(found):
    """The search has a parasitic drag, too, which does nothing in still air."""
    told = {f.name: f.parameters for f in found.findings}
    assert (
        found.verdict == "ambiguous"
        and set(told) == ALIKE
        and all(f.is_open for f in found.findings)
    )
    wind, tilt, bias = (
        told["wind"]["east_m_s"],
        told["rotor_tilt"]["x_rad"],
        told["attitude_bias"]["y_rad"],
    )
    assert wind.value == pytest.approx(EAST_M_S, rel=0.02)
    assert tilt.value == pytest.approx(-bias.value, rel=0.02), "as large a push"
    assert {f.size["channel"] for f in found.findings} == {"force_x"}


def test_each_makes_flights_that_took_no_part_better(found):
    told, channel = found.fit["channels"]["force_x_N"], "force_x_N"
    after = {name: left[channel] for name, left in found.fit["alternatives"].items()}
    assert set(after) == ALIKE and max(after.values()) < 0.95 * told["recalibrated"]
    first = found.findings[0].name
    assert next(iter(after)) == first and after[first] == told["after"], (
        "the likeliest first, and what 'after' has"
    )
    page = re.sub(r"<[^>]+>|\s+", " ", render(found.content()))
    row = " ".join(words.number_words(left) for left in after.values())
    assert f"force forward, N {row}" in re.sub(" +", " ", page)


def test_the_likeliest_flies_in_the_fitted_vehicle_alone(found):
    assert ALIKE & set(found.vehicle.effects) == {found.findings[0].name}


def test_the_page_says_that_they_are_open(found):
    page = render(found.content())
    assert page.count("open: this or another") == len(ALIKE) and "with each that is open" in page
    assert np.all([name.replace("_", " ") in page for name in ALIKE])


@pytest.fixture(scope="module")
def without_velocity(flown, sheet):
    """Drag in a strong wind, of flights that log an accelerometer and no velocity."""
    vehicle = sheet()
    effects = {"rotor_drag": {"k_kg": 3e-4}, "wind": {"east_m_s": 5.0}}
    logged = (
        "gyro_x_rad_s",
        "gyro_y_rad_s",
        "gyro_z_rad_s",
        "acc_x_m_s2",
        "acc_y_m_s2",
        "acc_z_m_s2",
    )
    frames = [
        flown(vehicle, effects, manoeuvres.make(name, 15.0), seed, logged)
        for seed, name in enumerate(("straight_runs", "height_staircase", "straight_runs"), 1)
    ]
    return [f.drop(columns=[c for c in f if c.startswith("v_")]) for f in frames], vehicle


def test_what_pushes_sideways_is_open_beside_a_drag_that_cannot_be_tested(without_velocity):
    """An accelerometer would be wrong by a quarter of g, and 98 % sure."""
    frames, vehicle = without_velocity
    found = ges.diagnose(frames, vehicle, holdout=["flight3"])
    sideways = {
        f.name
        for f in found.findings
        if f.size.get("channel") in ("acc_x", "acc_y", "force_x", "force_y")
    }
    assert sideways, "something has to be seen"
    assert {"rotor_drag", "parasitic_drag"} | sideways <= {
        f.name for f in found.findings if f.is_open
    }
    drag = next(f for f in found.findings if f.name == "rotor_drag")
    assert drag.parameters == {} and "velocity" in found.not_tested["rotor_drag"]
    assert "a logged velocity" in found.sentence and not found.laws
    assert "These flights give no number of it" in render(found.content())
