"""Trims of flights in sessions: mean balances, their posterior, and how far trims spread.

Trims spread at two levels, between the flights of a session and between sessions. That is a
hierarchical model (Gelman et al., *Bayesian Data Analysis*, 3rd ed., chapter 5). Few flights or
sessions determine a spread badly. It is pooled with what such vehicles usually show, by degrees of
freedom (scaled inverse chi-squared; ibid., section 2.6).
"""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import norm
from scipy.stats import t as student

from ges.diagnose.design.columns import nuisance_of
from ges.diagnose.design.system import System
from ges.diagnose.detectors.balance import (
    CANT,
    CHANNELS,
    LOSSES,
    MASS,
    losses_of,
    variance_of_means,
)
from ges.diagnose.select.evidence import Gram, marginalise_deviations
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model

*LEVERS, THRUST = MASS
TRIMS = (THRUST, *LOSSES, CANT, *LEVERS)


@dataclasses.dataclass(frozen=True)
class TrimBalance:
    """Mean residuals of thrust and moments of whole flights, their *balance*.

    Attributes
    ----------
    keys : of the k trims.
    prior_sd : (k,).
    spread : (k,) usual spread.
    sessions : normal equations by session and flight, of c channels over the sd of their mean.
    """

    keys: tuple[str, ...]
    prior_sd: np.ndarray
    spread: np.ndarray
    sessions: tuple[tuple[Gram, ...], ...]


def balance_of_flights(system: System, session: Sequence[int]) -> TrimBalance:
    """Reduce every flight to its mean balance of thrust and moments.

    Parameters
    ----------
    system : of the flights.
    session : index of each flight's session.

    Notes
    -----
    The mean balance alone determines gains. In single windows the noise of the commands is in the
    model too, and a fit would shrink the model (errors in variables).
    """
    kept = [
        k
        for k, c in enumerate(system.columns)
        if c.nuisance and c.nuisance.key in TRIMS and c.nuisance.sd > 0
    ]
    keys = tuple(nuisance_of(system.columns[k]).key for k in kept)
    balance_channels = [c for c, name in enumerate(system.names) if name in CHANNELS]
    # over the sd of a flight's mean, thrust and moments count alike whatever their units
    sd, grams = np.sqrt(variance_of_means(system, balance_channels)), []
    for r in system.flights:
        y = r.in_air(balance_channels).mean(axis=0) / sd
        x = r.mean_columns(balance_channels, kept) / sd[:, None]
        seen = np.isfinite(y)
        grams.append(
            Gram(
                x[seen].T @ x[seen],
                x[seen].T @ y[seen],
                float(y[seen] @ y[seen]),
                float(seen.sum()),
            )
        )
    prior = np.array([nuisance_of(system.columns[k]).sd for k in kept])
    together = tuple(
        tuple(g for g, own in zip(grams, session, strict=True) if own == index)
        for index in sorted(set(session))
    )
    return TrimBalance(keys, prior, np.array([_usual_spread(key, keys) for key in keys]), together)


def _usual_spread(key: str, keys: Sequence[str]) -> float:
    """Return the usual sd of a trim between flights, in the trim's unit; 0 for trims without one.

    It is a share of how far the trim may be off.
    """
    usual = settings.calibrate
    # motors that cannot be separated: the mean of four independent gains, 1 / sqrt(4)
    if key == THRUST and not set(LOSSES) & set(keys):
        return 0.5 * usual.spread * usual.loss_sd
    prior_sds = {**dict.fromkeys(LOSSES, usual.loss_sd), CANT: usual.cant_sd_rad}
    return usual.spread * prior_sds.get(key, 0.0)


@dataclasses.dataclass(frozen=True)
class _SessionPosterior:
    mean: np.ndarray
    covariance: np.ndarray
    log_likelihood: float


def _marginalise(gram: Gram, spread: np.ndarray) -> tuple[Gram, float]:
    """Integrate out the deviation N(0, spread^2) of one flight or session.

    Returns the normal equations of the common numbers, and the rest of the log likelihood.
    """
    # the factor that the integral leaves is -log det(I + S A S) / 2, S = diag(spread)
    inner = np.eye(len(spread)) + gram.xx * np.outer(spread, spread)
    common = marginalise_deviations(gram, np.arange(len(spread)), spread)
    return common, -0.5 * float(np.linalg.slogdet(inner)[1])


def posterior_of_trims(
    sessions: Sequence[Sequence[Gram]],
    prior_mean: np.ndarray,
    prior_sd: np.ndarray,
    flight_sd: np.ndarray,
    session_sd: np.ndarray,
) -> _SessionPosterior:
    """Return the posterior of common trims under N(prior_mean, prior_sd^2).

    Parameters
    ----------
    sessions : normal equations by session and flight.
    prior_mean, prior_sd : (k,) of the trims.
    flight_sd, session_sd : (k,) spreads, whose deviations are integrated out.
    """
    precision = np.diag(1.0 / prior_sd**2)
    right = precision @ prior_mean
    total = -float(np.log(prior_sd).sum()) - 0.5 * float(prior_mean @ precision @ prior_mean)
    for grams in sessions:
        # inner level first: what flights leave adds up to their session, and sessions to the whole
        flights = [_marginalise(gram, flight_sd) for gram in grams]
        session, own = _marginalise(
            functools.reduce(operator.add, [gram for gram, _ in flights]), session_sd
        )
        precision, right = precision + session.xx, right + session.xy
        total += own + sum(log_term for _, log_term in flights) - 0.5 * session.yy
    # Gaussian integral over the common numbers: the evidence that the spreads are chosen by
    covariance = np.linalg.inv(precision)
    mean = covariance @ right
    total += 0.5 * float(right @ mean) + 0.5 * np.linalg.slogdet(covariance)[1]
    return _SessionPosterior(mean, covariance, float(total))


