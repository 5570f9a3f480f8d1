"""Vehicles with other than four rotors fly, with the same bits at every lane width; what a rotor
has of its own acts; a payload and a wake from above do what their papers say.
"""

import numpy as np
import pytest

from ges.conventions import rotor_speed
from ges.errors import GesError
from ges.simulator import effects
from ges.simulator.flight import Flight, fly
from ges.simulator.terrain import Terrain
from ges.vehicle.airframe import from_layout
from ges.vehicle.file import parse_vehicle
from ges.vehicle.propeller import Propeller

FRAMES = ("hexa-x", "octo-x", "x8", "y6-b", "deca-plus", "dodeca-x")
G_M_S2 = 9.80665


def numbers_of(frame: str, **more) -> dict[str, float]:
    """A vehicle of 0.3 kg a rotor."""
    found = from_layout(frame, Propeller.parse("6in"), 0.6)
    vehicle = parse_vehicle(
        {
            "name": frame,
            "mass_kg": 0.3 * len(found.rotors),
            "inertia_kg_m2": {"xx": 0.03, "yy": 0.03, "zz": 0.05},
            "rotors": [rotor.model_dump(exclude_none=True) for rotor in found.rotors],
            "thrust_coefficient_N_s2": 1.5e-5,
            "torque_coefficient_Nm_s2": 2.4e-7,
            "motor_time_constant_s": 0.023,
            "max_rotor_speed_rad_s": 900,
        }
    )
    return {**vehicle.parameters(), "terrain_kind": 0, "mode": 0, "duration_s": 6.0, **more}


@pytest.mark.parametrize("frame", FRAMES)
def test_frames_hold_height_and_heading(frame):
    record = fly([Flight(numbers_of(frame), terrain=Terrain.flat())])[0]
    assert record.status == "ok"
    late = record["t_s"] > 4.0
    np.testing.assert_allclose(record["agl_m"][late], 0.22, atol=0.03)
    assert np.abs(record["v_x_m_s"][late] - 1.34).max() < 0.15
    assert np.abs(record["omega_z_rad_s"][late]).max() < 0.1
    columns = [name for name in record.columns if name.startswith("rotor_speed_")]
    assert columns == list(rotor_speed(int(numbers_of(frame)["rotors"])))


@pytest.mark.parametrize("frame", ["hexa-x", "x8", "y6-b", "deca-plus"])
def test_every_lane_width_gives_the_same_bits(frame):
    flights = [
        Flight(
            numbers_of(frame, seed=float(seed), duration_s=1.0),
            {"ground_effect": {"amplitude": 1.0}, "weak_rotor": {"loss_2": 0.1}},
            Terrain.flat(),
        )
        for seed in range(1, 6)
    ]
    one, *others = (fly(flights, lanes=lanes) for lanes in (1, 2, 4, 8))
    for other in others:
        for a, b in zip(one, other, strict=True):
            for name in a.columns:
                np.testing.assert_array_equal(a[name], b[name])


def _alike_but_for_one(numbers: dict[str, float]) -> dict[str, float]:
    # a rotor that is not quite like the others is flown by the unit of all vehicles
    return {**numbers, "rotor_1_lag": 1.0 + 1e-13}


@pytest.mark.parametrize("frame", ["x", "hexa-x", "octo-x", "x8"])
def test_the_unit_of_all_vehicles_flies_as_those_of_fixed_numbers(frame):
    numbers = numbers_of(frame, duration_s=2.0)
    on = {"ground_effect": {}, "rotor_drag": {}, "esc_delay": {}, "cg_offset": {}}
    fixed, general = fly(
        [
            Flight(numbers, on, Terrain.flat()),
            Flight(_alike_but_for_one(numbers), on, Terrain.flat()),
        ]
    )
    for name in ("p_x_m", "p_z_m", "q_w", "rotor_speed_3_rad_s", "u_4"):
        np.testing.assert_allclose(fixed[name], general[name], rtol=1e-6, atol=1e-7)


def test_rotors_that_cannot_make_yaw_are_refused_by_the_firmware_and_replayed():
    alike = {**numbers_of("hexa-x"), **{f"rotor_{i}_spin": 1.0 for i in range(1, 7)}}
    # yaw is the thrust in another unit then
    with pytest.raises(GesError, match="cannot make thrust and three moments"):
        fly([Flight(alike, terrain=Terrain.flat())])
    assert fly([_replayed(alike)])[0].status == "ok"


def _replayed(numbers: dict[str, float]) -> Flight:
    n = int(numbers["rotors"])
    table = np.column_stack([np.full((50, n), 0.5), np.tile([1.0, 0, 0, 0, 16, 0, 0, 0], (50, 1))])
    given = {**numbers, "control": "replayed_commands", "start": 1, "start_p_z_m": 50.0}
    return Flight({**given, "duration_s": 0.4}, terrain=Terrain.flat(), inputs=table)


