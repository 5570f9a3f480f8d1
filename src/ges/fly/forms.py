"""The comparison over worlds with other ground effects: which claims hang on the form, and on the historical mapping."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pandas as pd

from ..config import ClosedLoop, GroundEffect, SeedRange, Simulator
from ..stats.paired import compare, contrasts
from .bias import METRICS, bias_conditions, opposed
from .comparison import REFERENCE, mode_conditions
from .flights import fly_conditions, write_csv

FORMS = get_args(GroundEffect.model_fields["form"].annotation)


def _world(simulator: Simulator, form: str) -> Simulator:
    return simulator.model_copy(update={"ground_effect": simulator.ground_effect.model_copy(update={"form": form})})


def fly_world(
    simulator: Simulator, plan: ClosedLoop, closed_loop: SeedRange, clamp: Path, form: str, mapping: int, flights: Path
) -> None:
    """Every mode, and the oracle under every bias, with one form of the true ground effect and one mapping.

    Parameters
    ----------
    form : of :data:`FORMS`; the firmware's analytical estimate and the network stay those of the default form.
    mapping : 0: command scaled by 1/sqrt(estimate); 1: by 1/estimate, the historical error.
    flights : to write: a row a flight; ``experiment`` says modes or bias.
    """
    world, number = _world(simulator, form), float(mapping)
    arms = {"modes": mode_conditions(plan, clamp, mapping=number), "bias": bias_conditions(plan.biases, mapping=number)}
    tables = [fly_conditions(c, closed_loop.list(), world, plan).assign(experiment=name) for name, c in arms.items()]
    write_csv(pd.concat(tables).assign(form=form, mapping=("1/sqrt(f)", "1/f")[mapping]), flights)


def summarise_worlds(worlds: list[Path], flights: Path, summary: Path, tests: Path) -> None:
    """All worlds in one table; modes against the analytical one, and opposed biases against each other, in every world."""
    table = pd.concat([pd.read_csv(world) for world in worlds])
    summaries, tested = [], []
    for (form, mapping), part in table.groupby(["form", "mapping"], sort=False):
        modes, bias = (part[part["experiment"] == name] for name in ("modes", "bias"))
        pairs = opposed(sorted(bias["bias"].unique()))
        summaries.append(compare(modes, METRICS, REFERENCE).assign(form=form, mapping=mapping))
        tested.append(contrasts(bias, METRICS, pairs).assign(form=form, mapping=mapping))
    write_csv(table, flights)
    write_csv(pd.concat(summaries), summary)
    write_csv(pd.concat(tested), tests)
