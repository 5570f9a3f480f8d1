"""Calibrated probabilities: Platt scaling of the search's posterior, fitted to concealed cases.

The search treats one of its forms as exact. None is, so its probabilities are too sure. A logistic
correction of the log odds (Platt 1999) makes them match the share of names that come true. Its two
numbers are fitted by ``ges blind calibrate`` to cases of development seeds.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit, logit

from ges.diagnose.settings import settings


def log_odds(probability: float) -> float:
    """Return log odds, clipped where more certainty has no meaning.

    Parameters
    ----------
    probability : 0 to 1.
    """
    most = settings.statistics.certain_log_odds
    return float(np.clip(logit(np.clip(probability, 0.0, 1.0)), -most, most))


def calibrated_probability(probability: float) -> float:
    """Return the calibrated probability of a name.

    Parameters
    ----------
    probability : posterior probability of the search, 0 to 1.
    """
    s = settings.search
    return float(expit(s.log_odds_offset + s.log_odds_slope * log_odds(probability)))


def uncalibrated_log_odds(probability: float) -> float:
    """Return the search's log odds behind a calibrated probability.

    Parameters
    ----------
    probability : calibrated, 0 to 1.
    """
    return (
        float(logit(probability)) - settings.search.log_odds_offset
    ) / settings.search.log_odds_slope