def test_the_network_flies_four_rotors_alone():
    with pytest.raises(GesError, match="reads the speeds of 4 rotors"):
        fly([Flight({**numbers_of("hexa-x"), "mode": "ml"}, terrain=Terrain.flat())])


def test_where_motors_reach_their_limits_roll_and_pitch_go_before_yaw():
    """Heavy, and asked for another heading all the time: yaw may wait, the path may not."""
    n = 400
    reference = np.zeros((n, 14))
    reference[:, 2] = 5.0
    reference[:, 1] = 0.5 * np.sin(0.02 * np.arange(n))
    reference[:, 4] = 1.0 * np.cos(0.02 * np.arange(n))
    reference[:, 9] = 2.5 * np.sign(np.sin(0.05 * np.arange(n)))
    errors = []
    for allocation in (0, 1):
        numbers = numbers_of(
            "hexa-x",
            mass_kg=5.5,
            allocation=allocation,
            altitude_source=1,
            yaw_kp=100.0,
            inputs_dt_s=0.01,
            duration_s=4.0,
        )
        record = fly([Flight(numbers, terrain=Terrain.flat(-50.0), inputs=reference)])[0]
        assert record.status == "ok"
        away = [record[f"p_{a}_m"] - record[f"p_ref_{a}_m"] for a in "yz"]
        errors.append(np.sqrt(np.mean(np.square(away), axis=1)))
    # commands that are held one by one add up to another thrust
    aside, up = np.array(errors[1]) / np.array(errors[0])
    assert aside < 0.6 and up < 0.1


def _hovering(numbers: dict[str, float], speed: float, **more) -> effects.Samples:
    n = int(numbers["rotors"])
    columns = {"t_s": np.arange(3) * 0.01, "p_z_m": np.full(3, 50.0)}
    return effects.Samples.from_columns(
        {**columns, **dict.fromkeys(rotor_speed(n), np.full(3, speed)), **more}
    )


def test_a_canted_rotor_pushes_along_its_axis():
    numbers = numbers_of("hexa-x")
    canted = {**numbers, "rotor_2_axis_x": 0.75, "rotor_2_axis_z": 1.0}
    straight = effects.replay(numbers, _hovering(numbers, 400.0))
    turned = effects.replay(canted, _hovering(canted, 400.0))
    thrust = numbers["thrust_coefficient_N_s2"] * 400.0**2
    change = turned.force_N[0] - straight.force_N[0]
    # an axis of any length is a direction: here 0.6 forward, 0.8 up
    np.testing.assert_allclose(change, thrust * np.array([0.6, 0.0, -0.2]), atol=1e-12)
    hub = np.array([numbers[f"rotor_2_{a}_m"] for a in "xyz"])
    spin, torque = numbers["rotor_2_spin"], numbers["torque_coefficient_Nm_s2"] * 400.0**2
    reaction = -spin * torque * np.array([0.6, 0.0, -0.2])
    moment = np.cross(hub, change) + reaction
    np.testing.assert_allclose(turned.moment_Nm[0] - straight.moment_Nm[0], moment, atol=1e-12)


def test_a_rotor_may_have_numbers_of_its_own():
    numbers = numbers_of("octo-x")
    own = {**numbers, "rotor_5_thrust": 0.8, "rotor_5_torque": 1.5, "rotor_5_lag": 4.0}
    plain, strange = (effects.replay(n, _hovering(n, 400.0)) for n in (numbers, own))
    assert strange["thrust_5_N"][0] == pytest.approx(0.8 * plain["thrust_5_N"][0])
    assert strange["thrust_4_N"][0] == plain["thrust_4_N"][0]
    yaw = -numbers["rotor_5_spin"] * 0.5 * numbers["torque_coefficient_Nm_s2"] * 400.0**2
    assert strange.moment_Nm[0, 2] - plain.moment_Nm[0, 2] == pytest.approx(yaw)
    speeds = fly([_replayed(own)])[0]
    risen = [speeds[f"rotor_speed_{i}_rad_s"] - speeds["rotor_speed_4_rad_s"][0] for i in (4, 5)]
    # after a time constant one has gone 63 % of its way, the other 22 %
    at = int(np.argmin(np.abs(speeds["t_s"] - numbers["motor_time_constant_s"])))
    assert abs(risen[1][at]) < 0.5 * abs(risen[0][at])


