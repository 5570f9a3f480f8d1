"""Structure that no candidate explains: what a smooth function of the regime still predicts of blocks of time it never saw."""

from __future__ import annotations

from collections.abc import Sequence

from .locate import clear
from .model import Model
from .structure import Structure

LEAST_R2 = 0.1
"""Healthy flights that come below the chance that is asked explain less."""
BORROWED_R2 = 0.2
BORROWED_SHARE = {"force": 0.005, "acc": 0.005, "moment": 0.002, "range": 0.25}


def left_over(found: Sequence[Structure], model: Model) -> list[Structure]:
    """Structures in the residuals of the accepted model that no noise makes and that are large enough: of the mean, or where
    that shows none, of the size of forces and moments. The one that predicts most of each channel, the largest share first."""
    large = clear(found, model, LEAST_R2)
    best: dict[str, Structure] = {}
    for s in sorted([s for s in large if not s.of_size] or large, key=lambda s: (-s.r2, s.regime)):
        best.setdefault(s.channel, s)
    return list(best.values())


def borrowed(found: Sequence[Structure], model: Model) -> bool:
    """Whether what was accepted leaves a structure so large that its names are only the nearest: an effect of the library that
    is really there explains its channels, and one that is not makes up for a part of what is."""
    return any(not s.of_size for s in clear(found, model, BORROWED_R2, BORROWED_SHARE))
