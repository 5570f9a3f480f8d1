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


MAPPINGS = ("1/sqrt(f)", "1/f")
FITTED = "fitted to real flights"


def _fly(
    simulator: Simulator, plan: ClosedLoop, seeds: list[int], clamp: Path, mapping: int, **truth: float | str
) -> pd.DataFrame:
    """Every mode, and the oracle under every bias, with another true ground effect."""
    world = simulator.model_copy(update={"ground_effect": simulator.ground_effect.model_copy(update=truth)})
    number = float(mapping)
    arms = {"modes": mode_conditions(plan, clamp, mapping=number), "bias": bias_conditions(plan.biases, mapping=number)}
    tables = [fly_conditions(c, seeds, world, plan).assign(experiment=name) for name, c in arms.items()]
    return pd.concat(tables).assign(mapping=MAPPINGS[mapping])


def fly_world(
    simulator: Simulator, plan: ClosedLoop, closed_loop: SeedRange, clamp: Path, form: str, mapping: int, flights: Path
) -> None:
    """Fly one form of the true ground effect with one mapping.

    Parameters
    ----------
    form : of :data:`FORMS`; the firmware's analytical estimate and the network stay those of the default form.
    mapping : 0: command scaled by 1/sqrt(estimate); 1: by 1/estimate, the historical error.
    flights : to write: a row a flight; ``experiment`` says modes or bias.
    """
    write_csv(_fly(simulator, plan, closed_loop.list(), clamp, mapping, form=form).assign(form=form), flights)


def fly_fitted_world(
    simulator: Simulator, plan: ClosedLoop, closed_loop: SeedRange, clamp: Path, forms: Path, flights: Path
) -> None:
    """Fly the form that fits real flights best, with its constants; a table without rows where none were fitted.

    Parameters
    ----------
    forms : the fitted forms, rank 1 the best. The height of the rotor plane is the real vehicle's own and stays behind.
    """
    fitted = pd.read_csv(forms).sort_values("rank")
    if fitted.empty:
        write_csv(pd.DataFrame(columns=["condition", "seed", "experiment", "mapping", "form"]), flights)
        return
    best = fitted.iloc[0]
    own = {name: float(best[name]) for name in ("c_a", "decay") if pd.notna(best[name])}
    table = _fly(simulator, plan, closed_loop.list(), clamp, 0, form=str(best["form"]), **own)
    write_csv(table.assign(form=FITTED), flights)


def summarise_worlds(worlds: list[Path], flights: Path, summary: Path, tests: Path) -> None:
    """All worlds in one table; modes against the analytical one, and opposed biases against each other, in every world."""
    tables = [pd.read_csv(world) for world in worlds]
    table = pd.concat([t for t in tables if len(t)])
    summaries, tested = [], []
    for (form, mapping), part in table.groupby(["form", "mapping"], sort=False):
        modes, bias = (part[part["experiment"] == name] for name in ("modes", "bias"))
        pairs = opposed(sorted(bias["bias"].unique()))
        summaries.append(compare(modes, METRICS, REFERENCE).assign(form=form, mapping=mapping))
        tested.append(contrasts(bias, METRICS, pairs).assign(form=form, mapping=mapping))
    write_csv(table, flights)
    write_csv(pd.concat(summaries), summary)
    write_csv(pd.concat(tested), tests)
