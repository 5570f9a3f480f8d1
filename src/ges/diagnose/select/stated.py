"""Probabilities as they are told: those of the search, corrected by how often such names came true.

The search weighs its hypotheses as if one of its forms were exact. None is, so its probabilities
are too sure; a logistic correction of the log odds (Platt 1999) makes them what they say. Its two
numbers were fitted by ``ges blind calibrate`` to concealed cases of the project's own generator
with development seeds, apart from any evaluation (docs/proof.md).
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit, logit

OFFSET, SLOPE = -0.36, 0.597
FARTHEST = 7.0
"""Log odds beyond which the search's certainty says no more."""


def log_odds(probability: float) -> float:
    """Of a probability, within +-``FARTHEST``."""
    return float(np.clip(logit(np.clip(probability, 0.0, 1.0)), -FARTHEST, FARTHEST))


def stated(probability: float) -> float:
    """The search's probability of a name, as it is told."""
    return float(expit(OFFSET + SLOPE * log_odds(probability)))


def searched(told: float) -> float:
    """The search's log odds behind a told probability."""
    return (float(logit(told)) - OFFSET) / SLOPE
