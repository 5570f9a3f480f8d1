"""What is planted in a hexarotor and in an X8 is found there, at its rotor, and nothing else."""

import pytest

import ges
from ges.conventions import command
from ges.vehicle.airframe import from_layout
from ges.vehicle.propeller import Propeller

from .test_planted import LOGGED, recordings_of


@pytest.fixture(scope="module")
def vehicles(sheet):
    """A hexarotor and an X8 with rotors of the quadrotor, and as much weight for each of them."""

    def make(frame: str):
        rotors = from_layout(frame, Propeller.parse("6.5in"), 0.55).rotors
        return sheet(
            mass_kg={"value": 0.3 * len(rotors), "sd_rel": 0.01},
            rotors=[r.model_dump(exclude_none=True) for r in rotors],
            motor_time_constant_s={"value": 0.023, "sd_rel": 0.12},
            max_rotor_speed_rad_s={"value": 1000, "sd_rel": 0.01},
        )

    return {frame: make(frame) for frame in ("hexa-x", "x8")}


def _diagnosed(flown, vehicle, planted):
    logged = (*LOGGED, *command(len(vehicle.rotors))[4:])
    frames = recordings_of(flown, vehicle, planted, logged=logged)
    return ges.diagnose(frames, vehicle, holdout=["flight5"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "planted", "place"),
    [
        ("hexa-x", {"weak_rotor": {"loss_5": 0.15}}, "rotor 5"),
        ("x8", {"weak_rotor": {"loss_6": 0.2}}, "rotor 6"),
        ("x8", {"coaxial_wake": {"c": 0.25}}, ""),
        ("hexa-x", {"rotor_drag": {"k_kg": 1e-4}}, ""),
        ("hexa-x", {"payload": {"mass_kg": 0.4, "x_m": 0.06, "y_m": 0.0, "z_m": 0.0}}, ""),
        ("x8", {}, ""),
    ],
)
def test_what_is_planted_is_found_at_its_place(flown, vehicles, frame, planted, place):
    found = _diagnosed(flown, vehicles[frame], planted)
    assert {f.name for f in found.findings} == set(planted), found.sentence
    assert {f.place for f in found.findings} <= {place}
    for finding in found.findings:
        for name, value in planted[finding.name].items():
            told = finding.parameters.get(name)
            assert told is None or told.value == pytest.approx(value, rel=0.25, abs=0.015)
