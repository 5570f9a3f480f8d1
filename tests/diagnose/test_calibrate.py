"""Calibration on reference flights: simulated ones with known truth, and published healthy flights of small quadrotors."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from ges import manoeuvres, sim
from ges.calibrate import LOSSES, calibrate
from ges.cli import cli
from ges.errors import GesError
from ges.io.recording import make_set, write_set
from ges.io.usd import read_usd
from ges.terrain import Terrain
from ges.vehicle import load_vehicle, parse_vehicle

ROOT = Path(__file__).resolve().parents[2]
VEHICLE = {
    "name": "quad",
    "mass_kg": {"value": 1.0, "sd": 0.02},
    "inertia_kg_m2": {"xx": 0.01, "yy": 0.01, "zz": 0.018, "sd_rel": 0.1},
    "rotors": [
        {"x_m": 0.12 * x, "y_m": 0.12 * y, "radius_m": 0.1, "spin": spin}
        for x, y, spin in ((1, -1, "ccw"), (-1, 1, "ccw"), (1, 1, "cw"), (-1, -1, "cw"))
    ],
    "thrust_coefficient_N_s2": {"value": 6e-6, "sd_rel": 0.03},
    "torque_coefficient_Nm_s2": {"value": 1e-7, "sd_rel": 0.1},
    "max_rotor_speed_rad_s": 1000,
}
REFERENCES = ("p_ref_x_m", "p_ref_y_m", "p_ref_z_m", "v_ref_x_m_s", "v_ref_y_m_s", "v_ref_z_m_s", "yaw_ref_rad")
LOGGED = ("p_x_m", "p_y_m", "p_z_m", "v_x_m_s", "v_y_m_s", "v_z_m_s", "q_w", "q_x", "q_y", "q_z", "rotor_speed_1_rad_s",
          "rotor_speed_2_rad_s", "rotor_speed_3_rad_s", "rotor_speed_4_rad_s", *REFERENCES)  # fmt: skip
GYRO = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")


def _flown(vehicle, effects: dict, plan: str, seed: int) -> pd.DataFrame:
    table = manoeuvres.make(plan, 20.0)
    numbers = {**vehicle.parameters(), "seed": seed, "altitude_source": 1, "mode": "none", "inputs_dt_s": manoeuvres.STEP_S,
               "duration_s": 20.0}  # fmt: skip
    (record,) = sim.fly([sim.Flight(numbers, effects, Terrain.flat(), table)], ("t_s", *LOGGED, *GYRO))
    frame = pd.DataFrame(record.columns).rename(columns={name: name.replace("gyro", "omega") for name in GYRO})
    rng = np.random.default_rng(seed)
    for column in frame:
        noise = 0.02 if column.startswith(("v_", "omega")) else 0.001 if column.startswith("q_") else 0.0
        noise = 0.0 if column in REFERENCES else noise
        frame[column] += rng.normal(0.0, noise, len(frame))
    return frame


def _losses(*values: float) -> dict[str, float]:
    return {f"loss_{i}": v for i, v in enumerate(values, 1)}


def _reference(vehicle, *losses: dict) -> list[tuple[str, pd.DataFrame]]:
    plans = ("straight_runs", "multisine", "multisine")
    common = {"thrust_scale": {"scale": 0.02}, "inertia": {"xx": 0.08, "yy": -0.05, "zz": 0.0}}
    return [
        (f"f{k}", _flown(vehicle, {**common, "weak_rotor": loss}, plan, k))
        for k, (plan, loss) in enumerate(zip(plans, losses, strict=True), 1)
    ]


@pytest.fixture(scope="module")
def vehicle():
    return parse_vehicle(VEHICLE)


@pytest.fixture(scope="module")
def known(vehicle):
    """Flights of a vehicle with 2 % more thrust, other inertia and 5 % lost at rotor 2, calibrated."""
    return calibrate(make_set(vehicle, _reference(vehicle, *[_losses(0.0, 0.05, 0.0, 0.0)] * 3)))


def test_true_numbers_are_found_the_common_gain_counted_as_thrust(known):
    truth = {"thrust_scale.scale": 1.02 * (1 - 0.05 / 4) - 1, "inertia.xx": 0.08, "inertia.yy": -0.05,
             **dict(zip(LOSSES, (-0.0125, 0.0375, -0.0125, -0.0125), strict=True))}  # fmt: skip
    for key, value in truth.items():
        assert known.numbers[key].value == pytest.approx(value, abs=0.006), key


def test_the_file_takes_the_corrections(known, vehicle):
    new = known.vehicle
    s = known.numbers["thrust_scale.scale"].value
    assert new.thrust_coefficient_N_s2.value == pytest.approx(6e-6 * (1 + s)) and new.mass_kg.sd == 0.0
    assert new.inertia_kg_m2.xx == pytest.approx(0.01 * (1 + known.numbers["inertia.xx"].value))
    assert new.inertia_kg_m2.sd_rel < vehicle.inertia_kg_m2.sd_rel
    loss = new.effects["weak_rotor"]["loss_2"]
    assert loss.ci95[0] < loss.value < loss.ci95[1] and loss.sd == known.numbers["weak_rotor.loss_2"].later_sd


def test_a_second_calibration_moves_nothing(known, vehicle):
    again = calibrate(make_set(known.vehicle, _reference(vehicle, *[_losses(0.0, 0.05, 0.0, 0.0)] * 3)))
    for key in ("thrust_scale.scale", *LOSSES, "inertia.xx", "inertia.yy"):
        assert abs(again.numbers[key].value) < 0.003, key


def test_flights_that_differ_make_later_doubts_wide(known, vehicle):
    differing = [_losses(0.0, 0.05 + d, 0.0, 0.0) for d in (-0.03, 0.0, 0.03)]
    spread = calibrate(make_set(vehicle, _reference(vehicle, *differing)))
    assert 0.008 < spread.spread < 0.04 and known.spread < 0.003
    assert spread.numbers[LOSSES[1]].later_sd > 4 * known.numbers[LOSSES[1]].later_sd


def test_without_inertia_only_the_thrust_is_told(vehicle):
    bare = parse_vehicle({k: v for k, v in VEHICLE.items() if k not in ("inertia_kg_m2", "torque_coefficient_Nm_s2")})
    found = calibrate(make_set(bare, _reference(vehicle, *[_losses(0.0, 0.05, 0.0, 0.0)] * 3)))
    thrust = found.numbers["thrust_scale.scale"]
    assert thrust.value == pytest.approx(1.02 * (1 - 0.05 / 4) - 1, abs=0.006) and thrust.flight_sd > 0.0
    assert not set(LOSSES) & set(found.numbers) and "weak_rotor" not in found.vehicle.effects


def test_a_declared_doubt_frees_the_centre_of_gravity(vehicle):
    doubtful = parse_vehicle({**VEHICLE, "effects": {"cg_offset": {"x_m": {"value": 0.0, "sd": 0.003}}}})
    found = calibrate(make_set(doubtful, _reference(vehicle, *[_losses(0.0, 0.05, 0.0, 0.0)] * 3)))
    moved = found.numbers["cg_offset.x_m"]
    assert 0.0 < abs(moved.value) < 0.006 and found.vehicle.effects["cg_offset"]["x_m"].value == moved.value
    assert "cg_offset.y_m" not in found.numbers


def test_one_flight_is_refused_with_a_sentence(vehicle):
    frames = _reference(vehicle, *[_losses(0, 0, 0, 0)] * 3)[:1]
    with pytest.raises(GesError, match="needs two or more"):
        calibrate(make_set(vehicle, frames))


def test_verb_writes_a_vehicle_file_the_same_every_time(tmp_path, vehicle):
    write_set(tmp_path / "set", vehicle, _reference(vehicle, *[_losses(0.0, 0.05, 0.0, 0.0)] * 3))
    written = []
    for name in ("a.yaml", "b.yaml"):
        result = CliRunner().invoke(cli, ["calibrate", str(tmp_path / "set"), "--out", str(tmp_path / name)])
        assert result.exit_code == 0, result.output
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]
    assert load_vehicle(tmp_path / "a.yaml").effects["weak_rotor"]["loss_2"].value > 0.02


@pytest.mark.parametrize("airframe", ["E8", "E9"])
def test_small_quadrotors_gains_and_their_spread(recordings_dir, airframe):
    """Four healthy flights of one airframe: motor gains some per cent apart, and a spread of one to three per cent."""
    flights = [(p.name, read_usd(p)[0]) for p in sorted((recordings_dir / "crazypad" / "normal_flight").glob(f"{airframe}_*"))]
    found = calibrate(make_set(load_vehicle(ROOT / "config" / "vehicles" / "crazyflie.yaml"), flights))
    assert 0.01 < found.spread < 0.03 and not found.warnings
    assert found.seconds > 50.0
    for key in LOSSES:
        n = found.numbers[key]
        assert 0.02 < abs(n.value) < 0.15 and n.sd < n.later_sd < 0.04
    assert not any(key.startswith(("inertia", "motor_lag")) for key in found.numbers), "no rates were logged"
    assert found.vehicle.max_rotor_speed_rad_s.sd == 0.0 and found.vehicle.effects["thrust_curve"]["c"].sd == 0.0
    assert 0.0 < found.vehicle.thrust_coefficient_N_s2.sd < 0.02 * found.vehicle.thrust_coefficient_N_s2.value


def test_balance_of_commands_is_what_the_gains_say(recordings_dir):
    """The gains alone must explain the mean commands in slow flight: a 'strong' motor is asked for less."""
    paths = sorted((recordings_dir / "crazypad" / "normal_flight").glob("E9_*"))
    flights = [(p.name, read_usd(p)[0]) for p in paths]
    found = calibrate(make_set(load_vehicle(ROOT / "config" / "vehicles" / "crazyflie.yaml"), flights))
    gain = np.array([1.0 - found.vehicle.effects["weak_rotor"][f"loss_{i}"].value for i in range(1, 5)])
    mix = np.array([[-1, -1, 1, 1], [-1, 1, 1, -1], [1, -1, 1, -1]])  # roll, pitch, yaw of M1 front right ... M4 front left
    worst = []
    for _, f in flights:
        steady = f[(f.p_z_m > 0.4) & (np.hypot(f.v_x_m_s, f.v_y_m_s) < 0.1)]
        u = steady[[f"u_{i}" for i in range(1, 5)]].mean().to_numpy()
        worst.append([np.abs(mix @ (g * u)).max() / u.sum() for g in (np.ones(4), gain)])
    plain, balanced = np.mean(worst, axis=0)
    assert balanced < 0.4 * plain
