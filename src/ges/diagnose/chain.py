"""``diagnose``: recordings and a vehicle in, a :class:`Diagnosis` out. Names of flights serve only to be given back."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .. import effects as effect_table
from ..errors import GesError, unknown_name
from ..io.recording import RecordingSet, make_set, require_drive
from ..threads import blas_alone
from ..vehicle import Estimate as Fitting
from ..vehicle import Quantity, Vehicle
from .answers import strengths
from .balance import centred, shift_of
from .candidates import NOT_SEARCHED, needs_of
from .closed_loop import closed_loop
from .detect import smallest_detectable
from .engine import Accepted, accept, first_system, shot_fit, split, withdrawn, without, without_old_news
from .evidence import Board
from .findings import contributions, finding, open_findings, settled_findings
from .fit import Joint, calibrated, fitted_model, left_raw, null_fit, strain_without, within_bounds
from .gate import Gate, at_flown_voltage, pass_gate
from .gusts import HANGING, PUSHED, Gusts, gusts_of, heard_by, may_lean
from .hearing import lacking, silent_channels, unheard
from .hypothesis import Form, hypotheses
from .instruments import MOVED
from .locate import BLOCK_S, cells, from_findings, from_open, from_residuals, regimes, regimes_of, strongest
from .model import Model, from_vehicle
from .recommend import next_flight
from .result import Diagnosis
from .standing import matters, relieved, strained
from .structure import Structure, Told, structures
from .system import ALL_ON, Switches, System, common_channels, window_length_s
from .unknown import borrowed, left_over, theirs
from .verdict import sentence_of, verdict_of
from .verify import channel_table, elsewhere, errors, rollout_table, rollouts
from .weak import make_windows

METRIC = (
    "rms of the weak-form residual (windowed average, nothing differentiated) on flights that took no part; reduction_ci95: "
    "share by which 'after' is below 'recalibrated', 95 % interval over blocks of 5 s"
)


@blas_alone
def diagnose(
    recordings: RecordingSet | Mapping[str, pd.DataFrame] | Sequence[pd.DataFrame],
    vehicle: Vehicle | None = None,
    *,
    holdout: Sequence[str] | None = None,
    folder: Path | str = ".",
    names: Sequence[str] | None = None,
    switches: Switches = ALL_ON,
) -> Diagnosis:
    """Find what a simulator lacks, from real flights, to the same bytes whatever the number of cores.

    Parameters
    ----------
    recordings : a recording set, or tables with contract columns (a mapping gives them names).
    vehicle : what is known of the vehicle, with doubts; taken from a recording set where there is one.
    holdout : names of flights that take no part in fitting or choosing; None lets a rule choose that does not look at them.
    folder : where a height map named by the vehicle file lies.
    names : fit exactly these effects instead of searching: what the library could reach if the cause were known.
    switches : parts of the method to leave out, for ablations.

    Raises
    ------
    GesError
        When the recordings cannot be used, in one sentence.
    """
    flights = _as_set(recordings, vehicle, folder)
    require_drive(flights)
    model = from_vehicle(flights.vehicle, flights.folder)
    labels, frames = [f.name for f in flights.flights], [f.frame for f in flights.flights]
    gate = pass_gate(frames, model, labels)
    model = at_flown_voltage(model, gate.flights)
    train, held = split(frames, gate.usable(), _numbers(holdout, labels))
    if not train:
        raise GesError("every usable flight is held out; leave at least one for fitting")
    return _Chain(flights.vehicle, model, gate, train, held, labels, flights.warnings).run(names, switches)


def _as_set(recordings, vehicle: Vehicle | None, folder: Path | str) -> RecordingSet:
    if isinstance(recordings, RecordingSet):
        return recordings if vehicle is None else make_set(vehicle, [(f.name, f.frame) for f in recordings.flights], folder)
    if vehicle is None:
        raise GesError("no vehicle given; pass one (ges.vehicle.load_vehicle) or a recording set that has one")
    named = recordings.items() if isinstance(recordings, Mapping) else [(f"flight{i}", f) for i, f in enumerate(recordings, 1)]
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
    """A model, the fit behind it, and what it leaves: residuals by flight (m, C) and the structure in them."""

    model: Model
    joint: Joint
    board: Board
    left: Sequence[np.ndarray]
    structures: list[Structure]


def _stage(model: Model, joint: Joint, board: Board, told: Told) -> _Stage:
    left = centred(left_raw(board.system, joint), board.system)
    return _Stage(model, joint, board, left, structures(left, told, board.system.main, board.system.blocks(BLOCK_S)))


class _Chain:
    """The steps in their order; every step reads what the ones before it left."""

    def __init__(self, vehicle: Vehicle, model: Model, gate: Gate, train, held, names, warnings) -> None:
        self.vehicle, self.model, self.gate, self.names = vehicle, model, gate, names
        self.train = [gate.flights[i] for i in train]
        self.held, self.held_names = [gate.flights[i] for i in held], [names[i] for i in held]
        self.warnings = [*warnings, *gate.warnings]
        self.length_s = window_length_s(self.train)

    def run(self, names: Sequence[str] | None, switches: Switches) -> Diagnosis:
        system = first_system(self.train, self.model, self.length_s, switches)
        board, joint = null_fit(system)
        recalibrated = calibrated(self.model, joint.common)
        told = regimes_of(system)
        first = _stage(recalibrated, joint, board, told)
        map_cells = cells(system, first.left, told, first.structures)
        accepted = accept(board, self.length_s, switches, names)
        if names is None:
            accepted = self._unstrained(accepted, joint, switches)
        known = (accepted.fitted.board.system, accepted.fitted.joint) if accepted.fitted else (system, joint)
        gusts = gusts_of(*known, self.length_s, self.vehicle.effect_values().get("gusts"))
        gusts = None if gusts and may_lean(gusts.push_N, contributions(accepted, HANGING), system) else gusts
        if gusts and names is None and "wind" in accepted.names and gusts.may_be(accepted.fitted):
            accepted = without(accepted, "wind", self.length_s, switches)
        accepted = shot_fit(accepted, self.length_s, switches)
        last = self._last(accepted, first, told)
        foretold = [s for s in last.structures if not gusts or s.channel not in PUSHED]
        added = contributions(accepted)
        if names is None and added and not accepted.rivals and borrowed(theirs(foretold, added, system), self.model):
            accepted, last, foretold, gusts, added = withdrawn(accepted), first, first.structures, None, {}
        moved = None if accepted.names else shift_of(system)
        accepted = dataclasses.replace(accepted, rivals=()) if moved else accepted
        remains = left_over(foretold, last.model)
        accepted = without_old_news(accepted) if self.model.left_unexplained and not remains else accepted
        located = strongest([
            *from_residuals(map_cells, first.structures, system),
            *from_findings(added, last.left, accepted.probability, told, system),
            *(from_open(accepted.found, accepted.board, last.left, told, accepted.names) if accepted.rivals else ()),
        ])  # fmt: skip
        proven = sorted((finding(accepted, name, by) for name, by in added.items()), key=lambda f: -f.size["share_of_weight"])
        proven += [gusts.finding()] if gusts else []
        proven = [f for f in proven if names or matters(f.name, f.size["channel"], f.size["share_of_weight"])]
        findings = [*proven, *settled_findings(self.gate), *open_findings(accepted), *(moved.findings() if moved else ())]
        forms = hypotheses(system, last.left, told, [u.channel for u in remains if not u.of_size], BLOCK_S) if remains else {}
        unexplained = [_unexplained(u, forms.get(u.channel)) for u in remains]
        models = {"before": self.model, "recalibrated": recalibrated, "after": last.model}
        fit, proof = self._proof(models, located)
        verdict = verdict_of(findings, (moved.rivals,) if moved else accepted.rivals, unexplained)
        calibration = _calibration(last.joint, self.model)
        off = silent_channels([*self.train, *self.held], self.model)
        told_first = sentence_of(verdict, findings, located, unexplained, fit, calibration)
        return Diagnosis(
            verdict=verdict,
            sentence=moved.sentence() if moved else told_first + (unheard(off) if verdict == "nothing_proven" else ""),
            findings=tuple(findings),
            located=tuple(located),
            unexplained=tuple(unexplained),
            fit=fit,
            detectable=smallest_detectable(accepted.board, accepted.names),
            next_flight=moved.next_flight() if moved else _next_flight(accepted),
            data=self._data(system, off),
            calibration=calibration,
            not_tested=_not_tested(system, self.train, last.model),
            vehicle=self._fitted_vehicle(accepted, last.joint, gusts),
            details={"accepted": accepted, "cells": map_cells, "models": models, "held": self.held, **proof},
        )

    def _unstrained(self, accepted: Accepted, first: Joint, switches: Switches) -> Accepted:
        """Without the names that need declared numbers far outside their doubts: one by one, the worst offender first of those
        through which no other acts, while that relieves the numbers."""
        while accepted.fitted is not None and strained(accepted.fitted.apart, first, accepted.board.system):
            last = [n for n in accepted.names if not any(n in needs_of(other) for other in accepted.names)]
            worst = min(last, key=lambda name: strain_without(accepted.fitted, name))
            less = without(accepted, worst, self.length_s, switches)
            if not relieved(accepted.fitted.apart, less.fitted.apart if less.fitted else first, accepted.board.system):
                break
            accepted = less
        return accepted

    def _last(self, accepted: Accepted, first: _Stage, told: Told) -> _Stage:
        """With the accepted effects and the nuisances set anew."""
        if accepted.fitted is None:
            return first
        return _stage(fitted_model(self.model, accepted.fitted), accepted.fitted.joint, accepted.fitted.board, told)

    def _proof(self, models: Mapping[str, Model], located: Sequence[Mapping]) -> tuple[dict, dict]:
        """Errors before, recalibrated and after on the held-out flights: for the file, and in full for the pictures."""
        if not self.held:
            return {"metric": METRIC, "holdout_flights": [], "channels": {}, "rollout": {}}, {}
        channels, spacing_s = common_channels(self.held, self.model), 0.5 * self.length_s
        windows = [make_windows(f.t_s, f.flying, self.length_s) for f in self.held]
        told = [regimes(f, w, models["after"]) for f, w in zip(self.held, windows, strict=True)]
        left, rolled = errors(self.held, models, channels, self.length_s), rollouts(self.held, models)
        fit = {
            "metric": METRIC,
            "holdout_flights": self.held_names,
            "channels": channel_table(left, channels, spacing_s),
            "elsewhere": elsewhere(left, channels, located, told, spacing_s),
            "rollout": rollout_table(rolled),
            "closed_loop": closed_loop(self.held, models, self.length_s),
        }
        proof = {"errors": left, "channels": channels, "rollouts": rolled, "length_s": self.length_s, "regimes": told}
        return fit, proof

    def _data(self, system: System, off: Mapping[str, str]) -> dict:
        used = [*self.train, *self.held]
        reasons = sorted({r for f in used for r in f.left_out})
        return {
            "flights": len(used),
            "seconds_used": float(sum(f.flying.sum() * f.dt_s for f in used)),
            "left_out": {r: float(sum(f.left_out.get(r, 0.0) for f in used)) for r in reasons},
            "channels_used": list(system.main),
            "channels_off": off,
            "delays": [
                {"stream": d.stream, "delay_s": d.delay_s, "sd_s": d.sd_s, "correlation": d.correlation} for d in self.gate.delays
            ],
            "instruments": strengths([r.vouched for r in system.flights if r.vouched and r.flight.has("reference")], system.main),
            "window_s": self.length_s,
            "warnings": self.warnings,
        }

    def _fitted_vehicle(self, accepted: Accepted, joint: Joint, gusts: Gusts | None) -> Vehicle:
        """The vehicle file with findings and corrected numbers; what belongs to a sensor or to one day's trim stays out."""
        numbers: dict[str, Any] = {}
        effects = {name: dict(values) for name, values in self.vehicle.effects.items()}
        for key, value in joint.common.items():
            name, parameter = key.split(".")
            if name == "vehicle":
                numbers[parameter] = Quantity(value=self.model.number(parameter) + value, sd=joint.common_sd[key])
            elif effect_table.get(name).kind != "sensor":
                held = effects.setdefault(name, {})
                start = held[parameter].value if parameter in held else effect_table.get(name).neutral()[parameter]
                held[parameter] = Fitting(value=within_bounds(name, parameter, start + value), sd=joint.common_sd[key])
        for name in accepted.names:
            effects.setdefault(name, {}).update(_fittings(accepted, name))
        if gusts:
            told = gusts.finding().parameters
            effects["gusts"] = {parameter: Fitting(value=e.value, ci95=e.ci95) for parameter, e in told.items()}
        return self.vehicle.model_copy(update={"effects": effects, **numbers})


