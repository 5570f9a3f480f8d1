"""From a search to accepted names: rules, a full fit, then modifiers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from scipy.special import expit

from ges.diagnose.decide.rules import (
    SEARCH_RULES,
    RuleContext,
    apply_rules,
    differs_from_neutral,
    open_names,
    parameters_at_bounds,
    practically_significant,
    rivals_nearly_as_good,
    significant,
)
from ges.diagnose.design.columns import variant_of
from ges.diagnose.design.system import System, build
from ges.diagnose.detectors.loads import probable_load, refine_load
from ges.diagnose.estimate.fit import Fitted, fitted_model, free_parameters, polish, starting_values
from ges.diagnose.estimate.shoot import with_rollout_path
from ges.diagnose.library.candidates import (
    Candidate,
    amplitude_of,
    family_of,
    has_prerequisite,
    modifiers_of,
)
from ges.diagnose.library.requirements import candidates_of
from ges.diagnose.select.alike import Alike
from ges.diagnose.select.evidence import Posterior, Regression, make_regression
from ges.diagnose.select.scorer import entries
from ges.diagnose.select.search import (
    Hypothesis,
    SearchResult,
    log_evidence_over_plain,
    log_odds_against_one_of,
)
from ges.diagnose.select.stable import search_until_stable
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Decision, DecisionLog
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator.laws import LAW
from ges.threads import each

IDLE = "does nothing once it is fitted"
"""Why a name is open no more."""


class _WithFit:
    """What has a fit as soon as something is accepted."""

    fitted: Fitted | None

    @property
    def fit(self) -> Fitted:
        """``fitted``, where something is accepted.

        Raises
        ------
        ValueError
            Where nothing is.
        """
        if self.fitted is None:
            raise ValueError("nothing is accepted, and so nothing is fitted")
        return self.fitted


@dataclasses.dataclass(frozen=True)
class Accepted(_WithFit):
    """Outcome of the search on the training flights.

    Attributes
    ----------
    names : accepted effects.
    result, regression : the first search, with no name accepted yet, without its rows.
    system : of the flights, without candidates.
    fitted : the accepted names fitted in full; None where there are none.
    probability : posterior probability of every accepted name.
    rivals : names of which one is needed, the most probable first.
    contested : those of them that others could replace.
    alternatives : the fits with each rival. The likeliest off its bounds is ``fitted``.
    alike : places where each name does nearly the same in these flights.
    """

    names: tuple[str, ...]
    result: SearchResult
    regression: Regression
    system: System
    fitted: Fitted | None
    probability: dict[str, float]
    rivals: tuple[str, ...]
    contested: frozenset[str] = frozenset()
    alternatives: Mapping[str, Fitted] = dataclasses.field(default_factory=dict)
    alike: Mapping[str, tuple[Alike, ...]] = dataclasses.field(default_factory=dict)

    def without_rivals(self) -> Accepted:
        """Return it with nothing open."""
        return dataclasses.replace(self, rivals=(), contested=frozenset())

    @property
    def modelled(self) -> tuple[str, ...]:
        """The names, and what the alternative that is fitted adds."""
        return tuple(n for n in self.fitted.effects if n != LAW) if self.fitted else ()


def accept(system: System, record: DecisionLog, only: Sequence[str] | None = None) -> Accepted:
    """Search the library in rounds, and accept what passes the rules.

    Parameters
    ----------
    system : of the recalibrated vehicle, without candidates.
    record : takes every decision.
    only : fit exactly these names instead of searching.

    Notes
    -----
    Each round is linearised about what is accepted, and adds effects that act through it.
    """
    selection, base, forms_replaced = _Selection((), None, {}), system.model, False
    listed = candidates_of(system.recordings, base, (), only)
    first = latest = _search_round(system, base, listed, record, only)
    while True:
        new, polished = _fit_significant(
            latest, base, selection.fitted, system, record, names_searched=only is None
        )
        if polished is None or not new:
            break
        selection = selection.extend(new, polished, latest.probability_of)
        names = selection.names
        if only is None:
            # the wind is known only now; the forms that the search chose were for still air
            selection = _with_best_forms_in_wind(selection, system, record)
        # what stood beside another form may only have made up for it: searched again, once
        reformed = _reformed(selection.names, names)
        others_stand = len(reformed) < len(selection.names)
        search_again = only is None and not forms_replaced and others_stand
        if search_again:
            forms_replaced, selection = True, _restricted(selection, reformed, system)
        # the next round is linearised about what is accepted, and lists what acts through it
        base = system.model.with_effects(selection.fit.effects)
        listed = (
            _other_candidates(selection.names, base, system)
            if search_again
            else candidates_of(system.recordings, base, selection.names, only)
        )
        if not listed:
            break
        latest = _search_round(system, base, listed, record, only)
    # what was open at first, and then was accepted with the others, is open no more
    contested = first.contested - {*selection.names}
    return Accepted(
        selection.names,
        first.result,
        first.regression,
        system,
        selection.fitted,
        selection.probability,
        _open_names(first.result, selection.names, contested, base, system),
        contested,
        alike=first.alike,
    )


def _open_names(
    result: SearchResult,
    accepted: Sequence[str],
    contested: frozenset[str],
    base: Model,
    system: System,
) -> tuple[str, ...]:
    """Return names of the first search that stay open beside what is accepted."""
    # a name that is probable, but failed another rule, is not open
    least = settings.statistics.acceptance_probability
    decided = {*accepted, *(n for n, p in result.inclusion.items() if p >= least)}
    rivals = open_names(result, decided - contested, contested)
    return rivals if rivals and _still_needed(rivals, base, system) else ()


@dataclasses.dataclass(frozen=True)
class _Round:
    """Search of one round, and what passes its rules.

    Attributes
    ----------
    regression, result : the search, without the rows of its flights. They are as large as all
        columns, and no fit of its names needs them.
    passing : names that pass, in the order of the best set.
    modifiers : of these names.
    contested : names of the first round that could not be separated from others, and those others.
    alike : places where each passing name of the first round does nearly the same.
    """

    regression: Regression
    result: SearchResult
    passing: tuple[str, ...]
    modifiers: Mapping[str, _Modifier]
    contested: frozenset[str] = frozenset()
    alike: Mapping[str, tuple[Alike, ...]] = dataclasses.field(default_factory=dict)

    def probability_of(self, name: str) -> float:
        """Return the posterior probability of a name or a modifier."""
        if name in self.modifiers:
            return self.modifiers[name].probability
        return self.result.inclusion[name]


def _search_round(
    system: System,
    base: Model,
    listed: Sequence[Candidate],
    record: DecisionLog,
    only: Sequence[str] | None,
) -> _Round:
    """Search candidates added to the base, and decide which names pass."""
    regression, result = _search_with_refined_load(
        _regression_of(listed, base, system), listed, base, only
    )
    context = RuleContext(regression, result, result.best.names, tuple(entries(regression, listed)))
    passing = apply_rules(SEARCH_RULES, context, sorted(result.inclusion), record)
    passing = tuple(n for n in result.best.names if n in passing)
    modifiers = _probable_modifiers(regression, result, listed, passing, only)
    bare = _Round(regression.without_rows(), result, passing, modifiers)
    # asked of the first round alone, in which nothing is accepted
    if base is not system.model:
        return bare
    return dataclasses.replace(
        bare,
        contested=frozenset(_contested_names(context, record)),
        alike={name: context.alike(name) for name in passing},
    )


@dataclasses.dataclass(frozen=True)
class _Selection(_WithFit):
    """Names that the rounds have accepted so far, with their fit and probabilities."""

    names: tuple[str, ...]
    fitted: Fitted | None
    probability: dict[str, float]

    def extend(
        self, new: tuple[str, ...], fitted: Fitted, probability_of: Callable[[str], float]
    ) -> _Selection:
        """Add the names of a round."""
        probability = {**self.probability, **{name: probability_of(name) for name in new}}
        return _Selection(self.names + new, fitted, probability)


def _reformed(names: Sequence[str], before: Sequence[str]) -> list[str]:
    """Return names that have another form than in the search; all where none has.

    Parameters
    ----------
    names : that are accepted.
    before : the same, before drags had the form that a wind asks for.

    Notes
    -----
    Others of a family replaced a drag, or something modifies what was found. What acts through
    these, and what they act through, is among them.
    """
    of = {n: effect_table.get(n) for n in names}
    if set(names) != set(before):
        reformed = {p for n, e in of.items() if e.moves_air for p in (n, *e.prerequisites)}
    else:
        reformed = {p for n, e in of.items() if e.modifies for p in (n, e.modifies)}
    return [n for n in names if n in reformed or not reformed]


_Kept = TypeVar("_Kept", Accepted, _Selection)


def _restricted(whole: _Kept, names: Sequence[str], system: System) -> _Kept:
    """Return what is accepted with these of its names alone, fitted without the others."""
    fit = whole.fit
    effects = {e: v for e, v in fit.effects.items() if e in names}
    free = [f for f in fit.free if f[0] in names]
    return dataclasses.replace(
        whole,
        names=tuple(names),
        fitted=polish(system, effects, free) if names else None,
        probability={n: whole.probability[n] for n in names},
    )


def _other_candidates(names: Sequence[str], base: Model, system: System) -> list[Candidate]:
    """Return all candidates but these names, and but others of their families that stand alone."""
    families = {n for name in names for n in family_of(name)}
    return [
        c
        for c in candidates_of(system.recordings, base)
        if c.name not in names and (c.name not in families or set(c.prerequisites) & set(names))
    ]


def _contested_names(context: RuleContext, record: DecisionLog) -> set[str]:
    """Return names that could not be separated from others, and those others."""
    result = context.result
    undone = [
        name
        for name in result.best.names
        for d in record.of(name)
        if d.rule == "distinguishable" and not d.passed
    ]
    others = {
        n: [*(a.name for a in context.alike(n)), *context.untestable_rivals(n)] for n in undone
    }
    return {
        n for name in undone for n in (name, *rivals_nearly_as_good(result, name), *others[name])
    }


def _regression_of(listed: Sequence[Candidate], base: Model, reuse: System) -> Regression:
    """Return the regression of candidates added to the base, on the flights of a system."""
    return make_regression(
        build(reuse.recordings, base, [v for c in listed for v in c.variants], reuse)
    )


def _search_with_refined_load(
    regression: Regression, listed: Sequence[Candidate], base: Model, only: Sequence[str] | None
) -> tuple[Regression, SearchResult]:
    """Return the search, repeated with a refined load on a thread.

    A thread or first place that is wrong by centimetres needs other names for its residual.
    """
    regression, result, _ = search_until_stable(regression, listed, tuple(base.effects), only)
    variant = probable_load(regression, result)
    if variant is None:
        return regression, result
    system = regression.system
    refined = refine_load(system, variant)
    # two variants of one key are one entry, which would hold the load's mass twice
    if refined.key in {v.key for c in listed for v in c.variants}:
        return regression, result
    listed = [
        dataclasses.replace(c, variants=(*c.variants, refined)) if c.name == variant.effect else c
        for c in listed
    ]
    larger = _regression_of(listed, system.model, system)
    return search_until_stable(larger, listed, tuple(system.model.effects), only)[:2]


def _still_needed(rivals: Sequence[str], base: Model, system: System) -> bool:
    """Return whether one of these is needed still, given the full fit of what was accepted."""
    listed = candidates_of(system.recordings, base, (), rivals)
    result = search_until_stable(_regression_of(listed, base, system), listed, tuple(base.effects))[
        1
    ]
    return result.null().probability <= settings.statistics.possible_probability


@dataclasses.dataclass(frozen=True)
class _Modifier:
    """A modifier of the best variant of an effect.

    Attributes
    ----------
    values : its parameters.
    probability : against the effect alone.
    """

    values: Mapping[str, float]
    probability: float


def _probable_modifiers(
    regression: Regression,
    result: SearchResult,
    listed: Sequence[Candidate],
    names: Collection[str],
    only: Sequence[str] | None,
) -> dict[str, _Modifier]:
    """Return modifiers of these names in the best set, if no plain variant is nearly as good.

    All that are asked for, with ``only``.
    """
    chosen = result.best.posterior.columns if names else ()
    variants = [variant_of(regression.system.columns[k]) for k in chosen]
    modifiers = {
        m: values for v in variants if v.effect in names for m, values in modifiers_of(v).items()
    }
    if only is not None:
        return {m: _Modifier(values, 1.0) for m, values in modifiers.items() if m in only}
    if not modifiers:
        return {}
    # as a search of all that modifies these effects, and of nothing else, has them
    count = sum(e.modifies in names for e in effect_table.table().values())
    odds = log_evidence_over_plain(regression, listed, result.best) - log_odds_against_one_of(count)
    if odds <= settings.statistics.acceptance_log_odds:
        return {}
    return {m: _Modifier(values, float(expit(odds))) for m, values in modifiers.items()}


def _fit_hypothesis(
    regression: Regression,
    h: Hypothesis,
    present: Fitted | None,
    system: System,
    modifiers: effect_table.Effects = MappingProxyType({}),
) -> Fitted:
    """Fit a set of the search in full, added to what is fitted already.

    The system is of the model without the set. Modifiers are fitted with it, from their values.
    """
    effects, free_already = (present.effects, present.free) if present else ({}, ())
    values = {
        **starting_values(regression, h),
        **{m: {**effect_table.get(m).neutral(), **v} for m, v in modifiers.items()},
    }
    free = [
        *free_already,
        *free_parameters(regression, h, system.model, values),
        *((m, p) for m, v in modifiers.items() for p in v),
    ]
    return polish(system, {**effects, **values}, free)


def _fit_significant(
    latest: _Round,
    base: Model,
    fitted: Fitted | None,
    system: System,
    record: DecisionLog,
    names_searched: bool,
) -> tuple[tuple[str, ...], Fitted | None]:
    """Return the names of a round that are significant in a full fit, and that fit.

    Others are left out of it, modifiers first.
    """
    regression, result, modifiers = latest.regression, latest.result, latest.modifiers
    new, fallen = (*latest.passing, *modifiers), set[str]()
    while new:
        values_of_modifiers = {m: modifiers[m].values for m in new if m in modifiers}
        kept = _hypothesis_of(result, [n for n in new if n not in values_of_modifiers], regression)
        full = _fit_hypothesis(regression, kept, fitted, system, values_of_modifiers)
        decisions = {n: significant(full, n) for n in new} if names_searched else {}
        for name, decision in decisions.items():
            record.note(name, decision)
        failed = {n for n, d in decisions.items() if not d.passed}
        # a name that does nothing may have driven another one to its bound: it goes alone first
        at_bounds = {e for e, _ in parameters_at_bounds(full)}
        rejected = (failed & set(values_of_modifiers)) or (failed - at_bounds)
        rejected = rejected or _too_many(full, failed, new, system)
        # what acted through a name that fell has nothing to act through
        rejected |= {
            n for n in new if not has_prerequisite(n, {*base.effects, *(set(new) - rejected)})
        }
        if not rejected:
            return new, full
        fallen |= rejected
        new = tuple(n for n in new if n not in rejected)
        new = _probable_without(result, new, fallen, modifiers, record)
    return (), fitted


def _too_many(full: Fitted, at_bounds: set[str], names: Sequence[str], system: System) -> set[str]:
    """Return what to leave out of a fit at bounds: the names there, or one that drove them there.

    Parameters
    ----------
    full : the fit.
    at_bounds : names that fell, each at a bound.
    names : that may be left out.
    system : of the model without any.

    Notes
    -----
    Two that undo each other run until one is at a bound, and either may be the one too many. Fits
    without each compare under one noise.
    """
    best, least = at_bounds, math.inf
    for left_out in [at_bounds, *({n} for n in names if n not in at_bounds)] if at_bounds else []:
        effects = {e: v for e, v in full.effects.items() if e not in left_out}
        present = {*effects, *system.model.effects}
        if not effects or not all(has_prerequisite(e, present) for e in effects):
            continue
        free = [f for f in full.free if f[0] in effects]
        fitted = polish(system, effects, free, fixed_noise=full.regression.noise)
        if fitted.joint.cost < least and not parameters_at_bounds(fitted):
            best, least = left_out, fitted.joint.cost
    return best


def _probable_without(
    result: SearchResult,
    names: tuple[str, ...],
    fallen: Collection[str],
    modifiers: Collection[str],
    record: DecisionLog,
) -> tuple[str, ...]:
    """Return the names that stand without others that fell.

    A name may have been probable only beside what undid it. Modifiers stand with what they modify.
    """
    rest, standing = result.without(fallen), tuple(n for n in names if n in modifiers)
    searched = tuple(sorted(set(names) - set(standing)))
    if not any(h.names == searched for h in rest.hypotheses):
        return names
    least = settings.statistics.acceptance_probability
    for name in searched:
        p = rest.inclusion.get(name, 0.0)
        if p >= least:
            standing += (name,)
        else:
            because = f"posterior probability {p:.3g} without {', '.join(sorted(fallen))}"
            record.note(name, Decision("probable", False, because, p, least))
    return tuple(n for n in names if n in standing)


def _with_best_forms_in_wind(
    selection: _Selection, system: System, record: DecisionLog
) -> _Selection:
    """Replace drags by others of their family that fit better in the wind that was accepted.

    A search evaluates every form in still air. In wind linear and quadratic drag are other
    functions of the motion. So each is fitted again, in full and under the same noise.
    """
    fitted, names = selection.fit, selection.names
    replacements: dict[str, str] = {}
    through_wind = {
        c for n in names if effect_table.get(n).moves_air for c in effect_table.get(n).prerequisites
    }
    listed = {c.name for c in candidates_of(system.recordings, system.model)}
    least = settings.statistics.acceptance_log_odds
    for name in sorted(through_wind & set(names)):
        rule, better, gained = "best_form_in_wind", fitted, 0.0
        for rival in sorted((family_of(name) & listed) - set(fitted.effects)):
            candidate = _fit_with_replacement(fitted, name, rival, system)
            # costs are -2 log posterior under one noise; each row counts as in the evidence
            gain = (
                0.5
                * settings.evidence.tempering
                * (fitted.joint_free_moments.cost - candidate.joint_free_moments.cost)
            )
            because = f"log odds {gain:.3g} over {name}, both in full where the air moves"
            passed = gain > least and significant(candidate, rival).passed
            record.note(rival, Decision(rule, passed, because, gain, least))
            if passed and gain > gained:
                better, gained, replacements[name] = candidate, gain, rival
        if name in replacements:
            because = f"{replacements[name]} fits better where the air moves"
            record.note(name, Decision(rule, False, because, -gained, -least))
            fitted = polish(system, better.effects, better.free)
    return _Selection(
        tuple(replacements.get(n, n) for n in names),
        fitted,
        {replacements.get(n, n): p for n, p in selection.probability.items()},
    )


def _fit_with_replacement(fitted: Fitted, name: str, rival: str, system: System) -> Fitted:
    """Return the fit with a rival in place of a name, under the same noise."""
    descriptor = effect_table.get(rival)
    amplitudes = [
        amplitude_of(rival, p.name)
        for p in descriptor.parameters
        if p.name not in descriptor.shapes
    ]
    values = {
        **{e: v for e, v in fitted.effects.items() if e != name},
        # a step from neutral: at neutral itself a shape moves nothing, and its column vanishes
        rival: {**descriptor.neutral(), **{a.parameter: a.neutral + a.step for a in amplitudes}},
    }
    free = [
        *(f for f in fitted.free if f[0] != name),
        *((rival, a.parameter) for a in amplitudes),
        *((rival, p) for p in descriptor.shapes if descriptor.parameter(p).fitted),
    ]
    return polish(system, values, free, fixed_noise=fitted.regression.noise)


def fit_along_rollouts(accepted: Accepted) -> Accepted:
    """Refine the fit by multiple shooting, along the path that the model flies itself.

    Parameters
    ----------
    accepted : names and fits. It is returned unchanged with effects that have memory of the path:
        a path in pieces would break off their state.
    """
    fitted, system = accepted.fitted, accepted.system
    if fitted is None or any(effect_table.get(name).remembers_the_path for name in fitted.effects):
        return accepted
    # along its own path a push of turbulence no longer moves the velocity that drag depends on
    model = fitted_model(system.model, fitted)
    flights = each(lambda flight: with_rollout_path(flight, model), system.recordings)
    polished = polish(system, fitted.effects, fitted.free, flights, earlier=fitted)
    return dataclasses.replace(accepted, fitted=polished)


def confirm_along_rollouts(
    accepted: Accepted, nominal: Model, recalibrated: Model, record: DecisionLog
) -> Accepted:
    """Refine the fit along rollouts, without names that do not stand in it.

    Parameters
    ----------
    accepted : names and fits.
    nominal, recalibrated : the vehicle file's model, as given and with its numbers set.
    record : takes the decisions.

    Returns
    -------
    Names that are significant in this fit, which is the one that is reported, and bring the flights
    nearer than the vehicle file does.
    """
    refined, system = fit_along_rollouts(accepted), accepted.system
    fitted = refined.fitted
    if fitted is None:
        return refined
    decisions = {name: significant(fitted, name) for name in accepted.names}
    passed = [name for name, decision in decisions.items() if decision.passed]
    decisions |= practically_significant(fitted, passed, nominal, recalibrated)
    for name, decision in decisions.items():
        record.note(name, decision)
    # what acted through a name that fell has nothing to act through
    kept = [name for name in accepted.names if decisions[name].passed]
    kept = [n for n in kept if has_prerequisite(n, {*kept, *system.model.effects})]
    if len(kept) == len(accepted.names):
        return refined
    rest = _restricted(accepted, kept, system)
    return confirm_along_rollouts(rest, nominal, recalibrated, record)


def fit_alternatives(accepted: Accepted, record: DecisionLog) -> Accepted:
    """Fit every open name in full, added to what is accepted.

    Parameters
    ----------
    accepted : names and fits.
    record : takes the decisions.

    Returns
    -------
    Without open names whose fit is neutral, if two others are left. Nothing is open where that is
    so of all that are possible by themselves: the others are open in their place alone.
    """
    # what these flights cannot show has no column to fit
    inclusion = accepted.result.inclusion
    shown = [name for name in accepted.rivals if name in inclusion]
    least = settings.statistics.possible_probability
    likely = [name for name in shown if inclusion[name] >= least]
    fits = _fits_off_neutral(accepted, likely)
    if likely and not fits:
        for name in likely:
            record.note(name, Decision("open", False, IDLE))
        return accepted.without_rivals()
    more = _fits_off_neutral(accepted, [name for name in shown if name not in likely])
    fits = {name: fit for name in shown if (fit := fits.get(name) or more.get(name))}
    if len(shown) < len(accepted.rivals):
        # beside what cannot be tested nothing is open that would not be named without it
        decisions = {name: significant(fitted, name) for name, fitted in fits.items()}
        for name, decision in decisions.items():
            record.note(name, decision)
        if not any(d.passed for d in decisions.values()):
            return accepted.without_rivals()
    idle = set(shown) - set(fits) if len(fits) > 1 else set()
    for name in shown:
        because = IDLE if name in idle else "one of these is needed"
        record.note(name, Decision("open", name not in idle, because))
    return dataclasses.replace(
        accepted,
        rivals=tuple(n for n in accepted.rivals if n not in idle),
        alternatives=fits,
    )


def fit_causes(accepted: Accepted, causes: Mapping[str, effect_table.Effects]) -> Accepted:
    """Fit each of several causes in full, where no name is accepted.

    Parameters
    ----------
    accepted : without names.
    causes : starting values of the parameters that each changes, the most probable first.
    """
    system = accepted.system
    fits = {}
    for name, changed in causes.items():
        values = {e: {**system.model.values_of(e), **own} for e, own in changed.items()}
        fits[name] = polish(system, values, [(e, p) for e, own in changed.items() for p in own])
    return dataclasses.replace(accepted, fitted=next(iter(fits.values())), alternatives=fits)


def _fits_off_neutral(accepted: Accepted, names: Sequence[str]) -> dict[str, Fitted]:
    """Return the fits with each open name that acts, and does something once it is fitted."""
    return {name: fit for name in names if (fit := _fit_with_rival(accepted, name))}


def _fit_with_rival(accepted: Accepted, name: str) -> Fitted | None:
    """Return the fit with one open name and its prerequisite added.

    None where it cannot act, or does nothing once it is fitted.
    """
    system, fitted = accepted.system, accepted.fitted
    best = accepted.result.best_with(name, accepted.rivals)
    present = set(fitted.effects) if fitted else set()
    # a modifier or a wind alone does nothing: the prerequisite of its own best set comes with it
    own = ({name} | set(effect_table.get(name).prerequisites) & set(best.names)) - present
    if not has_prerequisite(name, {*own, *present, *system.model.effects}):
        return None
    kept = dataclasses.replace(
        best, posterior=_restricted_posterior(best, own, accepted.regression)
    )
    full = _fit_hypothesis(accepted.regression, kept, fitted, system)
    # what does nothing along the recorded path is not fitted along the model's own
    if not differs_from_neutral(full, name):
        return None
    refined = fit_along_rollouts(dataclasses.replace(accepted, fitted=full)).fit
    return refined if differs_from_neutral(refined, name) else None


def _hypothesis_of(
    result: SearchResult, names: Sequence[str], regression: Regression
) -> Hypothesis:
    """Return the set of just these names from the search, else the best set without all others."""
    just = tuple(sorted(names))
    # a set that was evaluated by itself has coefficients without what the others took of it
    exact = next((h for h in result.hypotheses if h.names == just), None)
    return exact or dataclasses.replace(
        result.best, posterior=_restricted_posterior(result.best, names, regression)
    )


def _restricted_posterior(
    h: Hypothesis, names: Collection[str], regression: Regression
) -> Posterior:
    # the posterior of a part is the marginal: its rows and columns of mean and covariance
    keep = [
        i
        for i, k in enumerate(h.posterior.columns)
        if variant_of(regression.system.columns[k]).effect in names
    ]
    p = h.posterior
    return dataclasses.replace(
        p,
        columns=tuple(p.columns[i] for i in keep),
        mean=p.mean[keep],
        covariance=p.covariance[np.ix_(keep, keep)],
    )
