"""Checks before any physics: usable flights and samples, and delays and offsets between streams."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter

from ges.conventions import BODY_RATE, GRAVITY_M_S2, MAD_TO_SD, QUATERNION, SPECIFIC_FORCE
from ges.diagnose.prepare.align import (
    Prepared,
    airborne,
    gaps,
    grid_step_s,
    lifting,
    regrid,
    resting_m,
    thrust_over_usual,
    thrust_over_weight,
)
from ges.diagnose.prepare.delays import (
    Delay,
    clock_drift,
    drive_delay,
    estimate_command_hold,
    gyro_bias,
    pose_delay,
    without_delay,
    without_gyro_bias,
)
from ges.diagnose.prepare.steady import with_steady_position, with_steady_voltage
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.errors import GesError
from ges.simulator import effects as effect_table
from ges.threads import each
from ges.vehicle.file import Estimate


@dataclasses.dataclass(frozen=True)
class Gate:
    """Recordings after all checks.

    Attributes
    ----------
    flights : prepared flights by index of the recording; those that cannot be used are left out.
    delays : clear delays of streams. That of the pose is removed, that of the drive where it is
        certain.
    warnings : sentences for the report.
    pose : clear delay of the pose, which was removed.
    gyro : clear offset of the gyro, which was removed, and its sd; (3,) rad/s each.
    """

    flights: Mapping[int, Prepared]
    delays: tuple[Delay, ...]
    warnings: tuple[str, ...]
    pose: Delay | None = None
    gyro: tuple[np.ndarray, np.ndarray] | None = None


@dataclasses.dataclass(frozen=True)
class _Gridded:
    """One recording on a grid.

    Attributes
    ----------
    flight : on the grid.
    working : (n,) thrust over its usual value.
    height_m : (n,) height over the ground, where known.
    resting_m : height at rest.
    """

    flight: Prepared
    working: np.ndarray
    height_m: np.ndarray | None
    resting_m: float


def prepare(frame: pd.DataFrame, model: Model, index: int = 0) -> Prepared:
    """Put one recording on a grid and find the samples that fly.

    Parameters
    ----------
    frame : table with contract columns.
    model : of the vehicle.
    index : of the flight, for messages.

    Returns
    -------
    The flight, with the reason for every sample that is left out.
    """
    return _in_the_air(_on_grid(frame, model, index), frame, model)


def _on_grid(frame: pd.DataFrame, model: Model, index: int) -> _Gridded:
    flight = with_thrust_direction(regrid(frame, grid_step_s(frame), index), frame)
    working = thrust_over_usual(flight, thrust_over_weight(flight, model))
    height = _height_over_ground_m(flight, model)
    return _Gridded(flight, working, height, resting_m(flight, working, height))


def _in_the_air(
    gridded: _Gridded, frame: pd.DataFrame, model: Model, others_rest_m: float = np.inf
) -> Prepared:
    """Return the flight with its flying samples.

    ``others_rest_m`` is where other flights rest, for one that begins and ends in the air.
    """
    flight, own = gridded.flight, np.isfinite(gridded.resting_m)
    rest_m = gridded.resting_m if own else others_rest_m
    # where no flight is seen at rest, every height counts as above it
    above = (
        gridded.height_m - (rest_m if np.isfinite(rest_m) else -np.inf)
        if gridded.height_m is not None
        else None
    )
    # one reason a sample, so that the seconds left out add up
    gap, up = gaps(frame, flight.t_s), airborne(flight, gridded.working, above)
    cut = clipped_samples(frame, flight.t_s) & up & ~gap
    hit = impact_samples(gridded, model) & up & ~gap & ~cut
    left_out = {"on_ground": ~up & ~gap, "gaps": gap, "clipping": cut, "contact": hit}
    flying = up & ~gap & ~cut & ~hit
    return flight.replace(flying=flying, lifting=lifting(flight, flying) & ~gap, excluded=left_out)


def _height_over_ground_m(flight: Prepared, model: Model) -> np.ndarray | None:
    """Return the height over the logged ground, else that of the vehicle file, (n,).

    None without a logged height.
    """
    if "p_z_m" not in flight.columns:
        return None
    x, y = (flight.columns.get(name, np.zeros(len(flight.t_s))) for name in ("p_x_m", "p_y_m"))
    ground = (
        flight.columns["ground_z_m"]
        if "ground_z_m" in flight.columns
        else model.terrain.at(x, y).height_m
    )
    return flight.columns["p_z_m"] - ground


def impact_samples(gridded: _Gridded, model: Model) -> np.ndarray:
    """Find contacts with the ground: short forces close to it that no drive and no noise makes.

    Parameters
    ----------
    gridded : the recording.
    model : of the vehicle.

    Returns
    -------
    (n,) True around every contact.
    """
    flight = gridded.flight
    if gridded.height_m is None or "acc_z_m_s2" not in flight.columns:
        return np.zeros(len(flight.t_s), bool)
    p, force_m_s2 = settings.prepare, flight.columns["acc_z_m_s2"]
    # the rest of the thrust beyond what carries is the least that no drive makes so shortly
    least_m_s2 = p.descent_share * GRAVITY_M_S2
    size = 2 * int(0.5 * p.pause_s / flight.dt_s) + 1
    # a running median follows steps and ramps of thrust and passes by what is short: a blow
    impact = np.abs(force_m_s2 - median_filter(force_m_s2, size=size, mode="nearest"))
    # noise from the median: an rms would be swollen by the blows themselves
    usual = MAD_TO_SD * np.median(impact)
    close = gridded.height_m < p.near_ground_m
    hit = (impact > least_m_s2 + settings.statistics.certain_sds * usual) & close
    around = max(1, int(p.pause_s / flight.dt_s))
    return binary_dilation(hit, iterations=around) if hit.any() else hit


def clipped_samples(frame: pd.DataFrame, grid_s: np.ndarray) -> np.ndarray:
    """Find where a gyro or accelerometer stands at the limit of its range.

    Parameters
    ----------
    frame : table with contract columns.
    grid_s : (n,) times of the grid.

    Returns
    -------
    (n,) True there and shortly around.
    """
    t_s, at_limit = frame["t_s"].to_numpy(dtype=float), np.zeros(len(grid_s), bool)
    margin_s = settings.design.half_window_s
    for name in (n for n in (*BODY_RATE, *SPECIFIC_FORCE) if n in frame):
        for first, last in _at_limit(t_s, frame[name].to_numpy(dtype=float)):
            at_limit |= (grid_s >= t_s[first] - margin_s) & (grid_s <= t_s[last] + margin_s)
    return at_limit


def _at_limit(t_s: np.ndarray, values: np.ndarray) -> list[tuple[int, int]]:
    """Return first and last rows of the times for which a reading stands at its extreme."""
    finite = np.flatnonzero(np.isfinite(values))
    starts = finite[np.r_[True, np.diff(values[finite]) != 0]] if len(finite) else finite
    if len(starts) < 3:
        return []
    ends = np.r_[starts[1:] - 1, finite[-1]]
    usual = np.median(np.diff(t_s[starts]))
    middle = np.median(values[finite])
    sd = np.std(values[finite])
    # a slow sensor holds too, and any signal has a largest value: all three marks make a limit
    long = t_s[ends] - t_s[starts] > settings.design.window_updates * usual
    extreme = np.isin(values[starts], (values[finite].min(), values[finite].max()))
    far = np.abs(values[starts] - middle) > settings.statistics.clear_sds * sd
    return list(zip(starts[long & extreme & far], ends[long & extreme & far], strict=True))


def with_thrust_direction(flight: Prepared, frame: pd.DataFrame) -> Prepared:
    """Derive an attitude from the acceleration where none was logged.

    Parameters
    ----------
    flight : on the grid.
    frame : the recording, for a logged yaw; without one it is zero.

    Returns
    -------
    The flight with ``attitude`` among ``derived``; unchanged where it was logged, or velocity was
    not.

    Notes
    -----
    The body's up is that of acceleration less gravity. Drag then counts as tilt, so horizontal
    forces carry no information.
    """
    if flight.has("attitude") or not flight.has("velocity"):
        return flight
    step, smoothing_s = flight.dt_s, settings.design.half_window_s
    # thrust over mass is acceleration less gravity where drag is small, along the body's up
    smooth = gaussian_filter1d(flight.stack("velocity"), smoothing_s / step, axis=0)
    up = np.gradient(smooth, step, axis=0) + np.array([0.0, 0.0, GRAVITY_M_S2])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    yaw = np.zeros(len(flight.t_s))
    if "yaw_rad" in frame:
        yaw = np.interp(flight.t_s, frame["t_s"], np.unwrap(frame["yaw_rad"].to_numpy(dtype=float)))
    # shortest rotation from z to up, (1 + z.up, z x up); then the yaw, about the thrust axis
    tilt = np.column_stack([1.0 + up[:, 2], -up[:, 1], up[:, 0], np.zeros(len(up))])
    tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)
    c, s = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    w, x, y, _ = tilt.T
    q = np.column_stack([w * c, x * c + y * s, y * c - x * s, w * s])
    columns = {**flight.columns, **dict(zip(QUATERNION, q.T, strict=True))}
    return flight.replace(
        columns=columns,
        derived=frozenset({"attitude"}),
        # a smoothed tilt brings no news within its smoothing
        update_s={**flight.update_s, "attitude": 2.0 * smoothing_s},
    )


def with_flown_voltage(model: Model, flights: Iterable[Prepared]) -> Model:
    """Return the model with the median battery voltage in the air as the nominal one.

    Parameters
    ----------
    model : of the vehicle; unchanged if its effects read the voltage already.
    flights : prepared recordings.
    """
    volts = [f.columns["battery_V"][f.flying] for f in flights if f.has("battery")]
    if not volts or any(effect_table.get(n).reads_voltage for n in model.effects):
        return model
    return model.with_number("battery_nominal_V", float(np.median(np.concatenate(volts))))


def with_stated_voltage(
    effects: Mapping[str, Mapping[str, Estimate]], model: Model
) -> dict[str, dict[str, Estimate]]:
    """Return effects of a vehicle file that state the voltage from which they count.

    A sensitivity that was fitted about the median of some flights means nothing about another
    voltage, which other flights have.

    Parameters
    ----------
    effects : parameters by name, by effect.
    model : of :func:`with_flown_voltage`.
    """
    nominal = {"nominal_V": Estimate(value=model.number("battery_nominal_V"))}
    reading = {n for n in effects if effect_table.get(n).reads_voltage}
    return {
        name: {**(nominal if name in reading else {}), **values} for name, values in effects.items()
    }


def _unusable_because(flight: Prepared) -> str | None:
    """Return why a flight cannot be used; None where it can."""
    if not (flight.has("rotor_speed") or flight.has("command")):
        return "has neither rotor speeds nor commands: its forces cannot be modelled"
    drive = "rotor_speed" if flight.has("rotor_speed") else "command"
    if not flight.stack(drive).any():
        return (
            f"never leaves the ground: its {drive.replace('_', ' ')}s are zero throughout (not"
            " armed, or other outputs drive it)"
        )
    if flight.flying.sum() * flight.dt_s < settings.prepare.flight_shortest_s:
        return f"has less than {settings.prepare.flight_shortest_s:g} s in the air"
    return None


def _remarks(flight: Prepared) -> list[str]:
    """Return what a reader should know about a flight that can be used."""
    remarks, drift = [], clock_drift(flight)
    if "clipping" in flight.left_out:
        remarks.append(
            f"reaches the limit of its gyro or accelerometer; {flight.left_out['clipping']:.2g} s"
            " around that are left out"
        )
    if abs(drift) > max(
        (flight.update_s[s] for s in ("gyro", "attitude") if flight.has(s)), default=0.0
    ):
        remarks.append(
            f"has two clocks: its attitude gets {1e3 * drift:.0f} ms later against its gyro along"
            " the flight; bring the logs to one clock before they are imported"
        )
    return remarks


def pass_gate(
    frames: Sequence[pd.DataFrame], model: Model, names: Sequence[str] | None = None
) -> Gate:
    """Prepare all recordings.

    Parameters
    ----------
    frames : tables with contract columns.
    model : of the vehicle.
    names : of the flights in messages; their numbers where not given.

    Raises
    ------
    GesError
        When no recording can be compared with the model.
    """
    names = names or [f"flight {i}" for i in range(len(frames))]
    gridded = each(lambda i: _on_grid(frames[i], model, i), range(len(frames)))
    rest_m = min(g.resting_m for g in gridded)
    prepared: list[Prepared] = each(
        lambda g, frame: _in_the_air(g, frame, model, rest_m), gridded, frames
    )
    problems = [_unusable_because(f) for f in prepared]
    usable = [i for i, problem in enumerate(problems) if not problem]
    if all(problems):
        name, problem = min(zip(names, problems, strict=True))
        raise GesError(
            f"no usable flight among {len(frames)}: {name} {problem}; log a flight with rotor"
            " speeds or motor commands (PX4: esc_status or actuator_motors; Crazyflie: motor.m1"
            " ...)"
        )
    warnings = [
        f"{name} {problem}; it was left out"
        for name, problem in zip(names, problems, strict=True)
        if problem
    ]
    flights = [prepared[i] for i in usable]
    noticed = zip(usable, each(_remarks, flights), strict=True)
    warnings += [f"{names[i]} {remark}" for i, remarks in noticed for remark in remarks]
    pose, flights = _without_pose_delay(flights)
    gyro, flights = _without_clear_gyro_bias(flights)
    hold = estimate_command_hold(flights)
    flights = [f.replace(command_hold=hold) for f in flights]
    # a delay that is not certain is left alone: a shift by noise adds an error
    delay = drive_delay(flights, model)
    if delay and delay.delay_s > settings.statistics.certain_sds * delay.sd_s:
        flights = [without_delay(f, delay.stream, delay.delay_s) for f in flights]
    # after the clocks: a drive that is late would predict the voltage late
    flights = [with_steady_voltage(with_steady_position(f)) for f in flights]
    delays = tuple(d for d in (pose, delay) if d)
    by_index = dict(zip(usable, flights, strict=True))
    return Gate(by_index, delays, tuple(sorted(warnings)), pose, gyro)


def _without_pose_delay(flights: list[Prepared]) -> tuple[Delay | None, list[Prepared]]:
    """Return the clear delay of the pose, and the flights without it."""
    pose = pose_delay(flights)
    # noise draws the peak of a correlation between two readings
    least_s = max(
        (f.update_s[s] for f in flights for s in ("gyro", "attitude") if f.has(s)), default=0.0
    )
    if not pose or abs(pose.delay_s) <= max(settings.statistics.certain_sds * pose.sd_s, least_s):
        return None, flights
    return pose, [without_delay(f, pose.stream, pose.delay_s) for f in flights]


def _without_clear_gyro_bias(
    flights: list[Prepared],
) -> tuple[tuple[np.ndarray, np.ndarray] | None, list[Prepared]]:
    """Return the clear gyro offset with its sd, and the flights without it."""
    bias = gyro_bias(flights)
    if not bias or not (np.abs(bias[0]) > settings.statistics.certain_sds * bias[1]).any():
        return None, flights
    return bias, [without_gyro_bias(f, bias[0]) for f in flights]
