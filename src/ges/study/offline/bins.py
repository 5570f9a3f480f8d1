"""Errors by ground and by clearance, from the predictions that Table 1 scores (seed-wise split).

``results/offline/ground_quartiles.csv`` begins with

- ``plan`` and ``model``;
- ``quantity`` (slope: tangent of the angle; curvature: size of the Laplacian) and ``unit``;
- ``quartile``, 1 to 4 over the test rows of the plan, and its edges ``low`` and ``high``.

``results/offline/clearance_bins.csv`` begins with ``plan``, ``model``, ``clearance_low_m`` and
``clearance_high_m`` (reading of the rangefinder). Both go on with

- ``rows``, ``share`` (of the test rows) and ``seeds``;
- ``rmse``, ``mae`` and ``r2``, each with ``_low`` and ``_high`` (95 % over seeds);
- ``mae_reduction``, the share by which the mean absolute error is below the analytical model's,
  with its interval.

Bins without rows are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from ges.files import write_csv
from ges.study.config import TerrainShape
from ges.study.datasets.ground import ground_of
from ges.study.models.scores import reduction, scores

BASE = "analytical"


def _predictions(files: list[Path]) -> pd.DataFrame:
    """Return predictions of one plan side by side: keys, truth and a column a model.

    All models have the same rows.
    """
    tables = {Path(f).name.split(".")[0]: pd.read_parquet(f) for f in files}
    # columns of one table are compared row by row, so the rows have to be the same
    first = tables[BASE]
    for name, table in tables.items():
        assert table[["seed", "row"]].equals(first[["seed", "row"]]), (
            f"{name} was scored on other rows than {BASE}"
        )
    return first.drop(columns="predicted").assign(
        **{f"by_{name}": t["predicted"] for name, t in tables.items()}
    )


def _scored(rows: pd.DataFrame, of: int, resamples: int, seed: int) -> Iterator[dict]:
    """Scores of every model on some rows."""
    counts = {"rows": len(rows), "share": len(rows) / of, "seeds": rows["seed"].nunique()}
    base = rows[f"by_{BASE}"]
    for column in [c for c in rows if c.startswith("by_")]:
        one = (rows["truth"].to_numpy(), rows[column].to_numpy())
        # the same draws of seeds for model and base: what is common to both leaves the interval
        saved = reduction(*one, base.to_numpy(), rows["seed"], resamples, seed)
        yield {
            "model": column[3:],
            **counts,
            **scores(*one, rows["seed"], resamples, seed),
            **saved,
        }


def _write(table: Path, rows: list[dict], first: list[str]) -> None:
    frame = pd.DataFrame(rows)
    write_csv(table, frame[[*first, *(c for c in frame if c not in first)]], digits=6)


def _irregularity(rows: pd.DataFrame, terrain: TerrainShape) -> pd.DataFrame:
    """Slope and size of the curvature under each row, from the numpy terrain."""
    slope, curvature = np.empty(len(rows)), np.empty(len(rows))
    for seed, index in rows.groupby("seed").indices.items():
        # slope and curvature are not recorded: the port gives those that were flown over
        ground = ground_of(int(seed), terrain).at(
            rows["p_x_m"].to_numpy()[index], rows["p_y_m"].to_numpy()[index]
        )
        slope[index], curvature[index] = ground.slope, np.abs(ground.curvature_1_m)
    return pd.DataFrame({"slope": slope, "curvature": curvature})


def write_ground_quartiles(
    predictions: list[Path],
    plan: str,
    terrain: TerrainShape,
    resamples: int,
    seed: int,
    table: Path,
) -> None:
    """Write the errors of every model by quartile of slope and of curvature.

    Parameters
    ----------
    predictions : of all models on the same rows; each file is named after its model.
    plan : flight plan, for the table.
    terrain : shape of the terrain.
    resamples : draws of seeds behind an interval.
    seed : of the draws.
    table : to write, see the module.
    """
    rows = _predictions(predictions)
    scored, units = [], {"slope": "1", "curvature": "1/m"}
    for quantity, values in _irregularity(rows, terrain).items():
        # edges from all test rows of the plan, so each quartile has a fourth of what is scored
        edges = np.quantile(values, [0, 0.25, 0.5, 0.75, 1])
        # a value on an edge belongs to the quartile below
        quartile = np.clip(np.searchsorted(edges[1:-1], values, side="left") + 1, 1, 4)
        for q in range(1, 5):
            where = {"plan": plan, "quantity": quantity, "unit": units[quantity], "quartile": q}
            where |= {"low": edges[q - 1], "high": edges[q]}
            scored += [
                {**where, **r} for r in _scored(rows[quartile == q], len(rows), resamples, seed)
            ]
    _write(table, scored, ["plan", "model", "quantity", "unit", "quartile", "low", "high"])


def write_clearance_bins(
    predictions: list[Path], plan: str, edges_m: list[float], resamples: int, seed: int, table: Path
) -> None:
    """Write the errors of every model by reading of the rangefinder.

    Parameters
    ----------
    predictions : of all models on the same rows; each file is named after its model.
    plan : flight plan, for the table.
    edges_m : of the bins, rising.
    resamples : draws of seeds behind an interval.
    seed : of the draws.
    table : to write, see the module.
    """
    rows = _predictions(predictions)
    scored = []
    for low, high in zip(edges_m[:-1], edges_m[1:], strict=True):
        inside = rows[(rows["range_m"] >= low) & (rows["range_m"] < high)]
        where = {"plan": plan, "clearance_low_m": low, "clearance_high_m": high}
        scored += (
            [{**where, **r} for r in _scored(inside, len(rows), resamples, seed)]
            if len(inside)
            else []
        )
    _write(table, scored, ["plan", "model", "clearance_low_m", "clearance_high_m"])
