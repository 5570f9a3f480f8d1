"""Interval nulls: what a number's prior allows is no finding, and no evidence for one."""

from __future__ import annotations

import dataclasses
import math
import sys

import numpy as np
from scipy.special import log_ndtr

from ges.diagnose.design.system import System
from ges.diagnose.select.evidence import Prior
from ges.diagnose.settings import settings

LEAST_LOG_MASS = math.log(sys.float_info.min)
"""Smaller masses have no logarithm in double precision."""


@dataclasses.dataclass(frozen=True)
class IntervalNull:
    """Intervals of coefficients that their prior allows.

    Attributes
    ----------
    low, high : (K,) of every column, NaN where it has none.
    counts : (K,) False for columns that never make a finding.
    cause : (K,) number of the effect, or of its place, that a column belongs to.
    prior : of all columns.

    Notes
    -----
    A candidate for a number with a prior says that some coefficient of it is beyond its interval.

    References
    ----------
    Morey and Rouder 2011, *Psychological Methods* 16, 406: Bayes factors of interval nulls.
    """

    low: np.ndarray
    high: np.ndarray
    counts: np.ndarray
    cause: np.ndarray
    prior: Prior

    def log_evidence(self, own: np.ndarray, mean: np.ndarray, sd: np.ndarray) -> np.ndarray:
        """Return what the intervals change of the log evidence of sets.

        Parameters
        ----------
        own : (s, k) columns of the sets.
        mean, sd : (s, k) of their posterior.

        Returns
        -------
        (s,) log mass beyond the intervals of the posterior, over that of the prior.
        """
        prior = self._log_mass_beyond(own, self.prior.mean[own], self.prior.sd[own])
        return self._log_mass_beyond(own, mean, sd) - prior

    def _log_mass_beyond(self, own: np.ndarray, mean: np.ndarray, sd: np.ndarray) -> np.ndarray:
        low, high = self.low[own], self.high[own]
        with np.errstate(invalid="ignore"):
            beyond = np.logaddexp(log_ndtr((low - mean) / sd), log_ndtr((mean - high) / sd))
        # what has no interval is always beyond it
        beyond = np.where(np.isnan(low), 0.0, np.clip(beyond, LEAST_LOG_MASS, 0.0))
        beyond = np.where(self.counts[own], beyond, LEAST_LOG_MASS)
        with np.errstate(divide="ignore"):
            log_within = np.log1p(-np.exp(beyond))
        cause = self.cause[own]
        same = cause[:, :, None] == cause[:, None, :]
        # one of several coefficients is enough
        within = np.where(same, log_within[:, None, :], 0.0).sum(axis=2)
        alone = np.where(same, beyond[:, None, :], -np.inf).max(axis=2)
        with np.errstate(divide="ignore"):
            some = np.maximum(np.log(-np.expm1(within)), alone)
        first = ~np.tril(same, -1).any(axis=2)
        return np.where(first, some, 0.0).sum(axis=1)


def interval_null(system: System, prior: Prior) -> IntervalNull:
    """Return the intervals of a system's columns.

    Parameters
    ----------
    system : of the flights.
    prior : of its columns.
    """
    candidates = {c.key for c in system.columns if c.variant}
    numbers = {key: system.number_with_prior(key) for key in sorted(candidates)}
    reach, none = settings.statistics.certain_sds, (np.nan, np.nan)
    intervals = [
        (n.mean - reach * n.sd, n.mean + reach * n.sd)
        if c.variant and (n := numbers[c.key])
        else none
        for c in system.columns
    ]
    low, high = np.array(intervals).reshape(-1, 2).T
    # where the lower tail is out of bounds, nothing is beyond the interval there
    low = np.where(low <= prior.low, -np.inf, low)
    high = np.where(high >= prior.high, np.inf, high)
    # an effect in several places is as many causes
    causes = [
        (v.effect, c.key if v.places else "") if (v := c.variant) else ("", "")
        for c in system.columns
    ]
    number = {cause: i for i, cause in enumerate(dict.fromkeys(causes))}
    return IntervalNull(
        low,
        high,
        np.array([c.part != "moment" for c in system.columns], dtype=bool),
        np.array([number[c] for c in causes], dtype=int),
        prior,
    )
