"""Figures of the offline comparison: models, splits, horizons, importances, error by ground and by clearance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from . import style

PLAN_LABELS = {"published": "published plan (nearly standing)", "consistent": "consistent plan (cruising)"}
SPLIT_LABELS = {"seedwise": "seed-wise", "blockwise": "block-wise"}


def _dots(axes, table: pd.DataFrame, order: list[str], metric: str, number: int, label: str, of: int) -> None:
    """A row of dots with intervals, one a model, shifted so that series do not cover each other."""
    rows = table.set_index("model").reindex(order)
    place = np.arange(len(order)) + (number - (of - 1) / 2) * 0.24
    span = np.abs(rows[[f"{metric}_low", f"{metric}_high"]].to_numpy().T - rows[metric].to_numpy())
    axes.errorbar(rows[metric], place, xerr=span, fmt=style.MARKERS[number], color=style.COLOURS[number], lw=0.8, label=label)
    axes.set_yticks(np.arange(len(order)), [style.MODEL_LABELS[m] for m in order])


def models(table1: Path, data: Path, pdf: Path, png: Path) -> None:
    """RMSE of every model on held-out seeds, by flight plan (the paper's figure 6)."""
    table = pd.read_csv(table1).query("split == 'seedwise'")
    plans = list(dict.fromkeys(table["plan"]))
    order = list(table[table["plan"] == plans[0]].sort_values("rmse", ascending=False)["model"])
    figure, axes = style.subplots(height=2.9)
    for i, plan in enumerate(plans):
        _dots(axes, table[table["plan"] == plan], order, "rmse", i, PLAN_LABELS[plan], len(plans))
    axes.set(xscale="log", xlabel="RMSE of the factor on held-out seeds")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, 1.22))
    style.save(figure, table, data, pdf, png)


def splits(table1: Path, plan: str, data: Path, pdf: Path, png: Path) -> None:
    """RMSE and R^2 under both splits (the paper's figure 7)."""
    table = pd.read_csv(table1).query("plan == @plan")
    order = list(table[table["split"] == "blockwise"].sort_values("rmse", ascending=False)["model"])
    figure, (left, right) = style.subplots(1, 2, width=style.PAGE_IN, height=2.5, sharey=True)
    for i, (split, label) in enumerate(SPLIT_LABELS.items()):
        for axes, metric in ((left, "rmse"), (right, "r2")):
            _dots(axes, table[table["split"] == split], order, metric, i, label, 2)
    left.set(xscale="log", xlabel="RMSE of the factor")
    right.set(xlabel="$R^2$")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    style.panel(left, "a")
    style.panel(right, "b")
    style.save(figure, table, data, pdf, png)


def predicted(table1: Path, predictions: list[Path], plan: str, data: Path, pdf: Path, png: Path) -> None:
    """Prediction against truth of the best model of the block-wise split (the paper's figure 8)."""
    scores = pd.read_csv(table1).query("plan == @plan and split == 'blockwise'").set_index("model")["r2"]
    best = scores.idxmax()
    rows = pd.read_parquet(next(p for p in predictions if p.name.startswith(f"{best}.")))
    table = rows[["truth", "predicted"]].sample(min(len(rows), 4000), random_state=0).sort_index()
    figure, axes = style.subplots(height=2.6)
    axes.plot(table["truth"], table["predicted"], ".", ms=1.5, alpha=0.35, color=style.BLUE, rasterized=True)
    span = [table["truth"].min(), table["truth"].max()]
    axes.plot(span, span, color=style.BLACK, lw=0.7, ls="--")
    axes.set(xlabel="true factor", ylabel="predicted factor", title=f"{style.MODEL_LABELS[best]}, $R^2$ = {scores[best]:.4f}")
    style.save(figure, table, data, pdf, png)


def _band(axes, x, table: pd.DataFrame, name: str, number: int, label: str) -> None:
    axes.plot(x, table[name], style.LINES[number], marker=style.MARKERS[number], color=style.COLOURS[number], label=label)
    if f"{name}_low" in table:
        axes.fill_between(x, table[f"{name}_low"], table[f"{name}_high"], color=style.COLOURS[number], alpha=0.2, lw=0)
