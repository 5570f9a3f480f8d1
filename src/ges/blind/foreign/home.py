"""The home generator itself: as it is, and in airs that nobody tuned on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ges.blind.foreign.sets import Place, Sources
from ges.blind.generator.air import Weather
from ges.blind.generator.grid import Spec, specs
from ges.blind.generator.make import Case, draw_case, fly_batch

AS_IT_IS, OTHER_AIR = "home", "home-other-air"
GRID = "world"
# time scales (share of the sd, s) and relative strengths of the flights, other ones in each half
SCALES = {
    "development": ((0.7, 0.12), (0.7, 1.2)),
    "evaluation": ((0.6, 0.2), (0.8, 2.0)),
}
STRENGTHS = {
    "development": (0.5, 0.7, 1.0, 1.5, 2.2),
    "evaluation": (0.4, 0.8, 1.0, 1.3, 2.6),
}


@dataclass(frozen=True)
class HomeDesign:
    """One case of the home generator's grid.

    Attributes
    ----------
    spec : its place in the grid and what is concealed.
    """

    spec: Spec

    @property
    def key(self) -> str:
        """Name in the table of cases: vehicle class, concealed names, menu of flights, index."""
        names = "+".join(self.spec.names) or "nothing"
        return f"{self.spec.size} {names} {self.spec.menu} #{self.spec.index}"


def designs(half: str) -> list[HomeDesign]:
    """Return the home generator's cases for a half.

    Returns
    -------
    The grid 'world' in the order of :data:`HALF_SEED`; what is drawn for a case follows from the
    seed of the sets.
    """
    return [HomeDesign(spec) for spec in specs(GRID, HALF_SEED[half])]


HALF_SEED = {"development": 0, "evaluation": 1}
"""Orders the composition; what is drawn for a case follows from the seed of the sets."""


def make(out: Path, sets: Sequence[tuple[HomeDesign, int, Place]], sources: Sources) -> None:
    """Fly cases in their usual air and seal them.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    sets : cases, each with its number in the world and its place; all have one seed.
    sources : of which nothing is needed.

    Raises
    ------
    GesError
        When a case could not be flown at any severity.
    """
    _make(out, sets, lambda case, _: case)


def make_in_other_air(
    out: Path, sets: Sequence[tuple[HomeDesign, int, Place]], sources: Sources
) -> None:
    """Fly cases in air of two time scales, with heavy tails and bursts, and seal them.

    Each flight of a case has another strength of turbulence; see :func:`make` for the rest.

    Raises
    ------
    GesError
        When a case could not be flown at any severity.
    """
    _make(out, sets, _in_other_air)


def _make(
    out: Path,
    sets: Sequence[tuple[HomeDesign, int, Place]],
    dressed: Callable[[Case, Place], Case],
) -> None:
    place_of = {design.spec.index: place for design, _, place in sets}
    seed = sets[0][2].seed

    def draw(spec: Spec, attempt: int) -> Case:
        place = place_of[spec.index]
        case = draw_case(spec, GRID, seed, attempt)
        around = replace(case.around, identity=place.identity)
        return dressed(replace(case, around=around, world=place.world), place)

    fly_batch([design.spec for design, _, _ in sets], out, seed, draw)


def _in_other_air(case: Case, place: Place) -> Case:
    rng = place.rng("air")
    weather = Weather(
        scales=SCALES[place.half],
        wander=float(rng.uniform(0.4, 0.7)),
        spikes=float(rng.uniform(0.3, 0.6)),
        burst=float(rng.uniform(0.5, 2.0)),
    )
    # every strength once before one comes again
    strengths = np.resize(rng.permutation(STRENGTHS[place.half]), len(case.sorties))
    sorties = [
        replace(sortie, weather=replace(weather, strength=float(strength)))
        for sortie, strength in zip(case.sorties, strengths, strict=True)
    ]
    return replace(case, sorties=sorties)
