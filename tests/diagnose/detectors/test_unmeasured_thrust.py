"""Thrust that is far off while nothing says why; and faults that clocks and gyros show by
themselves.
"""

import dataclasses

import numpy as np
import pytest

from ges.diagnose.design.drives import commanded_speeds
from ges.diagnose.detectors.clocks import gate_findings
from ges.diagnose.detectors.thrust import (
    UnmeasuredThrust,
    movable_by_voltage,
    unmeasured_thrust,
)
from ges.diagnose.estimate.joint import JointFit
from ges.diagnose.prepare.delays import Delay
from ges.diagnose.prepare.gate import Gate
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import FittedParameter
from ges.diagnose.types.model import SPEED

from ..synthetic import MODEL, hovering, nuisance, rows_of, system_of

SCALE, CURVE = "thrust_scale.scale", "thrust_curve.c"
COMMANDED = hovering(**{f"rotor_speed_{i}_rad_s": None for i in range(1, 5)})


def _system(flight=COMMANDED, sds=((SCALE, 0.05), (CURVE, 0.03)), channel="force_z"):
    columns = [nuisance(key, sd) for key, sd in sds]
    rows = rows_of(np.zeros((4, 1)), [{0: np.full(4, 5.0)} for _ in columns])
    rows = dataclasses.replace(rows, flight=flight)
    model = dataclasses.replace(MODEL, prior_sds={SCALE: 0.05})
    return system_of((channel,), columns, [rows], model)


def _joint(**common):
    named = {key.replace("__", "."): value for key, value in common.items()}
    return JointFit(*[np.zeros(0)] * 3, 0.0, named, dict.fromkeys(named, 0.01), ({},))


def test_thrust_that_is_far_beyond_its_doubt_is_told_with_all_that_may_do_it():
    found = unmeasured_thrust(_joint(thrust_scale__scale=-0.3, thrust_curve__c=0.05), _system())
    # T_max ((1 - c) u^2 + c u) in hover: what scale and curve make of it together
    bend = 0.05 * (MODEL.number("max_rotor_speed_rad_s") / MODEL.hover_rad_s - 1.0)
    assert found.key == SCALE and found.excess.value == pytest.approx(bend - 0.3)
    assert found.prior_sd == 0.05 and found.rivals == ("battery_sag", "thrust_scale")
    assert found.excess.ci95 == pytest.approx((bend - 0.3 - 0.0196, bend - 0.3 + 0.0196))
    assert found.sentence().startswith("Thrust is 27 +- 2.0 % less than the vehicle file says, 5")
    assert {f.name: f.probability for f in found.findings()} == pytest.approx(
        dict.fromkeys(found.rivals, 0.5)
    )


def test_a_curve_whose_scale_makes_up_for_it_is_no_other_thrust():
    per_bend = MODEL.number("max_rotor_speed_rad_s") / MODEL.hover_rad_s - 1.0
    joint = _joint(thrust_curve__c=0.4, thrust_scale__scale=-0.4 * per_bend)
    assert unmeasured_thrust(joint, _system()) is None


def test_a_named_curve_is_fitted_with_the_thrust_in_hover():
    joint = _joint(thrust_scale__scale=-0.3)
    assert unmeasured_thrust(joint, _system(), ("rotor_drag",)) is not None
    assert unmeasured_thrust(joint, _system(), ("rotor_drag", "thrust_curve")) is None


@pytest.mark.parametrize("times", [0.98, 1.02])
def test_thrust_that_is_not_certainly_off_is_not_told(times):
    sds = times * settings.statistics.certain_sds
    found = unmeasured_thrust(_joint(thrust_scale__scale=0.05 * sds), _system())
    assert (found is not None) == (times > 1.0)


