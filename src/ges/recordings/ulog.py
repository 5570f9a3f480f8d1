"""PX4 ULog by pyulog: topics brought to one clock and to ENU/FLU.

The time base is that of the attitude. A slower topic is taken by a straight line between its own
samples (commands and set-points: the last one given), and only where two of them lie less than a
quarter of a second apart; a faster one by its mean around each instant, so that vibration does not
fold down. Gaps stay NaN, nothing is invented.
"""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pyulog

from ges.conventions import BODY_RATE, QUATERNION, SPECIFIC_FORCE
from ges.errors import GesError

_GAP_S = 0.25
_HELD_S = 1.0
_FASTER = 1.5
_DOWNWARD = 25
_MAGIC = b"ULog\x01\x12\x35"
_HEADER, _MESSAGE_HEADER = 16, 3
_TOPICS = ["vehicle_attitude", "vehicle_angular_velocity", "sensor_combined", "vehicle_local_position", "actuator_outputs",
           "actuator_motors", "battery_status", "distance_sensor", "esc_status", "vehicle_local_position_setpoint"]
_RATES = (("vehicle_angular_velocity", "xyz[{}]"), ("sensor_combined", "gyro_rad[{}]"))
_OLD_RATES = ("rollspeed", "pitchspeed", "yawspeed")
_FLU_FROM_FRD = (1, -1, -1)


class _Log:
    """Topics of a log as arrays over seconds; of several instances the first."""

    def __init__(self, log: pyulog.ULog) -> None:
        self.parameters = log.initial_parameters
        self.start_us = log.start_timestamp
        self.topics = {d.name: d.data for d in reversed(log.data_list) if len(d.data["timestamp"]) > 1}

    def seconds(self, topic: str) -> np.ndarray:
        return (self.topics[topic]["timestamp"].astype(float) - self.start_us) * 1e-6

    def has(self, topic: str, field: str) -> bool:
        return topic in self.topics and field in self.topics[topic]

    def field(self, topic: str, field: str, valid: str | None = None) -> np.ndarray:
        """Values of a field, NaN where the log's own flag says that they are not valid."""
        values = self.topics[topic][field].astype(float)
        return np.where(self.topics[topic][valid] == 1, values, np.nan) if valid and self.has(topic, valid) else values

    def on(self, grid: np.ndarray, topic: str, field: str, valid: str | None = None) -> np.ndarray:
        """A measured field on the grid; NaN in gaps and beyond the topic's ends."""
        return on_grid(grid, self.seconds(topic), self.field(topic, field, valid))

    def held(self, grid: np.ndarray, topic: str, field: str) -> np.ndarray:
        """A command on the grid: the last one given, for at most a second."""
        t = self.seconds(topic)
        before = np.searchsorted(t, grid, side="right") - 1
        given = (before >= 0) & (grid - t[np.maximum(before, 0)] < _HELD_S)
        return np.where(given, self.field(topic, field)[np.maximum(before, 0)], np.nan)


