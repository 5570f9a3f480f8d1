"""What sets of candidates are weighed on: their columns and normal equations, every set by its own
columns alone.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.design.system import variant_of
from ges.diagnose.library.candidates import Candidate
from ges.diagnose.select.evidence import Gram, Posterior, Prior, Regression, posteriors
from ges.diagnose.settings import settings
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class Entry:
    """One variant of one candidate: its columns, what they are coefficients of, as
    ``effect.parameter``, and its log prior among the variants of its name.
    """

    name: str
    number: int
    columns: tuple[int, ...]
    keys: tuple[str, ...]
    log_share: float


def entries(regression: Regression, candidates: Sequence[Candidate]) -> list[Entry]:
    """Variants whose columns the flights excite at all."""
    allowed, all_columns = {c.name for c in candidates}, regression.system.columns
    found = [
        (name, columns) for (name, _), columns in regression.by_variant().items() if name in allowed
    ]
    keys = [tuple(dict.fromkeys(all_columns[k].key for k in columns)) for _, columns in found]
    shares = _log_shares(
        [(name, max(1, len(variant_of(all_columns[columns[0]]).places))) for name, columns in found]
    )
    return [
        Entry(name, i, tuple(columns), keys[i], shares[i])
        for i, (name, columns) in enumerate(found)
    ]


def _log_shares(variants: Sequence[tuple[str, int]]) -> list[float]:
    """Log prior of variants, given by name and in how many places they act, among those of their
    name: all alike, but that so many places are as much rarer as so many causes are.
    """
    many, sizes = Counter(variants), settings.search.size_probabilities
    weight = {(n, k): sizes[k] / sizes[1] for n, k in many}
    total: dict[str, float] = {}
    for name, places in many:
        total[name] = total.get(name, 0.0) + weight[name, places]
    # each number of places has its share of the name, which its variants split evenly
    return [math.log(weight[v] / total[v[0]] / many[v]) for v in variants]


@dataclasses.dataclass(frozen=True)
class Twins:
    """Nuisances that some candidate frees, by ``effect.parameter``: their prior, and their
    posterior where nothing is (mean (t,), covariance (t, t)), from which the columns (K,) move them
    by -``moved`` (t, K).
    """

    place: Mapping[str, int]
    prior_mean: np.ndarray
    prior_sd: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    moved: np.ndarray

    def known_zero(
        self, freed: np.ndarray, own: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the twins ``freed`` (s, f), once known to be zero, add to normal equations and log
        evidence of sets of columns ``own`` (s, k): (s, k, k), (s, k), (s,). By the density of their
        posterior there over that of their prior (Dickey 1971).
        """
        # beside coefficients b the twins are N(mean - moved b, C): the density at zero is Gaussian
        # in b, and adds moved^T C^-1 moved, moved^T C^-1 mean and a constant
        mean, moved = self.mean[freed], self.moved[freed[:, :, None], own[:, None, :]]
        covariance = self.covariance[freed[:, :, None], freed[:, None, :]]
        solved = np.linalg.solve(covariance, np.concatenate([moved, mean[:, :, None]], axis=2))
        over, sd = self.prior_mean[freed] / self.prior_sd[freed], self.prior_sd[freed]
        log_density = -0.5 * (
            np.linalg.slogdet(covariance)[1] + (mean * solved[:, :, -1]).sum(axis=1)
        )
        # less that of the prior; powers of 2 pi cancel
        gain = log_density + (np.log(sd) + 0.5 * over**2).sum(axis=1)
        turned = moved.transpose(0, 2, 1)
        return turned @ solved[:, :, :-1], (turned @ solved[:, :, -1:])[:, :, 0], gain


def _twins(gram: Gram, prior: Prior, at: Mapping[str, int]) -> Twins:
    """Of normal equations in which they are left."""
    columns = np.array(list(at.values()), dtype=int)
    mean, sd = prior.mean[columns], prior.sd[columns]
    # all other nuisances are integrated out by now, the twins about their prior mean here
    covariance = np.linalg.inv(gram.xx[np.ix_(columns, columns)] + np.diag(1.0 / sd**2))
    found = mean + covariance @ gram.about(columns, mean).xy[columns]
    return Twins(
        {key: i for i, key in enumerate(at)},
        mean,
        sd,
        found,
        covariance,
        covariance @ gram.xx[columns],
    )


@dataclasses.dataclass(frozen=True)
class SetScorer:
    """Normal equations with all nuisances integrated out.

    A declared number is right within its doubt, or it is a finding and free: never the sum of both.
    So ``twins`` take part in every set that does not have their effect's candidate for it, and are
    zero beside that.
    """

    gram: Gram
    prior: Prior
    twins: Twins

    def posteriors(self, sets: Sequence[Sequence[Entry]]) -> list[Posterior]:
        """Posterior of the columns of every set; its log evidence over that of the
        nuisances alone.
        """
        told: dict[int, Posterior] = {}
        for at, own, found in self._by_size(sets):
            for i, columns, mean, covariance, log_evidence in zip(
                at, own.tolist(), *found, strict=True
            ):
                told[i] = Posterior(tuple(columns), mean, covariance, float(log_evidence))
        return [told[i] for i in range(len(sets))]

    def log_evidences(self, sets: Sequence[Sequence[Entry]]) -> np.ndarray:
        """Of every set over the nuisances alone, (s,)."""
        out = np.zeros(len(sets))
        for at, _, (_, _, log_evidence) in self._by_size(sets):
            out[at] = log_evidence
        return out

    def best(self, sets: Sequence[Sequence[Entry]]) -> Sequence[Entry]:
        """The set with most evidence."""
        return sets[int(np.argmax(self.log_evidences(sets)))]

    def _by_size(
        self, sets: Sequence[Sequence[Entry]]
    ) -> list[tuple[list[int], np.ndarray, tuple]]:
        """Which sets, their columns and their posteriors, those with as many columns and freed
        nuisances at once.
        """
        # sets of one shape are one stack of matrices; few enough at once for the memory
        alike: dict[tuple[int, int], list[tuple[int, tuple[int, ...], tuple[int, ...]]]] = {}
        for i, chosen in enumerate(sets):
            own = tuple(itertools.chain.from_iterable(e.columns for e in chosen))
            freed = tuple(
                {
                    self.twins.place[key]: 0
                    for e in chosen
                    for key in e.keys
                    if key in self.twins.place
                }
            )
            alike.setdefault((len(own), len(freed)), []).append((i, own, freed))
        most = settings.numerics.sets_at_once
        parts = [
            group[i : i + most] for group in alike.values() for i in range(0, len(group), most)
        ]
        return each(self._together, parts)

    def _together(
        self, part: Sequence[tuple[int, tuple[int, ...], tuple[int, ...]]]
    ) -> tuple[list[int], np.ndarray, tuple]:
        own = np.array([columns for _, columns, _ in part], dtype=int)
        freed = np.array([twins for _, _, twins in part], dtype=int)
        more = self.twins.known_zero(freed, own) if freed.shape[1] else None
        return [i for i, _, _ in part], own, posteriors(self.gram, own, self.prior, more)


def set_scorer(regression: Regression, listed: Sequence[Entry]) -> SetScorer:
    """For these variants."""
    columns, keys = regression.system.columns, {key for e in listed for key in e.keys}
    at = {
        columns[k].key: int(k)
        for k in regression.nuisance
        if regression.prior.sd[k] > 0 and columns[k].key in keys
    }
    return SetScorer(
        regression.pooled(),
        regression.prior,
        _twins(regression.pooled(frozenset(at.values())), regression.prior, at),
    )