def test_where_the_log_tells_the_cause_nothing_is_unmeasured():
    logged = hovering(battery_V=16.0)
    assert unmeasured_thrust(_joint(thrust_scale__scale=-0.3), _system(logged)) is None
    spinning = hovering()
    found = unmeasured_thrust(_joint(thrust_scale__scale=-0.3), _system(spinning))
    assert found is None, "with rotor speeds the scale is searched"
    bent = unmeasured_thrust(_joint(thrust_curve__c=0.3), _system(spinning))
    assert bent is None, "and so is the curve, which a battery does not bend"


def test_a_top_speed_is_told_as_a_share_of_it():
    system = _system(hovering(), ((SPEED, 30.0),), "drive_1")
    joint = JointFit(*[np.zeros(0)] * 3, 0.0, {SPEED: 200.0}, {SPEED: 10.0}, ({},))
    found = unmeasured_thrust(joint, system)
    assert found.excess.value == pytest.approx(0.2) and found.prior_sd == pytest.approx(0.03)
    assert "Rotor speeds at the same commands are 20 +- 2.0 % higher" in found.sentence()
    assert "Another battery voltage (battery_sag) or another max_rotor_speed_rad_s would do it" in (
        found.sentence()
    )
    assert found.rivals == ("battery_sag",)
    assert [(f.name, f.probability) for f in found.findings()] == [("battery_sag", 0.5)]


def test_what_a_battery_sags_by_is_a_part_of_the_level():
    """In a flight without a drive it is nothing."""
    load = "battery_sag.load_V"
    columns = [nuisance(SPEED, 30.0), nuisance(load, 0.0, 0.5)]
    acting = [{0: np.full(4, 0.8)}, {0: np.full(4, -30.0)}]
    flights = [
        dataclasses.replace(rows_of(np.zeros((4, 1)), of), flight=hovering())
        for of in (acting, [{}, {}])
    ]
    model = dataclasses.replace(MODEL, prior_sds={SPEED: 0.0})
    system = system_of(("drive_1",), columns, flights, model)
    joint = JointFit(*[np.zeros(0)] * 3, 0.0, {SPEED: 10.0}, {SPEED: 1.0}, ({load: 2.0}, {}))
    found = unmeasured_thrust(joint, system)
    top = MODEL.number("max_rotor_speed_rad_s")
    assert found.excess.value == pytest.approx((10.0 - 0.5 * 2.0 * 30.0 / 0.8) / top)
    assert "which has no sd there" in found.sentence()


@pytest.mark.parametrize(
    ("flight", "movable"),
    [
        (COMMANDED, {"battery_sag", "thrust_scale", "vehicle"}),
        (hovering(), {"battery_sag", "vehicle"}),
        (hovering(battery_V=16.0), set()),
    ],
)
def test_what_a_voltage_can_move_is_no_number_of_the_file_that_is_wrong(flight, movable):
    """Scale and curve of a log undid each other in hover, and the scale was told, -60 %."""
    assert movable_by_voltage(_system(flight)) == movable


def _unmeasured(key, value, rivals=("battery_sag", "thrust_scale")):
    return UnmeasuredThrust(
        _system(), key, FittedParameter(value, (value, value), "1"), 0.05, rivals
    )


def _over_weight(effects):
    """Thrust over weight that the commands of a hover make under some effects, in full drive."""
    (speeds,) = commanded_speeds([COMMANDED], MODEL, {})
    scale = effects.get("thrust_scale", {}).get("scale", 0.0)
    return (1.0 + scale) * float(np.mean((speeds[-1] / MODEL.hover_rad_s) ** 2))


@pytest.mark.parametrize(("value", "thrust"), [(0.2, 1.2), (-0.15, 0.85)])
def test_each_explanation_makes_the_same_thrust_in_a_hover(value, thrust):
    """The compiled drive flies them: in the middle of the flight a battery is another thrust."""
    sets = _unmeasured(SCALE, value).explanations()
    assert set(sets) == {("thrust_scale",), ("battery_sag", "thrust_scale")}
    for effects in sets.values():
        assert _over_weight(effects) == pytest.approx(thrust, abs=2e-3)
    on = {names: effects["battery_sag"]["sensitivity"] for names, effects in sets.items()}
    assert on["battery_sag", "thrust_scale"] == 1.0 and on["thrust_scale",] == 0.0


