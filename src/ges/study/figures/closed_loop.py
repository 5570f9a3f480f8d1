"""Figures of the closed loop: traces, modes, biases, pulse, poles, restricted zone, grid."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from ges.study.config import Flights, SeedRange, Simulator
from ges.study.figures import style
from ges.study.fly.causes import FLOOR
from ges.study.fly.flights import flown, fly_conditions, mode
from ges.study.stats.paired import means

SHOWN = ("none", "analytical", "ml")
TRACES = ("t_s", "gyro_y_rad_s", "agl_m", "ge_factor", "ge_estimate")


def traces(
    simulator: Simulator, plan: Flights, seed: int, data: Path, pdf: Path, png: Path
) -> None:
    """Draw gyro and clearance of one seed in three modes (the paper's figure 15).

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    seed : of terrain and noise.
    data, pdf, png : to write: 8 s of each flight, and the figure.
    """
    records = flown([mode(name).flight(simulator, plan, seed) for name in SHOWN], TRACES)
    table = pd.concat(
        [pd.DataFrame(r.columns).assign(mode=name) for name, r in zip(SHOWN, records, strict=True)]
    )
    table = table[table["t_s"].between(0.2 * plan.duration_s, 0.2 * plan.duration_s + 8.0)]
    figure, (top, low) = style.subplots(2, 1, height=2.8, sharex=True)
    for i, name in enumerate(SHOWN):
        rows = table[table["mode"] == name]
        look = {
            "color": style.MODE_COLOURS[name],
            "ls": style.LINES[i],
            "lw": 0.9,
            "label": style.MODE_LABELS[name],
        }
        top.plot(rows["t_s"], rows["gyro_y_rad_s"], **{**look, "lw": 0.5})
        low.plot(rows["t_s"], 1000 * rows["agl_m"], **look)
    low.axhline(1000 * simulator.controller.agl_ref_m, color=style.BLACK, lw=0.5)
    top.set(ylabel="pitch rate (rad/s)")
    low.set(xlabel="time (s)", ylabel="clearance (mm)")
    figure.legend(*low.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    style.save(figure, table, data, pdf, png)


def _modes(axes: Axes, table: pd.DataFrame, spread: bool, scale: float = 1000.0) -> None:
    """A dot a mode with its standard deviation between seeds, or with the interval of its mean."""
    for i, row in enumerate(table.itertuples()):
        error = (
            [[row.sd], [row.sd]]
            if spread
            else [[row.mean - row.mean_low], [row.mean_high - row.mean]]
        )
        axes.errorbar(
            i,
            scale * row.mean,
            yerr=scale * np.array(error),
            ms=4.5,
            **style.MODE_DOTS[row.condition],
        )
    axes.set_xticks(
        range(len(table)), [style.MODE_LABELS[c].replace(" ", "\n") for c in table["condition"]]
    )
    axes.set_xlim(-0.5, len(table) - 0.5)
    axes.grid(axis="x", visible=False)


def small(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw gyro RMS and AGL RMS in three modes over the small list (the paper's figure 16).

    Parameters
    ----------
    summary : of :func:`ges.study.fly.comparison.fly_comparison`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(summary).query("seed_list == 'closed_loop_small' and condition in @SHOWN")
    table = table[table["metric"].isin(["gyro_rms_rad_s", "agl_rms_m"])]
    figure, (left, right) = style.subplots(1, 2, height=2.1)
    for axes, metric, label, scale in (
        (left, "gyro_rms_rad_s", "gyro RMS (rad/s)", 1.0),
        (right, "agl_rms_m", "AGL RMS (mm)", 1000.0),
    ):
        _modes(axes, table[table["metric"] == metric], spread=True, scale=scale)
        axes.set_ylabel(label)
    style.panels(left, right)
    style.save(figure, table, data, pdf, png)


def modes(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw AGL RMS of every mode over the large list of seeds (the paper's figure 17).

    Parameters
    ----------
    summary : of :func:`ges.study.fly.comparison.fly_comparison`.
    data, pdf, png : to write: the rows that are shown, with their paired differences, and the
        figure.
    """
    table = pd.read_csv(summary).query("seed_list == 'closed_loop' and metric == 'agl_rms_m'")
    figure, (left, right) = style.subplots(1, 2, width=style.PAGE_IN, height=2.3)
    _modes(left, table, spread=False)
    left.set_ylabel("AGL RMS (mm)\nmean and 95 % interval")
    paired = table.dropna(subset=["difference"])
    for i, row in enumerate(paired.itertuples()):
        error = 1000 * np.array([[row.difference - row.low], [row.high - row.difference]])
        right.errorbar(
            i,
            1000 * row.difference,
            yerr=error,
            ms=4.5,
            **style.MODE_DOTS[row.condition],
        )
    right.axhline(0, color=style.BLACK, lw=0.6)
    right.set_xticks(
        range(len(paired)), [style.MODE_LABELS[c].replace(" ", "\n") for c in paired["condition"]]
    )
    right.set(
        ylabel="AGL RMS less analytical (mm)\npaired, 95 % interval", xlim=(-0.5, len(paired) - 0.5)
    )
    style.panels(left, right)
    style.save(figure, table, data, pdf, png)


BIAS_METRICS = {
    "agl_rms_m": ("AGL RMS (mm)", 1000),
    "clearance_p5_m": ("5th percentile of\nclearance (mm)", 1000),
    "low_clearance_s": ("low clearance (s)", 1),
}


def bias(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the change of error and clearance against the oracle's bias (the paper's figure 18).

    Parameters
    ----------
    summary : of :func:`ges.study.fly.bias.fly_bias`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(summary)
    table = table[table["metric"].isin(BIAS_METRICS)]
    figure, axes = style.subplots(1, 3, width=style.PAGE_IN, height=2.1)
    for ax, (metric, (label, scale)) in zip(axes, BIAS_METRICS.items(), strict=True):
        rows = (
            table[table["metric"] == metric]
            .sort_values("condition", key=lambda c: c.astype(float))
            .fillna(0.0)
        )
        x, y = rows["condition"].astype(float), scale * rows["difference"]
        ax.errorbar(
            x, y, [y - scale * rows["low"], scale * rows["high"] - y], fmt="o-", color=style.BLUE
        )
        ax.axhline(0, color=style.BLACK, lw=0.6)
        ax.set(xlabel="bias of the factor", ylabel=f"change of {label}")
    style.panels(*axes)
    style.save(figure, table, data, pdf, png)


def restricted(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw AGL RMS in three modes in the restricted zone (the paper's figure 22).

    Parameters
    ----------
    summary : table ``restricted`` of :func:`ges.study.fly.comparison.fly_comparison`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(summary).query("metric == 'agl_rms_restricted_m' and condition in @SHOWN")
    figure, axes = style.subplots(height=2.1)
    _modes(axes, table, spread=False)
    axes.set_ylabel("AGL RMS in the zone (mm)\nmean and 95 % interval")
    style.save(figure, table, data, pdf, png)


def grid(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw hybrid less analytical AGL RMS over both corrections (the paper's figure 23).

    Parameters
    ----------
    summary : of :func:`ges.study.fly.grid.summarise_grid`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(summary).query("metric == 'agl_rms_m' and condition == 'ml'")
    wide = 1000 * table.pivot(
        index="slope_exponent", columns="curvature_factor", values="difference"
    )
    # half the width of the interval, in millimetres
    half = 500 * (
        table.assign(half=table["high"] - table["low"]).pivot(
            index=wide.index.name, columns=wide.columns.name, values="half"
        )
    )
    # a scale symmetric about zero: its pale middle is no difference
    reach = max(np.abs(wide.to_numpy()).max(), 1e-9)
    figure, axes = style.subplots(height=2.0)
    image = axes.imshow(wide, cmap="PuOr_r", vmin=-reach, vmax=reach, aspect="auto")
    style.cells(
        axes,
        wide,
        lambda i, j: f"{wide.iloc[i, j]:+.2f}\n± {half.iloc[i, j]:.2f}",
        lambda i, j: "white" if abs(wide.iloc[i, j]) > 0.65 * reach else "black",
        7.5,
    )
    axes.set(xlabel="curvature gain over the simulator's", ylabel="slope exponent")
    figure.colorbar(image, ax=axes, label="hybrid less analytical (mm)")
    style.save(figure, table, data, pdf, png)


def pulse(trace: Path, tests: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw clearance and shadow error after a bias pulse (the paper's figure 19).

    Parameters
    ----------
    trace, tests : of :func:`ges.study.fly.pulse.fly_pulse`.
    data, pdf, png : to write: the tests, and the figure.
    """
    table, tested = pd.read_csv(trace), pd.read_csv(tests)
    figure, (left, right) = style.subplots(1, 2, width=style.PAGE_IN, height=2.2)
    left.fill_between(
        table["after_s"],
        1000 * table["low_m"],
        1000 * table["high_m"],
        color=style.SKY,
        alpha=0.4,
        lw=0,
    )
    left.plot(table["after_s"], 1000 * table["change_m"], color=style.BLUE)
    left.axhline(0, color=style.BLACK, lw=0.6)
    left.set(
        xlabel="time after the pulse (s)", ylabel="change of clearance (mm)\nmean and 95 % interval"
    )
    rows = tested[tested["metric"] == "shadow_mae"]
    change = 1000 * rows["difference"]
    right.errorbar(
        range(len(rows)),
        change,
        [change - 1000 * rows["low"], 1000 * rows["high"] - change],
        fmt="s",
        color=style.RED,
    )
    right.axhline(0, color=style.BLACK, lw=0.6)
    right.set_xticks(range(len(rows)), rows["window_s"])
    right.set(
        xlabel="window after the pulse (s)",
        ylabel="change of the network's error\n(thousandths), 95 % interval",
    )
    style.panels(left, right)
    style.save(figure, tested, data, pdf, png)


def poles(poles: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the poles of the height loop near the origin, for each mode and both mappings.

    Parameters
    ----------
    poles : of :func:`ges.study.fly.poles.write_poles`.
    data, pdf, png : to write: poles right of -12 1/s, and the figure.
    """
    table = pd.read_csv(poles)
    # those far to the left die out at once
    table = table[(table["factor_is"] == "of height") & (table["real_1_s"] > -12.0)]
    names = [n for n in style.MODE_LABELS if n in set(table["mode"])]
    figure, axes = style.subplots(1, len(names), width=style.PAGE_IN, height=2.6, sharey=True)
    for ax, name in zip(np.atleast_1d(axes), names, strict=True):
        for i, mapping in enumerate(table["mapping"].unique()):
            rows = table[(table["mode"] == name) & (table["mapping"] == mapping)]
            shown = ax.scatter(
                rows["real_1_s"],
                rows["imaginary_1_s"],
                c=rows["factor"],
                marker=style.MARKERS[i],
                s=14,
                cmap="cividis",
                label=mapping,
                linewidths=0.3,
                edgecolors="black",
            )
        ax.axvline(0, color=style.RED, lw=0.8)
        ax.set(title=style.MODE_LABELS[name], xlabel="real part (1/s)")
    np.atleast_1d(axes)[0].set_ylabel("imaginary part (rad/s)")
    handles = np.atleast_1d(axes)[0].get_legend_handles_labels()
    figure.legend(
        *handles, title="command scaled by", loc="outside upper center", ncols=2, title_fontsize=7.5
    )
    figure.colorbar(shown, ax=axes, label="ground effect factor")
    style.save(figure, table, data, pdf, png)


def causes(tests: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw every mode against the vehicle without ground effect, by cause taken away.

    Parameters
    ----------
    tests : of :func:`ges.study.fly.causes.fly_causes`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(tests).query("metric == 'agl_rms_m'")
    table = table[table["reference"].str.startswith(f"{FLOOR}, ")]
    table = table.assign(
        mode=table["condition"].str.partition(", ")[0],
        cause=table["condition"].str.partition(", ")[2],
    )
    listed = list(dict.fromkeys(table["cause"]))
    figure, axes = style.subplots(height=3.2)
    for i, (name, rows) in enumerate(table.groupby("mode", sort=False)):
        x = 1000 * rows["difference"]
        axes.errorbar(
            x,
            np.array([listed.index(c) for c in rows["cause"]]) + 0.2 * (i - 1),
            xerr=[x - 1000 * rows["low"], 1000 * rows["high"] - x],
            ms=3.5,
            label=style.MODE_LABELS[name],
            **style.MODE_DOTS[name],
        )
    axes.axvline(0, color=style.BLACK, lw=0.6)
    axes.set_yticks(range(len(listed)), listed)
    axes.invert_yaxis()
    axes.set_xlabel("AGL RMS less that\nwithout ground effect (mm)")
    axes.locator_params(axis="x", nbins=6)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    style.save(figure, table.reset_index(drop=True), data, pdf, png)


def worlds(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw every mode against the analytical one, by form of the ground effect and by mapping.

    Parameters
    ----------
    summary : of :func:`ges.study.fly.forms.fly_worlds`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(summary).query("metric == 'agl_rms_m'").dropna(subset=["difference"])
    mappings = list(table["mapping"].unique())
    figure, axes = style.subplots(1, len(mappings), width=style.PAGE_IN, height=2.5)
    for ax, mapping in zip(np.atleast_1d(axes), mappings, strict=True):
        part = table[table["mapping"] == mapping]
        forms = list(dict.fromkeys(part["form"]))
        for i, (name, rows) in enumerate(part.groupby("condition", sort=False)):
            place = np.array([forms.index(f) for f in rows["form"]]) + 0.13 * (i - 2)
            y = 1000 * rows["difference"]
            ax.errorbar(
                place,
                y,
                [y - 1000 * rows["low"], 1000 * rows["high"] - y],
                ms=3.5,
                label=style.MODE_LABELS[name],
                **style.MODE_DOTS[name],
            )
        ax.axhline(0, color=style.BLACK, lw=0.6)
        labels = [style.FORM_LABELS.get(f, f) for f in forms]
        ax.set_xticks(
            range(len(forms)), [x.replace("-", "-\n").replace(" to ", "\nto ") for x in labels]
        )
        ax.set_title(f"command scaled by {mapping}")
    np.atleast_1d(axes)[0].set_ylabel("AGL RMS less analytical (mm)\npaired, 95 % interval")
    figure.legend(
        *np.atleast_1d(axes)[0].get_legend_handles_labels(), loc="outside upper center", ncols=5
    )
    style.save(figure, table, data, pdf, png)


def _shares(axes: Axes, table: pd.DataFrame, column: str) -> AxesImage:
    """Shares of seeds (%) over height and length of the pulse."""
    wide = 100 * table.pivot(index="duration_s", columns="bias", values=column)
    image = axes.imshow(wide, cmap="cividis", vmin=0, vmax=100, aspect="auto", origin="lower")
    style.cells(
        axes,
        wide,
        lambda i, j: f"{wide.iloc[i, j]:.0f}",
        lambda i, j: "black" if wide.iloc[i, j] > 55 else "white",
        6.5,
        rotation=45,
    )
    axes.set(xlabel="bias of the pulse", ylabel="length of the pulse (s)")
    return image


def pulse_map(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw the shares of seeds that touch the ground and that return, by pulse.

    Parameters
    ----------
    summary : of :func:`ges.study.fly.pulse.fly_pulse_map`.
    data, pdf, png : to write: the summary, and the figure.
    """
    table = pd.read_csv(summary)
    figure, (left, right) = style.subplots(1, 2, width=style.PAGE_IN, height=2.2)
    _shares(left, table, "touched")
    image = _shares(right, table, "returned")
    left.set_title("(a) touched the ground", loc="left")
    right.set_title("(b) returned to the unpulsed flight", loc="left")
    figure.colorbar(image, ax=[left, right], label="seeds (%)")
    style.save(figure, table, data, pdf, png)


ABLATION_METRICS = {
    "agl_rms_m": "AGL RMS (mm)",
    "clearance_p5_m": "5th percentile of clearance (mm)",
}


def ablation(
    simulator: Simulator,
    plan: Flights,
    seeds: SeedRange,
    narrow: float,
    data: Path,
    pdf: Path,
    png: Path,
) -> None:
    """Draw the parts of the hybrid mode: the network alone, and in a narrow band only.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    seeds : small list.
    narrow : band of trust about the formula without a cutover.
    data, pdf, png : to write: means by condition, and the figure.
    """
    arms = {
        "no feedforward": mode("none"),
        "analytical": mode("analytical"),
        "network alone": mode("ml_direct"),
        f"band of {narrow:g},\nno cutover": mode("ml", cutover_m=0.0, trust_band=narrow),
        "hybrid": mode("ml"),
    }
    named = [dataclasses.replace(arm, name=name) for name, arm in arms.items()]
    table = means(fly_conditions(named, seeds.list(), simulator, plan), ABLATION_METRICS)
    figure, axes = style.subplots(1, 2, width=style.PAGE_IN, height=2.1, sharey=True)
    for ax, (metric, label) in zip(axes, ABLATION_METRICS.items(), strict=True):
        rows = table[table["metric"] == metric].reset_index(drop=True)
        low, mean, high = (1000 * rows[c] for c in ("mean_low", "mean", "mean_high"))
        ax.errorbar(mean, rows.index, xerr=[mean - low, high - mean], fmt="o", color=style.BLUE)
        ax.set_yticks(rows.index, rows["condition"])
        ax.set_xlabel(f"{label}, mean and 95 % interval")
    style.panels(*axes)
    axes[0].invert_yaxis()
    style.save(figure, table, data, pdf, png)


def winner(summary: Path, data: Path, pdf: Path, png: Path) -> None:
    """Draw every mode with the published gains and with gains of its own.

    Parameters
    ----------
    summary : of :func:`ges.study.fly.winner.fly_winner`.
    data, pdf, png : to write: the rows that are shown, and the figure.
    """
    table = pd.read_csv(summary).query("metric == 'agl_rms_m'")
    table[["mode", "gains"]] = table["condition"].str.rsplit(", ", n=1, expand=True)
    names = list(dict.fromkeys(table["mode"]))
    figure, axes = style.subplots(width=style.PAGE_IN, height=2.2)
    for i, (gains, rows) in enumerate(table.groupby("gains", sort=False)):
        place = np.array([names.index(m) for m in rows["mode"]]) + 0.16 * (i - 0.5)
        low, mean, high = (1000 * rows[c] for c in ("mean_low", "mean", "mean_high"))
        axes.errorbar(
            place,
            mean,
            [mean - low, high - mean],
            fmt=style.MARKERS[i],
            color=style.COLOURS[i],
            label=f"gains {gains}",
        )
    axes.set_xticks(
        range(len(names)), [style.MODE_LABELS.get(m, m.replace(", ", ",\n", 1)) for m in names]
    )
    axes.set_ylabel("AGL RMS (mm)\nmean and 95 % interval")
    axes.legend()
    style.save(figure, table, data, pdf, png)
