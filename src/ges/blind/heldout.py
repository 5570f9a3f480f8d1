"""How much better held-out flights became, beside what the same fit makes of them when it is told the true names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from .. import effects as effect_table
from ..errors import GesError
from ..io.recording import load_set

WORTH = 0.02


def reductions(case: Path, names: Sequence[str], said: Mapping) -> dict[str, tuple[float, float]]:
    """Return the summed relative reductions of mean square error on held-out flights, by the diagnosis and by the oracle.

    Of the weak-form residuals (``open_loop``), and of the flights flown again in closed loop where their references were logged
    (``closed_loop``). Summed over the channels in which the oracle takes away 2 % or more of what recalibration leaves; left out
    where there are none, or no flight was held out.
    """
    import ges.diagnose

    known = [n for n in names if n in effect_table.table() and effect_table.get(n).kind != "sensor"]
    told = said.get("fit", {})
    if not known or not told.get("channels"):
        return {}
    try:
        best = ges.diagnose(load_set(case), names=known).fit
    except GesError:
        return {}
    found = {
        "open_loop": _gains(told["channels"], best["channels"]),
        "closed_loop": _gains(told.get("closed_loop", {}).get("channels", {}), best["closed_loop"].get("channels", {})),
    }
    return {kind: gains for kind, gains in found.items() if gains[1] > 0.0}


def _gains(told: Mapping[str, Mapping], best: Mapping[str, Mapping]) -> tuple[float, float]:
    """Of the diagnosis and of the oracle, over the channels that both have."""
    tool = oracle = 0.0
    for name in set(best) & set(told):
        left = told[name]["recalibrated"]
        gain = 1.0 - (best[name]["after"] / left) ** 2 if left else 0.0
        if gain > WORTH:
            oracle += gain
            tool += 1.0 - (told[name]["after"] / left) ** 2
    return tool, oracle
