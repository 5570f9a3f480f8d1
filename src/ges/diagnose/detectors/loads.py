"""Suspended and dragged loads: length of the thread, and first place of a load on the ground.

The length decides how fast a load swings, to hundredths. With the first place it decides where the
thread of a dragged load gets taut, to centimetres, which the flights show as a step. No affordable
grid is that fine, and no slope leads there from afar. So the best of a coarse grid is refined
before rivals are compared. For a dragged load three steps follow. First comes the place where the
thread gets taut. Then comes the trade-off of thread and first place, then both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from ges.diagnose.design.columns import variant_of
from ges.diagnose.design.system import System, build
from ges.diagnose.library.candidates import Candidate, Variant, flight_envelope, usual_height_m
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.select.evidence import Regression, make_regression
from ges.diagnose.select.scorer import entries, set_scorer
from ges.diagnose.select.search import SearchResult
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table

LOAD = "slung_load"
START = ("start_x_m", "start_y_m")
"""Shapes of a load that lies on the ground at first."""


@dataclasses.dataclass(frozen=True)
class DraggedLoad:
    """Geometry of a load that is dragged over the ground.

    Attributes
    ----------
    behind_m : horizontal distance at which it is dragged behind.
    ahead_m : horizontal distance ahead of the start at which it lay first.
    """

    behind_m: float
    ahead_m: float

    def with_thread(self, behind_m: float) -> DraggedLoad:
        """Return it on another thread that gets taut at the same place.

        Parameters
        ----------
        behind_m : of the other thread.
        """
        return DraggedLoad(behind_m, self.ahead_m + self.behind_m - behind_m)


def probable_load(regression: Regression, result: SearchResult) -> Variant | None:
    """Return the load of the best set that has one.

    Parameters
    ----------
    regression, result : of the search.

    Returns
    -------
    Its variant; None where a load is improbable.
    """
    best = next((h for h in result.hypotheses if LOAD in h.names), None)
    if best is None or result.inclusion[LOAD] < settings.statistics.possible_probability:
        return None
    variants = (variant_of(regression.system.columns[k]) for k in best.posterior.columns)
    return next(v for v in variants if v.effect == LOAD)


def refine_load(system: System, variant: Variant) -> Variant:
    """Refine the thread of a load, and the first place of a dragged one.

    Parameters
    ----------
    system : of the flights.
    variant : of ``slung_load``; where it is attached stays.

    Returns
    -------
    The variant with most evidence.
    """
    refine = _refine_dragged if set(START) <= variant.shape.keys() else _refine_hanging
    return refine(system, variant)


def _refine_hanging(system: System, variant: Variant) -> Variant:
    """Return the hanging load's variant of most evidence, by two grids of the thread's length."""
    best, span, levels = variant, _coarse_step(variant), settings.detect.load_levels
    # as far as the next of the coarse grid; the second grid spans one step of the first
    for _ in range(2):
        shares = np.geomspace(1.0 / span, span, levels)
        span = shares[1] / shares[0]
        lengths = float(best.shape["length_m"]) * shares
        tried = [
            dataclasses.replace(variant, shape={**variant.shape, "length_m": float(length)})
            for length in lengths
        ]
        best = tried[_most_probable(system, tried)]
    return best


def _coarse_step(variant: Variant) -> float:
    """Return the ratio of the thread's length to its farther neighbour on the grid."""
    grids = (
        np.array(s.levels)
        for s in effect_table.get(LOAD).searches
        if s.axis == ("length_m",) and s.fixed.items() <= variant.shape.items()
    )
    levels = next(grids)
    at = int(np.argmin(np.abs(np.log(levels / variant.shape["length_m"]))))
    near = levels[max(at - 1, 0) : at + 2]
    return float((near[1:] / near[:-1]).max())


