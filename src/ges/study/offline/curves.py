"""Learning curves: what more training rows would give, the ground for every cap on rows.

``results/offline/learning_curves.csv`` has

- ``plan``, ``model``, ``share`` (rows over the model's cap) and ``train_rows``;
- ``rmse``, ``mae`` and ``r2`` on the validation rows, each with ``_low`` and ``_high`` (95 % over
  seeds).

No test row is looked at.
"""

from __future__ import annotations

from pathlib import Path

import joblib
import pandas as pd

from ges.files import write_csv
from ges.study.config import AnyFit, Quadrotor, Window
from ges.study.datasets.rows import RowWindow, load_rows
from ges.study.models import zoo
from ges.study.models.scores import scores


def learning_curve(
    flights: Path,
    split: Path,
    at_cap: Path,
    name: str,
    plan: str,
    fit: AnyFit,
    shares: list[float],
    window: Window,
    vehicle: Quadrotor,
    horizon_s: float,
    rate_hz: float,
    validation_rows: int | None,
    resamples: int,
    seed: int,
    table: Path,
) -> None:
    """Fit a model to shares of its cap on rows, and score it on the validation rows.

    Parameters
    ----------
    flights, split : report of the leakage check, which names the flights, and the blocks.
    at_cap : the model of Table 1, fitted to the very rows of share 1, and not fitted again.
    name, plan : model and flight plan.
    fit : the model's part of the configuration; without a cap on rows it has its whole row set
        only.
    shares : rows over the cap.
    window : window of the sequence models.
    vehicle : airframe of the analytical baseline.
    horizon_s : how far ahead the factor is predicted.
    rate_hz : rows a second.
    validation_rows : cap on rows; None takes all.
    resamples : draws of seeds behind an interval.
    seed : of rows, training and draws.
    table : to write, see the module.
    """
    shape = RowWindow.of(window, rate_hz, horizon_s)
    past = name in zoo.SEQUENCE_MODELS
    # stopping and the choice of the best pass look at these rows, too, at every share alike
    validation = load_rows(flights, split, "validation", shape, validation_rows, seed, past)
    rows = []
    for share in shares if fit.train_rows else [1.0]:
        most = round(share * fit.train_rows) if fit.train_rows else None
        train = load_rows(flights, split, "train", shape, most, seed, past)
        if share == 1:
            model = joblib.load(at_cap)
        else:
            model = zoo.fitted(name, zoo.make(name, fit, window, vehicle, seed), train, validation)
        metrics = scores(
            validation.y,
            model.predict(zoo.features(name, validation)),
            validation.seed,
            resamples,
            seed,
        )
        rows.append(
            {"plan": plan, "model": name, "share": share, "train_rows": len(train), **metrics}
        )
    write_csv(table, pd.DataFrame(rows), digits=6)
