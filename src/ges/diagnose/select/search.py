"""Which set of candidates the flights support: exact for pairs, then beam search."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.special import softmax

from ges.diagnose.design.columns import variant_of
from ges.diagnose.library.candidates import Candidate, Variant, has_prerequisite, modifiers_of
from ges.diagnose.select.evidence import Posterior, Regression
from ges.diagnose.select.scorer import Entry, SetScorer, entries, set_scorer
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """A set of candidates with the best variant of each.

    Attributes
    ----------
    names : of the effects.
    variants : indices of the entries.
    posterior : of the coefficients.
    log_evidence : with the log prior of the set.
    probability : among all sets that were evaluated.
    log_prior : of a set of this size.
    """

    names: tuple[str, ...]
    variants: tuple[int, ...]
    posterior: Posterior
    log_evidence: float
    probability: float = 0.0
    log_prior: float = 0.0

    @property
    def flight_evidence(self) -> float:
        """Log evidence of the flights alone, without priors of size and rarity."""
        return self.log_evidence - self.log_prior - log_rarity(self.names)


@dataclasses.dataclass(frozen=True)
class SearchResult:
    """All hypotheses, best first, and the posterior probability of each candidate.

    Attributes
    ----------
    hypotheses : sorted by log evidence.
    inclusion : probability that a candidate takes part, by name.
    """

    hypotheses: tuple[Hypothesis, ...]
    inclusion: Mapping[str, float]

    @property
    def best(self) -> Hypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    def best_with(self, name: str, others: Collection[str] = ()) -> Hypothesis:
        """Return the most probable set that has a name.

        Parameters
        ----------
        name : that it has.
        others : that it should not have, where there is such a set.
        """
        with_name = [h for h in self.hypotheses if name in h.names]
        alone = [h for h in with_name if not set(others) - {name} & set(h.names)]
        return max(alone or with_name, key=lambda h: h.log_evidence)

    def without(self, names: Collection[str]) -> SearchResult:
        """Return the hypotheses without names, as if these had never been candidates.

        Parameters
        ----------
        names : that take no part.
        """
        return _normalise([h for h in self.hypotheses if not set(h.names) & set(names)])

    def null(self) -> Hypothesis:
        """Return the hypothesis without names: nothing but the prior sds.

        Returns
        -------
        With the null's log evidence, zero but for its prior.
        """
        return next(h for h in self.hypotheses if not h.names)


def cause_count(names: Sequence[str]) -> int:
    """Return how many causes a set has.

    Parameters
    ----------
    names : of the set. What acts through another of them adds none.
    """
    return sum(not set(effect_table.get(name).prerequisites) & set(names) for name in names)


def _log_prior(names: Sequence[str], count: int) -> float:
    """Return log prior of one set of this size among all of them; (7) of docs/method.md."""
    size = cause_count(names)
    # (7) of docs/method.md: all sets of one size share the prior of that size
    return float(
        np.log(settings.search.size_probabilities[size]) - np.log(max(1, math.comb(count, size)))
    )


def log_odds_against_one_of(count: int) -> float:
    """Return the prior log odds of nothing against one cause.

    Parameters
    ----------
    count : how many causes are possible.
    """
    none, one, *_ = settings.search.size_probabilities
    return math.log(none / one * count)


def log_rarity(names: Sequence[str]) -> float:
    """Return how much rarer these names are than others, as a log.

    Parameters
    ----------
    names : of the set.
    """
    return sum(math.log(effect_table.get(name).rarity) for name in names)


def _can_act_together(names: Sequence[str], base: Sequence[str]) -> bool:
    present = set(names) | set(base)
    return all(has_prerequisite(n, present) for n in names)


def _pairs(listed: Sequence[Entry], base: Sequence[str]) -> list[tuple[Entry, ...]]:
    """Return each variant that can act alone, and each two of two names that can act together."""
    names = {e.name for e in listed}
    alone = {name for name in names if _can_act_together([name], base)}
    # there are few names, and thousands of pairs
    together = {
        (one, other)
        for one, other in itertools.permutations(names, 2)
        if _can_act_together([one, other], base)
    }
    return [(e,) for e in listed if e.name in alone] + [
        pair
        for pair in itertools.combinations(listed, 2)
        if (pair[0].name, pair[1].name) in together
    ]


def _hypotheses_of(
    scorer: SetScorer, combos: Sequence[tuple[Entry, ...]], count: int
) -> dict[tuple[str, ...], Hypothesis]:
    """Return the hypotheses of every set of names, with the best variants.

    Evidence is averaged over variants.
    """
    share = np.array([sum([e.log_share for e in combo]) for combo in combos])
    weight = scorer.log_evidences(combos) + share
    # thousands of combinations have few names
    in_order = functools.cache(lambda names: tuple(sorted(names)))
    grouped: dict[tuple[str, ...], list[int]] = {}
    for i, combo in enumerate(combos):
        grouped.setdefault(in_order(tuple([e.name for e in combo])), []).append(i)
    best = [combos[members[int(np.argmax(weight[members]))]] for members in grouped.values()]
    out = {}
    for (names, members), top, posterior in zip(
        grouped.items(), best, scorer.posteriors(best), strict=True
    ):
        prior, rarity = _log_prior(names, count), log_rarity(names)
        # mean over variants by their shares, among those alone that were evaluated
        mean = np.logaddexp.reduce(weight[members]) - np.logaddexp.reduce(share[members])
        total = float(mean) + prior + rarity
        out[names] = Hypothesis(
            names, tuple(e.index for e in top), posterior, total, log_prior=prior
        )
    return out


def search(
    regression: Regression, candidates: Sequence[Candidate], base: Sequence[str] = ()
) -> SearchResult:
    """Evaluate the null, all singles, all pairs, and larger sets grown from the best.

    Parameters
    ----------
    regression : with the columns of all candidates.
    candidates : that take part.
    base : effects that are on already, so that their modifiers may act.
    """
    listed = entries(regression, candidates)
    scorer = set_scorer(regression, listed)
    count = max(len({e.name for e in listed}), 1)
    nothing = _log_prior((), count)
    hypotheses: dict[tuple[str, ...], Hypothesis] = {
        (): Hypothesis((), (), Posterior.empty(), nothing, log_prior=nothing)
    }
    hypotheses |= _hypotheses_of(scorer, _pairs(listed, base), count)
    # beam: a larger set has one of the best sets so far, with its best variants, and one name more
    for size in range(2, len(settings.search.size_probabilities) - 1):
        grown = [h for h in hypotheses.values() if len(h.names) == size]
        top = sorted(grown, key=lambda h: -h.log_evidence)[: settings.search.beam]
        by_index = {e.index: e for e in listed}
        every = {e.name for e in listed}
        more = {
            h.names: {
                name
                for name in every
                if name not in h.names and _can_act_together([*h.names, name], base)
            }
            for h in top
        }
        larger = [
            (*(by_index[i] for i in h.variants), e)
            for h in top
            for e in listed
            if e.name in more[h.names]
        ]
        for names, h in _hypotheses_of(scorer, larger, count).items():
            if names not in hypotheses or hypotheses[names].log_evidence < h.log_evidence:
                hypotheses[names] = h
    return _normalise(list(hypotheses.values()))


def log_evidence_over_plain(
    regression: Regression, candidates: Sequence[Candidate], best: Hypothesis
) -> float:
    """Return the log evidence of the best set over that of its names without modifiers.

    Parameters
    ----------
    regression, candidates : of the search.
    best : its best hypothesis.
    """
    listed = entries(regression, candidates)
    scorer = set_scorer(regression, listed)
    chosen = [next(e for e in listed if e.index == i) for i in best.variants]
    plain = [e for e in listed if not modifiers_of(_variant_of(regression, e))]
    # what nothing modifies stays; for each of the others all plain variants of its name
    options = [
        [e] if e in plain else [other for other in plain if other.name == e.name] for e in chosen
    ]
    return float(
        scorer.log_evidences([chosen])[0]
        - scorer.log_evidences(list(itertools.product(*options))).max()
    )


def _variant_of(regression: Regression, entry: Entry) -> Variant:
    return variant_of(regression.system.columns[entry.columns[0]])


def evaluate_exactly(regression: Regression, candidates: Sequence[Candidate]) -> SearchResult:
    """Evaluate all candidates together and nothing else, with the best variant of each.

    Parameters
    ----------
    regression : with the columns of all candidates.
    candidates : that take part.
    """
    listed = entries(regression, candidates)
    by_name = [
        [e for e in listed if e.name == name] for name in dict.fromkeys(e.name for e in listed)
    ]
    scorer = set_scorer(regression, listed)
    chosen = [scorer.best([(e,) for e in options])[0] for options in by_name]
    if not chosen:
        return _normalise([Hypothesis((), (), Posterior.empty(), 0.0)])
    # coordinate ascent: what is best alone need not be best with the others
    for _ in range(2):
        for i, options in enumerate(by_name):
            chosen = [*scorer.best([[*chosen[:i], e, *chosen[i + 1 :]] for e in options])]
    posterior = scorer.posteriors([chosen])[0]
    names = tuple(sorted(e.name for e in chosen))
    return _normalise(
        [Hypothesis(names, tuple(e.index for e in chosen), posterior, posterior.log_evidence)]
    )


def _normalise(hypotheses: list[Hypothesis]) -> SearchResult:
    # evidences of thousands of nats are known to 1e-12: only a softmax of them sums to one
    probabilities = softmax([h.log_evidence for h in hypotheses])
    normalised = [
        dataclasses.replace(h, probability=float(p))
        for h, p in zip(hypotheses, probabilities, strict=True)
    ]
    # names decide between equals, not the order in which sets were tried
    normalised.sort(key=lambda h: (-h.log_evidence, h.names))
    names = {n for h in normalised for n in h.names}
    inclusion = {
        n: float(sum(h.probability for h in normalised if n in h.names)) for n in sorted(names)
    }
    return SearchResult(tuple(normalised), inclusion)
