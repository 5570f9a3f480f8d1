"""The rules by which a name is accepted, in their order; each leaves a record.

A rule looks at one name among those that passed the rules before it. It decides whether the name
goes on, and gives the reason. :data:`SEARCH_RULES` apply to a search, :func:`significant` to a full
fit, and :func:`practically_significant` to what that fit is worth.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence, Set

import numpy as np

from ges.conventions import QUATERNION
from ges.diagnose.design.columns import variant_of
from ges.diagnose.design.system import System, build, residuals_with
from ges.diagnose.detectors.balance import LOSSES, causes_of
from ges.diagnose.detectors.gusts import wind_speed_m_s
from ges.diagnose.estimate.contributions import (
    contributions,
    rms_by_channel,
    size_of_contribution,
)
from ges.diagnose.estimate.fit import Fitted
from ges.diagnose.estimate.joint import joint_fit, raw_residuals
from ges.diagnose.library.candidates import (
    HULL,
    amplitude_of,
    family_of,
    fit_bounds,
    has_prerequisite,
)
from ges.diagnose.library.requirements import SIDEWAYS, untestable_drags
from ges.diagnose.select.alike import Alike, alike_of
from ges.diagnose.select.evidence import Regression, contribution_of, whiten_system
from ges.diagnose.select.scorer import Entry
from ges.diagnose.select.search import Hypothesis, SearchResult, cause_count
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Decision, DecisionLog
from ges.diagnose.types.model import Model, block_of
from ges.simulator import effects as effect_table

SIGNIFICANT, PRACTICAL = "significant_when_fitted", "practically_significant"


@dataclasses.dataclass(frozen=True)
class RuleContext:
    """What the rules of a search look at.

    Attributes
    ----------
    regression, result : the search.
    passing : names that passed the rules before, in the order of the best set.
    listed : variants of all that was searched.
    """

    regression: Regression
    result: SearchResult
    passing: tuple[str, ...]
    listed: tuple[Entry, ...] = ()

    @functools.cached_property
    def probable(self) -> tuple[str, ...]:
        """Names of the best set that are probable, whatever else speaks against them."""
        best, least = self.result.best.names, settings.statistics.acceptance_probability
        return tuple(n for n in best if self.result.inclusion[n] >= least)

    def alike(self, name: str) -> tuple[Alike, ...]:
        """Return what these flights cannot separate from a name, without others of its family.

        Parameters
        ----------
        name : of the best set.
        """
        # in its place alone: what needs a prerequisite that is not there is no single cause
        present = {*self.result.best.names, *self.regression.system.model.effects} - {name}
        rivals = [e for e in self.listed if has_prerequisite(e.name, present)]
        return tuple(
            a
            for a in alike_of(self.regression, self.result.best, name, rivals)
            if a.name == name or a.name not in family_of(name)
        )

    def untestable_rivals(self, name: str) -> dict[str, str]:
        """Return drags that may do what a name does, and that these flights cannot show.

        Parameters
        ----------
        name : of the best set.

        Returns
        -------
        What would have to be logged, by drag. Empty for a name that does not mainly push sideways.
        Empty also for one that pushes more than the vehicle leans: flown steadily, drag is what
        leaning holds.
        """
        system = self.regression.system
        drags = untestable_drags(system.recordings, system.model)
        if not drags:
            return {}
        pushes = contribution_of(self.result.best.posterior, {name}, system)
        size = size_of_contribution([pushes], system)
        sideways = {f"{kind}_{n[-1]}" for kind in ("force", "acc") for n in SIDEWAYS}
        may_be_drag = size["channel"] in sideways and size["share_of_weight"] <= _lean(system)
        return drags if may_be_drag else {}

    def on(self) -> set[str]:
        """Return the passing names and the effects of the model.

        Returns
        -------
        Their names.
        """
        return {*self.passing, *self.regression.system.model.effects}


def _lean(system: System) -> float:
    """Return the rms share of the weight that lies across the thrust axis, as the vehicle leans.

    Infinite where no attitude is known: it may lean by anything.
    """
    if any(q not in f.columns for f in system.recordings for q in QUATERNION):
        return np.inf
    # third diagonal entry of the rotation: cosine of the angle between thrust axis and vertical
    x, y = (
        np.concatenate([f.columns[q][f.flying] for f in system.recordings]) for q in QUATERNION[1:3]
    )
    return float(np.sqrt(np.mean(1.0 - (1.0 - 2.0 * (x**2 + y**2)) ** 2)))


Rule = Callable[[RuleContext, str], Decision]


def probable(context: RuleContext, name: str) -> Decision:
    """Accept names with a high posterior probability in the best set.

    Parameters
    ----------
    context : of the search.
    name : to decide on.
    """
    p, best = context.result.inclusion[name], name in context.result.best.names
    least = settings.statistics.acceptance_probability
    because = f"uncalibrated posterior probability {p:.3g}" + (
        "" if best else ", not in the best set"
    )
    return Decision("probable", best and p >= least, because, p, least)


def best_of_its_family(context: RuleContext, name: str) -> Decision:
    """Accept the best of each family.

    Parameters
    ----------
    context : of the search.
    name : to decide on.

    Notes
    -----
    Two of a family act in the same place, and one makes up for the form error of the other.
    """
    better = _best_of(context.result, name, context.probable)
    because = "the best of its family" if better == name else f"{better} acts there, and better"
    return Decision("best_of_its_family", better == name, because)


def has_its_prerequisite(context: RuleContext, name: str) -> Decision:
    """Accept names that need no prerequisite, or have one that is on.

    Parameters
    ----------
    context : of the search.
    name : to decide on.
    """
    acts = has_prerequisite(name, context.on())
    prerequisites = " or ".join(effect_table.get(name).prerequisites) or "nothing"
    return Decision("carried", acts, f"acts through {prerequisites}")


def distinguishable(context: RuleContext, name: str) -> Decision:
    """Accept names that no rival explains nearly as well, or could be expected to.

    Parameters
    ----------
    context : of the search.
    name : to decide on.
    """
    rival, others = best_rival(context.result, name), rivals_nearly_as_good(context.result, name)
    if untestable := context.untestable_rivals(name):
        drag, reason = next(iter(untestable.items()))
        because = f"{drag} may do it, and cannot be tested here: it {reason}"
        return Decision("distinguishable", False, because)
    alike = next((a for a in context.alike(name) if a.name != name), None)
    if alike is not None:
        lead, least = alike.expected_log_odds, settings.statistics.acceptance_log_odds
        because = f"{alike.name} does nearly the same here: log odds {lead:.3g} to be expected"
        return Decision("distinguishable", False, because, lead, least)
    if rival is None:
        return Decision("distinguishable", True, "nothing else explains anything")
    lead = _log_odds_over(context.result, name, rival)
    least = settings.statistics.acceptance_log_odds
    because = f"log odds {lead:.3g} over {' with '.join(rival.names)} in its place"
    return Decision("distinguishable", not others, because, lead, least)


def separable_from_mass(context: RuleContext, name: str) -> Decision:
    """Accept a rotor that lost thrust if the balance separates it from a mass at its hub.

    Parameters
    ----------
    context : of the search.
    name : to decide on.

    Notes
    -----
    Against a calibrated file both need the same balance but in yaw.
    """
    rule, best = "told_from_a_mass", context.result.best
    # only a single lost rotor has one hub where a mass could stand in for it
    columns = [context.regression.system.columns[k] for k in best.posterior.columns]
    keys = [col.key for col in columns if variant_of(col).effect == name]
    rotors = [LOSSES.index(key) for key in keys if key in LOSSES]
    causes = causes_of(context.regression.system) if len(rotors) == 1 else []
    if not causes:
        return Decision(rule, True, "no mass at one hub would do the same")
    loss, mass = causes[rotors[0]]
    lead = 0.5 * (loss.distance_explained - mass.distance_explained)
    least = settings.statistics.acceptance_log_odds
    because = f"log odds {lead:.3g} over a mass at its hub, by the balance"
    return Decision(rule, lead >= least, because, lead, least)


SEARCH_RULES: tuple[Rule, ...] = (
    probable,
    best_of_its_family,
    has_its_prerequisite,
    distinguishable,
    separable_from_mass,
)


def apply_rules(
    rules: Sequence[Rule], context: RuleContext, names: Sequence[str], record: DecisionLog
) -> tuple[str, ...]:
    """Apply rules in order.

    Parameters
    ----------
    rules : each sees the names that passed the ones before.
    context : of the search.
    names : to decide on.
    record : takes every decision.

    Returns
    -------
    The names that pass all rules.
    """
    passing = tuple(names)
    for rule in rules:
        context_now = dataclasses.replace(context, passing=passing)
        decisions = {name: rule(context_now, name) for name in passing}
        for name, decision in decisions.items():
            record.note(name, decision)
        passing = tuple(name for name in passing if decisions[name].passed)
    return passing


def _best_of(result: SearchResult, name: str, among: Sequence[str]) -> str:
    """Return the best of a name's family, each tried without the others of the family."""
    return max(
        sorted(family_of(name) & set(among)),
        # with another of the family the name has only what that leaves it: each is compared alone
        key=lambda n: h.log_evidence if (h := _alone(result, n)) else -np.inf,
    )


