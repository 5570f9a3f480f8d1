"""``diagnose``: recordings and a vehicle in, a diagnosis out; the stages in their order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ges.diagnose.decide.declared import contradicted
from ges.diagnose.decide.laws import FittedLaw, with_laws
from ges.diagnose.decide.withdraw import explained, remaining, thrust_of, with_open_modelled
from ges.diagnose.design.speeds import with_expected_speeds
from ges.diagnose.detectors.balance import balance_shift
from ges.diagnose.detectors.gusts import GUSTS
from ges.diagnose.estimate.fit import fitted_model
from ges.diagnose.locate.stages import recalibrate
from ges.diagnose.prepare.problem import Recordings, pose_problem
from ges.diagnose.prove.proof import prove
from ges.diagnose.report.compose import compose_diagnosis
from ges.diagnose.report.content import located_entries
from ges.diagnose.types.decision import Record
from ges.diagnose.types.diagnosis import Diagnosis
from ges.simulator import effects as effect_table
from ges.threads import blas_alone
from ges.vehicle.file import Vehicle

Watch = Callable[[str, Any], object]


@blas_alone
def diagnose(
    recordings: Recordings,
    vehicle: Vehicle | None = None,
    *,
    holdout: Sequence[str] | None = None,
    folder: Path | str = ".",
    names: Sequence[str] | None = None,
    watch: Watch = lambda step, known: None,
) -> Diagnosis:
    """Find what a simulator lacks, from recorded flights.

    Results are the same to the last byte, whatever the number of cores.

    Parameters
    ----------
    recordings : a recording set, or flights as tables with the columns of
        :class:`~ges.recordings.recording.RecordingSet`. A mapping gives tables names.
    vehicle : the vehicle file; needed for tables, and for a set in place of its own.
    holdout : names of flights that take no part in fitting or choosing. By default a hash of the
        recorded numbers chooses one flight in four, and at least one of two.
    folder : folder of the height map that ``vehicle`` names.
    names : effects to fit instead of searching: what could be reached if the causes were known. A
        name that the flights cannot show is left out.
    watch : called as ``watch(step, known)`` when a step ends. Steps are ``"located"`` with the
        cells of the map of residuals, and ``"fitted"`` with the accepted names.

    Returns
    -------
    Verdict, findings, and errors on the flights held out.

    Raises
    ------
    GesError
        When the recordings cannot be used, in one sentence.
    UsageError
        When ``holdout`` or ``names`` has an unknown name.

    Notes
    -----
    The equations stand in docs/method.md, the rules of every decision in docs/reference.md.

    Examples
    --------
    Four simulated flights come with the package; rotor drag and ground effect acted on them.

    >>> from pathlib import Path
    >>> import ges
    >>> from ges.recordings.recording import load_set
    >>> example = Path(ges.__file__).parent / "recordings" / "example"
    >>> found = ges.diagnose(load_set(example))
    >>> found
    Diagnosis(physics: rotor_drag, ground_effect)
    """
    record = Record()
    for name in names or ():
        effect_table.get(name)

    # what is there, and what the declared numbers can do about it
    problem = pose_problem(recordings, vehicle, holdout, folder)
    problem = problem.with_flights(with_expected_speeds(problem.flights, problem.model))
    start = recalibrate(problem.train, problem.model)
    watch("located", start.cells)

    # what the library explains of the rest, and what stays open or unexplained
    known_gusts = problem.vehicle.effect_values().get(GUSTS)
    answer = explained(start, problem.model, known_gusts, record, names)
    watch("fitted", answer.accepted.names)
    moved = None if answer.accepted.names else balance_shift(start.system)
    answer, left = remaining(answer, problem.model, moved is not None)
    shift = moved or (None if names else thrust_of(answer, start.system))
    located = located_entries(start, answer)
    answer, left = with_open_modelled(answer, left, start, problem.model, record)
    named = answer.last.model
    laws: list[FittedLaw] = []
    if names is None:
        answer, left, laws = with_laws(answer, left, start, problem.model)
    # an open cause may move the numbers that it is confused with: those are not the file's fault
    but = {*answer.accepted.rivals, *(shift.may_move if shift else ())}
    wrong = [] if names else contradicted(answer.last.joint, start.system, but)

    # how much better held-out flights are
    alternatives = answer.accepted.alternatives.items()
    models = {
        "before": problem.model,
        "recalibrated": start.first.model,
        **({"names_only": named} if laws else {}),
        "after": answer.last.model,
    }
    proof = prove(
        problem.held_out,
        models,
        {name: fitted_model(problem.model, fitted) for name, fitted in alternatives},
        located,
        start.system.length_s,
    )

    # what is told
    return compose_diagnosis(
        problem,
        start,
        answer,
        left,
        laws,
        models,
        proof,
        located,
        wrong,
        shift,
        record,
        names is None,
    )
