"""Structure in residuals that no candidate explains."""

from __future__ import annotations

from collections.abc import Sequence

from ges.diagnose.locate.regimes import clear_structures, reported_structures
from ges.diagnose.locate.structure import Structure
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


def unexplained_structures(structures: Sequence[Structure], model: Model) -> list[Structure]:
    """Select the structures that stay unexplained.

    Parameters
    ----------
    structures : structures in the residuals of the accepted model.
    model : for reference scales, and structure that the calibration flights show.

    Returns
    -------
    Of each channel the structure that predicts most, the largest share first. Structures of size
    count where none of the mean does.

    Notes
    -----
    A structure must be significant, and large or a large part of the residual. Healthy flights
    below the asked chance show smaller ones.
    """
    r2 = settings.statistics.least_gain
    large = [
        *reported_structures(structures, model),
        *clear_structures(structures, model, r2, settings.decide.form_margin),
    ]
    best: dict[str, Structure] = {}
    for s in sorted([s for s in large if not s.of_size] or large, key=lambda s: (-s.r2, s.regime)):
        best.setdefault(s.channel, s)
    return list(best.values())
