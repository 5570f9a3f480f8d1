"""Data of the figures, besides diagnosis.json."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from ges.diagnose.decide.accept import Accepted
from ges.diagnose.locate.regimes import Cell
from ges.diagnose.prepare.problem import Problem
from ges.diagnose.prove.proof import Proof
from ges.diagnose.types.model import Model


@dataclasses.dataclass(frozen=True)
class Workings:
    """Intermediate results of a diagnosis.

    Attributes
    ----------
    problem : the data.
    accepted : names and fits.
    cells : map of the residuals of the recalibrated vehicle.
    models : by stage.
    proof : errors on held-out flights.
    length_s : support of the test functions.
    """

    problem: Problem
    accepted: Accepted
    cells: Sequence[Cell]
    models: Mapping[str, Model]
    proof: Proof
    length_s: float
