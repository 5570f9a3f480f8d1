"""Structure that no candidate explains: what a smooth function of the regime still predicts of
blocks of time it never saw.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.design.system import System
from ges.diagnose.detectors.gusts import PUSHED, may_lean
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.diagnose.validate.locate import clear, located
from ges.diagnose.validate.structure import Structure


def left_over(found: Sequence[Structure], model: Model) -> list[Structure]:
    """Structures in the residuals of the accepted model that no noise makes and that are large, or
    explain much, as those of healthy flights that come below the asked chance do not: of the mean,
    or where that shows none, of the size of forces and moments. The one that predicts most of each
    channel, the largest share first.
    """
    r2 = settings.statistics.least_gain
    large = [*located(found, model), *clear(found, model, r2, settings.decide.form_margin)]
    best: dict[str, Structure] = {}
    for s in sorted([s for s in large if not s.of_size] or large, key=lambda s: (-s.r2, s.regime)):
        best.setdefault(s.channel, s)
    return list(best.values())


def theirs(
    found: Sequence[Structure], added: Mapping[str, Sequence[np.ndarray]], system: System
) -> list[Structure]:
    """Structures in channels in which names act, ``added`` by name and flight, (m, C); but for
    sideways pushes that what hangs below may make: its pull need only lean.
    """
    each = [np.sqrt(np.nanmean(np.concatenate(by) ** 2, axis=0)) for by in added.values()]
    acting = dict(zip(system.main, np.max(each, axis=0), strict=True))
    return [
        s
        for s in found
        if acting[s.channel] > settings.statistics.large_part * s.rms
        and not (s.channel in PUSHED and may_lean(s.rms, added, system))
    ]


def borrowed(found: Sequence[Structure], model: Model) -> list[Structure]:
    """Structures that what was accepted leaves, so large that its names are only the nearest: an
    effect of the library that is really there explains its channels, and one that is not makes up
    for a part of what is.
    """
    return [
        s
        for s in clear(found, model, settings.statistics.large_part, settings.decide.form_margin)
        if not s.of_size
    ]
