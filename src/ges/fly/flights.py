"""Flights of a closed-loop experiment: every condition over every seed, in one batch."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import pandas as pd

from .. import sim
from ..config import ClosedLoop, Simulator
from ..errors import GesError
from .metrics import COLUMNS, flight_metrics


@dataclasses.dataclass(frozen=True)
class Condition:
    """What distinguishes the flights of one arm of an experiment.

    Parameters
    ----------
    labels : columns that name the condition in the table.
    parameters : numbers of :class:`ges.sim.Flight` that differ.
    ground_effect : parameters of the true ground effect that differ.
    """

    labels: Mapping[str, float | str]
    parameters: Mapping[str, float | str]
    ground_effect: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def flight(self, simulator: Simulator, plan: ClosedLoop, seed: int) -> sim.Flight:
        """The flight of one seed; the same seed has the same terrain and the same sensor noise in every condition."""
        numbers = {"duration_s": plan.duration_s, "cruise_m_s": plan.cruise_m_s, "seed": float(seed)}
        truth = {**simulator.ground_effect.parameters(), **self.ground_effect}
        return sim.Flight({**simulator.parameters(), **numbers, **self.parameters}, {"ground_effect": truth})


def flown(flights: Sequence[sim.Flight], columns: Iterable[str]) -> list[sim.Record]:
    """Fly, and stop with a sentence where a flight did not end well."""
    records = sim.fly(flights, columns)
    for record in records:
        if record.status != "ok":
            raise GesError(f"closed loop: {record.status}; this flight plan or these gains cannot be flown")
    return records


def fly_conditions(conditions: Sequence[Condition], seeds: Sequence[int], simulator: Simulator, plan: ClosedLoop) -> pd.DataFrame:
    """Metrics of every condition over every seed, a row a flight."""
    arms = [(c, seed) for c in conditions for seed in seeds]
    records = flown([c.flight(simulator, plan, seed) for c, seed in arms], COLUMNS)
    limits = simulator.controller.agl_ref_m, plan.low_clearance_m, plan.restricted_m
    rows = [{**c.labels, "seed": seed, **flight_metrics(r, *limits)} for (c, seed), r in zip(arms, records, strict=True)]
    return pd.DataFrame(rows)
