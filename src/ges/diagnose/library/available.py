"""Candidates that the recordings at hand can test."""

from __future__ import annotations

from collections.abc import Sequence

from ges.diagnose.library.candidates import Candidate, flight_envelope
from ges.diagnose.library.grids import library
from ges.diagnose.library.requirements import unmet_requirement
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.types.model import Model


def candidates_of(
    flights: Sequence[Prepared],
    base: Model,
    taken: Sequence[str] = (),
    only: Sequence[str] | None = None,
) -> list[Candidate]:
    """Return the candidates that can act on a model and be seen in these flights.

    Parameters
    ----------
    flights : prepared recordings.
    base : the model they are tested on.
    taken : names that are left out. With any, only effects with a prerequisite in ``base`` are
        listed.
    only : names that are allowed; None allows all.
    """
    return [
        c
        for c in library(base, flight_envelope(flights, base.radius_m)).values()
        if c.name not in taken
        and (only is None or c.name in only)
        and not unmet_requirement(c.name, flights, base)
        and (set(c.prerequisites) & set(base.effects) or c.stands_alone and not taken)
    ]
