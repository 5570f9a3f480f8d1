"""Flights of the worlds that bring no trajectories of their own; each half flies its own families.

A path is a smooth function of a phase that starts and ends at rest, so that a controller is never
asked for a jump. Development flies ladders, eights, helices and dashes; evaluation flies chirps in
height, roses, rounded squares and waypoints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

SPIN_UP_S = 1.5


@dataclass(frozen=True)
class Scale:
    """What a path must respect of a vehicle.

    Attributes
    ----------
    low_m : least height of its centre above the ground.
    radius_m : rotor radius.
    speed_m_s : greatest speed.
    smooth_s : time constant of its response; the path is smoothed over it.
    """

    low_m: float
    radius_m: float
    speed_m_s: float
    smooth_s: float


Path = Callable[[np.ndarray, Scale, np.random.Generator], tuple[np.ndarray, ...]]


def references(
    half: str, seconds: float, step_s: float, scale: Scale, rng: np.random.Generator
) -> list[np.ndarray]:
    """Return one flight of every family of a half.

    Parameters
    ----------
    half : 'development' or 'evaluation'.
    seconds : length of a flight.
    step_s : time from one reference to the next.
    scale : what the paths must respect of the vehicle.
    rng : stream that sizes and headings are drawn from.

    Returns
    -------
    (11, n) a flight: position, velocity and acceleration in the world frame (m, s), yaw (rad) and
    yaw rate (rad/s). It begins and ends at rest.
    """
    n = int(round(seconds / step_s))
    t = np.arange(n) * step_s
    # the phase runs like time, but takes off from rest and comes to rest
    late = seconds - 2.0 * SPIN_UP_S
    phase = t + SPIN_UP_S * np.expm1(-t / SPIN_UP_S)
    phase = np.where(t < late, phase, np.nan)
    last = np.nanmax(phase)
    phase = np.where(np.isnan(phase), last + SPIN_UP_S * -np.expm1(-(t - late) / SPIN_UP_S), phase)
    return [_reference(path(phase, scale, rng), scale, step_s) for path in FAMILIES[half]]


def _reference(track: tuple[np.ndarray, ...], scale: Scale, step_s: float) -> np.ndarray:
    from scipy.ndimage import gaussian_filter1d

    # rounded off by the vehicle's own answer: a jump of the path is none of the reference
    width = scale.smooth_s / step_s
    smooth = np.stack([gaussian_filter1d(row, width, mode="nearest") for row in track])
    rate = np.gradient(smooth, step_s, axis=1)
    acceleration = np.gradient(rate[:3], step_s, axis=1)
    return np.concatenate([smooth[:3], rate[:3], acceleration, smooth[3:], rate[3:]])


def _holds(phase: np.ndarray, values: np.ndarray) -> np.ndarray:
    place = np.minimum((phase / phase[-1] * len(values)).astype(int), len(values) - 1)
    return values[place]


def _ladder(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Holds from six radii above the lowest height down to it and up again, turning between."""
    rungs = scale.low_m + scale.radius_m * np.array([6.0, 3.0, 1.4, 0.5, 0.0, 0.9, 2.2, 5.0])
    drift = 0.4 * np.sin(2.0 * np.pi * phase / rng.uniform(6.0, 9.0))
    turn = _holds(phase, np.cumsum(rng.uniform(-0.8, 0.8, 5)))
    return drift, 0.2 * np.cos(phase), _holds(phase, rungs), turn


