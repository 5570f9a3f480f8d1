"""How much better held-out flights became, beside what the same fit makes of them when it is told the true names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from .. import effects as effect_table
from ..errors import GesError
from ..io.recording import load_set

WORTH = 0.02


def reductions(case: Path, names: Sequence[str], said: Mapping) -> tuple[float, float] | None:
    """Return the summed relative reductions of mean square error on held-out flights, by the diagnosis and by the oracle.

    Summed over the channels in which the oracle takes away 2 % or more of what recalibration leaves; None where there are
    none, or no flight was held out.
    """
    import ges.diagnose

    known = [n for n in names if n in effect_table.table() and effect_table.get(n).kind != "sensor"]
    told = said.get("fit", {}).get("channels", {})
    if not known or not told:
        return None
    try:
        best = ges.diagnose(load_set(case), names=known).fit["channels"]
    except GesError:
        return None
    tool = oracle = 0.0
    for name in set(best) & set(told):
        left = told[name]["recalibrated"]
        gain = 1.0 - (best[name]["after"] / left) ** 2 if left else 0.0
        if gain > WORTH:
            oracle += gain
            tool += 1.0 - (told[name]["after"] / left) ** 2
    return (tool, oracle) if oracle > 0.0 else None
