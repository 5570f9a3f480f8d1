"""How much better held-out flights became, beside what the oracle's parameters make of them.

The same calibration, residuals and flights as in the diagnosis; only the effects and their parameters come from the oracle.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .. import effects as effect_table
from ..diagnose.fit import calibrated, null_fit
from ..diagnose.gate import pass_gate
from ..diagnose.model import from_vehicle
from ..diagnose.residual import UNITS
from ..diagnose.system import build, common_channels, window_length_s
from ..diagnose.verify import errors
from ..files import sha256
from ..io.recording import load_set
from .oracle import Oracle

WORTH = 0.02


def reductions(case: Path, best: Oracle, said: Mapping) -> tuple[float, float] | None:
    """Return the summed relative reductions of mean square error by the diagnosis and by the oracle.

    Summed over the channels in which the oracle takes away 2 % or more of what recalibration leaves; None where there are
    none, or no flight was held out.
    """
    known = {n: p for n, p in best.parameters.items() if n in effect_table.table() and effect_table.get(n).kind != "sensor"}
    told, held = said.get("fit", {}).get("channels", {}), said.get("fit", {}).get("holdout_flights")
    if not known or not held or not told:
        return None
    after = _oracle_errors(case, known, set(held))
    tool = oracle = 0.0
    for name, rms in after.items():
        left = told.get(name, {}).get("recalibrated")
        gain = 1.0 - (rms / left) ** 2 if left else 0.0
        if gain > WORTH:
            oracle += gain
            tool += 1.0 - (told[name]["after"] / left) ** 2
    return (tool, oracle) if oracle > 0.0 else None


def _oracle_errors(case: Path, known: Mapping[str, Mapping[str, float]], held: set[str]) -> dict[str, float]:
    """Errors on the held-out flights by channel, with the oracle's effects and all else calibrated on the others."""
    recordings = load_set(case)
    model = from_vehicle(recordings.vehicle, recordings.folder)
    place = {path.stem: k for k, path in enumerate(sorted(case.glob("*.parquet"), key=sha256), 1)}
    order = sorted(recordings.flights, key=lambda f: place[Path(f.name).stem])
    flights = dict(
        zip((f"flight_{k}" for k in range(1, len(order) + 1)), pass_gate([f.frame for f in order], model).flights, strict=True)
    )
    train = [f for name, f in flights.items() if f is not None and name not in held]
    taken = [flights[name] for name in sorted(held) if flights.get(name) is not None]
    concerned = model.with_effects({n: {**effect_table.get(n).neutral(), **p} for n, p in known.items()})
    _, joint = null_fit(build(train, concerned, []))
    channels = common_channels(taken, model)
    left = errors(taken, {"after": calibrated(concerned, joint.common)}, channels, window_length_s(train))["after"]
    stacked = np.concatenate(left)
    rms = np.sqrt(np.nanmean(stacked**2, axis=0))
    return {f"{name}_{UNITS[name]}": float(v) for name, v in zip(channels, rms, strict=True)}
