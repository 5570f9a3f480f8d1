"""Choice of the asymmetric clamp's threshold, on validation seeds alone."""

from __future__ import annotations

from pathlib import Path

from ges.files import write_csv, write_json
from ges.study.config import Flights, SeedRange, Simulator
from ges.study.fly.flights import Condition, fly_conditions
from ges.study.stats.paired import means


def choose_clamp(
    simulator: Simulator,
    plan: Flights,
    clamp_thresholds: list[float],
    validation: SeedRange,
    flights: Path,
    choice: Path,
) -> None:
    """Fly every candidate and take the one of least mean AGL RMS; of equals, the tightest.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    clamp_thresholds : candidates: what the network may add to the formula.
    validation : seeds.
    flights : to write: a row a flight.
    choice : to write (JSON): ``threshold``, the seeds it was chosen on, and the mean AGL RMS of
        every candidate.
    """
    # rising, and idxmin takes the first of equals: the tightest
    candidates = {f"{value:g}": value for value in sorted(clamp_thresholds)}
    conditions = [
        Condition(
            name,
            {"mode": "ml_asym_clamp", "overprediction_clamp": value},
            labels={"threshold": value},
        )
        for name, value in candidates.items()
    ]
    table = fly_conditions(conditions, validation.list(), simulator, plan)
    score = means(table, ["agl_rms_m"]).set_index("condition")["mean"]
    write_csv(flights, table)
    write_json(
        choice,
        {
            "threshold": candidates[score.idxmin()],
            "seeds": validation.list(),
            "agl_rms_m": score.to_dict(),
        },
    )