def _alone(result: SearchResult, name: str) -> Hypothesis | None:
    """Return the best set that has this name and no other of its family."""
    return next((h for h in result.hypotheses if family_of(name) & set(h.names) == {name}), None)


def best_rival(result: SearchResult, name: str) -> Hypothesis | None:
    """Return the set that explains the flights best in a name's place, however rare it is.

    Parameters
    ----------
    result : of the search.
    name : of the effect.
    """
    best = _alone(result, name) or result.best
    # a larger set explains at least as much by its freedom alone
    others = [
        h
        for h in result.hypotheses
        if name not in h.names and h.names and cause_count(h.names) <= cause_count(best.names)
    ]
    # by the flights alone: a rarity in the prior must not hide what explains them as well
    return max(others, key=lambda h: h.flight_evidence, default=None)


def _log_odds_over(result: SearchResult, name: str, rival: Hypothesis) -> float:
    """Return log odds of the best set with a name over its rival, from the flights alone."""
    return (_alone(result, name) or result.best).flight_evidence - rival.flight_evidence


def rivals_nearly_as_good(result: SearchResult, name: str) -> tuple[str, ...]:
    """Return names that explain the flights nearly as well in a name's place.

    Parameters
    ----------
    result : of the search.
    name : of the effect.
    """
    rival = best_rival(result, name)
    if name not in result.best.names or rival is None:
        return ()
    if _log_odds_over(result, name, rival) > settings.statistics.acceptance_log_odds:
        return ()
    best = _alone(result, name) or result.best
    return tuple(n for n in rival.names if n not in best.names)


