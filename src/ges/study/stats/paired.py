"""Intervals by seed and paired differences.

A seed is one terrain with one draw of sensor noise; the values of two conditions on one seed belong
together. Means get a percentile bootstrap over seeds. Differences get a paired t-test with its
interval and Cohen's d_z (mean over standard deviation of the differences). p-values of one table
are corrected by Holm's method.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

RESAMPLES = 9999
COMPARED = ("difference", "low", "high", "t", "p", "d_z", "above")


@functools.lru_cache(maxsize=8)
def _resamples(n: int) -> np.ndarray:
    # one set of draws for every mean of n seeds: equal values have equal intervals
    return np.random.default_rng(0).integers(0, n, (RESAMPLES, n))


def mean_interval(values: np.ndarray, confidence: float = 0.95) -> tuple[float, float]:
    """Return the bootstrap interval of a mean (percentile, the same draws every time).

    Parameters
    ----------
    values : (n,).
    confidence : of the interval, 0 to 1.

    Returns
    -------
    (low, high); NaN below two values.
    """
    if len(values) < 2:
        return float("nan"), float("nan")
    tail = 50.0 * (1.0 - confidence)
    low, high = np.percentile(
        np.asarray(values)[_resamples(len(values))].mean(axis=1), [tail, 100.0 - tail]
    )
    return float(low), float(high)


def difference(a: np.ndarray, b: np.ndarray) -> dict[str, float]:
    """Compare two conditions seed by seed.

    Parameters
    ----------
    a, b : (n,) values of the same seeds.

    Returns
    -------
    ``difference`` (mean of a - b), ``low``, ``high`` (95 %, t distribution), ``t``, ``p``
    (two-sided), ``d_z`` and ``above`` (share of pairs with a > b). Where every difference is zero,
    t = 0 and p = 1. Below two pairs the interval is NaN.
    """
    from scipy import stats

    d = np.asarray(a, float) - np.asarray(b, float)
    mean, above = float(d.mean()), float((d > 0).mean())
    # t would be 0 / 0
    if not d.any():
        return dict.fromkeys(COMPARED, 0.0) | {"p": 1.0}
    if len(d) < 2:
        return dict.fromkeys(COMPARED, float("nan")) | {"difference": mean, "above": above}
    test = stats.ttest_1samp(d, 0.0)
    low, high = test.confidence_interval(0.95)
    # equal differences have a deviation of zero but for rounding, which would give any number
    d_z = mean / float(d.std(ddof=1)) if np.ptp(d) > 0 else float("inf") * np.sign(mean)
    values = mean, low, high, test.statistic, test.pvalue, d_z, above
    return dict(zip(COMPARED, map(float, values), strict=True))


def holm(p: Sequence[float]) -> np.ndarray:
    """Return p-values corrected for their number.

    Parameters
    ----------
    p : (n,) p-values; NaN stays NaN and counts for nothing.

    References
    ----------
    Holm 1979, Scandinavian Journal of Statistics 6.
    """
    from statsmodels.stats.multitest import multipletests

    values = np.asarray(p, float)
    # a test that could not be made is none of the family's
    finite, corrected = np.isfinite(values), np.full(len(values), np.nan)
    if finite.any():
        corrected[finite] = multipletests(values[finite], method="holm")[1]
    return corrected


def _by_seed(flights: pd.DataFrame, condition: str, metric: str) -> pd.Series:
    return flights.loc[flights["condition"] == condition].set_index("seed")[metric]


def means(flights: pd.DataFrame, metrics: Iterable[str]) -> pd.DataFrame:
    """Return the mean of every metric in every condition.

    Parameters
    ----------
    flights : a row a flight: ``condition``, ``seed`` and the metrics.
    metrics : columns of ``flights``.

    Returns
    -------
    A row a metric and condition: ``metric``, ``condition``, ``seeds`` (how many), ``mean``, ``sd``
    (between seeds), ``mean_low`` and ``mean_high``.
    """
    rows = []
    for metric in metrics:
        for condition in flights["condition"].unique():
            values = _by_seed(flights, condition, metric).dropna().to_numpy()
            low, high = mean_interval(values)
            sd = float(values.std(ddof=1)) if len(values) > 1 else float("nan")
            mean = float(values.mean()) if len(values) else float("nan")
            rows.append((metric, condition, len(values), mean, sd, low, high))
    return pd.DataFrame(
        rows, columns=["metric", "condition", "seeds", "mean", "sd", "mean_low", "mean_high"]
    )


def contrasts(
    flights: pd.DataFrame, metrics: Iterable[str], pairs: Iterable[tuple[str, str]]
) -> pd.DataFrame:
    """Return paired differences of pairs of conditions in every metric.

    Parameters
    ----------
    flights : a row a flight: ``condition``, ``seed`` and the metrics.
    metrics : columns of ``flights``.
    pairs : (condition, reference).

    Returns
    -------
    A row a metric and pair: ``metric``, ``condition``, ``reference``, ``pairs`` (seeds with both),
    the keys of :func:`difference`, and ``p_holm`` over the whole table.
    """
    rows, pairs = [], list(pairs)
    for metric in metrics:
        for condition, reference in pairs:
            sides = [_by_seed(flights, name, metric) for name in (condition, reference)]
            # paired by seed, not by row; a seed without a number on one side is no pair
            both = pd.concat(sides, axis=1, join="inner").dropna().to_numpy()
            contrast = difference(both[:, 0], both[:, 1])
            rows.append(
                {
                    "metric": metric,
                    "condition": condition,
                    "reference": reference,
                    "pairs": len(both),
                    **contrast,
                }
            )
    table = pd.DataFrame(rows)
    return table.assign(p_holm=holm(table["p"])) if rows else table


def compare(flights: pd.DataFrame, metrics: Iterable[str], reference: str) -> pd.DataFrame:
    """Return means of every condition beside its paired difference from a reference.

    Parameters
    ----------
    flights : a row a flight: ``condition``, ``seed`` and the metrics.
    metrics : columns of ``flights``.
    reference : condition that the others are compared with.

    Returns
    -------
    Columns of :func:`means` and :func:`contrasts`; those of the latter are NaN for the reference.
    """
    metrics, names = list(metrics), [c for c in flights["condition"].unique() if c != reference]
    differences = contrasts(flights, metrics, [(name, reference) for name in names])
    table = means(flights, metrics)
    # left: the reference has a mean and no difference from itself
    return table.merge(differences, on=["metric", "condition"], how="left") if names else table
