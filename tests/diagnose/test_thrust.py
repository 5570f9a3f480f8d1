"""Thrust that is not as declared, in flights that do not say why: neither voltage nor rotor speeds
were logged.
"""

import numpy as np
import pandas as pd
import pytest

import ges
from ges.diagnose.report.page import render
from ges.diagnose.settings import settings
from ges.simulator import manoeuvres

LOGGED = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s", "u_1", "u_2", "u_3", "u_4", "battery_V")
PLANS = (
    ("height_staircase", (30.0,)),
    ("straight_runs", (30.0,)),
    ("climbs", (20.0,)),
    ("yaw_turn", (20.0,)),
)
DRAG = {"rotor_drag": {"k_kg": 1e-4}}
SAG = {"battery_sag": {"sensitivity": 0.8, "nominal_V": 16, "drop_V_s": 0.06, "load_V": 1.0}}
HEAVY = {"thrust_scale": {"scale": -0.2}}
BENT = {"thrust_curve": {"c": 0.3}}


def _diagnosed(flown, vehicle, effects, unlogged, plans=PLANS, steps_s=()):
    frames = [
        flown(vehicle, effects, manoeuvres.MENU[plan](*n), seed, LOGGED)
        for seed, (plan, n) in enumerate(plans, 1)
    ]
    frames = [f.drop(columns=[c for c in f if c.startswith(unlogged)]) for f in frames]
    frames = (
        [_at(f, step_s) for f, step_s in zip(frames, steps_s, strict=True)] if steps_s else frames
    )
    return ges.diagnose(frames, vehicle, holdout=[f"flight{len(plans)}"])


def _at(frame, step_s):
    """The recording as another clock samples it."""
    t_s = np.arange(0.0, frame["t_s"].iloc[-1], step_s)
    return pd.DataFrame(
        {c: t_s if c == "t_s" else np.interp(t_s, frame["t_s"], frame[c]) for c in frame}
    )


@pytest.mark.slow
def test_a_bent_curve_is_not_taken_for_a_usual_one(flown, sheet):
    """Rotor speeds show the bend, which a usual doubt would take upon itself. A battery that sags
    under load takes as much from all motors, and a curve from each by its own command.
    """
    found = _diagnosed(flown, sheet(), BENT, ("battery",))
    assert found.verdict == "physics"
    told = {f.name: f.parameters for f in found.findings}
    assert set(told) == {"thrust_curve"} and told["thrust_curve"]["c"].value == pytest.approx(
        0.3, rel=0.1
    )
    low, high = told["thrust_curve"]["c"].ci95
    assert low < 0.3 < high and not found.remark
    assert (
        _diagnosed(flown, sheet(), {"thrust_curve": {"c": 0.05}}, ("battery",)).verdict
        == "nothing_proven"
    )


@pytest.mark.slow
def test_by_commands_alone_a_bent_curve_is_named(flown, sheet):
    """How thrust bends with commands shows within seconds, in which no battery runs down."""
    found = _diagnosed(flown, sheet(), {"thrust_curve": {"c": 0.5}}, ("rotor_speed", "battery"))
    assert [f.name for f in found.findings] == ["thrust_curve"]
    low, high = found.findings[0].parameters["c"].ci95
    assert low < 0.5 < high


@pytest.mark.slow
def test_with_rotor_speeds_a_battery_is_no_curve(flown, sheet):
    """Another top speed may make the level of the speeds; a curve would not move them together."""
    deep = {"battery_sag": {**SAG["battery_sag"], "sensitivity": 1.0, "load_V": 2.0}}
    found = _diagnosed(flown, sheet(), deep, ("battery",))
    assert {f.name for f in found.findings if f.is_open} == {"battery_sag"}
    assert not [f.name for f in found.findings if not f.is_open]
    assert found.verdict == "ambiguous" and "logged (battery_V)" in found.remark
    assert "battery_V" in found.next_flight["preparation"]


