"""Intervals, paired differences and Holm's correction against scipy and worked numbers."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from ges.study.stats import paired


@pytest.fixture
def pairs():
    rng = np.random.default_rng(3)
    b = rng.normal(0.06, 0.01, 30)
    return b + rng.normal(0.001, 0.002, 30), b


def test_difference_is_the_paired_t_test(pairs):
    found, test = paired.difference(*pairs), stats.ttest_rel(*pairs)
    low, high = test.confidence_interval(0.95)
    assert (found["t"], found["p"]) == pytest.approx((test.statistic, test.pvalue))
    assert (found["low"], found["high"]) == pytest.approx((low, high))
    d = pairs[0] - pairs[1]
    assert found["d_z"] == pytest.approx(d.mean() / d.std(ddof=1))
    assert found["above"] == (pairs[0] > pairs[1]).mean()
    assert found["t"] == pytest.approx(found["d_z"] * np.sqrt(30))


def test_equal_conditions_differ_by_nothing(pairs):
    found = paired.difference(pairs[1], pairs[1])
    assert found == {
        "difference": 0.0,
        "low": 0.0,
        "high": 0.0,
        "t": 0.0,
        "p": 1.0,
        "d_z": 0.0,
        "above": 0.0,
    }


def test_one_pair_has_no_interval():
    found = paired.difference(np.array([2.0]), np.array([1.0]))
    assert found["difference"] == 1.0 and np.isnan(found["p"]) and np.isnan(found["low"])


def test_holm_by_hand():
    assert paired.holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert np.isnan(paired.holm([0.01, np.nan])[1]) and paired.holm([0.01, np.nan])[
        0
    ] == pytest.approx(0.01)


def test_bootstrap_interval_covers():
    """Of 500 samples of 30 from a known mean, the interval holds it in the 93.5 % that a percentile
    bootstrap of 30 reaches.
    """
    rng = np.random.default_rng(7)
    inside = [
        low <= 5.0 <= high
        for low, high in (paired.mean_interval(rng.normal(5.0, 2.0, 30)) for _ in range(500))
    ]
    assert 0.91 <= np.mean(inside) <= 0.97


def test_compare_joins_pairs_by_seed_and_not_by_row():
    rng = np.random.default_rng(1)
    seeds, level = np.arange(10), rng.normal(0, 1, 10)
    tables = [pd.DataFrame({"condition": "a", "seed": seeds, "x": level})]
    mixed = rng.permutation(10)
    tables.append(
        pd.DataFrame(
            {
                "condition": "b",
                "seed": seeds[mixed],
                "x": level[mixed] + 0.5 + 1e-3 * rng.normal(size=10),
            }
        )
    )
    table = paired.compare(pd.concat(tables), ["x"], "a").set_index("condition")
    assert (
        table.loc["b", "difference"] == pytest.approx(0.5, abs=1e-3)
        and table.loc["b", "high"] < 0.51
    )
    assert table.loc["b", "pairs"] == 10 and np.isnan(table.loc["a", "difference"])


def test_contrasts_correct_over_the_whole_table(pairs):
    table = pd.concat(
        [
            pd.DataFrame({"condition": name, "seed": range(30), "x": values, "y": values[::-1]})
            for name, values in zip("ab", pairs, strict=True)
        ]
    )
    found = paired.contrasts(table, ["x", "y"], [("a", "b")])
    assert (
        list(found["p_holm"]) == pytest.approx(list(paired.holm(found["p"])))
        and (found["p_holm"] >= found["p"]).all()
    )