def test_a_payload_in_the_middle_is_a_heavier_vehicle():
    numbers = numbers_of("hexa-x", duration_s=2.0)
    heavier = {**numbers, "mass_kg": numbers["mass_kg"] + 0.4, "fw_mass_kg": numbers["mass_kg"]}
    light = {**numbers, "fw_mass_kg": numbers["mass_kg"]}
    a = fly([Flight(heavier, terrain=Terrain.flat())])[0]
    b = fly([Flight(light, {"payload": {"mass_kg": 0.4}}, Terrain.flat())])[0]
    late = a["t_s"] > 1.0
    np.testing.assert_allclose(a["p_z_m"][late], b["p_z_m"][late], atol=2e-3)


def test_a_payload_beside_the_middle_is_its_weight_times_its_lever():
    """In hover: Newton and Euler about a point beside the common centre of mass."""
    numbers = numbers_of("x")
    m, share, x, y = numbers["mass_kg"], 0.2, 0.1, -0.05
    speed = np.sqrt((1.0 + share) * m * G_M_S2 / (4.0 * numbers["thrust_coefficient_N_s2"]))
    found = effects.evaluate(
        "payload",
        {"mass_kg": share * m, "x_m": x, "y_m": y},
        _hovering(numbers, speed),
        numbers,
    )
    np.testing.assert_allclose(
        found.moment_Nm[0], share * m * G_M_S2 * np.array([-y, x, 0.0]), rtol=1e-12
    )
    assert found["mass_kg"][0] == pytest.approx(share * m)
    np.testing.assert_allclose(
        [found[f"i{a}_kg_m2"][0] for a in ("xx", "yy", "zz")],
        share * m * np.array([y * y, x * x, x * x + y * y]),
    )
    # fast turning throws it outwards: F = -m_p omega x (omega x r)
    spun = effects.evaluate(
        "payload",
        {"mass_kg": share * m, "x_m": x, "y_m": 0.0},
        _hovering(numbers, speed, omega_z_rad_s=np.full(3, 5.0)),
        numbers,
    )
    assert spun.force_N[0, 0] == pytest.approx(share * m * 25.0 * x)


def test_a_lower_rotor_loses_in_the_wake_of_the_one_above_it():
    numbers = numbers_of("x8")
    samples = _hovering(numbers, 400.0)
    lost = effects.evaluate("coaxial_wake", {"c": 0.25}, samples, numbers)
    thrust = numbers["thrust_coefficient_N_s2"] * 400.0**2
    below = [numbers[f"rotor_{i}_z_m"] < 0.0 for i in range(1, 9)]
    np.testing.assert_allclose(lost.thrust_N[0], np.where(below, -0.25 * thrust, 0.0))
    fast = _hovering(numbers, 400.0, v_x_m_s=np.full(3, 12.0))
    swept = effects.evaluate("coaxial_wake", {"c": 0.25}, fast, numbers)
    assert 0.0 < -swept.force_N[0, 2] < -0.9 * lost.force_N[0, 2]
    flat = numbers_of("octo-x")
    none = effects.evaluate("coaxial_wake", {"c": 0.25}, _hovering(flat, 400.0), flat)
    assert np.nanmax(np.abs(none.data)) == 0.0


@pytest.mark.parametrize("speed_ratio", [1.0, 1.4, 2.0])
@pytest.mark.parametrize("v_x_m_s", [0.0, 1.5, 4.0, 6.0, 40.0])
def test_of_a_wake_that_is_carried_aside_the_part_over_the_lower_disc_counts(speed_ratio, v_x_m_s):
    numbers = numbers_of("x8")
    samples = _hovering(numbers, 400.0, v_x_m_s=np.full(3, v_x_m_s))
    lost = effects.evaluate(
        "coaxial_wake", {"c": 0.25, "speed_ratio": speed_ratio}, samples, numbers
    )
    below = min(range(1, 9), key=lambda i: numbers[f"rotor_{i}_z_m"])
    radius = numbers[f"rotor_{below}_radius_m"]
    thrust = numbers["thrust_coefficient_N_s2"] * 400.0**2
    induced = np.sqrt(thrust / (2.0 * numbers["rho_kg_m3"] * np.pi * radius**2))
    drop = max(numbers[f"rotor_{i}_z_m"] for i in range(1, 9)) - numbers[f"rotor_{below}_z_m"]
    aside = v_x_m_s * drop / (0.5 * (1.0 + speed_ratio) * induced)
    # the wake's circle, point by point
    wake = radius / np.sqrt(speed_ratio)
    x, y = np.meshgrid(*[np.linspace(-wake, wake, 801)] * 2)
    inside = np.hypot(x, y) <= wake
    share = np.mean(np.hypot(x + aside, y)[inside] <= radius)
    assert lost.thrust_N[0, below - 1] == pytest.approx(-0.25 * thrust * share, abs=5e-4 * thrust)
