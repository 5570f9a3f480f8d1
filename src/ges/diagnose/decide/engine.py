"""The whole chain: gate, calibration, location, search, fit, proof, verdict. It sees tables and
indices, never a name.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd
from scipy.special import expit

from ges.diagnose.decide.standing import (
    ACCEPT,
    SEPARATE,
    ambiguous,
    does_something,
    mattering,
    replaced_by,
    stands,
)
from ges.diagnose.design.system import ALL_ON, Switches, System, build
from ges.diagnose.detectors.balance import undecided
from ges.diagnose.detectors.loads import likely_load, sharpened
from ges.diagnose.estimate.fit import Fitted, fitted_model, free_parameters, polish, starting_values
from ges.diagnose.estimate.shoot import shot
from ges.diagnose.library.candidates import (
    Candidate,
    acts_among,
    flown,
    modifiers_of,
)
from ges.diagnose.library.grids import library
from ges.diagnose.library.requirements import lacking
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.select.evidence import Board, make_board
from ges.diagnose.select.search import Hypothesis, Search, over_plain
from ges.diagnose.select.stable import search_until_stable
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

RARER_MODIFIED = math.log(8.0)
"""Log odds against each of some five modifiers of an effect before any flight, as a search of them
alone has them.
"""


@dataclasses.dataclass(frozen=True)
class Accepted:
    """Outcome of the search on the training flights; ``rivals`` are names of which one is needed,
    the likeliest first, ``contested`` those of them that others could replace, ``alternatives`` the
    fits with each, the first of them ``fitted``.
    """

    names: tuple[str, ...]
    found: Search
    board: Board
    fitted: Fitted | None
    probability: dict[str, float]
    rivals: tuple[str, ...]
    contested: frozenset[str] = frozenset()
    alternatives: Mapping[str, Fitted] = dataclasses.field(default_factory=dict)

    @property
    def modelled(self) -> tuple[str, ...]:
        """The names, and the first of the alternatives beside them."""
        return (*self.names, *itertools.islice(self.alternatives, 1))


def split(
    digests: Sequence[str], usable: Sequence[int], holdout: Sequence[int] | None
) -> tuple[list[int], list[int]]:
    """Training and held-out flights.

    Without a request a quarter of the flights (at least one where there are two) is held out, drawn
    by the flights' :func:`digest`: the rule sees no content, and neither names nor order matter.
    """
    if holdout is not None:
        held = [i for i in usable if i in set(holdout)]
        return [i for i in usable if i not in set(held)], held
    ranked = sorted(usable, key=lambda i: digests[i])
    count = max(1, len(usable) // 4) if len(usable) > 1 else 0
    held = sorted(ranked[:count])
    return [i for i in usable if i not in set(held)], held


def digest(frame: pd.DataFrame) -> str:
    """Hash of what a flight recorded."""
    numbers = frame.reindex(sorted(frame.columns), axis=1).to_numpy(dtype=float)
    return hashlib.sha256(np.ascontiguousarray(numbers).tobytes()).hexdigest()


def candidates_of(
    flights: Sequence[Prepared],
    base: Model,
    taken: Sequence[str] = (),
    only: Sequence[str] | None = None,
):
    """Candidates that can act now: those that need no other at first, then what acts through the
    effects that are on.
    """
    return [
        c
        for c in library(base, flown(flights)).values()
        if c.name not in taken
        and (only is None or c.name in only)
        and not lacking(c.name, flights, base)
        and (set(c.carriers) & set(base.effects) or c.stands_alone and not taken)
    ]


def first_system(
    flights: Sequence[Prepared], model: Model, length_s: float, switches: Switches
) -> System:
    """The system of the declared vehicle with every candidate that needs no other."""
    variants = [v for c in candidates_of(flights, model) for v in c.variants]
    return build(flights, model, variants, length_s, switches=switches)


def accept(
    start: Board, length_s: float, switches: Switches = ALL_ON, only: Sequence[str] | None = None
) -> Accepted:
    """Search the library, keep what is proven, then let effects that modify the kept ones compete
    too.

    Parameters
    ----------
    start : of :func:`first_system`, with nothing chosen.
    only : fit exactly these names instead of searching.
    """
    system, flights, model = (
        start.system,
        [r.flight for r in start.system.flights],
        start.system.model,
    )
    listed, names, probability, shares, contested = (
        candidates_of(flights, model, (), only),
        (),
        {},
        {},
        set(),
    )
    first, fitted, base = None, None, model
    open_names = undecided(system) if only is None else frozenset()
    while listed:
        here = start if first is None else _laid_out(listed, base, system, length_s, switches)
        board, found, _ = search_until_stable(here, listed, tuple(base.effects), only)
        board, found = _load_sharper(board, found, listed, length_s, switches, only)
        first = first or (board, found)
        sizes = mattering(board, found, shares)
        replaced = {n: others for n in sizes if (others := replaced_by(found, n))}
        contested = (
            contested
            if names
            else {n for name, others in replaced.items() for n in (name, *others)}
        )
        sizes = {n: s for n, s in sizes.items() if n not in replaced and n not in open_names}
        shares |= sizes
        through = _modifying(board, found, listed, sizes, only)
        new, polished = _polished(
            board,
            found,
            (*sizes, *through),
            through,
            base,
            fitted,
            only is None,
            system,
            length_s,
            switches,
        )
        if not new:
            break
        probability |= {
            n: through[n].probability if n in through else found.inclusion[n] for n in new
        }
        fitted = polished
        names += new
        base = model.with_effects(fitted.effects)
        listed = candidates_of(flights, base, names, only)
    if first is None:
        first = search_until_stable(start, (), ())[:2]
    board, found = first
    settled = {*names, *(n for n, p in found.inclusion.items() if p >= ACCEPT)}
    rivals = ambiguous(found, settled - contested, contested)
    if rivals and not _needed(rivals, base, system, length_s, switches):
        rivals = ()
    return Accepted(names, found, board, fitted, probability, rivals, frozenset(contested))


def _laid_out(
    listed: Sequence[Candidate], base: Model, like: System, length_s: float, switches: Switches
) -> Board:
    """The board of candidates beside the base, on the flights of a system like it."""
    flights, variants = [r.flight for r in like.flights], [v for c in listed for v in c.variants]
    return make_board(build(flights, base, variants, length_s, like, switches))


def _needed(
    rivals: Sequence[str], base: Model, system: System, length_s: float, switches: Switches
) -> bool:
    """Whether one of these is needed still beside what was accepted, as its fit in full has it."""
    listed = candidates_of([r.flight for r in system.flights], base, (), rivals)
    found = search_until_stable(
        _laid_out(listed, base, system, length_s, switches), listed, tuple(base.effects)
    )[1]
    return found.null().probability <= 1.0 - ACCEPT


@dataclasses.dataclass(frozen=True)
class _Modifying:
    """What the best variant of an effect is modified by: its values, and how probable it is beside
    the effect alone.
    """

    values: Mapping[str, float]
    probability: float


def _modifying(
    board: Board,
    found: Search,
    listed: Sequence[Candidate],
    names: Collection[str],
    only: Sequence[str] | None,
) -> dict[str, _Modifying]:
    """Modifiers of these names' variants in the best set, if no plain variant is nearly as good; or
    if they are asked for.
    """
    variants = (
        [board.system.columns[k].variant for k in found.best.posterior.columns] if names else []
    )
    told = {
        m: values for v in variants if v.effect in names for m, values in modifiers_of(v).items()
    }
    if only is not None:
        return {m: _Modifying(values, 1.0) for m, values in told.items() if m in only}
    odds = over_plain(board, listed, found.best) - RARER_MODIFIED if told else -math.inf
    return (
        {m: _Modifying(values, float(expit(odds))) for m, values in told.items()}
        if odds > SEPARATE
        else {}
    )


def _in_full(
    board: Board,
    h: Hypothesis,
    beside: Fitted | None,
    system: System,
    length_s: float,
    switches: Switches,
    through: effect_table.Effects = MappingProxyType({}),
) -> Fitted:
    """The fit in full of a set that was weighed on a board, beside what is fitted already; the
    system is of the model without. What goes ``through`` effects of the set is fitted with it, from
    its values.
    """
    held, known = (beside.effects, beside.free) if beside else ({}, ())
    values = {
        **starting_values(board, h),
        **{m: {**effect_table.get(m).neutral(), **v} for m, v in through.items()},
    }
    free = [
        *known,
        *free_parameters(board, h, system.model, values),
        *((m, p) for m, v in through.items() for p in v),
    ]
    return polish(
        [r.flight for r in system.flights],
        system.model,
        {**held, **values},
        free,
        length_s,
        system,
        switches,
    )


def _load_sharper(
    board: Board,
    found: Search,
    listed: Sequence[Candidate],
    length_s: float,
    switches: Switches,
    only: Sequence[str] | None,
) -> tuple[Board, Search]:
    """Search again beside a load whose thread and first place are sharp: missed by centimetres,
    they need other names for what is left.
    """
    variant = likely_load(board, found)
    if variant is None:
        return board, found
    known = board.system
    sharp = sharpened(known, variant, length_s, switches)
    listed = [
        dataclasses.replace(c, variants=(*c.variants, sharp)) if c.name == variant.effect else c
        for c in listed
    ]
    here = _laid_out(listed, known.model, known, length_s, switches)
    return search_until_stable(here, listed, tuple(known.model.effects), only)[:2]


def _polished(
    board: Board,
    found: Search,
    new: tuple[str, ...],
    through: Mapping[str, _Modifying],
    base: Model,
    fitted: Fitted | None,
    choosing: bool,
    system: System,
    length_s: float,
    switches: Switches,
) -> tuple[tuple[str, ...], Fitted | None]:
    """The new names that stand when their numbers are fitted in full, and that fit; those that do
    not are left out of it, what goes ``through`` others first.
    """
    while new:
        modifying = {m: through[m].values for m in new if m in through}
        kept = _with_names(found, [n for n in new if n not in modifying], board)
        polished = _in_full(board, kept, fitted, system, length_s, switches, modifying)
        fallen = {n for n in new if choosing and not stands(polished, n)}
        fallen = (fallen & set(modifying)) or fallen
        fallen |= {n for n in new if not acts_among(n, {*base.effects, *(set(new) - fallen)})}
        if not fallen:
            return new, polished
        new = tuple(n for n in new if n not in fallen)
    return (), fitted


def shot_fit(accepted: Accepted, length_s: float, switches: Switches = ALL_ON) -> Accepted:
    """The same, its fit polished by multiple shooting: the model is asked along the path that it
    flies itself.

    What remembers the path, as a load that swings on it, would remember where one piece of it ends
    and the next begins: then nothing is shot.
    """
    fitted, system = accepted.fitted, accepted.board.system
    if fitted is None or any(effect_table.get(name).remembers_the_path for name in fitted.effects):
        return accepted
    found = fitted_model(system.model, fitted)
    flights = [shot(r.flight, found) for r in system.flights]
    polished = polish(
        flights, system.model, fitted.effects, fitted.free, length_s, system, switches
    )
    return dataclasses.replace(accepted, fitted=polished)


def with_alternatives(accepted: Accepted, length_s: float, switches: Switches = ALL_ON) -> Accepted:
    """The same with every name that is open fitted in full beside what is accepted, where it can
    act; without the names that then do nothing, if two are left.
    """
    tried = {name: _beside(accepted, name, length_s, switches) for name in accepted.rivals}
    fits = {
        name: fitted
        for name, fitted in tried.items()
        if fitted is not None and does_something(fitted, name)
    }
    idle = set(tried) - set(fits) if len(fits) > 1 else set()
    rivals = tuple(n for n in accepted.rivals if n not in idle)
    return dataclasses.replace(
        accepted,
        rivals=rivals,
        fitted=next(iter(fits.values()), accepted.fitted),
        alternatives=fits,
    )


def _beside(accepted: Accepted, name: str, length_s: float, switches: Switches) -> Fitted | None:
    """The fit with one open name, and what it acts through, beside what is accepted; None where it
    cannot act.
    """
    system, fitted, best = (
        accepted.board.system,
        accepted.fitted,
        accepted.found.best_with(name, accepted.rivals),
    )
    held = set(fitted.effects) if fitted else set()
    mine = ({name} | set(effect_table.get(name).carriers) & set(best.names)) - held
    if not acts_among(name, {*mine, *held, *system.model.effects}):
        return None
    kept = dataclasses.replace(best, posterior=_only(best, mine, accepted.board))
    full = _in_full(accepted.board, kept, fitted, system, length_s, switches)
    return shot_fit(dataclasses.replace(accepted, fitted=full), length_s, switches).fitted


def without(
    accepted: Accepted, name: str, length_s: float, switches: Switches = ALL_ON
) -> Accepted:
    """The same with one name less, and what acts through it alone; the others fitted anew."""
    fitted, system = accepted.fitted, accepted.board.system
    rest = {*accepted.names, *system.model.effects} - {name}
    names = tuple(n for n in accepted.names if n in rest and acts_among(n, rest))
    if not names:
        return withdrawn(accepted)
    values, free = {n: fitted.effects[n] for n in names}, [f for f in fitted.free if f[0] in names]
    left = polish(
        [r.flight for r in system.flights], system.model, values, free, length_s, system, switches
    )
    probability = {n: accepted.probability[n] for n in names}
    return dataclasses.replace(accepted, names=names, fitted=left, probability=probability)


def without_old_news(accepted: Accepted) -> Accepted:
    """The search without rivals that are needed beside what is proven for no more than healthy
    flights leave too.
    """
    return (
        accepted
        if accepted.contested or not accepted.names
        else dataclasses.replace(accepted, rivals=())
    )


def withdrawn(accepted: Accepted) -> Accepted:
    """The search as it was, with nothing accepted of it."""
    return dataclasses.replace(accepted, names=(), fitted=None, probability={}, rivals=())


def _with_names(found: Search, names: Sequence[str], board: Board) -> Hypothesis:
    """The set of just these names as the search weighed it, else the best set less all others."""
    just = tuple(sorted(names))
    weighed = next((h for h in found.hypotheses if h.names == just), None)
    return weighed or dataclasses.replace(found.best, posterior=_only(found.best, names, board))


def _only(h: Hypothesis, names: Collection[str], board: Board):
    keep = [
        i
        for i, k in enumerate(h.posterior.columns)
        if board.system.columns[k].variant.effect in names
    ]
    p = h.posterior
    return dataclasses.replace(
        p,
        columns=tuple(p.columns[i] for i in keep),
        mean=p.mean[keep],
        covariance=p.covariance[np.ix_(keep, keep)],
    )
