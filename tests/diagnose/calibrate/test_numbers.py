"""Spread between flights, trims and corrections of a vehicle file, by arithmetic alone."""

import pytest

from ges.diagnose.calibrate import calibrate as module
from ges.diagnose.calibrate.calibrate import Correction
from ges.diagnose.detectors.balance import LOSSES
from ges.diagnose.settings import settings
from ges.diagnose.types.model import SPEED
from ges.errors import GesError
from ges.vehicle.file import parse_vehicle

from ..synthetic import MODEL, hovering

SHEET = {
    "name": "quad",
    "mass_kg": {"value": 1.0, "sd": 0.02},
    "inertia_kg_m2": {"xx": 0.01, "yy": 0.01, "zz": 0.018, "sd_rel": 0.1},
    "rotors": [
        {"x_m": 0.1 * x, "y_m": 0.1 * y, "radius_m": 0.1, "spin": spin}
        for x, y, spin in ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw"))
    ],
    "thrust_coefficient_N_s2": {"value": 6e-6, "sd_rel": 0.03},
    "torque_coefficient_Nm_s2": {"value": 1e-7, "sd_rel": 0.1},
    "max_rotor_speed_rad_s": {"value": 1000.0, "sd": 20.0},
}


def _number(value, later_sd=0.01, declared_sd=0.05):
    return Correction(value, 0.5 * later_sd, 0.0, 0.0, declared_sd, later_sd)


def test_what_commands_alone_tell_is_one_number():
    told = module._with_free_trims(MODEL, [hovering()]).prior_sds
    assert {told[key] for key in LOSSES[:4]} == {settings.calibrate.loss_sd}
    assert told["cg_offset.x_m"] == 0.0 and SPEED not in told
    commanded = hovering(**{f"rotor_speed_{i}_rad_s": None for i in range(1, 5)})
    told = module._with_free_trims(MODEL, [commanded]).prior_sds
    assert told[SPEED] == 0.0 and told["thrust_curve.c"] == 0.0


@pytest.mark.parametrize(("value", "flown"), [(0.2, 0.2), (-0.72, -0.7)])
def test_a_correction_that_is_beyond_by_noise_is_at_its_bound(value, flown):
    assert module._within_flown_bounds("inertia.xx", value, 0.01, MODEL) == pytest.approx(flown)
    assert module._within_flown_bounds("esc_delay.delay_s", -0.05, 1e-3, MODEL) == 0.0, (
        "no nominal parameter"
    )


def test_a_correction_that_is_clearly_beyond_is_refused_in_one_sentence():
    with pytest.raises(GesError, match=r"need inertia\.xx corrected by -0\.9, and the simulator"):
        module._within_flown_bounds("inertia.xx", -0.9, 0.01, MODEL)


def test_corrections_are_folded_into_the_numbers_that_they_correct():
    vehicle = parse_vehicle(SHEET)
    numbers = {
        "thrust_scale.scale": _number(-0.1, 0.02),
        "inertia.xx": _number(0.2, 0.03),
        "inertia.zz": _number(-0.1, 0.04),
        SPEED: _number(25.0, 5.0),
    }
    told = module._corrected_fields(vehicle, numbers)
    assert told["thrust_coefficient_N_s2"].value == pytest.approx(5.4e-6)
    assert told["thrust_coefficient_N_s2"].sd == pytest.approx(0.02 * 6e-6)
    assert told["mass_kg"].value == 1.0 and told["mass_kg"].sd == 0.0, "one of the two takes it"
    inertia = told["inertia_kg_m2"]
    assert (inertia.xx, inertia.yy, inertia.zz) == pytest.approx((0.012, 0.01, 0.0162))
    assert inertia.sd_rel == pytest.approx(0.04), "the widest of them"
    assert told["max_rotor_speed_rad_s"].value == 1025.0
    assert told["max_rotor_speed_rad_s"].sd == 5.0


def test_trims_are_written_as_effects_about_what_the_file_had():
    vehicle = parse_vehicle({**SHEET, "effects": {"weak_rotor": {"loss_1": {"value": 0.02}}}})
    numbers = {LOSSES[0]: _number(0.03), LOSSES[1]: _number(-0.01), "inertia.xx": _number(0.2)}
    told = module._effects_of_file(vehicle, numbers)
    loss = told["weak_rotor"]["loss_1"]
    assert loss.value == pytest.approx(0.05) and loss.sd == 0.01
    assert loss.ci95 == pytest.approx((0.05 - 1.96 * 0.005, 0.05 + 1.96 * 0.005))
    assert told["weak_rotor"]["loss_2"].value == pytest.approx(-0.01)
    assert told["cg_offset"]["x_m"].value == 0.0 and "inertia" not in told


def test_a_number_far_from_its_declared_doubt_is_said_and_trims_are_not():
    far = module._moved_warnings(
        {"inertia.xx": _number(0.4), "inertia.yy": _number(0.1), LOSSES[0]: _number(0.4)}
    )
    assert len(far) == 1 and far[0].startswith("inertia.xx moved by 0.4, 8.0 times its prior sd")
    low, high = _number(0.1, 0.02).ci95
    assert (low, high) == pytest.approx((0.1 - 0.0196, 0.1 + 0.0196))


def test_a_top_speed_is_no_surer_in_later_flights_than_thrust_by_commands():
    """Gains by commands spread by 2 % between flights, and speed goes as the root of thrust."""
    assert module._usual_sd(SPEED, MODEL) == pytest.approx(
        0.01 * MODEL.number("max_rotor_speed_rad_s")
    )
    assert module._usual_sd("battery_sag.sensitivity", MODEL) > 0.0
    assert module._usual_sd("inertia.xx", MODEL) == 0.0
