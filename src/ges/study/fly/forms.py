"""The comparison over worlds with other ground effects: which claims hang on the form, and on the
historical mapping.
"""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pandas as pd

from ges.files import write_csv
from ges.study.config import Flights, GroundEffect, Mode, SeedRange, Simulator
from ges.study.fly.bias import METRICS, bias_conditions, opposed
from ges.study.fly.comparison import REFERENCE, mode_conditions
from ges.study.fly.flights import MAPPINGS, fly_conditions
from ges.study.stats.paired import compare, contrasts

FORMS = get_args(GroundEffect.model_fields["form"].annotation)


FITTED = "fitted to real flights"


def _fly(
    simulator: Simulator,
    plan: Flights,
    modes: list[Mode],
    biases: list[float],
    seeds: list[int],
    clamp: Path,
    mapping: int,
    **truth: float | str,
) -> pd.DataFrame:
    """Fly every mode, and the oracle under every bias, in another world.

    It has another true ground effect and one of :data:`MAPPINGS`.
    """
    world = simulator.model_copy(
        update={"ground_effect": simulator.ground_effect.model_copy(update=truth)}
    )
    number = float(mapping)
    arms = {
        "modes": mode_conditions(modes, clamp, mapping=number),
        "bias": bias_conditions(biases, mapping=number),
    }
    tables = [
        fly_conditions(c, seeds, world, plan).assign(experiment=name) for name, c in arms.items()
    ]
    return pd.concat(tables).assign(mapping=MAPPINGS[mapping])


def _fitted(forms: Path) -> dict[str, float | str] | None:
    """The form that fits real flights best, with its constants; nothing where none were fitted."""
    table = pd.read_csv(forms).sort_values("rank")
    if table.empty:
        return None
    best = table.iloc[0]
    return {
        "form": str(best["form"]),
        **{name: float(best[name]) for name in ("c_a", "decay") if pd.notna(best[name])},
    }


def _summaries(table: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    summaries, tested = [], []
    for (form, mapping), part in table.groupby(["form", "mapping"], sort=False):
        modes, bias = (part[part["experiment"] == name] for name in ("modes", "bias"))
        pairs = opposed(sorted(bias["bias"].unique()))
        summaries.append(compare(modes, METRICS, REFERENCE).assign(form=form, mapping=mapping))
        tested.append(contrasts(bias, METRICS, pairs).assign(form=form, mapping=mapping))
    return pd.concat(summaries), pd.concat(tested)


def fly_worlds(
    simulator: Simulator,
    plan: Flights,
    modes: list[Mode],
    biases: list[float],
    closed_loop: SeedRange,
    clamp: Path,
    forms: Path,
    flights: Path,
    summary: Path,
    tests: Path,
) -> None:
    """Fly every form of the true ground effect with both mappings.

    The form that fits real flights best follows with the right mapping. The firmware's analytical
    estimate and the network stay those of the default form.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    modes, biases : names of the modes, and biases of the oracle.
    closed_loop : seeds.
    clamp : choice of the clamp threshold (JSON).
    forms : forms fitted to real flights, rank 1 the best; may hold no rows. The height of the real
        vehicle's rotor plane is its own and stays behind.
    flights : to write: a row a flight; ``experiment`` is 'modes' or 'bias'.
    summary : to write: modes against the analytical one in every world.
    tests : to write: opposed biases against each other in every world.
    """
    fitted = _fitted(forms)
    # mapping 0 is the right one; the historical error needs no other form to show
    worlds = [(form, {"form": form}, mapping) for form in FORMS for mapping in range(len(MAPPINGS))]
    worlds += [(FITTED, fitted, 0)] if fitted else []
    seeds = closed_loop.list()
    table = pd.concat(
        [
            _fly(simulator, plan, modes, biases, seeds, clamp, m, **truth).assign(form=name)
            for name, truth, m in worlds
        ]
    )
    tables = _summaries(table)
    for content, path in zip((table, *tables), (flights, summary, tests), strict=True):
        write_csv(path, content)
