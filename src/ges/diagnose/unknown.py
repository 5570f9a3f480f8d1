"""Structure that no candidate explains: what a smooth function of the regime still predicts of flights it never saw."""

from __future__ import annotations

from collections.abc import Sequence

from .locate import clear
from .model import Model
from .structure import Structure

CHANCE = 0.01
LEAST_R2 = 0.05
LEAST_SHARE = 0.004  # of weight and its like
AGAIN = 1.5  # times what the flights of the calibration show too


def left_over(found: Sequence[Structure], model: Model) -> list[Structure]:
    """Structures in the residuals of the accepted model that no noise makes and that are large enough; the one that predicts
    most of each channel, the largest share first."""
    known = {channel: AGAIN * rms for channel, rms in model.left_unexplained.items()}
    least = {s.channel: max(LEAST_SHARE * model.whole(s.channel), known.get(s.channel, 0.0)) for s in found}
    fired = [s for s in clear(found, CHANCE, LEAST_R2) if s.rms > least[s.channel]]
    best: dict[str, Structure] = {}
    for s in sorted(fired, key=lambda s: (-s.r2, s.regime)):
        best.setdefault(s.channel, s)
    return list(best.values())
