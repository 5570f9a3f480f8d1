"""Plant it, see it found: candidates at the sizes given here, in flights of the project's own simulator.

Both sides have the same form here, so this shows that each signature is right, not how good the diagnosis is; that is what
concealed cases are for (docs/proof.md).
"""

import numpy as np
import pytest

import ges
from ges import manoeuvres

ACC = ("acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2")
LOGGED = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s", *ACC, "u_1", "u_2", "u_3", "u_4", "range_m", "battery_V",
          "p_ref_x_m", "p_ref_y_m", "p_ref_z_m", "v_ref_x_m_s", "v_ref_y_m_s", "v_ref_z_m_s", "yaw_ref_rad")  # fmt: skip
PLANS = (("height_staircase", 30.0), ("straight_runs", 30.0), ("climbs", 20.0), ("multisine", 20.0), ("yaw_turn", 20.0))
DRAG = {"rotor_drag": {"k_kg": 1e-4}}
CUSHION = {"ground_effect": {"form": 3, "c_a": 0.5, "decay": 1.0, "high": 10}}
PLANTED = {
    "ground_effect": CUSHION,
    "fountain_lift": {"fountain_lift": {"c_b": 0.1, "c_s": 1.0}},
    "rotor_drag": DRAG,
    "parasitic_drag": {"parasitic_drag": {"area_m2": 0.08}},
    "axial_inflow": {"axial_inflow": {"k_kg": 3e-4}},
    "translational_lift": {"translational_lift": {"c": 0.6}},
    "wind": {**DRAG, "wind": {"east_m_s": 2.5, "north_m_s": 1.0}},
    "battery_sag": {"battery_sag": {"sensitivity": 0.8, "nominal_V": 16, "drop_V_s": 0.06, "load_V": 0.5}},
    "motor_lag": {"motor_lag": {"up_s": 0.05, "down_s": 0.05}},
    "esc_delay": {"esc_delay": {"delay_s": 0.03}},
    "thrust_curve": {"thrust_curve": {"c": 0.3}},
    "weak_rotor": {"weak_rotor": {"loss_2": 0.15}},
    "cg_offset": {"cg_offset": {"x_m": 0.012, "y_m": 0.0}},
    "rotor_tilt": {"rotor_tilt": {"x_rad": 0.04, "y_rad": 0.0}},
    "rotor_inertia_reaction": {"rotor_inertia_reaction": {"inertia_kg_m2": 1.5e-4}},
    "tether": {"tether": {"weight_N_m": 0.5}},
    "slung_load": {"slung_load": {"mass_kg": 0.12, "length_m": 0.5}},
    "thrust_scale": {"thrust_scale": {"scale": -0.2}},
    "torque_coefficient": {"torque_coefficient": {"scale": 0.6}},
    "rangefinder_bias": {"rangefinder_bias": {"bias_m": 0.1}},
    "accelerometer_bias": {"accelerometer_bias": {"x_m_s2": 0.5}},
    "gyro_bias": {"gyro_bias": {"x_rad_s": 0.05}},
}


@pytest.fixture(scope="module")
def vehicle(sheet):
    return sheet(motor_time_constant_s={"value": 0.023, "sd_rel": 0.12}, max_rotor_speed_rad_s={"value": 1000, "sd_rel": 0.01})


def _recordings(flown, vehicle, effects):
    """Every manoeuvre once, the references and the excitation logged."""
    frames = []
    for seed, (plan, seconds) in enumerate(PLANS, 1):
        table = manoeuvres.make(plan, seconds)
        frame, asked = flown(vehicle, effects, table, seed, LOGGED), manoeuvres.to_frame(table)
        excitation = {c: np.interp(frame["t_s"], asked["t_s"], asked[c]) for c in manoeuvres.COLUMNS[10:]}
        frames.append(frame.assign(**excitation))
    return frames


@pytest.mark.parametrize("name", PLANTED)
def test_planted_effect_is_found(name, flown, vehicle):
    found = ges.diagnose(_recordings(flown, vehicle, PLANTED[name]), vehicle, holdout=["flight5"])
    named = {f.name for f in found.findings}
    assert name in named, found.sentence
    assert named <= set(PLANTED[name]) | {name}, found.sentence


def test_nothing_planted_nothing_found(flown, vehicle):
    found = ges.diagnose(_recordings(flown, vehicle, {}), vehicle)
    assert found.verdict == "nothing_proven", found.sentence
    assert found.detectable["ground_effect"]["smallest"]
