"""Rigid body, rotors, contact, integrators, sensors and firmware behave as their equations say."""

import numpy as np
import pytest

from ges.errors import GesError, UsageError
from ges.simulator import flight as sim
from ges.simulator.terrain import Terrain

QUIET = {
    "gyro_noise_rad_s": 0,
    "acc_noise_m_s2": 0,
    "range_noise_m": 0,
    "rpm_noise_rad_s": 0,
    "current_noise_A": 0,
}
FREE = {**QUIET, "start": 1, "start_p_z_m": 50, "control": 2, "duration_s": 1}
FLAT = Terrain.flat()


def free_flight(speeds, columns=None, effects=None, **numbers):
    """Rotor speeds imposed, the rest free."""
    table = np.zeros((2, 12))
    table[:, :4], table[:, 4] = speeds, 1.0
    return sim.fly([sim.Flight({**FREE, **numbers}, effects or {}, FLAT, table)], columns)[0]


def test_free_fall():
    r = free_flight(0.0)
    assert np.allclose(r["v_z_m_s"], -9.80665 * r["t_s"], atol=1e-9)
    assert r["p_z_m"][-1] == pytest.approx(50 - 9.80665 / 2, abs=9.80665 * 0.001)
    assert np.allclose(r["acc_z_m_s2"], 0, atol=1e-12)


def test_hover_speed_carries_the_weight():
    hover = np.sqrt(1.2 * 9.80665 / (4 * 1.5e-5))
    r = free_flight(hover)
    assert np.allclose(r["p_z_m"], 50, atol=1e-9)
    assert np.allclose(r["acc_z_m_s2"], 9.80665, atol=1e-9)


def test_rotor_moments_turn_the_right_way():
    """Front-right and rear-left counter-clockwise: faster left rotors roll right, faster ccw rotors
    yaw clockwise.
    """
    base = np.full(4, 400.0)
    right_roll = free_flight(base + [0, 20, 20, 0])["omega_x_rad_s"][-1]
    nose_up = free_flight(base + [20, 0, 20, 0])["omega_y_rad_s"][-1]
    yaw = free_flight(base + [20, 20, 0, 0])["omega_z_rad_s"][-1]
    thrust = 1.5e-5 * (420**2 - 400**2)
    assert right_roll == pytest.approx(2 * thrust * 0.087681 / 0.057, rel=1e-3)
    assert nose_up < 0 and yaw < 0


def test_torque_free_rotation_keeps_momentum_and_energy():
    r = free_flight(
        0.0,
        start_omega_x_rad_s=3,
        start_omega_y_rad_s=0.1,
        start_omega_z_rad_s=1,
        integrator=1,
        duration_s=2,
    )
    inertia = np.array([0.057, 0.057, 0.097])
    omega = np.stack([r[f"omega_{a}_rad_s"] for a in "xyz"], 1)
    energy, momentum = (inertia * omega**2).sum(1), np.linalg.norm(inertia * omega, axis=1)
    assert np.allclose(energy, energy[0], rtol=1e-10) and np.allclose(
        momentum, momentum[0], rtol=1e-10
    )
    assert np.allclose(sum(r[f"q_{a}"] ** 2 for a in "wxyz"), 1, atol=1e-12)


def end_state(integrator, dt):
    """A smooth tumbling flight near the ground with drag, and motors following a command."""
    table = np.zeros((2, 12))
    table[:, :4], table[:, 4] = [0.62, 0.6, 0.58, 0.61], 1.0
    numbers = {
        **QUIET,
        "integrator": integrator,
        "dt_s": dt,
        "record_every": round(0.8 / dt),
        "duration_s": 0.8,
        "control": 1,
        "start": 1,
        "start_p_z_m": 0.4,
        "start_v_x_m_s": 2,
        "start_v_z_m_s": 0.5,
        "start_omega_z_rad_s": 1,
        "start_rotor_speed_1_rad_s": 400,
        "start_rotor_speed_2_rad_s": 420,
        "start_rotor_speed_3_rad_s": 440,
        "start_rotor_speed_4_rad_s": 430,
    }
    on = {"ground_effect": {}, "rotor_drag": {}, "parasitic_drag": {}, "axial_inflow": {}}
    r = sim.fly([sim.Flight(numbers, on, FLAT, table)])[0]
    return np.array(
        [
            r[n][-1]
            for n in (
                "p_x_m",
                "p_y_m",
                "p_z_m",
                "v_x_m_s",
                "v_z_m_s",
                "q_w",
                "q_y",
                "rotor_speed_1_rad_s",
            )
        ]
    )


