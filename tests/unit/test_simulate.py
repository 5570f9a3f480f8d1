"""Every manoeuvre can be flown, and a vehicle file flies as it is."""

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

from ges.commands.simulate import command
from ges.errors import GesError
from ges.recordings.recording import checked_frame
from ges.simulator import flight as sim
from ges.simulator import manoeuvres
from ges.simulator.terrain import Terrain
from ges.vehicle import library

VEHICLES = ["crazyflie-2.1", "appius", "px4-quad"]


@pytest.mark.parametrize("name", manoeuvres.MENU)
def test_references_are_consistent(name):
    table = manoeuvres.make(name)
    for k in range(3):
        assert np.allclose(
            np.gradient(table[:, k], manoeuvres.STEP_S)[2:-2], table[2:-2, 3 + k], atol=0.12
        )
        assert np.abs(table[:, 6 + k]).max() < 6
    assert table[:, 2].min() >= 0.1


@pytest.mark.parametrize("name", manoeuvres.MENU)
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_manoeuvre_is_flown_without_touching_the_ground(name, vehicle, tmp_path):
    out = tmp_path / "f.parquet"
    result = CliRunner().invoke(command, [vehicle, "--plan", name, "--out", str(out)])
    assert result.exit_code == 0, result.output
    frame, _ = checked_frame("f", pd.read_parquet(out))
    assert frame["contact"].sum() == 0
    assert np.abs(frame["p_z_m"] - frame["p_ref_z_m"]).max() < 0.25
    assert (
        np.hypot(frame["p_x_m"] - frame["p_ref_x_m"], frame["p_y_m"] - frame["p_ref_y_m"]).max()
        < 1.0
    )


@pytest.mark.parametrize("name", manoeuvres.MENU)
def test_weak_and_canted_rotors_are_trimmed_before_the_record_begins(name, tmp_path):
    # as README's first diagnosis fits them: about x 28, about z 10 rad/s^2 in hover
    file = tmp_path / "weak.yaml"
    values = yaml.safe_load(library.path_of("crazyflie-2.1").read_text())
    values["effects"] = {
        "weak_rotor": {"loss_2": 0.051, "loss_3": 0.16, "loss_4": -0.05},
        "rotor_cant": {"angle_rad": 0.0114},
    }
    file.write_text(yaml.safe_dump(values))
    out = tmp_path / "f.parquet"
    result = CliRunner().invoke(command, [str(file), "--plan", name, "--out", str(out)])
    assert result.exit_code == 0, result.output
    frame, _ = checked_frame("f", pd.read_parquet(out))
    table = manoeuvres.make(name)
    assert frame["t_s"].iloc[-1] == pytest.approx((len(table) - 1) * manoeuvres.STEP_S)
    assert np.abs(frame["p_z_m"] - frame["p_ref_z_m"]).max() < 0.3
    first = frame.iloc[0]
    assert abs(2 * np.arctan2(first["q_z"], first["q_w"]) - first["yaw_ref_rad"]) < 0.05
    assert abs(first["p_x_m"] - first["p_ref_x_m"]) < 0.1


def test_set_point_file_round_trips():
    table = manoeuvres.make("height_staircase")
    assert np.allclose(manoeuvres.from_frame(manoeuvres.to_frame(table)), table, atol=1e-12)


def test_references_without_position_are_refused():
    with pytest.raises(GesError, match="p_ref_x_m"):
        manoeuvres.from_frame(pd.DataFrame({"t_s": [0.0, 1.0]}))


def test_rollout_from_a_recorded_state_repeats_the_flight():
    """Recorded rotor speeds and attitude, imposed, bring the vehicle where the flight went."""
    flown = sim.fly(
        [
            sim.Flight(
                {"duration_s": 3, "record_every": 1, "seed": 2},
                {"ground_effect": {}},
                Terrain.flat(),
            )
        ]
    )[0]
    first = 500
    speeds, rates = (
        [f"rotor_speed_{i}_rad_s" for i in range(1, 5)],
        [f"omega_{a}_rad_s" for a in "xyz"],
    )
    attitude = ["q_w", "q_x", "q_y", "q_z"]
    table = np.stack([flown[n][first:] for n in (*speeds, *attitude, "battery_V", *rates)], axis=1)
    names = ["p_x_m", "p_y_m", "p_z_m", "v_x_m_s", "v_y_m_s", "v_z_m_s", *attitude, *rates, *speeds]
    start = {f"start_{n}": flown[n][first] for n in names}
    numbers = {
        **start,
        "start": 1,
        "control": 2,
        "attitude_imposed": 1,
        "inputs_dt_s": 0.001,
        "duration_s": 1,
        "record_every": 1,
    }
    again = sim.fly([sim.Flight(numbers, {"ground_effect": {}}, Terrain.flat(), table)])[0]
    assert np.abs(again["p_z_m"] - flown["p_z_m"][first : first + 1001]).max() < 1e-9