def _refine_dragged(system: System, variant: Variant) -> Variant:
    """Return the dragged load's variant of most evidence, by rounds of trials about the best.

    Rounds vary the first place on the ground, then the thread with the place where it gets taut
    fixed. Then both are varied by ever smaller steps.
    """
    flights, model = system.recordings, system.model
    height_m = usual_height_m(model, flight_envelope(flights, model.radius_m))
    outbound = outbound_direction(flights)
    # a taut thread from this height meets the ground so far behind
    best = DraggedLoad(math.sqrt(max(variant.shape["length_m"] ** 2 - height_m**2, 0.0)), 0.0)

    def variant_of_load(load: DraggedLoad) -> Variant:
        start = dict(zip(START, (float(load.ahead_m * c) for c in outbound), strict=True))
        return dataclasses.replace(
            variant,
            shape={**variant.shape, "length_m": math.hypot(height_m, load.behind_m), **start},
        )

    for neighbours in (
        _first_places,
        _threads,
        *(_nearby(share) for share in settings.detect.places_nearby),
    ):
        # the best so far is tried again, so that no round loses; first, as the noise is estimated
        # with the first
        tried = [best, *neighbours(best, height_m)]
        best = tried[_most_probable(system, [variant_of_load(load) for load in tried])]
    return variant_of_load(best)


def outbound_direction(flights: Sequence[Prepared]) -> np.ndarray:
    """Return the horizontal direction in which the flights leave their first places.

    Parameters
    ----------
    flights : prepared recordings.

    Returns
    -------
    (2,) of length 1, world: to where half of the way is gone.
    """
    # a direction even where no flight leaves its place
    total = np.array([settings.numerics.small, 0.0])
    for flight in flights:
        gone = flight.stack("position")[:, :2] - flight.stack("position")[0, :2]
        far = np.linalg.norm(gone, axis=1)
        total += gone[np.argmax(far >= 0.5 * far.max())]
    return total / np.linalg.norm(total)


def _first_places(load: DraggedLoad, height_m: float) -> list[DraggedLoad]:
    """Return the load from first places up to a thread's reach behind and ahead of the start."""
    shares = np.linspace(-1.0, 1.0, settings.detect.load_levels)
    return [dataclasses.replace(load, ahead_m=load.behind_m * k) for k in shares]


def _threads(load: DraggedLoad, height_m: float) -> list[DraggedLoad]:
    """Return the load on threads as long as any on the coarse grid, and a step beyond."""
    (coarse,) = (s.levels for s in effect_table.get(LOAD).searches if s.rule == "drawn")
    # a step of the coarse grid beyond both of its ends
    step = coarse[1] / coarse[0]
    shares = np.geomspace(coarse[0] / step, coarse[-1] * step, settings.detect.load_levels)
    return [load.with_thread(height_m * k) for k in shares]


def _nearby(share: float) -> Callable[[DraggedLoad, float], list[DraggedLoad]]:
    """Return what lists the load's neighbours, in steps of a share of how far it is behind."""

    def neighbours(load: DraggedLoad, height_m: float) -> list[DraggedLoad]:
        step = share * load.behind_m
        threads = [load.with_thread(load.behind_m + k * step) for k in (-2, -1, 1, 2)]
        places = (load.ahead_m + k * step for k in (-2, -1, 1, 2))
        return threads + [dataclasses.replace(load, ahead_m=place) for place in places]

    return neighbours


def _most_probable(system: System, variants: Sequence[Variant]) -> int:
    """Return the index of the variant with most evidence.

    The noise is what the first of them leaves.
    """
    with_loads = build(system.recordings, system.model, variants, system)
    # a load has one amplitude, its mass: as many columns as variants, in their order
    columns = [k for k, c in enumerate(with_loads.columns) if c.variant is not None]
    regression = make_regression(with_loads, columns[:1])
    listed = entries(regression, [Candidate(LOAD, "physics", tuple(variants))])
    scorer = set_scorer(regression, listed)
    (best,) = scorer.best([(e,) for e in listed])
    return columns.index(best.columns[0])
