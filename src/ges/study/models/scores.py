"""Errors of predictions, with intervals over seeds: rows of one flight are no independent draws,
flights are.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.stats import bootstrap

NAMES = ("rmse", "mae", "r2")
CONFIDENCE = 0.95


def _sums(truth: np.ndarray, predicted: np.ndarray, seed: np.ndarray) -> np.ndarray:
    """Return rows and sums of each seed, (seeds, 5).

    The sums are of y, of y^2, of squared and of absolute error, with y less its overall mean.
    """
    y = truth.astype(float) - truth.mean(dtype=float)
    error = predicted.astype(float) - truth.astype(float)
    # y about its mean, or yy - y^2 / n of a factor near 1 would be a small rest of large numbers
    table = pd.DataFrame({"n": 1.0, "y": y, "yy": y**2, "ee": error**2, "e": np.abs(error)})
    return table.groupby(np.asarray(seed)).sum().to_numpy()


def _pooled(sums: np.ndarray, which: str) -> np.ndarray:
    """Score of all rows of the drawn seeds together; sums (..., seeds, 5)."""
    # rows, not seeds, count alike: the score is that of one table of all drawn rows
    n, y, yy, ee, e = np.moveaxis(sums.sum(axis=-2), -1, 0)
    if which == "r2":
        # variance about the mean of the drawn rows, not of all
        return 1.0 - ee / (yy - y**2 / n)
    return np.sqrt(ee / n) if which == "rmse" else e / n


def scores(
    truth: np.ndarray, predicted: np.ndarray, seed: np.ndarray, resamples: int, draw: int
) -> dict[str, float]:
    """Return RMSE, MAE and R^2 over all rows, with their intervals.

    Parameters
    ----------
    truth, predicted, seed : (n,) target, prediction and flight of each row.
    resamples : draws of seeds; fewer than two seeds leave the interval undefined.
    draw : seed of the draws.

    Returns
    -------
    ``rmse``, ``rmse_low``, ``rmse_high`` and so on; 95 % intervals of drawing flights anew.
    """
    sums = _sums(truth, predicted, seed)
    result: dict[str, float] = {}
    for name in NAMES:
        result |= _with_interval(
            name, sums, functools.partial(_pooled, which=name), resamples, draw
        )
    return result


def reduction(
    truth: np.ndarray,
    predicted: np.ndarray,
    base: np.ndarray,
    seed: np.ndarray,
    resamples: int,
    draw: int,
) -> dict[str, float]:
    """Return the share by which the mean absolute error is below that of a base.

    Parameters
    ----------
    truth, predicted, base, seed : (n,) target, both predictions and flight of each row.
    resamples : draws of seeds.
    draw : seed of the draws.

    Returns
    -------
    ``mae_reduction``, ``mae_reduction_low`` and ``mae_reduction_high`` (95 % over flights).
    """
    errors = pd.DataFrame({"ours": np.abs(predicted - truth), "base": np.abs(base - truth)}).astype(
        float
    )
    sums = errors.groupby(np.asarray(seed)).sum().to_numpy()
    return _with_interval("mae_reduction", sums, _share_saved, resamples, draw)


def _share_saved(sums: np.ndarray) -> np.ndarray:
    ours, base = np.moveaxis(sums.sum(axis=-2), -1, 0)
    return 1.0 - ours / base


def _with_interval(
    name: str, sums: np.ndarray, statistic: Callable, resamples: int, draw: int
) -> dict[str, float]:
    low = high = float("nan")
    if len(sums) > 1:
        # seeds are drawn with their sums, from which any score follows without the rows
        low, high = bootstrap(
            (np.arange(len(sums)),),
            lambda i, axis: statistic(sums[i]),
            n_resamples=resamples,
            batch=200,
            confidence_level=CONFIDENCE,
            method="percentile",
            rng=np.random.default_rng(draw),
        ).confidence_interval
    return {name: float(statistic(sums)), f"{name}_low": float(low), f"{name}_high": float(high)}
