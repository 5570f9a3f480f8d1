"""Findings: an accepted effect with its parameters, size, probability and rivals, as the contract
names them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.advise.detect import DetectedEffect
from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.declared import Contradicted
from ges.diagnose.decide.withdraw import Explanation, practically_significant
from ges.diagnose.design.system import System, variant_of
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
from ges.diagnose.select.stated import stated
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Record
from ges.diagnose.types.diagnosis import Estimate, Finding, interval95
from ges.simulator import effects as effect_table


def all_findings(
    answer: Explanation,
    wrong: Sequence[Contradicted],
    shift: Shift | UnmeasuredThrust | None,
    gate: Gate,
    record: Record,
    choosing: bool,
) -> list[Finding]:
    """What is proven, the largest first, what the gate settled, declared numbers that the flights
    contradict, and what is open.

    Parameters
    ----------
    wrong : declared numbers that the flights contradict.
    shift : what moved, where the flights cannot tell by which of several causes.
    choosing : whether names were searched, and not given.
    """
    accepted = answer.accepted
    proven = [f for n, added in answer.added.items() for f in by_place(accepted, n, added)]
    # shares make a force, a moment and a rotor speed comparable
    proven.sort(key=lambda f: -f.size["share_of_weight"])
    proven += [answer.gusts.finding()] if answer.gusts else []
    # names that were given are told whatever their size
    if choosing:
        model = answer.last.model
        proven = [f for f in proven if practically_significant(f.name, f.size, model, record)]
    return [
        *proven,
        *gate_findings(gate, answer.last.model.prior_sds),
        *declared_findings(wrong, answer.last.regression.system),
        *open_findings(accepted),
        *(shift.findings() if shift else ()),
    ]


def found_sizes(accepted: Accepted) -> dict[str, DetectedEffect]:
    """What was accepted, as the limits of what can be seen are held against it."""
    if accepted.fitted is None:
        return {}
    columns = accepted.regression.system.columns
    chosen = accepted.found.best.posterior.columns
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


def parameters_of(fitted: Fitted, name: str, declared: Mapping[str, float]) -> dict[str, Estimate]:
    """Fitted parameters of one effect with 95 % intervals; what it is strongly tied to, and what
    the file has, is noted.
    """
    units = {p.name: p.unit for p in effect_table.get(name).parameters}
    told = {}
    for e, p in fitted.free:
        if e == name:
            notes = (
                f"the vehicle file has {declared[p]:.3g}" if p in declared else "",
                _tied(fitted, (e, p)),
            )
            value = fitted.effects[e][p]
            told[p] = Estimate(
                value,
                interval95(value, fitted.sd(e, p)),
                units[p],
                "; ".join(n for n in notes if n),
            )
    return told


def _tied(fitted: Fitted, key: tuple[str, str]) -> str:
    others = [(abs(fitted.correlation(key, other)), other) for other in fitted.free if other != key]
    top = max(others, default=(0.0, key))
    return (
        f"tied to {'.'.join(top[1])} (correlation {top[0]:.2f}): together well known, apart less"
        if top[0] > settings.report.tied_correlation
        else ""
    )


def alternatives_of(accepted: Accepted, name: str) -> tuple[dict, ...]:
    """Names that could stand in its place, with the log odds against the best set that has it;
    first other places of it that these flights cannot tell from its own.
    """
    weighed = accepted.found.hypotheses
    having = max((h.log_evidence for h in weighed if name in h.names), default=0.0)
    # the best set without the name, by what it has that was not accepted: that takes its place
    best: dict[str, float] = {}
    for h in weighed:
        if name not in h.names:
            for other in set(h.names) - set(accepted.names):
                best[other] = max(best.get(other, -np.inf), h.log_evidence - having)
    ranked = sorted(best.items(), key=lambda item: (-item[1], item[0]))[
        : settings.report.alternatives
    ]
    places = [
        {"name": a.name, "place": a.place, "log_odds": -a.expected_log_odds}
        for a in accepted.alike.get(name, ())
    ]
    return (*places, *({"name": n, "log_odds": float(v)} for n, v in ranked))


def finding(accepted: Accepted, name: str, added: Sequence[np.ndarray]) -> Finding:
    """One accepted effect; ``added`` (m, C) by flight, of :func:`contributions`."""
    declared = accepted.regression.system.model.effects.get(name, {})
    return Finding.of(
        name,
        stated(accepted.probability[name]),
        parameters_of(accepted.fit, name, declared),
        size_of_contribution(added, accepted.fit.regression.system),
        alternatives_of(accepted, name),
        place=places_of(accepted, name),
    )


def by_place(accepted: Accepted, name: str, added: Sequence[np.ndarray]) -> list[Finding]:
    """One accepted effect; of one that acts in several places, a finding for each place.

    Parameters
    ----------
    added : by flight, (m, C) of :func:`contributions`.
    """
    fitted, model = accepted.fit, accepted.regression.system.model
    system = fitted.regression.system
    numbered = [p for e, p in fitted.free if e == name and place_of(p)]
    # ``added`` is of all places together, so each is computed alone, with the others at neutral
    if len(numbered) < 2:
        return [finding(accepted, name, added)]
    whole = finding(accepted, name, added)
    neutral = effect_table.get(name).neutral()
    found = []
    for parameter in numbered:
        others = {p: neutral[p] for p in numbered if p != parameter}
        effects = {**system.model.effects, name: {**fitted.effects[name], **others}}
        size = size_of_contribution(contributions_of(effects, name, system, model), system)
        parameters = {parameter: whole.parameters[parameter]}
        place = place_of(parameter)
        found.append(dataclasses.replace(whole, parameters=parameters, size=size, place=place))
    return found


def declared_findings(wrong: Sequence[Contradicted], system: System) -> list[Finding]:
    """Declared numbers that the flights contradict, by the effect that corrects them; a number that
    none corrects is told in the sentence and the calibration alone.
    """
    names = dict.fromkeys(
        number.effect for number in wrong if number.effect != "vehicle" and not number.is_trim
    )
    return [_declared(name, [n for n in wrong if n.effect == name], system) for name in names]


def _declared(name: str, wrong: Sequence[Contradicted], system: System) -> Finding:
    units = {p.name: p.unit for p in effect_table.get(name).parameters}
    parameters = {
        p: Estimate(
            n.value,
            interval95(n.value, n.sd),
            units[p],
            f"correction of the vehicle file, {n.sds:.1f} times its declared sd",
        )
        for n in wrong
        for p in [n.key.split(".")[1]]
    }
    # to first order: the number's column times its correction
    terms = {system.nuisances[n.key]: n.value for n in wrong}
    added = [rows.added(terms, len(system.main)) for rows in system.flights]
    # certain by its own rule, hence as sure as any name is told to be
    found = Finding.of(name, stated(1.0), parameters, size_of_contribution(added, system))
    # the effect may be physics; what is wrong here is a number of the file
    return dataclasses.replace(found, kind="parameter")


def open_findings(accepted: Accepted) -> list[Finding]:
    """Names that the flights cannot tell apart, each as it is fitted beside what is proven; of one
    that could not be, its coefficient from the search.
    """
    return [_open(accepted, name) for name in accepted.rivals]


def _open(accepted: Accepted, name: str) -> Finding:
    fitted, inclusion = accepted.alternatives.get(name), accepted.found.inclusion
    # one of them is needed: a set that has two makes neither surer than the other lets it be
    chance = stated(inclusion[name] / max(1.0, sum(inclusion[n] for n in accepted.rivals)))
    # without a fit there is no contribution to size, only the coefficient of the search
    if fitted is None:
        return Finding.of(name, chance, _searched(accepted, name), is_open=True)
    model = accepted.regression.system.model
    added, declared = contributions(fitted, (name,), model)[name], model.effects.get(name, {})
    return Finding.of(
        name,
        chance,
        parameters_of(fitted, name, declared),
        size_of_contribution(added, fitted.regression.system),
        is_open=True,
        place=places_of(accepted, name),
    )


def _searched(accepted: Accepted, name: str) -> dict[str, Estimate]:
    """Parameters of one name as the search has them."""
    found, units = (
        accepted.found.best_with(name, accepted.rivals).posterior,
        {p.name: p.unit for p in effect_table.get(name).parameters},
    )
    told: dict[str, Estimate] = {}
    for k, mean, sd in zip(found.columns, found.mean, found.sd, strict=True):
        column = accepted.regression.system.columns[k]
        variant = variant_of(column)
        # the moment's part has a coefficient of its own, and is no parameter of the effect
        if variant.effect == name and column.part != "moment":
            a = variant.amplitudes[column.amplitude]
            value = a.neutral + float(mean)
            told[a.parameter] = Estimate(value, interval95(value, float(sd)), units[a.parameter])
    return told
