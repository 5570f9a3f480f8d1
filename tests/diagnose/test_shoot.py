"""Drag by its force and not by its lever, and the path that the model flies itself."""

import dataclasses

import numpy as np
import pytest

import ges
from ges.diagnose.estimate import shoot
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres

DRAG = {"rotor_drag": {"k_kg": 1e-4}}
PLANS = (("straight_runs", (30.0,)), ("height_staircase", (20.0,)), ("multisine", (20.0,)))


def _flights(flown, vehicle, extra):
    return [
        flown(vehicle, DRAG, manoeuvres.MENU[plan](*n), seed, extra)
        for seed, (plan, n) in enumerate(PLANS, 1)
    ]


@pytest.fixture(scope="module")
def drawn(flown, sheet, with_rates):
    """Flights with drag, rotor speeds logged, every stream as fast as the other."""
    return _flights(flown, sheet(), with_rates)


def _raised(vehicle, z_m: float):
    return vehicle.model_copy(
        update={
            "rotors": [
                r.model_copy(update={"z_m": r.z_m.model_copy(update={"value": z_m})})
                for r in vehicle.rotors
            ]
        }
    )


def test_a_drag_is_as_large_as_its_force_where_the_file_has_the_rotors_at_another_height(
    drawn, sheet
):
    """Three centimetres: the moments, measured far better than the forces, would make it another
    drag.
    """
    found = ges.diagnose(drawn, _raised(sheet(), 0.03), names=["rotor_drag"])
    assert found.findings[0].parameters["k_kg"].value == pytest.approx(1e-4, rel=0.05)


@pytest.fixture(scope="module")
def prepared(drawn, sheet):
    """One flight, and the true model."""
    model = from_vehicle(sheet()).with_effects(DRAG)
    return pass_gate(drawn[:1], model, ["flight1"]).flights[0], model


def test_the_path_of_the_true_model_is_the_recorded_one(prepared):
    """It is flown in pieces of 0.2 s from states with noise; the differences stay within that
    noise.
    """
    flight, model = prepared
    path = shoot.with_rollout_path(flight, model).path
    starts = shoot.rollout_starts(flight, round(0.2 / flight.dt_s))
    assert len(starts) > 100 and set(path) == {
        f"{a}_{b}"
        for a, b in (
            ("p", "x_m"),
            ("p", "y_m"),
            ("p", "z_m"),
            ("v", "x_m_s"),
            ("v", "y_m_s"),
            ("v", "z_m_s"),
        )
    }
    for name, values in path.items():
        away = (values - flight.columns[name])[flight.flying]
        assert np.sqrt(np.mean(away**2)) < (0.03 if name.startswith("v") else 0.005), name


def test_a_wrong_model_flies_another_path(prepared):
    flight, model = prepared
    heavier = model.with_number("mass_kg", 1.3 * model.number("mass_kg"))
    fallen = shoot.with_rollout_path(flight, heavier).path["v_z_m_s"] - flight.columns["v_z_m_s"]
    assert np.mean(fallen[flight.flying]) < -0.1


def test_readings_too_slow_for_a_piece_leave_the_recorded_path(prepared):
    flight, model = prepared
    slow = dataclasses.replace(flight, update_s={**flight.update_s, "rotor_speed": 0.1})
    assert shoot.with_rollout_path(slow, model).path == {}


def test_moments_of_flights_never_seen_do_not_pay_for_a_tilt(flown, sheet, with_rates):
    """The fitted vehicle has the lever of its file, three centimetres off, and the trims that go
    with it.
    """
    tilt = {"rotor_tilt": {"x_rad": 0.02, "y_rad": 0.0}}
    flights = [
        flown(sheet(), tilt, manoeuvres.MENU[plan](*n), seed, with_rates)
        for seed, (plan, n) in enumerate(PLANS, 1)
    ]
    found = ges.diagnose(flights, _raised(sheet(), 0.03), holdout=["flight2"], names=["rotor_tilt"])
    for axis in "xy":
        told = found.fit["channels"][f"moment_{axis}_Nm"]
        assert told["after"] < 1.1 * told["recalibrated"], axis