def gauge_of_trims(keys: Sequence[str], model: Model) -> np.ndarray:
    """Return the matrix that moves common patterns of the losses into what does the same.

    Parameters
    ----------
    keys : of the k trims.
    model : of the vehicle.

    Returns
    -------
    (k, k).

    Notes
    -----
    Their mean goes into the thrust scale. Their yaw, of rotors that turn one way against the
    others, goes into the cant, ``g = mean(s_i e_i) K_Q / (K_T L)``. Corrections are small and arms
    alike.
    """
    gauge = np.eye(len(keys))
    gains = losses_of(model)
    if not set(gains) <= set(keys):
        return gauge
    losses, spin = [keys.index(key) for key in gains], model.of_rotors("spin")
    ratio_m = model.number("torque_coefficient_Nm_s2") / model.number("thrust_coefficient_N_s2")
    # a pattern that the losses share is projected out of them, into the number that does the same
    together = {THRUST: (np.ones(len(losses)), -1.0), CANT: (spin, ratio_m / model.arm_m)}
    for key, (sign, per) in together.items():
        if key in keys:
            gauge[np.ix_(losses, losses)] -= np.outer(sign, sign) / len(losses)
            gauge[keys.index(key), losses] = per * sign / len(losses)
    return gauge


@dataclasses.dataclass(frozen=True)
class Spread:
    """A spread over the usual one.

    Attributes
    ----------
    estimate : from these flights alone; nan where they show none.
    pooled : with the usual one.
    freedom : its degrees of freedom.
    """

    estimate: float
    pooled: float
    freedom: float

    @property
    def later_sd(self) -> float:
        """Sd of the equivalent normal of a later flight or session.

        It is as wide as the Student distribution where a change becomes certain.
        """
        # equal tails: Student's quantile where a normal has certain_sds, over certain_sds
        certain_sds = settings.statistics.certain_sds
        return float(student.isf(norm.sf(certain_sds), self.freedom)) / certain_sds * self.pooled


Spreads = tuple[Spread, Spread]
"""Between flights, of a session where there are several, and between sessions."""


def fit_spreads(balance: TrimBalance, start: np.ndarray, usual: float) -> Spreads:
    """Return both spreads by maximum likelihood, pooled with usual ones.

    Parameters
    ----------
    balance : of the flights.
    start : (k,) prior mean of the trims.
    usual : spread over that of :class:`TrimBalance`.

    Returns
    -------
    Between flights and between sessions. A single set has one spread, whatever its flights' days.
    """
    sessions, balances = balance.sessions, balance.sessions[0][0].n
    several = len(sessions) > 1
    flights = sum(map(len, sessions))
    usual_within = usual * (settings.calibrate.smaller_spread if several else 1.0)

    def most_likely(flight: float | None, session: float | None) -> float:
        """Return the factor that makes the flights most likely, the one of the two that is None."""

        def cost(log_factor: float) -> float:
            at = float(np.exp(log_factor))
            levels = [at if level is None else level for level in (flight, session)]
            return -posterior_of_trims(
                sessions, start, balance.prior_sd, *(level * balance.spread for level in levels)
            ).log_likelihood

        # a scale is searched in its logarithm: it stays positive, and half is as far as double
        most = np.log(settings.calibrate.spread_factor_most)
        return float(np.exp(minimize_scalar(cost, bounds=(-most, most), method="bounded").x))

    # each flight beyond the first of its session shows one deviation in every balance
    freedom = balances * (flights - len(sessions))
    # flights first, sessions held at their usual spread
    within = _pool(
        most_likely(None, usual if several else 0.0) if freedom else np.nan,
        freedom,
        usual_within,
        balances,
    )
    if not several:
        return within, Spread(np.nan, 0.0, balances)
    # then sessions, given by how much flights differ
    between = most_likely(within.pooled, None)
    return within, _pool(between, balances * (len(sessions) - 1), usual, balances)


def _pool(estimate: float, freedom: float, usual: float, worth: float) -> Spread:
    """Return the estimated and the usual spread, weighted by their degrees of freedom.

    The usual one is worth one flight: its ``worth`` is the number of balances (Kass and Wasserman
    1995, JASA 90, 928, unit information).
    """
    # scaled inverse chi-squared: (n s^2 + n0 s0^2) / (n + n0); no freedom, no word (s is nan)
    # (Gelman et al. 2013, Bayesian Data Analysis, 2.6)
    total = freedom + worth
    own = freedom * estimate**2 if freedom else 0.0
    return Spread(estimate, float(np.sqrt((own + worth * usual**2) / total)), total)