def on_grid(grid: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (m,) at times ``t`` brought to the times ``grid`` (n,); NaN where there is nothing to
    go by.
    """
    if np.median(np.diff(grid)) > _FASTER * np.median(np.diff(t)):
        return _means(grid, t, values)
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    inside = (grid >= t[0]) & (grid <= t[-1]) & (t[after] - t[after - 1] < _GAP_S)
    return np.where(inside, np.interp(grid, t, values), np.nan)


def _means(grid: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean of the samples in the cell around each grid time, NaN in an empty cell; a cell is a
    median step wide at most.
    """
    half = 0.5 * np.median(np.diff(grid))
    first, last = np.searchsorted(t, grid - half), np.searchsorted(t, grid + half)
    total = np.concatenate([[0.0], np.cumsum(values)])
    count = last - first
    return np.divide(total[last] - total[first], count, out=np.full(len(grid), np.nan), where=count > 0)


def _attitude(log: _Log, grid: np.ndarray) -> dict[str, np.ndarray]:
    """NED/FRD quaternion to ENU/FLU: q_enu_flu = q_enu_from_ned q q_frd_from_flu."""
    w, x, y, z = (log.field("vehicle_attitude", f"q[{k}]") for k in range(4))
    h = np.sqrt(0.5)
    # (0, h, h, 0) q (0, 1, 0, 0), sign dropped
    enu = np.stack([h * (w + z), h * (x + y), h * (x - y), h * (w - z)])
    flips = np.where(np.sum(enu[:, 1:] * enu[:, :-1], axis=0) < 0, -1.0, 1.0)
    enu[:, 1:] *= np.cumprod(flips)
    t = log.seconds("vehicle_attitude")
    on = np.stack([on_grid(grid, t, row) for row in enu])
    return dict(zip(QUATERNION, on / np.linalg.norm(on, axis=0), strict=True))


def _body(log: _Log, grid: np.ndarray, names: tuple[str, ...], topic: str, fields: list[str]) -> dict[str, np.ndarray]:
    signed = zip(names, _FLU_FROM_FRD, fields, strict=True)
    return {name: sign * log.on(grid, topic, field) for name, sign, field in signed}


def _inertial(log: _Log, grid: np.ndarray) -> dict[str, np.ndarray]:
    """Body rates and specific force."""
    columns = {}
    forms = ((topic, [form.format(k) for k in range(3)]) for topic, form in _RATES if log.has(topic, form.format(0)))
    topic, fields = next(forms, ("vehicle_attitude", list(_OLD_RATES)))
    if log.has(topic, fields[0]):
        columns |= _body(log, grid, BODY_RATE, topic, fields)
    if log.has("sensor_combined", "accelerometer_m_s2[0]"):
        columns |= _body(log, grid, SPECIFIC_FORCE, "sensor_combined", [f"accelerometer_m_s2[{k}]" for k in range(3)])
    return columns


def _motion(log: _Log, grid: np.ndarray) -> dict[str, np.ndarray]:
    """Position, velocity and their references, where the log calls them valid."""
    columns = {}
    for axis, field, sign, flag in (("x", "y", 1, "xy"), ("y", "x", 1, "xy"), ("z", "z", -1, "z")):
        for name, logged, valid in ((f"p_{axis}_m", field, f"{flag}_valid"), (f"v_{axis}_m_s", "v" + field, f"v_{flag}_valid")):
            if log.has("vehicle_local_position", logged):
                columns[name] = sign * log.on(grid, "vehicle_local_position", logged, valid)
        for name, logged in ((f"p_ref_{axis}_m", field), (f"v_ref_{axis}_m_s", "v" + field)):
            if log.has("vehicle_local_position_setpoint", logged):
                columns[name] = sign * log.held(grid, "vehicle_local_position_setpoint", logged)
    if log.has("vehicle_local_position_setpoint", "yaw"):
        east = np.pi / 2 - log.held(grid, "vehicle_local_position_setpoint", "yaw")
        columns["yaw_ref_rad"] = (east + np.pi) % (2 * np.pi) - np.pi
    return columns


def _commands(log: _Log, grid: np.ndarray, n_rotors: int, span: tuple[float, float] | None) -> dict[str, np.ndarray]:
    """Normalised motor commands; pulse widths by the given range, else by the log's PWM_MIN and
    PWM_MAX.
    """
    if log.has("actuator_motors", f"control[{n_rotors - 1}]"):
        return {f"u_{i + 1}": np.clip(log.held(grid, "actuator_motors", f"control[{i}]"), 0, 1) for i in range(n_rotors)}
    if not log.has("actuator_outputs", f"output[{n_rotors - 1}]"):
        return {}
    if span is None and not {"PWM_MIN", "PWM_MAX"} <= set(log.parameters):
        raise GesError("the log holds pulse widths but no PWM_MIN and PWM_MAX; give their range, e.g. --pwm 1000 2000")
    low, high = span or (float(log.parameters["PWM_MIN"]), float(log.parameters["PWM_MAX"]))
    return {f"u_{i + 1}": np.clip((log.held(grid, "actuator_outputs", f"output[{i}]") - low) / (high - low), 0, 1)
            for i in range(n_rotors)}


def _electrics(log: _Log, grid: np.ndarray, n_rotors: int) -> dict[str, np.ndarray]:
    """Rotor speeds, battery and the downward rangefinder."""
    columns = {f"rotor_speed_{i + 1}_rad_s": log.on(grid, "esc_status", f"esc[{i}].esc_rpm") * (np.pi / 30)
               for i in range(n_rotors) if log.has("esc_status", f"esc[{i}].esc_rpm")}
    for field, column in (("voltage_v", "battery_V"), ("current_a", "battery_A")):
        if log.has("battery_status", field):
            columns[column] = log.on(grid, "battery_status", field)
    if log.has("distance_sensor", "current_distance"):
        facing = (
            log.field("distance_sensor", "orientation") if log.has("distance_sensor", "orientation") else np.array([_DOWNWARD])
        )
        if np.all(facing == _DOWNWARD):
            columns["range_m"] = log.on(grid, "distance_sensor", "current_distance")
    return columns


def is_whole(data: bytes) -> bool:
    """Whether the messages of a log end where the file ends."""
    at = _HEADER
    while at + _MESSAGE_HEADER <= len(data):
        at += _MESSAGE_HEADER + int.from_bytes(data[at : at + 2], "little")
    return at == len(data)


def _open(path: Path) -> tuple[pyulog.ULog, bool]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror}") from None
    if not data.startswith(_MAGIC):
        raise GesError(f"{path.name} is not a PX4 ULog (it must begin with 'ULog')")
    try:
        log = pyulog.ULog(io.BytesIO(data), _TOPICS)
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, struct.error) as error:
        raise GesError(f"{path.name} is cut short or damaged before its first sample: {error}") from None
    return log, is_whole(data) and not log.file_corruption


