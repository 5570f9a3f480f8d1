"""Figures of a diagnosis: functions from plain numbers to matplotlib, readable without colour."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from scipy.special import stdtrit

from ges.diagnose.prove.traces import Trace
from ges.diagnose.types.words import (
    channel_words,
    number_words,
    quantity_words,
    stage_words,
    unit_words,
)

DRAWN_STAGES = ("before", "recalibrated", "names_only", "after")
# Okabe and Ito's colour-blind safe set
COLOURS = {
    "before": "#999999",
    "recalibrated": "#56B4E9",
    "names_only": "#009E73",
    "after": "#D55E00",
}
# grey, hatched and full, dotted, dashed and solid: stages differ in black and white, too
HATCHES = {"before": "", "recalibrated": "///", "names_only": "...", "after": ""}
LINES = {"before": ":", "recalibrated": "--", "names_only": "-.", "after": "-"}
# whoever imports this may have drawn in another style before: the same figure is the same bytes
STYLE = {
    "font.family": "DejaVu Sans",
    "mathtext.fontset": "dejavusans",
    "figure.constrained_layout.use": False,
    "axes.grid": False,
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.0,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "svg.hashsalt": "ges",
    "figure.dpi": 100.0,
}
WIDTH_IN = 7.0
BINS = 12
# beyond, a score is as dark as the map gets: one outlier would bleach all other cells
LARGEST_Z = 6.0
MAP_COLUMNS = 3
MAP_LABEL = "mean residual over its standard error (dot: significant)"
MOST_DECIMALS = 4
MOST_PARAMETERS = 10
SIGNIFICANT = 0.05
DRAWS = 400
TALLEST_IN = 9.6
"""Of a figure that fits on a printed page with its caption."""


def _figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure, dpi: int = 160) -> bytes:
    """Return a figure as PNG, with the same bytes every time.

    Parameters
    ----------
    figure : to lay out and draw.
    dpi : resolution.
    """
    out = io.BytesIO()
    with mpl.rc_context(STYLE):
        of_screen = figure.dpi
        figure.set_dpi(dpi)
        # laid out without the drawing that savefig would throw away
        if engine := figure.get_layout_engine():
            engine.execute(figure)
            figure.set_layout_engine("none")
        FigureCanvasAgg(figure).print_png(out, metadata={"Software": None})
        figure.set_dpi(of_screen)
    return out.getvalue()


def pdf(figure: Figure) -> bytes:
    """Write the figure, laid out by :func:`png`, as PDF, the same bytes every time."""
    out = io.BytesIO()
    # no date and no program's name: the same figure is the same bytes
    with mpl.rc_context(STYLE):
        FigureCanvasPdf(figure).print_pdf(
            out, metadata={"CreationDate": None, "Producer": None, "Creator": None}
        )
    return out.getvalue()


def location_map(cells: Sequence[Mapping[str, Any]], most_channels: int = 8) -> Figure:
    """Draw the mean residual over its standard error, by channel and regime bin.

    Parameters
    ----------
    cells : a mapping for each cell: ``channel``, ``regime``, ``low``, ``high``, ``mean`` (channel's
        unit), ``sd`` (of the mean), ``q_value``. Cells with q below 0.05 carry a dot; bins without
        enough data stay white.
    most_channels : the channels with the clearest cells are drawn.
    """
    channels = clearest_channels(cells, most_channels)
    regimes = list(dict.fromkeys(k["regime"] for k in cells))
    rows = -(-len(regimes) // MAP_COLUMNS)
    with mpl.rc_context(STYLE):
        figure = _figure(0.7 + rows * (0.6 + 0.22 * len(channels)))
        axes = figure.subplots(rows, min(MAP_COLUMNS, len(regimes)), squeeze=False)
        for axis, regime in zip(axes.flat, regimes, strict=False):
            drawn = draw_map(axis, [k for k in cells if k["regime"] == regime], channels)
            axis.tick_params(labelleft=axis in axes[:, 0])
        for axis in list(axes.flat)[len(regimes) :]:
            axis.set_axis_off()
        # the gap is a share of all rows together
        bar = figure.colorbar(
            drawn, ax=axes, location="bottom", shrink=0.6, aspect=40, pad=0.06 / rows
        )
        bar.set_label(MAP_LABEL)
    return figure


def clearest_channels(cells: Sequence[Mapping[str, Any]], most: int = 8) -> list[str]:
    """Return the channels with the clearest cells, in their own order.

    Parameters
    ----------
    cells : as for :func:`location_map`.
    most : number of channels.
    """
    z = {
        c: max(abs(_score(k)) for k in cells if k["channel"] == c)
        for c in dict.fromkeys(k["channel"] for k in cells)
    }
    # the clearest are chosen, but drawn in their own order, so that axes stay together
    kept = sorted(z, key=lambda c: -z[c])[:most]
    return [c for c in z if c in kept]


def _score(cell: Mapping[str, Any]) -> float:
    return cell["mean"] / cell["sd"] if np.isfinite(cell["sd"]) and cell["sd"] > 0 else 0.0


def draw_map(axis: Axes, cells: Sequence[Mapping[str, Any]], channels: Sequence[str]) -> AxesImage:
    """Draw the map of one regime: bins of equal width on the page, their bounds below.

    Parameters
    ----------
    axis : to draw on.
    cells : of this regime, as for :func:`location_map`.
    channels : rows, from the top.

    Returns
    -------
    The image, for a colour bar.
    """
    bounds = sorted({k["low"] for k in cells} | {k["high"] for k in cells})
    score = np.full((len(channels), max(len(bounds) - 1, 1)), np.nan)
    for cell in cells:
        if cell["channel"] not in channels:
            continue
        row = channels.index(cell["channel"])
        columns = range(bounds.index(cell["low"]), bounds.index(cell["high"]))
        score[row, list(columns)] = _score(cell)
        if cell["q_value"] < SIGNIFICANT:
            axis.plot(np.mean(columns), row, "o", color="black", markersize=3.0)
    drawn = axis.imshow(
        score,
        # pale at zero, two hues that colour-blind eyes tell apart, one scale in all strips
        cmap="PuOr_r",
        norm=Normalize(-LARGEST_Z, LARGEST_Z),
        aspect="auto",
        interpolation="nearest",
    )
    # bins are quantiles, so their bounds are uneven: first, middle and last tell the scale
    shown = sorted({0, len(bounds) // 2, len(bounds) - 1})
    axis.set_xticks([i - 0.5 for i in shown], _ticks(bounds, shown))
    axis.set_yticks(range(len(channels)), [channel_words(c) for c in channels])
    axis.set_xlabel(quantity_words(cells[0]["regime"]))
    axis.spines[["top", "right"]].set_visible(True)
    return drawn


def _ticks(bounds: Sequence[float], shown: Sequence[int]) -> list[str]:
    """Return bounds to a hundredth of their span, or as finely as makes them differ."""
    decimals = max(0, 2 - int(np.ceil(np.log10(max(bounds[-1] - bounds[0], 1e-9)))))
    while decimals < MOST_DECIMALS and len({round(bounds[i], decimals) for i in shown}) < len(
        shown
    ):
        decimals += 1
    return [f"{round(bounds[i], decimals) + 0.0:.{decimals}f}".replace("-", "−") for i in shown]


def held_out_bars(channels: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Draw errors on held-out flights by stage, each channel in units of its ``before``.

    Parameters
    ----------
    channels : as ``fit.channels`` of diagnosis.json: ``before``, ``recalibrated``, with laws
        ``names_only``, ``after`` and ``reduction_ci95``. The latter is the 95 % interval of 1 -
        after / recalibrated, drawn on ``after``.
    """
    with mpl.rc_context(STYLE):
        figure = _figure(0.9 + 0.5 * sum(c["before"] > 0 for c in channels.values()))
        axis = figure.subplots()
        draw_held_out(axis, channels)
        handles, labels = axis.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def draw_held_out(axis: Axes, channels: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw the bars of :func:`held_out_bars`.

    Parameters
    ----------
    axis : to draw on.
    channels : as for :func:`held_out_bars`.
    """
    names = [n for n in channels if channels[n]["before"] > 0]
    stages = [s for s in DRAWN_STAGES if all(s in channels[n] for n in names)]
    # a bar and a gap for every stage, centred on the channel's tick
    step = 0.78 / len(stages)
    for k, stage in enumerate(stages):
        values = np.array([channels[n][stage] / channels[n]["before"] for n in names])
        at = np.arange(len(names)) + step * (k - 0.5 * (len(stages) - 1))
        axis.barh(
            at,
            values,
            0.92 * step,
            color=COLOURS[stage],
            hatch=HATCHES[stage],
            edgecolor="white",
            label=stage_words(stage),
        )
        if stage == "after":
            axis.errorbar(
                values,
                at,
                xerr=_after_error(channels, names, values),
                fmt="none",
                ecolor="black",
                capsize=2.5,
            )
    axis.axvline(1.0, color="black", linewidth=0.6)
    labels = [
        f"{channel_words(n)}\n{number_words(channels[n]['before'])} {unit_words(n)}" for n in names
    ]
    axis.set_yticks(range(len(names)), labels)
    axis.invert_yaxis()
    axis.set_xlabel("error on held-out flights (1: that of the vehicle file, written at the left)")


def _after_error(
    channels: Mapping[str, Mapping[str, Any]], names: Sequence[str], values: np.ndarray
) -> np.ndarray:
    """Return distances (2, k) from ``after`` to its interval, in units of ``before``."""
    recalibrated = np.array([channels[n]["recalibrated"] / channels[n]["before"] for n in names])
    ci = np.array(
        [[v if v is not None else np.nan for v in channels[n]["reduction_ci95"]] for n in names]
    )
    # after = recalibrated (1 - reduction): the upper end of the reduction is the lower error
    low, high = recalibrated * (1.0 - ci[:, 1]), recalibrated * (1.0 - ci[:, 0])
    return np.nan_to_num(np.clip([values - low, high - values], 0.0, None))


def residual_against(*drawn: Any) -> Figure:
    """Draw the residual of the recalibrated model against a regime variable.

    Parameters
    ----------
    *drawn : what :func:`draw_residual` draws on axes.
    """
    with mpl.rc_context(STYLE):
        figure = _figure(3.4)
        draw_residual(figure.subplots(), *drawn)
    return figure


def draw_residual(
    axis: Axes,
    x: np.ndarray,
    y: np.ndarray,
    curves: Mapping[str, np.ndarray],
    blocks: np.ndarray,
    xlabel: str,
    ylabel: str,
    bins: int = BINS,
) -> None:
    """Draw the residual of the recalibrated model against a regime variable on axes.

    Parameters
    ----------
    axis : to draw on.
    x, y : (n,) variable and residual of every window (held-out flights).
    curves : by stage (``recalibrated``, ``after``), (n,) what that model adds in the same windows.
    blocks : (n,) index of the block of time; the 95 % bands come from the spread of the blocks'
        means.
    xlabel, ylabel : of the axes.
    bins : number of bins with equally many windows.
    """
    # quantiles: every bin has as many windows, and so a mean that is known as well
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    # thousands of points are pixels in the PDF, not as many vector marks
    axis.plot(x, y, ".", color="#BBBBBB", markersize=2.0, rasterized=True, zorder=1)
    center, mean, half = bin_means(x, y, blocks, edges)
    axis.errorbar(
        center,
        mean,
        yerr=half,
        fmt="o",
        color="black",
        markersize=4.0,
        capsize=2.5,
        zorder=3,
        label="recorded, mean of the bin with 95 % interval",
    )
    drawn = [np.quantile(y, [0.005, 0.995]), mean]
    for stage, contribution in curves.items():
        _, line, _ = bin_means(x, contribution, blocks, edges)
        drawn.append(line)
        axis.plot(
            center,
            line,
            LINES[stage],
            color=COLOURS[stage],
            linewidth=2.0,
            zorder=2,
            label=stage_words(stage),
        )
    # outliers and the intervals of a few blocks may leave the picture, means and models may not
    low, high = np.nanmin(np.concatenate(drawn)), np.nanmax(np.concatenate(drawn))
    room = 0.05 * (high - low)
    axis.set_ylim(low - room, high + room)
    axis.set(xlabel=xlabel, ylabel=ylabel)
    axis.legend()


def over_time(t: Trace) -> Figure:
    """Draw signals of one flight, recorded and by stage, with recorded less simulated beside them.

    Parameters
    ----------
    t : the flight; grey spans are left out, and so are channels that are simulated ahead.
    """
    drawn = [(c, name) for c, name in enumerate(t.channels) if name not in t.ahead]
    rows = len(drawn)
    height_in = min(0.75 + 0.95 * rows, TALLEST_IN)
    with mpl.rc_context({**STYLE, "font.size": 7.5, "axes.titlesize": 7.5}):
        figure = Figure(figsize=(WIDTH_IN, height_in))
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, 2, squeeze=False, sharex=True)
        for (left, right), (c, name) in zip(axes, drawn, strict=True):
            draw_signal(left, t, name)
            # a misfit that is small beside the signal shows at the right, on a scale of its own
            for stage, values in t.simulated.items():
                _line(right, stage, t.t_s, t.recorded[:, c] - values[:, c])
            right.axhline(0.0, color="black", linewidth=0.5)
            _shade(right, t)
        axes[0, 1].set_title("recorded less simulated", loc="left", pad=2)
        for axis in axes[-1]:
            axis.set_xlabel(f"time, s ({t.flight})")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="upper center", ncols=4)
        # by hand: margins in inches, whatever the number of rows, and no layout to compute
        figure.subplots_adjust(
            left=0.075,
            right=0.99,
            bottom=0.45 / height_in,
            top=1.0 - 0.45 / height_in,
            hspace=0.45,
            wspace=0.17,
        )
    return figure


def draw_signal(axis: Axes, t: Trace, channel: str) -> None:
    """Draw one signal of a flight, recorded and by stage.

    Parameters
    ----------
    axis : to draw on.
    t : the flight.
    channel : one of its channels.
    """
    c = t.channels.index(channel)
    axis.plot(t.t_s, t.recorded[:, c], color="black", linewidth=0.9, label="recorded", zorder=3)
    for stage, values in t.simulated.items():
        _line(axis, stage, t.t_s, values[:, c])
    _limit(axis, t.used, t.recorded[:, c], *(v[:, c] for v in t.simulated.values()))
    axis.set_title(f"{channel_words(channel)}, {unit_words(channel)}", loc="left", pad=2)
    _shade(axis, t)


def _line(axis: Axes, stage: str, t_s: np.ndarray, values: np.ndarray) -> None:
    axis.plot(
        t_s, values, LINES[stage], color=COLOURS[stage], linewidth=0.9, label=stage_words(stage)
    )


def _shade(axis: Axes, t: Trace) -> None:
    """Shade the spans that are left out."""
    for span in t.left_out:
        axis.axvspan(span.start_s, span.end_s, color="#E4E4E4", linewidth=0, zorder=0)
    axis.margins(x=0.0)


def _limit(axis: Axes, used: np.ndarray, *signals: np.ndarray) -> None:
    """Limit an axis by what is used: an impact on the ground would flatten all else."""
    values = np.concatenate([s[used & np.isfinite(s)] for s in signals])
    if len(values):
        room = 0.05 * np.ptp(values) or 1.0
        axis.set_ylim(values.min() - room, values.max() + room)


def bin_means(
    x: np.ndarray, y: np.ndarray, blocks: np.ndarray, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centre, mean and half width of the 95 % interval of every bin with data.

    Parameters
    ----------
    x, y : (n,) signals; the centres are in the unit of x, means and half widths in that of y.
    blocks : (n,) index of the block of time, which counts as one draw.
    edges : (k,) of the bins, rising.

    Returns
    -------
    (b,) each.
    """
    center, mean, half = [], [], []
    bin_of = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    for k in range(len(edges) - 1):
        inside = (bin_of == k) & np.isfinite(y)
        if not inside.any():
            continue
        each = [y[inside & (blocks == b)] for b in np.unique(blocks[inside])]
        about, count = float(y[inside].mean()), len(each)
        # standard error of a mean whose blocks are independent and whose windows are not:
        # sqrt(sum of (sum e)^2 B / (B - 1)) / n, with Student's t for few blocks
        sums = np.array([(e - about).sum() for e in each])
        error = np.sqrt((sums**2).sum() * count / max(count - 1, 1)) / inside.sum()
        center.append(float(x[inside].mean()))
        mean.append(about)
        half.append(float(stdtrit(count - 1, 0.975) * error) if count > 1 else np.nan)
    return np.array(center), np.array(mean), np.array(half)


def rollout_growth(
    t_s: np.ndarray, errors: Mapping[str, Mapping[str, np.ndarray]], seed: int = 0
) -> Figure:
    """Draw the open-loop error against time since the start, with 95 % bands over the starts.

    Parameters
    ----------
    t_s : (k,) time since the start of a rollout.
    errors : by contract column (``p_z_m`` ...) and stage, (starts, k) simulated less recorded.
    seed : of the bootstrap.
    """
    names = list(errors)
    with mpl.rc_context(STYLE):
        figure = _figure(2.3 * -(-len(names) // 3) + 0.3)
        axes = figure.subplots(-(-len(names) // 3), min(3, len(names)), squeeze=False)
        for axis, name in zip(axes.flat, names, strict=False):
            draw_rollout(axis, t_s, errors[name], name, seed)
        for axis in list(axes.flat)[len(names) :]:
            axis.set_axis_off()
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def draw_rollout(
    axis: Axes, t_s: np.ndarray, errors: Mapping[str, np.ndarray], channel: str, seed: int = 0
) -> None:
    """Draw the open-loop error of one channel against time since the start.

    Parameters
    ----------
    axis : to draw on.
    t_s : (k,) time since the start of a rollout.
    errors : by stage, (starts, k) simulated less recorded.
    channel : contract column, as ``p_z_m``.
    seed : of the bootstrap.
    """
    for stage, e in errors.items():
        rms, band = _rms_band(np.asarray(e, dtype=float), np.random.default_rng(seed))
        axis.fill_between(t_s, *band, color=COLOURS[stage], alpha=0.2, linewidth=0)
        axis.plot(
            t_s, rms, LINES[stage], color=COLOURS[stage], linewidth=1.8, label=stage_words(stage)
        )
    axis.set(
        title=channel_words(channel),
        xlabel="time since start, s",
        ylabel=f"rms error, {unit_words(channel)}",
    )
    axis.set_ylim(bottom=0.0)


def _rms_band(e: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the rms over the starts (k,) and its 95 % bootstrap band (2, k)."""
    # whole rollouts are drawn: errors along one of them are not independent
    drawn = (e[rng.integers(0, len(e), (DRAWS, len(e)))] ** 2).mean(axis=1)
    return np.sqrt((e**2).mean(axis=0)), np.sqrt(np.quantile(drawn, [0.025, 0.975], axis=0))


def parameter_intervals(parameters: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw fitted parameters with 95 % intervals, each on its own scale.

    Parameters
    ----------
    parameters : ``label``, ``value``, ``ci95``, ``unit``, and, where the vehicle file has one,
        ``nominal`` and ``prior_sd``. The first ten are drawn, which a printed page holds.
    """
    with mpl.rc_context(STYLE):
        figure = _figure(0.4 + 0.55 * len(parameters[:MOST_PARAMETERS]))
        labels = draw_parameters(figure.subplots(), parameters)
        figure.legend(labels.values(), labels.keys(), loc="outside lower center", ncols=len(labels))
    return figure


def draw_parameters(axis: Axes, parameters: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Draw the intervals of :func:`parameter_intervals`.

    Parameters
    ----------
    axis : to draw on.
    parameters : as for :func:`parameter_intervals`.

    Returns
    -------
    What a legend needs: one handle for each label, however many rows drew it.
    """
    parameters = parameters[:MOST_PARAMETERS]
    for row, p in enumerate(parameters):
        _interval(axis, row, p)
    axis.set(xlim=(-0.02, 1.02), ylim=(len(parameters) - 0.5, -0.5))
    axis.set_axis_off()
    return dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))


def _interval(axis: Axes, row: int, p: Mapping[str, Any]) -> None:
    """Draw one line: what is drawn lies between 0 and 1."""
    low, high = (v if v is not None else p["value"] for v in p["ci95"])
    nominal, two_sds = p.get("nominal"), 2.0 * (p.get("prior_sd") or 0.0)
    band = [nominal - two_sds, nominal + two_sds] if nominal is not None else []
    reach = [low, high, 0.0, *band]
    # every parameter has its own unit, so every line is scaled to hold what is marked on it
    start, length = min(reach), max(reach) - min(reach) or 1.0
    value_at, low_at, high_at, zero_at, *band_at = (
        (v - start) / length for v in (p["value"], *reach)
    )
    if band:
        axis.fill_between(
            band_at,
            row,
            row + 0.4,
            color="#CCCCCC",
            linewidth=0,
            label="nominal, with two prior sds",
        )
    axis.plot([0.0, 1.0], [row + 0.4] * 2, color="#777777", linewidth=0.6)
    axis.plot([zero_at] * 2, [row, row + 0.4], ":", color="black", linewidth=0.8, label="zero")
    axis.plot(
        [low_at, high_at],
        [row + 0.2] * 2,
        color=COLOURS["after"],
        linewidth=3.0,
        solid_capstyle="butt",
        label="95 % interval",
    )
    axis.plot(value_at, row + 0.2, "o", color="black", markersize=5.0, label="fitted")
    unit = f" {p['unit']}" if p["unit"] not in ("1", "") else ""
    span = f"95 %: {number_words(low)} to {number_words(high)}"
    nominal_words = (
        f"; nominal: {number_words(nominal)} ± {number_words(two_sds, 2)}" if band else ""
    )
    axis.text(
        0.0, row - 0.07, f"{p['label']} = {number_words(p['value'])}{unit}  ({span}{nominal_words})"
    )
