"""What figures are drawn from, beside what is told."""

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
    """What a diagnosis worked on, the search, the map of what the recalibrated model leaves, the
    models by stage, the proof, and the support of its windows, s.
    """

    problem: Problem
    accepted: Accepted
    cells: Sequence[Cell]
    models: Mapping[str, Model]
    proof: Proof
    length_s: float