def _eight(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A lying eight at growing speed, high, with the nose going round."""
    size = rng.uniform(0.9, 1.4)
    angle = scale.speed_m_s / (2.2 * size) * phase * (0.4 + 0.6 * phase / phase[-1])
    high = scale.low_m + 10.0 * scale.radius_m + 0.8 + 0.2 * np.sin(0.9 * phase)
    return size * np.sin(angle), 0.5 * size * np.sin(2.0 * angle), high, 0.5 * phase


def _helix(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A circle that climbs and sinks, the nose along the path."""
    size, angle = rng.uniform(0.7, 1.1), 0.7 * scale.speed_m_s * phase
    reach = 0.3 * scale.speed_m_s / 1.1
    high = scale.low_m + 6.0 * scale.radius_m + 0.9 + reach * np.sin(1.1 * phase)
    return size * np.cos(angle), size * np.sin(angle), high, angle + 0.5 * np.pi


def _dashes(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Out and back along a line, faster every time, once low and once high."""
    heading, span = rng.uniform(0.0, 2.0 * np.pi), phase[-1]
    speed = scale.speed_m_s * (0.35 + 0.65 * phase / span)
    # the way is the integral of a speed that turns round every 1.5 s
    distance = np.cumsum(speed * np.sign(np.sin(2.0 * np.pi * phase / 3.0))) * np.gradient(phase)
    # centred: dashes that grow do not come back to where they began
    distance -= distance.mean()
    rungs = np.array([0.3, 0.3, 8.0, 8.0]) * scale.radius_m
    high = scale.low_m + _holds(phase, rungs)
    return (
        distance * np.cos(heading),
        distance * np.sin(heading),
        high,
        _holds(phase, np.array([0, 0.7])),
    )


def _chirp(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Height sweeps between the lowest and eight radii above it, ever faster."""
    sweep = 0.15 * phase + 0.5 * 0.35 * phase**2 / phase[-1]
    swing = 0.5 + 0.5 * np.cos(2.0 * np.pi * sweep)
    turn = 0.9 * np.sin(2.0 * np.pi * phase / rng.uniform(4.0, 7.0))
    return (
        0.3 * np.sin(0.4 * phase),
        0.3 * np.sin(0.3 * phase),
        (scale.low_m + 8.0 * scale.radius_m * swing**2),
        turn,
    )


def _rose(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A rose of three petals at steady speed, nose turned by the way."""
    size = rng.uniform(1.1, 1.6)
    angle = 0.6 * scale.speed_m_s / size * phase
    reach = size * np.cos(1.5 * angle)
    high = scale.low_m + 9.0 * scale.radius_m + 1.1
    yaw = rng.uniform(-1.0, 1.0) + 0.35 * phase
    return reach * np.cos(0.5 * angle), reach * np.sin(0.5 * angle), high + 0.0 * phase, yaw


def _square(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A rounded square that tilts in height, at two speeds."""
    speed = scale.speed_m_s * np.where(phase < 0.5 * phase[-1], 0.45, 0.9)
    # way in edges: half-way the speed changes, and the path does not
    way = np.cumsum(speed * np.gradient(phase)) / rng.uniform(1.2, 1.8)
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * 0.7
    at = way % 4.0
    x, y = (np.interp(at, np.arange(5), corner[:, k]) for k in (0, 1))
    high = scale.low_m + 5.0 * scale.radius_m + 0.7 + 0.5 * x
    return x, y, high, _holds(phase, rng.uniform(-1.2, 1.2, 4))


def _waypoints(phase: np.ndarray, scale: Scale, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A spline through random points, low and high, near the fastest speed."""
    from scipy.interpolate import CubicSpline

    reach = 0.35 * scale.speed_m_s
    count = int(phase[-1] / 1.6) + 2
    points = rng.uniform(-reach, reach, (count, 2))
    heights = scale.low_m + scale.radius_m * rng.uniform(0.2, 7.0, count)
    at = np.linspace(0.0, phase[-1], count)
    x, y = CubicSpline(at, points)(phase).T
    # heights by straight pieces: a spline would swing below the lowest
    high = np.interp(phase, at, heights)
    return x, y, high, np.interp(phase, at, np.cumsum(rng.uniform(-0.6, 0.6, count)))


FAMILIES: dict[str, tuple[Path, ...]] = {
    "development": (_ladder, _eight, _helix, _dashes),
    "evaluation": (_chirp, _rose, _square, _waypoints),
}
