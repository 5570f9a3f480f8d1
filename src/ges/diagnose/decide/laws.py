"""Laws for residuals that accepted names leave: few terms, fitted together with the names."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ges.diagnose.decide.explanation import Explanation, explanation_of
from ges.diagnose.design.noise import estimate_noise
from ges.diagnose.design.system import build, with_columns
from ges.diagnose.estimate.contributions import contributions_of, size_of_contribution
from ges.diagnose.estimate.fit import Fitted, free_columns
from ges.diagnose.estimate.joint import joint_fit
from ges.diagnose.library.candidates import Variant, amplitude_of
from ges.diagnose.library.requirements import untestable_drags
from ges.diagnose.locate.laws import (
    RivalLaw,
    SparseForm,
    candidate_terms,
    neighbouring_terms,
    rival_law,
    sparse_form,
    term_columns,
)
from ges.diagnose.locate.stages import Start
from ges.diagnose.locate.structure import Structure
from ges.diagnose.prepare.channels import least_rms_in
from ges.diagnose.select.evidence import make_regression, whiten_system
from ges.diagnose.settings import settings
from ges.diagnose.types.model import block_of
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
    r2 : share of the residual's variance that it predicts on blocks of time it was not fitted to.
    structure : in the channel's residual, with its regime.
    size : of :func:`~ges.diagnose.estimate.contributions.size_of_contribution`.
    """

    channel: str
    coefficients: Mapping[Term, float]
    sd: Mapping[Term, float]
    r2: float
    structure: Structure
    size: Mapping[str, Any]


def add_laws(explanation: Explanation, start: Start) -> tuple[Explanation, list[FittedLaw]]:
    """Add a law in every channel in which one predicts the residuals.

    Parameters
    ----------
    explanation : accepted names with their fit.
    start : the recalibrated vehicle.

    Returns
    -------
    The explanation with laws, and the laws.

    Notes
    -----
    Names keep their values. A law that is free together with them would take their place (Liu,
    Bayarri and Berger 2009, *Bayesian Analysis* 4, 119, on modularization). Nominal parameters are
    free within their priors, as they have taken up a part of what the law is.
    """
    # a nominal parameter that was named would be a nuisance again with a law, and move twice
    before = explanation.accepted.fitted
    if before and before.corrects_vehicle(start.system):
        return explanation, []
    forms = {
        channel: (form, structure)
        for channel, structure in _response_structures(explanation).items()
        if (form := _sparse_form_of(channel, explanation)).terms
    }
    terms = [term for form, _ in forms.values() for term in form.terms]
    while terms:
        fitted, sd = _fit_terms(terms, explanation, start)
        # a constant alone is a number of the file or a trim, and no law
        varying = {t.channel for t in terms if t.varies}
        clear = [
            t
            for t in terms
            if t.channel in varying
            and abs(fitted.effects[LAW][t.key]) > settings.statistics.clear_sds * sd[t]
            and _is_relevant(t, fitted)
        ]
        if len(clear) == len(terms):
            break
        # what only filled in for another term goes
        terms = clear
    if not terms:
        return explanation, []
    accepted = dataclasses.replace(explanation.accepted, fitted=fitted)
    more = explanation_of(accepted, explanation.gusts, start)
    laws = [
        FittedLaw(
            channel,
            {t: fitted.effects[LAW][t.key] for t in own},
            {t: sd[t] for t in own},
            form.r2,
            structure,
            _law_size(channel, fitted, explanation),
        )
        for channel, (form, structure) in forms.items()
        if (own := [t for t in form.terms if t in terms])
    ]
    return more, laws


def rival_laws(explanation: Explanation) -> dict[str, RivalLaw]:
    """Fit the law that could stand in the place of each name that acts as a force or moment.

    Parameters
    ----------
    explanation : accepted names with their fit, without laws.

    Returns
    -------
    By name; of several places a name has one law.
    """
    if explanation.accepted.fitted is None:
        return {}
    system, model = explanation.last.regression.system, explanation.last.model
    free = [effect for effect, _ in explanation.accepted.fit.free]
    rivals = {}
    for name, contribution in explanation.contributions.items():
        response = size_of_contribution(contribution, system)["channel"]
        kinds = [kind for kind, names in RESPONSES.items() if block_of(response) in names]
        if not kinds:
            continue
        channel = f"{kinds[0]}_{response[-1]}"
        at = system.main.index(response)
        own = [a[:, at] for a in contribution]
        pairs = zip(explanation.last.residuals_in_air, own, strict=True)
        # speeds through the air are those without the name: a wind is no part of its rival
        bare = dataclasses.replace(
            model, effects={k: v for k, v in model.effects.items() if k != name}
        )
        terms = candidate_terms(channel, system)
        rivals[name] = rival_law(
            channel,
            [row[:, at] + a for row, a in pairs],
            own,
            term_columns(terms, system, bare),
            terms,
            system.blocks(settings.statistics.block_s),
            free.count(name),
            len(explanation.accepted.result.inclusion),
        )
    return rivals


