"""``ges doctor`` and ``ges import`` on logs as a stranger has them."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import writers
from click.testing import CliRunner

from ges.cli import cli, main
from ges.recordings.recording import load_set


def _run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments])


def _table(path, motion, columns=("p", "v", "acc", "omega", "q", "u")):
    forms = {"p": "p_{}_m", "v": "v_{}_m_s", "acc": "acc_{}_m_s2", "omega": "omega_{}_rad_s"}
    table = {"t_s": motion["t"]}
    for key in columns:
        axes = "wxyz" if key == "q" else "1234" if key == "u" else "xyz"
        form = forms.get(key, f"{key}_{{}}")
        table |= {form.format(a): motion[key][:, k] for k, a in enumerate(axes)}
    pd.DataFrame(table).to_csv(path, index=False)
    return path


def test_doctor_says_what_is_there_what_can_be_told_and_what_to_switch_on(tmp_path, motion):
    path = _table(tmp_path / "f.csv", motion, ("acc", "omega", "u"))
    (found,) = json.loads(_run("doctor", path, "--json").stdout)
    assert found["usable"] and found["format"] == "table" and not found["problem"]
    rates = {s["name"]: s["rate_hz"] for s in found["streams"]}
    assert rates == {"rates": 50.0, "acceleration": 50.0, "command": 50.0}
    assert "weak_rotor" in found["can_tell"]
    assert "velocity" in found["cannot_tell"]["rotor_drag"]
    assert "height" in found["cannot_tell"]["ground_effect"]
    assert found["switch_on"]["rotor_speed"].startswith("not logged: columns rotor_speed_1")
    assert not set(found["can_tell"]) & set(found["cannot_tell"])
    page = _run("doctor", path)
    assert page.exit_code == 0 and "can be told if large enough: " in page.output
    assert "cannot be told: " in page.output and "next time, position (not logged)" in page.output


def test_doctor_and_the_diagnosis_ask_for_the_same_references(tmp_path, motion):
    path = _table(tmp_path / "f.csv", motion)
    (found,) = json.loads(_run("doctor", path, "--json").stdout)
    assert "references that the controller followed" in found["cannot_tell"]["inertia"]
    frame = pd.read_csv(path)
    frame[[f"p_ref_{a}_m" for a in "xyz"]] = motion["p"]
    frame[[f"v_ref_{a}_m_s" for a in "xyz"]] = motion["v"]
    frame["yaw_ref_rad"] = 0.0
    frame.to_csv(path, index=False)
    (found,) = json.loads(_run("doctor", path, "--json").stdout)
    assert "inertia" in found["can_tell"]


def test_doctor_looks_at_the_flights_of_a_recording_set(tmp_path, motion):
    for name in ("two", "one"):
        frame = pd.read_csv(_table(tmp_path / "f.csv", motion))
        frame.to_parquet(tmp_path / f"{name}.parquet")
    (tmp_path / "vehicle.yaml").write_text("name: mine, yours\n")
    done = _run("doctor", tmp_path, "--json")
    assert done.exit_code == 0, done.output
    assert [f["name"] for f in json.loads(done.stdout)] == ["one.parquet", "two.parquet"]


def test_doctor_shows_a_sign_that_is_wrong(tmp_path, motion):
    wrong = dict(motion, omega=motion["omega"] * [-1, 1, 1])
    page = _run("doctor", _table(tmp_path / "f.csv", wrong))
    assert "omega_x_rad_s and the turning of the attitude run against each other" in page.output
    assert (
        "omega_x_rad_s has the other sign" in page.output and "--mend gyro-minus-x" in page.output
    )


def test_doctor_goes_on_behind_a_log_that_cannot_be_read(tmp_path, motion, monkeypatch, capsys):
    (tmp_path / "bad").write_bytes(bytes(50))
    good = _table(tmp_path / "f.csv", motion)
    result = _run("doctor", tmp_path / "bad", good)
    assert result.exit_code == 1 and "no flight log that is known" in result.output
    assert "can be told if large enough: " in result.output
    logs = json.loads(_run("doctor", tmp_path / "bad", good, "--json").stdout)
    assert [log["usable"] for log in logs] == [False, True]
    monkeypatch.setattr("sys.argv", ["ges", "doctor", str(tmp_path / "bad")])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 1 and "Traceback" not in capsys.readouterr().err


def test_doctor_of_a_log_that_is_refused_says_why_and_what_is_in_it(recordings_dir):
    log = recordings_dir / "px4-flights" / "sample_log_small.ulg"
    result = _run("doctor", log)
    assert result.exit_code == 0
    assert "cannot be diagnosed: this is a log of a VTOL aircraft" in result.output
    assert "vehicle_attitude" in result.output and "can be told" not in result.output


def test_doctor_names_the_parameters_of_the_autopilot(recordings_dir, tmp_path):
    """The beginnings of real logs, as they are read in no time."""
    logs = {
        "px4-flights/battery_brownout.ulg": ("SDLOG_PROFILE 25", "DSHOT_BIDIR_EN"),
        "ardupilot/dataflash-sample-1.bin": ("LOG_BITMASK 438271", "SERVO_BLH_AUTO"),
        "betaflight/LOG00037.BFL": ("dshot_bidir = ON", "INAV"),
        "crazyflie-usd/log10": ("rpm.m1 to rpm.m4 in config.txt", "stateEstimate.vx"),
    }
    paths = []
    for number, name in enumerate(logs):
        paths.append(tmp_path / f"{number}_{Path(name).name}")
        paths[-1].write_bytes((recordings_dir / name).read_bytes()[:500_000])
    for found, words in zip(
        json.loads(_run("doctor", *paths, "--json").stdout), logs.values(), strict=True
    ):
        advice = " ".join(found["switch_on"].values())
        assert all(word in advice for word in words), found["name"]


def test_import_takes_any_log_and_writes_the_contract(tmp_path, motion):
    t_us = (motion["t"] * 1e6).astype(int)
    fields = {"t_us": t_us, "note.x": 0.0 * t_us}
    fields |= {f"motor.m{i}": 65535 * motion["u"][:, i - 1] for i in range(1, 5)}
    fields |= {f"stateEstimate.v{a}": motion["v"][:, k] for k, a in enumerate("xyz")}
    usd = writers.usd(tmp_path / "log01", [("fixedFrequency", fields)])
    table = _table(tmp_path / "log02.csv", motion)
    result = _run("import", usd, table, "--vehicle", "crazyflie-2.1", "--out", tmp_path / "set")
    assert result.exit_code == 0, result.output
    assert "kept, not used: note_x" in result.output
    flights = load_set(tmp_path / "set").flights
    assert [f.name for f in flights] == ["log01", "log02"]
    for flight in flights:
        np.testing.assert_allclose(flight.frame["u_1"], motion["u"][:, 0], atol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--format", "px5"), "unknown format 'px5'"),
        (("--pwm", "2000", "1000"), "the output that means 0 must be below"),
        (("--rotor-order", "1,2,3,3"), "name each of 1 to 4 once"),
        (("--map", "nobody"), "unknown map"),
    ],
)
def test_wrong_options_are_told(tmp_path, motion, monkeypatch, capsys, arguments, words):
    path = _table(tmp_path / "f.csv", motion)
    given = ["import", path, "--vehicle", "crazyflie-2.1", "--out", tmp_path / "set"]
    monkeypatch.setattr("sys.argv", ["ges", *map(str, (*given, *arguments))])
    with pytest.raises(SystemExit) as stop:
        main()
    message = capsys.readouterr().err
    assert stop.value.code == 2 and words in message and "Traceback" not in message
    assert not (tmp_path / "set").exists()