def significant(fitted: Fitted, name: str) -> Decision:
    """Decide whether a name is significant in a full fit.

    Parameters
    ----------
    fitted : with the name.
    name : of the effect.

    Notes
    -----
    1. A wind has to blow faster than air that is still.
    2. No amplitude stands at a bound.
    3. Some amplitude is certainly beyond its prior, and far from neutral with its shape given. An
       effect whose size its shape leaves open is there all the same.

    Far is ``certain_sds`` for what corrects a number of the file, as ten such numbers and more are
    always free. For other effects it is ``clear_sds``.
    """
    effect, rule = effect_table.get(name), SIGNIFICANT
    if effect.moves_air:
        speed_m_s = wind_speed_m_s(fitted.regression.system, name, fitted.effects[name])
        still_m_s = settings.decide.still_air_m_s
        if speed_m_s < still_m_s:
            return Decision(rule, False, "air is as still anywhere", speed_m_s, still_m_s)
    at_bound = next((p for e, p in parameters_at_bounds(fitted) if e == name), None)
    if at_bound is not None:
        value = fitted.effects[name][at_bound]
        return Decision(rule, False, f"{at_bound} stands at its bound", value, value)
    certain_sds = settings.statistics.certain_sds
    corrects = any(p.corrects for p in effect.parameters if p.name not in effect.shapes)
    required_sds = certain_sds if corrects else settings.statistics.clear_sds
    system, largest_sds = fitted.regression.system, 0.0
    for parameter in (p for e, p in fitted.free if e == name and p not in effect.shapes):
        deviation = _deviation(fitted, name, parameter)
        prior = system.number_with_prior(f"{name}.{parameter}")
        # what the prior of this number allows, the file's or the usual one, is no finding
        is_beyond_prior = not prior or abs(deviation - prior.mean) > certain_sds * prior.sd
        if is_beyond_prior:
            largest_sds = max(largest_sds, fitted.sds_from_neutral(name, parameter))
    because = f"{largest_sds:.3g} sds from neutral" if largest_sds else "within its prior sd"
    return Decision(rule, largest_sds > required_sds, because, largest_sds, required_sds)


