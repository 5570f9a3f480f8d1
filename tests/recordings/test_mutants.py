"""A few seconds of ``mutate.py``: a damaged log is read or refused in one sentence."""

import mutate
import pytest
import writers

from ges.recordings.readers import Options

# Seconds a log; sizes such that a mutant is read in no time and still holds a flight.
SECONDS = 2.0
LOGS = {
    "px4-flights/ekf_failure.ulg": 300_000,
    "ardupilot/dataflash-sample-1.bin": 150_000,
    "betaflight/LOG00037.BFL": 80_000,
    "imrclab-crazyflie/free/eckart00": None,
    "gazebo-iris/quadrotor_model.csv": 150_000,
}


@pytest.mark.parametrize("name", LOGS)
def test_damaged_logs(recordings_dir, name):
    found, count = mutate.damage(recordings_dir / name, Options(), SECONDS, size=LOGS[name])
    assert count and set(found) <= {"read", "refused"}, found


def test_damaged_log_of_our_own(tmp_path, motion):
    """The same without any recording at hand."""
    t_us = (motion["t"] * 1e6).astype(int)
    fields = {"t_us": t_us} | {f"rpm.m{i}": 9e3 * motion["u"][:, i - 1] for i in range(1, 5)}
    fields |= {f"gyro.{a}": motion["omega"][:, k] for k, a in enumerate("xyz")}
    seen = {"t_us": t_us} | {f"locSrv.{a}": motion["p"][:, k] for k, a in enumerate("xyz")}
    log = writers.usd(tmp_path / "log00", [("fixedFrequency", fields), ("estPose", seen)])
    found, count = mutate.damage(log, Options(), SECONDS)
    assert count and found["read"] and set(found) <= {"read", "refused"}, found


def test_the_script_notices_what_is_no_sentence(tmp_path, monkeypatch):
    (tmp_path / "f.csv").write_text("t_s,u_1\n0,1\n")
    monkeypatch.setattr(mutate, "open_log", lambda *_: 1 / 0)
    found, _ = mutate.damage(tmp_path / "f.csv", Options(), 0.05)
    assert any("ZeroDivisionError" in what for what in found)
