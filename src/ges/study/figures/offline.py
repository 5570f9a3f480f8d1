"""Figures of the offline comparison: models, splits, horizons, importances, error by ground and by
clearance.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ges.study.figures import style

PLAN_LABELS = {
    "published": "published plan (nearly standing)",
    "consistent": "consistent plan (cruising)",
}
SPLIT_LABELS = {"seedwise": "seed-wise", "blockwise": "block-wise"}


def _dots(
    axes: Axes, table: pd.DataFrame, order: list[str], metric: str, number: int, label: str, of: int
) -> None:
    """A row of dots with intervals, one a model, shifted so that series do not cover each other."""
    rows = table.set_index("model").reindex(order)
    place = np.arange(len(order)) + (number - (of - 1) / 2) * 0.24
    span = np.abs(rows[[f"{metric}_low", f"{metric}_high"]].to_numpy().T - rows[metric].to_numpy())
    axes.errorbar(
        rows[metric],
        place,
        xerr=span,
        fmt=style.MARKERS[number],
        color=style.COLOURS[number],
        lw=0.8,
        label=label,
    )
    axes.set_yticks(np.arange(len(order)), [style.MODEL_LABELS[m] for m in order])


def models(table1: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the RMSE of every model on held-out seeds, by flight plan (the paper's figure 6).

    Parameters
    ----------
    table1 : of :func:`ges.study.models.train.write_table1`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(table1).query("split == 'seedwise'")
    plans = list(dict.fromkeys(table["plan"]))
    order = list(table[table["plan"] == plans[0]].sort_values("rmse", ascending=False)["model"])
    figure, axes = style.subplots(height=2.9)
    for i, plan in enumerate(plans):
        _dots(axes, table[table["plan"] == plan], order, "rmse", i, PLAN_LABELS[plan], len(plans))
    axes.set(xscale="log", xlabel="RMSE of the factor on held-out seeds")
    style.log_ticks(axes.xaxis)
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, 1.22))
    style.save(figure, table, data, pdf, png)


def splits(table1: Path, plan: str, data: Path, pdf: Path, png: Path) -> None:
    """Draw RMSE and R^2 under both splits (the paper's figure 7).

    Parameters
    ----------
    table1 : of :func:`ges.study.models.train.write_table1`.
    plan : flight plan that is shown.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(table1).query("plan == @plan")
    order = list(table[table["split"] == "blockwise"].sort_values("rmse", ascending=False)["model"])
    figure, (left, right) = style.subplots(1, 2, width=style.PAGE_IN, height=2.5, sharey=True)
    for i, (split, label) in enumerate(SPLIT_LABELS.items()):
        for axes, metric in ((left, "rmse"), (right, "r2")):
            _dots(axes, table[table["split"] == split], order, metric, i, label, 2)
    left.set(xscale="log", xlabel="RMSE of the factor")
    style.log_ticks(left.xaxis)
    right.set(xlabel="$R^2$")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    style.panels(left, right)
    style.save(figure, table, data, pdf, png)


def predicted(
    table1: Path, predictions: list[Path], plan: str, data: Path, pdf: Path, png: Path
) -> None:
    """Draw prediction against truth of the best model of a split (the paper's figure 8).

    Parameters
    ----------
    table1 : of :func:`ges.study.models.train.write_table1`.
    predictions : of all models on the block-wise split; each file is named after its model.
    plan : flight plan that is shown.
    data, pdf, png : to write: at most 4000 rows, and the figure.
    """
    scores = (
        pd.read_csv(table1).query("plan == @plan and split == 'blockwise'").set_index("model")["r2"]
    )
    best = scores.idxmax()
    rows = pd.read_parquet(next(p for p in predictions if p.name.startswith(f"{best}.")))
    table = rows[["truth", "predicted"]].sample(min(len(rows), 4000), random_state=0).sort_index()
    figure, axes = style.subplots(height=2.6)
    axes.plot(
        table["truth"],
        table["predicted"],
        ".",
        ms=1.5,
        alpha=0.35,
        color=style.BLUE,
        rasterized=True,
    )
    span = [table["truth"].min(), table["truth"].max()]
    axes.plot(span, span, color=style.BLACK, lw=0.7, ls="--")
    axes.set(
        xlabel="true factor",
        ylabel="predicted factor",
        title=f"{style.MODEL_LABELS[best]}, $R^2$ = {scores[best]:.4f}",
    )
    style.save(figure, table, data, pdf, png)


def _band(
    axes: Axes, x: pd.Series, table: pd.DataFrame, name: str, number: int, label: str
) -> None:
    axes.plot(
        x,
        table[name],
        style.LINES[number],
        marker=style.MARKERS[number],
        color=style.COLOURS[number],
        label=label,
    )
    if f"{name}_low" in table:
        axes.fill_between(
            x,
            table[f"{name}_low"],
            table[f"{name}_high"],
            color=style.COLOURS[number],
            alpha=0.2,
            lw=0,
        )


SHOWN = {"analytical": "analytical", "random_forest": "random forest"}


def _panels(table: pd.DataFrame, height: float) -> tuple:
    """A panel for each flight plan of a table."""
    plans = [p for p in PLAN_LABELS if p in set(table["plan"])]
    figure, axes = style.subplots(1, len(plans), width=style.PAGE_IN, height=height, squeeze=False)
    for ax, plan, letter in zip(axes[0], plans, "ab", strict=False):
        ax.set_title(f"({letter}) {PLAN_LABELS[plan]}", loc="left")
    return figure, dict(zip(plans, axes[0], strict=True))


def _legend(figure: Figure, axes: Axes) -> None:
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)


