"""Figures of real flights; where the recordings are not at hand, each states so in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from ges.study.figures import style
from ges.study.figures.flights import FORMS, form_curve
from ges.vehicle.load import load_vehicle

ABSENT = """The published recordings are not at hand, so this figure shows nothing.
'ges recordings fetch appius-ground-effect --out recordings' brings them;
then run the workflow again."""
# of an error by channel: heading of its panel
CHANNELS = {
    "force_z_N": "force along thrust (mN)",
    "moment_x_Nm": "moment in roll (mN m)",
    "moment_y_Nm": "moment in pitch (mN m)",
    "moment_z_Nm": "moment in yaw (mN m)",
}
STAGES = {
    "as_given": ("calibrated before the change", "o", style.GREY),
    "recalibrated": ("recalibrated", "s", style.BLUE),
    "named": ("with what was named", "^", style.RED),
}
EDGES = (0.0, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 12.0, 25.0)


def _absent(table: pd.DataFrame, data: Path, pdf: Path, png: Path) -> None:
    figure, axes = style.subplots(width=style.PAGE_IN, height=0.8)
    axes.axis("off")
    axes.text(0.5, 0.5, ABSENT, ha="center", va="center")
    style.save(figure, table, data, pdf, png)


def binned(blocks: pd.DataFrame) -> pd.DataFrame:
    """Return the mean factor in bins of height.

    Parameters
    ----------
    blocks : rows of :func:`ges.study.figures.flights.thrust_blocks`.

    Returns
    -------
    A row a bin of :data:`EDGES`: ``z_over_r``, ``factor``, ``blocks``, and ``low`` and ``high``,
    the 95 % interval over blocks. Bins of one block have none.
    """
    groups = blocks.groupby(pd.cut(blocks["z_over_r"], EDGES), observed=True)
    table = groups.agg(
        z_over_r=("z_over_r", "mean"),
        factor=("factor", "mean"),
        sd=("factor", "std"),
        blocks=("factor", "size"),
    )
    # of one block the deviation is NaN, and so the interval; the quantile has to exist all the same
    half = (
        stats.t.ppf(0.975, np.maximum(table["blocks"] - 1, 1))
        * table["sd"]
        / np.sqrt(table["blocks"])
    )
    return (
        table.assign(low=table["factor"] - half, high=table["factor"] + half)
        .drop(columns="sd")
        .reset_index(drop=True)
    )


def thrust(blocks: Path, forms: Path, vehicle: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the measured thrust ratio against height, with the forms as fitted to it.

    Parameters
    ----------
    blocks, forms : of :func:`ges.study.figures.flights.thrust_blocks` and
        :func:`ges.study.figures.flights.fit_forms`.
    vehicle : vehicle file.
    data, pdf, png : to write: the bins that are shown, and the figure. Without recordings the
        figure states that.
    """
    table = pd.read_csv(blocks)
    if table.empty:
        return _absent(table, data, pdf, png)
    shown, airframe = binned(table), load_vehicle(vehicle)
    fitted = pd.read_csv(forms).set_index("form")
    z = np.geomspace(0.6, 22.0, 300)
    figure, axes = style.subplots(width=style.PAGE_IN, height=2.9)
    for i, (name, flight) in enumerate(table.groupby("flight")):
        label = f"blocks of {name.lower().replace('_', ' ')}"
        axes.plot(
            flight["z_over_r"],
            flight["factor"],
            style.MARKERS[i + 1],
            ms=2.5,
            alpha=0.45,
            mew=0,
            color=style.COLOURS[i + 3],
            label=label,
        )
    for i, form in enumerate(FORMS):
        offset = (
            f", rotors {1000 * fitted.loc[form, 'offset_m']:+.0f} mm"
            if form != "exponential"
            else ", fitted"
        )
        label = style.FORM_LABELS[form] + offset
        axes.plot(
            z,
            form_curve(form, fitted.loc[form], z, airframe),
            color=(*style.COLOURS[:3], style.BLACK)[i],
            ls=style.LINES[i],
            label=label,
        )
    error = np.abs(shown[["low", "high"]].to_numpy().T - shown["factor"].to_numpy())
    axes.errorbar(
        shown["z_over_r"],
        shown["factor"],
        np.nan_to_num(error),
        fmt="o",
        color=style.BLACK,
        ms=4,
        zorder=5,
        label="mean and 95 % interval",
    )
    ticks = [0.7, 1, 2, 3, 5, 10, 20]
    axes.set(
        xscale="log",
        xticks=ticks,
        xticklabels=[f"{t:g}" for t in ticks],
        ylim=(0.95, 1.14),
        xlim=(0.6, 22),
    )
    axes.set_xlabel("height of the tracked point over rotor radius, $z/R$")
    axes.set_ylabel("thrust over that at height,\nat equal rotor speed")
    axes.minorticks_off()
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    style.save(figure, shown, data, pdf, png)


def dispersion(scatter: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw displacements in hover, real and simulated (in place of figures 1 and 2).

    Parameters
    ----------
    scatter : of :func:`ges.study.figures.flights.hover_dispersion`.
    data, pdf, png : to write: standard deviations, and the figure. Without recordings the figure
        states that.
    """
    table = pd.read_csv(scatter)
    if "real" not in set(table["source"]):
        return _absent(table.iloc[:0], data, pdf, png)
    figure, axes = style.subplots(1, 4, width=style.PAGE_IN, height=2.1)
    rows = []
    for ax, ((source, height), part) in zip(
        axes, table.groupby(["source", "height"], sort=False), strict=True
    ):
        x, z = 1000 * part["dx_m"], 1000 * part["dz_m"]
        ax.plot(
            x,
            z,
            ".",
            ms=1,
            alpha=0.4,
            color=style.BLUE if height == "low" else style.RED,
            rasterized=True,
        )
        reach = (
            1.1e3 * table.loc[table["source"] == source, ["dx_m", "dz_m"]].abs().to_numpy().max()
        )
        ax.set(
            title=f"{source}, {height}\nsd {x.std():.2g} and {z.std():.2g} mm",
            xlabel="forward (mm)",
            xlim=(-reach, reach),
            ylim=(-reach, reach),
            aspect="equal",
        )
        rows.append(
            {
                "source": source,
                "height": height,
                "samples": len(part),
                "blocks": part["block"].nunique(),
                **{f"sd_{a}_m": part[f"d{a}_m"].std() for a in "xyz"},
            }
        )
    axes[0].set_ylabel("up (mm)")
    style.save(figure, pd.DataFrame(rows), data, pdf, png)


def changes(errors: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the error of every channel on held-out flights, by what was done to the vehicle.

    Parameters
    ----------
    errors : of :func:`ges.blind.score.shipped.score_changes`.
    data, pdf, png : to write: the errors, and the figure.
    """
    table = pd.read_csv(errors)
    done = list(table["done"].drop_duplicates())
    figure, axes = style.subplots(1, len(CHANNELS), width=style.PAGE_IN, height=2.0, sharey=True)
    for ax, (channel, heading) in zip(axes, CHANNELS.items(), strict=True):
        rows = table[table["channel"] == channel].set_index("done").reindex(done)
        for stage, (label, mark, colour) in STAGES.items():
            ax.plot(1e3 * rows[stage], np.arange(len(done)), mark, color=colour, label=label)
        ax.set(xlabel=heading, xlim=(0.0, None), ylim=(len(done) - 0.5, -0.5))
        ax.set_yticks(np.arange(len(done)), done)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(STAGES))
    style.save(figure, table, data, pdf, png)