def _notices(name: str, columns: dict[str, np.ndarray], whole: bool, n_rotors: int) -> list[str]:
    notices = [] if whole else [f"{name} is cut short or damaged; the samples that can be read are used"]
    lacking = [what for what, column in (("motor commands", "u_1"), ("rotor speeds", "rotor_speed_1_rad_s"),
                                         ("battery voltage", "battery_V"), ("position references", "p_ref_x_m"))
               if column not in columns]
    if lacking:
        notices.append(f"{name}: the log has no {', no '.join(lacking)}; a fuller logging profile would help")
    if "u_1" in columns and not any(np.nanmax(columns[f"u_{i + 1}"], initial=0) > 0 for i in range(n_rotors)):
        notices.append(f"{name}: the motor commands never leave zero; the vehicle was not armed, or other outputs drive it")
    return notices


def read_ulog(path: str | Path, n_rotors: int = 4, pwm: tuple[float, float] | None = None) -> tuple[pd.DataFrame, list[str]]:
    """One flight from a PX4 log.

    Parameters
    ----------
    path : the log.
    n_rotors : how many motor outputs to take.
    pwm : pulse widths (us) that mean command 0 and 1; the log's own PWM_MIN and PWM_MAX if not
        given.

    Returns
    -------
    frame, warnings : contract columns on the attitude's time base, t = 0 at the log's start; what
        the log lacks.

    Raises
    ------
    GesError When the file is no ULog, is cut before its data, has no attitude, or has pulse widths
    of unknown range.
    """
    path = Path(path)
    raw, whole = _open(path)
    log = _Log(raw)
    if not log.has("vehicle_attitude", "q[0]"):
        reason = "it is cut short before them" if not whole else "they were not logged; use a logging profile with attitude"
        raise GesError(f"{path.name} holds no vehicle_attitude samples: {reason}")
    grid = np.unique(log.seconds("vehicle_attitude"))
    try:
        columns = {"t_s": grid, **_attitude(log, grid), **_inertial(log, grid), **_motion(log, grid),
                   **_commands(log, grid, n_rotors, pwm), **_electrics(log, grid, n_rotors)}
    except GesError as error:
        raise GesError(f"{path.name}: {error}") from None
    return pd.DataFrame(columns), _notices(path.name, columns, whole, n_rotors)
