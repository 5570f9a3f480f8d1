"""What of a search is proven: probable, large enough to matter, not to be replaced, and firm when
fitted in full.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.design.system import System
from ges.diagnose.estimate.fit import FORM_ERROR, Fitted, Joint, strain
from ges.diagnose.library.candidates import acts_among, amplitude_of, wind_speed_m_s
from ges.diagnose.select.evidence import Board, acts_of
from ges.diagnose.select.search import Hypothesis, Search, size_of
from ges.diagnose.types.model import block_of
from ges.simulator import effects as effect_table

ACCEPT, SURE = 0.9, 0.999
SEPARATE, SEPARATE_FROM_USUAL = math.log(ACCEPT / (1.0 - ACCEPT)), 4.5
CLEAR_SDS, OPEN_SDS, STRAINED = 3.0, 1.5, 5.0
"""Open: of what is unlike an error of a form; how large a lag is may be open far up where that
there is one is not.
"""
DOUBTFUL_SDS = 2.0
"""What is within as many declared sds is no finding, however well it is measured."""
REACH_M = 10.0  # 2 cm of a rangefinder matter
STILL_AIR_M_S = 0.3
"""No air is stiller, nor any position more at rest."""
FAINT = 2.0  # times the least
LIGHTER = 0.4
"""Of the least, of what does not look like an error of a form."""
LEAST_SHARE = {"force": 0.002, "acc": 0.002, "moment": 0.0005, "drive": 0.0003, "range": 0.002}
"""Of weight, weight times arm, full speed or a rotor radius: no model is right to less."""


def unlike_form_error(name: str) -> bool:
    """Whether an effect does not look like what the form of a larger one is wrong by: what a form
    is wrong by depends on the place alone, and what acts through time or speed does not.
    """
    return "unlike_form_error" in effect_table.get(name).hints


def sets_a_lever(name: str) -> bool:
    """Whether an effect is the lever of the one that it modifies."""
    return "lever_of_carrier" in effect_table.get(name).hints


def matters(name: str, channel: str, share: float) -> bool:
    """Whether an effect's share of a channel's whole is more than what no model is right to."""
    return bool(channel) and share >= LEAST_SHARE[block_of(channel)] * (
        LIGHTER if unlike_form_error(name) else 1.0
    )


def least_sizes(system: System) -> np.ndarray:
    """What matters at least in each main channel, rms over all windows, in the channel's unit."""
    return np.array(
        [
            LEAST_SHARE[block_of(n)] * (REACH_M if n == "range" else system.model.whole(n))
            for n in system.main
        ]
    )


def mattering(board: Board, found: Search, known: Mapping[str, float]) -> dict[str, float]:
    """Names that are probable and large enough, with their sizes (see :func:`_shares`); ``known``
    are those of accepted effects.

    Two of a family act in the same place, and one of them makes up for what the other's form is
    wrong by: the better of the two is kept. What is small beside a larger one may be what the
    larger one's form is wrong by, and takes more to be told, as does what is faint and a levelling
    moment; a small modifier is no more than that, if it is not unlike an error of a form, and so is
    what a larger effect's form is known to be wrong by (``error_of`` of its descriptor).
    """
    probable = [n for n in found.best.names if found.inclusion[n] >= ACCEPT]
    places = {n: taken_over(found, n, probable) for n in probable}
    shares = {n: _shares(board, found.best, place) for n, place in places.items() if place}
    beside = {n for n in shares if beside_larger(n, shares)}
    small = {
        n
        for n in shares
        if found.inclusion[n] < SURE and (n in beside or faint(shares[n]) or sets_a_lever(n))
    }
    small |= {n for n in beside if effect_table.get(n).error_of in shares}
    small |= answering_gusts({*shares, *board.system.model.effects}, board.system)
    share = {n: max(by.values()) for n, by in shares.items() if n not in small}
    carriers = {c for n, s in share.items() if s >= 1.0 for c in effect_table.get(n).carriers}
    share = {n: s for n, s in share.items() if s >= _least(n, found.inclusion[n]) or n in carriers}
    present = {*share, *board.system.model.effects}
    share = {n: s for n, s in share.items() if acts_among(n, present)}
    return {n: s for n, s in share.items() if s >= least_beside(n, known)}


def answering_gusts(present: set[str], system: System) -> set[str]:
    """Names that gusts make up: through a drag above the centre of gravity they turn the vehicle,
    whose angular acceleration answers moments that no column has. Where nothing but the air shook
    it, that looks like more inertia.
    """
    shaken = any(
        r.flight.has("excitation") and r.flight.stack("excitation")[:, :3].any()
        for r in system.flights
    )
    alike = {e.name: e.unexcited_like for e in effect_table.table().values() if e.unexcited_like}
    return {
        name
        for name, like in alike.items()
        if not shaken and {like, *effect_table.get(like).carriers} & present
    }


def _least(name: str, probability: float) -> float:
    """How many times the least that matters a name has to make."""
    return LIGHTER if unlike_form_error(name) and probability >= SURE else 1.0


def least_beside(name: str, known: Mapping[str, float]) -> float:
    """The least size at which a modifier is more than what the form of the effect that it modifies
    is wrong by.
    """
    return (
        0.0
        if unlike_form_error(name)
        else FORM_ERROR * known.get(effect_table.get(name).modifies or "", 0.0)
    )


