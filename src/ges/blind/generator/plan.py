"""Manoeuvres: what the controller is asked for, as smooth references at the control rate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ges.blind.generator.ground import height_at

CONTROL_DT_S = 0.004
REACH_M = 6.5


@dataclass(frozen=True)
class Plan:
    """References of one flight at the control rate.

    Attributes
    ----------
    reference : (11, n) position, velocity and acceleration (world frame), yaw, yaw rate; m, s, rad.
    excite : (4, n) angular acceleration about the body axes (rad/s^2) and heave (m/s^2).
    ground_s : time that the vehicle waits on the ground first.
    """

    reference: np.ndarray
    excite: np.ndarray
    ground_s: float


@dataclass(frozen=True)
class Room:
    """What a manoeuvre must know of the vehicle and the place.

    Attributes
    ----------
    seconds : length of the flight.
    radius_m : rotor radius.
    low_m : least height of the centre above the ground.
    pace : factor on speeds.
    smooth_s : time over which references are averaged, three times.
    grid : heights of the terrain, z[y, x] (m).
    """

    seconds: float
    radius_m: float
    low_m: float
    pace: float
    smooth_s: float
    grid: np.ndarray

    @property
    def top_m(self) -> float:
        """Height of the highest point of the terrain."""
        return float(self.grid.max())


Manoeuvre = Callable[[Room, np.random.Generator], np.ndarray]


def _clock(room: Room) -> np.ndarray:
    return np.arange(int(round(room.seconds / CONTROL_DT_S))) * CONTROL_DT_S


def _hold(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Spread values over the flight as equal holds."""
    index = np.minimum((t / t[-1] * len(values)).astype(int), len(values) - 1)
    return np.asarray(values, dtype=float)[index]


def _track(
    t: np.ndarray,
    x: np.ndarray | float,
    y: np.ndarray | float,
    z: np.ndarray | float,
    yaw: np.ndarray | float,
) -> np.ndarray:
    return np.stack([np.broadcast_to(v, t.shape).astype(float) for v in (x, y, z, yaw)])


def _under(room: Room, x: np.ndarray | float, y: np.ndarray | float) -> np.ndarray:
    """Return the ground under a track, smoothed."""
    x, y = np.broadcast_arrays(x, y)
    return _smooth(height_at(room.grid[None], np.zeros(len(x), np.intp), x, y), 0.5)


def _staircase(room: Room, rng: np.random.Generator) -> np.ndarray:
    """Return heights from six radii down to the lowest and up again.

    The vehicle drifts slowly and turns between holds.
    """
    t = _clock(room)
    steps = np.geomspace(6.0 * room.radius_m + room.low_m, room.low_m, 5)
    drift, aside = 0.6 * np.sin(2.0 * np.pi * t / rng.uniform(9.0, 14.0)), rng.uniform(-0.5, 0.5)
    z = _hold(t, np.concatenate([steps, steps[-2::-1]])) + _under(room, drift, aside)
    return _track(t, drift, aside, z, _hold(t, np.cumsum(rng.uniform(-1.2, 1.2, 4))))


def _runs(room: Room, rng: np.random.Generator) -> np.ndarray:
    """Return out-and-back runs of growing speed along one heading, high above the ground.

    The nose turns between them.
    """
    t = _clock(room)
    heading = rng.uniform(0.0, 2.0 * np.pi)
    distance = _out_and_back(t, np.array([1.2, -1.2, 2.4, -2.4, 4.0, -4.0]) * room.pace)
    high = room.top_m + 8.0 * room.radius_m + rng.uniform(0.8, 1.5)
    return _track(
        t,
        distance * np.cos(heading),
        distance * np.sin(heading),
        high,
        _hold(t, rng.uniform(-3, 3, 3)),
    )


def _climbs(room: Room, rng: np.random.Generator) -> np.ndarray:
    """Climbs and descents at 0.5 to 1.8 m/s, with the yaw going round once."""
    t = _clock(room)
    rates = np.array([0.5, -0.5, 1.0, -1.0, 1.8, -1.8, 1.0, -1.0]) * min(room.pace, 1.0)
    z = np.cumsum(_hold(t, rates)) * CONTROL_DT_S
    # the lowest point of the climbs is clear of all terrain
    z += room.top_m + 5.0 * room.radius_m + room.low_m + 0.3 - z.min()
    return _track(
        t,
        0.4 * np.sin(0.5 * t),
        0.4 * np.cos(0.4 * t),
        z,
        2.0 * np.pi * t / t[-1] * rng.choice([-1, 1]),
    )


def _low_runs(room: Room, rng: np.random.Generator) -> np.ndarray:
    """Runs of growing speed, 0.5 to 2.6 m/s, close to the ground, following it."""
    t = _clock(room)
    heading = rng.uniform(-0.5, 0.5) + rng.choice([0.0, np.pi])
    distance = _out_and_back(t, np.array([0.5, -0.5, 1.2, -1.2, 2.6, -2.6]) * room.pace)
    x, y = distance * np.cos(heading), distance * np.sin(heading)
    ground = _under(room, x, y)
    clear = _hold(t, rng.permutation([1.0, 1.6, 1.0, 2.4])) * room.low_m
    return _track(t, x, y, ground + clear, _hold(t, rng.uniform(-1.5, 1.5, 3)))


