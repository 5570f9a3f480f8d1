"""Laws for what the accepted names leave: few terms, flown beside the names."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ges.diagnose.decide.unknown import left_over
from ges.diagnose.decide.withdraw import Explanation, answer_of
from ges.diagnose.design.system import build
from ges.diagnose.design.whiten import estimate_noise
from ges.diagnose.estimate.contributions import contributions_of, size_of_contribution
from ges.diagnose.estimate.fit import Fitted, free_columns, joint_fit, pinned_priors
from ges.diagnose.library.candidates import Variant, amplitude_of
from ges.diagnose.locate.laws import (
    SparseForm,
    candidate_terms,
    neighbouring_terms,
    sparse_form,
    term_columns,
)
from ges.diagnose.locate.stages import Start
from ges.diagnose.locate.structure import Structure
from ges.diagnose.select.evidence import make_regression, whiten_system
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
    r2 : share of what the names leave that it predicts of blocks of time it was not fitted to.
    structure : what was left in the channel, and in which regime.
    size : of :func:`~ges.diagnose.estimate.contributions.size_of_contribution`.
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

    A law is fitted to what names and declared numbers leave, which stay as they are: a law that
    were free together with them would take their place (Liu, Bayarri and Berger 2009, *Bayesian
    Analysis* 4, 119, on modularization).

    Parameters
    ----------
    left : structure that the answer leaves.
    declared : the vehicle file's model.
    """
    # a declared number that was named would be a nuisance again beside a law, and move twice
    before = answer.accepted.fitted
    corrected = {n.key for c in start.system.columns if (n := c.nuisance)}
    if before and any(f"{e}.{p}" in corrected for e, p in before.free):
        return answer, left, []
    forms = {
        channel: (form, structure)
        for channel, structure in _channels(left, answer).items()
        if (form := _form(channel, answer)).terms
    }
    terms = [term for form, _ in forms.values() for term in form.terms]
    while terms:
        fitted, sd = _beside(terms, answer, start)
        overdone = _overdone(forms, fitted, answer)
        clear = [
            t
            for t in terms
            if abs(fitted.effects[LAW][t.key]) > settings.statistics.clear_sds * sd[t]
            and t.channel not in overdone
        ]
        if len(clear) == len(terms):
            break
        # what only filled in for another term goes, and what trims would have to take back
        terms = clear
    if not terms:
        return answer, left, []
    accepted = dataclasses.replace(answer.accepted, fitted=fitted)
    more = answer_of(accepted, answer.gusts, start, declared)
    laws = [
        FittedLaw(
            channel,
            {t: fitted.effects[LAW][t.key] for t in own},
            {t: sd[t] for t in own},
            form.r2,
            structure,
            _size(channel, fitted, answer),
        )
        for channel, (form, structure) in forms.items()
        if (own := [t for t in form.terms if t in terms])
    ]
    return more, left_over(more.structures, more.last.model), laws


def _overdone(
    forms: Mapping[str, tuple[SparseForm, Structure]], fitted: Fitted, answer: Explanation
) -> set[str]:
    """Channels in which a law moves more within flights than what was left there: trims that are
    free beside it cancel it in these flights, and would not in others.
    """
    main = fitted.regression.system.main
    found = set()
    for channel, (_, structure) in forms.items():
        at = main.index(structure.channel)
        added = [a[:, at] for a in _added(channel, fitted, answer)]
        left = [row[:, at] for row in answer.last.residuals_in_air]
        moved, had = (math.hypot(*map(_spread, rows)) for rows in (added, left))
        if settings.statistics.large_part * moved > had:
            found.add(channel)
    return found


def _spread(values: np.ndarray) -> float:
    """Length of what differs from the mean; of nothing 0."""
    good = values[np.isfinite(values)]
    return float(np.linalg.norm(good - good.mean())) if len(good) else 0.0


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


