"""How late one stream is against another, how that drifts, and gyro offsets: by direct comparison,
before any physics.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import stdtrit

from ges.diagnose.prepare.align import Held, Prepared, lift, maybe_held
from ges.diagnose.prepare.kinematics import turn_rates
from ges.diagnose.prepare.steady import with_past
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.threads import each

POSE = ("position", "velocity", "attitude")


@dataclasses.dataclass(frozen=True)
class Delay:
    """How late one stream is against the motion: seconds, sd over flights, correlation at
    the peak.
    """

    stream: str
    delay_s: float
    sd_s: float
    correlation: float


def _drive_lags_s() -> np.ndarray:
    """Delays of the rotor speeds that are tried, s: two steps of negative ones show a peak at 0."""
    longest_s = settings.prepare.pause_s
    step_s = longest_s / settings.prepare.lag_steps
    return np.arange(-2.0 * step_s, longest_s + settings.numerics.small, step_s)


def _pose_lags_s() -> np.ndarray:
    """Delays of the pose that are tried, s, of both signs."""
    longest_s = settings.design.window_shortest_s
    step_s = longest_s / settings.prepare.lag_steps
    return np.arange(-longest_s, longest_s + settings.numerics.small, step_s)


def _high_pass(x: np.ndarray, step_s: float, slower_s: float | None = None) -> np.ndarray:
    return x - gaussian_filter1d(x, (slower_s or settings.prepare.slow_s) / step_s)


def _correlations(flight: Prepared, model: Model, lags_s: np.ndarray) -> np.ndarray | None:
    """Sums for the correlation of thrust with vertical acceleration at every lag: (4, lags)."""
    ratio = lift(
        flight,
        model.number("thrust_coefficient_N_s2"),
        model.number("max_rotor_speed_rad_s"),
        model.weight_N,
    )
    if (
        ratio is None
        or "v_z_m_s" not in flight.columns
        or flight.flying.sum() * flight.dt_s < settings.prepare.flight_shortest_s
    ):
        return None
    step = flight.dt_s
    width = settings.prepare.thrust_smoothing_s / step
    # derivative of the Gaussian that smoothed the thrust: both keep the same band of frequency
    a = _high_pass(gaussian_filter1d(flight.columns["v_z_m_s"], width, order=1) / step, step)
    b = _high_pass(ratio, step)
    return _sums(flight, a, b, width, lags_s)


def _sums(
    flight: Prepared, a: np.ndarray, b: np.ndarray, width: float, lags_s: np.ndarray
) -> np.ndarray:
    """Sums for the correlation of one signal with another taken later by every lag, in the air:
    products, squares of the later and of the other, and how many samples are independent, where
    both were smoothed over ``width`` samples: (4, lags).
    """
    inside = flight.flying
    late = np.stack([np.interp(flight.t_s + lag, flight.t_s, b)[inside] for lag in lags_s])
    a = a[inside]
    # a box as wide averages noise as the Gaussian does
    free = len(a) / max(1.0, 2.0 * math.sqrt(math.pi) * width)
    each = [late @ a, (late**2).sum(axis=1), np.full(len(lags_s), a @ a)]
    return np.stack([*each, np.full(len(lags_s), free)])


def _peak(sums: np.ndarray, lags_s: np.ndarray) -> tuple[float, float]:
    """Lag and correlation at the peak, by a parabola through the three highest points."""
    r = sums[0] / np.sqrt(np.maximum(sums[1] * sums[2], settings.numerics.tiny))
    # the parabola needs a neighbour on either side, also of a peak at an end of the lags
    i = int(np.clip(np.argmax(r), 1, len(r) - 2))
    below, top, above = r[i - 1 : i + 2]
    bend = below - 2.0 * top + above
    shift = 0.5 * (below - above) / bend if bend < 0 else 0.0
    return float(lags_s[i] + shift * (lags_s[1] - lags_s[0])), float(r[i])


def _bound(sums: np.ndarray, lags_s: np.ndarray) -> float:
    """The least sd that a delay between two signals can have (Cramer-Rao; Carter 1987, Proc. IEEE
    75, 236): a = g b(t - d) + n has the information g^2 sum(b'^2) / var(n) on d.
    """
    products, squares, power, free = sums
    i = int(np.clip(np.argmax(products), 1, len(lags_s) - 2))
    gain = products[i] / squares[i]
    # of the correlation the curvature at its peak is -g sum(b'^2)
    bend = products[i - 1] - 2.0 * products[i] + products[i + 1]
    bend /= (lags_s[1] - lags_s[0]) ** 2
    left = max(power[i] - gain * products[i], 0.0)
    information = -gain * bend * free[i]
    return math.sqrt(left / information) if information > 0.0 else math.inf


def _told(stream: str, told: Sequence[np.ndarray], lags_s: np.ndarray) -> Delay | None:
    """The delay that the flights' summed correlations (4, lags) peak at; None without a clear peak.
    Its sd is the scatter of the flights, each by how much it moves: one that hardly does says
    nothing of it. And one without which the others agree better makes no delay alone.
    """
    if not told:
        return None
    together = np.sum(told, axis=0)
    delay, top = _peak(together, lags_s)
    weight = np.maximum([s[0].max() for s in told], 0.0)
    weight = weight / (weight.sum() or 1.0)
    # flights beyond one, as many as speak up
    free = 1.0 / max(float(weight @ weight), settings.numerics.small) - 1.0
    scatter = np.sqrt(weight @ (np.array([_peak(s, lags_s)[0] for s in told]) - delay) ** 2)
    several = free > settings.numerics.small
    sd = float(scatter / np.sqrt(free)) if several else float(lags_s[1] - lags_s[0])
    # leave one flight out: where the rest agree better, its whole pull on the delay is doubt
    less = [_peak(together - s, lags_s) for s in told] if len(told) > 1 else []
    sd = max([sd, *(abs(at - delay) for at, r in less if r > top)])
    # flights that agree by luck know no more than their noise lets them
    sd = max(sd, _bound(together, lags_s))
    # the sd of what is rounded to the grid of lags (Sheppard 1898)
    least_sd_s = float(lags_s[1] - lags_s[0]) / math.sqrt(12.0)
    clear = top > settings.statistics.large_part
    return Delay(stream, delay, max(sd, least_sd_s), top) if clear else None


def _behind_commands(flights: Sequence[Prepared]) -> float:
    """How far the rotor speeds lag behind their commands, s; infinite where that is not told."""
    told, lags_s = [], _drive_lags_s()
    for f in (f for f in flights if f.has("rotor_speed") and f.has("command")):
        width = settings.design.coarsest_s / f.dt_s
        # summed squares go as thrust: turns, in which rotors differ, cancel to first order
        squares = ((f.stack(s) ** 2).sum(axis=1) for s in ("command", "rotor_speed"))
        asked, given = (_high_pass(gaussian_filter1d(s / s.mean(), width), f.dt_s) for s in squares)
        told.append(_sums(f, asked, given, width, lags_s))
    found = _told("rotor_speed", told, lags_s)
    return found.delay_s if found else np.inf


def drive_delay(flights: Sequence[Prepared], model: Model) -> Delay | None:
    """How late the rotor speeds are logged against the motion, by direct correlation of thrust and
    vertical acceleration.

    Commands are left alone: their delay is physics (motor lag, transport delay). But what is late
    against the motion is as late against the commands that made it; where it is not, the
    controller's answers to disturbances made the peak.
    """
    logged, lags_s = [f for f in flights if f.has("rotor_speed")], _drive_lags_s()
    told = [s for s in each(lambda f: _correlations(f, model, lags_s), logged) if s is not None]
    found = _told("rotor_speed", told, lags_s)
    if found is None:
        return None
    # share of variance that the delay explains beyond none: r^2 at the peak less r |r| at lag 0
    at, shifted_2, still_2, _ = np.sum(told, axis=0)[:, np.argmin(np.abs(lags_s))]
    gained = found.correlation**2 - at * abs(at) / (shifted_2 * still_2)
    # speeds behind their commands by more than the motors lag: so late can the log be at most
    room = _behind_commands(flights) - model.number("motor_time_constant_s")
    late = found.delay_s < room + settings.statistics.certain_sds * found.sd_s
    return found if gained > settings.statistics.least_gain and late else None


def command_hold(flights: Sequence[Prepared]) -> Held:
    """How long commands are held, by what rotor speeds logged beside them do in the same row and in
    the two after it.

    What a command does before the next one is logged shows in its own row only if it was given in
    parts since the row before: the controller runs faster than the log. Where it was held for a
    row, nothing shows at once, most a row later, and less from there on. A transport delay or a
    slow second pole looks like neither, and leaves it open.
    """
    told = [f for f in flights if f.drive_in_every_row]
    if not told:
        return maybe_held()
    p = settings.prepare
    (now, then, after), sds = _responses(told)
    if now > max(settings.statistics.certain_sds * sds[0], p.at_once_share * then):
        return Held(0.0, p.at_once_share)
    fades = (
        then > settings.statistics.certain_sds * sds[1]
        and max(abs(now), sds[0]) < p.at_once_share * then
    )
    held = fades and after < (1.0 - settings.statistics.least_gain) * then
    return Held(0.5, p.at_once_share) if held else maybe_held()


def _responses(flights: Sequence[Prepared]) -> tuple[np.ndarray, np.ndarray]:
    """How relative rotor speeds follow relative commands at once, a row later and two rows later,
    and their sds: least squares of a finite response, which noise of the speeds does not bias
    (Ljung 1999, section 10.1).
    """
    taps = max(3, int(settings.design.window_shortest_s / max(f.dt_s for f in flights)))
    parts = [_delayed(f, taps) for f in flights]
    x, y = np.concatenate([x for x, _ in parts]), np.concatenate([y for _, y in parts])
    inverse = np.linalg.pinv(x.T @ x)
    response = inverse @ (x.T @ y)
    sds = np.sqrt(np.diag(inverse) * np.mean((y - x @ response) ** 2))
    return response[:3], sds[:3]


def _delayed(flight: Prepared, taps: int) -> tuple[np.ndarray, np.ndarray]:
    """Commands of every rotor now and up to ``taps`` rows before, and its speeds, over their means
    in the air, without what is slow; in the air, all rotors after each other.
    """
    air = np.flatnonzero(flight.flying)
    # over the means one response serves all rotors, whatever the units and the gain of each
    u, speed = (
        flight.stack(s).T / flight.stack(s)[air].mean(axis=0)[:, None]
        for s in ("command", "rotor_speed")
    )
    u, speed = (_high_pass(x, flight.dt_s, settings.design.window_shortest_s) for x in (u, speed))
    # a past that reaches before the recording is padded with zeros, which nobody commanded
    air = air[air >= taps]
    return np.concatenate([with_past(x, taps)[air] for x in u]), np.concatenate(list(speed[:, air]))


def _width(flight: Prepared) -> float:
    """Samples over which both body rates are smoothed: one width, set by the slower stream, so that
    the smoothing itself makes no delay between them.
    """
    update_s = max(flight.update_s["attitude"], flight.update_s["gyro"])
    return max(settings.design.coarsest_s, update_s) / flight.dt_s


def _both_rates(flight: Prepared) -> tuple[np.ndarray, np.ndarray] | None:
    """Smoothed body rates by gyro and by attitude."""
    if "attitude" in flight.derived or not (flight.has("gyro") and flight.has("attitude")):
        return None
    width = _width(flight)
    q = flight.stack("attitude")
    turning = turn_rates(q, np.gradient(q, flight.dt_s, axis=0))
    return tuple(gaussian_filter1d(r, width, axis=0) for r in (flight.stack("gyro"), turning))


def _rate_correlations(flight: Prepared) -> np.ndarray | None:
    """Sums for the correlation of the two body rates at every lag of the pose: (4, lags)."""
    pair, lags_s = _both_rates(flight), _pose_lags_s()
    if pair is None or flight.flying.sum() * flight.dt_s <= settings.prepare.flight_shortest_s:
        return None
    gyro, pose = (_high_pass(rates.T, flight.dt_s) for rates in pair)
    axes = zip(gyro, pose, strict=True)
    return np.sum([_sums(flight, a, b, _width(flight), lags_s) for a, b in axes], axis=0)


def pose_delay(flights: Sequence[Prepared]) -> Delay | None:
    """How late position, velocity and attitude are against the gyro, by direct correlation of the
    two body rates.

    None where most of the gyro is noise: the controller answers it, and so the vehicle turns a
    moment after its noise, as a late attitude would.
    """
    told = [s for s in each(_rate_correlations, flights) if s is not None]
    found = _told("attitude", told, _pose_lags_s())
    return found if found and found.correlation**2 > 0.5 else None


def clock_drift(flight: Prepared) -> float:
    """How much later the pose gets against the gyro along a flight, s; 0 where that is not told, or
    may be chance.

    A line through the delays of blocks of time, at whole samples: interpolation between them
    smooths noise, and draws the peak of a noisy correlation to half a sample, one way in one block
    and the other way in the next.
    """
    pair, rows = _both_rates(flight), np.flatnonzero(flight.flying)
    count = int(len(rows) * flight.dt_s // settings.statistics.block_s)
    if pair is None or count < settings.statistics.folds:
        return 0.0
    gyro, pose = (_high_pass(rates.T, flight.dt_s) for rates in pair)
    lags_s = _pose_lags_s()
    lags = np.arange(int(lags_s[0] / flight.dt_s), int(lags_s[-1] / flight.dt_s) + 1)
    blocks = np.array_split(rows, count)
    told = np.array(
        [_peak(_whole_sums(gyro, pose, block, lags), lags * flight.dt_s) for block in blocks]
    )
    centers_s = np.array([flight.t_s[block].mean() for block in blocks])
    return (flight.t_s[rows[-1]] - flight.t_s[rows[0]]) * _slope(centers_s, *told.T)


def _whole_sums(a: np.ndarray, b: np.ndarray, rows: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """Sums for the correlation of signals (k, n) with others taken later by whole samples, over
    some rows: (3, lags).
    """
    late, now = b[:, np.clip(rows + lags[:, None], 0, b.shape[1] - 1)], a[:, rows]
    return np.stack(
        [
            np.einsum("klr,kr->l", late, now),
            (late**2).sum(axis=(0, 2)),
            np.full(len(lags), (now**2).sum()),
        ]
    )


def _slope(t_s: np.ndarray, delay_s: np.ndarray, correlation: np.ndarray) -> float:
    """Of the line through delays, each as good as its correlation; 0 where their scatter about it
    may have made it.
    """
    told = correlation > settings.statistics.large_part
    if told.sum() < settings.statistics.folds:
        return 0.0
    x, y, free = t_s[told], delay_s[told], told.sum() - 2
    # the variance of a delay goes as (1 - r^2) / r^2; near r = 1 one block would outweigh all
    share = np.minimum(correlation[told], 1.0 - settings.statistics.least_gain) ** 2
    weight = share / (1.0 - share)
    x, y = x - np.average(x, weights=weight), y - np.average(y, weights=weight)
    spread = weight @ x**2
    slope = float(weight @ (x * y) / spread)
    sd = float(np.sqrt(weight @ (y - slope * x) ** 2 / free / spread))
    # Student's bound, two-sided: few blocks draw a line by luck
    chance = 1.0 - settings.statistics.certain_probability
    return slope if abs(slope) > -stdtrit(free, 0.5 * chance) * sd else 0.0


def gyro_bias(flights: Sequence[Prepared]) -> tuple[np.ndarray, np.ndarray] | None:
    """Gyro less the rates that the attitude implies: mean (3,) and its sd over flights, rad/s."""
    means = [
        (p[0] - p[1])[f.flying].mean(axis=0)
        for f in flights
        if (p := _both_rates(f)) is not None and f.flying.any()
    ]
    if len(means) < 2:
        return None
    # flights that agree by luck do not make an offset certain: the sd has a floor
    sd = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return np.mean(means, axis=0), np.hypot(sd, settings.prepare.gyro_bias_least_sd_rad_s)


def without_bias(flight: Prepared, bias: np.ndarray) -> Prepared:
    """The flight with a constant (3,), rad/s, taken out of its gyro."""
    if not flight.has("gyro"):
        return flight
    mended = {n: flight.columns[n] - b for n, b in zip(flight.streams["gyro"], bias, strict=True)}
    return flight.replaced(columns={**flight.columns, **mended})


def shifted(flight: Prepared, stream: str, delay_s: float) -> Prepared:
    """The flight with one stream moved back by its delay."""
    # the pose is taken as one estimator's: position and velocity are as late as the attitude
    streams = POSE if stream == "attitude" else (stream,)
    names = [n for s in streams for n in flight.streams[s] if n in flight.columns]
    # what was so at t, a late stream says at t + delay
    moved = {n: np.interp(flight.t_s + delay_s, flight.t_s, flight.columns[n]) for n in names}
    return flight.replaced(
        columns={**flight.columns, **moved}, lateness_s={**flight.lateness_s, stream: delay_s}
    )
