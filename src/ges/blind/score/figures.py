"""Pictures of the scores: confusion matrix, share found by severity, calibration of stated
probabilities, outcomes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ges.study.figures import style

SEVERITIES = ("weak", "medium", "strong")
OUTCOMES = {
    "exact": style.BLUE,
    "hedged": style.SKY,
    "partial": style.GREEN,
    "nothing": "#dddddd",
    "unknown": style.YELLOW,
    "extra": style.ORANGE,
    "wrong": style.RED,
    "failed": style.BLACK,
}
# what is no name stands behind the names
LAST = ("true names", "true companion only", "nothing_proven", "ambiguous", "unknown", "failed")


def draw_all(out: Path, tables: Mapping[str, pd.DataFrame]) -> None:
    """Draw every figure beside its table: ``<name>.csv``, ``.pdf`` and ``.png``.

    Parameters
    ----------
    out : folder of the figures.
    tables : by the names of :func:`ges.blind.score.score.score_cases`.
    """
    drawn = {
        "confusion_matrix": (_draw_confusion, "confusion"),
        "detection": (_draw_detection, "singles"),
        "calibration": (_draw_calibration, "reliability"),
        "outcomes": (_draw_outcomes, "categories"),
        "detection_limit": (draw_limit, "cases"),
        "power": (draw_power, "power"),
    }
    for name, (draw, source) in drawn.items():
        figure = draw(tables[source]) if len(tables[source]) else _draw_nothing()
        style.save(
            figure, tables[source], *((out / name).with_suffix(s) for s in (".csv", ".pdf", ".png"))
        )


def _draw_nothing() -> Figure:
    """What stands in the place of a figure that no case has anything to show in."""
    figure, axes = style.subplots(height=0.8)
    axes.set_axis_off()
    axes.text(0.5, 0.5, "no case has anything to show here", ha="center", va="center")
    return figure


def _words(name: str) -> str:
    return name.replace("_", " ")


def _draw_confusion(table: pd.DataFrame) -> Figure:
    """Share of the cases of each row that got each answer."""
    rows = [
        *sorted(r for r in set(table["concealed"]) if r not in _GROUPS),
        *(g for g in _GROUPS if g in set(table["concealed"])),
    ]
    claims = set(table["answer"])
    columns = [*sorted(claims - set(LAST)), *(c for c in LAST if c in claims)]
    counts = table.pivot_table(
        index="concealed", columns="answer", values="cases", aggfunc="sum", fill_value=0
    )
    counts = counts.reindex(index=rows, columns=columns, fill_value=0).to_numpy(dtype=float)
    figure, axes = style.subplots(width=style.PAGE_IN, height=0.9 + 0.17 * len(rows))
    # colours are shares of a row, figures are counts
    axes.imshow(
        counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto"
    )
    for i, j in np.argwhere(counts > 0):
        dark = counts[i, j] / counts[i].sum() > 0.5
        axes.text(
            j,
            i,
            f"{counts[i, j]:.0f}",
            ha="center",
            va="center",
            fontsize=6,
            color="white" if dark else "black",
        )
    axes.set_xticks(
        range(len(columns)), [_words(c) for c in columns], rotation=60, ha="right", fontsize=6
    )
    axes.set_yticks(range(len(rows)), [_words(r) for r in rows], fontsize=6)
    axes.grid(False)
    axes.set(xlabel="answer (a case with several names counts in each)", ylabel="concealed")
    return figure


_GROUPS = ("pair", "triple", "confounded", "null")


def _draw_detection(table: pd.DataFrame) -> Figure:
    """Share exactly right by severity, an effect a row."""
    named = table[table["category"].isin(["single", "parameter", "sensor"])]
    effects = list(
        dict.fromkeys(named.sort_values(["category", "effect"], ascending=[False, True])["effect"])
    )
    figure, axes = style.subplots(width=style.COLUMN_IN, height=0.7 + 0.16 * len(effects))
    for k, severity in enumerate(SEVERITIES):
        here = named[named["severity"] == severity].set_index("effect").reindex(effects)
        at = np.arange(len(effects)) + 0.22 * (k - 1)
        # matplotlib wants the lengths of the bars, not their ends
        bars = np.abs(here[["low", "high"]].to_numpy().T - here["exact"].to_numpy())
        axes.errorbar(
            here["exact"],
            at,
            xerr=bars,
            fmt=style.MARKERS[k],
            color=style.COLOURS[k],
            ms=3,
            lw=0.6,
            capsize=0,
            label=severity,
        )
    axes.set_yticks(range(len(effects)), [_words(e) for e in effects], fontsize=6)
    axes.set(
        xlabel="share exactly right (95 % interval)",
        xlim=(-0.03, 1.03),
        ylim=(len(effects) - 0.4, -0.6),
    )
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return figure


def _draw_calibration(table: pd.DataFrame) -> Figure:
    """Stated probability against the share that came true."""
    figure, axes = style.subplots(height=2.6)
    axes.plot([0, 1], [0, 1], color=style.GREY, lw=0.8, ls="--", label="as stated")
    bars = np.abs(table[["low", "high"]].to_numpy().T - table["true"].to_numpy())
    axes.errorbar(
        table["stated"],
        table["true"],
        yerr=bars,
        fmt="o",
        color=style.BLUE,
        label="came true (95 % interval)",
    )
    for row in table.itertuples():
        axes.annotate(
            f"{row.n}",
            (row.stated, row.true),
            xytext=(-4, -8),
            textcoords="offset points",
            fontsize=6,
            ha="right",
        )
    axes.set(
        xlabel="stated probability of a name",
        ylabel="share of names that were true",
        xlim=(-0.02, 1.04),
        ylim=(-0.02, 1.04),
    )
    axes.legend(loc="upper left")
    return figure


def _draw_outcomes(table: pd.DataFrame) -> Figure:
    """Shares of outcomes by kind of case."""
    kinds = list(dict.fromkeys(table["category"]))
    counts = table.pivot_table(
        index="category", columns="outcome", values="cases", aggfunc="sum", fill_value=0
    ).loc[kinds]
    shares = counts.div(counts.sum(axis=1), axis=0)
    figure, axes = style.subplots(width=style.PAGE_IN, height=0.9 + 0.22 * len(kinds))
    start = np.zeros(len(kinds))
    for outcome in [o for o in OUTCOMES if o in shares]:
        axes.barh(
            range(len(kinds)),
            shares[outcome],
            left=start,
            color=OUTCOMES[outcome],
            edgecolor="white",
            lw=0.5,
            label=outcome,
        )
        start += shares[outcome].to_numpy()
    axes.set_yticks(range(len(kinds)), [f"{k} ({int(counts.loc[k].sum())})" for k in kinds])
    axes.set(xlabel="share of cases", xlim=(0, 1), ylim=(len(kinds) - 0.4, -0.6))
    axes.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=8, handlelength=1.0, columnspacing=1.0
    )
    axes.grid(False)
    return figure


def draw_limit(table: pd.DataFrame) -> Figure:
    """Draw cases with one effect over its size, relative to the stated detection limit.

    Parameters
    ----------
    table : a row a case, with ``over_limit`` and ``outcome``.
    """
    single = table[(table["category"] == "single") & table["over_limit"].notna()]
    size, right = single["over_limit"].astype(float), single["outcome"] == "exact"
    figure, axes = style.subplots(height=2.4)
    axes.axvline(1.0, color=style.GREY, lw=0.8, ls="--", label="stated detection limit")
    # points lie at 0 or 1 only: in lanes, one an effect, they do not hide each other
    lanes = {effect: k for k, effect in enumerate(dict.fromkeys(single["truth"].sort_values()))}
    at = 0.12 * (np.array([lanes[t] for t in single["truth"]]) / max(len(lanes), 1) - 0.5)
    axes.plot(size[right], 1.0 + at[right], "o", color=style.BLUE, label="exactly right")
    axes.plot(size[~right], at[~right], "x", color=style.RED, label="not")
    if len(size) > 3:
        # bins of equal counts, each at its geometric mean
        edges = np.quantile(size, np.linspace(0.0, 1.0, min(6, len(size) // 3 + 2)))
        place = np.clip(np.searchsorted(edges, size, side="right") - 1, 0, len(edges) - 2)
        shares = [
            (float(np.exp(np.log(size[place == b]).mean())), right[place == b].mean())
            for b in np.unique(place)
        ]
        axes.plot(
            *zip(*shares, strict=True),
            color=style.BLACK,
            lw=1.0,
            marker=".",
            label="share, equal counts",
        )
    axes.set(
        xscale="log",
        xlabel="size of the effect over the stated limit",
        ylabel="exactly right",
        ylim=(-0.15, 1.15),
    )
    axes.legend(loc="center right", fontsize=6)
    return figure


def draw_power(table: pd.DataFrame) -> Figure:
    """Draw the share of true names that were reported over their detection limit.

    Parameters
    ----------
    table : rows of :func:`by_world.power_table`; with a column ``method`` a line each.
    """
    figure, axes = style.subplots(height=2.6)
    if not len(table):
        axes.set_axis_off()
        axes.text(0.5, 0.5, "of no set a limit is known", ha="center", va="center")
        return figure
    methods = list(dict.fromkeys(table["method"])) if "method" in table else [""]
    for k, method in enumerate(methods):
        part = table[table["method"] == method] if method else table
        at = np.maximum(part["middle_nats"], 0.5)
        # the limit is of the sets, and the same for all methods
        if k == 0:
            axes.plot(at, part["best_method"], color=style.BLACK, lw=1.0, label="any method")
        bars = np.abs(part[["low", "high"]].to_numpy().T - part["named"].to_numpy())
        axes.errorbar(
            at,
            part["named"],
            yerr=bars if k == 0 else None,
            marker=style.MARKERS[k % len(style.MARKERS)],
            color=style.COLOURS[k % len(style.COLOURS)],
            ms=3,
            lw=0.8,
            label=method or "named (95 % interval)",
        )
    axes.set(
        xscale="log",
        xlabel="log likelihood ratio against the best without the name (nats)",
        ylabel="share of true names named",
        ylim=(-0.03, 1.03),
    )
    axes.legend(loc="upper left", fontsize=6)
    return figure
