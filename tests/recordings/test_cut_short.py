"""Logs that end early, as they do when the battery is pulled or a download stops: read up to the
cut, or refused in a sentence.
"""

import mutate
import numpy as np
import pandas as pd
import pytest
import writers

from ges.errors import GesError
from ges.recordings.readers import Options, open_log

SHARES = (0.3, 0.6, 0.95)
# One real log of each kind; those of PX4 differ in the topics that they end in.
REAL = {
    "appius-ground-effect/HOVERING.csv": Options("appius"),
    "ardupilot/dataflash-sample-1.bin": Options(),
    "betaflight/LOG00037.BFL": Options(),
    "crazypad/normal_flight/E8_log00": Options(),
    "gazebo-iris/quadrotor_model.csv": Options(),
    "imrclab-crazyflie/free/eckart00": Options(),
    "px4-flights/battery_brownout.ulg": Options(),
    "px4-flights/ekf_failure.ulg": Options(),
    "px4-flights/sample_log_small.ulg": Options(),
    "px4-flights/sample_px4_events.ulg": Options(),
    "px4-sample/sample.ulg": Options(),
}
SLOW = {"ardupilot/dataflash-sample-1.bin", "betaflight/LOG00037.BFL"}


def _cut(whole, share, folder):
    """The first bytes of a log, under its own name."""
    path = folder / whole.name
    path.write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
    return path


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in REAL]
)
def test_a_real_log_cut_short(recordings_dir, tmp_path, name, share):
    found = mutate.outcome(_cut(recordings_dir / name, share, tmp_path), REAL[name])
    assert found in ("read", "refused")


def _us(motion):
    return (motion["t"] * 1e6).astype(int) + 1_000_000


def _ulog(path, motion):
    at = {"timestamp": _us(motion)}
    return writers.ulog(
        path,
        [
            ("vehicle_attitude", 0, at | {f"q[{k}]": motion["q"][:, k] for k in range(4)}),
            ("actuator_motors", 0, at | {f"control[{k}]": motion["u"][:, k] for k in range(4)}),
        ],
    )


def _usd(path, motion):
    fields = {"t_us": _us(motion)}
    fields |= {f"motor.m{i}": 65535 * motion["u"][:, i - 1] for i in range(1, 5)}
    fields |= {f"gyro.{a}": np.degrees(motion["omega"][:, k]) for k, a in enumerate("xyz")}
    return writers.usd(path, [("fixedFrequency", fields)])


def _dataflash(path, motion):
    t_us = _us(motion).tolist()
    tables = [
        ("ATT", "Qfff", ("TimeUS", "Roll", "Pitch", "Yaw"), 10.0 * motion["omega"]),
        ("RCOU", "Qffff", ("TimeUS", "C1", "C2", "C3", "C4"), 1100 + 800 * motion["u"]),
    ]
    messages = [
        (name, form, columns, [(t, *row) for t, row in zip(t_us, values.tolist(), strict=True)])
        for name, form, columns, values in tables
    ]
    known = {"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0, "FRAME_CLASS": 1.0}
    known |= {f"SERVO{i}_FUNCTION": 32.0 + i for i in range(1, 5)}
    return writers.dataflash(path, messages, known)


def _blackbox(path, motion):
    fields = {"loopIteration": np.arange(len(motion["t"])), "time": _us(motion)}
    fields |= {f"gyroADC[{k}]": np.degrees(100 * motion["omega"][:, k]) for k in range(3)}
    fields |= {f"motor[{k}]": 48 + 1999 * motion["u"][:, k] for k in range(4)}
    header = {
        "Firmware revision": "Betaflight 4.5.1 (77d01ba3b) STM32F7X2",
        "gyro_scale": "0x3c23d70a",
        "acc_1G": "2048",
        "motorOutput": "158,2047",
    }
    return writers.blackbox(path, fields, header)


def _table(motion):
    columns = {"t_s": motion["t"]} | {f"u_{i + 1}": motion["u"][:, i] for i in range(4)}
    return pd.DataFrame(columns | {f"q_{a}": motion["q"][:, k] for k, a in enumerate("wxyz")})


def _csv(path, motion):
    _table(motion).to_csv(path, index=False)
    return path


WRITTEN = {"f.ulg": _ulog, "log00": _usd, "f.bin": _dataflash, "f.bbl": _blackbox, "f.csv": _csv}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_log_cut_short_is_the_same_log_up_to_the_cut(tmp_path, motion, name):
    whole = WRITTEN[name](tmp_path / name, motion)
    (tmp_path / "cut").mkdir()
    long, last_s = open_log(whole).frame().set_index("t_s"), 0.0
    for share in SHARES:
        frame = open_log(_cut(whole, share, tmp_path / "cut")).frame().set_index("t_s")
        span_s = frame.index[-1] - long.index[0]
        assert last_s < span_s < long.index[-1] - long.index[0]
        # the last row may be half a row
        kept = frame.index[:-1]
        pd.testing.assert_frame_equal(frame.loc[kept], long.loc[kept, frame.columns], rtol=1e-6)
        last_s = span_s
    assert last_s > 0.85 * (long.index[-1] - long.index[0])


def test_a_parquet_file_cut_short_is_refused(tmp_path, motion):
    """What its columns are stands at its end."""
    _table(motion).to_parquet(tmp_path / "f.parquet")
    (tmp_path / "cut").mkdir()
    for share in SHARES:
        with pytest.raises(GesError) as stop:
            open_log(_cut(tmp_path / "f.parquet", share, tmp_path / "cut"))
        assert "\n" not in str(stop.value)
