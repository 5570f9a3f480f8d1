"""What a bias of the estimate does: the oracle with a constant added to its ground effect
factor.
"""

from __future__ import annotations

from pathlib import Path

from ges.study.config import Flights, SeedRange, Simulator
from ges.study.fly.flights import Condition, fly_conditions, write_csv
from ges.study.stats.paired import compare, contrasts

METRICS = ("agl_rms_m", "clearance_mean_m", "clearance_p5_m", "clearance_min_m", "low_clearance_s")


def bias_name(bias: float) -> str:
    """'+0.02', '-0.02', '0'."""
    return f"{bias:+g}" if bias else "0"


def bias_conditions(biases: list[float], **parameters: float | str) -> list[Condition]:
    """The oracle under every bias, and under none."""
    values = sorted({0.0, *biases})
    return [
        Condition(bias_name(b), {"mode": "oracle", "bias": b, **parameters}, labels={"bias": b})
        for b in values
    ]


def opposed(biases: list[float]) -> list[tuple[str, str]]:
    """Pairs (+b, -b) of the biases that occur with both signs, the greatest first."""
    return [
        (bias_name(b), bias_name(-b))
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
    """Every bias over every seed.

    Parameters
    ----------
    flights : to write: a row a flight.
    summary : to write: means, with the paired difference from no bias.
    tests : to write: paired tests of +b against -b in every clearance metric, corrected together by
        Holm's method.
    """
    table = fly_conditions(bias_conditions(biases), closed_loop.list(), simulator, plan)
    write_csv(table, flights)
    write_csv(compare(table, METRICS, "0"), summary)
    write_csv(contrasts(table, METRICS, opposed(biases)), tests)
