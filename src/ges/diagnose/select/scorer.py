"""Evidence of any set of candidates, each from its own columns alone."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.design.columns import variant_of
from ges.diagnose.library.candidates import Candidate
from ges.diagnose.select.evidence import Gram, Posterior, Prior, Regression, posteriors
from ges.diagnose.settings import settings
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class Entry:
    """One variant of one candidate.

    Attributes
    ----------
    name : of the effect.
    index : of the variant among all.
    columns : of its amplitudes.
    keys : their ``effect.parameter``.
    log_share : log prior among the variants of its name.
    """

    name: str
    index: int
    columns: tuple[int, ...]
    keys: tuple[str, ...]
    log_share: float


def entries(regression: Regression, candidates: Sequence[Candidate]) -> list[Entry]:
    """Return the variants whose columns the flights excite.

    Parameters
    ----------
    regression : with the columns of all variants.
    candidates : that are allowed.
    """
    allowed, all_columns = {c.name for c in candidates}, regression.system.columns
    listed = [
        (name, columns) for (name, _), columns in regression.by_variant().items() if name in allowed
    ]
    keys = [tuple(dict.fromkeys(all_columns[k].key for k in columns)) for _, columns in listed]
    shares = _log_shares(
        [
            (name, max(1, len(variant_of(all_columns[columns[0]]).places)))
            for name, columns in listed
        ]
    )
    return [
        Entry(name, i, tuple(columns), keys[i], shares[i])
        for i, (name, columns) in enumerate(listed)
    ]


def _log_shares(variants: Sequence[tuple[str, int]]) -> list[float]:
    """Return log priors of variants, given by name and number of places, among those of their name.

    Several places are as much rarer than one as several causes are.
    """
    many, sizes = Counter(variants), settings.search.size_probabilities
    weight = {(n, k): sizes[k] / sizes[1] for n, k in many}
    total: dict[str, float] = {}
    for name, places in many:
        total[name] = total.get(name, 0.0) + weight[name, places]
    # each number of places has its share of the name, which its variants split evenly
    return [math.log(weight[v] / total[v[0]] / many[v]) for v in variants]


@dataclasses.dataclass(frozen=True)
class FreedNuisances:
    """Nuisances whose number some candidate frees, with prior and posterior.

    Attributes
    ----------
    index : of each by ``effect.parameter``.
    prior_mean, prior_sd : (t,).
    mean, covariance : (t,) and (t, t), posterior with all candidates at zero.
    shift_per_unit : (t, K) decrease of the mean per unit of each column's coefficient.
    """

    index: Mapping[str, int]
    prior_mean: np.ndarray
    prior_sd: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    shift_per_unit: np.ndarray

    def condition_on_zero(
        self, freed: np.ndarray, own: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Set some nuisances to zero in sets of columns.

        Parameters
        ----------
        freed : (s, f) indices of the nuisances.
        own : (s, k) columns of the sets.

        Returns
        -------
        What this adds to normal equations and log evidence: (s, k, k), (s, k), (s,).

        Notes
        -----
        The evidence changes by the density of their posterior at zero over that of their prior
        (Dickey 1971).
        """
        # given coefficients b the nuisances are N(mean - shift_per_unit b, C): the density at zero
        # is Gaussian in b, and adds moved^T C^-1 moved, moved^T C^-1 mean and a constant
        mean = self.mean[freed]
        shift_per_unit = self.shift_per_unit[freed[:, :, None], own[:, None, :]]
        covariance = self.covariance[freed[:, :, None], freed[:, None, :]]
        solved = np.linalg.solve(
            covariance, np.concatenate([shift_per_unit, mean[:, :, None]], axis=2)
        )
        over, sd = self.prior_mean[freed] / self.prior_sd[freed], self.prior_sd[freed]
        log_density = -0.5 * (
            np.linalg.slogdet(covariance)[1] + (mean * solved[:, :, -1]).sum(axis=1)
        )
        # less that of the prior; powers of 2 pi cancel
        gain = log_density + (np.log(sd) + 0.5 * over**2).sum(axis=1)
        turned = shift_per_unit.transpose(0, 2, 1)
        return turned @ solved[:, :, :-1], (turned @ solved[:, :, -1:])[:, :, 0], gain