def _out_and_back(t: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Legs of equal length at the given speeds, within reach, as a coordinate along a line."""
    weights = 1.0 / np.abs(speeds)
    edges = np.cumsum(weights / weights.sum()) * t[-1]
    speed = speeds[np.minimum(np.searchsorted(edges, t), len(speeds) - 1)]
    distance = np.cumsum(speed) * CONTROL_DT_S
    return np.clip(distance - distance.mean(), -REACH_M, REACH_M)


def _mixed(room: Room, rng: np.random.Generator) -> np.ndarray:
    """Circles, a hover turned once around, and quick steps in every axis."""
    t = _clock(room)
    third = t[-1] / 3.0
    phase = np.where(t < third, 2.0 * np.pi * 2.0 * t / third, 0.0)
    x = np.where(t < third, 0.8 * np.sin(phase), 0.0)
    y = np.where(t < third, 0.8 * (1.0 - np.cos(phase)), 0.0)
    late = np.clip(t - 2.0 * third, 0.0, None)
    x, y = x + 0.4 * _square(late, 3.1), y + 0.4 * _square(late, 4.3)
    z = room.top_m + 5.0 * room.radius_m + 0.6 + 0.25 * _square(late, 2.3)
    return _track(
        t, x, y, z, 2.0 * np.pi * np.clip((t - third) / third, 0.0, 1.0) + 0.8 * _square(late, 3.7)
    )


def _square(t: np.ndarray, period: float) -> np.ndarray:
    return np.where(t > 0.0, (np.floor(2.0 * t / period) % 2.0), 0.0)


def _still(height: Callable[[Room], float]) -> Manoeuvre:
    def hover(room: Room, rng: np.random.Generator) -> np.ndarray:
        t = _clock(room)
        return _track(t, 0.0, 0.0, _under(room, 0.0 * t, 0.0) + height(room), 0.3)

    return hover


hover_low = _still(lambda room: 1.3 * room.low_m)
hover_high = _still(lambda room: 8.0 * room.radius_m + 0.8)


def _one_speed(room: Room, rng: np.random.Generator) -> np.ndarray:
    """One speed out and back on one line at one height and heading."""
    t = _clock(room)
    leg = 6.0
    distance = 2.4 * room.pace * (np.abs((t % (2.0 * leg)) - leg) - leg / 2.0)
    return _track(
        t, np.clip(distance, -REACH_M, REACH_M), 0.0, room.top_m + 8.0 * room.radius_m + 1.0, 0.0
    )


MENU: dict[str, Manoeuvre] = {
    "staircase": _staircase,
    "runs": _runs,
    "climbs": _climbs,
    "low_runs": _low_runs,
    "mixed": _mixed,
    "hover_low": hover_low,
    "hover_high": hover_high,
    "one_speed": _one_speed,
}
FULL_MENU = ("staircase", "runs", "climbs", "low_runs", "mixed")


def make_plan(
    name: str, room: Room, excite: bool, on_ground: bool, rng: np.random.Generator
) -> Plan:
    """Return the smooth references of a manoeuvre.

    Parameters
    ----------
    name : key of :data:`MENU`.
    room : vehicle and place.
    excite : whether a multisine excites the loops.
    on_ground : whether the flight starts on the ground, for one to two seconds.
    rng : stream of all draws.
    """
    track = MENU[name](room, rng)
    ground_s = float(rng.uniform(1.0, 2.0)) if on_ground else 0.0
    if on_ground:
        track = _after_ground(track, ground_s, room)
    # smooth before differentiating: the controller is fed velocity and acceleration forward
    smooth = np.stack(
        [_smooth(row, (0.7 if k == 2 else 1.0) * room.smooth_s) for k, row in enumerate(track)]
    )
    rate = np.gradient(smooth, CONTROL_DT_S, axis=1)
    acceleration = np.gradient(rate[:3], CONTROL_DT_S, axis=1)
    reference = np.concatenate([smooth[:3], rate[:3], acceleration, smooth[3:4], rate[3:4]])
    return Plan(reference, _multisine(track.shape[1], rng) * float(excite), ground_s)


def _after_ground(track: np.ndarray, ground_s: float, room: Room) -> np.ndarray:
    """Stand, then climb to the manoeuvre's start; the manoeuvre loses its last seconds."""
    wait = int(round((ground_s + 1.0) / CONTROL_DT_S))
    out = np.concatenate([np.repeat(track[:, :1], wait, axis=1), track[:, :-wait]], axis=1)
    start = height_at(room.grid[None], np.zeros(1, np.intp), out[0, :1], out[1, :1])[0]
    out[2, : int(round(ground_s / CONTROL_DT_S))] = start + 0.5 * room.radius_m
    return out


def _smooth(row: np.ndarray, seconds: float) -> np.ndarray:
    """Three passes of a moving mean: finite jerk from steps."""
    from scipy.ndimage import uniform_filter1d

    width = max(int(round(seconds / CONTROL_DT_S)), 1)
    for _ in range(3):
        row = uniform_filter1d(row, width, mode="nearest")
    return row


def _multisine(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return (4, n): Schroeder-free random-phase sums of interleaved tones, 0.4 to 6 Hz."""
    t = np.arange(n) * CONTROL_DT_S
    size = np.array([3.0, 3.0, 1.5, 0.8])
    out = np.zeros((4, n))
    for k in range(24):
        # every fourth tone goes to an axis, so that no two axes share one
        tone = 0.4 + 0.24 * k
        out[k % 4] += np.sin(2.0 * np.pi * tone * t + rng.uniform(0.0, 2.0 * np.pi))
    return size[:, None] * out / np.sqrt(3.0) * np.clip((t - 4.0) / 2.0, 0.0, 1.0)
