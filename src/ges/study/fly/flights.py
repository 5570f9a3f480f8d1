"""Flights of a closed-loop experiment: every condition over every seed, a row of metrics a
flight.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence

import pandas as pd

from ges.errors import GesError
from ges.simulator import flight as sim
from ges.study.config import Flights, Simulator
from ges.study.fly.metrics import COLUMNS, flight_metrics

MAPPINGS = ("1/sqrt(f)", "1/f")
"""What the firmware scales the command by, in the order of the simulator's parameter
``mapping``.
"""
AT_ONCE = 120  # flights in memory together; results do not depend on it


@dataclasses.dataclass(frozen=True)
class Condition:
    """What distinguishes the flights of one arm of an experiment.

    Attributes
    ----------
    name : the arm, in the column ``condition`` of the table.
    parameters : numbers of :class:`ges.simulator.flight.Flight` that differ.
    ground_effect : parameters of the true ground effect that differ.
    labels : further columns of the table.
    """

    name: str
    parameters: Mapping[str, float | str]
    ground_effect: Mapping[str, float] = dataclasses.field(default_factory=dict)
    labels: Mapping[str, float | str] = dataclasses.field(default_factory=dict)

    def flight(self, simulator: Simulator, plan: Flights, seed: int) -> sim.Flight:
        """Return the flight of one seed.

        Parameters
        ----------
        simulator, plan : what is flown, and how; the condition's own numbers win.
        seed : gives the same terrain and the same sensor noise in every condition.
        """
        numbers = {
            "duration_s": plan.duration_s,
            "cruise_m_s": plan.cruise_m_s,
            "seed": float(seed),
        }
        # what a condition says goes before the plan, and the plan before the simulator
        truth = {**simulator.ground_effect.parameters(), **self.ground_effect}
        return sim.Flight(
            {**simulator.parameters(), **numbers, **self.parameters}, {"ground_effect": truth}
        )

    def but(self, name: str, **parameters: float | str) -> Condition:
        """Return the same condition under another name with other numbers.

        Parameters
        ----------
        name : of the new condition.
        **parameters : numbers that differ.
        """
        return dataclasses.replace(self, name=name, parameters={**self.parameters, **parameters})


def mode(name: str, **parameters: float | str) -> Condition:
    """Return the condition of a feedforward mode, named after it.

    Parameters
    ----------
    name : of the mode.
    **parameters : further numbers of the flights.
    """
    return Condition(name, {"mode": name, **parameters})


def counted(total: int, at_once: int) -> Iterator[int]:
    """Yield the first index of every batch, with a progress bar on a terminal.

    Parameters
    ----------
    total : pieces of work.
    at_once : pieces of a batch.
    """
    starts = range(0, total, at_once)
    if not sys.stderr.isatty():
        yield from starts
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("flights", total=total)
        for start in starts:
            yield start
            bar.advance(task, at_once)


def flown(flights: Sequence[sim.Flight], columns: Iterable[str]) -> Iterator[sim.Record]:
    """Fly in batches, and yield the records.

    Parameters
    ----------
    flights : to fly.
    columns : of the records.

    Raises
    ------
    GesError
        When a flight did not end well.
    """
    columns = tuple(columns)
    for start in counted(len(flights), AT_ONCE):
        for record in sim.fly(flights[start : start + AT_ONCE], columns):
            if record.status != "ok":
                raise GesError(
                    f"closed loop: {record.status}; this flight plan or these gains cannot be flown"
                )
            yield record


def fly_conditions(
    conditions: Sequence[Condition], seeds: Sequence[int], simulator: Simulator, plan: Flights
) -> pd.DataFrame:
    """Fly every condition over every seed.

    Parameters
    ----------
    conditions, seeds : each condition meets each seed.
    simulator, plan : what is flown, and how.

    Returns
    -------
    A row a flight: ``condition``, its labels, ``seed`` and :data:`metrics.NAMES`.

    Raises
    ------
    GesError
        When a flight did not end well.
    """
    arms = [(c, seed) for c in conditions for seed in seeds]
    records = flown([c.flight(simulator, plan, seed) for c, seed in arms], COLUMNS)
    limits = simulator.controller.agl_ref_m, plan.low_clearance_m, plan.restricted_m
    rows = [
        {"condition": c.name, **c.labels, "seed": seed, **flight_metrics(record, *limits)}
        for (c, seed), record in zip(arms, records, strict=True)
    ]
    return pd.DataFrame(rows)