@pytest.mark.slow
def test_what_a_battery_usually_takes_is_the_speed_of_flights_to_come(flown, sheet):
    """9 % of the top speed, 2.6 times what flights without a voltage usually differ by."""
    found = _diagnosed(flown, sheet(), SAG, ("battery",))
    assert found.verdict == "nothing_proven" and not found.findings
    taken = found.calibration["vehicle.max_rotor_speed_rad_s"]
    assert -4.0 < taken["value"] / taken["prior_sd"] < -2.0
    unseen = [v for name, v in found.fit["channels"].items() if name.startswith("drive")]
    assert all(v["after"] < 0.3 * v["before"] for v in unseen)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.9, 0.8])
def test_a_ceiling_is_named_beside_an_unmeasured_curve(flown, sheet, share):
    found = _diagnosed(flown, sheet(), BENT | {"rotor_saturation": {"share": share}}, ("battery",))
    names = {f.name for f in found.findings}
    assert names == {"thrust_curve", "rotor_saturation"}


@pytest.mark.parametrize(
    "effects",
    [pytest.param(HEAVY, id="heavy"), pytest.param(SAG, id="sagged", marks=pytest.mark.slow)],
)
def test_its_causes_are_named_together(flown, sheet, effects):
    found = _diagnosed(flown, sheet(), effects, ("rotor_speed", "battery"))
    assert found.verdict == "ambiguous"
    assert {f.name for f in found.findings} == {"battery_sag", "thrust_scale"}
    assert "logged (battery_V)" in found.remark
    report = render(found.content())
    assert report.count("give no number of it") == 1 and "with the battery voltage logged" in report


@pytest.mark.slow
@pytest.mark.parametrize("effects", [HEAVY, SAG], ids=["heavy", "sagged"])
def test_the_flight_that_it_asks_for_tells(flown, sheet, effects):
    asked = _diagnosed(flown, sheet(), effects, ("rotor_speed", "battery")).next_flight
    assert "battery_V" in asked["preparation"]
    # another thrust is in both: that of a battery's level
    assert set(asked["separates"]) == {"battery_sag", "nothing more"}
    assert asked["expected_log_odds"] > settings.statistics.acceptance_log_odds
    told = _diagnosed(
        flown, sheet(), effects, ("rotor_speed",), ((asked["manoeuvre"], (30.0,)),) * 2
    )
    assert set(effects) <= {f.name for f in told.findings} <= {*effects, "thrust_scale"}


@pytest.mark.slow
def test_clocks_that_differ_by_little_are_asked_alike(flown, sheet):
    """Half a window is 12.5 steps, give or take what clocks differ by."""
    told = _diagnosed(
        flown,
        sheet(),
        HEAVY,
        ("rotor_speed", "battery"),
        steps_s=(0.008001, 0.0080008, 0.0080021, 0.0080037),
    )
    assert told.verdict == "ambiguous" and told.next_flight["manoeuvre"]


@pytest.mark.slow
def test_what_is_proven_is_told_apart_from_what_is_open(flown, sheet):
    found = _diagnosed(flown, sheet(), HEAVY | DRAG, ("rotor_speed", "battery"))
    assert found.verdict == "ambiguous"
    sure, opened = found.sentence.split("; beside it one of ", 1)
    assert "rotor drag" in sure and "thrust scale" not in sure and "rotor drag" not in opened
    assert found.remark.startswith("Thrust is") and "rotor_drag" not in found.remark
    assert {f.name for f in found.findings if f.probability > 0.9} == {"rotor_drag"}


@pytest.mark.slow
def test_with_rotor_speeds_it_has_one_cause(flown, sheet):
    assert [f.name for f in _diagnosed(flown, sheet(), HEAVY, ("battery",)).findings] == [
        "thrust_scale"
    ]


def test_thrust_within_its_doubt_is_nothing(flown, sheet):
    found = _diagnosed(
        flown, sheet(), {"thrust_scale": {"scale": -0.07}}, ("rotor_speed", "battery")
    )
    assert found.verdict == "nothing_proven" and not found.findings