def taken_over(found: Search, name: str, probable: Sequence[str]) -> set[str]:
    """All that acts in a name's place, which the name takes over; nothing where another that is
    probable, too, is the better.
    """
    family = _family(name)
    better = max(
        sorted(family & set(probable)),
        key=lambda n: h.log_evidence if (h := _alone(found, n)) else -np.inf,
    )
    return family & set(found.best.names) if name == better else set()


def _family(name: str) -> set[str]:
    family = effect_table.get(name).family
    return {e.name for e in effect_table.table().values() if e.family == family}


def _alone(found: Search, name: str) -> Hypothesis | None:
    """The best set that has this name and no other of its family."""
    return next((h for h in found.hypotheses if _family(name) & set(h.names) == {name}), None)


def beside_larger(name: str, shares: Mapping[str, Mapping[str, float]]) -> bool:
    """Whether another effect is so much larger in each block of channels that the name may be an
    error of the other's form.
    """
    others = [by for n, by in shares.items() if n != name]
    return all(
        v < FORM_ERROR * max((by[block] for by in others), default=0.0)
        for block, v in shares[name].items()
        if v > 0.0
    )


def faint(share: Mapping[str, float]) -> bool:
    """Whether a name acts in the drive alone, and there little: so may a motor that is not quite as
    the library has it.
    """
    return (
        not any(v > 0.0 for block, v in share.items() if block != "drive")
        and share.get("drive", 0.0) < FAINT
    )


def _shares(board: Board, h: Hypothesis, names: set[str]) -> dict[str, float]:
    """Rms of what effects add together by the search's coefficients, over the least that matters,
    in each block its greatest channel; an accelerometer shows forces.
    """
    system, added = board.system, acts_of(h.posterior, names, board.system)
    with np.errstate(invalid="ignore"):
        share = np.sqrt(
            np.nanmean(np.where(np.isfinite(added).any(axis=0), added, 0.0) ** 2, axis=0)
        ) / least_sizes(system)
    blocks = np.array(["force" if block_of(n) == "acc" else block_of(n) for n in system.main])
    return {block: float(np.max(share[blocks == block])) for block in dict.fromkeys(blocks)}


def replaced_by(found: Search, name: str) -> tuple[str, ...]:
    """What explains the flights nearly as well in its place, however rarely it is met; () where
    nothing does.
    """
    best = _alone(found, name) or found.best
    others = [
        h
        for h in found.hypotheses
        if name not in h.names and h.names and size_of(h.names) <= size_of(best.names)
    ]
    other = max(others, key=lambda h: h.of_flights, default=None)
    if name not in found.best.names or other is None:
        return ()
    if best.of_flights - other.of_flights > lead_over(name, other.names):
        return ()
    return tuple(n for n in other.names if n not in best.names)


def lead_over(name: str, others: Sequence[str]) -> float:
    """Log odds by which a name has to be better than others in its place."""
    return SEPARATE_FROM_USUAL if effect_table.get(name).usual_beside in others else SEPARATE


def ambiguous(found: Search, names: set[str], contested: set[str]) -> tuple[str, ...]:
    """Names that replace each other: none proven alone, but one of them needed."""
    without = sum(h.probability for h in found.hypotheses if not set(h.names) - names)
    needed = without <= 1.0 - ACCEPT
    open_names = contested | {
        n for n, p in found.inclusion.items() if needed and n not in names and p > 0.1
    }
    if len(open_names) < 2:
        return ()
    return tuple(sorted(open_names, key=lambda n: (-found.inclusion.get(n, 0.0), n)))


def strained(last: Joint, first: Joint, system: System) -> bool:
    """Whether a fit needs declared numbers far outside their doubts, farther than they go without
    what was accepted.
    """
    return strain(last, system) > max(STRAINED, strain(first, system) + 1.0)


def relieved(last: Joint, less: Joint, system: System) -> bool:
    """Whether the declared numbers come nearer to their doubts, by one at least, with a
    name less.
    """
    return strain(less, system) < strain(last, system) - 1.0


def stands(fitted: Fitted, name: str) -> bool:
    """Whether some amplitude is clearly not neutral with its shape held, more than its sd with it
    free, and not within the doubt that is declared, and none went as far as the effect allows; a
    wind, whether it blows at all.
    """
    effect = effect_table.get(name)
    if effect.kind == "wind" and wind_speed_m_s(name, fitted.effects[name]) < STILL_AIR_M_S:
        return False
    clear, declared = False, fitted.board.system.model.doubts
    for parameter in (p for e, p in fitted.free if e == name and p not in effect.shapes):
        value, a = fitted.effects[name][parameter], amplitude_of(name, parameter)
        if value != a.neutral and value in (a.low, a.high):
            return False
        told = abs(value - a.neutral) > max(
            fitted.sd(name, parameter), DOUBTFUL_SDS * declared.get(f"{name}.{parameter}", 0.0)
        )
        clear |= told and fitted.sds_from_neutral(name, parameter) > (
            OPEN_SDS if unlike_form_error(name) else CLEAR_SDS
        )
    return clear


def does_something(fitted: Fitted, name: str) -> bool:
    """Whether some amplitude is further from neutral than its sd."""
    own = [
        (p, amplitude_of(name, p).neutral)
        for e, p in fitted.free
        if e == name and p not in effect_table.get(name).shapes
    ]
    return any(abs(fitted.effects[name][p] - neutral) > fitted.sd(name, p) for p, neutral in own)
