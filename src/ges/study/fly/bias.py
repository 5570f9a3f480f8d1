"""What a bias of the estimate does: the oracle with a constant added to its ground effect
factor.
"""

from __future__ import annotations

from pathlib import Path

from ges.files import write_csv
from ges.study.config import Flights, SeedRange, Simulator
from ges.study.fly.flights import Condition, fly_conditions
from ges.study.stats.paired import compare, contrasts

METRICS = ("agl_rms_m", "clearance_mean_m", "clearance_p5_m", "clearance_min_m", "low_clearance_s")


def _bias_name(bias: float) -> str:
    """'+0.02', '-0.02', '0'."""
    return f"{bias:+g}" if bias else "0"


def bias_conditions(biases: list[float], **parameters: float | str) -> list[Condition]:
    """Return the oracle under every bias, and under none.

    Parameters
    ----------
    biases : constants that are added to the factor.
    **parameters : further numbers of the flights.
    """
    values = sorted({0.0, *biases})
    return [
        Condition(_bias_name(b), {"mode": "oracle", "bias": b, **parameters}, labels={"bias": b})
        for b in values
    ]


def opposed(biases: list[float]) -> list[tuple[str, str]]:
    """Return the biases that occur with both signs.

    Returns
    -------
    Names of the conditions (+b, -b), the greatest first.
    """
    return [
        (_bias_name(b), _bias_name(-b))
        for b in sorted(biases, reverse=True)
        if b > 0 and -b in biases
    ]


def fly_bias(
    simulator: Simulator,
    plan: Flights,
    biases: list[float],
    closed_loop: SeedRange,
    flights: Path,
    summary: Path,
    tests: Path,
) -> None:
    """Fly every bias over every seed.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    biases : constants that are added to the oracle's factor.
    closed_loop : seeds.
    flights : to write: a row a flight.
    summary : to write: means, with the paired difference from no bias.
    tests : to write: paired tests of +b against -b in every clearance metric, corrected together by
        Holm's method.
    """
    table = fly_conditions(bias_conditions(biases), closed_loop.list(), simulator, plan)
    write_csv(flights, table)
    write_csv(summary, compare(table, METRICS, "0"))
    write_csv(tests, contrasts(table, METRICS, opposed(biases)))
