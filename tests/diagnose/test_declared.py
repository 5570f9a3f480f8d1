"""Nominal parameters that are far from the vehicle: recalibrated with step control, and said."""

import numpy as np
import pytest

import ges
from ges.diagnose.calibrate.calibrate import calibrate
from ges.diagnose.decide.contradicted import Contradicted
from ges.diagnose.design.system import build, residuals_with
from ges.diagnose.estimate.joint import null_fit, with_corrections
from ges.diagnose.estimate.recalibrate import operating_point
from ges.diagnose.library.candidates import flight_envelope
from ges.diagnose.library.grids import library, out_of_reach
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.report.verdict import remark_of, verdict_of
from ges.diagnose.types.model import from_vehicle
from ges.errors import GesError
from ges.recordings.recording import make_set
from ges.simulator import effects, manoeuvres

LOGGED = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s", "u_1", "u_2", "u_3", "u_4", "battery_V")
PLANS = ("height_staircase", "straight_runs", "climbs", "straight_runs")
TOP_RAD_S, HOVER_U, BEND = 1500, 0.43, 0.9  # hover: sqrt(m g / 4 k) over the top speed


def _frames(flown, vehicle, concealed, unlogged=()):
    frames = [
        flown(vehicle, concealed, manoeuvres.make(plan, 20.0), seed, LOGGED)
        for seed, plan in enumerate(PLANS, 1)
    ]
    return [f.drop(columns=[c for c in f if c.startswith(unlogged)]) for f in frames]


def _null_fit(frames, vehicle):
    model = from_vehicle(vehicle)
    gate = pass_gate(frames, model, [f"f{i}" for i in range(len(frames))])
    return null_fit(build(list(gate.flights.values()), model, ()))


def test_a_file_that_is_about_right_needs_one_linear_step(flown, sheet):
    frames = _frames(flown, sheet(), {"thrust_scale": {"scale": 0.02}})
    assert operating_point(*_null_fit(frames, sheet()), from_vehicle(sheet())) == {}


@pytest.mark.slow
def test_recalibration_is_no_worse_than_the_file_on_flights_that_were_fitted(flown, sheet):
    """Commands alone, a bent curve, and a thrust coefficient that was set from hovering: curve and
    coefficient multiply, and the linear step of both is worse than none.
    """
    hovers = {"value": 6e-6 * (1.0 + BEND * (1.0 / HOVER_U - 1.0)), "sd_rel": 0.3}
    vehicle = sheet(max_rotor_speed_rad_s=TOP_RAD_S, thrust_coefficient_N_s2=hovers)
    flew = sheet(max_rotor_speed_rad_s=TOP_RAD_S)
    frames = _frames(flown, flew, {"thrust_curve": {"c": BEND}}, ("rotor_speed", "battery"))
    regression, joint = _null_fit(frames, vehicle)
    moved = operating_point(regression, joint, from_vehicle(vehicle))
    assert moved, "one linear step would do: the case is too easy to test anything"
    given, there = (
        sum((r**2).sum() for r in residuals_with(regression.system, model))
        for model in (regression.system.model, with_corrections(regression.system.model, moved))
    )
    assert there < given
    assert moved["thrust_curve.c"] > 0.1 and moved["thrust_scale.scale"] < -0.1


@pytest.mark.parametrize("share", [0.85, 1.0])
def test_a_declared_number_beyond_four_sds_is_a_finding(flown, sheet, share):
    vehicle = sheet(max_rotor_speed_rad_s={"value": 1000 * share, "sd": 20.0})
    found = ges.diagnose(_frames(flown, sheet(), {}), vehicle, holdout=["flight4"])
    assert found.verdict == ("parameter" if share < 1.0 else "nothing_proven"), found.sentence
    assert ("wrong about max rotor speed" in found.sentence) == (share < 1.0)
    moved = found.calibration["vehicle.max_rotor_speed_rad_s"]["value"]
    assert moved == pytest.approx(1000 * (1.0 - share), abs=10.0)


def test_a_number_with_two_corrections_is_contradicted_once():
    up = Contradicted("motor_lag.up_s", -0.027, 0.001, 0.005, -0.9)
    down = Contradicted("motor_lag.down_s", -0.026, 0.001, 0.005, -0.87)
    remark = remark_of("parameter", [up, down], None, {})
    assert remark == up.sentence() and "motor_time_constant_s" in remark


def test_calibrate_refuses_a_file_that_is_too_far_off(flown, sheet):
    """A correction of +1150 % would be written as the +900 % that the library flies."""
    far = sheet(thrust_coefficient_N_s2={"value": 4.8e-7, "sd_rel": 0.5})
    frames = _frames(flown, sheet(), {})
    recordings = make_set(far, [(f"f{i}", f) for i, f in enumerate(frames)])
    with pytest.raises(GesError, match="corrected by .* correct mass_kg or thrust_coefficient"):
        calibrate(recordings)


def test_what_lies_beyond_the_bounds_of_its_parameters_is_not_tried(flown, sheet):
    """Flights of a kilometre: places are too far apart for the wake of another vehicle."""
    model = from_vehicle(sheet())
    frame = flown(sheet(), {}, manoeuvres.make("straight_runs", 20.0), 1)
    flight = pass_gate([frame], model, ["f"]).flights[0]
    assert "downwash" in library(model, flight_envelope([flight], model.radius_m))
    for name in ("p_x_m", "p_y_m"):
        flight.columns[name] = 300.0 * np.asarray(flight.columns[name])
    far = flight_envelope([flight], model.radius_m)
    assert "downwash" not in library(model, far)
    assert "width_m" in out_of_reach(effects.get("downwash"), model, far)


def test_a_trim_of_a_calibrated_file_that_moved_far_is_a_change_whose_cause_is_open():
    """*Nothing proven* beside a trim 5 sds away from its file would contradict itself."""
    moved = Contradicted("weak_rotor.loss_1", 0.06, 0.004, 0.012, 0.06)
    assert moved.is_trim and "vehicle has changed" in moved.sentence()
    assert verdict_of((), [moved], (), ()) == "unknown"
    number = Contradicted("thrust_scale.scale", 0.3, 0.01, 0.03, 0.3)
    assert not number.is_trim and verdict_of((), [number, moved], (), ()) == "parameter"
    assert verdict_of((), [], (), ()) == "nothing_proven"
    assert verdict_of((), [], ["a law"], ["structure"]) == "law"
