"""Search and noise until they agree: what is found decides what is noise, and what is noise decides
what is found.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ges.diagnose.design.system import System, variant_of
from ges.diagnose.design.whiten import noise_residuals
from ges.diagnose.library.candidates import Candidate, Variant, family_of, has_prerequisite
from ges.diagnose.select.evidence import Regression, make_regression
from ges.diagnose.select.search import SearchResult, exactly, search
from ges.diagnose.settings import settings

Found = tuple[Regression, SearchResult, tuple[int, ...]]
"""A search, its regression, and the columns of what is more probable in it than
not.
"""


def search_until_stable(
    regression: Regression,
    candidates: Sequence[Candidate],
    base: Sequence[str],
    only: Sequence[str] | None = None,
) -> Found:
    """Search, measure the noise that the best set leaves, search again; starts from the most
    cautious noise, the regression's.

    To that noise a strong effect that shakes some flights and not others is noise. So where a
    candidate explains most of what the best set leaves in such a channel, the search starts once
    more from the noise without that, and stays if just that is then found.
    """
    found = _settled(regression, candidates, base, only)
    # where names are given, no other can be hidden
    for _ in range(settings.numerics.noise_rounds if only is None else 0):
        again = _bolder(found[0], found[2], candidates, base)
        if again is None:
            break
        found = again
    return found


def _bolder(
    regression: Regression,
    chosen: tuple[int, ...],
    candidates: Sequence[Candidate],
    base: Sequence[str],
) -> Found | None:
    """The search from the noise without a candidate that explains most of what is left, if it finds
    that and nothing else new.
    """
    for hidden in _hidden(regression, chosen, candidates, base):
        start = (*chosen, *hidden)
        again = _settled(make_regression(regression.system, start), candidates, base, None)
        if _effects(regression.system, again[2]) - _effects(regression.system, chosen) == _effects(
            regression.system, hidden
        ):
            return again
    return None


def _settled(
    regression: Regression,
    candidates: Sequence[Candidate],
    base: Sequence[str],
    only: Sequence[str] | None,
) -> Found:
    """Search in the regression's noise, then in that which the best set leaves, until it stays the
    same.

    The set leaves noise by its coefficients together: those that one channel alone asks for could
    explain away what the whole does not.
    """
    chosen: dict[int, float] = {}
    for again in range(settings.numerics.noise_rounds):
        regression = make_regression(regression.system, together=chosen) if again else regression
        found = (
            search(regression, candidates, base)
            if only is None
            else exactly(regression, candidates)
        )
        now = _probable(found, regression.system)
        # what was found leaves just the noise that it was found in
        if set(now) == set(chosen):
            break
        chosen = now
    return regression, found, tuple(chosen)


def _probable(found: SearchResult, system: System) -> dict[int, float]:
    """Columns of the best set and their coefficients, of names that are more probable than not;
    which of a family it is makes no difference to what is left.
    """
    families = {name: family_of(name) for name in found.best.names}
    probability = {
        name: sum(h.probability for h in found.hypotheses if family & set(h.names))
        for name, family in families.items()
    }
    best = found.best.posterior
    return {
        k: float(value)
        for k, value in zip(best.columns, best.mean, strict=True)
        if probability[variant_of(system.columns[k]).effect] > 0.5
    }


def _hidden(
    regression: Regression,
    chosen: Sequence[int],
    candidates: Sequence[Candidate],
    base: Sequence[str],
) -> list[tuple[int, ...]]:
    """Columns of the variants, one of an effect, that explain most of what chosen columns leave in
    some channel where flights are noisy and others are not, the best first.
    """
    system, taken = regression.system, _effects(regression.system, chosen)
    free = {
        c.name
        for c in candidates
        if c.name not in taken and has_prerequisite(c.name, {c.name, *taken, *base})
    }
    listed = [
        k
        for k, c in enumerate(system.columns)
        if c.variant is not None and c.variant.effect in free
    ]
    noisy = regression.noise.noisiest_flight > settings.statistics.flights_ratio
    channels = np.flatnonzero(noisy).tolist()
    if not listed or not channels:
        return []
    share = np.max(
        [_explained(system, c, noise_residuals(system, c, chosen), listed) for c in channels],
        axis=0,
    )
    # most explained first: of an effect the first variant that comes is its best
    best: dict[str, Variant] = {}
    count = np.count_nonzero(share > 0.5)
    for i in np.argsort(-share, kind="stable")[:count]:
        variant = variant_of(system.columns[listed[i]])
        best.setdefault(variant.effect, variant)
    return [
        tuple(k for k in listed if system.columns[k].variant is v)
        for v in list(best.values())[: settings.search.beam]
    ]


def _effects(system: System, chosen: Sequence[int]) -> set[str]:
    return {variant_of(system.columns[k]).effect for k in chosen}


def _explained(
    system: System, channel: int, left: Sequence[np.ndarray], listed: Sequence[int]
) -> np.ndarray:
    """Share of what is left in a channel, (m,) by flight, that each of these columns explains
    alone.
    """
    xy, xx, yy = np.zeros(len(listed)), np.zeros(len(listed)), 0.0
    for e, r in zip(left, system.flights, strict=True):
        good = np.isfinite(e)
        x = r.x.of(channel, listed)[good]
        # about each flight's mean, which is no part of what is left
        x, y = x - x.mean(axis=0), e[good] - e[good].mean()
        xy, xx, yy = xy + x.T @ y, xx + (x**2).sum(axis=0), yy + float(y @ y)
    # squared correlation, pooled over the flights
    return xy**2 / np.maximum(xx * yy, settings.numerics.tiny)
