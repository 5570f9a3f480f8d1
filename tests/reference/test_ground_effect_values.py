"""Ground effect forms against tabulated evaluations of the published formulas (they check the code,
not the physics).
"""

import numpy as np
import pytest

from ges.simulator import effects
from ges.simulator.terrain import Terrain

X = np.array([0.3, 0.5, 0.75, 1, 1.5, 2, 3, 4, 6])
R = 0.1
TABLE = {
    "cheeseman_bennett_1955": (
        {"form": 0, "high": 10},
        [3.2727, 1.3333, 1.1250, 1.0667, 1.0286, 1.0159, 1.0070, 1.0039, 1.0017],
    ),
    "hayden_1976": (
        {"form": 1, "high": 10},
        [1.9280, 1.3674, 1.1679, 1.0940, 1.0396, 1.0202, 1.0063, 1.0014, 1.0],
    ),
    "sanchez_cuevas_2017_without_body_lift": (
        {"form": 2, "k_b": 0, "high": 10},
        [3.4259, 1.3711, 1.1590, 1.0997, 1.0572, 1.0390, 1.0214, 1.0133, 1.0064],
    ),
    "sanchez_cuevas_2017_with_body_lift": (
        {"form": 2, "k_b": 2, "high": 10},
        [3.6358, 1.4229, 1.2095, 1.1531, 1.1110, 1.0870, 1.0551, 1.0365, 1.0185],
    ),
    "he_leang_exponential": (
        {"form": 3, "c_a": 0.4, "decay": 2.2},
        [1.2067, 1.1331, 1.0768, 1.0443, 1.0148, 1.0049, 1.0005, 1.0001, 1.0000],
    ),
}


def factor(values: dict, x: np.ndarray) -> np.ndarray:
    """Factor of rotor 1 hovering level at x radii over flat ground; neighbouring hubs 2.9 radii
    apart.
    """
    half = 2.9 * R / 2
    places = [(1, -1), (-1, 1), (1, 1), (-1, -1)]
    numbers = {f"rotor_{i}_radius_m": R for i in range(1, 5)}
    for i, (sx, sy) in enumerate(places, 1):
        numbers |= {f"rotor_{i}_x_m": sx * half, f"rotor_{i}_y_m": sy * half}
    samples = effects.Samples.from_columns(
        {
            "t_s": np.arange(len(x)) * 1.0,
            "p_z_m": x * R,
            "rotor_speed_1_rad_s": np.full(len(x), 400.0),
        }
    )
    return effects.replay(numbers, samples, {"ground_effect": values}, Terrain.flat())[
        "ge_factor_1"
    ]


@pytest.mark.parametrize("form", TABLE)
def test_form_matches_its_published_formula(form):
    values, expected = TABLE[form]
    assert np.allclose(factor(values, X), expected, atol=1e-3)


def test_clamp_of_the_study_binds_below_three_eighths_of_a_radius():
    f = factor({}, np.array([0.30, 0.374, 0.376]))
    assert f[0] == pytest.approx(1.8) and f[1] == pytest.approx(1.8) and f[2] < 1.8


@pytest.mark.parametrize(
    ("mass", "radius", "x", "v", "expected"),
    [(0.027, 0.0231, 1, 4, 1.032), (1.5, 0.12, 1, 4, 1.044)],
)
def test_cheeseman_bennett_fades_in_forward_flight(mass, radius, x, v, expected):
    k = 1e-5
    speed = np.sqrt(mass * 9.81 / (4 * k))
    numbers = {
        "mass_kg": mass,
        "thrust_coefficient_N_s2": k,
        **{f"rotor_{i}_radius_m": radius for i in range(1, 5)},
    }
    values = {"t_s": np.zeros(1), "p_z_m": np.array([x * radius]), "v_x_m_s": np.array([float(v)])}
    values |= {f"rotor_speed_{i}_rad_s": np.array([speed]) for i in range(1, 5)}
    on = {"ground_effect": {}, "ground_effect_forward_flight": {"c": 1}}
    f = effects.replay(numbers, effects.Samples.from_columns(values), on, Terrain.flat())[
        "ge_factor_1"
    ][0]
    # physics table: 1 + u / (1 + (V/v_h)^2) inside Cheeseman-Bennett's denominator; the library
    # fades the gain itself
    assert f == pytest.approx(expected, abs=2.5e-3)


def test_rotor_drag_of_a_crazyflie_is_three_percent_of_weight_per_metre_per_second():
    speed = 2150.0
    values = {"t_s": np.zeros(1), "v_x_m_s": np.ones(1)} | {
        f"rotor_speed_{i}_rad_s": np.array([speed]) for i in range(1, 5)
    }
    samples = effects.Samples.from_columns(values)
    force = effects.evaluate("rotor_drag", {"k_kg": 9.1785e-7}, samples, {}).force_N[0, 0]
    assert -force / (0.027 * 9.81) == pytest.approx(0.030, abs=0.001)


def test_network_equals_the_sample_stored_beside_its_weights():
    import re
    from pathlib import Path

    from ges.simulator import _lib

    header = (
        Path(__file__).resolve().parents[2] / "sim_c/firmware/ge_ff_mlp_weights.h"
    ).read_text()
    given = re.search(r"ges_mlp_sample_in\[13\] = \{([^}]*)\}", header).group(1)
    expected = re.search(r"ges_mlp_sample_out = ([^;]+);", header).group(1)
    features = np.array(
        [float.fromhex(v.strip().rstrip("f")) for v in given.split(",")], dtype=np.float32
    )
    assert _lib.network(features) == pytest.approx(
        float.fromhex(expected.strip().rstrip("f")), rel=1e-5
    )
