"""Published logs that lack much: an honest verdict on what they allow, and what to log instead."""

import json

import pytest
from click.testing import CliRunner

from ges.cli import cli


def _run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def blind_flights(recordings_dir, tmp_path_factory):
    """Two Crazyflie logs with accelerometer, gyro and commands alone, imported and diagnosed."""
    folder = tmp_path_factory.mktemp("usd")
    logs = [recordings_dir / "crazyflie-usd" / name for name in ("log10", "log15")]
    assert (
        _run("import", *logs, "--vehicle", "crazyflie-2.1", "--out", folder / "set").exit_code == 0
    )
    result = _run("diagnose", folder / "set", "--out", folder / "out")
    assert result.exit_code == 0, result.output
    return (
        json.loads((folder / "out" / "diagnosis.json").read_text()),
        (folder / "out" / "report.html").read_text(),
    )


def test_a_log_without_position_proves_nothing_and_says_what_it_could_not_hear(blind_flights):
    diagnosis, _ = blind_flights
    assert diagnosis["verdict"] == "nothing_proven" and not diagnosis["findings"]
    assert {c.split("_")[0] for c in diagnosis["data"]["channels_used"]} == {"acc", "moment"}
    assert (
        "nothing of drag, inflow, loads and the ground (log velocity and attitude"
        in diagnosis["remark"]
    )
    off = diagnosis["data"]["channels_off"]
    assert "velocity and attitude" in off["force_z"] and "rotor speeds" in off["drive_1"]
    for name in ("ground_effect", "rotor_drag", "axial_inflow", "slung_load", "battery_sag"):
        assert diagnosis["not_tested"][name].startswith("needs a logged"), name
        assert name not in diagnosis["detectable"], (
            "no size can be promised for what nothing was logged of"
        )
    assert {"weak_rotor", "accelerometer_bias"} <= set(diagnosis["detectable"])


def test_without_position_the_open_loop_proof_is_left_out(blind_flights):
    diagnosis, _ = blind_flights
    assert not diagnosis["fit"]["rollout"] or not diagnosis["fit"]["rollout"]["channels"]
    assert set(diagnosis["fit"]["channels"]) == {
        "acc_x_N",
        "acc_y_N",
        "acc_z_N",
        "moment_x_Nm",
        "moment_y_Nm",
        "moment_z_Nm",
    }


def test_a_log_from_the_bench_is_no_flight(recordings_dir, tmp_path):
    """The PX4 sample was never armed: all outputs stand at the disarmed pulse width, position is
    never valid.
    """
    log = recordings_dir / "px4-sample" / "sample.ulg"
    made = _run(
        "import",
        log,
        "--parts",
        "2",
        "--vehicle",
        "px4-quad",
        "--out",
        tmp_path / "set",
    )
    assert made.exit_code == 0 and "motor commands never leave zero" in made.output
    with pytest.raises(
        Exception, match="sample_part1 never leaves the ground: its commands are zero throughout"
    ) as stop:
        CliRunner().invoke(
            cli,
            ["diagnose", str(tmp_path / "set"), "--out", str(tmp_path / "out")],
            catch_exceptions=False,
        )
    assert "actuator_motors" in str(stop.value) and not (tmp_path / "out").exists()