def _deviation(fitted: Fitted, name: str, parameter: str) -> float:
    """Return the distance of an amplitude from neutral, in the parameter's unit.

    For a drive's delay or lag, what the other takes back is subtracted. Together they shape one
    response, which rows and a motor's second pole leave open.
    """
    deviation = fitted.effects[name][parameter] - amplitude_of(name, parameter).neutral
    other_s = _other_lateness_s(fitted, effect_table.get(name).parameter(parameter))
    if deviation * other_s < 0.0:
        return math.copysign(max(abs(deviation) - abs(other_s), 0.0), deviation)
    return deviation


def _other_lateness_s(fitted: Fitted, parameter: effect_table.Parameter) -> float:
    """Return how much later a drive responds by its delay, for a lag; by its lag, for a delay.

    Both are counted from the vehicle file, and add up to the mean of the drive's impulse response.
    A lag is the mean of those up and down. It is 0 for what is neither.
    """
    own = parameter.prior.timing if parameter.prior else ""
    if not own:
        return 0.0
    values = [
        fitted.effects.get(e.name, {}).get(
            p.name, fitted.joint.common.get(f"{e.name}.{p.name}", 0.0)
        )
        for e in effect_table.table().values()
        for p in e.parameters
        if p.prior and p.prior.timing not in ("", own)
    ]
    return float(np.mean(values))


def practically_significant(
    fitted: Fitted, names: Sequence[str], nominal: Model, recalibrated: Model
) -> dict[str, Decision]:
    """Decide whether flights agree better with a name than with the file, by what matters.

    Parameters
    ----------
    fitted : with the names.
    names : of effects; each is decided on.
    nominal, recalibrated : the vehicle file's model, as given and with its numbers set.

    Notes
    -----
    Some channel must be nearer by what matters. A number of the file may be wrong by less, but
    flights have to agree better. Numbers that undo each other change nothing, and a delay that a
    lag undoes does no more than recalibration alone.
    """
    system = fitted.regression.system
    reference, of_least = system.reference_scales, system.least_rms / system.reference_scales
    as_given, after = (
        rms_by_channel(residuals, system) / reference
        for residuals in (residuals_with(system, nominal), raw_residuals(system, fitted.joint))
    )

    def decision(name: str, made: Sequence[np.ndarray]) -> Decision:
        corrects, gain = effect_table.get(name).about == "parameter", as_given**2 - after**2
        # of what flights are nearer by no more is the name's than what it makes
        own = rms_by_channel(made, system) / reference
        share = np.minimum(np.copysign(np.sqrt(np.abs(gain)), gain), own)
        if not corrects:
            # recalibration may have moved this very number
            without = _residuals_with_batteries(fitted, recalibrated.with_effect_of(name, nominal))
            share[after >= rms_by_channel(without, system) / reference] = 0.0
        least = np.zeros(len(share)) if corrects else of_least
        margin = share - least
        # force and accelerometer show one push alike but for rounding; the first is named
        c = int(np.argmax(margin > margin.max() - settings.numerics.small))
        because = "no nearer than the vehicle file, as given or recalibrated"
        if share[c] > 0.0:
            percent, channel = 100.0 * share[c], system.main[c]
            because = f"{percent:.2g} % of the whole nearer than the vehicle file in {channel}"
        passed = bool(share[c] > settings.numerics.small and share[c] >= least[c])
        return Decision(PRACTICAL, passed, because, float(share[c]), float(least[c]))

    return {n: decision(n, made) for n, made in contributions(fitted, names, nominal).items()}


