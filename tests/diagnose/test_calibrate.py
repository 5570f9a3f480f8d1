"""Calibration on reference flights: simulated ones with known truth, and published healthy flights
of small quadrotors.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from ges.cli import cli
from ges.conventions import command, rotor_speed
from ges.diagnose.calibrate.calibrate import LOSSES, calibrate
from ges.diagnose.design.system import build
from ges.diagnose.prepare.gate import pass_gate, with_flown_voltage
from ges.diagnose.types.model import from_vehicle
from ges.errors import GesError
from ges.recordings.readers import open_log
from ges.recordings.recording import make_set, write_set
from ges.simulator import manoeuvres
from ges.vehicle.load import load_vehicle

ROOT = Path(__file__).resolve().parents[2]


def _losses(*values: float) -> dict[str, float]:
    return {f"loss_{i}": v for i, v in enumerate(values, 1)}


@pytest.fixture(scope="module")
def reference(flown, with_rates, sheet):
    """Three flights of a vehicle with 2 % more thrust, other inertia and the given losses of rotor
    2.
    """
    common = {"thrust_scale": {"scale": 0.02}, "inertia": {"xx": 0.08, "yy": -0.05, "zz": 0.0}}
    plans = ("straight_runs", "multisine", "multisine")

    def make(*lost: float) -> list[tuple[str, pd.DataFrame]]:
        return [
            (
                f"f{k}",
                flown(
                    sheet(),
                    {**common, "weak_rotor": _losses(0.0, loss)},
                    manoeuvres.make(plan, 20.0),
                    k,
                    with_rates,
                ),
            )
            for k, (plan, loss) in enumerate(zip(plans, lost, strict=True), 1)
        ]

    return make


@pytest.fixture(scope="module")
def alike(reference):
    """Flights that all lost 5 % at rotor 2."""
    return reference(0.05, 0.05, 0.05)


@pytest.fixture(scope="module")
def vehicle(sheet):
    return sheet()


@pytest.fixture(scope="module")
def known(vehicle, alike):
    return calibrate(make_set(vehicle, alike))


def test_true_numbers_are_found_the_common_gain_counted_as_thrust(known):
    """And what turns in yaw as a cant: rotor 2 spins as rotor 1 does, so they share that part."""
    truth = {
        "thrust_scale.scale": 1.02 * (1 - 0.05 / 4) - 1,
        **dict(zip(LOSSES[:4], (-0.025, 0.025, 0.0, 0.0), strict=True)),
    }
    for key, value in truth.items():
        assert known.numbers[key].value == pytest.approx(value, abs=0.006), key
    for key, value in {"inertia.xx": 0.08, "inertia.yy": -0.05, "inertia.zz": 0.0}.items():
        n = known.numbers[key]
        assert abs(n.value - value) < 2.0 * n.sd < 0.11 and abs(n.value - value) < 0.02, key


def test_what_the_drive_does_on_the_ground_is_no_balance(flown, held_down, with_rates, vehicle):
    """Two seconds at more than full thrust before each flight leaves the ground."""
    columns, frames = (*with_rates, "u_1", "u_2", "u_3", "u_4"), []
    for k in (1, 2, 3):
        frame = flown(
            vehicle,
            {"thrust_scale": {"scale": 0.02}},
            manoeuvres.make("multisine", 20.0),
            k,
            columns,
        )
        t = frame["t_s"].to_numpy()
        frames.append(
            (f"f{k}", held_down(frame, np.where(t < 2.0, 0.0, np.where(t < 4.0, 1.3, 1.0))))
        )
    spread_words = calibrate(make_set(vehicle, frames))
    assert spread_words.numbers["thrust_scale.scale"].value == pytest.approx(0.02, abs=0.006)
    assert all(abs(spread_words.numbers[key].value) < 0.006 for key in LOSSES[:4])


def test_the_file_takes_the_corrections(known, vehicle):
    new = known.vehicle
    s = known.numbers["thrust_scale.scale"].value
    assert (
        new.thrust_coefficient_N_s2.value == pytest.approx(6e-6 * (1 + s)) and new.mass_kg.sd == 0.0
    )
    assert new.inertia_kg_m2.xx == pytest.approx(0.01 * (1 + known.numbers["inertia.xx"].value))
    assert new.inertia_kg_m2.sd_rel < vehicle.inertia_kg_m2.sd_rel
    loss = new.effects["weak_rotor"]["loss_2"]
    assert (
        loss.ci95[0] < loss.value < loss.ci95[1]
        and loss.sd == known.numbers["weak_rotor.loss_2"].later_sd
    )


def test_motors_that_differ_are_numbers_of_the_file(flown, with_rates, sheet):
    """Without them a common top speed, thrust curve and lag bend to fit motors that differ."""
    vehicle = sheet(
        motor_time_constant_s={"value": 0.023, "sd_rel": 0.12},
        max_rotor_speed_rad_s={"value": 1000, "sd_rel": 0.01},
    )
    logged, differ = (
        (*with_rates, *command(4), *rotor_speed(4)),
        {"loss_1": 0.008, "loss_3": -0.006},
    )
    flights = [
        (f"f{k}", flown(vehicle, {"slow_motor": differ}, manoeuvres.make(plan, 20.0), k, logged))
        for k, plan in enumerate(("straight_runs", "multisine", "height_staircase"), 1)
    ]
    losses = calibrate(make_set(vehicle, flights)).vehicle.effects["slow_motor"]
    # all alike are a top speed: what motors differ by is known
    for name, loss in differ.items():
        assert losses[name].value - losses["loss_2"].value == pytest.approx(loss, abs=5e-4)


def test_a_second_calibration_moves_nothing(known, alike):
    again = calibrate(make_set(known.vehicle, alike))
    for key in ("thrust_scale.scale", *LOSSES[:4], "inertia.xx", "inertia.yy"):
        assert abs(again.numbers[key].value) < 0.003, key


def test_flights_that_differ_make_later_doubts_wide(known, vehicle, reference):
    spread = calibrate(make_set(vehicle, reference(0.02, 0.05, 0.08)))
    assert 0.008 < spread.spread < 0.04 and known.spread < 0.003
    assert spread.numbers[LOSSES[1]].later_sd > 3 * known.numbers[LOSSES[1]].later_sd


def test_sets_are_sessions_whose_spread_is_in_the_doubt(known, vehicle, alike, reference):
    """Days between which rotor 2 lost three per cent more than within them."""
    days = (alike, reference(0.02, 0.02, 0.02)[:2], reference(0.08, 0.08, 0.08)[:2])
    apart = calibrate(*(make_set(vehicle, day) for day in days))
    together = calibrate(make_set(vehicle, [f for day in days for f in day]))
    assert apart.spread < 0.005 < 0.01 < apart.session_spread
    assert np.isnan(together.session_spread) and together.spread > 0.01
    assert apart.numbers[LOSSES[1]].later_sd > 2 * known.numbers[LOSSES[1]].later_sd
    assert (
        "sessions differ by" in apart.spread_words() and "sessions" not in together.spread_words()
    )
    with pytest.raises(GesError, match="different vehicle files"):
        calibrate(make_set(vehicle, alike), make_set(known.vehicle, alike))


def test_without_inertia_only_the_thrust_is_told(sheet, alike):
    bare = sheet(inertia_kg_m2=None, torque_coefficient_Nm_s2=None)
    found = calibrate(make_set(bare, alike))
    thrust = found.numbers["thrust_scale.scale"]
    assert (
        thrust.value == pytest.approx(1.02 * (1 - 0.05 / 4) - 1, abs=0.006)
        and thrust.flight_sd > 0.0
    )
    assert not set(LOSSES) & set(found.numbers) and "weak_rotor" not in found.vehicle.effects


def test_a_declared_doubt_frees_the_centre_of_gravity(sheet, alike):
    doubtful = sheet(effects={"cg_offset": {"x_m": {"value": 0.0, "sd": 0.003}}})
    found = calibrate(make_set(doubtful, alike))
    moved = found.numbers["cg_offset.x_m"]
    assert (
        0.0 < abs(moved.value) < 0.006
        and found.vehicle.effects["cg_offset"]["x_m"].value == moved.value
    )
    assert "cg_offset.y_m" not in found.numbers


def test_one_flight_is_refused_with_a_sentence(vehicle, alike):
    with pytest.raises(GesError, match="needs two or more"):
        calibrate(make_set(vehicle, alike[:1]))


def test_verb_writes_a_vehicle_file_the_same_every_time(tmp_path, vehicle, alike):
    write_set(tmp_path / "set", vehicle, alike)
    written = []
    for name in ("a.yaml", "b.yaml"):
        result = CliRunner().invoke(
            cli, ["calibrate", str(tmp_path / "set"), "--out", str(tmp_path / name)]
        )
        assert result.exit_code == 0, result.output
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]
    assert load_vehicle(tmp_path / "a.yaml").effects["weak_rotor"]["loss_2"].value > 0.02


@pytest.mark.parametrize("airframe", ["E8", "E9"])
def test_small_quadrotors_gains_and_their_spread(recordings_dir, airframe):
    """Four healthy flights of one airframe: motor gains some per cent apart, and a spread of one to
    three per cent.
    """
    flights = [
        (p.name, open_log(p).frame())
        for p in sorted((recordings_dir / "crazypad" / "normal_flight").glob(f"{airframe}_*"))
    ]
    found = calibrate(make_set(load_vehicle("crazyflie-2.1"), flights))
    assert 0.01 < found.spread < 0.03 and not found.warnings
    assert found.seconds > 50.0
    for key in LOSSES[:4]:
        n = found.numbers[key]
        assert 0.005 < abs(n.value) < 0.15 and n.sd < n.later_sd < 0.04
    assert not any(key.startswith(("inertia", "motor_lag")) for key in found.numbers), (
        "no rates were logged"
    )
    assert (
        found.vehicle.max_rotor_speed_rad_s.sd == 0.0
        and found.vehicle.effects["thrust_curve"]["c"].sd == 0.0
    )
    assert (
        0.0
        < found.vehicle.thrust_coefficient_N_s2.sd
        < 0.02 * found.vehicle.thrust_coefficient_N_s2.value
    )


def _balance_share(vehicle, flights):
    """Mean moments that a vehicle file leaves in the air, over weight times arm, (3,)."""
    made = make_set(vehicle, flights)
    model = from_vehicle(made.vehicle)
    prepared = pass_gate([f.frame for f in made.flights], model, [f.name for f in made.flights])
    flights = list(prepared.flights.values())
    system = build(flights, with_flown_voltage(model, flights), [])
    at = [system.names.index(f"moment_{a}") for a in "xyz"]
    means = np.mean([r.in_air(at).mean(axis=0) for r in system.flights], axis=0)
    return np.abs(means) / model.reference_scale("moment_x")


def test_gains_and_cant_balance_the_moments(recordings_dir):
    """Of four healthy flights, two of them a battery apart."""
    paths = sorted((recordings_dir / "crazypad" / "normal_flight").glob("E9_*"))
    flights = [(p.name, open_log(p).frame()) for p in paths]
    sheet = load_vehicle("crazyflie-2.1")
    before = _balance_share(sheet, flights)
    after = _balance_share(calibrate(make_set(sheet, flights)).vehicle, flights)
    assert np.linalg.norm(after) < 0.2 * np.linalg.norm(before)
    assert after[2] < 0.2 * before[2], "in yaw, by the cant"


@pytest.mark.slow
def test_a_calibrated_drive_turns_commands_of_later_flights_into_speeds(recordings_dir):
    """Of a vehicle whose battery reads 3.7 V, on flights of another pace, within 2 %."""
    folder = recordings_dir / "imrclab-crazyflie" / "free"
    first, later = (
        [(p.name, open_log(p).frame()) for p in sorted(folder.glob(pattern))[:3]]
        for pattern in ("eckart0*", "eckart[12]*")
    )
    made = calibrate(make_set(load_vehicle("crazyflie-2.1"), first)).vehicle
    model = from_vehicle(made, ROOT)
    prepared = pass_gate([frame for _, frame in later], model, [name for name, _ in later])
    flights = list(prepared.flights.values())
    system = build(flights, with_flown_voltage(model, flights), [])
    drives = [system.main.index(f"drive_{i}") for i in range(1, 5)]
    for rows in system.flights:
        speed = rows.flight.stack("rotor_speed").mean()
        assert np.abs(rows.in_air(drives).mean(axis=0)).max() < 0.02 * speed
