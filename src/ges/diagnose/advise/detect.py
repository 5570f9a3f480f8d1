"""The smallest size of every effect that these flights would have shown, from the information
matrix alone.

The flights' noise, nuisances and rivals are those of the search itself: an effect counts as seen
when its evidence beats nothing and every rival by the odds that an acceptance takes, in nine of ten
such sets of flights, and when it is large enough to be told (see ``standing``). What is free to be
off without any finding, a motor's lag within its doubt, tells no more of itself than that doubt
leaves. Of an effect of several shapes, a load on threads of any length say, the middle one stands
for all.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri

from ges.diagnose.decide.standing import FAINT, SEPARATE, SURE, lead_over, least_sizes
from ges.diagnose.design.system import Column
from ges.diagnose.estimate.fit import CLIPPING
from ges.diagnose.library.candidates import modifiers_of
from ges.diagnose.select.evidence import TEMPERING, Board, Gram, rms_of
from ges.diagnose.select.search import PRIOR_OF_SIZE, log_rarity
from ges.diagnose.types.model import block_of
from ges.simulator import effects as effect_table

POWER = 0.9


@dataclasses.dataclass(frozen=True)
class _Shape:
    """One variant of one effect: its columns on the board, by true column the evidence that they
    gain and what of it is ``over`` what is free without them, and the price: of their freedom, of
    being one of many shapes, of being rarely met.
    """

    name: str
    columns: tuple[int, ...]
    gain: np.ndarray
    over: np.ndarray
    cost: float


def _shapes(board: Board, gram: Gram, leave_out: Collection[str]) -> list[_Shape]:
    found = [
        (name, columns)
        for (name, _), columns in board.by_variant().items()
        if name not in leave_out
    ]
    many, most = Counter(name for name, _ in found), _most(board)
    return [
        _Shape(
            name,
            tuple(columns),
            gain,
            np.minimum(gain, most),
            cost + math.log(many[name]) - log_rarity([name]),
        )
        for name, columns in found
        for gain, cost in [expected_evidence(gram, columns, board.prior.sd)]
    ]


def _most(board: Board) -> np.ndarray:
    """Evidence per squared unit of every column's coefficient, (K,), that no flights exceed: a
    nuisance of its key costs no more (what columns that hold at different levels differ by would
    count as evidence without end).
    """
    doubt = {key: sd for key, k in board.system.nuisances.items() if (sd := board.prior.sd[k]) > 0}
    return np.array(
        [0.5 / doubt[c.key] ** 2 if c.key in doubt else np.inf for c in board.system.columns]
    )


def expected_evidence(
    gram: Gram, columns: Sequence[int], prior_sd: np.ndarray
) -> tuple[np.ndarray, float]:
    """Log evidence of a set of columns when one column of the board alone acts: ``gain * size^2 -
    cost``, noise left out.

    Returns
    -------
    gain, cost : per squared unit of the coefficient of every column that may be the true one, and
        the price of the set's freedom.
    """
    at = np.asarray(columns, dtype=int)
    scale = prior_sd[at]
    chol = np.linalg.cholesky(np.eye(len(at)) + gram.xx[np.ix_(at, at)] * np.outer(scale, scale))
    half = np.linalg.solve(chol, (gram.xx[at] * scale[:, None]).T[:, :, None])[:, :, 0]
    return 0.5 * np.array([h @ h for h in half]), float(np.log(np.diag(chol)).sum())


def _size_beyond(price: float, per_square: float) -> float:
    """Size from which an evidence that grows as ``per_square size^2`` exceeds a price in nine of
    ten sets of flights, its noise growing with the size.
    """
    if per_square <= 0.0:
        return np.inf if price > 0.0 else 0.0
    half = ndtri(POWER) * math.sqrt(TEMPERING / (2.0 * per_square))
    square = half**2 + price / per_square
    return half + math.sqrt(square) if square >= 0.0 else 0.0


def _needed(shape: _Shape, truth: int, others: Sequence[_Shape], odds: float) -> tuple[float, str]:
    """Size of the true coefficient at which its evidence beats nothing and every other effect; inf
    and the effect that hides it where one does.
    """
    gain, count = float(shape.gain[truth]), len({s.name for s in others} | {shape.name})
    price, rarity = (
        math.log(odds) + shape.cost,
        math.log(PRIOR_OF_SIZE[0] / PRIOR_OF_SIZE[1] * count),
    )
    worst, hidden = _size_beyond(price + rarity, max(float(shape.over[truth]), 1e-300)), ""
    for other in (s for s in others if s.name != shape.name):
        more = lead_over(shape.name, (other.name,)) - SEPARATE
        size = _size_beyond(price + more - other.cost, gain - float(other.gain[truth]))
        if size > worst:
            worst, hidden = size, other.name
    return worst, hidden


def _least_told(board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Coefficient of every column (K,) at which it matters in its greatest channel, and whether it
    acts in the drive alone.
    """
    shares = rms_of(board.system) / least_sizes(board.system)[:, None]
    elsewhere = shares[[block_of(name) != "drive" for name in board.system.main]]
    with np.errstate(divide="ignore"):
        return 1.0 / shares.max(axis=0), ~elsewhere.any(axis=0)


