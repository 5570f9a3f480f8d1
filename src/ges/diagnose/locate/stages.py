"""Stages of a vehicle model: as given, recalibrated, with the findings; and what each leaves."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ges.diagnose.design.system import System, build, window_length_s
from ges.diagnose.detectors.balance import centred
from ges.diagnose.estimate.fit import Joint, calibrated, in_the_air, left_raw, null_fit
from ges.diagnose.estimate.recalibrate import moved_to, operating_point
from ges.diagnose.library.available import candidates_of
from ges.diagnose.locate.regimes import Cell, cells, regimes_of
from ges.diagnose.locate.structure import Regimes, Structure, structures
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.select.evidence import Regression
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


@dataclasses.dataclass(frozen=True)
class Stage:
    """A model, the fit behind it, and what it leaves.

    Attributes
    ----------
    model, joint, regression : the model, its numbers as they were fitted, and on what.
    left : residuals by flight, (m, C), in the channels' units; ``in_air`` those in the air.
    structures : what a smooth function of the regime predicts of them.
    """

    model: Model
    joint: Joint
    regression: Regression
    left: Sequence[np.ndarray]
    in_air: Sequence[np.ndarray]
    structures: list[Structure]


def stage(model: Model, joint: Joint, regression: Regression, regimes: Regimes) -> Stage:
    """Of a model and its fit; ``regimes`` of all windows by flight."""
    left = centred(left_raw(regression.system, joint), regression.system)
    # a drive on the ground is no regime of flight, and would pass for structure
    in_air = in_the_air(left, regression.system)
    found = structures(
        in_air,
        regimes,
        regression.system.main,
        regression.system.blocks(settings.statistics.block_s),
    )
    return Stage(model, joint, regression, left, in_air, found)


@dataclasses.dataclass(frozen=True)
class Start:
    """What the declared vehicle leaves.

    Attributes
    ----------
    system : residuals, nuisances and every candidate that needs no other.
    regimes : of all windows, by flight.
    first : the recalibrated stage; ``cells`` its map.
    """

    system: System
    regimes: Regimes
    first: Stage
    cells: list[Cell]


def recalibrated(flights: Sequence[Prepared], declared: Model) -> Start:
    """Set the declared numbers within their doubts, and look at what that leaves."""
    # corrections multiply each other, so all columns are made where the model comes to stand
    length_s = window_length_s(flights)
    moved: dict[str, float] = {}
    for some in parts(flights):
        alone = build(some, moved_to(declared, moved), (), length_s=length_s)
        moved = operating_point(*null_fit(alone), declared) or moved
    for _ in range(settings.numerics.noise_rounds):
        alone = build(flights, moved_to(declared, moved), (), length_s=length_s)
        further = operating_point(*null_fit(alone), declared)
        if not further:
            break
        moved = further
    system = first_system(flights, moved_to(declared, moved))
    regression, joint = null_fit(system)
    regimes = regimes_of(system)
    first = stage(calibrated(declared, joint.common), joint, regression, regimes)
    return Start(system, regimes, first, cells(system, first.in_air, regimes, first.structures))


def parts(flights: Sequence[Prepared]) -> list[list[Prepared]]:
    """Shorter parts of long flights, a quarter of the next each: where they put the declared
    numbers, all of the flights have a step or two left, and steps are what long flights cost
    (Bottou, Curtis and Nocedal 2018, SIAM Rev. 60, 223).
    """
    found: list[list[Prepared]] = []
    some = list(flights)
    while max(_seconds(f) for f in some) >= 4.0 * settings.advise.duration_s:
        some = [_middle(f, max(0.25 * _seconds(f), settings.advise.duration_s)) for f in some]
        found.append(some)
    return found[::-1]


def _seconds(flight: Prepared) -> float:
    return len(flight.t_s) * flight.dt_s


def _middle(flight: Prepared, seconds: float) -> Prepared:
    """So long a part about the middle of the time in the air."""
    rows = min(len(flight.t_s), round(seconds / flight.dt_s))
    air = np.flatnonzero(flight.flying)
    center = int(air[len(air) // 2]) if len(air) else len(flight.t_s) // 2
    start = min(max(0, center - rows // 2), len(flight.t_s) - rows)
    return flight.between(start, start + rows)


def first_system(flights: Sequence[Prepared], model: Model) -> System:
    """The system of a vehicle with every candidate that needs no other."""
    variants = [v for c in candidates_of(flights, model) for v in c.variants]
    return build(flights, model, variants, length_s=window_length_s(flights))
