"""What the same tool makes of a case when it is told the true names, and how much better held-out
flights became beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ges.errors import GesError
from ges.recordings.recording import load_set
from ges.simulator import effects as effect_table

WORTH = 0.02


def told_the_truth(case: Path, names: Sequence[str]) -> dict[str, Any]:
    """Return ``diagnosis.json`` of a case whose true names were given; {} where they are of sensors
    or cannot be fitted.
    """
    from ges.diagnose.pipeline import diagnose

    known = [n for n in names if n in effect_table.table() and effect_table.get(n).kind != "sensor"]
    if not known:
        return {}
    try:
        return diagnose(load_set(case), names=known).content()
    except GesError:
        return {}


def reductions(said: Mapping, best: Mapping) -> dict[str, tuple[float, float]]:
    """Return the summed relative reductions of mean square error on held-out flights, by the
    diagnosis and by the oracle.

    Of the weak-form residuals (``open_loop``), and of the flights flown again in closed loop where
    their references were logged (``closed_loop``). Summed over the channels in which the oracle
    takes away 2 % or more of what recalibration leaves; left out where there are none, or no flight
    was held out.

    Parameters
    ----------
    said, best : ``diagnosis.json`` of the blind diagnosis and of the one that was told the true
        names.
    """
    tool, oracle = (
        {"open_loop": d.get("fit", {}), "closed_loop": d.get("fit", {}).get("closed_loop", {})}
        for d in (said, best)
    )
    found = {
        kind: _gains(tool[kind].get("channels", {}), oracle[kind].get("channels", {}))
        for kind in oracle
    }
    return {kind: gains for kind, gains in found.items() if gains[1] > 0.0}


def _gains(told: Mapping[str, Mapping], best: Mapping[str, Mapping]) -> tuple[float, float]:
    """Of the diagnosis and of the oracle, over the channels that both have."""
    tool = oracle = 0.0
    for name in set(best) & set(told):
        # 1 - (rms after)^2 / (rms recalibrated)^2: what recalibration takes away is nobody's merit
        left = told[name]["recalibrated"]
        gain = 1.0 - (best[name]["after"] / left) ** 2 if left else 0.0
        if gain > WORTH:
            oracle += gain
            tool += 1.0 - (told[name]["after"] / left) ** 2
    return tool, oracle
