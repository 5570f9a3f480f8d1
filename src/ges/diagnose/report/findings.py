"""Findings: effects with parameters, size, probability and rivals, as the contract names them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.advise.detect import DetectedEffect
from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.contradicted import Contradicted
from ges.diagnose.decide.explanation import Explanation
from ges.diagnose.decide.rules import parameters_at_bounds
from ges.diagnose.design.columns import variant_of
from ges.diagnose.design.system import System
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.clocks import gate_findings
from ges.diagnose.detectors.thrust import UnmeasuredThrust
from ges.diagnose.estimate.contributions import (
    contributions,
    contributions_of,
    size_of_contribution,
)
from ges.diagnose.estimate.fit import Fitted
from ges.diagnose.library.candidates import amplitude_of, place_of
from ges.diagnose.prepare.gate import Gate
from ges.diagnose.report.content import places_of
from ges.diagnose.select.probability import calibrated_probability
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import Finding, FittedParameter
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


def all_findings(
    explanation: Explanation,
    nominal: Model,
    contradicted: Sequence[Contradicted],
    unnamed_cause: Shift | UnmeasuredThrust | None,
    gate: Gate,
) -> list[Finding]:
    """Return the findings of a diagnosis.

    Parameters
    ----------
    explanation : accepted names with their fits.
    nominal : the vehicle file's model, against which sizes count.
    contradicted : nominal parameters that the flights contradict.
    unnamed_cause : a shifted balance or unmeasured thrust; None without one.
    gate : delays and offsets that were removed.

    Returns
    -------
    Accepted effects, the largest first, then sensor faults, contradicted parameters, and open
    names.
    """
    accepted = explanation.accepted
    proven = [
        f
        for n, contribution in explanation.contributions.items()
        for f in _findings_by_place(accepted, n, contribution, nominal)
    ]
    # shares make a force, a moment and a rotor speed comparable
    proven.sort(key=lambda f: -f.size["share_of_weight"])
    proven += [explanation.gusts.finding()] if explanation.gusts else []
    return [
        *proven,
        *gate_findings(gate, explanation.last.model.prior_sds),
        *_contradicted_findings(contradicted, explanation.last.regression.system),
        *open_findings(accepted, nominal),
        *(unnamed_cause.findings() if unnamed_cause else ()),
    ]


def detected_effects(accepted: Accepted) -> dict[str, DetectedEffect]:
    """Return the accepted effects with their sizes, for the limits of detection.

    Parameters
    ----------
    accepted : names and fits.
    """
    if accepted.fitted is None:
        return {}
    columns = accepted.regression.system.columns
    chosen = accepted.result.best.posterior.columns
    variants = {v.effect: v for v in (variant_of(columns[k]) for k in chosen)}
    effects = accepted.fitted.effects
    return {
        name: DetectedEffect(
            variants.get(name),
            {
                p: abs(effects[name][p] - amplitude_of(name, p).neutral)
                for e, p in accepted.fitted.free
                if e == name
            },
        )
        for name in accepted.names
    }


def _parameters_of(
    fitted: Fitted, name: str, nominal: Mapping[str, float]
) -> dict[str, FittedParameter]:
    """Return fitted parameters of one effect with 95 % intervals.

    Notes give strong correlations, bounds that were met, and what the vehicle file has.
    """
    estimates, at_bounds = {}, parameters_at_bounds(fitted)
    for e, p in fitted.free:
        if e == name:
            notes = (
                f"the vehicle file has {nominal[p]:.3g}" if p in nominal else "",
                _lever_note(fitted.effects[name], name, nominal),
                _correlation_note(fitted, (e, p)),
                "at its bound: these flights ask for more" if (e, p) in at_bounds else "",
            )
            note = "; ".join(n for n in notes if n)
            value, sd = fitted.effects[e][p], fitted.sd(e, p)
            estimates[p] = FittedParameter.of(f"{e}.{p}", value, sd, note)
    return estimates


def _lever_note(values: Mapping[str, float], name: str, nominal: Mapping[str, float]) -> str:
    """Return where an effect acts, if that is not where the vehicle file has it."""
    lever = effect_table.get(name).lever
    if lever is None or values[lever.name] == nominal.get(lever.name, lever.default):
        return ""
    return f"its {lever.name} is {values[lever.name]:.2g}"


def _correlation_note(fitted: Fitted, key: tuple[str, str]) -> str:
    others = [(abs(fitted.correlation(key, other)), other) for other in fitted.free if other != key]
    top = max(others, default=(0.0, key))
    return (
        f"tied to {'.'.join(top[1])} (correlation {top[0]:.2f}): together well known, apart less"
        if top[0] > settings.report.tied_correlation
        else ""
    )


def _alternatives_of(accepted: Accepted, name: str) -> tuple[dict, ...]:
    """Return names that could take its place, with log odds against the best set.

    Other places of the same name that these flights cannot separate come first.
    """
    # the best set without the name, by what it has that was not accepted: that takes its place
    best: dict[str, float] = {}
    result = accepted.result
    # a name of a later round was accepted given others, which the first search did not have
    for h in result.hypotheses if name in result.best.names else ():
        if name not in h.names:
            for other in set(h.names) - set(accepted.names):
                odds = h.log_evidence - result.best.log_evidence
                best[other] = max(best.get(other, -np.inf), odds)
    ranked = sorted(best.items(), key=lambda item: (-item[1], item[0]))[
        : settings.report.alternatives
    ]
    places = [
        {"name": a.name, "place": a.place, "log_odds": -a.expected_log_odds}
        for a in accepted.alike.get(name, ())
    ]
    return (*places, *({"name": n, "log_odds": float(v)} for n, v in ranked))


def _finding(
    accepted: Accepted, name: str, contribution: Sequence[np.ndarray], nominal: Model
) -> Finding:
    """Return one accepted effect; ``contribution`` (m, C) by flight."""
    return Finding.of(
        name,
        calibrated_probability(accepted.probability[name]),
        _parameters_of(accepted.fit, name, nominal.effects.get(name, {})),
        size_of_contribution(contribution, accepted.fit.regression.system),
        _alternatives_of(accepted, name),
        place=places_of(accepted, name),
    )


def _findings_by_place(
    accepted: Accepted, name: str, contribution: Sequence[np.ndarray], nominal: Model
) -> list[Finding]:
    """Return one accepted effect, as one finding for each place where it acts.

    ``contribution`` is by flight, (m, C) of :func:`contributions`.
    """
    fitted, system = accepted.fit, accepted.fit.regression.system
    numbered = [p for e, p in fitted.free if e == name and place_of(p)]
    # ``added`` is of all places together, so each is computed alone, with the others at neutral
    if len(numbered) < 2:
        return [_finding(accepted, name, contribution, nominal)]
    whole = _finding(accepted, name, contribution, nominal)
    neutral = effect_table.get(name).neutral()
    findings = []
    for parameter in numbered:
        others = {p: neutral[p] for p in numbered if p != parameter}
        effects = {**system.model.effects, name: {**fitted.effects[name], **others}}
        size = size_of_contribution(contributions_of(effects, name, system, nominal), system)
        parameters = {parameter: whole.parameters[parameter]}
        place = place_of(parameter)
        findings.append(dataclasses.replace(whole, parameters=parameters, size=size, place=place))
    return findings


def _contradicted_findings(contradicted: Sequence[Contradicted], system: System) -> list[Finding]:
    """Return contradicted nominal parameters, by the effect that corrects them.

    A number that no effect corrects is in the sentence and the calibration alone.
    """
    names = dict.fromkeys(
        number.effect
        for number in contradicted
        if number.effect != "vehicle" and not number.is_trim
    )
    return [
        _contradicted_finding(name, [n for n in contradicted if n.effect == name], system)
        for name in names
    ]


def _contradicted_finding(
    name: str, contradicted: Sequence[Contradicted], system: System
) -> Finding:
    note = "correction of the vehicle file, {:.1f} times its prior sd"
    parameters = {
        ParameterKey.of(n.key).parameter: FittedParameter.of(
            n.key, n.value, n.sd, note.format(n.sds)
        )
        for n in contradicted
    }
    # to first order: the number's column times its correction
    terms = {system.nuisances[n.key]: n.value for n in contradicted}
    contribution = [rows.weighted_columns(terms, len(system.main)) for rows in system.flights]
    # certain by its own rule, hence as sure as any name can be
    finding = Finding.of(
        name, calibrated_probability(1.0), parameters, size_of_contribution(contribution, system)
    )
    # the effect may be physics; what is wrong here is a number of the file
    return dataclasses.replace(finding, kind="parameter")


def open_findings(accepted: Accepted, nominal: Model) -> list[Finding]:
    """Return the names that the flights cannot separate, each as fitted with what is accepted.

    Parameters
    ----------
    accepted : names and fits; without a fit of a name its coefficient from the search counts.
    nominal : the vehicle file's model, against which sizes count.
    """
    return [_open_finding(accepted, name, nominal) for name in accepted.rivals]


def _open_finding(accepted: Accepted, name: str, nominal: Model) -> Finding:
    fitted, inclusion = accepted.alternatives.get(name), accepted.result.inclusion
    # one of them is needed: a set that has two makes neither surer than the other lets it be
    # what cannot be tested is as likely as any of them
    probability = calibrated_probability(
        inclusion.get(name, 1.0) / max(1.0, sum(inclusion.get(n, 1.0) for n in accepted.rivals))
    )
    # without a fit there is no contribution to size, only the coefficient of the search
    if fitted is None:
        return Finding.of(name, probability, _search_estimates(accepted, name), is_open=True)
    contribution = contributions(fitted, (name,), nominal)[name]
    return Finding.of(
        name,
        probability,
        _parameters_of(fitted, name, nominal.effects.get(name, {})),
        size_of_contribution(contribution, fitted.regression.system),
        is_open=True,
        place=places_of(accepted, name),
    )


def _search_estimates(accepted: Accepted, name: str) -> dict[str, FittedParameter]:
    """Return parameters of one name from the search; none of what these flights cannot show."""
    if name not in accepted.result.inclusion:
        return {}
    posterior = accepted.result.best_with(name, accepted.rivals).posterior
    estimates: dict[str, FittedParameter] = {}
    for k, mean, sd in zip(posterior.columns, posterior.mean, posterior.sd, strict=True):
        column = accepted.regression.system.columns[k]
        variant = variant_of(column)
        # the moment's part has a coefficient of its own, and is no parameter of the effect
        if variant.effect == name and column.part != "moment":
            a = variant.amplitudes[column.amplitude]
            estimates[a.parameter] = FittedParameter.of(
                f"{name}.{a.parameter}", a.neutral + float(mean), float(sd)
            )
    return estimates
