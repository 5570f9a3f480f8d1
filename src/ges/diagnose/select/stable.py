"""Search and noise in turn until they agree: each depends on the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ges.diagnose.design.columns import variant_of
from ges.diagnose.design.noise import noise_residuals
from ges.diagnose.design.system import System
from ges.diagnose.library.candidates import Candidate, Variant, family_of, has_prerequisite
from ges.diagnose.select.evidence import Regression, make_regression
from ges.diagnose.select.search import SearchResult, evaluate_exactly, search
from ges.diagnose.settings import settings

StableSearch = tuple[Regression, SearchResult, tuple[int, ...]]
"""A search, its regression, and the columns of what is more probable in it than
not.
"""


def search_until_stable(
    regression: Regression,
    candidates: Sequence[Candidate],
    base: Sequence[str],
    only: Sequence[str] | None = None,
) -> StableSearch:
    """Search, estimate the noise from the residuals of the best set, and search again.

    Parameters
    ----------
    regression : with the most cautious noise, from which the search starts.
    candidates : that take part.
    base : effects that are on already.
    only : fit exactly these names instead of searching.

    Returns
    -------
    The regression, its search, and the columns of names that are more probable than not.

    Notes
    -----
    To the first noise a strong effect is noise, and less surprising the slower it is. Where a
    candidate explains most of a channel's residual, the search starts once more from the noise
    without it. That search stays if it finds just the effect: noise and set agree in both, and
    the first is where the search began.
    """
    result = _search_and_noise(regression, candidates, base, only)
    # where names are given, no other can be hidden
    for _ in range(settings.numerics.noise_rounds if only is None else 0):
        again = _search_without_hidden(result[0], result[2], candidates, base)
        if again is None:
            break
        result = again
    return result


def _search_without_hidden(
    regression: Regression,
    chosen: tuple[int, ...],
    candidates: Sequence[Candidate],
    base: Sequence[str],
) -> StableSearch | None:
    """Return the search from the noise without a candidate that explains most of the residual.

    None unless it finds that and nothing else new.
    """
    for hidden in _hidden_in_noise(regression, chosen, candidates, base):
        start = (*chosen, *hidden)
        again = _search_and_noise(make_regression(regression.system, start), candidates, base, None)
        if _effects(regression.system, again[2]) - _effects(regression.system, chosen) == _effects(
            regression.system, hidden
        ):
            return again
    return None


def _search_and_noise(
    regression: Regression,
    candidates: Sequence[Candidate],
    base: Sequence[str],
    only: Sequence[str] | None,
) -> StableSearch:
    """Search, then estimate the noise of the best set, until the set stays the same.

    The set is subtracted with its joint coefficients. Coefficients of a single channel could
    explain away what the whole does not.
    """
    chosen: dict[int, float] = {}
    for again in range(settings.numerics.noise_rounds):
        regression = make_regression(regression.system, together=chosen) if again else regression
        result = (
            search(regression, candidates, base)
            if only is None
            else evaluate_exactly(regression, candidates)
        )
        now = _probable(result, regression.system)
        # what was found leaves just the noise that it was found in
        if set(now) == set(chosen):
            break
        chosen = now
    return regression, result, tuple(chosen)


def _probable(result: SearchResult, system: System) -> dict[int, float]:
    """Return columns and coefficients of the best set, of names that are more probable than not.

    Which of a family it is makes no difference to the residual.
    """
    families = {name: family_of(name) for name in result.best.names}
    probability = {
        name: sum(h.probability for h in result.hypotheses if family & set(h.names))
        for name, family in families.items()
    }
    best = result.best.posterior
    return {
        k: float(value)
        for k, value in zip(best.columns, best.mean, strict=True)
        if probability[variant_of(system.columns[k]).effect] > 0.5
    }


def _hidden_in_noise(
    regression: Regression,
    chosen: Sequence[int],
    candidates: Sequence[Candidate],
    base: Sequence[str],
) -> list[tuple[int, ...]]:
    """Return columns of variants that explain most of a channel, the best first.

    There is one variant of each effect.
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
    if not listed:
        return []
    channels = range(len(system.names))
    residuals = noise_residuals(system, channels, chosen)
    share = np.max(
        [_explained_share(system, c, [e[c] for e in residuals], listed) for c in channels],
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


def _explained_share(
    system: System, channel: int, residuals: Sequence[np.ndarray], listed: Sequence[int]
) -> np.ndarray:
    """Return the share of the residuals (m,) that each of these columns explains alone."""
    xy, xx, yy = np.zeros(len(listed)), np.zeros(len(listed)), 0.0
    for e, r in zip(residuals, system.flights, strict=True):
        good = np.isfinite(e)
        x = r.x.of(channel, listed)[good]
        # about each flight's mean, which is no part of what is left
        x, y = x - x.mean(axis=0), e[good] - e[good].mean()
        xy, xx, yy = xy + x.T @ y, xx + (x**2).sum(axis=0), yy + float(y @ y)
    # squared correlation, pooled over the flights
    return xy**2 / np.maximum(xx * yy, settings.numerics.tiny)