def _is_relevant(term: Term, fitted: Fitted) -> bool:
    """Return whether a term is above the practical significance threshold of its channel."""
    system = fitted.regression.system
    columns = term_columns([term], system, system.model)
    rms = np.sqrt(
        np.mean(
            np.concatenate([x[r.air] for x, r in zip(columns, system.flights, strict=True)]) ** 2
        )
    )
    size = abs(fitted.effects[LAW][term.key]) * rms
    return size >= least_rms_in(term.channel, system.model)


def _response_structures(explanation: Explanation) -> dict[str, Structure]:
    """Return channels of laws with structure; a size depends on what has another sign elsewhere."""
    system, by_channel = explanation.last.regression.system, {}
    main = system.main
    # what stands for a drag that cannot be tested would be reported as a law: it pushes sideways,
    # and turns the vehicle
    drags = untestable_drags(system.recordings, system.model)
    for channel in (c for c in CHANNELS if not drags or c == "force_z"):
        kind, axis = channel.split("_")
        responses = [f"{k}_{axis}" for k in RESPONSES[kind] if f"{k}_{axis}" in main]
        structures = [s for name in responses for s in explanation.unexplained if s.channel == name]
        if structures:
            by_channel[channel] = structures[0]
    return by_channel


def _sparse_form_of(channel: str, explanation: Explanation) -> SparseForm:
    """Return the sparse form of a channel's residual."""
    system, model = explanation.last.regression.system, explanation.last.model
    kind, axis = channel.split("_")
    response = next(n for k in RESPONSES[kind] if (n := f"{k}_{axis}") in system.main)
    residuals = [row[:, system.main.index(response)] for row in explanation.last.residuals_in_air]
    blocks, terms = system.blocks(settings.statistics.block_s), candidate_terms(channel, system)
    x = term_columns(terms, system, model)
    form = sparse_form(residuals, x, terms, blocks)
    # a place on the grid is half a cell off; what was tried before is paid for still
    for _ in range(settings.numerics.noise_rounds):
        near = dict.fromkeys(
            t for chosen in form.terms if chosen.local for t in neighbouring_terms(chosen, system)
        )
        if not (new := [t for t in near if t not in terms]):
            break
        terms = [*terms, *new]
        x = [np.hstack(pair) for pair in zip(x, term_columns(new, system, model), strict=True)]
        finer = sparse_form(residuals, x, terms, blocks)
        if finer.r2 <= form.r2 + settings.numerics.small:
            break
        form = finer
    return form


def _fit_terms(
    terms: Sequence[Term], explanation: Explanation, start: Start
) -> tuple[Fitted, dict[Term, float]]:
    """Return the fit of nominal parameters and a law of these terms beside the names.

    The sds of its coefficients come with it. Names keep their values.
    """
    before, model = explanation.accepted.fitted, start.system.model
    names = before.effects if before else {}
    # a term that the vehicle file has already counts from there
    given = {**{t.key: 0.0 for t in terms}, **model.effects.get(LAW, {})}
    law, keys = given, [t.key for t in terms]
    variants = [Variant(LAW, {}, (amplitude_of(LAW, key),)) for key in keys]
    # along the path of the names' own fit
    flights = (before.regression.system if before else start.system).recordings
    with_names = model.with_effects(names)
    # flights show a law over the mass or the inertia. Only about a law that acts do their columns
    # have its part, and its coefficients what is uncertain with them
    for reuse in (start.system, with_columns(start.system, ())):
        design = build(flights, with_names.with_effects({LAW: law}), variants, reuse)
        chosen = free_columns(design)
        regression = whiten_system(design, estimate_noise(design, chosen))
        prior_mean = np.array([given[key] - law[key] for key in keys])
        joint = joint_fit(regression, chosen, prior_mean, regression.prior.sd[chosen])
        law = law | {key: law[key] + float(c) for key, c in zip(keys, joint.chosen, strict=True)}
    # noise and trims follow, as they do with names
    refitted = make_regression(
        build(flights, with_names.with_effects({LAW: law}), (), start.system)
    )
    trims = joint_fit(refitted, ())
    fitted = Fitted(
        {**names, LAW: law},
        before.free if before else (),
        before.covariance if before else np.zeros((0, 0)),
        trims,
        before.joint_free_moments if before else trims,
        refitted,
        before.chord_covariance if before else None,
    )
    return fitted, dict(zip(terms, np.sqrt(np.diag(joint.covariance)), strict=True))


def _law_contribution(channel: str, fitted: Fitted, explanation: Explanation) -> list[np.ndarray]:
    """Return the contribution of one channel's law to every channel, by flight, (m, C)."""
    effects = fitted.regression.system.model.effects
    search_regression = explanation.accepted.regression
    others = {k: 0.0 if k.startswith(f"{channel}:") else v for k, v in effects[LAW].items()}
    without = search_regression.system.model.with_effects({LAW: others})
    return contributions_of(effects, LAW, fitted.regression.system, without)


def _law_size(channel: str, fitted: Fitted, explanation: Explanation) -> dict[str, Any]:
    """Return the size of one channel's law, in channels of its own kind."""
    system, kinds = fitted.regression.system, RESPONSES[block_of(channel)]
    shown = [block_of(name) in kinds for name in system.main]
    contribution = _law_contribution(channel, fitted, explanation)
    return size_of_contribution([np.where(shown, a, np.nan) for a in contribution], system)
