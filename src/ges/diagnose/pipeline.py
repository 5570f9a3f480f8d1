"""``diagnose``: recordings and a vehicle in, a :class:`Diagnosis` out. Names of flights serve only
to be given back.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ges.diagnose.advise.detect import Found, smallest_detectable
from ges.diagnose.advise.recommend import next_flight
from ges.diagnose.decide.declared import Contradicted, contradicted
from ges.diagnose.decide.engine import (
    Accepted,
    accept,
    digest,
    first_system,
    shot_fit,
    split,
    with_alternatives,
    withdrawn,
    without,
    without_old_news,
)
from ges.diagnose.decide.standing import matters, relieved, strained
from ges.diagnose.decide.unknown import borrowed, left_over, theirs
from ges.diagnose.design.answers import strengths
from ges.diagnose.design.system import ALL_ON, Switches, System, common_channels, window_length_s
from ges.diagnose.design.weak import make_windows
from ges.diagnose.detectors.balance import Shift, centred, shift_of
from ges.diagnose.detectors.clocks import settled_findings
from ges.diagnose.detectors.gusts import (
    GUSTS,
    HANGING,
    PUSHED,
    WIND,
    Gusts,
    gusts_of,
    heard_by,
    may_lean,
)
from ges.diagnose.detectors.thrust import UntoldThrust, untold_thrust
from ges.diagnose.estimate.fit import (
    Fitted,
    Joint,
    calibrated,
    fitted_model,
    in_the_air,
    left_raw,
    null_fit,
    strain_without,
    within_bounds,
)
from ges.diagnose.estimate.recalibrate import operating_point
from ges.diagnose.library.candidates import amplitude_of, flown
from ges.diagnose.library.grids import out_of_reach
from ges.diagnose.library.requirements import lacking, silent_channels, unheard
from ges.diagnose.prepare.gate import Gate, at_flown_voltage, pass_gate
from ges.diagnose.report.findings import (
    contributions,
    declared_findings,
    finding,
    open_findings,
    size_of,
)
from ges.diagnose.report.verdict import sentence_of, verdict_of
from ges.diagnose.select.evidence import Board
from ges.diagnose.types.diagnosis import Diagnosis, Finding, interval95
from ges.diagnose.types.model import Model, from_vehicle
from ges.diagnose.validate.closed_loop import closed_loop
from ges.diagnose.validate.hypothesis import Form, hypotheses
from ges.diagnose.validate.locate import (
    BLOCK_S,
    Cell,
    cells,
    from_findings,
    from_open,
    from_residuals,
    regimes,
    regimes_of,
    strongest,
)
from ges.diagnose.validate.structure import Structure, Told, structures
from ges.diagnose.validate.verify import (
    channel_table,
    elsewhere,
    errors,
    rms_table,
    rollout_table,
    rollouts,
    worse_recalibrated,
)
from ges.errors import GesError, unknown_name
from ges.recordings.recording import RecordingSet, make_set, require_drive
from ges.simulator import effects as effect_table
from ges.threads import blas_alone
from ges.vehicle.file import Estimate as Fitting
from ges.vehicle.file import Quantity, Vehicle

METRIC = (
    "rms of the weak-form residual (windowed average, nothing differentiated) on flights that took"
    " no part; reduction_ci95: share by which 'after' is below 'recalibrated', 95 % interval over"
    " blocks of 5 s"
)

Watch = Callable[[str, Any], object]


def _unwatched(step: str, known: Any) -> None:
    """Nobody looks."""


@blas_alone
def diagnose(
    recordings: RecordingSet | Mapping[str, pd.DataFrame] | Sequence[pd.DataFrame],
    vehicle: Vehicle | None = None,
    *,
    holdout: Sequence[str] | None = None,
    folder: Path | str = ".",
    names: Sequence[str] | None = None,
    switches: Switches = ALL_ON,
    watch: Watch = _unwatched,
) -> Diagnosis:
    """Find what a simulator lacks, from real flights, to the same bytes whatever the number of
    cores.

    Parameters
    ----------
    recordings : a recording set, or tables with contract columns (a mapping gives them names).
    vehicle : what is known of the vehicle, with doubts; taken from a recording set where there is
        one.
    holdout : names of flights that take no part in fitting or choosing; None lets a rule choose
        that does not look at them.
    folder : where a height map named by the vehicle file lies.
    names : fit exactly these effects instead of searching: what the library could reach if the
        cause were known.
    switches : parts of the method to leave out, for ablations.
    watch : is called as steps end, with ``"located"`` and the cells of the location map, then
        ``"fitted"`` and the names.

    Raises
    ------
    GesError
        When the recordings cannot be used, in one sentence.
    """
    flights = _as_set(recordings, vehicle, folder)
    require_drive(flights)
    model = from_vehicle(flights.vehicle, flights.folder)
    hashed = [(digest(f.frame), f) for f in flights.flights]
    ordered = sorted(hashed, key=lambda pair: pair[0])  # neither names nor their order matter
    labels, frames = [f.name for _, f in ordered], [f.frame for _, f in ordered]
    gate = pass_gate(frames, model, labels)
    model = at_flown_voltage(model, gate.flights)
    train, held = split([d for d, _ in ordered], gate.usable(), _numbers(holdout, labels))
    if not train:
        raise GesError("every usable flight is held out; leave at least one for fitting")
    return _Chain(flights.vehicle, model, gate, train, held, labels, flights.warnings, watch).run(
        names, switches
    )


def _as_set(recordings, vehicle: Vehicle | None, folder: Path | str) -> RecordingSet:
    if isinstance(recordings, RecordingSet):
        return (
            recordings
            if vehicle is None
            else make_set(vehicle, [(f.name, f.frame) for f in recordings.flights], folder)
        )
    if vehicle is None:
        raise GesError(
            "no vehicle given; pass one (ges.vehicle.load_vehicle) or a recording set that has one"
        )
    named = (
        recordings.items()
        if isinstance(recordings, Mapping)
        else [(f"flight{i}", f) for i, f in enumerate(recordings, 1)]
    )
    return make_set(vehicle, named, folder)


def _numbers(holdout: Sequence[str] | None, names: Sequence[str]) -> list[int] | None:
    if holdout is None:
        return None
    for name in holdout:
        if name not in names:
            raise unknown_name("flight", name, names)
    return [names.index(name) for name in holdout]


@dataclasses.dataclass(frozen=True)
class _Stage:
    """A model, the fit behind it, and what it leaves: residuals by flight (m, C), those in the air,
    and their structure.
    """

    model: Model
    joint: Joint
    board: Board
    left: Sequence[np.ndarray]
    in_air: Sequence[np.ndarray]
    structures: list[Structure]


def _stage(model: Model, joint: Joint, board: Board, told: Told) -> _Stage:
    left = centred(left_raw(board.system, joint), board.system)
    in_air = in_the_air(left, board.system)
    found = structures(in_air, told, board.system.main, board.system.blocks(BLOCK_S))
    return _Stage(model, joint, board, left, in_air, found)


@dataclasses.dataclass(frozen=True)
class _Start:
    """What the declared vehicle leaves: the system, the regimes of its windows, the first stage and
    its map.
    """

    system: System
    told: Told
    first: _Stage
    cells: list[Cell]


@dataclasses.dataclass(frozen=True)
class _Answer:
    """What the search came to: what is accepted, gusts beside it, the stage with both, the
    structures of that which no gust makes, and what every accepted effect adds.
    """

    accepted: Accepted
    gusts: Gusts | None
    last: _Stage
    foretold: list[Structure]
    added: Mapping[str, Sequence[np.ndarray]]


class _Chain:
    """The steps in their order; every step reads what the ones before it left."""

    def __init__(
        self, vehicle: Vehicle, model: Model, gate: Gate, train, held, names, warnings, watch: Watch
    ) -> None:
        self.vehicle, self.model, self.gate, self.names = vehicle, model, gate, names
        self.train = [gate.flights[i] for i in train]
        self.held, self.held_names = [gate.flights[i] for i in held], [names[i] for i in held]
        self.warnings = [*warnings, *gate.warnings]
        self.length_s, self.watch = window_length_s(self.train), watch

    def run(self, names: Sequence[str] | None, switches: Switches) -> Diagnosis:
        """The steps; with ``names``, of just these effects, whatever speaks against them."""
        start = self._start(switches)
        self.watch("located", start.cells)
        answer = self._fitted(start, names, switches)
        self.watch("fitted", answer.accepted.names)
        if names is None:
            answer = self._not_of_a_form(self._not_borrowed(answer, start), start, switches)
        moved = None if answer.accepted.names else shift_of(start.system)
        answer, remains = self._remaining(answer, moved)
        shift = moved or (None if names else self._thrust(answer, start.system))
        located = self._located(start, answer)
        if answer.accepted.rivals:
            answer, remains = self._with_alternatives(answer, start, switches)
        wrong = [] if names else self._contradicted(answer, shift, start.system)
        findings = self._findings(answer, shift, wrong, names)
        unexplained = _unexplained(remains, start, answer.last)
        models = {
            "before": self.model,
            "recalibrated": start.first.model,
            "after": answer.last.model,
        }
        fit, proof = self._proof(models, located, answer.accepted.alternatives)
        calibration = _calibration(answer.last.joint, self.model)
        verdict = verdict_of(findings, wrong, unexplained)
        off = silent_channels([*self.train, *self.held], self.model)
        why_open = shift.sentence() if shift else ""
        told_first = sentence_of(
            verdict, findings, located, unexplained, fit, calibration, wrong, why_open
        )
        return Diagnosis(
            verdict=verdict,
            sentence=(
                why_open
                if moved
                else told_first + (unheard(off) if verdict == "nothing_proven" else "")
            ),
            findings=tuple(findings),
            located=tuple(located),
            unexplained=tuple(unexplained),
            fit=fit,
            detectable=smallest_detectable(answer.accepted.board, _found(answer.accepted)),
            next_flight=shift.next_flight() if shift else _next_flight(answer.accepted),
            data=self._data(start.system, off, worse_recalibrated(fit["channels"])),
            calibration=calibration,
            not_tested=_not_tested(start.system, self.train, answer.last.model),
            vehicle=self._fitted_vehicle(answer.accepted, answer.last.joint, answer.gusts),
            details={
                "accepted": answer.accepted,
                "cells": start.cells,
                "models": models,
                "held": self.held,
                **proof,
            },
        )

    def _start(self, switches: Switches) -> _Start:
        system = first_system(self.train, self.model, self.length_s, switches)
        board, joint = null_fit(system)
        moved = operating_point(board, joint)
        if moved:
            there = dataclasses.replace(calibrated(self.model, moved), moved=moved)
            system = first_system(self.train, there, self.length_s, switches)
            board, joint = null_fit(system)
        told = regimes_of(system)
        first = _stage(calibrated(self.model, joint.common), joint, board, told)
        return _Start(system, told, first, cells(system, first.in_air, told, first.structures))

    def _fitted(self, start: _Start, names: Sequence[str] | None, switches: Switches) -> _Answer:
        """What the library explains, fitted in full, and gusts in what it leaves."""
        accepted = accept(start.first.board, self.length_s, switches, names)
        if names is None:
            accepted = self._unstrained(accepted, start.first.joint, switches)
        gusts = self._gusts(accepted, start)
        if gusts and names is None and WIND in accepted.names and gusts.may_be(accepted.fitted):
            accepted = without(accepted, WIND, self.length_s, switches)
        accepted = shot_fit(accepted, self.length_s, switches)
        return self._answer(accepted, gusts, start)

    def _answer(self, accepted: Accepted, gusts: Gusts | None, start: _Start) -> _Answer:
        """What is accepted and gusts, with what they leave and add."""
        last = self._last(accepted, start.first, start.told)
        foretold = [s for s in last.structures if not gusts or s.channel not in PUSHED]
        return _Answer(accepted, gusts, last, foretold, contributions(accepted))

    def _with_alternatives(
        self, answer: _Answer, start: _Start, switches: Switches
    ) -> tuple[_Answer, list[Structure]]:
        """The answer with all that is open modelled too, the likeliest in the last stage, and the
        structure that is left.
        """
        accepted = with_alternatives(answer.accepted, self.length_s, switches)
        answer = self._answer(accepted, answer.gusts, start)
        return answer, left_over(answer.foretold, answer.last.model)

    def _gusts(self, accepted: Accepted, start: _Start) -> Gusts | None:
        """Gusts beside what is accepted, where nothing hangs below that may lean to push so."""
        fitted = accepted.fitted
        known = (fitted.board.system, fitted.joint) if fitted else (start.system, start.first.joint)
        gusts = gusts_of(*known, self.length_s, self.vehicle.effect_values().get(GUSTS))
        return (
            None
            if gusts and may_lean(gusts.push_N, contributions(accepted, HANGING), start.system)
            else gusts
        )

    def _not_borrowed(self, answer: _Answer, start: _Start) -> _Answer:
        """The answer, or none at all where its names may stand for something that is not in the
        library.
        """
        if not answer.added or answer.accepted.rivals:
            return answer
        if not borrowed(theirs(answer.foretold, answer.added, start.system), self.model):
            return answer
        return _Answer(withdrawn(answer.accepted), None, start.first, start.first.structures, {})

    def _not_of_a_form(self, answer: _Answer, start: _Start, switches: Switches) -> _Answer:
        """The answer without names that may be what the form of a needed, but untold thrust curve
        is wrong by.
        """
        accepted, thrust = answer.accepted, self._thrust(answer, start.system)
        for name, by in answer.added.items() if thrust else ():
            if thrust.is_form_error(name, size_of(by, start.system)):
                accepted = without(accepted, name, self.length_s, switches)
        return (
            answer if accepted is answer.accepted else self._answer(accepted, answer.gusts, start)
        )

    def _remaining(self, answer: _Answer, moved: Shift | None) -> tuple[_Answer, list[Structure]]:
        """The answer without rivals that a shift or old news make idle, and the structure that is
        left.
        """
        accepted, remains = answer.accepted, left_over(answer.foretold, answer.last.model)
        accepted = dataclasses.replace(accepted, rivals=()) if moved else accepted
        accepted = (
            without_old_news(accepted) if self.model.left_unexplained and not remains else accepted
        )
        return dataclasses.replace(answer, accepted=accepted), remains

    def _located(self, start: _Start, answer: _Answer) -> list[dict]:
        accepted, left = answer.accepted, answer.last.left
        return strongest(
            [
                *from_residuals(start.cells, start.first.structures, start.system),
                *from_findings(answer.added, left, accepted.probability, start.told, start.system),
                *(
                    from_open(accepted.found, accepted.board, left, start.told, accepted.names)
                    if accepted.rivals
                    else ()
                ),
            ]
        )

    def _thrust(self, answer: _Answer, system: System) -> UntoldThrust | None:
        """Thrust that is far off beside all that was accepted, where nothing says why and no other
        names are open.
        """
        return None if answer.accepted.rivals else untold_thrust(answer.last.joint, system)

    def _contradicted(
        self, answer: _Answer, shift: Shift | UntoldThrust | None, system: System
    ) -> list[Contradicted]:
        """Declared numbers beyond their doubts that no open cause may have moved."""
        rivals = (*shift.rivals, "vehicle") if isinstance(shift, UntoldThrust) else ()
        return contradicted(answer.last.joint, system, {*rivals, *answer.accepted.rivals})

    def _findings(
        self,
        answer: _Answer,
        shift: Shift | UntoldThrust | None,
        wrong: Sequence[Contradicted],
        names: Sequence[str] | None,
    ) -> list[Finding]:
        """What is proven, the largest first, what the gate settled, declared numbers that the
        flights contradict, and what is open.
        """
        accepted = answer.accepted
        proven = sorted(
            (finding(accepted, n, by) for n, by in answer.added.items()),
            key=lambda f: -f.size["share_of_weight"],
        )
        proven += [answer.gusts.finding()] if answer.gusts else []
        proven = [
            f
            for f in proven
            if names or matters(f.name, f.size["channel"], f.size["share_of_weight"])
        ]
        return [
            *proven,
            *settled_findings(self.gate),
            *declared_findings(wrong, answer.last.board.system),
            *open_findings(accepted),
            *(shift.findings() if shift else ()),
        ]

    def _unstrained(self, accepted: Accepted, first: Joint, switches: Switches) -> Accepted:
        """Without the names that need declared numbers far outside their doubts: one by one, the
        worst offender first of those through which no other acts, while that relieves the numbers.
        """
        while accepted.fitted is not None and strained(
            accepted.fitted.apart, first, accepted.board.system
        ):
            last = [
                n
                for n in accepted.names
                if not any(n in effect_table.get(o).carriers for o in accepted.names)
            ]
            worst = min(last, key=lambda name: strain_without(accepted.fitted, name))
            less = without(accepted, worst, self.length_s, switches)
            if not relieved(
                accepted.fitted.apart,
                less.fitted.apart if less.fitted else first,
                accepted.board.system,
            ):
                break
            accepted = less
        return accepted

    def _last(self, accepted: Accepted, first: _Stage, told: Told) -> _Stage:
        """With the accepted effects and the nuisances set anew."""
        if accepted.fitted is None:
            return first
        return _stage(
            fitted_model(self.model, accepted.fitted),
            accepted.fitted.joint,
            accepted.fitted.board,
            told,
        )

    def _proof(
        self,
        models: Mapping[str, Model],
        located: Sequence[Mapping],
        alternatives: Mapping[str, Fitted],
    ) -> tuple[dict, dict]:
        """Errors before, recalibrated and after on the held-out flights: for the file, and in full
        for the pictures.
        """
        if not self.held:
            return {"metric": METRIC, "holdout_flights": [], "channels": {}, "rollout": {}}, {}
        channels, spacing_s = common_channels(self.held, self.model), 0.5 * self.length_s
        windows = [make_windows(f.t_s, f.flying, self.length_s) for f in self.held]
        told = [regimes(f, w, models["after"]) for f, w in zip(self.held, windows, strict=True)]
        left, rolled = (
            errors(self.held, models, channels, self.length_s),
            rollouts(self.held, models),
        )
        fit = {
            "metric": METRIC,
            "holdout_flights": self.held_names,
            "channels": channel_table(left, channels, spacing_s),
            "alternatives": self._with_each(alternatives, channels),
            "elsewhere": elsewhere(left, channels, located, told, spacing_s),
            "rollout": rollout_table(rolled),
            "closed_loop": closed_loop(self.held, models, self.length_s),
        }
        proof = {
            "errors": left,
            "channels": channels,
            "rollouts": rolled,
            "length_s": self.length_s,
            "regimes": told,
        }
        return fit, proof

    def _with_each(
        self, alternatives: Mapping[str, Fitted], channels: Sequence[str]
    ) -> dict[str, dict[str, float]]:
        """Rms on the held-out flights by channel, with each of the names that are open."""
        models = {name: fitted_model(self.model, fitted) for name, fitted in alternatives.items()}
        return {
            name: rms_table(left, channels)
            for name, left in errors(self.held, models, channels, self.length_s).items()
        }

    def _data(self, system: System, off: Mapping[str, str], noticed: Sequence[str]) -> dict:
        used = [*self.train, *self.held]
        reasons = sorted({r for f in used for r in f.left_out})
        return {
            "flights": len(used),
            "seconds_used": float(sum(f.flying.sum() * f.dt_s for f in used)),
            "left_out": {r: float(sum(f.left_out.get(r, 0.0) for f in used)) for r in reasons},
            "channels_used": list(system.main),
            "channels_off": off,
            "delays": [
                {
                    "stream": d.stream,
                    "delay_s": d.delay_s,
                    "sd_s": d.sd_s,
                    "correlation": d.correlation,
                }
                for d in self.gate.delays
            ],
            "instruments": strengths(
                [r.vouched for r in system.flights if r.vouched and r.flight.has("reference")],
                system.main,
            ),
            "window_s": self.length_s,
            "warnings": [*self.warnings, *noticed],
        }

    def _fitted_vehicle(self, accepted: Accepted, joint: Joint, gusts: Gusts | None) -> Vehicle:
        """The vehicle file with findings and corrected numbers; what belongs to a sensor or to one
        day's trim stays out.
        """
        numbers: dict[str, Any] = {}
        effects = {name: dict(values) for name, values in self.vehicle.effects.items()}
        for key, value in joint.common.items():
            name, parameter = key.split(".")
            if name == "vehicle":
                numbers[parameter] = Quantity(
                    value=self.model.number(parameter) + value, sd=joint.common_sd[key]
                )
            elif effect_table.get(name).kind != "sensor":
                held = effects.setdefault(name, {})
                start = (
                    held[parameter].value
                    if parameter in held
                    else effect_table.get(name).neutral()[parameter]
                )
                held[parameter] = Fitting(
                    value=within_bounds(name, parameter, start + value), sd=joint.common_sd[key]
                )
        for name in accepted.modelled:
            effects.setdefault(name, {}).update(_fittings(accepted, name))
        if gusts:
            told = gusts.finding().parameters
            effects[GUSTS] = {
                parameter: Fitting(value=e.value, ci95=e.ci95) for parameter, e in told.items()
            }
        return self.vehicle.model_copy(update={"effects": effects, **numbers})


def _found(accepted: Accepted) -> dict[str, Found]:
    """What was accepted, as the limits of what can be seen are held against it."""
    if accepted.fitted is None:
        return {}
    columns = accepted.board.system.columns
    chosen = accepted.found.best.posterior.columns if accepted.found.best.posterior else ()
    variants = {v.effect: v for v in (columns[k].variant for k in chosen)}
    return {
        name: Found(
            variants.get(name),
            {
                p: abs(accepted.fitted.effects[name][p] - amplitude_of(name, p).neutral)
                for e, p in accepted.fitted.free
                if e == name
            },
        )
        for name in accepted.names
    }


def _next_flight(accepted: Accepted) -> dict:
    return (
        next_flight(accepted.board, accepted.found, accepted.names)
        if _something_open(accepted)
        else {}
    )


def _something_open(accepted: Accepted) -> bool:
    """Whether rivals are left that another flight could separate."""
    return bool(accepted.rivals) or any(0.1 < p < 0.9 for p in accepted.found.inclusion.values())


def _not_tested(system: System, flights, found: Model) -> dict[str, str]:
    """Candidates that these recordings cannot speak about, each with what they lack."""
    told = {}
    searched = {c.variant.effect for c in system.columns if c.variant is not None}
    searched |= {e.name for e in effect_table.table().values() if e.settled and e.kind == "sensor"}
    searched |= {GUSTS} if heard_by(found.effects) else set()
    for name, effect in effect_table.table().items():
        if name in searched or effect.modifies:
            continue
        told[name] = (
            lacking(name, flights, system.model)
            or effect.settled
            or out_of_reach(effect, system.model, flown(flights))
            or "these flights do not excite it"
        )
    references = any(f.has("reference") for f in flights)
    moved = {n for n in searched if effect_table.get(n).feedback == "dynamic"}
    for name in sorted(moved) if not references else ():
        told[name] = (
            "needs the references that the controller followed, or its answers to disturbances look"
            " like this effect"
        )
    return told


def _fittings(accepted: Accepted, name: str) -> dict[str, Fitting]:
    fitted, free = accepted.fitted, {p for e, p in accepted.fitted.free if e == name}
    told = {}
    for parameter, value in fitted.effects[name].items():
        sd = fitted.sd(name, parameter) if parameter in free else 0.0
        told[parameter] = Fitting(value=value, sd=sd, ci95=interval95(value, sd) if sd else None)
    return told


def _unexplained(remains: Sequence[Structure], start: _Start, last: _Stage) -> list[dict]:
    """Structure that is left, each with a sparse form of it as a hypothesis where it is one of the
    mean.
    """
    by_mean = [u.channel for u in remains if not u.of_size]
    forms = hypotheses(start.system, last.in_air, start.told, by_mean, BLOCK_S) if remains else {}
    return [_structure_told(u, forms.get(u.channel)) for u in remains]


def _structure_told(u: Structure, form: Form | None) -> dict:
    told = {
        "channel": u.channel,
        "regime": u.bounds,
        "r2": u.r2,
        "q_value": u.q_value,
        "rms": u.rms,
        "of_size": u.of_size,
    }
    return {**told, "hypothesis": form.content()} if form else told


def _calibration(joint: Joint, model: Model) -> dict[str, dict]:
    """What the declared numbers came to, each beside its declared doubt."""
    told = {}
    for key, value in joint.common.items():
        sd, doubt = joint.common_sd[key], model.doubts.get(key)
        told[key] = {"value": value, "ci95": list(interval95(value, sd)), "declared_sd": doubt}
    return told
