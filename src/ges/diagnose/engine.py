"""The whole chain: gate, calibration, location, search, fit, proof, verdict. It sees tables and indices, never a name."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence

import numpy as np
import pandas as pd

from .align import Prepared
from .candidates import NEEDS_ATTITUDE, Candidate, library
from .evidence import Board, make_board
from .fit import Fitted, Joint, free_parameters, joint_fit, polish, starting_values
from .model import Model
from .select import Hypothesis, Search, search
from .system import System, attitude_measured, build

ACCEPT = 0.9
ROUNDS = 4


@dataclasses.dataclass(frozen=True)
class Accepted:
    """Outcome of the search on the training flights."""

    names: tuple[str, ...]
    found: Search
    board: Board
    fitted: Fitted | None
    probability: dict[str, float]
    rivals: tuple[tuple[str, ...], ...]


def split(frames: Sequence[pd.DataFrame], usable: Sequence[int], holdout: Sequence[int] | None) -> tuple[list[int], list[int]]:
    """Training and held-out flights.

    Without a request a quarter of the flights (at least one where there are two) is held out, drawn by a hash of their
    bytes: the rule sees no content, and neither names nor order matter.
    """
    if holdout is not None:
        held = [i for i in usable if i in set(holdout)]
        return [i for i in usable if i not in set(held)], held
    ranked = sorted(usable, key=lambda i: _digest(frames[i]))
    count = max(1, len(usable) // 4) if len(usable) > 1 else 0
    held = sorted(ranked[:count])
    return [i for i in usable if i not in set(held)], held


def _digest(frame: pd.DataFrame) -> str:
    numbers = frame.reindex(sorted(frame.columns), axis=1).to_numpy(dtype=float)
    return hashlib.sha256(np.ascontiguousarray(numbers).tobytes()).hexdigest()


def _pick(h: Hypothesis, names: Sequence[str], board: Board) -> tuple[int, ...]:
    return tuple(k for k in (h.posterior.columns if h.posterior else ()) if board.system.columns[k].variant.effect in names)


def search_until_stable(
    system: System, candidates: Sequence[Candidate], base: Sequence[str]
) -> tuple[Board, Search, tuple[int, ...]]:
    """Search, measure the noise that the best set leaves, search again; starts from the most cautious noise."""
    chosen: tuple[int, ...] = ()
    for _ in range(ROUNDS):
        board = make_board(system, chosen)
        found = search(board, candidates, base)
        sure = [n for n in found.best.names if found.inclusion[n] > 0.5]
        now = _pick(found.best, sure, board)
        if set(now) == set(chosen):
            break
        chosen = now
    return board, found, chosen


def accept(flights: Sequence[Prepared], model: Model, length_s: float) -> Accepted:
    """Search the library, keep what is proven, then let effects that modify the kept ones compete too."""
    names: tuple[str, ...] = ()
    probability: dict[str, float] = {}
    base, fitted, first, rates = model, None, None, attitude_measured(flights)
    for turn in range(3):
        listed = [
            c for c in library(base).values()
            if c.name not in names and (set(c.needs) & set(base.effects) if c.needs else not turn)
            and (rates or c.name not in NEEDS_ATTITUDE)
        ]  # fmt: skip
        if not listed:
            break
        system = build(flights, base, [v for c in listed for v in c.variants], length_s)
        board, found, _ = search_until_stable(system, listed, tuple(base.effects))
        first = first or (board, found)
        new = tuple(n for n in found.best.names if found.inclusion[n] >= ACCEPT)
        if not new:
            break
        probability |= {n: found.inclusion[n] for n in new}
        kept = dataclasses.replace(found.best, posterior=_only(found.best, new, board))
        values = starting_values(board, kept)
        held = dict(fitted.effects) if fitted else {}
        free = list(fitted.free) if fitted else []
        fitted = polish(flights, model, {**held, **values}, free + free_parameters(board, kept, model, values), length_s)
        names += new
        base = model.with_effects(fitted.effects)
        if not any(set(c.needs) & set(new) for c in library(model).values()):
            break
    board, found = first
    return Accepted(names, found, board, fitted, probability, _ambiguous(found, names))


def _only(h: Hypothesis, names: Sequence[str], board: Board):
    keep = [i for i, k in enumerate(h.posterior.columns) if board.system.columns[k].variant.effect in names]
    p = h.posterior
    return dataclasses.replace(
        p, columns=tuple(p.columns[i] for i in keep), mean=p.mean[keep], covariance=p.covariance[np.ix_(keep, keep)]
    )


def _ambiguous(found: Search, names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Names that replace each other: none proven alone, but one of them needed."""
    open_names = {n: p for n, p in found.inclusion.items() if n not in names and p > 0.1}
    without = sum(h.probability for h in found.hypotheses if not set(h.names) - set(names))
    if without > 1.0 - ACCEPT or len(open_names) < 2:
        return ()
    ranked = sorted(open_names, key=lambda n: -open_names[n])
    return (tuple(ranked),)


def null_of(flights: Sequence[Prepared], model: Model, length_s: float) -> tuple[Board, Joint, System]:
    """Calibration alone: the best that the declared parameters can do."""
    system = build(flights, model, [], length_s)
    board = make_board(system)
    return board, joint_fit(board, ()), system