@pytest.mark.parametrize(("integrator", "order", "dt"), [(0, 1, 0.002), (1, 4, 0.01)])
def test_error_falls_with_the_step_as_the_order_says(integrator, order, dt):
    exact = end_state(1, 0.0005)
    errors = [np.abs(end_state(integrator, dt / k) - exact) for k in (1, 2, 4)]
    ratios = [
        np.linalg.norm(a) / np.linalg.norm(b) for a, b in zip(errors, errors[1:], strict=False)
    ]
    assert np.allclose(ratios, 2**order, rtol=0.15)


def test_contact_holds_the_vehicle_and_is_recorded():
    r = free_flight(0.0, start_p_z_m=0.3, duration_s=3)
    rest = r["t_s"] > 2
    assert np.all(r["contact"][rest] == 1) and r["contact"][0] == 0
    depth = 1.2 * 9.80665 / (4 * 3000)
    assert np.allclose(r["p_z_m"][rest], 0.06 - depth, atol=1e-4)
    assert np.allclose(r["acc_z_m_s2"][rest], 9.80665, atol=0.05)


def test_friction_stops_a_sliding_vehicle():
    r = free_flight(0.0, start_p_z_m=0.059, start_v_x_m_s=1.0, duration_s=2)
    assert r["v_x_m_s"][-1] == pytest.approx(0, abs=1e-3)


def test_nonfinite_state_stops_its_lane_alone():
    flights = [
        sim.Flight({"seed": i, "duration_s": 3, **({"inputs_dt_s": 0.01} if i == 2 else {})})
        for i in range(6)
    ]
    table = np.zeros((2, 12))
    table[:, 4] = 1.0
    bad = table.copy()
    bad[1, 0] = np.nan
    free = [
        sim.Flight({**FREE, "seed": i, "inputs_dt_s": 0.5}, {}, FLAT, bad if i == 3 else table)
        for i in range(6)
    ]
    records = sim.fly(free)
    assert [r.stopped_field is None for r in records] == [True, True, True, False, True, True]
    assert "seed 3" in records[3].status and "is not finite" in records[3].status
    stopped = records[3]["t_s"]
    assert np.isnan(stopped[-1]) and np.isfinite(stopped[0])
    assert all(np.isfinite(r["p_z_m"]).all() for i, r in enumerate(records) if i != 3)
    assert all(r.status == "ok" for r in sim.fly(flights))


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"mass_kg": -1}, "mass_kg is -1 kg; allowed is"),
        ({"dt_s": 0}, "dt_s is 0"),
        ({"duration_s": float("nan")}, "duration_s is nan"),
        ({"terrain_features_max": 10, "terrain_features_min": 20}, "raise it"),
        ({"control": 1}, "no replay table"),
        ({"rotor_1_x_m": 0, "rotor_2_x_m": 0, "rotor_3_x_m": 0, "rotor_4_x_m": 0}, "rotors"),
    ],
)
def test_bad_numbers_give_one_sentence(numbers, words):
    with pytest.raises(GesError, match=words):
        sim.fly([sim.Flight({"duration_s": 0.1, **numbers})])


def test_unknown_names_offer_the_nearest():
    with pytest.raises(UsageError, match="did you mean 'mass_kg'"):
        sim.fly([sim.Flight({"mas_kg": 1})])
    with pytest.raises(UsageError, match="did you mean 'rotor_drag'"):
        sim.fly([sim.Flight({}, {"rotor_drg": {}})])
    with pytest.raises(UsageError, match="did you mean 'k_kg'"):
        sim.fly([sim.Flight({}, {"rotor_drag": {"k_g": 1}})])
    with pytest.raises(UsageError, match="did you mean 'oracle'"):
        sim.fly([sim.Flight({"mode": "orcle"})])


def test_rangefinder_sees_along_the_body_axis_and_ends_at_its_range():
    r = free_flight(
        0.0, start_p_z_m=2.0, start_q_w=np.cos(0.1), start_q_x=np.sin(0.1), duration_s=0.01
    )
    assert r["range_m"][0] == pytest.approx(2.0 / np.cos(0.2), rel=1e-9)
    assert np.isnan(free_flight(0.0, start_p_z_m=3.2, duration_s=0.01)["range_m"][0])


def test_sensor_noise_is_normal_with_the_given_deviation():
    r = sim.fly(
        [
            sim.Flight(
                {"duration_s": 200, "cruise_m_s": 0, "agl_ref_m": 1, "record_every": 4}, {}, FLAT
            )
        ]
    )[0]
    noise = (r["gyro_z_rad_s"] - r["omega_z_rad_s"])[::1] / 0.009
    assert abs(noise.mean()) < 0.02 and noise.std() == pytest.approx(1, abs=0.01)
    assert np.mean(noise**4) == pytest.approx(3, abs=0.1)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.02


