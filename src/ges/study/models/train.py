"""One training job, and the table of all of them.

A job writes, beside each other under ``results/models/<plan>/<split>/training<seed>/``:

- ``<model>.predictions.parquet``: ``seed``, ``row``, ``truth`` and ``predicted`` (factor at the
  horizon) of every test row, with ``range_m`` (reading) and ``p_x_m``, ``p_y_m``, ``agl_m`` (true
  place) at the present;
- ``<model>.metrics.json``: plan, split, model, rows of each part, scores with intervals (null where
  one seed gives none);
- ``<model>.joblib``: the fitted model.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

from ges.files import replacing, write_csv, write_json
from ges.study.config import AnyFit, Quadrotor, Window
from ges.study.datasets.columns import FEATURES
from ges.study.datasets.rows import Rows, RowWindow, load_rows
from ges.study.datasets.split import PARTS
from ges.study.models import zoo
from ges.study.models.scores import NAMES, scores

PLACES = ("p_x_m", "p_y_m", "agl_m")


def train_model(
    flights: Path,
    split: Path,
    name: str,
    plan: str,
    kind: str,
    fit: AnyFit | None,
    window: Window,
    vehicle: Quadrotor,
    horizon_s: float,
    rate_hz: float,
    validation_rows: int | None,
    test_rows: int | None,
    resamples: int,
    seed: int,
    predictions: Path,
    metrics: Path,
    model: Path,
) -> None:
    """Fit one model to one split of one flight plan and score it on the test rows.

    Parameters
    ----------
    flights, split : report of the leakage check, which names the flights, and the blocks.
    name, plan, kind : model, flight plan and split.
    fit : the model's part of the configuration; a model that has none is fitted to no rows.
    window : window of the sequence models.
    vehicle : airframe of the analytical baseline.
    horizon_s : how far ahead the factor is predicted.
    rate_hz : rows a second.
    validation_rows, test_rows : caps on rows; None takes all.
    resamples : draws of seeds behind an interval.
    seed : of rows, training and draws.
    predictions, metrics, model : to write, see the module.
    """
    shape = RowWindow.of(window, rate_hz, horizon_s)
    caps = {"train": fit.train_rows, "validation": validation_rows} if fit else {}
    caps, past = caps | {"test": test_rows}, name in zoo.SEQUENCE_MODELS
    parts = {
        part: load_rows(flights, split, part, shape, most, seed, past)
        for part, most in caps.items()
    }
    made = zoo.fitted(
        name,
        zoo.make(name, fit, window, vehicle, seed),
        parts.get("train"),
        parts.get("validation"),
    )
    test = parts["test"]
    # scored as they are stored, so that scores can be made again from the file to the last bit
    predicted = made.predict(zoo.features(name, test)).astype(np.float32)
    _write_predictions(predictions, test, predicted)
    scored = scores(test.y, predicted, test.seed, resamples, seed)
    rows = {f"{part}_rows": len(parts.get(part, ())) for part in PARTS}
    # JSON has no NaN
    written = {key: value if math.isfinite(value) else None for key, value in scored.items()}
    write_json(
        metrics,
        {
            "plan": plan,
            "split": kind,
            "model": name,
            **rows,
            "test_seeds": len(set(test.seed)),
            **written,
        },
    )
    with replacing(model) as new:
        joblib.dump(made, new, compress=3)


def _write_predictions(path: Path, rows: Rows, predicted: np.ndarray) -> None:
    """Write predictions of rows beside the truth and the place."""
    table = {
        "seed": rows.seed.astype(np.int32),
        "row": rows.row.astype(np.int32),
        "truth": rows.y,
        "predicted": predicted,
    }
    table["range_m"] = rows.now[:, FEATURES.index("range_m")]
    frame = pd.DataFrame({**table, **{name: rows.places[name] for name in PLACES}})
    with replacing(path) as new:
        frame.to_parquet(new, compression="zstd", index=False)


def write_table1(metrics: list[Path], table: Path) -> None:
    """Write Table 1: every model on every split of every plan, best R^2 first.

    Parameters
    ----------
    metrics : files of :func:`train_model`; all models of a plan and split are scored on the same
        rows.
    table : to write: plan, split, model; rmse, mae, r2 each with ``_low`` and ``_high`` (95 % over
        seeds); and the counts of rows and test seeds.
    """
    columns = [
        "plan",
        "split",
        "model",
        *(f"{n}{end}" for n in NAMES for end in ("", "_low", "_high")),
        "train_rows",
        "validation_rows",
        "test_rows",
        "test_seeds",
    ]
    frame = pd.DataFrame([json.loads(Path(m).read_text()) for m in metrics])[columns]
    frame = frame.sort_values(
        ["plan", "split", "r2"], ascending=[False, False, False], kind="stable"
    )
    write_csv(table, frame, digits=6)
