"""``diagnose``: recordings and a vehicle in, a diagnosis out; the stages in their order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ges.diagnose.decide.contradicted import contradicted_parameters, excused_effects
from ges.diagnose.decide.explanation import (
    explain_flights,
    refit_with_open_names,
    thrust_of,
    without_idle_rivals,
)
from ges.diagnose.decide.laws import FittedLaw, add_laws, rival_laws
from ges.diagnose.design.speeds import with_expected_speeds
from ges.diagnose.detectors.balance import balance_shift
from ges.diagnose.detectors.gusts import GUSTS
from ges.diagnose.detectors.thrust import movable_by_voltage
from ges.diagnose.estimate.fit import fitted_model
from ges.diagnose.locate.stages import recalibrate
from ges.diagnose.prepare.problem import Recordings, pose_problem
from ges.diagnose.prove.proof import prove
from ges.diagnose.report.compose import compose_diagnosis
from ges.diagnose.report.content import located_entries
from ges.diagnose.report.diagnosis import Diagnosis
from ges.diagnose.types.decision import DecisionLog
from ges.simulator import effects as effect_table
from ges.threads import blas_alone
from ges.vehicle.file import Vehicle

Watch = Callable[[str, Any], object]


@blas_alone
def diagnose(
    recordings: Recordings,
    vehicle: Vehicle | str | Path | None = None,
    *,
    holdout: str | Sequence[str] | None = None,
    folder: Path | str = ".",
    names: str | Sequence[str] | None = None,
    watch: Watch = lambda step, results: None,
) -> Diagnosis:
    """Find what a simulator lacks, from recorded flights.

    Results are the same to the last byte, whatever the number of cores.

    Parameters
    ----------
    recordings : a recording set, or flights as tables with the columns of
        :class:`~ges.recordings.recording.RecordingSet`. A mapping gives tables names.
        ``ges.diagnose`` also takes the path of a set, of a log, or a list of logs.
    vehicle : the vehicle, the path of its file or its name in the library. Needed for tables, and
        for a set in place of its own.
    holdout : name or names of flights that take no part in fitting or choosing. By default a hash
        of the recorded numbers chooses one flight in four, and at least one of two.
    folder : folder of the height map that ``vehicle`` names, where it is not a path.
    names : effects to fit instead of searching: what could be reached if the causes were known. A
        name that the flights cannot show is left out.
    watch : called as ``watch(step, results)`` when a step ends. Steps are ``"located"`` with the
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
    record = DecisionLog()
    names = [names] if isinstance(names, str) else names
    for name in names or ():
        effect_table.get(name)

    # what is there, and what the nominal parameters can do about it
    problem = pose_problem(recordings, vehicle, holdout, folder)
    problem = problem.with_flights(with_expected_speeds(problem.flights, problem.model))
    start, nominal = recalibrate(problem.train, problem.model), problem.model
    watch("located", start.cells)

    # what the library explains of the residuals, and what stays open or unexplained
    nominal_gusts = problem.vehicle.effect_values().get(GUSTS)
    start, explanation = explain_flights(start, nominal_gusts, record, names)
    watch("fitted", explanation.accepted.names)
    balance = None if explanation.accepted.names else balance_shift(start.system)
    explanation = without_idle_rivals(explanation, nominal, balance is not None)
    unnamed_cause = balance or (None if names else thrust_of(explanation, start.system))
    located = located_entries(start, explanation)
    explanation = refit_with_open_names(explanation, start, balance, record)
    named, rivals = explanation.last.model, {} if names else rival_laws(explanation)
    laws: list[FittedLaw] = []
    if names is None:
        explanation, laws = add_laws(explanation, start)
    movable = {*explanation.accepted.rivals, *movable_by_voltage(start.system)}
    last, excused = explanation.last, excused_effects(movable, record)
    contradicted = [] if names else contradicted_parameters(last.joint, start.system, excused)

    # how much better held-out flights are
    alternatives = explanation.accepted.alternatives.items()
    models = {
        "before": nominal,
        "recalibrated": start.first.model,
        **({"names_only": named} if laws else {}),
        "after": last.model,
    }
    proof = prove(
        problem.held_out,
        models,
        {name: fitted_model(nominal, fitted) for name, fitted in alternatives},
        located,
        start.system.length_s,
    )

    # the diagnosis
    return compose_diagnosis(
        problem,
        start,
        explanation,
        laws,
        rivals,
        models,
        proof,
        located,
        contradicted,
        unnamed_cause,
        record,
    )