def _freed_nuisances(gram: Gram, prior: Prior, at: Mapping[str, int]) -> FreedNuisances:
    """Make it from normal equations in which they are left."""
    columns = np.array(list(at.values()), dtype=int)
    mean, sd = prior.mean[columns], prior.sd[columns]
    # all other nuisances are integrated out by now, the freed ones about their prior mean here
    covariance = np.linalg.inv(gram.xx[np.ix_(columns, columns)] + np.diag(1.0 / sd**2))
    mean_at_zero = mean + covariance @ gram.about(columns, mean).xy[columns]
    return FreedNuisances(
        {key: i for i, key in enumerate(at)},
        mean,
        sd,
        mean_at_zero,
        covariance,
        covariance @ gram.xx[columns],
    )


@dataclasses.dataclass(frozen=True)
class SetScorer:
    """Normal equations with all nuisances integrated out, which score any set.

    Attributes
    ----------
    gram, prior : of all columns.
    freed_nuisances : nuisances that a candidate frees.

    Notes
    -----
    A nominal parameter is right within its prior, or it is a finding and free, never the sum of
    both. So its nuisance takes part in every set without the candidate for it, and is zero with
    it.
    """

    gram: Gram
    prior: Prior
    freed_nuisances: FreedNuisances

    def posteriors(self, sets: Sequence[Sequence[Entry]]) -> list[Posterior]:
        """Return the posterior of every set.

        Parameters
        ----------
        sets : of entries.

        Returns
        -------
        With log evidence over that of the nuisances alone.
        """
        by_set: dict[int, Posterior] = {}
        for at, own, values in self._by_size(sets):
            for i, columns, mean, covariance, log_evidence in zip(
                at, own.tolist(), *values, strict=True
            ):
                by_set[i] = Posterior(tuple(columns), mean, covariance, float(log_evidence))
        return [by_set[i] for i in range(len(sets))]

    def log_evidences(self, sets: Sequence[Sequence[Entry]]) -> np.ndarray:
        """Return the log evidence of every set over the nuisances alone.

        Parameters
        ----------
        sets : s sets of entries.

        Returns
        -------
        (s,).
        """
        out = np.zeros(len(sets))
        for at, _, (_, _, log_evidence) in self._by_size(sets):
            out[at] = log_evidence
        return out

    def best(self, sets: Sequence[Sequence[Entry]]) -> Sequence[Entry]:
        """Return the set with most evidence.

        Parameters
        ----------
        sets : of entries.
        """
        return sets[int(np.argmax(self.log_evidences(sets)))]

    def _by_size(
        self, sets: Sequence[Sequence[Entry]]
    ) -> list[tuple[list[int], np.ndarray, tuple]]:
        """Return indices, columns and posteriors of sets, for all of one shape at once."""
        # sets of one shape are one stack of matrices; few enough at once for the memory
        by_shape: dict[tuple[int, int], list[tuple[int, tuple[int, ...], tuple[int, ...]]]] = {}
        every = {e.index: e for chosen in sets for e in chosen}
        index = self.freed_nuisances.index
        freed_by = {
            i: tuple(index[key] for key in e.keys if key in index) for i, e in every.items()
        }
        for i, chosen in enumerate(sets):
            own: tuple[int, ...] = ()
            freed: tuple[int, ...] = ()
            for e in chosen:
                own += e.columns
                freed += freed_by[e.index]
            freed = tuple(dict.fromkeys(freed))
            by_shape.setdefault((len(own), len(freed)), []).append((i, own, freed))
        most = settings.numerics.sets_at_once
        stacks = [
            group[i : i + most] for group in by_shape.values() for i in range(0, len(group), most)
        ]
        return each(self._posteriors_of_stack, stacks)

    def _posteriors_of_stack(
        self, stack: Sequence[tuple[int, tuple[int, ...], tuple[int, ...]]]
    ) -> tuple[list[int], np.ndarray, tuple]:
        own = np.array([columns for _, columns, _ in stack], dtype=int)
        freed = np.array([nuisances for _, _, nuisances in stack], dtype=int)
        more = self.freed_nuisances.condition_on_zero(freed, own) if freed.shape[1] else None
        return [i for i, _, _ in stack], own, posteriors(self.gram, own, self.prior, more)


def set_scorer(regression: Regression, listed: Sequence[Entry]) -> SetScorer:
    """Return the scorer of these variants.

    Parameters
    ----------
    regression : of the search.
    listed : variants that sets may have.
    """
    columns, keys = regression.system.columns, {key for e in listed for key in e.keys}
    at = {
        columns[k].key: int(k)
        for k in regression.nuisance
        if regression.prior.sd[k] > 0 and columns[k].key in keys
    }
    return SetScorer(
        regression.pool(),
        regression.prior,
        _freed_nuisances(regression.pool(frozenset(at.values())), regression.prior, at),
    )
