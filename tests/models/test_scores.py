"""Scores are scikit-learn's, intervals come from seeds, and R^2 ranks models as RMSE does on one
row set.
"""

import numpy as np
import pandas as pd
import pytest
from sklearn import metrics

from ges.study.models.scores import reduction, scores
from ges.study.models.train import write_table1

RNG = np.random.default_rng(5)
SEED = np.repeat(np.arange(12), 50)
TRUTH = RNG.normal(1.0, 0.03, SEED.size) + 0.02 * RNG.normal(size=12)[SEED]
PREDICTED = TRUTH + RNG.normal(0.0, 0.01, SEED.size)


def test_scores_are_those_of_scikit_learn():
    found = scores(TRUTH, PREDICTED, SEED, 100, 1)
    assert found["rmse"] == pytest.approx(
        metrics.root_mean_squared_error(TRUTH, PREDICTED), rel=1e-12
    )
    assert found["mae"] == pytest.approx(metrics.mean_absolute_error(TRUTH, PREDICTED), rel=1e-12)
    assert found["r2"] == pytest.approx(metrics.r2_score(TRUTH, PREDICTED), rel=1e-12)


def test_intervals_hold_the_score_and_grow_when_seeds_differ():
    same = scores(TRUTH, PREDICTED, SEED, 500, 1)
    uneven = scores(TRUTH, TRUTH + (1 + SEED % 3 * 3) * (PREDICTED - TRUTH), SEED, 500, 1)
    for found in (same, uneven):
        assert all(found[f"{n}_low"] < found[n] < found[f"{n}_high"] for n in ("rmse", "mae", "r2"))
    width = [(f["rmse_high"] - f["rmse_low"]) / f["rmse"] for f in (same, uneven)]
    assert width[1] > 2 * width[0]


def test_more_rows_of_the_same_seeds_are_no_more_evidence():
    """Each row ten times over: an interval over rows would shrink by three, one over seeds
    stays.
    """
    once, often = (
        scores(*(np.tile(a, k) for a in (TRUTH, PREDICTED, SEED)), 500, 1) for k in (1, 10)
    )
    assert often["mae_high"] - often["mae_low"] == pytest.approx(
        once["mae_high"] - once["mae_low"], rel=1e-6
    )


def test_one_seed_has_no_interval():
    assert np.isnan(scores(TRUTH, PREDICTED, np.zeros(SEED.size), 100, 1)["rmse_low"])


def test_reduction():
    found = reduction(TRUTH, TRUTH + 0.5 * (PREDICTED - TRUTH), PREDICTED, SEED, 100, 1)
    assert found["mae_reduction"] == pytest.approx(0.5)


def test_table1_ranks_alike(tmp_path):
    rows = {
        "plan": "published",
        "split": "seedwise",
        "train_rows": 9,
        "validation_rows": 9,
        "test_rows": 600,
        "test_seeds": 12,
    }
    files = []
    for i, noise in enumerate((0.02, 0.005, 0.01)):
        found = scores(TRUTH, TRUTH + noise * RNG.normal(size=SEED.size), SEED, 100, 1)
        files.append(tmp_path / f"{i}.json")
        pd.Series({**rows, "model": f"model{i}", **found}).to_json(files[-1])
    write_table1(files, tmp_path / "table1.csv")
    table = pd.read_csv(tmp_path / "table1.csv")
    assert list(table["model"]) == ["model1", "model2", "model0"]
    assert table["rmse"].is_monotonic_increasing and table["r2"].is_monotonic_decreasing
