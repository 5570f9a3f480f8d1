"""Laws for what the accepted names leave: terms chosen over flights, fitted together with all else."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.unknown import left_over
from ges.diagnose.decide.withdraw import Explanation, answer_of
from ges.diagnose.estimate.contributions import contributions_of, size_of
from ges.diagnose.estimate.fit import Fitted, polish
from ges.diagnose.locate.laws import columns, sparse_terms, tried
from ges.diagnose.locate.stages import Start
from ges.diagnose.locate.structure import Structure
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model, block_of
from ges.simulator.laws import CHANNELS, LAW, Term

RESPONSES = {"force": ("force", "acc"), "moment": ("moment",)}
"""Channels in which a law is looked for, the first of them that the flights have."""


@dataclasses.dataclass(frozen=True)
class FittedLaw:
    """A law of one channel.

    Attributes
    ----------
    channel : one of :data:`ges.simulator.laws.CHANNELS`.
    coefficients, sd : by term.
    r2 : share of what the names leave that it predicts of flights it was not fitted to.
    structure : what was left in the channel, and in which regime.
    size : of :func:`~ges.diagnose.estimate.contributions.size_of`.
    """

    channel: str
    coefficients: Mapping[Term, float]
    sd: Mapping[Term, float]
    r2: float
    structure: Structure
    size: Mapping[str, Any]


def with_laws(
    answer: Explanation, left: list[Structure], start: Start, declared: Model
) -> tuple[Explanation, list[Structure], list[FittedLaw]]:
    """The answer with a law in every channel in which one predicts what the names leave, the
    structure that stays, and the laws.

    Parameters
    ----------
    left : structure that the answer leaves.
    declared : the vehicle file's model.
    """
    chosen = {
        channel: found
        for channel, structure in _channels(left, answer).items()
        if (found := _chosen(channel, structure, answer))
    }
    terms = [t for found in chosen.values() for t in found.terms]
    while terms:
        fitted = _fitted(answer, terms, start)
        clear = [t for t in terms if _sds(fitted, t) >= settings.statistics.clear_sds]
        if len(clear) == len(terms):
            break
        # what the joint fit does not need was the other terms' part
        terms = clear
    if not terms:
        return answer, left, []
    accepted = dataclasses.replace(answer.accepted, fitted=fitted)
    more = answer_of(accepted, answer.gusts, start, declared)
    laws = [
        _law(channel, chosen[channel], [t for t in terms if t.channel == channel], accepted)
        for channel in chosen
    ]
    return more, left_over(more.structures, more.last.model), [w for w in laws if w.coefficients]


@dataclasses.dataclass(frozen=True)
class _Chosen:
    """Terms for the structure of one channel, and what they predict of it."""

    terms: Sequence[Term]
    r2: float
    structure: Structure


def _channels(left: Sequence[Structure], answer: Explanation) -> dict[str, Structure]:
    """Channels of laws in which a mean is left, each with its structure."""
    main, found = answer.last.regression.system.main, {}
    for channel in CHANNELS:
        kind, axis = channel.split("_")
        heard = [f"{k}_{axis}" for k in RESPONSES[kind] if f"{k}_{axis}" in main]
        means = [s for name in heard for s in left if s.channel == name and not s.of_size]
        if means:
            found[channel] = means[0]
    return found


def _chosen(channel: str, structure: Structure, answer: Explanation) -> _Chosen | None:
    """Terms that predict what is left in a channel of flights that they were not fitted to."""
    system, model = answer.last.regression.system, answer.last.model
    kind, axis = channel.split("_")
    response = next(n for k in RESPONSES[kind] if (n := f"{k}_{axis}") in system.main)
    e = [row[:, system.main.index(response)] for row in answer.last.in_air]
    terms = tried(channel, system)
    if not terms:
        return None
    found, r2 = sparse_terms(
        e, columns(terms, system, model), terms, system.blocks(settings.statistics.block_s)
    )
    if r2 < settings.locate.r2_least:
        return None
    return _Chosen(found, r2, structure)


def _fitted(answer: Explanation, terms: Sequence[Term], start: Start) -> Fitted:
    """The names' fit with coefficients of these terms as further parameters."""
    before, system = answer.accepted.fitted, start.system
    declared = system.model.effects.get(LAW, {})
    law = {**declared, **{t.key: declared.get(t.key, 0.0) for t in terms}}
    free = [(LAW, t.key) for t in terms]
    if before is None:
        return polish(system, {LAW: law}, free)
    flights = before.regression.system.recordings
    return polish(system, {**before.effects, LAW: law}, [*before.free, *free], flights)


def _sds(fitted: Fitted, term: Term) -> float:
    """A coefficient over its sd."""
    return abs(fitted.effects[LAW][term.key]) / fitted.sd(LAW, term.key)


def _law(channel: str, chosen: _Chosen, terms: Sequence[Term], accepted: Accepted) -> FittedLaw:
    fitted = accepted.fit
    system, effects = fitted.regression.system, fitted.effects
    others = {k: v for k, v in effects[LAW].items() if not k.startswith(f"{channel}:")}
    bare = dataclasses.replace(
        accepted.regression.system.model, effects={**system.model.effects, LAW: others}
    )
    added = contributions_of(system.model.effects, LAW, system, bare)
    return FittedLaw(
        channel,
        {t: effects[LAW][t.key] for t in terms},
        {t: fitted.sd(LAW, t.key) for t in terms},
        chosen.r2,
        chosen.structure,
        size_of([_of_kind(a, channel, system.main) for a in added], system),
    )


def _of_kind(added: np.ndarray, channel: str, main: Sequence[str]) -> np.ndarray:
    """What is added in channels of the law's own kind, NaN in all others."""
    kinds = RESPONSES[block_of(channel)]
    return np.where([block_of(name) in kinds for name in main], added, np.nan)
