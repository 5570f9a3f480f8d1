"""Feedforward modes against each other on fresh seeds, and the part of it away from the ground."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from ges.files import write_csv
from ges.study.config import Flights, Mode, SeedRange, Simulator
from ges.study.fly.flights import Condition, fly_conditions, mode
from ges.study.fly.metrics import NAMES
from ges.study.stats.paired import compare

REFERENCE = "analytical"


def mode_conditions(modes: list[Mode], clamp: Path, **parameters: float) -> list[Condition]:
    """Return a condition for every feedforward mode.

    Parameters
    ----------
    modes : names of the modes.
    clamp : choice of the asymmetric clamp's threshold (JSON).
    **parameters : further numbers of the flights.
    """
    threshold = json.loads(Path(clamp).read_text())["threshold"]
    return [mode(name, overprediction_clamp=threshold, **parameters) for name in modes]


def fly_comparison(
    simulator: Simulator,
    plan: Flights,
    modes: list[Mode],
    closed_loop_small: SeedRange,
    closed_loop: SeedRange,
    clamp: Path,
    flights: Path,
    summary: Path,
    restricted: Path,
) -> None:
    """Fly every mode over both lists of seeds, with the network running beside it.

    The network's error where it does not act, against its error where it flies, is what its own
    actions cost it.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    modes : names of the modes.
    closed_loop_small, closed_loop : small and large list of seeds.
    clamp : the choice of the clamp threshold (JSON).
    flights : to write: a row a flight; ``seed_list`` names its list.
    summary : to write: mean of every metric, mode and list, with the paired difference from the
        analytical mode.
    restricted : to write: the same for the tracking error where the rangefinder reads the
        restricted zone, large list.
    """
    conditions, tables, summaries = mode_conditions(modes, clamp, shadow=1.0), [], []
    lists = {"closed_loop_small": closed_loop_small, "closed_loop": closed_loop}
    for name, seeds in lists.items():
        table = fly_conditions(conditions, seeds.list(), simulator, plan)
        tables.append(table.assign(seed_list=name))
        summaries.append(compare(table, NAMES, REFERENCE).assign(seed_list=name))
    write_csv(flights, pd.concat(tables))
    write_csv(summary, pd.concat(summaries))
    # the table of the last list, which is the large one
    write_csv(restricted, compare(table, ["agl_rms_restricted_m", "agl_rms_m"], REFERENCE))


def write_table2(comparison: Path, bias: Path, table: Path) -> None:
    """Write the closed-loop AGL RMS of every mode and of every bias of the oracle.

    Intervals of means are bootstraps over seeds. Differences are paired: modes from the analytical
    one, biases from 0.

    Parameters
    ----------
    comparison, bias : summaries of :func:`fly_comparison` and :func:`bias.fly_bias`.
    table : to write.
    """
    modes, biases = pd.read_csv(comparison), pd.read_csv(bias)
    both = pd.concat(
        [
            modes.assign(experiment="modes"),
            biases.assign(experiment="bias", seed_list="closed_loop"),
        ]
    )
    both = both[both["metric"] == "agl_rms_m"].drop(columns="metric")
    first = ["experiment", "seed_list", "condition"]
    write_csv(table, both[first + [c for c in both.columns if c not in first]])
