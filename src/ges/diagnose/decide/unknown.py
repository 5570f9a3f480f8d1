"""Structure that no candidate explains: what a smooth function of the regime still predicts of
blocks of time it never saw.
"""

from __future__ import annotations

from collections.abc import Sequence

from ges.diagnose.locate.regimes import clear_structures, reported_structures
from ges.diagnose.locate.structure import Structure
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


def left_over(found: Sequence[Structure], model: Model) -> list[Structure]:
    """Structures in the residuals of the accepted model that no noise makes and that are large, or
    explain much, as those of healthy flights that come below the asked chance do not: of the mean,
    or where that shows none, of the size of forces and moments. The one that predicts most of each
    channel, the largest share first.
    """
    r2 = settings.statistics.least_gain
    large = [
        *reported_structures(found, model),
        *clear_structures(found, model, r2, settings.decide.form_margin),
    ]
    best: dict[str, Structure] = {}
    for s in sorted([s for s in large if not s.of_size] or large, key=lambda s: (-s.r2, s.regime)):
        best.setdefault(s.channel, s)
    return list(best.values())
