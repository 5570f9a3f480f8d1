"""Shares with exact intervals, bootstrap intervals, and the calibration of stated probabilities."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

CONFIDENCE = 0.95
DRAWS = 2000


def proportion(hits: Sequence[bool]) -> tuple[float, float, float]:
    """Share with its Clopper-Pearson interval; NaN where there is nothing to count."""
    from scipy.stats import binomtest

    if not len(hits):
        return (np.nan,) * 3
    test = binomtest(int(sum(hits)), len(hits))
    low, high = test.proportion_ci(CONFIDENCE, method="exact")
    return (test.statistic, float(low), float(high))


def bootstrap(
    values: np.ndarray, statistic: Callable[[np.ndarray], float]
) -> tuple[float, float, float]:
    """Statistic of rows of ``values`` with its percentile interval over resampled rows."""
    if not len(values):
        return (np.nan,) * 3
    rng = np.random.default_rng(0)
    drawn = [statistic(values[rng.integers(0, len(values), len(values))]) for _ in range(DRAWS)]
    low, high = np.nanquantile(drawn, [0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0])
    return (float(statistic(values)), float(low), float(high))


def calibration_error(stated: np.ndarray, bins: int = 10) -> float:
    """Expected calibration error of rows (probability, came true) over equal bins."""
    place = np.clip((stated[:, 0] * bins).astype(int), 0, bins - 1)
    gaps = [abs((stated[place == b, 0] - stated[place == b, 1]).sum()) for b in range(bins)]
    return float(sum(gaps) / len(stated))
