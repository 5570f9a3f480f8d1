"""Delays between streams, clock drift, and gyro offsets, from direct comparison without physics."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import stdtrit

from ges.diagnose.prepare.align import (
    CommandHold,
    Prepared,
    thrust_over_weight,
)
from ges.diagnose.prepare.kinematics import turn_rates
from ges.diagnose.prepare.steady import lag_matrix
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.threads import each

POSE = ("position", "velocity", "attitude")


@dataclasses.dataclass(frozen=True)
class Delay:
    """Delay of one stream against the motion.

    Attributes
    ----------
    stream : what is late.
    delay_s : the delay.
    sd_s : its standard deviation over flights.
    correlation : correlation at the peak.
    """

    stream: str
    delay_s: float
    sd_s: float
    correlation: float


def _drive_lags_s() -> np.ndarray:
    """Return trial delays of the rotor speeds, s; two negative steps show a peak at 0."""
    longest_s = settings.prepare.pause_s
    step_s = longest_s / settings.prepare.lag_steps
    return np.arange(-2.0 * step_s, longest_s + settings.numerics.small, step_s)


def _pose_lags_s() -> np.ndarray:
    """Return trial delays of the pose, s, of both signs."""
    longest_s = settings.design.window_shortest_s
    step_s = longest_s / settings.prepare.lag_steps
    return np.arange(-longest_s, longest_s + settings.numerics.small, step_s)


def _high_pass(x: np.ndarray, step_s: float, slower_s: float | None = None) -> np.ndarray:
    return x - gaussian_filter1d(x, (slower_s or settings.prepare.slow_s) / step_s)


def _thrust_correlations(flight: Prepared, model: Model, lags_s: np.ndarray) -> np.ndarray | None:
    """Return the correlation sums (4, lags) of thrust with vertical acceleration."""
    ratio = thrust_over_weight(flight, model)
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
    return _correlation_sums(flight, a, b, width, lags_s)


def _correlation_sums(
    flight: Prepared, a: np.ndarray, b: np.ndarray, width: float, lags_s: np.ndarray
) -> np.ndarray:
    """Return sums (4, lags) for the correlation of ``a`` with ``b`` taken later, in the air.

    They are products, squares of the later and of the other, and the number of independent samples.
    Both signals were smoothed over ``width`` samples.
    """
    inside = flight.flying
    late = np.stack([np.interp(flight.t_s + lag, flight.t_s, b)[inside] for lag in lags_s])
    a = a[inside]
    # a box as wide averages noise as the Gaussian does
    free = len(a) / max(1.0, 2.0 * math.sqrt(math.pi) * width)
    each = [late @ a, (late**2).sum(axis=1), np.full(len(lags_s), a @ a)]
    return np.stack([*each, np.full(len(lags_s), free)])


def _peak(sums: np.ndarray, lags_s: np.ndarray) -> tuple[float, float]:
    """Return lag and correlation at the peak, by a parabola through the highest points."""
    r = sums[0] / np.sqrt(np.maximum(sums[1] * sums[2], settings.numerics.tiny))
    # the parabola needs a neighbour on either side, also of a peak at an end of the lags
    i = int(np.clip(np.argmax(r), 1, len(r) - 2))
    below, top, above = r[i - 1 : i + 2]
    bend = below - 2.0 * top + above
    shift = 0.5 * (below - above) / bend if bend < 0 else 0.0
    return float(lags_s[i] + shift * (lags_s[1] - lags_s[0])), float(r[i])


def _least_sd_s(sums: np.ndarray, lags_s: np.ndarray) -> float:
    """Return the lower bound of the sd of a delay between two signals.

    For a = g b(t - d) + n the information on d is g^2 sum(b'^2) / var(n).

    References
    ----------
    Carter 1987, Proc. IEEE 75, 236.
    """
    products, squares, power, free = sums
    i = int(np.clip(np.argmax(products), 1, len(lags_s) - 2))
    # what does not move says nothing of when it moved
    if not squares[i] > 0.0:
        return math.inf
    gain = products[i] / squares[i]
    # of the correlation the curvature at its peak is -g sum(b'^2)
    bend = products[i - 1] - 2.0 * products[i] + products[i + 1]
    bend /= (lags_s[1] - lags_s[0]) ** 2
    unexplained = max(power[i] - gain * products[i], 0.0)
    information = -gain * bend * free[i]
    return math.sqrt(unexplained / information) if information > 0.0 else math.inf


def _combined_delay(
    stream: str, of_flights: Sequence[np.ndarray], lags_s: np.ndarray
) -> Delay | None:
    """Return the delay at the peak of the flights' summed correlations (4, lags).

    None without a clear peak.

    The sd is the scatter of the flights, each weighted by how much it moves. It is at least the
    shift by leaving out a flight without which the others agree better.
    """
    if not of_flights:
        return None
    together = np.sum(of_flights, axis=0)
    delay, top = _peak(together, lags_s)
    weight = np.maximum([s[0].max() for s in of_flights], 0.0)
    weight = weight / (weight.sum() or 1.0)
    # flights beyond one, as many as speak up
    free = 1.0 / max(float(weight @ weight), settings.numerics.small) - 1.0
    scatter = np.sqrt(weight @ (np.array([_peak(s, lags_s)[0] for s in of_flights]) - delay) ** 2)
    several = free > settings.numerics.small
    sd = float(scatter / np.sqrt(free)) if several else float(lags_s[1] - lags_s[0])
    # leave one flight out: where the rest agree better, its whole pull on the delay counts as
    # uncertainty
    without_one = [_peak(together - s, lags_s) for s in of_flights] if len(of_flights) > 1 else []
    sd = max([sd, *(abs(at - delay) for at, r in without_one if r > top)])
    # flights that agree by luck know no more than their noise lets them
    sd = max(sd, _least_sd_s(together, lags_s))
    # the sd of what is rounded to the grid of lags (Sheppard 1898)
    least_sd_s = float(lags_s[1] - lags_s[0]) / math.sqrt(12.0)
    # of independent signals a correlation has a variance of one over the number of samples
    clear = top * math.sqrt(together[3].max()) > settings.statistics.certain_sds
    return Delay(stream, delay, max(sd, least_sd_s), top) if clear else None


def _lag_behind_commands_s(flights: Sequence[Prepared]) -> float:
    """Return the lag of the rotor speeds behind their commands.

    It is infinite where it cannot be seen.
    """
    of_flights, lags_s = [], _drive_lags_s()
    for f in (f for f in flights if f.has("rotor_speed") and f.has("command")):
        width = settings.design.coarsest_s / f.dt_s
        # summed squares go as thrust: turns, in which rotors differ, cancel to first order
        squares = ((f.stack(s) ** 2).sum(axis=1) for s in ("command", "rotor_speed"))
        commanded, turned = (
            _high_pass(gaussian_filter1d(s / s.mean(), width), f.dt_s) for s in squares
        )
        of_flights.append(_correlation_sums(f, commanded, turned, width, lags_s))
    delay = _combined_delay("rotor_speed", of_flights, lags_s)
    return delay.delay_s if delay else np.inf


def drive_delay(flights: Sequence[Prepared], model: Model) -> Delay | None:
    """Estimate the delay of logged rotor speeds, from thrust against vertical acceleration.

    Parameters
    ----------
    flights : prepared recordings.
    model : of the vehicle.

    Returns
    -------
    The delay; None where it is not clear.

    Notes
    -----
    The delay of commands is physics and stays: motor lag, transport delay. A log is at most as late
    as it is against the commands. A peak beyond that is the controller's response to disturbances.
    """
    logged, lags_s = [f for f in flights if f.has("rotor_speed")], _drive_lags_s()
    of_flights = [
        s for s in each(lambda f: _thrust_correlations(f, model, lags_s), logged) if s is not None
    ]
    delay = _combined_delay("rotor_speed", of_flights, lags_s)
    if delay is None:
        return None
    # share of variance that the delay explains beyond none: r^2 at the peak less r |r| at lag 0
    at, shifted_2, still_2, _ = np.sum(of_flights, axis=0)[:, np.argmin(np.abs(lags_s))]
    gained = delay.correlation**2 - at * abs(at) / (shifted_2 * still_2)
    # how far speeds are behind their commands, beyond the lag of the motors
    room = _lag_behind_commands_s(flights) - model.number("motor_time_constant_s")
    late = room > settings.statistics.clear_sds * delay.sd_s
    if gained <= settings.statistics.least_gain or not late:
        return None
    return dataclasses.replace(delay, delay_s=min(delay.delay_s, room))


def estimate_command_hold(flights: Sequence[Prepared]) -> CommandHold:
    """Estimate how long commands are held, from rotor speeds in their row and the two after it.

    Parameters
    ----------
    flights : prepared recordings; only those with a complete drive in every row count.

    Returns
    -------
    No hold, a whole row, or :class:`CommandHold` as it is where neither is clear.

    Notes
    -----
    A command shows in its own row only if the controller runs faster than the log. Where it is held
    for a row, nothing shows at once, most a row later, and less after that. A transport delay or a
    slow second pole looks like neither.
    """
    usable = [f for f in flights if f.drive_in_every_row]
    if not usable:
        return CommandHold()
    (now, then, after), sds = _responses(usable)
    # what moves within a row has half of its response there, what is held none: halfway between
    least, certain_sds = 0.25 * then, settings.statistics.certain_sds
    if now > max(certain_sds * sds[0], least):
        return CommandHold(0.0, 0.0)
    fades = then > certain_sds * sds[1] and max(abs(now), sds[0]) < least
    holds = fades and after < (1.0 - settings.statistics.least_gain) * then
    return CommandHold(0.5, 0.0) if holds else CommandHold()


def _responses(flights: Sequence[Prepared]) -> tuple[np.ndarray, np.ndarray]:
    """Return the response of relative rotor speeds to relative commands, and its sds.

    They are the first three taps of a finite impulse response.

    Least squares, which noise of the speeds does not bias.

    References
    ----------
    Ljung 1999, *System Identification*, section 10.1.
    """
    taps = max(3, int(settings.design.window_shortest_s / max(f.dt_s for f in flights)))
    parts = [_lagged_response_rows(f, taps) for f in flights]
    x, y = np.concatenate([x for x, _ in parts]), np.concatenate([y for _, y in parts])
    inverse = np.linalg.pinv(x.T @ x)
    response = inverse @ (x.T @ y)
    sds = np.sqrt(np.diag(inverse) * np.mean((y - x @ response) ** 2))
    return response[:3], sds[:3]


def _lagged_response_rows(flight: Prepared, taps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return lagged commands (rotors r, taps) and speeds (rotors r,), over their means.

    They are of the r rows in the air, rotor after rotor, and high-passed.
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
    return np.concatenate([lag_matrix(x, taps)[air] for x in u]), np.concatenate(
        list(speed[:, air])
    )


def _smoothing_samples(flight: Prepared) -> float:
    """Return smoothing width of both body rates, set by the slower stream.

    One width for both makes no delay between them.
    """
    update_s = max(flight.update_s["attitude"], flight.update_s["gyro"])
    return max(settings.design.coarsest_s, update_s) / flight.dt_s


def _rates_by_gyro_and_attitude(flight: Prepared) -> tuple[np.ndarray, np.ndarray] | None:
    """Return smoothed body rates by gyro and by attitude, rad/s; None where one never changes."""
    if "attitude" in flight.derived or not (flight.has("gyro") and flight.has("attitude")):
        return None
    width = _smoothing_samples(flight)
    if not math.isfinite(width):
        return None
    q = flight.stack("attitude")
    turning = turn_rates(q, np.gradient(q, flight.dt_s, axis=0))
    return tuple(gaussian_filter1d(r, width, axis=0) for r in (flight.stack("gyro"), turning))


def _rate_correlations(flight: Prepared) -> np.ndarray | None:
    """Return the correlation sums (4, lags) of the two body rates."""
    pair, lags_s = _rates_by_gyro_and_attitude(flight), _pose_lags_s()
    if pair is None or flight.flying.sum() * flight.dt_s <= settings.prepare.flight_shortest_s:
        return None
    gyro, pose = (_high_pass(rates.T, flight.dt_s) for rates in pair)
    axes = zip(gyro, pose, strict=True)
    return np.sum(
        [_correlation_sums(flight, a, b, _smoothing_samples(flight), lags_s) for a, b in axes],
        axis=0,
    )


def pose_delay(flights: Sequence[Prepared]) -> Delay | None:
    """Estimate the delay of position, velocity and attitude against the gyro.

    Parameters
    ----------
    flights : prepared recordings.

    Returns
    -------
    The delay; None where it is not clear, or most of the gyro is noise.

    Notes
    -----
    A controller responds to noise of the gyro, and the vehicle turns shortly after it, as with a
    late attitude.
    """
    of_flights = [s for s in each(_rate_correlations, flights) if s is not None]
    delay = _combined_delay("attitude", of_flights, _pose_lags_s())
    return delay if delay and delay.correlation**2 > 0.5 else None


def clock_drift(flight: Prepared) -> float:
    """Estimate how much the delay of the pose against the gyro grows along a flight.

    Parameters
    ----------
    flight : prepared recording.

    Returns
    -------
    Seconds; 0 where it cannot be seen, or may be chance.

    Notes
    -----
    A line is fitted to the delays of blocks of time, at whole samples. Interpolated samples are
    smoother, which draws a noisy peak to half a sample.
    """
    pair, rows = _rates_by_gyro_and_attitude(flight), np.flatnonzero(flight.flying)
    count = int(len(rows) * flight.dt_s // settings.statistics.block_s)
    if pair is None or count < settings.statistics.folds:
        return 0.0
    gyro, pose = (_high_pass(rates.T, flight.dt_s) for rates in pair)
    lags_s = _pose_lags_s()
    lags = np.arange(int(lags_s[0] / flight.dt_s), int(lags_s[-1] / flight.dt_s) + 1)
    blocks = np.array_split(rows, count)
    peaks = np.array(
        [_peak(_whole_sample_sums(gyro, pose, block, lags), lags * flight.dt_s) for block in blocks]
    )
    centers_s = np.array([flight.t_s[block].mean() for block in blocks])
    return (flight.t_s[rows[-1]] - flight.t_s[rows[0]]) * _significant_slope(centers_s, *peaks.T)


def _whole_sample_sums(
    a: np.ndarray, b: np.ndarray, rows: np.ndarray, lags: np.ndarray
) -> np.ndarray:
    """Return correlation sums (3, lags) of signals (k, n) at whole samples."""
    late, now = b[:, np.clip(rows + lags[:, None], 0, b.shape[1] - 1)], a[:, rows]
    return np.stack(
        [
            np.einsum("klr,kr->l", late, now),
            (late**2).sum(axis=(0, 2)),
            np.full(len(lags), (now**2).sum()),
        ]
    )


def _significant_slope(t_s: np.ndarray, delay_s: np.ndarray, correlation: np.ndarray) -> float:
    """Return the slope of the line through delays, weighted by their correlation.

    It is 0 where it may be chance.
    """
    clear = correlation > 0.0
    if clear.sum() < settings.statistics.folds:
        return 0.0
    x, y, free = t_s[clear], delay_s[clear], clear.sum() - 2
    # the variance of a delay goes as (1 - r^2) / r^2; near r = 1 one block would outweigh all
    share = np.minimum(correlation[clear], 1.0 - settings.statistics.least_gain) ** 2
    weight = share / (1.0 - share)
    x, y = x - np.average(x, weights=weight), y - np.average(y, weights=weight)
    spread = weight @ x**2
    slope = float(weight @ (x * y) / spread)
    sd = float(np.sqrt(weight @ (y - slope * x) ** 2 / free / spread))
    # Student's bound, two-sided: few blocks draw a line by luck
    level = 1.0 - settings.statistics.certain_probability
    return slope if abs(slope) > -stdtrit(free, 0.5 * level) * sd else 0.0


def gyro_bias(flights: Sequence[Prepared]) -> tuple[np.ndarray, np.ndarray] | None:
    """Estimate the constant offset of the gyro from the rates of the attitude.

    Parameters
    ----------
    flights : prepared recordings.

    Returns
    -------
    Mean (3,), rad/s, body, and the sd of its distance from none (3,), which has that over flights
    and the usual one. None with fewer than two flights.
    """
    means = [
        (p[0] - p[1])[f.flying].mean(axis=0)
        for f in flights
        if (p := _rates_by_gyro_and_attitude(f)) is not None and f.flying.any()
    ]
    if len(means) < 2:
        return None
    # an offset that gyros usually have is no finding, however well flights agree
    priors = [p.prior for e in effect_table.table().values() for p in e.parameters if p.prior]
    usual = [prior.sd for prior in priors if prior.shows_in == ("gyro",)]
    sd = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return np.mean(means, axis=0), np.hypot(sd, usual)


def without_gyro_bias(flight: Prepared, bias: np.ndarray) -> Prepared:
    """Return the flight with a constant subtracted from its gyro.

    Parameters
    ----------
    flight : prepared recording.
    bias : (3,) rad/s, body.
    """
    if not flight.has("gyro"):
        return flight
    corrected = {
        n: flight.columns[n] - b for n, b in zip(flight.streams["gyro"], bias, strict=True)
    }
    return flight.replace(columns={**flight.columns, **corrected})


def without_delay(flight: Prepared, stream: str, delay_s: float) -> Prepared:
    """Return the flight with one stream moved back by its delay.

    Parameters
    ----------
    flight : prepared recording.
    stream : what is late. With ``attitude``, position and velocity move too, as one estimator's.
    delay_s : how late it is.
    """
    # the pose is taken as one estimator's: position and velocity are as late as the attitude
    streams = POSE if stream == "attitude" else (stream,)
    names = [n for s in streams for n in flight.streams[s] if n in flight.columns]
    # what was so at t, a late stream shows at t + delay
    moved = {n: np.interp(flight.t_s + delay_s, flight.t_s, flight.columns[n]) for n in names}
    return flight.replace(columns={**flight.columns, **moved})