def _form(channel: str, answer: Explanation) -> SparseForm:
    """A form of what is left in a channel."""
    system, model = answer.last.regression.system, answer.last.model
    kind, axis = channel.split("_")
    response = next(n for k in RESPONSES[kind] if (n := f"{k}_{axis}") in system.main)
    left = [row[:, system.main.index(response)] for row in answer.last.residuals_in_air]
    blocks, terms = system.blocks(settings.statistics.block_s), candidate_terms(channel, system)
    x = term_columns(terms, system, model)
    form = sparse_form(left, x, terms, blocks)
    # a place on the grid is half a cell off; what was tried before is paid for still
    for _ in range(settings.numerics.noise_rounds):
        near = dict.fromkeys(
            t for chosen in form.terms if chosen.local for t in neighbouring_terms(chosen)
        )
        if not (new := [t for t in near if t not in terms]):
            break
        terms = [*terms, *new]
        x = [np.hstack(pair) for pair in zip(x, term_columns(new, system, model), strict=True)]
        finer = sparse_form(left, x, terms, blocks)
        if finer.r2 <= form.r2 + settings.numerics.small:
            break
        form = finer
    return form


def _beside(
    terms: Sequence[Term], answer: Explanation, start: Start
) -> tuple[Fitted, dict[Term, float]]:
    """The names' fit with a law of these terms beside it, and the sds of its coefficients.

    Names and declared numbers stay as they are, pinned by priors that are narrow against their sds;
    trims are free to follow.
    """
    before, model = answer.accepted.fitted, start.system.model
    system, joint = (
        (before.regression.system, before.joint) if before else (start.system, start.first.joint)
    )
    names = before.effects if before else {}
    # a term that the vehicle file has already counts from there
    law = {**{t.key: 0.0 for t in terms}, **model.effects.get(LAW, {})}
    variants = [Variant(LAW, {}, (amplitude_of(LAW, t.key),)) for t in terms]
    flights, known = system.recordings, model.with_effects({**names, LAW: law})
    # what numbers are held at leaves them no part in an answer of the controller, and a law is made
    # of speeds, heights and places: no column here is endogenous
    asked = build(flights, known, variants, start.system)
    exogenous = tuple(dataclasses.replace(rows, endogenous={}) for rows in asked.flights)
    asked = dataclasses.replace(asked, flights=exogenous)
    held, chosen = pinned_priors(joint), free_columns(asked)
    regression = whiten_system(asked, estimate_noise(asked, chosen))
    prior_sd = regression.prior.sd[chosen]
    found = joint_fit(regression, chosen, np.zeros(len(chosen)), prior_sd, held)
    law |= {t.key: law[t.key] + float(c) for t, c in zip(terms, found.chosen, strict=True)}
    # trims follow, as they do beside names
    there = make_regression(build(flights, known.with_effects({LAW: law}), (), start.system))
    beside = joint_fit(there, (), nuisance_priors=held)
    # a pin is no knowledge: what was pinned keeps the doubt of the names' own fit
    sds = {**beside.common_sd, **{key: joint.common_sd[key] for key in held}}
    beside = dataclasses.replace(beside, common_sd=sds)
    fitted = Fitted(
        {**names, LAW: law},
        before.free if before else (),
        before.covariance if before else np.zeros((0, 0)),
        beside,
        before.joint_free_moments if before else beside,
        there,
    )
    return fitted, dict(zip(terms, np.sqrt(np.diag(found.covariance)), strict=True))


def _added(channel: str, fitted: Fitted, answer: Explanation) -> list[np.ndarray]:
    """What the law of a channel adds to every channel, by flight, (m, C)."""
    effects, declared = fitted.regression.system.model.effects, answer.accepted.regression
    others = {k: 0.0 if k.startswith(f"{channel}:") else v for k, v in effects[LAW].items()}
    without = declared.system.model.with_effects({LAW: others})
    return contributions_of(effects, LAW, fitted.regression.system, without)


def _size(channel: str, fitted: Fitted, answer: Explanation) -> dict[str, Any]:
    """How large the law of a channel is, in channels of its own kind."""
    system, kinds = fitted.regression.system, RESPONSES[block_of(channel)]
    shown = [block_of(name) in kinds for name in system.main]
    added = _added(channel, fitted, answer)
    return size_of_contribution([np.where(shown, a, np.nan) for a in added], system)
