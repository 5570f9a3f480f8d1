"""Vehicles from published logs, none of which came with a vehicle file."""

import dataclasses

import numpy as np
import pytest

from ges.conventions import GRAVITY_M_S2, command
from ges.errors import GesError
from ges.recordings.readers import Options, open_log
from ges.vehicle.drive import binned, normalised_thrust
from ges.vehicle.from_log import describe_log
from ges.vehicle.load import load_vehicle
from ges.vehicle.propeller import Propeller
from ges.vehicle.turning import turning

COMMAND = command(4)


@dataclasses.dataclass
class Part:
    """Some rows of a log's table, and its parameters."""

    log: object
    rows: object

    def __getattr__(self, name):
        return getattr(self.log, name)

    def frame(self):
        return self.rows.reset_index(drop=True)


def _halves(log) -> list[Part]:
    frame = log.frame()
    early = frame["t_s"] < frame["t_s"].iloc[[0, -1]].mean()
    return [Part(log, frame[early]), Part(log, frame[~early])]


def _lift_error(vehicle, frame) -> float:
    """Median error of the vertical force that the commands make against that of the motion, over
    the weight, of half seconds in which rotors turn.
    """
    bins = binned(frame)
    c = vehicle.effect_values().get("thrust_curve", {"c": 0.0})["c"]
    largest = vehicle.thrust_coefficient_N_s2.value * vehicle.max_rotor_speed_rad_s.value**2
    drive = normalised_thrust(bins[list(COMMAND)].to_numpy(), c).sum(axis=1)
    q = bins[["q_w", "q_x", "q_y", "q_z"]].to_numpy()
    up = 1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2) / np.sum(q**2, axis=1)
    climbing = np.gradient(bins["v_z_m_s"].to_numpy(), bins["t_s"].to_numpy())
    wanted = (GRAVITY_M_S2 + climbing) / GRAVITY_M_S2
    said = largest * drive * up / (vehicle.mass_kg.value * GRAVITY_M_S2)
    flying = drive > 0.5 * np.nanmedian(drive)
    return float(np.nanmedian(np.abs(said - wanted)[flying]))


@pytest.mark.parametrize(
    ("path", "largest"),
    [("px4-flights/battery_brownout.ulg", 0.03), ("ardupilot/dataflash-sample-1.bin", 0.1)],
)
def test_a_vehicle_of_the_first_half_carries_the_second(recordings_dir, path, largest):
    """Commands alone, mass assumed, where the generic vehicle is more than a fifth off; over the
    four minutes of the second the battery sags by 7 %.
    """
    if path.endswith(".bin"):
        pytest.importorskip("pymavlink", reason="extra 'ardupilot'")
    early, late = _halves(open_log(recordings_dir / path))
    half = describe_log(early, 2.0, Propeller.parse("10in")).vehicle
    assert _lift_error(half, late.frame()) < largest
    assert _lift_error(load_vehicle("px4-quad"), late.frame()) > 0.2


def test_rotor_speeds_say_which_propeller_it_was(recordings_dir):
    log = open_log(recordings_dir / "px4-flights" / "ekf_failure.ulg")
    sheet = describe_log(log, 2.0, Propeller.parse("10in"))
    assert any("would touch" in remark for remark in sheet.remarks)
    assert any("it would suit 7.4" in remark for remark in sheet.remarks)
    assert not describe_log(log, 2.0, Propeller.parse("7.4in")).remarks


def test_betaflight_with_its_propellers_out(recordings_dir):
    pytest.importorskip("betaflight_chirp_core", reason="extra 'betaflight'")
    log = open_log(recordings_dir / "betaflight" / "LOG00037.BFL")
    sheet = describe_log(log, 0.65, Propeller.parse("5x4.3x3"))
    assert [r.spin for r in sheet.vehicle.rotors] == ["ccw", "cw", "cw", "ccw"]
    assert "bears that out in roll, pitch and yaw" in sheet.sources["rotors"]


def test_crazyflies_agree_on_their_rotors_whatever_they_carry(recordings_dir):
    """Measured speeds, 37 g alone and 44.4 g with a payload: one thrust coefficient to 3 %."""
    folder = recordings_dir / "imrclab-crazyflie"
    found = [
        describe_log(open_log(folder / path), mass_kg, Propeller.parse("46mm")).vehicle
        for path, mass_kg in (("free/eckart00", 0.037), ("payload/eckart06", 0.0444))
    ]
    k = [v.thrust_coefficient_N_s2.value for v in found]
    assert k[1] == pytest.approx(k[0], rel=0.03)
    for vehicle in found:
        assert vehicle.motor_time_constant_s.value == pytest.approx(0.04, abs=0.01)
        assert vehicle.effects["thrust_curve"]["c"].value < 0.6, "duty cycles are not linear"


def test_a_table_shows_its_layout_in_flight(recordings_dir):
    """Gazebo's iris, PX4's quad X; its largest thrust is known, 5.84e-6 times 1100 squared."""
    log = open_log(recordings_dir / "gazebo-iris" / "quadrotor_model.csv")
    vehicle = describe_log(log, 1.545, Propeller.parse("10in")).vehicle
    assert [r.spin for r in vehicle.rotors] == ["ccw", "ccw", "cw", "cw"]
    k, top = vehicle.thrust_coefficient_N_s2.value, vehicle.max_rotor_speed_rad_s.value
    c = vehicle.effects["thrust_curve"]["c"].value
    hover = np.array(0.71)
    truth = 5.84e-6 * (1000.0 * hover + 100.0) ** 2
    assert k * top**2 * normalised_thrust(hover, c) == pytest.approx(truth, rel=0.05)


def test_a_vtol_and_a_flight_that_never_was_are_refused(recordings_dir):
    for path, words in (
        ("px4-flights/sample_log_small.ulg", "VTOL"),
        ("px4-sample/sample.ulg", "commands above zero"),
    ):
        with pytest.raises(GesError, match=words):
            describe_log(open_log(recordings_dir / path), 1.0, Propeller.parse("10in"))


def test_an_x8_turns_as_its_layout_says(recordings_dir):
    """Two nominal flights: roll, pitch and yaw follow what eight motors are asked for."""
    vehicle = load_vehicle("acsl-x8")
    for stem in ("log_20240613_115633", "log_20240613_121802"):
        log = open_log(recordings_dir / "acsl-x8" / f"{stem}.log", Options(mapping="acsl"))
        seen = turning(log.frame())
        assert (seen.agreement(vehicle.rotors) > 0.9).all()
        assert not seen.contradicted(vehicle.rotors)
