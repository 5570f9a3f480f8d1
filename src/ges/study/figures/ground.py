"""Ground and ground effect: the surface that is flown over, the factor against clearance, a flight
in the world frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from ges.conventions import rotor_speed
from ges.simulator import effects
from ges.simulator.terrain import ProceduralShape, Terrain
from ges.study.config import Flights, Simulator
from ges.study.figures import style
from ges.study.fly.flights import flown, mode

TRACK = (
    "t_s",
    "p_x_m",
    "p_z_m",
    "ground_z_m",
    "agl_m",
    "range_m",
    "ge_factor",
    "ge_estimate",
    "gyro_y_rad_s",
)


def flat_factor(
    height_m: np.ndarray, parameters: Mapping[str, float], effect: Mapping[str, float]
) -> np.ndarray:
    """Return the factor of the compiled ground effect over flat ground.

    Parameters
    ----------
    height_m : (n,) of the body origin over the ground.
    parameters : simulator parameters of the vehicle.
    effect : parameters of ``ground_effect``.

    Returns
    -------
    (n,) of the first rotor.
    """
    height_m = np.asarray(height_m, dtype=float)
    # f is a ratio of thrusts at equal speed: any speed serves
    turning = dict.fromkeys(rotor_speed(4), np.full(len(height_m), 400.0))
    samples = effects.Samples.from_columns(
        {"t_s": np.arange(len(height_m)) * 0.01, "p_z_m": height_m, **turning}
    )
    return effects.replay(parameters, samples, {"ground_effect": effect})["ge_factor_1"]


def formula(height_m: np.ndarray, simulator: Simulator) -> np.ndarray:
    """Return the flat-ground formula that the firmware's analytical mode uses.

    Parameters
    ----------
    height_m : (n,) of the body origin over the ground.
    simulator : what is flown.

    Returns
    -------
    (n,) factors.
    """
    return flat_factor(height_m, simulator.parameters(), {"form": 0.0})


def terrain(simulator: Simulator, seed: int, data: Path, pdf: Path, png: Path) -> None:
    """Draw the ground of one seed: from above, and along the middle of the track.

    Parameters
    ----------
    simulator : shape of the terrain.
    seed : of the terrain.
    data, pdf, png : to write: height, slope and curvature along the track, and the figure.
    """
    ground = Terrain.procedural(
        seed, ProceduralShape(**{k: float(v) for k, v in simulator.terrain.model_dump().items()})
    )
    x, y = np.linspace(0.0, 20.0, 801), np.linspace(-1.5, 1.5, 121)
    surface = ground.at(*np.meshgrid(x, y)).height_m
    line = ground.at(x, np.zeros_like(x))
    table = pd.DataFrame(
        {
            "x_m": x,
            "height_m": line.height_m,
            "slope": line.slope,
            "curvature_1_m": line.curvature_1_m,
        }
    )
    figure, axes = style.subplots(
        4, 1, height=3.9, sharex=True, gridspec_kw={"height_ratios": [1.1, 1, 1, 1]}
    )
    image = axes[0].pcolormesh(x, y, 100 * surface, cmap="cividis", rasterized=True, shading="auto")
    figure.colorbar(image, ax=axes, location="top", shrink=0.6, aspect=30, label="height (cm)")
    axes[0].set(ylabel="$y$ (m)")
    axes[0].grid(False)
    rows = (
        ("height_m", "height (m)"),
        ("slope", "slope (tan)"),
        ("curvature_1_m", "curvature\n(1/m)"),
    )
    for ax, (name, label), colour in zip(axes[1:], rows, style.COLOURS, strict=False):
        ax.plot(table["x_m"], table[name], color=colour)
        ax.set_ylabel(label)
    axes[-1].set_xlabel("$x$ along the track (m)")
    figure.align_ylabels(axes)
    style.save(figure, table, data, pdf, png)


def track(simulator: Simulator, plan: Flights, seed: int, data: Path, pdf: Path, png: Path) -> None:
    """Draw a flight without feedforward in the world frame (the paper's figure 3).

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    seed : of terrain and noise.
    data, pdf, png : to write: 8 s of the flight, and the figure.
    """
    (record,) = flown([mode("none").flight(simulator, plan, seed)], TRACK)
    table = pd.DataFrame(record.columns)
    table = table[table["t_s"].between(0.2 * plan.duration_s, 0.2 * plan.duration_s + 8.0)]
    figure, (top, low) = style.subplots(
        2, 1, height=2.7, sharex=True, gridspec_kw={"height_ratios": [2, 1]}
    )
    top.fill_between(
        table["t_s"],
        table["ground_z_m"],
        table["ground_z_m"].min() - 0.03,
        color="#d9cfc0",
        label="ground",
        lw=0,
    )
    top.plot(table["t_s"], table["p_z_m"], color=style.BLUE, label="vehicle")
    # the controller holds the height over ground, so the line follows the ground
    target = table["ground_z_m"] + simulator.controller.agl_ref_m
    top.plot(table["t_s"], target, color=style.RED, ls="--", lw=0.8, label="height to hold")
    top.set(ylabel="world height (m)")
    top.legend(loc="upper center", bbox_to_anchor=(0.5, 1.22), ncols=3)
    low.plot(table["t_s"], table["ge_factor"], color=style.BLACK)
    low.set(xlabel="time (s)", ylabel="true factor")
    style.save(figure, table, data, pdf, png)


def _binned(flights: list[Path], simulator: Simulator, edges: np.ndarray) -> pd.DataFrame:
    """Return factor and analytical error in bins of the rotors' clearance.

    Rows are of flights of the data set.
    """
    table = pd.concat(
        [pq.read_table(f, columns=["agl_m", "range_m", "ge_factor"]).to_pandas() for f in flights]
    )
    table = table[np.isfinite(table["range_m"])]
    table["error"] = (
        formula(np.maximum(table["range_m"], 0.01), simulator) - table["ge_factor"]
    ).abs()
    groups = table.groupby(pd.cut(table["agl_m"], edges), observed=True)
    return (
        groups.agg(
            clearance_m=("agl_m", "mean"),
            factor=("ge_factor", "mean"),
            factor_p5=("ge_factor", lambda v: v.quantile(0.05)),
            factor_p95=("ge_factor", lambda v: v.quantile(0.95)),
            analytical_mae=("error", "mean"),
            rows=("error", "size"),
        )
        .query("rows >= 50")
        .reset_index(drop=True)
    )


def curve(flights: list[Path], simulator: Simulator, data: Path, pdf: Path, png: Path) -> None:
    """Draw true factor and flat-ground formula against clearance (the paper's figure 4).

    Parameters
    ----------
    flights : files of the data set.
    simulator : what was flown.
    data, pdf, png : to write: means by bin of clearance with the formula's error, and the figure.
    """
    table = _binned(flights, simulator, np.linspace(0.0, 0.6, 31))
    table["flat_formula"] = formula(table["clearance_m"], simulator)
    figure, (left, right) = style.subplots(1, 2, width=style.PAGE_IN, height=2.2)
    left.fill_between(
        table["clearance_m"],
        table["factor_p5"],
        table["factor_p95"],
        color=style.SKY,
        alpha=0.35,
        lw=0,
        label="5th to 95th percentile",
    )
    left.plot(
        table["clearance_m"],
        table["factor"],
        color=style.BLUE,
        marker="o",
        label="true factor, mean",
    )
    left.plot(
        table["clearance_m"],
        table["flat_formula"],
        color=style.RED,
        ls="--",
        label="flat-ground formula",
    )
    left.set(xlabel="rotor clearance (m)", ylabel="ground effect factor")
    right.plot(table["clearance_m"], table["analytical_mae"], color=style.RED, marker="s")
    right.set(
        xlabel="rotor clearance (m)", ylabel="mean absolute error\nof the flat-ground formula"
    )
    left.legend()
    style.panels(left, right)
    style.save(figure, table, data, pdf, png)
