"""Structure that no candidate explains: what a smooth function of the regime still predicts of blocks of time it never saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .locate import clear
from .model import Model
from .structure import Structure

LEAST_R2 = 0.03
LEAST_SHARE = {"force": 0.002, "acc": 0.002, "moment": 0.0004, "drive": 0.004, "range": 0.3}
"""Of weight, weight times arm, full rotor speed, a rotor radius."""
FORCED = ("force", "acc", "moment")
LEAST_SIZE = 0.01
BORROWED_R2 = 0.2
BORROWED_SHARE = {"force": 0.005, "acc": 0.005, "moment": 0.002, "range": 0.25}
AGAIN = 3.0  # times what the flights of the calibration show too: root of the 95 % point of F for four flights against four


def left_over(found: Sequence[Structure], model: Model) -> list[Structure]:
    """Structures in the residuals of the accepted model that no noise makes and that are large enough: of the mean, or where
    that shows none, of the size of forces and moments. The one that predicts most of each channel, the largest share first."""
    large = [s for s in clear(found, LEAST_R2) if s.rms > _least(s, model)]
    best: dict[str, Structure] = {}
    for s in sorted([s for s in large if not s.of_size] or large, key=lambda s: (-s.r2, s.regime)):
        best.setdefault(s.channel, s)
    return list(best.values())


def borrowed(found: Sequence[Structure], model: Model) -> bool:
    """Whether what was accepted leaves a structure so large that its names are only the nearest: an effect of the library that
    is really there explains its channels, and one that is not makes up for a part of what is."""
    means = [s for s in clear(found, BORROWED_R2) if not s.of_size and _kind(s) in BORROWED_SHARE]
    return any(s.rms > _least(s, model, BORROWED_SHARE) for s in means)


def _kind(s: Structure) -> str:
    return s.channel.split("_")[0]


def _least(s: Structure, model: Model, shares: Mapping[str, float] = LEAST_SHARE) -> float:
    """Smallest rms that counts; what the flights of the calibration show too does not."""
    usual = shares[_kind(s)]
    if s.of_size:
        usual = LEAST_SIZE if _kind(s) in FORCED else float("inf")
    return max(usual * model.whole(s.channel), AGAIN * model.left_unexplained.get(s.key, 0.0))
