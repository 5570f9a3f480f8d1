"""Which set of candidates the flights support: singles and pairs exactly, larger sets by search."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from .candidates import Candidate
from .evidence import Board, Gram, Posterior, posterior, posteriors

PRIOR_OF_SIZE = (0.5, 0.3, 0.13, 0.05, 0.02)
LARGEST = 4
BEAM = 3
AT_ONCE = 4096


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """A set of candidates with the best variant of each, its posterior and its probability among all that were weighed."""

    names: tuple[str, ...]
    variants: tuple[int, ...]
    posterior: Posterior | None
    log_evidence: float
    probability: float = 0.0


@dataclasses.dataclass(frozen=True)
class Search:
    """All weighed hypotheses, best first, and the probability that each candidate takes part."""

    hypotheses: tuple[Hypothesis, ...]
    inclusion: Mapping[str, float]

    @property
    def best(self) -> Hypothesis:
        """The most probable."""
        return self.hypotheses[0]

    def null(self) -> Hypothesis:
        """Nothing but the declared doubts."""
        return next(h for h in self.hypotheses if not h.names)


@dataclasses.dataclass(frozen=True)
class Entry:
    """Columns of one variant of one candidate."""

    name: str
    number: int
    columns: tuple[int, ...]


def entries(board: Board, candidates: Sequence[Candidate]) -> list[Entry]:
    """Variants whose columns the flights excite at all."""
    allowed = {c.name for c in candidates}
    found: dict[tuple[str, str], list[int]] = {}
    for k, column in enumerate(board.system.columns):
        if column.variant is not None and column.variant.effect in allowed and board.prior_sd[k] > 0:
            found.setdefault((column.variant.effect, column.variant.key), []).append(k)
    return [Entry(name, i, tuple(columns)) for i, ((name, _), columns) in enumerate(found.items())]


def _log_prior(size: int, count: int) -> float:
    sets = max(1.0, float(np.prod([count - i for i in range(size)]) / np.prod(range(1, size + 1))))
    return float(np.log(PRIOR_OF_SIZE[size]) - np.log(sets))


def _columns(chosen: Sequence[Entry]) -> tuple[int, ...]:
    return tuple(k for e in chosen for k in e.columns)


def _weigh(gram: Gram, board: Board, chosen: Sequence[Entry]) -> Posterior:
    return posterior(gram, _columns(chosen), board.prior_sd, board.one_sided)


def _log_evidences(gram: Gram, board: Board, combos: Sequence[tuple[Entry, ...]]) -> np.ndarray:
    """Log evidence of every combination, those of one number of columns at once."""
    columns = [_columns(c) for c in combos]
    sizes, out = np.array([len(c) for c in columns], dtype=int), np.zeros(len(combos))
    for size in np.unique(sizes):
        same = np.flatnonzero(sizes == size)
        for part in np.array_split(same, 1 + len(same) // AT_ONCE):
            out[part] = posteriors(gram, [columns[i] for i in part], board.prior_sd, board.one_sided)[2]
    return out


def _compatible(names: Sequence[str], needs: Mapping[str, tuple[str, ...]], base: Sequence[str]) -> bool:
    present = set(names) | set(base)
    return all(not needs[n] or present & set(needs[n]) for n in names)


def _sets_of(gram: Gram, board: Board, combos: Sequence[tuple[Entry, ...]], count: int) -> dict[tuple[str, ...], Hypothesis]:
    """Evidence of every set of names: mean over the variants, the best variant kept."""
    weight = _log_evidences(gram, board, combos)
    grouped: dict[tuple[str, ...], list[int]] = {}
    for i, combo in enumerate(combos):
        grouped.setdefault(tuple(sorted(e.name for e in combo)), []).append(i)
    out = {}
    for names, members in grouped.items():
        top = combos[max(members, key=lambda i: weight[i])]
        total = float(logsumexp(weight[members]) - np.log(len(members))) + _log_prior(len(names), count)
        out[names] = Hypothesis(names, tuple(e.number for e in top), _weigh(gram, board, top), total)
    return out


def search(board: Board, candidates: Sequence[Candidate], base: Sequence[str] = (), leave_out: int | None = None) -> Search:
    """Weigh the null, all singles, all pairs, and larger sets grown from the best.

    Parameters
    ----------
    base : effects that are switched on already (so their modifiers may act).
    leave_out : a flight that takes no part.
    """
    gram, listed = board.pooled(leave_out), entries(board, candidates)
    needs = {c.name: c.needs for c in candidates}
    count = max(len({e.name for e in listed}), 1)
    found: dict[tuple[str, ...], Hypothesis] = {(): Hypothesis((), (), None, _log_prior(0, count))}
    combos = [(e,) for e in listed] + [p for p in itertools.combinations(listed, 2) if p[0].name != p[1].name]
    found |= _sets_of(gram, board, [c for c in combos if _compatible([e.name for e in c], needs, base)], count)
    for size in range(2, LARGEST):
        grown = [h for h in found.values() if len(h.names) == size]
        top = sorted(grown, key=lambda h: -h.log_evidence)[:BEAM]
        by_number = {e.number: e for e in listed}
        larger = [
            (*(by_number[i] for i in h.variants), e)
            for h in top
            for e in listed
            if e.name not in h.names and _compatible([*h.names, e.name], needs, base)
        ]
        for names, h in _sets_of(gram, board, larger, count).items():
            if names not in found or found[names].log_evidence < h.log_evidence:
                found[names] = h
    return _normalised(list(found.values()))


def exactly(board: Board, candidates: Sequence[Candidate]) -> Search:
    """All candidates together and nothing else, the best variant of each."""
    listed = entries(board, candidates)
    by_name = [[e for e in listed if e.name == name] for name in dict.fromkeys(e.name for e in listed)]
    gram = board.pooled()
    chosen = [max(options, key=lambda e: _weigh(gram, board, (e,)).log_evidence) for options in by_name]
    if not chosen:
        return _normalised([Hypothesis((), (), None, 0.0)])
    for _ in range(2):
        for i, options in enumerate(by_name):
            chosen[i] = max(options, key=lambda e, i=i: _weigh(gram, board, [*chosen[:i], e, *chosen[i + 1 :]]).log_evidence)
    found = _weigh(gram, board, chosen)
    names = tuple(sorted(e.name for e in chosen))
    return _normalised([Hypothesis(names, tuple(e.number for e in chosen), found, found.log_evidence)])


def _normalised(found: list[Hypothesis]) -> Search:
    total = logsumexp([h.log_evidence for h in found])
    weighed = [dataclasses.replace(h, probability=float(np.exp(h.log_evidence - total))) for h in found]
    weighed.sort(key=lambda h: (-h.log_evidence, h.names))
    names = {n for h in weighed for n in h.names}
    inclusion = {n: float(sum(h.probability for h in weighed if n in h.names)) for n in sorted(names)}
    return Search(tuple(weighed), inclusion)