def _next_flight(accepted: Accepted) -> dict:
    return next_flight(accepted.board, accepted.found, accepted.names) if _something_open(accepted) else {}


def _something_open(accepted: Accepted) -> bool:
    """Whether rivals are left that another flight could separate."""
    return bool(accepted.rivals) or any(0.1 < p < 0.9 for p in accepted.found.inclusion.values())


def _not_tested(system: System, flights, found: Model) -> dict[str, str]:
    """Candidates that these recordings cannot speak about, each with what they lack."""
    told = {}
    searched = {c.variant.effect for c in system.columns if c.variant is not None} | {"time_offset", "gyro_bias", "wind"}
    searched |= {"gusts"} if heard_by(found.effects) else set()
    for name, effect in effect_table.table().items():
        if name in searched or effect.modifies:
            continue
        told[name] = lacking(name, flights, system.model) or NOT_SEARCHED.get(name, "these flights do not excite it")
    references = any(f.has("reference") for f in flights)
    for name in sorted(MOVED & searched) if not references else ():
        told[name] = "needs the references that the controller followed, or its answers to disturbances look like this effect"
    return told


def _fittings(accepted: Accepted, name: str) -> dict[str, Fitting]:
    fitted, free = accepted.fitted, {p for e, p in accepted.fitted.free if e == name}
    told = {}
    for parameter, value in fitted.effects[name].items():
        sd = fitted.sd(name, parameter) if parameter in free else 0.0
        told[parameter] = Fitting(value=value, sd=sd, ci95=(value - 1.96 * sd, value + 1.96 * sd) if sd else None)
    return told


def _unexplained(u: Structure, form: Form | None) -> dict:
    told = {"channel": u.channel, "regime": u.bounds, "r2": u.r2, "q_value": u.q_value, "rms": u.rms, "of_size": u.of_size}
    return {**told, "hypothesis": form.content()} if form else told


def _calibration(joint: Joint, model: Model) -> dict[str, dict]:
    """What the declared numbers came to, each beside its declared doubt."""
    told = {}
    for key, value in joint.common.items():
        sd, doubt = joint.common_sd[key], model.doubts.get(key)
        told[key] = {"value": value, "ci95": [value - 1.96 * sd, value + 1.96 * sd], "declared_sd": doubt}
    return told
