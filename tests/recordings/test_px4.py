"""PX4 logs: rotor speeds of the right motor, the right instance, the right range, references that
no disturbance has touched.
"""

import numpy as np
import pytest
import writers

from ges.errors import GesError, UsageError
from ges.examine import examine
from ges.recordings.readers import Options, open_log
from ges.recordings.readers.rotor_order import agreement


def _us(t, offset_us=0):
    return (t * 1e6 + 1e6 + offset_us).astype(np.uint64)


def _topics(motion, ned):
    t = motion["t"]
    at = {"timestamp": _us(t)}
    return {
        "vehicle_attitude": at | {f"q[{k}]": ned["q"][:, k] for k in range(4)},
        "vehicle_angular_velocity": at | {f"xyz[{k}]": ned["omega"][:, k] for k in range(3)},
        "sensor_combined": at | {f"accelerometer_m_s2[{k}]": ned["acc"][:, k] for k in range(3)},
        "vehicle_local_position": at
        | dict(zip(("x", "y", "z"), ned["p"].T, strict=True))
        | dict(zip(("vx", "vy", "vz"), ned["v"].T, strict=True))
        | {f: np.ones(len(t)) for f in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")},
        "actuator_motors": at | {f"control[{k}]": motion["u"][:, k] for k in range(4)},
    }


def _write(path, topics, **more):
    return writers.ulog(path, [(name, 0, fields) for name, fields in topics.items()], **more)


def _esc(motion, order, functions=True):
    """Speed readings, reading k that of motor ``order[k]``."""
    fields = {"timestamp": _us(motion["t"])}
    for k, motor in enumerate(order):
        fields[f"esc[{k}].esc_rpm"] = 8000 * np.sqrt(motion["u"][:, motor - 1])
        if functions:
            fields[f"esc[{k}].actuator_function"] = np.full(len(motion["t"]), 100 + motor)
    return fields


def test_everything_arrives_in_the_contracts_frames(tmp_path, motion, ned):
    log = open_log(_write(tmp_path / "f.ulg", _topics(motion, ned)))
    frame = log.frame()
    assert log.autopilot.startswith("PX4") and not log.problem()
    for names, key in (("p_{}_m", "p"), ("v_{}_m_s", "v"), ("acc_{}_m_s2", "acc")):
        got = frame[[names.format(a) for a in "xyz"]].to_numpy()
        np.testing.assert_allclose(got, motion[key], atol=1e-5)
    np.testing.assert_allclose(
        frame[[f"omega_{a}_rad_s" for a in "xyz"]].to_numpy(), motion["omega"], atol=1e-5
    )
    q = frame[["q_w", "q_x", "q_y", "q_z"]].to_numpy()
    np.testing.assert_allclose(np.abs(np.sum(q * motion["q"], axis=1)), 1.0, atol=1e-6)
    np.testing.assert_allclose(frame["t_s"], motion["t"] + 1.0, atol=1e-6)


@pytest.mark.parametrize("order", [(1, 2, 3, 4), (2, 4, 1, 3)])
def test_rotor_speeds_go_by_the_function_of_the_output(tmp_path, motion, ned, order):
    topics = _topics(motion, ned) | {"esc_status": _esc(motion, order)}
    frame = open_log(_write(tmp_path / "f.ulg", topics)).frame()
    for i in range(4):
        asked = 8000 * np.sqrt(motion["u"][:, i]) * np.pi / 30
        np.testing.assert_allclose(frame[f"rotor_speed_{i + 1}_rad_s"], asked, rtol=1e-3)


def test_readings_without_a_function_are_used_only_if_the_commands_bear_them_out(
    tmp_path, motion, ned
):
    topics = _topics(motion, ned)
    right = topics | {"esc_status": _esc(motion, (1, 2, 3, 4), functions=False)}
    assert "rotor_speed" in open_log(_write(tmp_path / "a.ulg", right)).streams
    wrong = topics | {"esc_status": _esc(motion, (2, 4, 1, 3), functions=False)}
    log = open_log(_write(tmp_path / "b.ulg", wrong))
    assert "rotor_speed" not in log.streams
    assert any("speak for the order 3 1 4 2" in note for note in log.notes)
    stated = open_log(tmp_path / "b.ulg", Options(rotor_order=(3, 1, 4, 2)))
    speed = stated.streams["rotor_speed"].columns["rotor_speed_2_rad_s"]
    asked = 8000 * np.sqrt(motion["u"][:, 1]) * np.pi / 30
    np.testing.assert_allclose(speed, asked, rtol=1e-3)
    with pytest.raises(UsageError, match="name each of 1 to 4 once"):
        Options(rotor_order=(1, 1, 2, 3))


def test_a_velocity_that_the_estimator_never_had_is_no_missing_stream(tmp_path, motion, ned):
    """It is logged, at its full rate: what to switch on is no logger."""
    topics = _topics(motion, ned)
    place = topics["vehicle_local_position"]
    topics["vehicle_local_position"] = place | {"v_xy_valid": np.zeros(len(motion["t"]))}
    path = _write(tmp_path / "f.ulg", topics)
    assert list(open_log(path).unusable) == ["v_x_m_s", "v_y_m_s"]
    report = examine(path, Options())
    why = report["cannot_tell"]["rotor_drag"]
    assert why.startswith("needs a logged velocity") and "; v_xy_valid of vehicle_local" in why
    assert why.count("optical flow") == 1 and "velocity" not in report["switch_on"]


def test_an_instance_that_is_zero_throughout_is_passed_over_and_said(tmp_path, motion, ned):
    topics = _topics(motion, ned)
    idle = {k: v if k == "timestamp" else 0 * v for k, v in topics["actuator_motors"].items()}
    listed = [(name, 0, fields) for name, fields in topics.items() if name != "actuator_motors"]
    listed += [("actuator_motors", 0, idle), ("actuator_motors", 1, topics["actuator_motors"])]
    log = open_log(writers.ulog(tmp_path / "f.ulg", listed))
    np.testing.assert_allclose(log.frame()["u_1"], motion["u"][:, 0], atol=1e-6)
    assert "actuator_motors instance 0 is zero throughout; instance 1 is used" in log.notes


RANGES = {
    "before 1.11": ((1100.0, 1900.0), {"PWM_MIN": 1100, "PWM_MAX": 1900}),
    "1.11": ((1075.0, 1950.0), {"PWM_MAIN_MIN": 1075, "PWM_MAIN_MAX": 1950}),
    "1.12, one output its own": (
        (1075.0, 1950.0),
        {"PWM_MIN": 900, "PWM_MAX": 2100}
        | {f"PWM_MAIN_MIN{n}": 1075 for n in range(1, 5)}
        | {f"PWM_MAIN_MAX{n}": 1950 for n in range(1, 5)},
    ),
    "DShot": ((0.06 * 1999, 1999.0), {"DSHOT_MIN": 0.06, "DSHOT_CONFIG": 600}),
    "UAVCAN": (
        (1.0, 8191.0),
        {f"UAVCAN_EC_FUNC{n}": 100 + n for n in range(1, 5)}
        | {f"UAVCAN_EC_MIN{n}": 1 for n in range(1, 5)}
        | {f"UAVCAN_EC_MAX{n}": 8191 for n in range(1, 5)},
    ),
}


@pytest.mark.parametrize("version", RANGES)
def test_ranges_of_the_outputs(tmp_path, motion, ned, version):
    (low, high), parameters = RANGES[version]
    topics = _topics(motion, ned)
    u = topics.pop("actuator_motors")
    topics["actuator_outputs"] = {
        "timestamp": u["timestamp"],
        **{f"output[{k}]": low + (high - low) * u[f"control[{k}]"] for k in range(4)},
    }
    frame = open_log(_write(tmp_path / "f.ulg", topics, parameters=parameters)).frame()
    np.testing.assert_allclose(
        frame[[f"u_{i}" for i in range(1, 5)]].to_numpy(), motion["u"], atol=1e-4
    )


def test_outputs_without_a_range_ask_for_it(tmp_path, motion, ned):
    topics = _topics(motion, ned)
    u = topics.pop("actuator_motors")
    topics["actuator_outputs"] = {
        "timestamp": u["timestamp"],
        **{f"output[{k}]": 1000 + 1000 * u[f"control[{k}]"] for k in range(4)},
    }
    path = _write(tmp_path / "f.ulg", topics)
    with pytest.raises(GesError, match="give their range, e.g. --pwm 1000 2000"):
        open_log(path)
    frame = open_log(path, Options(pwm=(1000.0, 2000.0))).frame()
    np.testing.assert_allclose(frame["u_3"], motion["u"][:, 2], atol=1e-4)


def test_outputs_go_by_function_too(tmp_path, motion, ned):
    topics = _topics(motion, ned)
    u = topics.pop("actuator_motors")
    order = (2, 4, 1, 3)  # output 1 drives motor 2
    topics["actuator_outputs"] = {
        "timestamp": u["timestamp"],
        **{f"output[{k}]": 1100 + 800 * u[f"control[{m - 1}]"] for k, m in enumerate(order)},
    }
    parameters = {f"PWM_MAIN_FUNC{k + 1}": 100 + m for k, m in enumerate(order)}
    parameters |= {f"PWM_MAIN_MIN{n}": 1100 for n in range(1, 5)}
    parameters |= {f"PWM_MAIN_MAX{n}": 1900 for n in range(1, 5)}
    frame = open_log(_write(tmp_path / "f.ulg", topics, parameters=parameters)).frame()
    np.testing.assert_allclose(
        frame[[f"u_{i}" for i in range(1, 5)]].to_numpy(), motion["u"], atol=1e-4
    )


def test_a_controllers_own_answer_is_no_reference(tmp_path, motion, ned):
    """The velocity of the old set-point holds the answer to the position error, where there is a
    position set-point.
    """
    t = motion["t"]
    half = t < 4.0
    where = np.where(half[:, None], ned["p"], np.nan)
    setpoint = {"timestamp": _us(t)}
    setpoint |= dict(zip("xyz", where.T, strict=True))
    setpoint |= dict(zip(("vx", "vy", "vz"), ned["v"].T, strict=True))
    setpoint["yaw"] = np.full(len(t), 0.3)
    topics = _topics(motion, ned) | {"vehicle_local_position_setpoint": setpoint}
    frame = open_log(_write(tmp_path / "f.ulg", topics)).frame()
    assert frame["v_ref_x_m_s"][half].isna().all()
    np.testing.assert_allclose(frame["v_ref_x_m_s"][~half], motion["v"][~half, 0], atol=1e-5)
    np.testing.assert_allclose(frame["p_ref_z_m"][half], motion["p"][half, 2], atol=1e-5)
    assert frame["yaw_ref_rad"].to_numpy() == pytest.approx(np.pi / 2 - 0.3)


def test_a_slow_stream_speaks_once_a_sample(tmp_path, motion, ned):
    """4 Hz on rows of 50 Hz: a value in the row nearest to each sample, on the line between."""
    topics = _topics(motion, ned)
    esc = _esc(motion, (1, 2, 3, 4))
    topics["esc_status"] = {k: v[3::13] for k, v in esc.items()}
    log = open_log(_write(tmp_path / "f.ulg", topics))
    assert log.streams["rotor_speed"].rate_hz == pytest.approx(1 / 0.26, rel=0.01)
    speed = log.frame()["rotor_speed_1_rad_s"]
    assert speed.notna().sum() == len(motion["t"][3::13])
    asked = 8000 * np.sqrt(motion["u"][3::13, 0]) * np.pi / 30
    np.testing.assert_allclose(speed.dropna(), asked, rtol=1e-3)


REFUSED = {
    "a VTOL aircraft": {"MAV_TYPE": 22},
    "a helicopter": {"MAV_TYPE": 4},
    "a vehicle with 2 rotors": {"CA_ROTOR_COUNT": 2},
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_no_multirotor_is_refused_in_one_sentence(tmp_path, motion, ned, kind):
    log = open_log(_write(tmp_path / "f.ulg", _topics(motion, ned), parameters=REFUSED[kind]))
    assert "attitude" in log.streams
    with pytest.raises(GesError, match=f"f: this is a log of {kind}; multirotors can be"):
        log.frame()


def test_a_log_at_1_hz_and_one_without_motors_are_refused_in_one_sentence(tmp_path, motion, ned):
    topics = _topics(motion, ned)
    slow = {name: {k: v[::50] for k, v in fields.items()} for name, fields in topics.items()}
    with pytest.raises(GesError, match="its drive is logged 1 times a second"):
        open_log(_write(tmp_path / "slow.ulg", slow)).frame()
    topics.pop("actuator_motors")
    with pytest.raises(GesError, match="the log says nothing of the drive"):
        open_log(_write(tmp_path / "none.ulg", topics)).frame()


def test_a_log_cut_short_is_read_up_to_the_cut(tmp_path, motion, ned):
    whole = _write(tmp_path / "f.ulg", _topics(motion, ned)).read_bytes()
    (tmp_path / "cut.ulg").write_bytes(whole[: int(0.7 * len(whole))])
    log = open_log(tmp_path / "cut.ulg")
    assert 5.0 < log.frame()["t_s"].max() - 1.0 < 6.0
    assert any("cut short or damaged" in note for note in log.notes)


def test_ekf_failure_has_its_speeds_at_the_right_motors(recordings_dir):
    """Readings 2 4 1 3 by their functions; as numbered, the commands do not know their speeds."""
    log = open_log(recordings_dir / "px4-flights" / "ekf_failure.ulg")
    r = agreement(log.streams["command"], log.streams["rotor_speed"])
    assert np.diag(r) == pytest.approx([0.48, 0.61, 0.70, 0.35], abs=0.1)
    assert any("are readings 3, 1, 4, 2 of esc_status" in note for note in log.notes)
    assert log.parameters["CA_ROTOR0_PX"] == pytest.approx(0.11)
    assert log.parameters["THR_MDL_FAC"] == 0.0


@pytest.mark.parametrize("name", ["ekf_failure", "battery_brownout", "sample_px4_events"])
def test_outputs_of_real_logs_say_what_the_commands_say(recordings_dir, name):
    """DShot with channels in another order, PWM, and PX4's own simulator."""
    from ges.recordings.readers import px4

    log = px4._open(recordings_dir / "px4-flights" / f"{name}.ulg")
    asked = dict(px4._commands(log, Options()))["command"]
    sent, t_s, _ = px4._outputs(log, Options())
    flying = np.interp(t_s, asked.t_s, asked.columns["u_1"]) > 0.05
    for i, row in enumerate(sent, 1):
        u = np.interp(t_s, asked.t_s, asked.columns[f"u_{i}"])
        assert np.median(np.abs(u - row)[flying]) < 2e-3, i


def test_a_voltage_that_no_battery_has_is_not_used(recordings_dir):
    log = open_log(recordings_dir / "px4-flights" / "battery_brownout.ulg")
    assert "battery" not in log.streams
    assert any("which no battery has" in note for note in log.notes)


def test_a_vtol_is_refused_kindly(recordings_dir):
    log = open_log(recordings_dir / "px4-flights" / "sample_log_small.ulg")
    assert log.problem() == "this is a log of a VTOL aircraft; multirotors can be diagnosed"
