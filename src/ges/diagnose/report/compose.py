"""What is told of a diagnosis, from what every stage hands over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ges.diagnose.advise.detect import smallest_detectable
from ges.diagnose.advise.next_flight import next_flight
from ges.diagnose.decide.declared import Contradicted
from ges.diagnose.decide.laws import FittedLaw
from ges.diagnose.decide.withdraw import Explanation
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.thrust import UnmeasuredThrust
from ges.diagnose.library.requirements import silent_channels
from ges.diagnose.locate.stages import Start
from ges.diagnose.locate.structure import Structure
from ges.diagnose.prepare.problem import Problem
from ges.diagnose.prove.proof import Proof
from ges.diagnose.prove.verify import recalibration_warnings
from ges.diagnose.report.content import (
    calibration_of,
    considered,
    data_used,
    not_tested,
    unexplained_by,
)
from ges.diagnose.report.findings import all_findings, found_sizes
from ges.diagnose.report.laws import laws_content
from ges.diagnose.report.origin import origin_of
from ges.diagnose.report.per_speed import with_force_per_speed
from ges.diagnose.report.sentence import with_sentence
from ges.diagnose.report.vehicle import fitted_vehicle
from ges.diagnose.report.verdict import remark_of, verdict_of
from ges.diagnose.report.workings import Workings
from ges.diagnose.types.decision import Record
from ges.diagnose.types.diagnosis import Diagnosis
from ges.diagnose.types.model import Model


def composed(
    problem: Problem,
    start: Start,
    answer: Explanation,
    left: Sequence[Structure],
    laws: Sequence[FittedLaw],
    models: Mapping[str, Model],
    proof: Proof,
    located: Sequence[dict],
    wrong: Sequence[Contradicted],
    shift: Shift | UnmeasuredThrust | None,
    record: Record,
    searched: bool,
) -> Diagnosis:
    """Put together what is told.

    Parameters
    ----------
    problem, start, answer, proof : what the stages found: prepared flights, the recalibrated model,
        the accepted names, errors on held-out flights.
    left : structure that the accepted model leaves.
    laws : what was found in flights beside the names.
    models : before, recalibrated and after, with laws also names_only.
    located : where the mismatch lives, as it is told.
    wrong : declared numbers that the flights contradict.
    shift : a shifted trim or an unmeasured thrust, None where there is none.
    record : decisions on every name.
    searched : False where the names were given.
    """
    findings = all_findings(answer, wrong, shift, problem.gate, record, searched)
    # asked of the model with all findings, as one may act through another
    findings = with_force_per_speed(findings, answer.last.model)
    unexplained = unexplained_by(left)
    calibration = calibration_of(answer.last.joint, problem.model)
    off = silent_channels(problem.flights, problem.model)
    untested = not_tested(start.system, answer.last.model)
    warnings = [*problem.warnings, *recalibration_warnings(proof.fit["channels"])]
    verdict = verdict_of(findings, wrong, laws, unexplained)
    diagnosis = Diagnosis(
        verdict=verdict,
        remark=remark_of(verdict, wrong, shift, off),
        origin=origin_of(problem),
        findings=tuple(findings),
        located=tuple(located),
        laws=tuple(laws_content(laws)),
        unexplained=tuple(unexplained),
        fit=proof.fit,
        detectable=smallest_detectable(answer.accepted.regression, found_sizes(answer.accepted)),
        next_flight=next_flight(answer.accepted, shift),
        data=data_used(problem.flights, problem.gate, start.system, off, warnings),
        calibration=calibration,
        not_tested=untested,
        considered=considered(answer.accepted, record, untested),
        vehicle=fitted_vehicle(
            problem.vehicle, problem.model, answer.accepted, answer.last.joint, answer.gusts, laws
        ),
        workings=Workings(
            problem, answer.accepted, start.cells, models, proof, start.system.length_s
        ),
    )
    # last, as it reads all that is told
    return with_sentence(diagnosis)
