"""Bad recordings end in one sentence that says what was wrong and what to do, never in a traceback
or a wrong number.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import ges
from ges.cli import cli, main
from ges.errors import GesError
from ges.recordings.recording import make_set, write_set
from ges.vehicle.load import load_vehicle, vehicle_path

ROOT = Path(__file__).resolve().parents[2]


T = np.arange(0.0, 8.0, 0.02)


def _flight(**changes) -> pd.DataFrame:
    """A hover of the appius vehicle, smooth and without noise."""
    n = len(T)
    columns = {
        "t_s": T,
        "p_x_m": 0 * T,
        "p_y_m": 0 * T,
        "p_z_m": 1.0 + 0.1 * np.sin(T),
        "v_x_m_s": 0 * T,
        "v_y_m_s": 0 * T,
        "v_z_m_s": 0.1 * np.cos(T),
        "q_w": np.ones(n),
        "q_x": 0 * T,
        "q_y": 0 * T,
        "q_z": 0 * T,
    }
    columns |= {f"rotor_speed_{i}_rad_s": np.full(n, 595.0) + np.sin(T + i) for i in range(1, 5)}
    frame = pd.DataFrame(columns | {k: v for k, v in changes.items() if v is not None})
    return frame.drop(columns=[k for k, v in changes.items() if v is None])


def _set(folder, *frames):
    write_set(
        folder,
        load_vehicle("appius"),
        [(f"f{i}", f) for i, f in enumerate(frames)],
    )
    return folder


def _told(arguments, capsys, monkeypatch) -> tuple[str, int]:
    monkeypatch.setattr("sys.argv", ["ges", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    return capsys.readouterr().err, stop.value.code


ROLL = 0.2 * np.sin(2.0 * T)
ROLLING = 0.4 * np.cos(2.0 * T)


def _moving(**changes) -> pd.DataFrame:
    """The hover with a slow roll, its gyro, and a height that goes up and down."""
    turned = {
        "q_w": np.cos(0.5 * ROLL),
        "q_x": np.sin(0.5 * ROLL),
        "omega_x_rad_s": ROLLING,
        "omega_y_rad_s": 0 * T,
        "omega_z_rad_s": 0 * T,
    }
    return _flight(**turned | changes)


def _turning(turns: float, **changes) -> pd.DataFrame:
    """The hover while it turns on the spot; its set-point counts the turns, in radians."""
    yaw = 2.0 * np.pi * turns * T / T[-1]
    turned = {"q_w": np.cos(0.5 * yaw), "q_z": np.sin(0.5 * yaw), "yaw_ref_rad": yaw}
    return _flight(**turned | changes)


SPEEDS = {f"rotor_speed_{i}_rad_s": None for i in range(1, 5)}
CASES = {
    "no drive": ([_flight(**SPEEDS), _flight(**SPEEDS)], "neither rotor speeds", 1),
    "zero length": ([_flight().iloc[:1], _flight()], "needs two or more", 1),
    "too short": ([_flight().iloc[:20], _flight().iloc[:20]], "leave this recording out", 1),
    "time runs back": ([_flight(t_s=T[::-1]), _flight()], "does not increase", 1),
    "rpm as rad/s": ([_flight(rotor_speed_1_rad_s=np.full(len(T), 5681.0)), _flight()], "rpm", 1),
    "accelerometer in g": (
        [_moving(acc_x_m_s2=0 * T, acc_y_m_s2=0 * T, acc_z_m_s2=1 + 0 * T)] * 2,
        "looks like g",
        1,
    ),
    "accelerometer down": (
        [_moving(acc_x_m_s2=0 * T, acc_y_m_s2=0 * T, acc_z_m_s2=0 * T - 9.8)] * 2,
        "z points down",
        1,
    ),
    "gyro in deg/s": ([_moving(omega_x_rad_s=57.3 * ROLLING)] * 2, "deg/s", 1),
    "gyro other way": (
        [_moving(omega_x_rad_s=-ROLLING)] * 2,
        "omega_x_rad_s has the other sign",
        1,
    ),
    "north-east-down": ([_moving(v_z_m_s=-0.1 * np.cos(T))] * 2, "v_z_m_s has the other sign", 1),
    "position in feet": (
        [_moving(p_z_m=3.28 * (1.0 + 0.1 * np.sin(T)))] * 2,
        "the position is in feet",
        1,
    ),
    "commands in per cent": ([_moving(u_1=0 * T + 55.0)] * 2, "commands are 0..1", 1),
    "set-point in degrees": (
        [_turning(0.5, yaw_ref_rad=180.0 * T / T[-1])] * 2,
        "it looks like degrees; convert to rad",
        1,
    ),
    "one flight": ([_flight()], "needed are 2 or more", 1),
}


@pytest.mark.parametrize("case", CASES)
def test_one_sentence(case, tmp_path, capsys, monkeypatch):
    frames, words, code = CASES[case]
    _set(tmp_path / "set", *frames)
    said, exit_code = _told(
        ["diagnose", tmp_path / "set", "--out", tmp_path / "out"], capsys, monkeypatch
    )
    assert exit_code == code and words in said and "Traceback" not in said
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_channel_of_nothing_but_nan_is_left_out_and_said(tmp_path):
    nan = {"battery_V": np.full(len(T), np.nan)}
    _set(tmp_path / "set", _flight(**nan), _flight(**nan))
    told = CliRunner().invoke(
        cli, ["diagnose", str(tmp_path / "set"), "--out", str(tmp_path / "out")]
    )
    assert told.exit_code == 0, told.output
    assert "battery_V holds no sample (all NaN)" in told.output


def test_unknown_flight_to_hold_out_names_the_nearest(tmp_path, capsys, monkeypatch):
    _set(tmp_path / "set", _flight(), _flight())
    said, code = _told(
        ["diagnose", tmp_path / "set", "--out", tmp_path / "out", "--holdout", "f3"],
        capsys,
        monkeypatch,
    )
    assert code == 2 and "unknown flight 'f3'" in said


def test_negative_mass_and_unknown_key(tmp_path, capsys, monkeypatch):
    _set(tmp_path / "set", _flight(), _flight())
    good = vehicle_path("appius").read_text()
    for text, words in (
        (good.replace("value: 1.5", "value: -1.5"), "must be positive"),
        (good + "\nweight: 3\n", "weight"),
    ):
        (tmp_path / "set" / "vehicle.yaml").write_text(text)
        said, code = _told(
            ["diagnose", tmp_path / "set", "--out", tmp_path / "out"], capsys, monkeypatch
        )
        assert code in (1, 2) and words in said and "Traceback" not in said


def test_a_flight_in_order_is_not_refused():
    still = {"acc_x_m_s2": 0 * T, "acc_y_m_s2": 0 * T, "acc_z_m_s2": 0 * T + 9.8}
    flights = make_set(load_vehicle("appius"), [("f", _moving(**still))])
    assert not flights.warnings and len(flights.flights) == 1


def test_a_set_point_may_count_its_turns():
    flights = make_set(load_vehicle("appius"), [("f", _turning(9.0))])
    assert flights.flights[0].frame["yaw_ref_rad"].max() > 50.0


def test_no_flight_at_all_is_said():
    with pytest.raises(GesError, match="no flight among the recordings"):
        ges.diagnose([], load_vehicle("appius"))


def test_an_effect_that_nobody_has_is_refused_before_any_work():
    with pytest.raises(GesError, match="unknown effect 'rotor_drga'; did you mean 'rotor_drag'"):
        ges.diagnose([_flight(), _flight()], load_vehicle("appius"), names=["rotor_drga"])