def test_of_another_top_speed_a_battery_shows_by_its_sag_alone():
    sets = _unmeasured(SPEED, 0.05, ("battery_sag",)).explanations()
    assert {names: e["battery_sag"]["sensitivity"] for names, e in sets.items()} == {
        (): 0.0,
        ("battery_sag",): 1.0,
    }
    assert all(_over_weight(effects) == pytest.approx(1.0, abs=2e-3) for effects in sets.values())


def test_the_excess_is_about_what_the_file_has():
    known = dataclasses.replace(MODEL, effects={"thrust_scale": {"scale": 0.1}})
    found = _unmeasured(SCALE, 0.2)
    held = dataclasses.replace(found, system=dataclasses.replace(found.system, model=known))
    told = held.explanations()["thrust_scale",]["thrust_scale"]["scale"]
    assert told == pytest.approx(0.3), "about what the file has"


@pytest.mark.parametrize(("excess", "scale"), [(0.2, 0.3), (-0.69, -0.59), (-5.0, -0.9)])
def test_what_recalibration_has_moved_already_counts_once(excess, scale):
    """A mass of a third of the true one ended a diagnosis: *scale is -1.26*, and -.9 the least."""
    found = _unmeasured(SCALE, excess)
    # the file has .1, and recalibration has moved it by -.5
    moved = dataclasses.replace(
        MODEL, effects={"thrust_scale": {"scale": -0.4}}, corrections={SCALE: -0.5}
    )
    held = dataclasses.replace(found, system=dataclasses.replace(found.system, model=moved))
    told = held.explanations()["thrust_scale",]["thrust_scale"]["scale"]
    assert told == pytest.approx(scale)


def test_settled_faults_are_findings_with_intervals_and_without_rivals():
    pose = Delay("attitude", 0.04, 0.002, 0.9)
    gyro = np.array([0.03, 0.0, -0.04]), np.array([0.001, 0.001, 0.002])
    late, offset = gate_findings(Gate({}, (), (), pose, gyro), {})
    assert late.name == "time_offset" and late.parameters["delay_s"].value == 0.04
    assert late.parameters["delay_s"].ci95 == pytest.approx((0.04 - 0.00392, 0.04 + 0.00392))
    assert offset.size["value"] == pytest.approx(0.05) and not offset.is_open
    assert offset.parameters["z_rad_s"].ci95 == pytest.approx((-0.04 - 0.00392, -0.04 + 0.00392))
    assert late.probability == settings.statistics.certain_probability
    assert gate_findings(Gate({}, (), ()), {}) == []


@pytest.mark.parametrize(
    ("delay_s", "doubts", "told"),
    [(0.006, {}, []), (-0.02, {}, ["time_offset"]), (0.02, {"time_offset.delay_s": 0.01}, [])],
)
def test_a_delay_that_clocks_usually_have_is_no_fault(delay_s, doubts, told):
    """Usual is 3 ms; beyond doubt are four sds, as of every nominal parameter."""
    gate = Gate({}, (), (), Delay("attitude", delay_s, 0.0005, 0.99))
    assert [f.name for f in gate_findings(gate, doubts)] == told


def test_a_thrust_of_each_flight_s_own_counts_in_the_mean():
    system = _system()
    system = dataclasses.replace(system, flights=system.flights * 2)
    joint = dataclasses.replace(
        _joint(thrust_scale__scale=-0.05),
        by_flight=({SCALE: -0.24}, {SCALE: -0.26}),
    )
    found = unmeasured_thrust(joint, system)
    # half a range of two is their mean's standard error: (.26 - .24) / 2
    assert found.excess.value == pytest.approx(-0.3)
    assert found.excess.ci95 == pytest.approx((-0.3 - 0.0196, -0.3 + 0.0196))
