"""Scores of laws, against coefficients worked out by hand."""

import math

import numpy as np
import pytest

from ges.blind.score.laws import law_outcome, law_scores
from ges.vehicle.file import parse_vehicle

MASS_KG, RADIUS_M, GRAVITY_M_S2, RHO_KG_M3 = 0.5, 0.1, 9.80665, 1.225
VEHICLE = parse_vehicle(
    {
        "name": "quad",
        "mass_kg": MASS_KG,
        "inertia_kg_m2": {"xx": 0.003, "yy": 0.003, "zz": 0.006},
        "rotors": [
            {"x_m": 0.12 * x, "y_m": 0.12 * y, "radius_m": RADIUS_M, "spin": spin}
            for x, y, spin in ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw"))
        ],
        "thrust_coefficient_N_s2": 5e-6,
        "torque_coefficient_Nm_s2": 1e-7,
        "max_rotor_speed_rad_s": 1500,
        "rho_kg_m3": RHO_KG_M3,
    }
)
WEIGHT_N = MASS_KG * GRAVITY_M_S2
HOVER_M_S = math.sqrt(WEIGHT_N / (2.0 * RHO_KG_M3 * 4.0 * math.pi * RADIUS_M**2))


def _answer(channel, powers, coefficient, *laws):
    truth = {"laws": [{"channel": channel, "powers": powers, "coefficient_SI": coefficient}]}
    content = {"laws": [{"channel": c, "form": form} for c, form in laws]}
    return law_outcome("a", truth, content, VEHICLE)


@pytest.mark.parametrize("form", ["0.1 m g (V_x/v_h)", "0.1 T (V_x/v_h)"])
def test_a_force_per_speed_is_read_by_the_speed_of_hover(form):
    found = _answer("force_y", {"V_x": 1}, 0.1 * WEIGHT_N / HOVER_M_S, ("force_y", form))
    assert found.right and found.error < 1e-3


@pytest.mark.parametrize("form", ["0.2 m g L (V_y/v_h)|V_y/v_h|", "0.2 m g L (V_y/v_h)^2"])
def test_a_square_is_one_whatever_its_sign(form):
    arm_m = math.hypot(0.12, 0.12)
    truth = 0.2 * WEIGHT_N * arm_m / HOVER_M_S**2
    found = _answer("moment_z", {"V_y": 2}, truth, ("moment_z", form))
    assert found.right and found.error < 1e-3


def test_another_channel_another_term_one_more_and_a_place_are_not_right():
    true = ("force_y", "0.1 m g (V_x/v_h)")
    for laws in (
        (),
        (("force_x", true[1]),),
        (("force_y", "0.1 m g (V_y/v_h)"),),
        (("force_y", true[1] + " + 0.2 m g (V_y/v_h)"),),
        (("force_y", "0.1 m g (V_x/v_h) near(1 m, 2 m, 0.5 m)"),),
        (true, ("force_z", "0.1 m g (R/h)")),
    ):
        found = _answer("force_y", {"V_x": 1}, 0.12, *laws)
        assert not found.right and np.isnan(found.error)


def test_coefficients_are_scored_where_the_terms_are_right():
    unit = WEIGHT_N / HOVER_M_S
    answers = [
        _answer("force_y", {"V_x": 1}, c * unit, ("force_y", "0.1 m g (V_x/v_h)"))
        for c in (0.101, 0.12)
    ]
    answers.append(_answer("force_y", {"V_x": 1}, unit))
    scores = law_scores(answers)
    assert scores["laws with the right terms"][0] == pytest.approx(2 / 3)
    assert scores["their coefficients within 5%"][0] == pytest.approx(0.5)
    assert law_scores([]) == {}
