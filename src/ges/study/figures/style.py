"""One look for all figures: sizes of the printed page, colours that colour-blind readers tell
apart, marks for grey print.

Colours are those of Okabe and Ito; every series also has its own marker, line style or label.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ges.files import replacing, write_csv

if TYPE_CHECKING:
    import pandas as pd

COLUMN_IN = 3.33
"""Width of a column of the paper."""
PAGE_IN = 6.93
"""Width of both columns."""

BLACK, ORANGE, SKY, GREEN = "#000000", "#e69f00", "#56b4e9", "#009e73"
YELLOW, BLUE, RED, PINK = "#f0e442", "#0072b2", "#d55e00", "#cc79a7"
GREY = "#999999"
COLOURS = (BLUE, RED, GREEN, ORANGE, PINK, SKY, BLACK, GREY)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
LINES = ("-", "--", "-.", ":")

MODE_LABELS = {
    "none": "no feedforward",
    "analytical": "analytical",
    "oracle": "oracle",
    "ml": "ML hybrid",
    "ml_direct": "ML direct",
    "ml_asym_clamp": "ML clamped",
}
MODE_COLOURS = dict(zip(MODE_LABELS, (GREY, BLUE, BLACK, RED, ORANGE, GREEN), strict=True))
MODE_DOTS = {
    name: {"fmt": marker, "color": MODE_COLOURS[name]}
    for name, marker in zip(MODE_LABELS, MARKERS, strict=False)
}
FORM_LABELS = {
    "cheeseman_bennett": "Cheeseman-Bennett",
    "hayden": "Hayden",
    "sanchez_cuevas": "Sanchez-Cuevas",
    "exponential": "exponential",
}
MODEL_LABELS = {
    "analytical": "analytical",
    "linear": "linear",
    "decision_tree": "decision tree",
    "random_forest": "random forest",
    "gradient_boosting": "gradient boosting",
    "mlp": "MLP",
    "lstm": "LSTM",
    "transformer": "Transformer",
}

_SETTINGS = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8.5,
    "axes.labelsize": 8.5,
    "axes.titlesize": 8.5,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.3,
    "grid.color": "#cccccc",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "pdf.fonttype": 42,
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
    "axes.unicode_minus": True,
    "errorbar.capsize": 2.0,
}


def subplots(
    rows: int = 1, columns: int = 1, width: float = COLUMN_IN, height: float = 2.2, **keywords: Any
) -> tuple[Figure, Any]:
    """Return a figure in the style of all figures, and its axes.

    Parameters
    ----------
    rows, columns : panels.
    width, height : of the figure, inches.
    **keywords : of ``matplotlib.pyplot.subplots``.

    Returns
    -------
    Axes as one or as an array.
    """
    plt.rcdefaults()
    plt.rcParams.update(_SETTINGS)
    return plt.subplots(rows, columns, figsize=(width, height), **keywords)


def save(figure: Figure, table: pd.DataFrame, data: Path, pdf: Path, png: Path) -> None:
    """Write the table that a figure shows, and the figure twice.

    Parameters
    ----------
    figure : is closed afterwards.
    table : what it shows.
    data, pdf, png : to write; equal figures give equal bytes.
    """
    write_csv(data, table, digits=9)
    with replacing(pdf) as new:
        figure.savefig(
            new, format="pdf", metadata={"CreationDate": None, "Producer": None, "Creator": None}
        )
    with replacing(png) as new:
        figure.savefig(new, format="png", metadata={"Software": None})
    plt.close(figure)


def log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis at 1, 2 and 5 of every decade, in plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def panels(*axes: Axes) -> None:
    """Write the letters of panels, a, b and so on, above their left upper corners."""
    for ax, letter in zip(axes, "abcdef", strict=False):
        ax.set_title(f"({letter})", loc="left", fontweight="bold")


def cells(
    axes: Axes,
    table: pd.DataFrame,
    text: Callable,
    colour: Callable,
    size: float,
    rotation: float = 0.0,
) -> None:
    """Write into the cells of a table that is drawn as an image, and label its axes.

    Parameters
    ----------
    axes : of the image.
    table : numbers, by numbers in rows and columns.
    text, colour : called with row and column of a cell.
    size : of the text, points.
    rotation : of the labels of columns, degrees.
    """
    for i, j in np.ndindex(table.shape):
        axes.text(j, i, text(i, j), ha="center", va="center", fontsize=size, color=colour(i, j))
    axes.set_xticks(range(table.shape[1]), [f"{v:g}" for v in table.columns], rotation=rotation)
    axes.set_yticks(range(table.shape[0]), [f"{v:g}" for v in table.index])
    axes.grid(False)
