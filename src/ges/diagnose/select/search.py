"""Which set of candidates the flights support: singles and pairs exactly, larger sets by search."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from ges.diagnose.design.system import variant_of
from ges.diagnose.library.candidates import Candidate, Variant, has_prerequisite, modifiers_of
from ges.diagnose.select.evidence import Posterior, Regression
from ges.diagnose.select.scorer import Entry, SetScorer, entries, set_scorer
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """A set of candidates with the best variant of each, its posterior and its probability among
    all that were weighed.
    """

    names: tuple[str, ...]
    variants: tuple[int, ...]
    posterior: Posterior
    log_evidence: float
    probability: float = 0.0
    log_prior: float = 0.0

    @property
    def of_flights(self) -> float:
        """Log evidence of the flights alone, whatever its size and however rarely such names are
        met.
        """
        return self.log_evidence - self.log_prior - log_rarity(self.names)


@dataclasses.dataclass(frozen=True)
class SearchResult:
    """All weighed hypotheses, best first, and the probability that each candidate takes part."""

    hypotheses: tuple[Hypothesis, ...]
    inclusion: Mapping[str, float]

    @property
    def best(self) -> Hypothesis:
        """The most probable."""
        return self.hypotheses[0]

    def best_with(self, name: str, others: Collection[str] = ()) -> Hypothesis:
        """The most probable set that has this name, and none of some others where there is one."""
        having = [h for h in self.hypotheses if name in h.names]
        alone = [h for h in having if not set(others) - {name} & set(h.names)]
        return max(alone or having, key=lambda h: h.log_evidence)

    def null(self) -> Hypothesis:
        """Nothing but the declared doubts."""
        return next(h for h in self.hypotheses if not h.names)


def size_of(names: Sequence[str]) -> int:
    """How many causes a set has: what acts through another of the set counts no more than that one
    alone.
    """
    return sum(not set(effect_table.get(name).prerequisites) & set(names) for name in names)


def _log_prior(names: Sequence[str], count: int) -> float:
    """Of one set of this size among all of them."""
    size = size_of(names)
    # (7) of docs/method.md: all sets of one size share the prior of that size
    return float(
        np.log(settings.search.size_probabilities[size]) - np.log(max(1, math.comb(count, size)))
    )


def log_odds_against_one_of(count: int) -> float:
    """Log odds of nothing against one cause out of so many, before any flight."""
    none, one, *_ = settings.search.size_probabilities
    return math.log(none / one * count)


def log_rarity(names: Sequence[str]) -> float:
    """How much less often than others of their number such names are met."""
    return sum(math.log(effect_table.get(name).rarity) for name in names)


def _compatible(names: Sequence[str], base: Sequence[str]) -> bool:
    present = set(names) | set(base)
    return all(has_prerequisite(n, present) for n in names)


def _sets_of(
    on: SetScorer, combos: Sequence[tuple[Entry, ...]], count: int
) -> dict[tuple[str, ...], Hypothesis]:
    """Evidence of every set of names: mean over the variants, the best variant kept."""
    share = np.array([sum(e.log_share for e in combo) for combo in combos])
    weight = on.log_evidences(combos) + share
    grouped: dict[tuple[str, ...], list[int]] = {}
    for i, combo in enumerate(combos):
        grouped.setdefault(tuple(sorted(e.name for e in combo)), []).append(i)
    best = [combos[max(members, key=lambda i: weight[i])] for members in grouped.values()]
    out = {}
    for (names, members), top, found in zip(
        grouped.items(), best, on.posteriors(best), strict=True
    ):
        prior, rarity = _log_prior(names, count), log_rarity(names)
        # mean over variants by their shares, among those alone that were weighed
        mean = np.logaddexp.reduce(weight[members]) - np.logaddexp.reduce(share[members])
        total = float(mean) + prior + rarity
        out[names] = Hypothesis(names, tuple(e.number for e in top), found, total, log_prior=prior)
    return out


def search(
    regression: Regression, candidates: Sequence[Candidate], base: Sequence[str] = ()
) -> SearchResult:
    """Weigh the null, all singles, all pairs, and larger sets grown from the best.

    Parameters
    ----------
    base : effects that are switched on already (so their modifiers may act).
    """
    listed = entries(regression, candidates)
    on = set_scorer(regression, listed)
    count = max(len({e.name for e in listed}), 1)
    nothing = _log_prior((), count)
    found: dict[tuple[str, ...], Hypothesis] = {
        (): Hypothesis((), (), Posterior.of_nothing(), nothing, log_prior=nothing)
    }
    combos = [(e,) for e in listed] + [
        p for p in itertools.combinations(listed, 2) if p[0].name != p[1].name
    ]
    found |= _sets_of(on, [c for c in combos if _compatible([e.name for e in c], base)], count)
    # beam: a larger set has one of the best sets so far, with its best variants, and one name more
    for size in range(2, len(settings.search.size_probabilities) - 1):
        grown = [h for h in found.values() if len(h.names) == size]
        top = sorted(grown, key=lambda h: -h.log_evidence)[: settings.search.beam]
        by_number = {e.number: e for e in listed}
        larger = [
            (*(by_number[i] for i in h.variants), e)
            for h in top
            for e in listed
            if e.name not in h.names and _compatible([*h.names, e.name], base)
        ]
        for names, h in _sets_of(on, larger, count).items():
            if names not in found or found[names].log_evidence < h.log_evidence:
                found[names] = h
    return _normalised(list(found.values()))


def over_plain(regression: Regression, candidates: Sequence[Candidate], best: Hypothesis) -> float:
    """Log evidence of the best set over that of the same names without what modifies a variant of
    them.
    """
    listed = entries(regression, candidates)
    on, chosen = (
        set_scorer(regression, listed),
        [next(e for e in listed if e.number == i) for i in best.variants],
    )
    plain = [e for e in listed if not modifiers_of(_variant_of(regression, e))]
    # what nothing modifies stays; for each of the others all plain variants of its name
    options = [
        [e] if e in plain else [other for other in plain if other.name == e.name] for e in chosen
    ]
    return float(
        on.log_evidences([chosen])[0] - on.log_evidences(list(itertools.product(*options))).max()
    )


def _variant_of(regression: Regression, entry: Entry) -> Variant:
    return variant_of(regression.system.columns[entry.columns[0]])


def exactly(regression: Regression, candidates: Sequence[Candidate]) -> SearchResult:
    """All candidates together and nothing else, the best variant of each."""
    listed = entries(regression, candidates)
    by_name = [
        [e for e in listed if e.name == name] for name in dict.fromkeys(e.name for e in listed)
    ]
    on = set_scorer(regression, listed)
    chosen = [on.best([(e,) for e in options])[0] for options in by_name]
    if not chosen:
        return _normalised([Hypothesis((), (), Posterior.of_nothing(), 0.0)])
    # coordinate ascent: what is best alone need not be best beside the others
    for _ in range(2):
        for i, options in enumerate(by_name):
            chosen = [*on.best([[*chosen[:i], e, *chosen[i + 1 :]] for e in options])]
    found = on.posteriors([chosen])[0]
    names = tuple(sorted(e.name for e in chosen))
    return _normalised(
        [Hypothesis(names, tuple(e.number for e in chosen), found, found.log_evidence)]
    )


def _normalised(found: list[Hypothesis]) -> SearchResult:
    total = logsumexp([h.log_evidence for h in found])
    weighed = [
        dataclasses.replace(h, probability=float(np.exp(h.log_evidence - total))) for h in found
    ]
    # names decide between equals, not the order in which sets were tried
    weighed.sort(key=lambda h: (-h.log_evidence, h.names))
    names = {n for h in weighed for n in h.names}
    inclusion = {
        n: float(sum(h.probability for h in weighed if n in h.names)) for n in sorted(names)
    }
    return SearchResult(tuple(weighed), inclusion)