def horizons(horizons: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw R^2 of formula and forest against the horizon (the paper's figure 9).

    Parameters
    ----------
    horizons : of :func:`ges.study.offline.horizons.sweep_horizons`.
    data, pdf, png : to write: the table, and the figure.
    """
    table = pd.read_csv(horizons).sort_values(
        ["plan", "model", "horizon_s"], ascending=[False, True, True]
    )
    figure, panels = _panels(table, 2.3)
    for plan, ax in panels.items():
        for i, (model, label) in enumerate(SHOWN.items()):
            rows = table[(table["plan"] == plan) & (table["model"] == model)]
            _band(ax, 1000 * rows["horizon_s"], rows, "r2", i, label)
        ax.set(xlabel="horizon (ms)", ylabel="$R^2$ on held-out seeds")
    _legend(figure, ax)
    style.save(figure, table, data, pdf, png)


FEATURE_LABELS = {"range_m": "range", "thrust_command": "thrust command"}


def _feature(name: str) -> str:
    plain = (
        name.replace("_rad_s", "").replace("_A", "").replace("rpm", "rotor speed").replace("_", " ")
    )
    return FEATURE_LABELS.get(name, plain)


def importances(importances: Path, plan: str, data: Path, pdf: Path, png: Path) -> None:
    """Draw both importances of the forest's features (the paper's figure 10).

    Parameters
    ----------
    importances : of :func:`ges.study.offline.importances.write_importances`.
    plan : flight plan that is shown.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(importances).query("plan == @plan").sort_values("permutation")
    figure, (left, right) = style.subplots(1, 2, height=2.8, sharey=True)
    places = range(len(table))
    left.barh(places, table["impurity"], color=style.BLUE)
    right.barh(places, table["permutation"], color=style.RED)
    left.set_yticks(places, [_feature(f) for f in table["feature"]])
    left.set(xlabel="impurity\n(share)")
    right.set(xlabel="permutation\n(fall of $R^2$)")
    style.save(figure, table, data, pdf, png)


def ground_quartiles(quartiles: Path, quantity: str, data: Path, pdf: Path, png: Path) -> None:
    """Draw the error by quartile of slope or curvature (the paper's figures 11 and 12).

    Parameters
    ----------
    quartiles : of :func:`ges.study.offline.bins.write_ground_quartiles`.
    quantity : 'slope' or 'curvature'.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(quartiles)
    table = table[(table["quantity"] == quantity) & table["model"].isin(SHOWN)]
    figure, panels = _panels(table, 2.2)
    for plan, ax in panels.items():
        for i, (model, label) in enumerate(SHOWN.items()):
            rows = table[(table["plan"] == plan) & (table["model"] == model)]
            span = [rows["mae"] - rows["mae_low"], rows["mae_high"] - rows["mae"]]
            ax.errorbar(
                rows["quartile"] + 0.12 * (i - 0.5),
                rows["mae"],
                span,
                fmt=style.MARKERS[i],
                color=style.COLOURS[i],
                label=label,
            )
        unit = "" if rows["unit"].iloc[0] == "1" else f" ({rows['unit'].iloc[0]})"
        labels = [f"{round(r.low, 4):.2g} to\n{r.high:.2g}" for r in rows.itertuples()]
        ax.set_xticks(rows["quartile"], labels)
        ax.set(
            xlabel=f"quartiles of {quantity}{unit}", ylabel="mean absolute error", ylim=(0, None)
        )
    _legend(figure, ax)
    style.save(figure, table, data, pdf, png)


LEAST_SHARE = 0.001
"""Bins with a smaller share of the test rows are not shown."""


def _middle(table: pd.DataFrame) -> pd.Series:
    return (table["clearance_low_m"] + table["clearance_high_m"]) / 2


def clearance(bins: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the error against clearance, with the share of test rows (the paper's figure 13).

    Parameters
    ----------
    bins : of :func:`ges.study.offline.bins.write_clearance_bins`.
    data, pdf, png : to write: bins of at least :data:`LEAST_SHARE`, and the figure.
    """
    table = pd.read_csv(bins).query("share >= @LEAST_SHARE")
    table = table[table["model"].isin(SHOWN)]
    figure, panels = _panels(table, 2.4)
    for plan, ax in panels.items():
        for i, (model, label) in enumerate(SHOWN.items()):
            rows = table[(table["plan"] == plan) & (table["model"] == model)]
            _band(ax, _middle(rows), rows, "mae", i, label)
        share = ax.twinx()
        width = rows["clearance_high_m"] - rows["clearance_low_m"]
        share.bar(
            _middle(rows),
            100 * rows["share"],
            width,
            color="#dddddd",
            zorder=0,
            edgecolor="white",
            linewidth=0.5,
        )
        # Bars keep to the lower third, and a share has no ticks above all rows.
        share.set(ylabel="test rows (%)", ylim=(0, 300 * rows["share"].max()))
        share.set_yticks([tick for tick in share.get_yticks() if tick <= 100])
        share.grid(False)
        ax.set_zorder(share.get_zorder() + 1)
        ax.patch.set_visible(False)
        ax.set(xlabel="rangefinder reading (m)", ylabel="mean absolute error", yscale="log")
        style.log_ticks(ax.yaxis)
    _legend(figure, ax)
    style.save(figure, table, data, pdf, png)


def reduction(bins: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw how much less the forest errs than the formula (the paper's figure 14).

    Parameters
    ----------
    bins : of :func:`ges.study.offline.bins.write_clearance_bins`.
    data, pdf, png : to write: bins of at least :data:`LEAST_SHARE`, and the figure.
    """
    table = pd.read_csv(bins).query("model == 'random_forest' and share >= @LEAST_SHARE")
    figure, axes = style.subplots(height=2.3)
    for i, plan in enumerate(p for p in PLAN_LABELS if p in set(table["plan"])):
        rows = table[table["plan"] == plan]
        percent = rows[["mae_reduction", "mae_reduction_low", "mae_reduction_high"]] * 100
        _band(axes, _middle(rows), percent, "mae_reduction", i, PLAN_LABELS[plan])
    axes.axhline(0, color=style.BLACK, lw=0.6)
    axes.set(
        xlabel="rangefinder reading (m)",
        ylabel="reduction of the mean\nabsolute error (%)",
        ylim=(-60, 100),
    )
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center")
    style.save(figure, table, data, pdf, png)


def learning_curves(curves: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the validation error of every model against its training rows.

    Parameters
    ----------
    curves : of :func:`ges.study.offline.curves.learning_curve`.
    data, pdf, png : to write: the table, and the figure.
    """
    table = pd.read_csv(curves)
    figure, axes = style.subplots(height=2.9)
    for i, (model, rows) in enumerate(table.groupby("model", sort=False)):
        look = {"marker": style.MARKERS[i], "color": style.COLOURS[i], "ls": style.LINES[i % 4]}
        axes.plot(rows["train_rows"] / 1000, rows["rmse"], label=style.MODEL_LABELS[model], **look)
        cap = rows[rows["share"] == 1.0]
        axes.plot(
            cap["train_rows"] / 1000, cap["rmse"], "o", ms=8, mfc="none", color=style.COLOURS[i]
        )
    axes.set(
        xscale="log",
        xlabel="training rows (thousands; ring: the cap in use)",
        ylabel="RMSE of the factor on validation seeds",
    )
    style.log_ticks(axes.xaxis)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    style.save(figure, table, data, pdf, png)
