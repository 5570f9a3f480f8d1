"""Shares with exact intervals, bootstrap intervals, and the calibration of stated probabilities."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

CONFIDENCE = 0.95
DRAWS = 2000


def proportion(hits: Sequence[bool]) -> tuple[float, float, float]:
    """Return a share with its 95 % interval.

    Returns
    -------
    (share, low, high); NaN where there is nothing to count.

    References
    ----------
    Clopper and Pearson 1934, Biometrika 26.
    """
    from scipy.stats import binomtest

    if not len(hits):
        return (np.nan,) * 3
    test = binomtest(int(sum(hits)), len(hits))
    low, high = test.proportion_ci(CONFIDENCE, method="exact")
    return (test.statistic, float(low), float(high))


def bootstrap(
    values: np.ndarray, statistic: Callable[[np.ndarray], float]
) -> tuple[float, float, float]:
    """Return a statistic with its 95 % percentile interval over resampled rows.

    Parameters
    ----------
    values : (n, ...) rows.
    statistic : of such rows.

    Returns
    -------
    (statistic, low, high); NaN without rows. The draws are the same every time.
    """
    if not len(values):
        return (np.nan,) * 3
    # the same draws every time: scores of the same answers are the same to the last digit
    rng = np.random.default_rng(0)
    drawn = [statistic(values[rng.integers(0, len(values), len(values))]) for _ in range(DRAWS)]
    low, high = np.nanquantile(drawn, [0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0])
    return (float(statistic(values)), float(low), float(high))


def calibration_error(stated: np.ndarray, bins: int = 10) -> float:
    """Return the expected calibration error over equal bins.

    Parameters
    ----------
    stated : (n, 2) stated probability and whether it came true.
    bins : number of bins.
    """
    place = np.clip((stated[:, 0] * bins).astype(int), 0, bins - 1)
    # |sum of p - sum of hits| / n is a bin's share of the rows times its gap
    gaps = [abs((stated[place == b, 0] - stated[place == b, 1]).sum()) for b in range(bins)]
    return float(sum(gaps) / len(stated))


def reliability_table(stated: Sequence[tuple[float, bool]], bins: int = 10) -> pd.DataFrame:
    """Return the share that came true by bin of the stated probability.

    Parameters
    ----------
    stated : (probability, came true).
    bins : number of equal bins.

    Returns
    -------
    A row a bin that holds any: its lower edge, count, mean stated probability, share and 95 %
    interval.
    """
    values = np.array(stated, dtype=float).reshape(-1, 2)
    place = np.clip((values[:, 0] * bins).astype(int), 0, bins - 1)
    rows = []
    for b in np.unique(place):
        part = values[place == b]
        came_true = proportion(part[:, 1].astype(bool))
        rows.append((b / bins, len(part), part[:, 0].mean(), *came_true))
    return pd.DataFrame(rows, columns=["bin", "n", "stated", "true", "low", "high"])


def score_row(
    name: str, values: tuple[float, float, float, int], aim: tuple[str, float] | None
) -> dict[str, float | int | str | None]:
    """Return a row of the table of scores.

    Parameters
    ----------
    name : of the score.
    values : score, interval (low, high) and number of cases.
    aim : direction ('<=' or '>=') and goal; None without one.

    Returns
    -------
    ``met`` is empty without an aim or without cases; numbers that are not finite are None.
    """
    value, low, high, count = values
    sign, goal = aim or ("", np.nan)
    met = ""
    if sign and count:
        met = "yes" if (value <= goal if sign == "<=" else value >= goal) else "no"
    finite = [float(v) if np.isfinite(v) else None for v in (value, low, high)]
    about = f"{sign} {goal:g}" if sign else ""
    keys = ("score", "value", "low", "high", "n", "aim", "met")
    return dict(zip(keys, (name, *finite, count, about, met), strict=True))
