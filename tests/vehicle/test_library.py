"""Vehicles that come with the package, and the laws that fill what files leave out."""

import numpy as np
import pytest

from ges.errors import UsageError
from ges.vehicle import library, scaling
from ges.vehicle.load import load_vehicle, vehicle_path

PUBLISHED = [
    "crazyflie-2.1",
    "crazyflie-2.1-brushless",
    "hummingbird",
    "gazebo-iris",
    "gazebo-x500",
    "pybullet-cf2x",
    "sih-quad",
]


@pytest.mark.parametrize("name", library.names())
def test_every_vehicle_says_its_name_and_where_it_comes_from(name):
    vehicle = load_vehicle(name)
    assert vehicle.name == name
    assert len(vehicle.rotors) == (8 if "x8" in name else 4)
    text = library.path_of(name).read_text()
    assert text.startswith("# ") and len(library.title(name)) > 20
    largest = vehicle.max_rotor_speed_rad_s.value
    ratio = (largest / vehicle.hover_speed_rad_s()) ** 2
    assert 1.2 < ratio < 8.0, "thrust to weight"


def test_a_name_nobody_knows_lists_the_nearest():
    with pytest.raises(UsageError, match="did you mean 'crazyflie-2.1"):
        load_vehicle("crazyflie21")


def test_a_file_is_taken_before_a_guess(tmp_path):
    (tmp_path / "mine.yaml").write_text(library.path_of("x500").read_text())
    assert load_vehicle(tmp_path / "mine.yaml").name == "x500"
    assert vehicle_path("other.yaml").name == "other.yaml"


@pytest.mark.parametrize("name", PUBLISHED)
def test_scaling_laws_hold_for_published_vehicles(name):
    """Each within three of the stated doubts; Gazebo's iris and SIH are the ends of the spread."""
    vehicle = load_vehicle(name)
    arm_m = scaling.arm_m(*(vehicle.rotor_arrays()[k] for k in ("x_m", "y_m")))
    law = scaling.inertia(vehicle.mass_kg.value, arm_m)
    for axis in ("xx", "yy", "zz"):
        ratio = getattr(vehicle.inertia_kg_m2, axis) / getattr(law, axis)
        assert abs(np.log(ratio)) < 3 * scaling.INERTIA_SD_REL


@pytest.mark.parametrize("name", ["crazyflie-2.1-brushless", "hummingbird", "x500"])
def test_torque_and_spacing_laws_hold_for_real_vehicles(name):
    vehicle = load_vehicle(name)
    diameter_m = 2 * vehicle.rotors[0].radius_m.value
    law = scaling.torque_coefficient(vehicle.thrust_coefficient_N_s2.value, diameter_m)
    assert abs(law.value - vehicle.torque_coefficient_Nm_s2.value) < 2 * law.sd
    rotors = vehicle.rotor_arrays()
    hubs = np.stack([rotors["x_m"], rotors["y_m"], rotors["z_m"]], axis=1)
    assert scaling.radius_m(hubs) == pytest.approx(0.5 * diameter_m, rel=0.15)