def smallest_detectable(
    board: Board, given: Sequence[str] = (), odds: float = 9.0
) -> dict[str, dict[str, Any]]:
    """Smallest size by effect.

    Parameters
    ----------
    board : of the search, with the columns of every candidate.
    given : effects that are accepted already; beside them the others are judged, and each of them
        beside the rest.
    odds : that an acceptance takes.

    Returns
    -------
    by effect: ``parameter``, ``smallest`` (None where it never would), ``unit``, ``shape`` (the
    fixed parameters), and ``limited_by``, the rival that is hardest to tell from it ('' when it is
    noise).
    """
    pooled, least, told = board.pooled(), _least_told(board), {}
    for name in given:
        told |= _beside(board, pooled, least, {*given} - {name}, {name}, odds)
    return told | _beside(board, pooled, least, {*given}, None, odds)


def _beside(
    board: Board,
    pooled: Gram,
    least_told: tuple[np.ndarray, np.ndarray],
    given: Collection[str],
    asked: Collection[str] | None,
    odds: float,
) -> dict[str, dict]:
    """Smallest sizes of the ``asked`` effects (of all where None), those ``given`` being free and
    no rivals; ``least_told`` of :func:`_least_told`.
    """
    free = np.array(
        [
            k
            for k, c in enumerate(board.system.columns)
            if c.variant is not None and c.variant.effect in given and board.prior.sd[k] > 0
        ],
        dtype=int,
    )
    gram = pooled.without(free, 10.0 * board.prior.sd[free])
    shapes, (least, drive_alone) = _shapes(board, gram, given), least_told
    told: dict[str, list[tuple[float, dict[str, Any]]]] = {}
    for shape in (s for s in shapes if asked is None or s.name in asked):
        for k in (k for k in shape.columns if _is_told(board.system.columns[k])):
            size, hidden = _needed(shape, k, shapes, odds)
            if drive_alone[k]:  # what is faint has to be sure
                size = min(
                    max(size, FAINT * least[k]), _needed(shape, k, shapes, SURE / (1.0 - SURE))[0]
                )
            size, hidden = max((size, hidden), (float(least[k]), ""))
            told.setdefault(shape.name, []).append(_entry(board, k, size, hidden))
    return {name: _standing_for(entries) for name, entries in told.items()}


def _is_told(column: Column) -> bool:
    """Whether a size is told of it: of the main part of effects that nothing modifies."""
    return column.part != "moment" and not modifiers_of(column.variant)


def _standing_for(entries: list[tuple[float, dict[str, Any]]]) -> dict[str, Any]:
    """The middle of entries by their relative size."""
    return sorted(entries, key=lambda entry: entry[0])[(len(entries) - 1) // 2][1]


def _entry(board: Board, k: int, size: float, hidden: str) -> tuple[float, dict[str, Any]]:
    """The size relative to the parameter's room, and what is told of it; of what clips, the level,
    if its whole is seen.
    """
    variant = board.system.columns[k].variant
    amplitude = variant.amplitudes[board.system.columns[k].amplitude]
    room = max(amplitude.high - amplitude.neutral, amplitude.neutral - amplitude.low)
    if variant.effect in CLIPPING:
        size = abs(amplitude.level) if size <= abs(amplitude.level) else np.inf
    seen = np.isfinite(size) and size <= room
    unit = effect_table.get(variant.effect).parameter(amplitude.parameter).unit
    entry = {
        "parameter": amplitude.parameter,
        "smallest": size if seen else None,
        "unit": unit,
        "shape": dict(variant.shape),
        "limited_by": hidden,
    }
    return (size / abs(amplitude.step) if seen else np.inf), entry
