"""PX4 ULog by pyulog: topics brought to one clock and to ENU/FLU.

The grid is that of the attitude. Each topic is taken by linear interpolation between its own samples, and only where
two of them lie less than a quarter of a second apart: gaps stay NaN, nothing is invented.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pyulog

from ..errors import GesError

_GAP_S = 0.25
_QUIET_TOPICS = ["vehicle_attitude", "vehicle_angular_velocity", "sensor_combined", "vehicle_local_position", "actuator_outputs",
                 "actuator_motors", "battery_status", "distance_sensor", "esc_status", "vehicle_local_position_setpoint"]  # fmt: skip


class _Log:
    """Topics of a log as arrays over seconds."""

    def __init__(self, log: pyulog.ULog) -> None:
        self.parameters = log.initial_parameters
        self.start_us = log.start_timestamp
        self.topics = {d.name: d.data for d in reversed(log.data_list) if len(d.data["timestamp"]) > 1}

    def seconds(self, topic: str) -> np.ndarray:
        return (self.topics[topic]["timestamp"].astype(float) - self.start_us) * 1e-6

    def has(self, topic: str, field: str) -> bool:
        return topic in self.topics and field in self.topics[topic]

    def on(self, grid: np.ndarray, topic: str, field: str) -> np.ndarray:
        """A field on the grid; NaN in gaps and beyond the topic's ends."""
        t, values = self.seconds(topic), self.topics[topic][field].astype(float)
        after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
        gap = t[after] - t[after - 1]
        inside = (grid >= t[0]) & (grid <= t[-1]) & (gap < _GAP_S)
        return np.where(inside, np.interp(grid, t, values), np.nan)


def _attitude(log: _Log, grid: np.ndarray) -> dict[str, np.ndarray]:
    """NED/FRD quaternion to ENU/FLU: q_enu_flu = q_ned_to_enu q q_flu_to_frd."""
    w, x, y, z = (log.on(grid, "vehicle_attitude", f"q[{k}]") for k in range(4))
    h = np.sqrt(0.5)
    enu = (h * (w + z), h * (x + y), h * (x - y), h * (w - z))  # (0, h, h, 0) * q * (0, 1, 0, 0), sign dropped
    norm = np.sqrt(sum(v * v for v in enu))
    return {name: v / norm for name, v in zip(("q_w", "q_x", "q_y", "q_z"), enu, strict=True)}


def _rates(log: _Log, grid: np.ndarray) -> dict[str, np.ndarray]:
    for topic, fields in (("vehicle_angular_velocity", ("xyz[0]", "xyz[1]", "xyz[2]")),
                          ("sensor_combined", ("gyro_rad[0]", "gyro_rad[1]", "gyro_rad[2]")),
                          ("vehicle_attitude", ("rollspeed", "pitchspeed", "yawspeed"))):  # fmt: skip
        if log.has(topic, fields[0]):
            values = [sign * log.on(grid, topic, f) for sign, f in zip((1, -1, -1), fields, strict=True)]
            return dict(zip(("omega_x_rad_s", "omega_y_rad_s", "omega_z_rad_s"), values, strict=True))
    return {}


def _motion(log: _Log, grid: np.ndarray) -> dict[str, np.ndarray]:
    columns = {}
    for topic, suffix in (("vehicle_local_position", ""), ("vehicle_local_position_setpoint", "_ref")):
        for axis, field, sign in (("x", "y", 1), ("y", "x", 1), ("z", "z", -1)):
            if log.has(topic, field):
                columns[f"p{suffix}_{axis}_m"] = sign * log.on(grid, topic, field)
            if log.has(topic, "v" + field):
                columns[f"v{suffix}_{axis}_m_s"] = sign * log.on(grid, topic, "v" + field)
    if log.has("sensor_combined", "accelerometer_m_s2[0]"):
        for k, (axis, sign) in enumerate((("x", 1), ("y", -1), ("z", -1))):
            columns[f"acc_{axis}_m_s2"] = sign * log.on(grid, "sensor_combined", f"accelerometer_m_s2[{k}]")
    return columns


def _drive(log: _Log, grid: np.ndarray, n_rotors: int) -> dict[str, np.ndarray]:
    columns = {}
    low, high = (float(log.parameters.get(k, d)) for k, d in (("PWM_MIN", 1000), ("PWM_MAX", 2000)))
    for i in range(n_rotors):
        if log.has("actuator_motors", f"control[{i}]"):
            columns[f"u_{i + 1}"] = log.on(grid, "actuator_motors", f"control[{i}]")
        elif log.has("actuator_outputs", f"output[{i}]"):
            columns[f"u_{i + 1}"] = np.clip((log.on(grid, "actuator_outputs", f"output[{i}]") - low) / (high - low), 0, 1)
        if log.has("esc_status", f"esc[{i}].esc_rpm"):
            columns[f"rotor_speed_{i + 1}_rad_s"] = log.on(grid, "esc_status", f"esc[{i}].esc_rpm") * (np.pi / 30)
    for field, column in (("voltage_v", "battery_V"), ("current_a", "battery_A")):
        if log.has("battery_status", field):
            columns[column] = log.on(grid, "battery_status", field)
    if log.has("distance_sensor", "current_distance"):
        columns["range_m"] = log.on(grid, "distance_sensor", "current_distance")
    return columns


def _open(path: Path) -> pyulog.ULog:
    try:
        return pyulog.ULog(io.BytesIO(path.read_bytes()), _QUIET_TOPICS)
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror}") from None
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, struct.error, UnicodeDecodeError) as error:
        raise GesError(f"{path.name} is not a readable ULog file (cut short or another format): {error}") from None


def read_ulog(path: str | Path, n_rotors: int = 4) -> tuple[pd.DataFrame, list[str]]:
    """One flight from a PX4 log.

    Returns
    -------
    frame, warnings : contract columns on the attitude's time base, t = 0 at the log's start; what the log lacks.

    Raises
    ------
    GesError
        When the file is no ULog, is cut before its data, or has no attitude.
    """
    path = Path(path)
    raw = _open(path)
    log = _Log(raw)
    if "vehicle_attitude" not in log.topics:
        raise GesError(f"{path.name} holds no vehicle_attitude (cut short, or not logged); use a logging profile with attitude")
    grid = log.seconds("vehicle_attitude")
    grid = grid[np.concatenate([[True], np.diff(grid) > 0])]
    columns = {"t_s": grid, **_attitude(log, grid), **_rates(log, grid), **_motion(log, grid), **_drive(log, grid, n_rotors)}
    warnings = [f"{path.name}: the log is damaged; the readable part is used"] if getattr(raw, "file_corruption", False) else []
    lacking = [what for what, name in (("rotor speeds", "rotor_speed_1_rad_s"), ("battery voltage", "battery_V"),
                                       ("position references", "p_ref_x_m")) if name not in columns]  # fmt: skip
    if lacking:
        warnings.append(f"{path.name}: the log has no {', no '.join(lacking)}; a fuller logging profile would help")
    return pd.DataFrame(columns), warnings
