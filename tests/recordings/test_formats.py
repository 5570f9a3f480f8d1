"""Every other format: a log that the test writes comes back in the contract's frames, and the real
one shows what it is known to show.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.io
import writers
import yaml

from ges.errors import GesError, UsageError
from ges.recordings.consistency import agreements
from ges.recordings.readers import READERS, Options, open_log
from ges.recordings.readers import log as streams
from ges.recordings.readers.maps import ColumnMap, presets
from ges.recordings.readers.ros import TopicMap


def _same_motion(frame, motion, names=("p_{}_m", "v_{}_m_s", "acc_{}_m_s2"), tolerance=1e-4):
    for form in names:
        key = {"p": "p", "v": "v", "a": "acc"}[form[0]]
        got = frame[[form.format(a) for a in "xyz"]].to_numpy()
        good = np.isfinite(got).all(axis=1)
        assert good.mean() > 0.4
        np.testing.assert_allclose(got[good], motion[key][good], atol=tolerance)
    got = frame[[f"omega_{a}_rad_s" for a in "xyz"]].to_numpy()
    np.testing.assert_allclose(got, motion["omega"], atol=tolerance)
    if "q_w" in frame:
        q = frame[["q_w", "q_x", "q_y", "q_z"]].to_numpy()
        turn = np.abs(np.sum(q * motion["q"], axis=1))
        np.testing.assert_allclose(turn, 1.0, atol=tolerance)


def _agree(frame, least=0.9):
    """Pairs of quantities that disagree; the written commands are those of no flight."""
    tied = [a for a in agreements(frame) if "commands" not in a.what]
    assert len(tied) >= 6
    return {a.what: a.correlation for a in tied if a.correlation < least}


# --- the registry


def test_a_file_of_no_format_is_refused_with_those_that_there_are(tmp_path):
    (tmp_path / "x.bin").write_bytes(bytes(range(7, 200)))
    with pytest.raises(GesError, match="no flight log that is known here; known are PX4 ULog"):
        open_log(tmp_path / "x.bin")
    (tmp_path / "empty").write_bytes(b"")
    with pytest.raises(GesError, match="is empty"):
        open_log(tmp_path / "empty")
    with pytest.raises(GesError, match="cannot read .*none: No such file"):
        open_log(tmp_path / "none")
    with pytest.raises(UsageError, match="unknown format 'px5'; did you mean 'px4'"):
        open_log(tmp_path / "x.bin", kind="px5")


def test_every_reader_says_what_to_switch_on():
    wanted = {"rotor_speed", "command", "rates", "acceleration", "position", "velocity", "attitude"}
    for reader in READERS:
        assert wanted <= set(reader.advice), reader.name
        assert set(reader.advice) <= set(streams.COLUMNS), reader.name


def test_a_library_that_is_not_installed_is_named_with_its_command(tmp_path, monkeypatch, motion):
    monkeypatch.setitem(__import__("sys").modules, "pymavlink.DFReader", None)
    path = writers.dataflash(tmp_path / "f.bin", [])
    with pytest.raises(GesError, match="read by pymavlink, .*pip install pymavlink brings"):
        open_log(path)


def test_no_vibration_folds_down_and_no_gap_is_filled():
    """A fast stream appears by its means, a set-point for a second, nothing over a gap."""
    fast = np.arange(0.0, 4.0, 0.001)
    attitude = streams.Stream(np.arange(0.0, 4.0, 0.05), {"q_w": np.ones(80)})
    shaken = streams.Stream(fast, {"acc_x_m_s2": 2.0 + np.sin(2 * np.pi * 200 * fast)})
    t = np.array([0.0, 0.1, 0.2, 1.5, 1.6])
    gap = streams.Stream(t, {"p_x_m": t})
    asked = streams.Stream(np.array([1.0]), {"p_ref_x_m": np.array([5.0])}, held=True)
    log = streams.Log(
        "f",
        "px4",
        "",
        {
            "attitude": attitude,
            "acceleration": shaken,
            "position": gap,
            "reference": asked,
            "command": streams.Stream(attitude.t_s, {"u_1": attitude.t_s}),
        },
    )
    frame = log.frame().set_index("t_s")
    assert frame["acc_x_m_s2"].iloc[1:-1].to_numpy() == pytest.approx(2.0, abs=1e-6)
    at = frame["p_x_m"].dropna()
    assert set(np.round(at.index, 2)) == {0.0, 0.1, 0.2, 1.5, 1.6}
    held = frame["p_ref_x_m"].dropna()
    assert held.index.min() >= 1.0 and held.index.max() < 2.0


# --- ArduPilot


def _ardupilot(path, motion, ned, parameters=None, servo=(1, 2, 3, 4), esc=None, **more):
    t_us = (motion["t"] * 1e6 + 5e6).astype(int)
    degrees = np.degrees(ned["euler"])
    pulses = np.zeros((len(t_us), 4))
    for motor, channel in enumerate(servo):
        pulses[:, channel - 1] = 1100 + 800 * motion["u"][:, motor]
    rows = {
        "ATT": (
            "QffffB",
            ("TimeUS", "Roll", "Pitch", "Yaw", "DesYaw", "AEKF"),
            np.column_stack([degrees, degrees[:, 2] + 1.0, 0 * t_us]),
        ),
        "IMU": (
            "QBffffff",
            ("TimeUS", "I", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"),
            np.column_stack([0 * t_us, ned["omega"], ned["acc"]]),
        ),
        "XKF1": (
            "QBffffff",
            ("TimeUS", "C", "VN", "VE", "VD", "PN", "PE", "PD"),
            np.column_stack([0 * t_us, ned["v"], ned["p"]]),
        ),
        "RCOU": ("QHHHH", ("TimeUS", "C1", "C2", "C3", "C4"), np.round(pulses)),
        "PSCN": (
            "Qfff",
            ("TimeUS", "TPN", "PN", "DVN"),
            np.column_stack([ned["p"][:, 0] + 0.1, ned["p"][:, 0], ned["v"][:, 0]]),
        ),
    }
    messages = []
    for name, (form, columns, values) in rows.items():
        whole = [
            [int(v) if f in "BH" else float(v) for f, v in zip(form[1:], row, strict=True)]
            for row in values
        ]
        messages.append(
            (name, form, columns, [(t, *r) for t, r in zip(t_us.tolist(), whole, strict=True)])
        )
    if esc is not None:
        rows = [
            (t, instance, float(w))
            for instance, rpm in esc.items()
            for t, w in zip(t_us.tolist(), rpm, strict=True)
        ]
        messages.append(("ESC", "QBf", ("TimeUS", "Instance", "RPM"), rows))
    known = {
        "MOT_PWM_MIN": 1100.0,
        "MOT_PWM_MAX": 1900.0,
        "FRAME_CLASS": 1.0,
        "MOT_THST_EXPO": 0.65,
    }
    known |= {f"SERVO{channel}_FUNCTION": 33.0 + i for i, channel in enumerate(servo)}
    return writers.dataflash(path, messages, known | (parameters or {}), **more)


def test_ardupilot_arrives_in_the_contracts_frames(tmp_path, motion, ned):
    log = open_log(_ardupilot(tmp_path / "f.bin", motion, ned, servo=(3, 1, 4, 2)))
    frame = log.frame()
    _same_motion(frame, motion)
    for i in range(4):
        np.testing.assert_allclose(frame[f"u_{i + 1}"], motion["u"][:, i], atol=1e-3)
    assert log.autopilot == "ArduCopter V4.5.7 (2a3dc4b7)"
    assert log.parameters["MOT_THST_EXPO"] == pytest.approx(0.65)
    assert "motors 1 to 4 are outputs 3, 1, 4, 2" in log.notes
    np.testing.assert_allclose(frame["p_ref_y_m"], motion["p"][:, 1] + 0.1, atol=1e-4)
    assert not _agree(frame)


def test_ardupilot_messages_of_no_length_are_skipped(tmp_path, motion, ned):
    path = _ardupilot(tmp_path / "f.bin", motion, ned)
    whole = path.read_bytes()
    length = whole.index(b"XKF1") - 1
    path.write_bytes(whole[:length] + b"\x00" + whole[length + 1 :])
    # without a velocity, and not read without an end
    frame = open_log(path).frame()
    assert "q_w" in frame and "v_x_m_s" not in frame


def test_ardupilot_rotor_speeds_against_the_commands_are_refused(tmp_path, motion, ned):
    def rpm(order):
        return {k: 8000 * np.sqrt(motion["u"][:, m]) for k, m in enumerate(order)}

    log = open_log(_ardupilot(tmp_path / "a.bin", motion, ned, esc=rpm((0, 1, 2, 3))))
    asked = 8000 * np.sqrt(motion["u"][:, 3]) * np.pi / 30
    np.testing.assert_allclose(log.frame()["rotor_speed_4_rad_s"], asked, rtol=1e-4)
    log = open_log(_ardupilot(tmp_path / "b.bin", motion, ned, esc=rpm((1, 3, 0, 2))))
    assert "rotor_speed" not in log.streams
    assert any("the commands speak for the order 3 1 4 2" in note for note in log.notes)


@pytest.mark.parametrize(
    ("more", "kind"),
    [
        ({"parameters": {"FRAME_CLASS": 6.0}}, "a helicopter"),
        ({"text": ("ArduPlane V4.5.7",)}, "an ArduPlane vehicle"),
    ],
)
def test_ardupilot_of_another_vehicle_is_refused(tmp_path, motion, ned, more, kind):
    with pytest.raises(GesError, match=f"this is a log of {kind}"):
        open_log(_ardupilot(tmp_path / "f.bin", motion, ned, **more)).frame()


def test_a_real_ardupilot_log(recordings_dir):
    log = open_log(recordings_dir / "ardupilot" / "dataflash-sample-1.bin")
    assert log.autopilot.startswith("ArduCopter V3.6.8") and log.parameters["RC3_MIN"] > 0
    rates = {name: round(s.rate_hz) for name, s in log.streams.items()}
    assert rates["attitude"] == rates["command"] == 10 and rates["acceleration"] == 25
    frame = log.frame()
    turning = {a.what: a.correlation for a in agreements(frame) if "turning" in a.what}
    assert len(turning) == 3 and min(turning.values()) > 0.95
    assert frame["acc_z_m_s2"].median() == pytest.approx(9.8, abs=0.1)
    # in Stabilize there is no height to hold
    assert frame["p_ref_z_m"].notna().mean() < 0.7


# --- Betaflight


def _betaflight(path, motion, header=None, motors=None, flights=1, **more):
    t_us = (motion["t"] * 1e6).astype(int)
    gyro, acc = np.degrees(motion["omega"]), motion["acc"] / 9.80665 * 2048
    motors = 48 + 1999 * motion["u"] if motors is None else motors
    fields = {"loopIteration": np.arange(len(t_us)), "time": t_us}
    fields |= {f"gyroADC[{k}]": np.round(100 * gyro[:, k]) for k in range(3)}
    fields |= {f"accSmooth[{k}]": np.round(acc[:, k]) for k in range(3)}
    fields |= {f"motor[{k}]": np.round(motors[:, k]) for k in range(motors.shape[1])}
    fields |= {"vbatLatest": np.full(len(t_us), 1612)} | more
    lines = {
        "Firmware revision": "Betaflight 4.5.1 (77d01ba3b) STM32F7X2",
        "gyro_scale": "0x3c23d70a",  # 0.01 deg/s
        "acc_1G": "2048",
        "motorOutput": "158,2047",
        "motor_poles": "12",
    }
    return writers.blackbox(path, fields, lines | (header or {}), flights)


def test_betaflight_arrives_in_the_contracts_units(tmp_path, motion):
    rpm = 9000 * np.sqrt(motion["u"])
    speeds = {f"eRPM[{k}]": np.round(rpm[:, k] * 6 / 100) for k in range(4)}
    log = open_log(_betaflight(tmp_path / "f.bbl", motion, **speeds))
    frame = log.frame()
    _same_motion(frame, motion, names=("acc_{}_m_s2",), tolerance=5e-3)
    np.testing.assert_allclose(frame["u_2"], motion["u"][:, 1], atol=1e-3)
    np.testing.assert_allclose(
        frame["rotor_speed_3_rad_s"], rpm[:, 2] * np.pi / 30, atol=100 / 6 * np.pi / 30
    )
    assert frame["battery_V"].to_numpy() == pytest.approx(16.12)
    assert log.autopilot.startswith("Betaflight 4.5.1") and log.parameters["motor_poles"] == 12


def test_inav_has_a_pose(tmp_path, motion, ned):
    north_east_up = ned["p"] * [1, 1, -1]
    pose = {f"navPos[{k}]": np.round(100 * north_east_up[:, k]) for k in range(3)}
    velocity = ned["v"] * [1, 1, -1]
    pose |= {f"navVel[{k}]": np.round(100 * velocity[:, k]) for k in range(3)}
    angles = np.degrees(ned["euler"]) * [10, -10, 10]
    pose |= {f"attitude[{k}]": np.round(angles[:, k]) for k in range(3)}
    revision = {"Firmware revision": "INAV 7.1.2 (4e1e59eb) MATEKF405", "motorOutput": "1000,2000"}
    path = _betaflight(
        tmp_path / "f.txt", motion, revision, motors=1000 + 1000 * motion["u"], **pose
    )
    frame = open_log(path).frame()
    _same_motion(frame, motion, tolerance=8e-3)
    np.testing.assert_allclose(frame["u_1"], motion["u"][:, 0], atol=1e-3)
    assert not _agree(frame, 0.8)


def test_the_longest_of_several_flights_is_read_and_said(tmp_path, motion):
    path = _betaflight(tmp_path / "f.bbl", motion, flights=2)
    whole = path.read_bytes()
    path.write_bytes(whole + whole[: int(0.4 * len(whole))])
    assert "flight 1 of 3 in the file is read; --part chooses another" in open_log(path).notes
    assert open_log(path, Options(part=2)).streams["rates"].span_s[1] > 7.0
    with pytest.raises(UsageError, match="holds 3 flights; --part 4 is none"):
        open_log(path, Options(part=4))


def test_betaflight_with_six_motors_is_read(tmp_path, motion):
    six = 48 + 1999 * motion["u"][:, [0, 1, 2, 3, 0, 1]]
    frame = open_log(_betaflight(tmp_path / "f.bbl", motion, motors=six)).frame()
    np.testing.assert_array_equal(frame["u_6"], frame["u_2"])


def test_betaflight_with_two_motors_is_refused(tmp_path, motion):
    with pytest.raises(GesError, match="a vehicle with 2 motors"):
        two = 48 + 1999 * motion["u"][:, :2]
        open_log(_betaflight(tmp_path / "f.bbl", motion, motors=two)).frame()


def test_a_real_betaflight_log(recordings_dir):
    """More thrust at the left rolls to the right, more at the rear pitches the nose down."""
    log = open_log(recordings_dir / "betaflight" / "LOG00037.BFL")
    assert log.autopilot.startswith("Betaflight 4.2.0")
    assert log.streams["rates"].t_s[-1] == pytest.approx(17.0, abs=0.1)
    assert any("motors 1 and 4 turn counter-clockwise" in note for note in log.notes)
    frame = log.frame()
    flying = frame[[f"u_{i}" for i in range(1, 5)]].mean(axis=1) > 0.2
    u, later = frame[flying], frame.shift(-20)[flying]
    for sides, axis in ((("u_3", "u_4", "u_1", "u_2"), "x"), (("u_1", "u_3", "u_2", "u_4"), "y")):
        push = (
            (u[sides[0]] + u[sides[1]] - u[sides[2]] - u[sides[3]]).rolling(9, center=True).mean()
        )
        turn = later[f"omega_{axis}_rad_s"] - u[f"omega_{axis}_rad_s"]
        assert push.corr(turn) > 0.3
    assert frame["acc_z_m_s2"][flying].median() == pytest.approx(9.8, abs=0.5)
    assert 20 < frame["battery_V"].median() < 25


# --- Crazyflie


def test_crazyflie_reads_rotor_speeds_every_event_and_motion_capture(tmp_path, motion):
    t_us = (motion["t"] * 1e6).astype(int) + 10_000_000
    fixed = {"t_us": t_us}
    fixed |= {f"gyro.{a}": np.degrees(motion["omega"][:, k]) for k, a in enumerate("xyz")}
    fixed |= {f"acc.{a}": motion["acc"][:, k] / 9.80665 for k, a in enumerate("xyz")}
    fixed |= {f"stateEstimate.q{a}": motion["q"][:, k] for k, a in enumerate("wxyz")}
    fixed |= {f"stateEstimate.{a}": 1.05 * motion["p"][:, k] for k, a in enumerate("xyz")}
    fixed |= {f"stateEstimate.v{a}": 1.05 * motion["v"][:, k] for k, a in enumerate("xyz")}
    fixed |= {f"pwm.m{i}_pwm": 65535 * motion["u"][:, i - 1] for i in range(1, 5)}
    fixed |= {f"rpm.m{i}": 15000 + 1000 * motion["u"][:, i - 1] for i in range(1, 5)}
    fixed["pm.vbatMV"] = np.full(len(t_us), 3900.0)
    seen = {"t_us": t_us[::2] + 3000}
    moved = motion["t"][::2] + 0.003
    for k, a in enumerate("xyz"):
        seen[f"locSrv.{a}"] = np.interp(moved, motion["t"], motion["p"][:, k])
    target = {"t_us": t_us[::10], "ctrltarget.x": motion["p"][::10, 0], "value": t_us[::10] * 0.0}
    path = writers.usd(
        tmp_path / "log00", [("fixedFrequency", fixed), ("estPose", seen), ("target", target)]
    )
    log = open_log(path)
    frame = log.frame()
    _same_motion(frame, motion, tolerance=8e-3)
    np.testing.assert_allclose(
        frame["rotor_speed_2_rad_s"], (15000 + 1000 * motion["u"][:, 1]) * np.pi / 30, rtol=1e-5
    )
    np.testing.assert_allclose(frame["u_4"], motion["u"][:, 3], atol=1e-5)
    assert frame["p_ref_x_m"].notna().sum() == len(t_us[::10])
    assert "v_x_m_s_estimate" in frame and "target_value" in frame
    assert any("duty cycles" in n for n in log.notes)
    assert any("motion capture" in n for n in log.notes)


@pytest.mark.parametrize("flight", ["free/eckart00", "free/eckart17", "payload/eckart27"])
def test_real_crazyflie_flights_with_measured_rotor_speeds(recordings_dir, flight):
    log = open_log(recordings_dir / "imrclab-crazyflie" / flight)
    assert log.streams["rotor_speed"].rate_hz > 400 and log.streams["position"].rate_hz > 90
    frame = log.frame()
    found = {a.what: a.correlation for a in agreements(frame)}
    assert found.pop("acc_z_m_s2 and squared rotor speeds") > 0.6
    assert min(found.values()) > 0.85, found
    moved = [a for a in agreements(frame) if a.what.startswith("d(p_")]
    assert all(a.ratio == pytest.approx(1.0, abs=0.02) for a in moved)


# --- tables and MATLAB


def test_a_table_with_text_a_mark_and_quoted_vectors(tmp_path):
    text = (
        "\ufefft_s,note,p_z_m,u_1,vector\n"
        '0.0,"take-off, now",1.0,0.5,"[1, 2, 3]"\n'
        '0.1,ça va,,0.6,"[1, 2, 3]"\n'
        "0.2,,1.2,0.7,\n"
    )
    (tmp_path / "f.csv").write_bytes(text.encode())
    log = open_log(tmp_path / "f.csv")
    assert list(log.streams) == ["position", "command"]
    assert log.streams["position"].columns["p_z_m"].tolist() == pytest.approx(
        [1.0, np.nan, 1.2], nan_ok=True
    )
    (tmp_path / "latin.csv").write_bytes(text.encode().replace("ç".encode(), b"\xe7"))
    assert len(open_log(tmp_path / "latin.csv").streams["command"].t_s) == 3


def test_separator_and_decimal_comma(tmp_path):
    (tmp_path / "map.yaml").write_text(
        "separator: ';'\ndecimal: ','\nlayouts:\n  - columns:\n      t: {to: t_s, unit: ms}\n"
        "      z: {to: p_z_m, unit: cm}\n      w: {to: wind, optional: true}\n"
    )
    (tmp_path / "f.csv").write_text("t;z\n0;100,5\n20;101,5\n")
    log = open_log(tmp_path / "f.csv", Options(tmp_path / "map.yaml"))
    assert log.streams["position"].columns["p_z_m"].tolist() == pytest.approx([1.005, 1.015])
    assert log.streams["position"].t_s.tolist() == pytest.approx([0.0, 0.02])


BAD_TABLES = {
    "a short row": ("t_s,u_1\n0,1\n0.1\n0.2,1\n", "line 3 has 1 columns, the first line 2"),
    "text": ("t_s,u_1\n0,0.1\n0.1,up\n", "line 3: 'up' is no number"),
    "no time": ("t,u_1\n0,0.1\n0.1,0.2\n", "needs a column map"),
    "time missing": ("t_s,u_1\n0,0.1\n,0.2\n", "not a number in row 1"),
    "header alone": ("t_s,u_1\n", "no sample"),
}


@pytest.mark.parametrize("case", BAD_TABLES)
def test_bad_tables_are_refused_with_the_place(tmp_path, case):
    text, words = BAD_TABLES[case]
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(GesError, match=words):
        open_log(tmp_path / "f.csv")


def test_a_map_is_checked(tmp_path):
    (tmp_path / "f.csv").write_text("1,2\n3,4\n")
    for text, words in (
        ("layouts:\n  - columns:\n      - {too: t_s}\n      - null\n", "unknown key 'too'"),
        (
            "layouts:\n  - columns:\n      - {to: t_s, unit: furlongs}\n      - null\n",
            "cannot become",
        ),
        ("layouts:\n  - columns:\n      - {to: t_s, unit: 'm('}\n      - null\n", "is not known"),
        ("layouts: [\n", "is not YAML"),
    ):
        (tmp_path / "map.yaml").write_text(text)
        with pytest.raises(UsageError, match=words):
            open_log(tmp_path / "f.csv", Options(tmp_path / "map.yaml"))
    with pytest.raises(UsageError, match="did you mean 'appius'"):
        open_log(tmp_path / "f.csv", Options("apius"))


def _columns(motion):
    columns = {"t_s": motion["t"]}
    for form, key in (
        ("p_{}_m", "p"),
        ("v_{}_m_s", "v"),
        ("acc_{}_m_s2", "acc"),
        ("omega_{}_rad_s", "omega"),
    ):
        columns |= {form.format(a): motion[key][:, k] for k, a in enumerate("xyz")}
    columns |= {f"u_{i + 1}": motion["u"][:, i] for i in range(4)}
    return columns | {f"q_{a}": motion["q"][:, k] for k, a in enumerate("wxyz")}


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_contract_names_need_no_map(tmp_path, motion, kind):
    table = pd.DataFrame(_columns(motion)).assign(remark="none")
    path = tmp_path / f"f.{kind}"
    table.to_csv(path, index=False) if kind == "csv" else table.to_parquet(path)
    frame = open_log(path).frame()
    _same_motion(frame, motion, tolerance=1e-9)
    assert "remark" not in frame


def test_a_map_turns_north_east_down(tmp_path, motion, ned):
    table = {"t": motion["t"]}
    table |= {
        f"{n}{k}": ned[key][:, k]
        for n, key in (("v", "v"), ("q", "q"), ("w", "omega"))
        for k in range(3)
    }
    table |= {f"q{k}": ned["q"][:, k] for k in range(4)}
    lines = ["layouts:", "  - axes: ned-frd", "    columns:", "      t: {to: t_s}"]
    for k, a in enumerate("xyz"):
        lines += [f"      v{k}: {{to: v_{a}_m_s}}", f"      w{k}: {{to: omega_{a}_rad_s}}"]
    lines += [f"      q{k}: {{to: q_{a}}}" for k, a in enumerate("wxyz")]
    (tmp_path / "map.yaml").write_text("\n".join(lines))
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)
    log = open_log(tmp_path / "f.csv", Options(tmp_path / "map.yaml"))
    got = np.stack(list(log.streams["velocity"].columns.values()), axis=1)
    np.testing.assert_allclose(got, motion["v"], atol=1e-9)
    got = np.stack(list(log.streams["rates"].columns.values()), axis=1)
    np.testing.assert_allclose(got, motion["omega"], atol=1e-9)
    (tmp_path / "map.yaml").write_text("\n".join(lines[:5]))
    with pytest.raises(UsageError, match="map the whole vector"):
        open_log(tmp_path / "f.csv", Options(tmp_path / "map.yaml"))


def test_the_iris_of_another_simulator(recordings_dir):
    """Its map is known by the column names; physics of a simulator agrees to per cents."""
    log = open_log(recordings_dir / "gazebo-iris" / "quadrotor_model.csv")
    assert "its columns are those of the map 'gazebo-iris'" in log.notes
    found = agreements(log.frame())
    tied = [a for a in found if "commands" not in a.what]
    assert len(tied) == 6
    assert all(a.correlation > 0.99 and a.ratio == pytest.approx(1.0, abs=0.03) for a in tied)


def test_matlab_by_its_own_names(tmp_path, motion):
    (tmp_path / "map.yaml").write_text(
        "layouts:\n  - columns:\n      log.t: {to: t_s}\n      'log.p(:,3)': {to: p_z_m}\n"
        "  - columns:\n      esc.t: {to: t_s, unit: ms}\n"
        "      'esc.rpm(1,:)': {to: rotor_speed_1_rad_s, unit: rpm}\n"
    )
    slow = motion["t"][::5]
    scipy.io.savemat(
        tmp_path / "f.mat",
        {
            "log": {"t": motion["t"], "p": motion["p"], "name": "x"},
            "esc": {"t": 1e3 * slow, "rpm": np.tile(3000 + slow, (4, 1))},
        },
    )
    log = open_log(tmp_path / "f.mat", Options(tmp_path / "map.yaml"))
    np.testing.assert_allclose(log.streams["position"].columns["p_z_m"], motion["p"][:, 2])
    speed = log.streams["rotor_speed"]
    np.testing.assert_allclose(speed.t_s, slow)
    np.testing.assert_allclose(speed.columns["rotor_speed_1_rad_s"], (3000 + slow) * np.pi / 30)
    with pytest.raises(UsageError, match="has not all variables"):
        open_log(tmp_path / "f.mat", Options("gazebo-iris"))


def test_matlab_of_the_newest_kind_is_refused_with_the_remedy(tmp_path):
    (tmp_path / "f.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    with pytest.raises(GesError, match="save it again by save"):
        open_log(tmp_path / "f.mat")


def test_maps_of_the_page_are_maps():
    """Examples of docs/importing.md, and every shipped map."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "importing.md").read_text()
    blocks = [yaml.safe_load(b) for b in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)]
    for block in blocks:
        model = TopicMap if "topics" in block else ColumnMap
        model.model_validate(block)
    assert len(blocks) == 2
    for name, mapping in (presets(ColumnMap) | presets(TopicMap)).items():
        assert mapping.about, name


def test_a_damaged_matlab_file_at_which_its_library_crashes_is_refused(tmp_path):
    scipy.io.savemat(tmp_path / "f.mat", {"t_s": np.arange(4.0)})
    data = bytearray((tmp_path / "f.mat").read_bytes())
    data[176] = 255  # type of the numbers
    (tmp_path / "f.mat").write_bytes(data)
    with pytest.raises(GesError, match="f.mat is damaged: it cannot be read as a MATLAB file"):
        open_log(tmp_path / "f.mat")
