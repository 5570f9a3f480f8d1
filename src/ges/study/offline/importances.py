"""Which features the random forest relies on.

``results/offline/importances.csv`` has, for the forest of Table 1 on the seed-wise split,

- ``plan`` and ``feature``;
- ``impurity``, the share of the fall in variance over the splits on it;
- ``permutation``, the fall in R^2 when the feature is shuffled among the test rows;
- ``permutation_low`` and ``permutation_high``, the least and greatest of ``repeats`` shuffles;
- ``over_others``, its ratio to the greatest of the other features.
"""

from __future__ import annotations

from pathlib import Path

import joblib
import numpy as np
import pandas as pd
from sklearn.inspection import permutation_importance

from ges.files import write_csv
from ges.study.config import Window
from ges.study.datasets.columns import FEATURES
from ges.study.datasets.rows import RowWindow, load_rows


def write_importances(
    flights: Path,
    split: Path,
    model: Path,
    plan: str,
    window: Window,
    rate_hz: float,
    horizon_s: float,
    rows: int,
    repeats: int,
    seed: int,
    table: Path,
) -> None:
    """Write impurity and permutation importance of a fitted forest.

    Parameters
    ----------
    flights, split : report of the leakage check, which names the flights, and the blocks.
    model : the forest (joblib).
    plan : flight plan, for the table.
    window : of which only the reach into the past counts: it decides the rows.
    rate_hz : rows a second.
    horizon_s : how far ahead the factor is predicted.
    rows : cap on test rows.
    repeats : shuffles of each feature.
    seed : of rows and shuffles.
    table : to write, see the module.
    """
    forest = joblib.load(model)
    test = load_rows(
        flights, split, "test", RowWindow.of(window, rate_hz, horizon_s), rows, seed, past=False
    )
    # on test rows: impurity says what the trees split on in training, this what predictions need
    losses = permutation_importance(
        forest, test.now, test.y, n_repeats=repeats, random_state=seed, scoring="r2"
    ).importances
    mean = losses.mean(axis=1)
    others = [np.delete(mean, i).max() for i in range(len(mean))]
    # a few shuffles have no percentiles: least and greatest
    frame = pd.DataFrame(
        {
            "plan": plan,
            "feature": FEATURES,
            "impurity": forest.feature_importances_,
            "permutation": mean,
            "permutation_low": losses.min(axis=1),
            "permutation_high": losses.max(axis=1),
            "over_others": mean / others,
            "repeats": repeats,
        }
    )
    write_csv(table, frame, digits=6)
