"""``diagnose``: recordings and a vehicle in, a diagnosis out; the stages in their order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ges.diagnose.advise.detect import smallest_detectable
from ges.diagnose.advise.next_flight import next_flight
from ges.diagnose.decide.declared import contradicted
from ges.diagnose.decide.withdraw import explained, remaining, thrust_of, with_open_modelled
from ges.diagnose.detectors.balance import shift_of
from ges.diagnose.detectors.gusts import GUSTS
from ges.diagnose.estimate.fit import fitted_model
from ges.diagnose.library.requirements import silent_channels
from ges.diagnose.prepare.problem import pose_problem
from ges.diagnose.report.content import (
    calibration_of,
    considered,
    data_used,
    located_by,
    not_tested,
    unexplained_by,
)
from ges.diagnose.report.findings import all_findings, found_sizes
from ges.diagnose.report.origin import origin_of
from ges.diagnose.report.per_speed import with_force_per_speed
from ges.diagnose.report.sentence import with_sentence
from ges.diagnose.report.vehicle import fitted_vehicle
from ges.diagnose.report.verdict import remark_of, verdict_of
from ges.diagnose.report.workings import Workings
from ges.diagnose.types.decision import Record
from ges.diagnose.types.diagnosis import Diagnosis
from ges.diagnose.validate.proof import prove
from ges.diagnose.validate.stages import recalibrated
from ges.diagnose.validate.verify import worse_recalibrated
from ges.recordings.recording import RecordingSet
from ges.threads import blas_alone
from ges.vehicle.file import Vehicle

Watch = Callable[[str, Any], object]


@blas_alone
def diagnose(
    recordings: RecordingSet | Mapping[str, pd.DataFrame] | Sequence[pd.DataFrame],
    vehicle: Vehicle | None = None,
    *,
    holdout: Sequence[str] | None = None,
    folder: Path | str = ".",
    names: Sequence[str] | None = None,
    watch: Watch = lambda step, known: None,
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
    watch : is called as steps end, with ``"located"`` and the cells of the location map, then
        ``"fitted"`` and the names.

    Raises
    ------
    GesError
        When the recordings cannot be used, in one sentence.
    """
    record = Record()

    # what is there, and what the declared numbers can do about it
    problem = pose_problem(recordings, vehicle, holdout, folder)
    start = recalibrated(problem.train, problem.model)
    watch("located", start.cells)

    # what the library explains of the rest, and what stays open or unexplained
    known_gusts = problem.vehicle.effect_values().get(GUSTS)
    answer = explained(start, problem.model, known_gusts, record, names)
    watch("fitted", answer.accepted.names)
    moved = None if answer.accepted.names else shift_of(start.system)
    answer, left = remaining(answer, problem.model, moved is not None)
    shift = moved or (None if names else thrust_of(answer, start.system))
    located = located_by(start, answer)
    answer, left = with_open_modelled(answer, left, start, problem.model, record)
    but = {*answer.accepted.rivals, *(shift.may_move if shift else ())}
    wrong = [] if names else contradicted(answer.last.joint, start.system, but)

    # how much better held-out flights are, and what could not be seen
    alternatives = answer.accepted.alternatives.items()
    models = {
        "before": problem.model,
        "recalibrated": start.first.model,
        "after": answer.last.model,
    }
    proof = prove(
        problem.held,
        models,
        {name: fitted_model(problem.model, fitted) for name, fitted in alternatives},
        located,
        start.system.length_s,
    )
    findings = all_findings(answer, wrong, shift, problem.gate, record, names is None)
    findings = with_force_per_speed(findings, answer.last.model)
    unexplained = unexplained_by(left, start, answer.last)
    calibration = calibration_of(answer.last.joint, problem.model)
    off = silent_channels(problem.flights, problem.model)
    untested = not_tested(start.system, answer.last.model)
    warnings = [*problem.warnings, *worse_recalibrated(proof.fit["channels"])]
    verdict = verdict_of(findings, wrong, unexplained)
    diagnosis = Diagnosis(
        verdict=verdict,
        remark=remark_of(verdict, wrong, shift, off),
        origin=origin_of(problem),
        findings=tuple(findings),
        located=tuple(located),
        unexplained=tuple(unexplained),
        fit=proof.fit,
        detectable=smallest_detectable(answer.accepted.board, found_sizes(answer.accepted)),
        next_flight=next_flight(answer.accepted, shift),
        data=data_used(problem.flights, problem.gate, start.system, off, warnings),
        calibration=calibration,
        not_tested=untested,
        considered=considered(answer.accepted, record, untested),
        vehicle=fitted_vehicle(
            problem.vehicle, problem.model, answer.accepted, answer.last.joint, answer.gusts
        ),
        workings=Workings(
            problem, answer.accepted, start.cells, models, proof, start.system.length_s
        ),
    )
    return with_sentence(diagnosis)
