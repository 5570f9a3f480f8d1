"""How often names come true that the search is so sure of: the logistic correction of its log odds
(Platt 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ges.blind.protocol import seal
from ges.blind.protocol.run import OUT
from ges.blind.score.judge import judge
from ges.blind.score.verdicts import read_verdict
from ges.diagnose.settings import settings
from ges.errors import GesError

FIRST_OF_EVALUATION = 1000


def pairs(folders: Sequence[Path]) -> np.ndarray:
    """Return stated probabilities and whether the names were true.

    Parameters
    ----------
    folders : of diagnosed development cases.

    Returns
    -------
    (n, 2) of all names but those of certain probability, which the gate decides.

    Raises
    ------
    GesError
        For a folder of an evaluation seed: nothing is fitted to those.
    """
    stated = []
    for folder in folders:
        # a folder that does not tell its seed counts as one for evaluation
        if seal.makers(folder).get("seed", FIRST_OF_EVALUATION) >= FIRST_OF_EVALUATION:
            raise GesError(
                f"'{folder}' is for evaluation (seeds from {FIRST_OF_EVALUATION} on); nothing may"
                " be fitted to it"
            )
        for name in seal.cases(folder):
            judged = judge(name, seal.truth(folder, name), read_verdict(folder / OUT / name))
            stated += [
                (p, float(true))
                for p, true in judged.stated
                if p != settings.statistics.certain_probability
            ]
    return np.array(stated, dtype=float).reshape(-1, 2)


def fit(log_odds: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Fit the logistic correction that makes stated probabilities come true.

    Parameters
    ----------
    log_odds, true : (n,) of the search, and whether the name was true.

    Returns
    -------
    Offset a and slope b of P = 1 / (1 + exp(-a - b log odds)).

    References
    ----------
    Platt 1999, *Probabilistic outputs for support vector machines*.
    """
    from sklearn.linear_model import LogisticRegression

    # hardly any penalty: P(true) = 1 / (1 + exp(-a - b logit p)) at its greatest likelihood
    model = LogisticRegression(C=1e6).fit(log_odds[:, None], true)
    return float(model.intercept_[0]), float(model.coef_[0, 0])
