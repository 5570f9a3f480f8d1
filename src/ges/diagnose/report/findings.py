"""Findings: an accepted effect with its parameters, size, probability and rivals, as the contract
names them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ges.diagnose.decide.declared import Contradicted
from ges.diagnose.decide.engine import Accepted
from ges.diagnose.decide.stated import stated
from ges.diagnose.design.residual import channels, residual
from ges.diagnose.design.system import System
from ges.diagnose.estimate.fit import Fitted
from ges.diagnose.report.words import size_unit
from ges.diagnose.types.diagnosis import Estimate, Finding, interval95
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

RIVALS = 4
CONFOUNDED = 0.9
ALIKE = (
    1.0 + 1e-9
)  # what force and accelerometer show of one push differs by rounding alone: the first is told


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
        if top[0] > CONFOUNDED
        else ""
    )


def alternatives_of(accepted: Accepted, name: str) -> tuple[dict, ...]:
    """Names that could stand in its place, with the log odds against the best set that has it."""
    weighed = accepted.found.hypotheses
    having = max((h.log_evidence for h in weighed if name in h.names), default=0.0)
    best: dict[str, float] = {}
    for h in weighed:
        if name not in h.names:
            for other in set(h.names) - set(accepted.names):
                best[other] = max(best.get(other, -np.inf), h.log_evidence - having)
    ranked = sorted(best.items(), key=lambda item: (-item[1], item[0]))[:RIVALS]
    return tuple({"name": n, "log_odds": float(v)} for n, v in ranked)


def size_of(added: Sequence[np.ndarray], system: System) -> dict:
    """Rms of what one effect adds (of :func:`contributions`) where it weighs most."""
    best = {"value": 0.0, "unit": "N", "share_of_weight": 0.0, "channel": ""}
    for c, channel in enumerate(system.main):
        unit, whole = size_unit(channel), system.model.whole(channel)
        values = np.concatenate([a[:, c] for a in added])
        values = values[np.isfinite(values)]
        rms = float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
        if rms / whole > ALIKE * best["share_of_weight"]:
            best = {"value": rms, "unit": unit, "share_of_weight": rms / whole, "channel": channel}
    return best


def contributions(
    accepted: Accepted, among: Collection[str] | None = None
) -> dict[str, list[np.ndarray]]:
    """What each accepted effect (``among`` some, where given) adds on the training flights to what
    the vehicle file has of it, by name and flight, (m, C).
    """
    if accepted.fitted is None:
        return {}
    system, declared = accepted.fitted.board.system, accepted.board.system.model.effects
    told = {}
    for name in (n for n in accepted.names if among is None or n in among):
        bare = {k: v for k, v in system.model.effects.items() if k != name}
        bare |= {name: declared[name]} if name in declared else {}
        told[name] = [_added(rows, bare, system.model, system.main) for rows in system.flights]
    return told


def _added(rows, effects: Mapping, model: Model, names: tuple[str, ...]) -> np.ndarray:
    """Residual with these effects alone less residual with the model's, (m, C); NaN where a channel
    is absent.
    """
    bare = dataclasses.replace(model, effects=effects)
    here = channels(rows.flight, model)
    out = np.full((len(rows.windows), len(names)), np.nan)
    without, having = (residual(rows.flight, rows.windows, m, here) for m in (bare, model))
    out[:, [names.index(n) for n in here]] = without - having
    return np.where(np.isfinite(rows.y[:, : len(names)]), out, np.nan)


def finding(accepted: Accepted, name: str, added: Sequence[np.ndarray]) -> Finding:
    """One accepted effect; ``added`` of :func:`contributions`."""
    declared = accepted.board.system.model.effects.get(name, {})
    return Finding.of(
        name,
        stated(accepted.probability[name]),
        parameters_of(accepted.fitted, name, declared),
        size_of(added, accepted.fitted.board.system),
        alternatives_of(accepted, name),
    )


def declared_findings(wrong: Sequence[Contradicted], system: System) -> list[Finding]:
    """Declared numbers that the flights contradict, by the effect that corrects them; a number that
    none corrects is told in the sentence and the calibration alone.
    """
    names = dict.fromkeys(number.effect for number in wrong if number.effect != "vehicle")
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
    terms = {system.nuisances[n.key]: n.value for n in wrong}
    added = [rows.added(terms, len(system.main)) for rows in system.flights]
    found = Finding.of(name, stated(1.0), parameters, size_of(added, system))
    return dataclasses.replace(found, kind="parameter")


def open_findings(accepted: Accepted) -> list[Finding]:
    """Names that the flights cannot tell apart, each as it is fitted beside what is proven; of one
    that could not be, its coefficient from the search.
    """
    return [_open(accepted, name) for name in accepted.rivals]


def _open(accepted: Accepted, name: str) -> Finding:
    fitted, chance = accepted.alternatives.get(name), stated(accepted.found.inclusion[name])
    if fitted is None:
        return Finding.of(name, chance, _searched(accepted, name), is_open=True)
    added = contributions(dataclasses.replace(accepted, names=(name,), fitted=fitted))[name]
    declared = accepted.board.system.model.effects.get(name, {})
    return Finding.of(
        name,
        chance,
        parameters_of(fitted, name, declared),
        size_of(added, fitted.board.system),
        is_open=True,
    )


def _searched(accepted: Accepted, name: str) -> dict[str, Estimate]:
    """Parameters of one name as the search has them."""
    found, units = (
        accepted.found.best_with(name, accepted.rivals).posterior,
        {p.name: p.unit for p in effect_table.get(name).parameters},
    )
    told: dict[str, Estimate] = {}
    for k, mean, sd in zip(found.columns, found.mean, found.sd, strict=True):
        column = accepted.board.system.columns[k]
        if column.variant.effect == name and column.part != "moment":
            a = column.variant.amplitudes[column.amplitude]
            value = a.neutral + float(mean)
            told[a.parameter] = Estimate(value, interval95(value, float(sd)), units[a.parameter])
    return told
