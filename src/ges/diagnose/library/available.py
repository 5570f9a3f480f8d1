"""Candidates that these recordings can speak about."""

from __future__ import annotations

from collections.abc import Sequence

from ges.diagnose.library.candidates import Candidate, flown
from ges.diagnose.library.grids import library
from ges.diagnose.library.requirements import lacking
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.types.model import Model


def candidates_of(
    flights: Sequence[Prepared],
    base: Model,
    taken: Sequence[str] = (),
    only: Sequence[str] | None = None,
) -> list[Candidate]:
    """Candidates that can act now: those that need no other at first, then what acts through the
    effects that are on.
    """
    return [
        c
        for c in library(base, flown(flights, base.radius_m)).values()
        if c.name not in taken
        and (only is None or c.name in only)
        and not lacking(c.name, flights, base)
        and (set(c.carriers) & set(base.effects) or c.stands_alone and not taken)
    ]