def test_oracle_cancels_the_ground_effect_where_motors_are_instant():
    numbers = {**QUIET, "mode": "oracle", "cruise_m_s": 0, "agl_ref_m": 0.12, "duration_s": 10}
    r = sim.fly([sim.Flight(numbers, {"ground_effect": {"amplitude": 3}}, FLAT)])[0]
    end = r["t_s"] > 8
    u = np.sqrt(1.2 * 9.80665 / (4 * 1.5e-5)) / 900
    assert np.allclose(r["u_1"][end], u / np.sqrt(r["ge_factor"][end]), rtol=1e-3)
    assert np.all(r["ge_factor"][end] > 1.05)


def test_historical_mapping_overcorrects():
    def bias(mapping):
        numbers = {
            **QUIET,
            "mode": "oracle",
            "mapping": mapping,
            "altitude_ki": 0,
            "cruise_m_s": 0,
            "agl_ref_m": 0.12,
            "duration_s": 20,
        }
        return (
            sim.fly([sim.Flight(numbers, {"ground_effect": {"amplitude": 3}}, FLAT)])[0]["agl_m"][
                -1
            ]
            - 0.12
        )

    assert abs(bias(0)) < 2e-4
    assert bias(1) < -2e-3


def test_table_of_references_is_followed():
    t = np.arange(0, 20, 0.05)
    table = np.zeros((len(t), 14))
    table[:, 0], table[:, 3] = np.sin(0.5 * t), 0.5 * np.cos(0.5 * t)
    table[:, 6], table[:, 2], table[:, 9] = -0.25 * np.sin(0.5 * t), 1.0, 0.3
    flight = sim.Flight(
        {**QUIET, "altitude_source": 1, "inputs_dt_s": 0.05, "duration_s": 20}, {}, FLAT, table
    )
    r = sim.fly([flight])[0]
    late = r["t_s"] > 5
    assert np.abs(r["p_x_m"] - np.sin(0.5 * r["t_s"]))[late].max() < 0.05
    assert 2 * np.arctan2(r["q_z"], r["q_w"])[-1] == pytest.approx(0.3, abs=0.02)


def test_steady_drag_trim():
    """Steady speed: the tilt balances rotor drag, tan(theta) = k sum(w) V / (m g)."""
    r = sim.fly(
        [
            sim.Flight(
                {**QUIET, "agl_ref_m": 1, "mode": "none", "duration_s": 20},
                {"rotor_drag": {"k_kg": 2e-4}},
                FLAT,
            )
        ]
    )[0]
    pitch = np.arcsin(2 * (r["q_w"] * r["q_y"] - r["q_x"] * r["q_z"]))[-1]
    total = sum(r[f"rotor_speed_{i}_rad_s"][-1] for i in range(1, 5))
    assert np.tan(pitch) == pytest.approx(
        2e-4 * total * r["v_x_m_s"][-1] / (1.2 * 9.80665), rel=0.02
    )


def test_slung_load_swings_at_its_frequency():
    numbers = {**FREE, "duration_s": 20, "start_v_x_m_s": 0.5, "attitude_imposed": 1}
    table = np.zeros((2, 12))
    table[:, :4], table[:, 4] = np.sqrt(1.3 * 9.80665 / (4 * 1.5e-5)), 1.0
    on = {
        "slung_load": {"mass_kg": 0.1, "length_m": 1.0, "damping": 0.0},
        "rotor_drag": {"k_kg": 1e-4},
    }
    v = sim.fly([sim.Flight(numbers, on, FLAT, table)])[0]["v_x_m_s"]
    swing = v - np.polyval(np.polyfit(np.arange(len(v)), v, 6), np.arange(len(v)))
    frequency = np.fft.rfftfreq(len(swing), 0.01)[np.argmax(np.abs(np.fft.rfft(swing)))]
    assert frequency == pytest.approx(
        np.sqrt(9.80665 / 1.0 * (1 + 0.1 / 1.2)) / (2 * np.pi), abs=0.06
    )


def test_attitude_reading_is_turned_by_the_sensor_alone():
    angle = 0.04
    biased = sim.Flight({"duration_s": 1}, {"attitude_bias": {"x_rad": angle}}, Terrain.flat())
    plain = sim.Flight({"duration_s": 1}, {}, Terrain.flat())
    turned, true = sim.fly([biased, plain])
    assert turned["attitude_x"][0] == pytest.approx(np.sin(angle / 2), rel=1e-3)
    assert np.abs(turned["q_x"][-1]) > 1e-4, "the firmware flies by the reading"
    for a in "wxyz":
        assert np.allclose(true[f"attitude_{a}"], true[f"q_{a}"], atol=1e-15)
