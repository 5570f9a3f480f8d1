"""Propellers by their trade names."""

import math

import pytest

from ges.errors import UsageError
from ges.vehicle.propeller import Propeller, thrust_coefficient, thrust_curve


@pytest.mark.parametrize(
    ("size", "diameter_m", "blades"),
    [
        ("10in", 0.254, 2),
        ('10"', 0.254, 2),
        ("10", 0.254, 2),
        ("10x4.5", 0.254, 2),
        ("10X4.5", 0.254, 2),
        ("5x4.3x3", 0.127, 3),
        ("0.254m", 0.254, 2),
        (".254 m", 0.254, 2),
        ("254mm", 0.254, 2),
        ("46mm", 0.046, 2),
    ],
)
def test_sizes(size, diameter_m, blades):
    prop = Propeller.parse(size)
    assert prop.diameter_m == pytest.approx(diameter_m)
    assert prop.blades == blades
    assert prop.radius_m == pytest.approx(0.5 * diameter_m)


@pytest.mark.parametrize("size", ["", "ten", "10 feet", "10x", "-10in", "0in", "254", "5x4x99"])
def test_what_is_no_size_says_how_to_write_one(size):
    with pytest.raises(UsageError, match="10in|0.02 to 2 m"):
        Propeller.parse(size)


def test_thrust_grows_with_density_diameter_and_blades():
    two = thrust_coefficient(Propeller(0.254), 1.2).value
    assert thrust_coefficient(Propeller(0.254), 0.6).value == pytest.approx(0.5 * two)
    assert thrust_coefficient(Propeller(0.508), 1.2).value == pytest.approx(16 * two)
    assert thrust_coefficient(Propeller(0.254, 3), 1.2).value == pytest.approx(1.31 * two)


def test_thrust_coefficient_is_that_of_measured_propellers_within_its_doubt():
    """Bench of the appius quadrotor, and two published identifications of the Hummingbird."""
    for diameter_m, rho, measured in ((0.24, 1.205, 1.038e-5), (0.2, 1.2, 5.57e-6)):
        said = thrust_coefficient(Propeller(diameter_m), rho)
        assert abs(said.value - measured) < said.sd


def test_blade_element_theory_bears_out_the_third_blade():
    """C_T = (sigma a / 2)(theta / 3 - lambda / 2), lambda = sqrt(C_T / 2), pitch 0.45 diameters."""

    def ct(solidity: float) -> float:
        theta, value = math.atan(0.45 / (math.pi * 0.75)) + math.radians(3.0), 0.01
        for _ in range(200):
            inflow = math.sqrt(value / 2)
            value += 0.5 * (0.5 * solidity * 5.7 * (theta / 3 - inflow / 2) - value)
        return value

    assert ct(0.135) / ct(0.09) == pytest.approx(1.31, abs=0.02)


def test_larger_propellers_bend_the_curve_more():
    assert thrust_curve(Propeller(0.127)).value == pytest.approx(0.5)
    assert thrust_curve(Propeller(0.762)).value == pytest.approx(0.2)
    assert thrust_curve(Propeller(0.046)).value == pytest.approx(0.5)
