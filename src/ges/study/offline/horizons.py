"""Horizon sweep: the analytical baseline and a random forest predict from 0 to 500 ms ahead.

``results/offline/horizons.csv``: ``plan, model`` (analytical, random_forest), ``horizon_s``;
``rmse, mae, r2``, each with ``_low`` and ``_high`` (95 % over seeds); ``train_rows, test_rows,
test_seeds``. Seed-wise split; every horizon is scored on the same rows, those that the longest one
allows.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from ges.files import write_csv
from ges.study.config import ForestFit, Quadrotor, Window
from ges.study.datasets.rows import RowWindow, load_rows
from ges.study.models import zoo
from ges.study.models.scores import scores

MODELS = ("analytical", "random_forest")


def sweep_horizons(
    flights: Path,
    split: Path,
    plan: str,
    horizons_s: list[float],
    fit: ForestFit,
    sweep_rows: int,
    window: Window,
    vehicle: Quadrotor,
    rate_hz: float,
    test_rows: int | None,
    resamples: int,
    seed: int,
    table: Path,
) -> None:
    """Fit and score formula and forest at every horizon.

    Parameters
    ----------
    flights, split : report of the leakage check, which names the flights, and the blocks.
    plan : flight plan, for the table.
    horizons_s : how far ahead the factor is predicted.
    fit : the forest's part of the configuration.
    sweep_rows : cap on training rows.
    window : of which only the reach into the past counts: it decides the rows.
    vehicle : airframe of the analytical baseline.
    rate_hz : rows a second.
    test_rows : cap on rows; None takes all.
    resamples : draws of seeds behind an interval.
    seed : of rows, training and draws.
    table : to write, see the module.
    """
    rows = []
    for horizon_s in horizons_s:
        # the reserve of the longest, or short ones would also have rows nearer to a block's end
        shape = RowWindow.of(window, rate_hz, horizon_s, max(horizons_s))
        train = load_rows(flights, split, "train", shape, sweep_rows, seed, past=False)
        test = load_rows(flights, split, "test", shape, test_rows, seed, past=False)
        for name in MODELS:
            learned = train if name == "random_forest" else None
            model = zoo.fitted(name, zoo.make(name, fit, window, vehicle, seed), learned, None)
            predicted = model.predict(zoo.features(name, test))
            metrics = scores(test.y, predicted, test.seed, resamples, seed)
            counts = {
                "train_rows": len(learned or ()),
                "test_rows": len(test),
                "test_seeds": len(set(test.seed)),
            }
            rows.append({"plan": plan, "model": name, "horizon_s": horizon_s, **metrics, **counts})
    write_csv(table, pd.DataFrame(rows), digits=6)
