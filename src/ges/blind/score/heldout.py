"""What the same tool makes of a case given its true names, and how held-out errors compare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ges.errors import GesError
from ges.recordings.recording import load_set
from ges.simulator import effects as effect_table

WORTH = 0.02


def diagnose_true_names(case: Path, names: Sequence[str]) -> dict[str, Any]:
    """Diagnose a case given its true names.

    Parameters
    ----------
    case : folder of the set.
    names : true names.

    Returns
    -------
    Content of ``diagnosis.json``; empty where all names are of sensors or cannot be fitted.
    """
    from ges.diagnose.pipeline import diagnose

    modelled = [
        n for n in names if n in effect_table.table() and effect_table.get(n).kind != "sensor"
    ]
    if not modelled:
        return {}
    try:
        return diagnose(load_set(case), names=modelled).content()
    except GesError:
        return {}


def reductions(blind: Mapping, best: Mapping) -> dict[str, tuple[float, float]]:
    """Return how much diagnosis and oracle reduce the error on held-out flights.

    Parameters
    ----------
    blind, best : ``diagnosis.json`` of the blind diagnosis and of the one given the true names.

    Returns
    -------
    (by the diagnosis, by the oracle), sums over channels of 1 - (after / recalibrated)^2.
    ``open_loop`` is of the weak-form residuals, ``closed_loop`` of flights simulated with their
    references. Only channels count in which the oracle gains more than :data:`WORTH`; a kind
    without any is missing.
    """
    tool, oracle = (
        {"open_loop": d.get("fit", {}), "closed_loop": d.get("fit", {}).get("closed_loop", {})}
        for d in (blind, best)
    )
    by_kind = {
        kind: _gains(tool[kind].get("channels", {}), oracle[kind].get("channels", {}))
        for kind in oracle
    }
    return {kind: gains for kind, gains in by_kind.items() if gains[1] > 0.0}


def _gains(reported: Mapping[str, Mapping], best: Mapping[str, Mapping]) -> tuple[float, float]:
    """Of the diagnosis and of the oracle, over the channels that both have."""
    tool = oracle = 0.0
    for name in set(best) & set(reported):
        # 1 - (rms after)^2 / (rms recalibrated)^2: what recalibration takes away is nobody's merit
        recalibrated = reported[name]["recalibrated"]
        gain = 1.0 - (best[name]["after"] / recalibrated) ** 2 if recalibrated else 0.0
        if gain > WORTH:
            oracle += gain
            tool += 1.0 - (reported[name]["after"] / recalibrated) ** 2
    return tool, oracle
