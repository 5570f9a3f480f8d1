"""Gate before any physics: flying samples, delays between streams, and what a recording cannot speak about."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d

from ..errors import GesError
from .align import STREAMS, Prepared, airborne, gaps, grid_step_s, lift, regrid
from .model import Model
from .residual import turn_rates

LATEST_S, EARLIEST_S = 0.6, -0.04
LEAST_CORRELATION = 0.3
LEAST_GAIN = 0.02  # of the variance
SURE = 4.0
POSE = ("position", "velocity", "attitude")
RATE_SMOOTHING_S = 0.03
LEAST_DELAY_SD_S, LEAST_DELAY_S = 0.001, 0.006
LEAST_GYRO_SD_RAD_S, LEAST_GYRO_RAD_S = 0.002, 0.01


@dataclasses.dataclass(frozen=True)
class Delay:
    """How late one stream is against the motion: seconds, sd over flights, correlation at the peak."""

    stream: str
    delay_s: float
    sd_s: float
    correlation: float


@dataclasses.dataclass(frozen=True)
class Gate:
    """Prepared flights (None where a recording is of no use), delays, and sentences for the report."""

    flights: tuple[Prepared | None, ...]
    delays: tuple[Delay, ...]
    warnings: tuple[str, ...]
    pose: Delay | None = None
    gyro: tuple[np.ndarray, np.ndarray] | None = None

    def usable(self) -> list[int]:
        """Indices of the flights that can be used."""
        return [i for i, f in enumerate(self.flights) if f is not None]


def prepare(frame: pd.DataFrame, model: Model, number: int = 0) -> Prepared:
    """One recording on a grid, flying samples found, seconds left out counted by reason."""
    flight = with_thrust_direction(regrid(frame, grid_step_s(frame), number), frame)
    ratio = lift(flight, model.number("thrust_coefficient_N_s2"), model.number("max_rotor_speed_rad_s"), model.weight_N)
    gap = gaps(frame, flight.t_s)
    up = airborne(flight, ratio)
    left = {"on_ground": float((~up & ~gap).sum() * flight.dt_s), "gaps": float(gap.sum() * flight.dt_s)}
    return flight.replaced(flying=up & ~gap, left_out={k: v for k, v in left.items() if v > 0})


def with_thrust_direction(flight: Prepared, frame: pd.DataFrame) -> Prepared:
    """Where no attitude was logged: the body axis along thrust from the acceleration, and the yaw that was logged (or 0).

    Good for slow flight: drag counts as tilt, so horizontal forces say nothing then; ``derived`` remembers it.
    """
    if flight.has("attitude") or not flight.has("velocity"):
        return flight
    step = flight.dt_s
    smooth = gaussian_filter1d(flight.stack("velocity"), 0.1 / step, axis=0)
    up = np.gradient(smooth, step, axis=0) + np.array([0.0, 0.0, 9.80665])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    yaw = np.zeros(len(flight.t_s))
    if "yaw_rad" in frame:
        yaw = np.interp(flight.t_s, frame["t_s"], np.unwrap(frame["yaw_rad"].to_numpy(dtype=float)))
    tilt = np.column_stack([1.0 + up[:, 2], -up[:, 1], up[:, 0], np.zeros(len(up))])
    tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)
    c, s = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    w, x, y, _ = tilt.T
    q = np.column_stack([w * c, x * c + y * s, y * c - x * s, w * s])
    columns = {**flight.columns, **dict(zip(("q_w", "q_x", "q_y", "q_z"), q.T, strict=True))}
    return flight.replaced(columns=columns, derived=frozenset({"attitude"}), update_s={**flight.update_s, "attitude": 0.2})


def _high_pass(x: np.ndarray, step_s: float) -> np.ndarray:
    return x - gaussian_filter1d(x, 1.5 / step_s)


def _correlations(flight: Prepared, model: Model, lags_s: np.ndarray) -> np.ndarray | None:
    """Sums for the correlation of thrust with vertical acceleration at every lag: (3, lags)."""
    ratio = lift(flight, model.number("thrust_coefficient_N_s2"), model.number("max_rotor_speed_rad_s"), model.weight_N)
    if ratio is None or "v_z_m_s" not in flight.columns or flight.flying.sum() * flight.dt_s < 5.0:
        return None
    step, inside = flight.dt_s, flight.flying
    a = _high_pass(gaussian_filter1d(flight.columns["v_z_m_s"], 0.15 / step, order=1) / step, step)
    b = _high_pass(ratio, step)
    out = []
    for lag in lags_s:
        shifted = np.interp(flight.t_s + lag, flight.t_s, b)[inside]
        out.append((a[inside] @ shifted, shifted @ shifted, a[inside] @ a[inside]))
    return np.array(out).T


def _peak(sums: np.ndarray, lags_s: np.ndarray) -> tuple[float, float]:
    """Lag and correlation at the peak, by a parabola through the three highest points."""
    r = sums[0] / np.sqrt(np.maximum(sums[1] * sums[2], 1e-30))
    i = int(np.clip(np.argmax(r), 1, len(r) - 2))
    below, top, above = r[i - 1 : i + 2]
    bend = below - 2.0 * top + above
    shift = 0.5 * (below - above) / bend if bend < 0 else 0.0
    return float(lags_s[i] + shift * (lags_s[1] - lags_s[0])), float(r[i])


def drive_delay(flights: Sequence[Prepared], model: Model) -> Delay | None:
    """How late the rotor speeds are logged against the motion, by direct correlation of thrust and vertical acceleration.

    Commands are left alone: their delay is physics (motor lag, transport delay).
    """
    lags = np.arange(EARLIEST_S, LATEST_S + 1e-9, 0.02)
    told = [s for f in flights if f.has("rotor_speed") for s in [_correlations(f, model, lags)] if s is not None]
    if not told:
        return None
    delay, top = _peak(np.sum(told, axis=0), lags)
    unmoved = np.sum(told, axis=0)[:, np.argmin(np.abs(lags))]
    if top < LEAST_CORRELATION or top**2 - unmoved[0] * abs(unmoved[0]) / (unmoved[1] * unmoved[2]) < LEAST_GAIN:
        return None
    each = [_peak(s, lags)[0] for s in told]
    sd = float(np.std(each, ddof=1) / np.sqrt(len(each))) if len(each) > 1 else float(lags[1] - lags[0])
    return Delay("rotor_speed", delay, max(sd, 0.005), top)


def _both_rates(flight: Prepared) -> tuple[np.ndarray, np.ndarray] | None:
    """Smoothed body rates by gyro and by attitude."""
    if "attitude" in flight.derived or not (flight.has("gyro") and flight.has("attitude")):
        return None
    width = max(RATE_SMOOTHING_S, 1.5 * max(flight.update_s["attitude"], flight.update_s["gyro"])) / flight.dt_s
    q = flight.stack("attitude")
    turning = turn_rates(q, np.gradient(q, flight.dt_s, axis=0))
    return tuple(gaussian_filter1d(r, width, axis=0) for r in (flight.stack("gyro"), turning))


def pose_delay(flights: Sequence[Prepared]) -> Delay | None:
    """How late position, velocity and attitude are against the gyro, by direct correlation of the two body rates."""
    lags = np.arange(-0.15, 0.15 + 1e-9, 0.005)
    told = []
    for flight, pair in ((f, p) for f in flights if (p := _both_rates(f)) is not None):
        inside, sums = flight.flying, np.zeros((3, len(lags)))
        for a, b in zip(pair[0].T, pair[1].T, strict=True):
            a, b = _high_pass(a, flight.dt_s), _high_pass(b, flight.dt_s)
            late = np.stack([np.interp(flight.t_s + lag, flight.t_s, b)[inside] for lag in lags])
            sums += np.stack([late @ a[inside], (late**2).sum(axis=1), np.full(len(lags), a[inside] @ a[inside])])
        if inside.sum() * flight.dt_s > 5.0:
            told.append(sums)
    if not told:
        return None
    delay, top = _peak(np.sum(told, axis=0), lags)
    each = [_peak(s, lags)[0] for s in told]
    sd = float(np.std(each, ddof=1) / np.sqrt(len(each))) if len(each) > 1 else 0.005
    return Delay("attitude", delay, max(sd, LEAST_DELAY_SD_S), top) if top > LEAST_CORRELATION else None


def gyro_bias(flights: Sequence[Prepared]) -> tuple[np.ndarray, np.ndarray] | None:
    """Gyro less the rates that the attitude implies: mean (3,) and its sd over flights, rad/s."""
    means = [(p[0] - p[1])[f.flying].mean(axis=0) for f in flights if (p := _both_rates(f)) is not None and f.flying.any()]
    if len(means) < 2:
        return None
    sd = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return np.mean(means, axis=0), np.hypot(sd, LEAST_GYRO_SD_RAD_S)


def without_bias(flight: Prepared, bias: np.ndarray) -> Prepared:
    """The flight with a constant taken out of its gyro."""
    if not flight.has("gyro"):
        return flight
    mended = {n: flight.columns[n] - b for n, b in zip(STREAMS["gyro"], bias, strict=True)}
    return flight.replaced(columns={**flight.columns, **mended})


def shifted(flight: Prepared, stream: str, delay_s: float) -> Prepared:
    """The flight with one stream moved back by its delay."""
    streams = POSE if stream == "attitude" else (stream,)
    names = [n for s in streams for n in STREAMS[s] if n in flight.columns]
    moved = {n: np.interp(flight.t_s + delay_s, flight.t_s, flight.columns[n]) for n in names}
    return flight.replaced(columns={**flight.columns, **moved}, lateness_s={**flight.lateness_s, stream: delay_s})


def at_flown_voltage(model: Model, flights: Sequence[Prepared | None]) -> Model:
    """The model with the median battery voltage in the air as its nominal one, unless the vehicle file models sag already."""
    volts = [f.columns["battery_V"][f.flying] for f in flights if f is not None and f.has("battery")]
    if not volts or "battery_sag" in model.effects:
        return model
    return model.with_number("battery_nominal_V", float(np.median(np.concatenate(volts))))


def _problem(flight: Prepared, number: int) -> str | None:
    if not (flight.has("rotor_speed") or flight.has("command")):
        return f"flight {number} has neither rotor speeds nor commands: its forces cannot be modelled; it was left out"
    if flight.flying.sum() * flight.dt_s < 3.0:
        return f"flight {number} has less than 3 s in the air; it was left out"
    return None


def pass_gate(frames: Sequence[pd.DataFrame], model: Model) -> Gate:
    """Prepare all recordings.

    Raises
    ------
    GesError
        When no recording is left that the model can be held against.
    """
    flights: list[Prepared | None] = [prepare(frame, model, i) for i, frame in enumerate(frames)]
    warnings = []
    for i, flight in enumerate(flights):
        problem = _problem(flight, i)
        if problem:
            warnings.append(problem)
            flights[i] = None
    usable = [f for f in flights if f is not None]
    if not usable:
        raise GesError(f"no usable flight among {len(frames)}: {warnings[0]}; log rotor speeds or motor commands in the air")
    pose, gyro = pose_delay(usable), None
    if pose and abs(pose.delay_s) > max(SURE * pose.sd_s, LEAST_DELAY_S):
        flights = [f and shifted(f, pose.stream, pose.delay_s) for f in flights]
    else:
        pose = None
    usable = [f for f in flights if f is not None]
    found = gyro_bias(usable)
    if found and (np.abs(found[0]) > np.maximum(SURE * found[1], LEAST_GYRO_RAD_S)).any():
        gyro = found
        flights = [f and without_bias(f, gyro[0]) for f in flights]
    usable = [f for f in flights if f is not None]
    delay = drive_delay(usable, model)
    if delay and delay.delay_s > SURE * delay.sd_s:
        flights = [f and shifted(f, delay.stream, delay.delay_s) for f in flights]
    return Gate(tuple(flights), (delay,) if delay else (), tuple(warnings), pose, gyro)
