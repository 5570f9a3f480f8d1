"""The networks of both flight plans in flight.

The published study flew one that was trained on its data set, whose cruise speed was not that of
the closed loop. Each network is one of several trainings, so that the luck of one draw of weights
decides nothing.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from ges.files import write_csv
from ges.study.config import Flights, SeedRange, Simulator
from ges.study.fly.comparison import REFERENCE
from ges.study.fly.flights import fly_conditions, mode
from ges.study.stats.paired import compare

METRICS = ("agl_rms_m", "clearance_p5_m", "low_clearance_s", "network_mae")
MODES = (REFERENCE, "ml", "ml_direct")


def fly_network(
    simulator: Simulator,
    plan: Flights,
    closed_loop: SeedRange,
    trained_on: str,
    training: int,
    flights: Path,
) -> None:
    """Fly one network, as hybrid and alone, beside the formula over every seed.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    closed_loop : seeds.
    trained_on, training : flight plan of its data set and seed of its training, for the table.
    flights : to write: a row a flight.
    """
    conditions = [mode(name, shadow=1.0) for name in MODES]
    table = fly_conditions(conditions, closed_loop.list(), simulator, plan)
    write_csv(flights, table.assign(trained_on=trained_on, training=training))


def summarise_networks(networks: list[Path], flights: Path, summary: Path) -> None:
    """Compare hybrid and network alone with the formula.

    Parameters
    ----------
    networks : tables of :func:`fly_network`.
    flights : to write: all of their rows.
    summary : to write: a row a metric and condition, of every training (``training`` its seed) and
        of their mean (``mean``). The mean is taken seed by seed first, so that its interval is over
        terrains.
    """
    table = pd.concat([pd.read_csv(path) for path in networks])
    keys = ["condition", "trained_on", "seed"]
    # trainings are no further draws of terrain: averaged first, or they would narrow the interval
    mean = table.groupby(keys, sort=False)[list(METRICS)].mean().reset_index()
    each = pd.concat([table.astype({"training": str}), mean.assign(training="mean")])
    parts = [
        compare(part, METRICS, REFERENCE).assign(trained_on=plan, training=training)
        for (plan, training), part in each.groupby(["trained_on", "training"], sort=False)
    ]
    write_csv(flights, table)
    write_csv(summary, pd.concat(parts).assign(trainings=table["training"].nunique()))
