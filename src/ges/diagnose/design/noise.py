"""Noise of every channel: autoregression, sd and its growth, from what nuisances leave."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from statistics import median_low
from types import MappingProxyType

import numpy as np

from ges.diagnose.design.system import FlightRows, System
from ges.diagnose.settings import settings
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class NoiseModel:
    """Noise of the C channels.

    Attributes
    ----------
    ar : (C, p) autoregression coefficients.
    sd : (C,) innovation sd.
    growth : (C,) growth of the variance with the covariate.
    disturbance : (C,) size of disturbances that feedback may have followed, over ``sd``. It is the
        residual of the nuisances alone, without the noisiest flights.
    """

    ar: np.ndarray
    sd: np.ndarray
    growth: np.ndarray
    disturbance: np.ndarray


def noise_residuals(
    system: System,
    channels: Sequence[int],
    chosen: Sequence[int] = (),
    together: Mapping[int, float] = MappingProxyType({}),
) -> list[np.ndarray]:
    """Return what nuisances, columns and a constant of each flight leave in the air.

    Nuisances stay within their priors.

    Parameters
    ----------
    system : of the flights.
    channels : indices of c channels.
    chosen : columns whose coefficients each channel decides alone.
    together : coefficients of columns that act with these, but for one common factor: forms differ.

    Returns
    -------
    By flight, (c, m).
    """
    nuisances = [k for k, column in enumerate(system.columns) if column.nuisance is not None]
    kept, common = np.union1d(nuisances, chosen).astype(int), np.unique(list(together)).astype(int)
    # all is drawn to zero here, so that a mean apart from zero has to be within reach, too
    prior_sd = {
        int(k): math.hypot(n.sd, n.flight_sd, n.mean)
        if (n := system.columns[k].nuisance)
        else math.inf
        for k in kept
    }

    def of_flight(r: FlightRows) -> np.ndarray:
        residuals = np.full((len(channels), len(r.y)), np.nan)
        good = r.air[:, None] & np.isfinite(r.y)
        groups: dict[tuple[bytes, bytes], list[int]] = {}
        for i, c in enumerate(channels):
            groups.setdefault((good[:, c].tobytes(), r.x.at[c].tobytes()), []).append(i)
        for group in groups.values():
            own = [channels[i] for i in group]
            rows, at = good[:, own[0]], r.x.at[own[0]]
            if not rows.any():
                continue
            here, shared = np.intersect1d(kept, at), np.intersect1d(common, at)
            x = [np.stack([r.x.of(c, here).T for c in own])]
            prior_sds = [prior_sd[k] for k in here.tolist()]
            if len(shared):
                sizes = [together[k] for k in shared.tolist()]
                x.append(np.stack([[r.x.of(c, shared) @ sizes] for c in own]))
                prior_sds.append(math.inf)
            residuals[np.ix_(np.array(group), rows)] = _ridge_residuals(
                r.y[rows][:, own].T, np.concatenate(x, axis=1)[..., rows], np.array(prior_sds)
            )
        return residuals

    return each(of_flight, system.flights)


def _ridge_residuals(y: np.ndarray, x: np.ndarray, prior_sds: np.ndarray) -> np.ndarray:
    """Return residuals (g, n) of ridge regressions of g channels on k columns each, (g, k, n).

    The ridge of each is the variance of its residual.
    """
    y = y - y.mean(axis=1, keepdims=True)
    x = x - x.mean(axis=2, keepdims=True)
    # what has no prior sd may go far beyond what the residual could ask for
    size, tiny = np.sqrt(np.mean(x**2, axis=2)), settings.numerics.tiny
    sd2 = np.mean(y**2, axis=1)
    far = settings.numerics.wide_factor * np.sqrt(sd2)[:, None] / np.maximum(size, tiny)
    # in units of how far each may go, the prior N(0, 1) is a ridge of the noise's variance;
    # that variance is what is left, so it is found by turns
    sds = np.where(np.isfinite(prior_sds), prior_sds, np.where(size > 0, far, 0.0))
    x = x * sds[..., None]
    gram, right = x @ x.swapaxes(1, 2), x @ y[..., None]
    least = np.maximum(settings.numerics.small * np.trace(gram, axis1=1, axis2=2), tiny)
    e = y
    for _ in range(settings.numerics.noise_rounds):
        # the least ridge keeps columns that are alike solvable where nothing is left
        ridge = np.maximum(sd2, least)[:, None, None] * np.eye(gram.shape[1])
        e = y - (np.linalg.solve(gram + ridge, right).swapaxes(1, 2) @ x)[:, 0]
        sd2 = np.mean(e**2, axis=1)
    return e


def rows_in_run(follows: np.ndarray) -> np.ndarray:
    """Return how many rows every row directly follows in one run.

    Parameters
    ----------
    follows : (m,) True where a row directly follows the one before.

    Returns
    -------
    (m,).
    """
    # the last row that follows none is where a run starts
    at = np.arange(len(follows))
    return at - np.maximum.accumulate(np.where(follows, 0, at))


def rows_followed(y: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return how many present rows every row directly follows.

    Parameters
    ----------
    y : (m, c), NaN where a row is absent.
    run : (m,) of :func:`rows_in_run`.

    Returns
    -------
    (m, c); -1 where the row is absent itself.
    """
    there, at = np.isfinite(y), np.arange(len(y))[:, None]
    before = np.zeros_like(there)
    before[1:] = there[:-1]
    first = there & ((run == 0)[:, None] | ~before)
    return np.where(there, at - np.maximum.accumulate(np.where(first, at, 0), axis=0), -1)


