"""Does the verdict on the modes depend on how strong the slope and curvature corrections are? A
cell of the grid a job.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from ges.files import write_csv
from ges.study.config import Flights, Mode, SeedRange, Simulator
from ges.study.fly.comparison import REFERENCE, mode_conditions
from ges.study.fly.flights import fly_conditions
from ges.study.stats.paired import compare

METRICS = ("agl_rms_m", "clearance_p5_m", "low_clearance_s")
CELL = ["slope_exponent", "curvature_factor"]


def fly_grid_cell(
    simulator: Simulator,
    plan: Flights,
    modes: list[Mode],
    closed_loop: SeedRange,
    clamp: Path,
    slope_exponent: float,
    curvature_factor: float,
    flights: Path,
) -> None:
    """Fly every mode over every seed with one pair of corrections.

    The network stays the one of the default corrections.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    modes : names of the modes.
    closed_loop : seeds.
    clamp : choice of the clamp threshold (JSON).
    slope_exponent : of the true ground effect.
    curvature_factor : curvature gain over the simulator's.
    flights : to write: a row a flight.
    """
    # the published grid is in gains without a unit, so factors of the gain are what compares
    gain = curvature_factor * simulator.ground_effect.curvature_gain_m
    truth = simulator.ground_effect.model_copy(
        update={"slope_exponent": slope_exponent, "curvature_gain_m": gain}
    )
    world = simulator.model_copy(update={"ground_effect": truth})
    table = fly_conditions(mode_conditions(modes, clamp), closed_loop.list(), world, plan)
    cell = {"slope_exponent": slope_exponent, "curvature_factor": curvature_factor}
    write_csv(flights, table.assign(**cell))


def summarise_grid(cells: list[Path], flights: Path, summary: Path) -> None:
    """Compare every mode with the analytical one in every cell of the grid.

    Parameters
    ----------
    cells : tables of :func:`fly_grid_cell`.
    flights : to write: all of their rows.
    summary : to write: means and paired differences by cell.
    """
    table = pd.concat([pd.read_csv(cell) for cell in cells])
    write_csv(flights, table)
    parts = [
        compare(part, METRICS, REFERENCE).assign(**dict(zip(CELL, values, strict=True)))
        for values, part in table.groupby(CELL)
    ]
    whole = pd.concat(parts)
    write_csv(summary, whole[CELL + [c for c in whole.columns if c not in CELL]])
