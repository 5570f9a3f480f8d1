"""From a search to what is accepted of it: names that pass the rules, fitted in full, then effects
that modify the accepted ones.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from scipy.special import expit

from ges.diagnose.decide.rules import (
    SEARCH_RULES,
    RuleContext,
    ambiguous,
    does_something,
    judged,
    replaced_by,
    significant,
)
from ges.diagnose.design.system import System, build, variant_of
from ges.diagnose.detectors.loads import probable_load, refine_load
from ges.diagnose.estimate.fit import Fitted, fitted_model, free_parameters, polish, starting_values
from ges.diagnose.estimate.shoot import with_rollout_path
from ges.diagnose.library.available import candidates_of
from ges.diagnose.library.candidates import (
    Candidate,
    amplitude_of,
    family_of,
    has_prerequisite,
    modifiers_of,
)
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
from ges.diagnose.types.decision import Decision, Record
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Accepted:
    """Outcome of the search on the training flights.

    Attributes
    ----------
    names : what is accepted.
    found, regression : the first search, with no name accepted yet.
    fitted : the accepted names fitted in full; None where there are none.
    probability : posterior probability of every accepted name.
    rivals : names of which one is needed, the likeliest first.
    contested : those of them that others could replace.
    alternatives : the fits with each rival, the first of them ``fitted``.
    alike : places where each name does nearly the same in these flights.
    """

    names: tuple[str, ...]
    found: SearchResult
    regression: Regression
    fitted: Fitted | None
    probability: dict[str, float]
    rivals: tuple[str, ...]
    contested: frozenset[str] = frozenset()
    alternatives: Mapping[str, Fitted] = dataclasses.field(default_factory=dict)
    alike: Mapping[str, tuple[Alike, ...]] = dataclasses.field(default_factory=dict)

    @property
    def fit(self) -> Fitted:
        """``fitted``, where something is accepted.

        Raises
        ------
        ValueError : where nothing is.
        """
        if self.fitted is None:
            raise ValueError("nothing is accepted, and so nothing is fitted")
        return self.fitted

    @property
    def modelled(self) -> tuple[str, ...]:
        """The names, and the first of the alternatives beside them."""
        return (*self.names, *itertools.islice(self.alternatives, 1))


def accept(start: Regression, record: Record, only: Sequence[str] | None = None) -> Accepted:
    """Search the library, keep what is proven, then let effects that modify the kept ones compete
    too.

    Parameters
    ----------
    start : of the declared vehicle, with nothing chosen.
    record : takes every decision.
    only : fit exactly these names instead of searching.
    """
    system, first = start.system, None
    base = system.model
    fitted: Fitted | None = None
    names: tuple[str, ...] = ()
    probability: dict[str, float] = {}
    contested: set[str] = set()
    alike: dict[str, tuple[Alike, ...]] = {}
    listed = candidates_of(system.recordings, base, (), only)
    while listed:
        regression = start if first is None else _laid_out(listed, base, system)
        regression, found = _searched(regression, listed, base, only)
        first = first or (regression, found)
        context = RuleContext(
            regression, found, found.best.names, tuple(entries(regression, listed))
        )
        told = judged(SEARCH_RULES, context, sorted(found.inclusion), record)
        told = tuple(n for n in found.best.names if n in told)
        if not names:
            contested = _contested(context, record)
            alike = {n: context.alike(n) for n in told}
        through = _modifying(regression, found, listed, told, only)
        new, polished = _fitted_in_full(
            regression,
            found,
            (*told, *through),
            through,
            base,
            fitted,
            system,
            record,
            only is None,
        )
        if polished is None or not new:
            break
        probability |= {
            n: through[n].probability if n in through else found.inclusion[n] for n in new
        }
        fitted, names = polished, names + new
        if only is None:
            # the wind is known only now; the forms that the search chose were weighed in still air
            fitted, instead = _best_forms_in_wind(fitted, names, system, record)
            names = tuple(instead.get(n, n) for n in names)
            probability = {instead.get(n, n): p for n, p in probability.items()}
        # the next round is linearised about what is accepted, and lists what acts through it
        base = system.model.with_effects(polished.effects)
        listed = candidates_of(system.recordings, base, names, only)
    regression, found = first or search_until_stable(start, (), ())[:2]
    # a name that is probable, but failed another rule, is not open
    settled = {
        *names,
        *(n for n, p in found.inclusion.items() if p >= settings.statistics.acceptance_probability),
    }
    # what was open at first, and then was accepted beside the others, is open no more
    contested -= set(names)
    rivals = ambiguous(found, settled - contested, contested)
    if rivals and not _needed(rivals, base, system):
        rivals = ()
    return Accepted(
        names,
        found,
        regression,
        fitted,
        probability,
        rivals,
        frozenset(contested),
        alike=alike,
    )


def _contested(context: RuleContext, record: Record) -> set[str]:
    """Names that could not be told from others, and those others."""
    found = context.found
    undone = [
        name
        for name in found.best.names
        for d in record.of(name)
        if d.rule == "distinguishable" and not d.passed
    ]
    others = {n: [a.name for a in context.alike(n)] for n in undone}
    return {n for name in undone for n in (name, *replaced_by(found, name), *others[name])}


def _laid_out(listed: Sequence[Candidate], base: Model, like: System) -> Regression:
    """Build the regression of candidates beside the base, on the flights of a system like it."""
    return make_regression(
        build(like.recordings, base, [v for c in listed for v in c.variants], like)
    )


def _searched(
    regression: Regression, listed: Sequence[Candidate], base: Model, only: Sequence[str] | None
) -> tuple[Regression, SearchResult]:
    """The search; once more beside a load whose thread and first place are sharp: missed by
    centimetres, they need other names for what is left.
    """
    regression, found, _ = search_until_stable(regression, listed, tuple(base.effects), only)
    variant = probable_load(regression, found)
    if variant is None:
        return regression, found
    known = regression.system
    sharp = refine_load(known, variant)
    # two variants of one key are one entry, which would hold the load's mass twice
    if sharp.key in {v.key for c in listed for v in c.variants}:
        return regression, found
    listed = [
        dataclasses.replace(c, variants=(*c.variants, sharp)) if c.name == variant.effect else c
        for c in listed
    ]
    sharper = _laid_out(listed, known.model, known)
    return search_until_stable(sharper, listed, tuple(known.model.effects), only)[:2]


def _needed(rivals: Sequence[str], base: Model, system: System) -> bool:
    """Whether one of these is needed still beside what was accepted, as its fit in full has it."""
    listed = candidates_of(system.recordings, base, (), rivals)
    found = search_until_stable(_laid_out(listed, base, system), listed, tuple(base.effects))[1]
    return found.null().probability <= settings.statistics.possible_probability


@dataclasses.dataclass(frozen=True)
class _Modifying:
    """What the best variant of an effect is modified by: its values, and how probable it is beside
    the effect alone.
    """

    values: Mapping[str, float]
    probability: float


def _modifying(
    regression: Regression,
    found: SearchResult,
    listed: Sequence[Candidate],
    names: Collection[str],
    only: Sequence[str] | None,
) -> dict[str, _Modifying]:
    """Modifiers of these names' variants in the best set, if no plain variant is nearly as good; or
    if they are asked for.
    """
    chosen = found.best.posterior.columns if names else ()
    variants = [variant_of(regression.system.columns[k]) for k in chosen]
    brought = {
        m: values for v in variants if v.effect in names for m, values in modifiers_of(v).items()
    }
    if only is not None:
        return {m: _Modifying(values, 1.0) for m, values in brought.items() if m in only}
    if not brought:
        return {}
    # as a search of all that modifies these effects, and of nothing else, has them
    ways = sum(e.modifies in names for e in effect_table.table().values())
    odds = log_evidence_over_plain(regression, listed, found.best) - log_odds_against_one_of(ways)
    if odds <= settings.statistics.acceptance_log_odds:
        return {}
    return {m: _Modifying(values, float(expit(odds))) for m, values in brought.items()}


def _in_full(
    regression: Regression,
    h: Hypothesis,
    beside: Fitted | None,
    system: System,
    through: effect_table.Effects = MappingProxyType({}),
) -> Fitted:
    """Fit in full a set that a search weighed, beside what is fitted already; the
    system is of the model without. What goes ``through`` effects of the set is fitted with it, from
    its values.
    """
    held, known = (beside.effects, beside.free) if beside else ({}, ())
    values = {
        **starting_values(regression, h),
        **{m: {**effect_table.get(m).neutral(), **v} for m, v in through.items()},
    }
    free = [
        *known,
        *free_parameters(regression, h, system.model, values),
        *((m, p) for m, v in through.items() for p in v),
    ]
    return polish(system, {**held, **values}, free)


def _fitted_in_full(
    regression: Regression,
    found: SearchResult,
    new: tuple[str, ...],
    through: Mapping[str, _Modifying],
    base: Model,
    fitted: Fitted | None,
    system: System,
    record: Record,
    choosing: bool,
) -> tuple[tuple[str, ...], Fitted | None]:
    """The new names that are significant when their numbers are fitted in full, and that fit; those
    that are not are left out of it, what goes ``through`` others first.
    """
    while new:
        modifying = {m: through[m].values for m in new if m in through}
        kept = _with_names(found, [n for n in new if n not in modifying], regression)
        full = _in_full(regression, kept, fitted, system, modifying)
        decisions = {n: significant(full, n) for n in new} if choosing else {}
        for name, decision in decisions.items():
            record.note(name, decision)
        fallen = {n for n, d in decisions.items() if not d.passed}
        fallen = (fallen & set(modifying)) or fallen
        # what acted through a name that fell has nothing to act through
        fallen |= {n for n in new if not has_prerequisite(n, {*base.effects, *(set(new) - fallen)})}
        if not fallen:
            return new, full
        new = tuple(n for n in new if n not in fallen)
    return (), fitted


def _best_forms_in_wind(
    fitted: Fitted, names: Sequence[str], system: System, record: Record
) -> tuple[Fitted, dict[str, str]]:
    """The fit with others of their family in place of those that wind acts through, where these fit
    the flights better, and by what each of them is replaced.

    A search weighs every form in still air. In wind linear and quadratic drag are other functions
    of the motion, so there each is asked again, in full and under the same noise.
    """
    instead: dict[str, str] = {}
    blown = {
        c for n in names if effect_table.get(n).moves_air for c in effect_table.get(n).prerequisites
    }
    listed = {c.name for c in candidates_of(system.recordings, system.model)}
    least = settings.statistics.acceptance_log_odds
    for name in sorted(blown & set(names)):
        rule, better, gained = "best_form_in_wind", fitted, 0.0
        for rival in sorted((family_of(name) & listed) - set(fitted.effects)):
            tried = _in_place_of(fitted, name, rival, system)
            # costs are -2 log posterior under one noise; each row counts as in the evidence
            gain = (
                0.5
                * settings.evidence.tempering
                * (fitted.joint_free_moments.cost - tried.joint_free_moments.cost)
            )
            because = f"log odds {gain:.3g} over {name}, both in full where the air moves"
            passed = gain > least and significant(tried, rival).passed
            record.note(rival, Decision(rule, passed, because, gain, least))
            if passed and gain > gained:
                better, gained, instead[name] = tried, gain, rival
        if name in instead:
            because = f"{instead[name]} fits better where the air moves"
            record.note(name, Decision(rule, False, because, -gained, -least))
            fitted = polish(system, better.effects, better.free)
    return fitted, instead


def _in_place_of(fitted: Fitted, name: str, rival: str, system: System) -> Fitted:
    """The fit with a rival in place of a name, under the same noise."""
    known = effect_table.get(rival)
    amplitudes = [
        amplitude_of(rival, p.name) for p in known.parameters if p.name not in known.shapes
    ]
    values = {
        **{e: v for e, v in fitted.effects.items() if e != name},
        # a step from neutral: at neutral itself a shape moves nothing, and its column vanishes
        rival: {**known.neutral(), **{a.parameter: a.neutral + a.step for a in amplitudes}},
    }
    free = [
        *(f for f in fitted.free if f[0] != name),
        *((rival, a.parameter) for a in amplitudes),
        *((rival, p) for p in known.shapes if known.parameter(p).fitted),
    ]
    return polish(system, values, free, fixed_noise=fitted.regression.noise)


def shot_fit(accepted: Accepted) -> Accepted:
    """The same, its fit polished by multiple shooting: the model is asked along the path that it
    flies itself.

    What remembers the path, as a load that swings on it, would remember where one piece of it ends
    and the next begins: then nothing is shot.
    """
    fitted, system = accepted.fitted, accepted.regression.system
    if fitted is None or any(effect_table.get(name).remembers_the_path for name in fitted.effects):
        return accepted
    # along its own path a push of turbulence no longer moves the velocity that drag is held against
    model = fitted_model(system.model, fitted)
    flights = [with_rollout_path(flight, model) for flight in system.recordings]
    polished = polish(system, fitted.effects, fitted.free, flights)
    return dataclasses.replace(accepted, fitted=polished)


def with_alternatives(accepted: Accepted, record: Record) -> Accepted:
    """The same with every name that is open fitted in full beside what is accepted, where it can
    act; without the names that then do nothing, if two are left.
    """
    tried = {name: _beside(accepted, name) for name in accepted.rivals}
    fits = {
        name: fitted
        for name, fitted in tried.items()
        if fitted is not None and does_something(fitted, name)
    }
    idle = set(tried) - set(fits) if len(fits) > 1 else set()
    for name in tried:
        because = "does nothing once it is fitted" if name in idle else "one of these is needed"
        record.note(name, Decision("open", name not in idle, because))
    return dataclasses.replace(
        accepted,
        rivals=tuple(n for n in accepted.rivals if n not in idle),
        fitted=next(iter(fits.values()), accepted.fitted),
        alternatives=fits,
    )


def _beside(accepted: Accepted, name: str) -> Fitted | None:
    """The fit with one open name, and what it acts through, beside what is accepted; None where it
    cannot act.
    """
    system, fitted = accepted.regression.system, accepted.fitted
    best = accepted.found.best_with(name, accepted.rivals)
    held = set(fitted.effects) if fitted else set()
    # a modifier or a wind alone does nothing: the carrier of its own best set comes with it
    mine = ({name} | set(effect_table.get(name).prerequisites) & set(best.names)) - held
    if not has_prerequisite(name, {*mine, *held, *system.model.effects}):
        return None
    kept = dataclasses.replace(best, posterior=_only(best, mine, accepted.regression))
    full = _in_full(accepted.regression, kept, fitted, system)
    return shot_fit(dataclasses.replace(accepted, fitted=full)).fitted


def without(accepted: Accepted, name: str) -> Accepted:
    """The same with one name less, and what acts through it alone; the others fitted anew."""
    system = accepted.regression.system
    rest = {*accepted.names, *system.model.effects} - {name}
    names = tuple(n for n in accepted.names if n in rest and has_prerequisite(n, rest))
    if not names:
        return withdrawn(accepted)
    fitted = accepted.fit
    values, free = {n: fitted.effects[n] for n in names}, [f for f in fitted.free if f[0] in names]
    left = polish(system, values, free)
    probability = {n: accepted.probability[n] for n in names}
    return dataclasses.replace(accepted, names=names, fitted=left, probability=probability)


def withdrawn(accepted: Accepted) -> Accepted:
    """The search as it was, with nothing accepted of it."""
    return dataclasses.replace(accepted, names=(), fitted=None, probability={}, rivals=())


def _with_names(found: SearchResult, names: Sequence[str], regression: Regression) -> Hypothesis:
    """The set of just these names as the search weighed it, else the best set less all others."""
    just = tuple(sorted(names))
    # a set that was weighed by itself has coefficients without what the others took of it
    weighed = next((h for h in found.hypotheses if h.names == just), None)
    return weighed or dataclasses.replace(
        found.best, posterior=_only(found.best, names, regression)
    )


def _only(h: Hypothesis, names: Collection[str], regression: Regression) -> Posterior:
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