def _rows_with_past(
    residual: np.ndarray, run: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows with a full past, their value and their past."""
    at = np.flatnonzero(rows_followed(residual[:, None], run) >= order)
    return at, residual[at], np.stack([residual[at - k] for k in range(1, order + 1)], axis=1)


def _growth(e: np.ndarray, covariate: np.ndarray) -> tuple[float, float]:
    """Return maximum-likelihood sd and growth of e ~ N(0, sd^2 (1 + g covariate^2))."""
    # -2 log likelihood, maximised over sd for every growth of a grid
    best = (np.inf, 1.0, 0.0)
    for g in settings.noise.growths:
        w = 1.0 + g * covariate**2
        sd2 = max(float(np.mean(e**2 / w)), settings.numerics.tiny)
        cost = len(e) * np.log(sd2) + np.log(w).sum()
        if cost < best[0]:
            best = (cost, float(np.sqrt(sd2)), g)
    return best[1], best[2]


def estimate_noise(
    system: System,
    chosen: Sequence[int] = (),
    together: Mapping[int, float] = MappingProxyType({}),
) -> NoiseModel:
    """Estimate the noise of every channel, pooled over flights, from :func:`noise_residuals`.

    Parameters
    ----------
    system : of the flights.
    chosen, together : columns that do not count as noise, as for :func:`noise_residuals`.

    Notes
    -----
    Without columns a strong effect counts as noise. That is cautious, so the search starts there.
    """
    covariate, runs = (
        variance_covariate(system.flights),
        [rows_in_run(r.follows) for r in system.flights],
    )
    endogenous = {c for r in system.flights for _, c in r.endogenous}
    # rows without any noise would count without limit
    floor = np.array(
        [settings.noise.least_share * system.model.reference_scale(name) for name in system.names]
    )

    every = range(len(system.names))
    by_flight = noise_residuals(system, every, chosen, together)
    # the controller responded to what columns explain, too: so without them
    plain = noise_residuals(system, every) if len(chosen) or together else None

    def of_channel(c: int) -> tuple[np.ndarray, float, float, float]:
        residuals = [e[c] for e in by_flight]
        ar, sd, growth = _channel_noise(system, residuals, runs, covariate)
        sd = max(sd, floor[c])
        disturbance = (
            _disturbance_size([e[c] for e in plain], runs, ar, sd)
            if plain and c in endogenous
            else 1.0
        )
        return ar, sd, growth, disturbance

    return NoiseModel(*(np.array(values) for values in zip(*each(of_channel, every), strict=True)))


def _disturbance_size(
    residuals: Sequence[np.ndarray], runs: Sequence[np.ndarray], ar: np.ndarray, sd: float
) -> float:
    """Return the residual size (m,) over the innovation sd in the middle flight.

    Of two it is the lesser, and at least 1.
    """
    sizes = [
        np.sqrt(np.mean((value - past @ ar) ** 2))
        for _, value, past in (
            _rows_with_past(e, run, len(ar)) for e, run in zip(residuals, runs, strict=True)
        )
        if len(value)
    ]
    return max(1.0, float(median_low(sizes)) / sd) if sizes else 1.0


def _channel_noise(
    system: System,
    residuals: Sequence[np.ndarray],
    runs: Sequence[np.ndarray],
    covariate: Sequence[np.ndarray],
) -> tuple[np.ndarray, float, float]:
    """Return AR coefficients, innovation sd and growth of one channel's residuals by flight."""
    order = settings.noise.autoregression_order
    pieces = [
        (*_rows_with_past(e, run, order), u)
        for e, run, u in zip(residuals, runs, covariate, strict=True)
    ]
    value, past = np.concatenate([p[1] for p in pieces]), np.concatenate([p[2] for p in pieces])
    # too few rows for a filter: none, and a unit sd
    if len(value) < 4 * order:
        return np.zeros(order), 1.0, 0.0
    if not settings.noise.whitening:
        return np.zeros(order), float(np.sqrt(np.mean(value**2))), 0.0
    # least squares on the past alone; the ridge holds where a channel never changes
    gram = past.T @ past
    ridge = max(settings.numerics.small * np.trace(gram), settings.numerics.tiny)
    ar = np.linalg.solve(gram + ridge * np.eye(order), past.T @ value)
    return ar, *_growth(value - past @ ar, np.concatenate([p[3][p[0]] for p in pieces]))


def variance_covariate(flights: Sequence[FlightRows]) -> list[np.ndarray]:
    """Return the covariate of the variance in units of its median over all flights.

    Parameters
    ----------
    flights : rows by flight.

    Returns
    -------
    By flight, (m,).
    """
    # where thrust never changes, any unit will do
    median = np.median(np.concatenate([r.covariate[r.air] for r in flights])) or 1.0
    return [r.covariate / median for r in flights]