def _residuals_with_batteries(fitted: Fitted, model: Model) -> list[np.ndarray]:
    """Return residuals of another model, with what drives have of their own fitted to it.

    The level of each flight's battery is no merit of a name. Trims of each flight are not fitted:
    a push that all flights share would be one.
    """
    regression = fitted.regression
    system = build(regression.system.recordings, model, [], regression.system)
    corrections, near = model.corrections, math.sqrt(settings.numerics.small)
    priors = {key: (corrections.get(key, 0.0), near) for key in system.nuisances}
    white = whiten_system(system, regression.noise)
    residuals = raw_residuals(system, joint_fit(white, (), nuisance_priors=priors))
    of_drive = np.array([block_of(name) == "drive" for name in system.main])
    return [
        np.where(of_drive, own, rows.y[:, : len(of_drive)])
        for own, rows in zip(residuals, system.flights, strict=True)
    ]


def parameters_at_bounds(fitted: Fitted) -> list[tuple[str, str]]:
    """Return amplitudes beyond a bound of the library, and places on the body at its hull.

    The flights ask for more than the effect can be: something else is behind it. An amplitude whose
    optimum is no farther beyond its bound than its sd, its shape given, may well be what the bound
    allows.

    Parameters
    ----------
    fitted : the fit.

    Returns
    -------
    Effect and parameter of each.
    """
    model = fitted.regression.system.model
    at_bounds = []
    for e, p in fitted.free:
        value, effect, a = fitted.effects[e][p], effect_table.get(e), amplitude_of(e, p)
        at_hull = effect.parameter(p).reach_over == HULL and value in fit_bounds((e, p), model)
        at_bound = p not in effect.shapes and value != a.neutral and value in (a.low, a.high)
        if at_hull or at_bound and fitted.sds_beyond_bound(e, p) > 1.0:
            at_bounds.append((e, p))
    return at_bounds


def differs_from_neutral(fitted: Fitted, name: str) -> bool:
    """Return whether some amplitude is farther from neutral than its sd.

    Parameters
    ----------
    fitted : with the name.
    name : of the effect.
    """
    own = [
        (p, amplitude_of(name, p).neutral)
        for e, p in fitted.free
        if e == name and p not in effect_table.get(name).shapes
    ]
    return any(abs(fitted.effects[name][p] - neutral) > fitted.sd(name, p) for p, neutral in own)


def open_names(result: SearchResult, names: Set[str], contested: Set[str]) -> tuple[str, ...]:
    """Return names that replace each other: none accepted alone, but one of them needed.

    Parameters
    ----------
    result : of the search.
    names : that are decided.
    contested : names that others could replace, and those others.

    Returns
    -------
    The most probable first; empty for fewer than two.
    """
    # one of those that are contested stands for what they do, so that it is no want of others
    decided = names | contested
    # probability that nothing is at work beyond the decided names
    without = sum(h.probability for h in result.hypotheses if not set(h.names) - decided)
    possible = settings.statistics.possible_probability
    needed = without <= possible
    open_names = contested | {
        n for n, p in result.inclusion.items() if needed and n not in decided and p > possible
    }
    if len(open_names) < 2:
        return ()
    ranked = sorted(open_names, key=lambda n: (-result.inclusion.get(n, 0.0), n))
    # a credible set: the most probable names that hold the probability of an acceptance together
    share = np.cumsum([result.inclusion.get(n, 0.0) for n in ranked])
    count = 1 + int(np.searchsorted(share, settings.statistics.acceptance_probability * share[-1]))
    return tuple(n for i, n in enumerate(ranked) if i < max(count, 2) or n in contested)
