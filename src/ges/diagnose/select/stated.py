"""Probabilities as they are told: those of the search, corrected by how often such names came true.

The search weighs its hypotheses as if one of its forms were exact. None is, so its probabilities
are too sure; a logistic correction of the log odds (Platt 1999) makes them what they say. Its two
numbers are fitted by ``ges blind calibrate`` to concealed cases of development seeds.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit, logit

from ges.diagnose.settings import settings


def log_odds(probability: float) -> float:
    """Of a probability, no farther than where the search's certainty says more."""
    most = settings.statistics.certain_log_odds
    return float(np.clip(logit(np.clip(probability, 0.0, 1.0)), -most, most))


def stated(probability: float) -> float:
    """The search's probability of a name, as it is told."""
    s = settings.search
    return float(expit(s.log_odds_offset + s.log_odds_slope * log_odds(probability)))


def searched(told: float) -> float:
    """The search's log odds behind a told probability."""
    return (float(logit(told)) - settings.search.log_odds_offset) / settings.search.log_odds_slope
