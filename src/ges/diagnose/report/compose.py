"""The diagnosis put together from the results of all stages."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from ges.diagnose.advise.detect import smallest_detectable
from ges.diagnose.advise.next_flight import next_flight
from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.contradicted import Contradicted
from ges.diagnose.decide.explanation import Explanation
from ges.diagnose.decide.laws import FittedLaw
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.thrust import UnmeasuredThrust
from ges.diagnose.library.requirements import silent_channels
from ges.diagnose.locate.laws import RivalLaw
from ges.diagnose.locate.regimes import Cell
from ges.diagnose.locate.stages import Start
from ges.diagnose.prepare.problem import Problem
from ges.diagnose.prove.proof import Proof
from ges.diagnose.prove.verify import recalibration_warnings
from ges.diagnose.report.content import (
    calibration_of,
    considered_candidates,
    data_used,
    not_tested,
    unexplained_entries,
)
from ges.diagnose.report.diagnosis import Diagnosis
from ges.diagnose.report.findings import all_findings, detected_effects
from ges.diagnose.report.laws import laws_content, with_rival_laws
from ges.diagnose.report.origin import origin_of
from ges.diagnose.report.per_speed import with_force_per_speed
from ges.diagnose.report.sentence import sentence_of
from ges.diagnose.report.vehicle import fitted_vehicle
from ges.diagnose.report.verdict import remark_of, verdict_of
from ges.diagnose.types.decision import DecisionLog
from ges.diagnose.types.model import Model


@dataclasses.dataclass(frozen=True)
class Workings:
    """Intermediate results of a diagnosis.

    Attributes
    ----------
    problem : the data.
    accepted : names and fits.
    cells : map of the residuals of the recalibrated vehicle.
    models : by stage.
    proof : errors on held-out flights.
    length_s : support of the test functions.
    """

    problem: Problem
    accepted: Accepted
    cells: Sequence[Cell]
    models: Mapping[str, Model]
    proof: Proof
    length_s: float


def compose_diagnosis(
    problem: Problem,
    start: Start,
    explanation: Explanation,
    laws: Sequence[FittedLaw],
    rivals: Mapping[str, RivalLaw],
    models: Mapping[str, Model],
    proof: Proof,
    located: Sequence[dict],
    contradicted: Sequence[Contradicted],
    unnamed_cause: Shift | UnmeasuredThrust | None,
    record: DecisionLog,
) -> Diagnosis:
    """Put the diagnosis together.

    Parameters
    ----------
    problem, start, explanation, proof : results of the stages: prepared flights, the recalibrated
        model, the accepted names, errors on held-out flights.
    laws : found besides the names.
    rivals : law that could stand in the place of each name.
    models : before, recalibrated and after, with laws also names_only.
    located : entries of ``located``.
    contradicted : nominal parameters that the flights contradict.
    unnamed_cause : a shifted balance or an unmeasured thrust; None where there is none.
    record : decisions on every name.
    """
    accepted, last = explanation.accepted, explanation.last
    findings = all_findings(explanation, problem.model, contradicted, unnamed_cause, problem.gate)
    # asked of the model with all findings, as one may act through another
    findings = with_force_per_speed(with_rival_laws(findings, rivals), last.model)
    unexplained = unexplained_entries(explanation.unexplained)
    off = silent_channels(problem.flights, problem.model)
    untested = not_tested(start.system, last.model)
    warnings = [
        *problem.warnings,
        *recalibration_warnings(proof.fit["channels"], problem.model),
        *proof.warnings,
    ]
    verdict = verdict_of(findings, contradicted, laws, unexplained)
    diagnosis = Diagnosis(
        verdict=verdict,
        remark=remark_of(verdict, contradicted, unnamed_cause, off),
        origin=origin_of(problem),
        findings=tuple(findings),
        located=tuple(located),
        laws=tuple(laws_content(laws)),
        unexplained=tuple(unexplained),
        fit=proof.fit,
        detectable=smallest_detectable(accepted.regression, detected_effects(accepted)),
        next_flight=next_flight(accepted, unnamed_cause),
        data=data_used(problem.flights, problem.gate, start.system, off, warnings),
        calibration=calibration_of(last.joint, last.regression.system, problem.model),
        not_tested=untested,
        considered=considered_candidates(accepted, record, untested),
        vehicle=fitted_vehicle(
            problem.vehicle, problem.model, accepted, last.joint, explanation.gusts, laws
        ),
        workings=Workings(problem, accepted, start.cells, models, proof, start.system.length_s),
    )
    # last, as it reads all that is reported
    return dataclasses.replace(diagnosis, sentence=sentence_of(diagnosis.content()))
