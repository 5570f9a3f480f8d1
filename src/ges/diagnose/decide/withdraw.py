"""What the flights as a whole take back: names that do not predict a flight, or that gusts or the
form of an unmeasured thrust curve explain.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.decide.accept import (
    Accepted,
    accept,
    shot_fit,
    with_alternatives,
    without,
)
from ges.diagnose.decide.predict import drop_unpredictive
from ges.diagnose.decide.sizes import least_size
from ges.diagnose.decide.unknown import left_over
from ges.diagnose.design.system import System
from ges.diagnose.detectors.gusts import HANGING, PUSHED, WIND, Gusts, find_gusts, load_may_push
from ges.diagnose.detectors.thrust import UnmeasuredThrust, unmeasured_thrust
from ges.diagnose.estimate.contributions import contributions, size_of_contribution
from ges.diagnose.estimate.fit import Fitted, fitted_model
from ges.diagnose.locate.stages import Stage, Start, make_stage
from ges.diagnose.locate.structure import Structure
from ges.diagnose.types.decision import Decision, Record
from ges.diagnose.types.model import Model


@dataclasses.dataclass(frozen=True)
class Explanation:
    """What the search came to.

    Attributes
    ----------
    accepted : names and fits.
    gusts : beside them, or None.
    last : the stage with both.
    structures : the structures of that which no gust makes.
    added : what every accepted effect adds, by name and flight, (m, C).
    """

    accepted: Accepted
    gusts: Gusts | None
    last: Stage
    structures: list[Structure]
    added: Mapping[str, Sequence[np.ndarray]]


def explained(
    start: Start,
    declared: Model,
    known_gusts: Mapping[str, float] | None,
    record: Record,
    only: Sequence[str] | None,
) -> Explanation:
    """What the library explains, fitted in full, and gusts in what it leaves; with ``only``, just
    these effects, whatever speaks against them.

    Parameters
    ----------
    declared : the vehicle file's model.
    known_gusts : parameters of the gusts that the vehicle file has.
    """
    accepted = accept(start.first.regression, record, only)
    if only is None:
        accepted = drop_unpredictive(accepted, record)
    gusts = _gusts(accepted, start, known_gusts)
    if gusts and only is None and WIND in accepted.names:
        decision = _more_than_gusts(gusts, accepted.fit)
        record.note(WIND, decision)
        accepted = accepted if decision.passed else without(accepted, WIND)
    answer = answer_of(shot_fit(accepted), gusts, start, declared)
    if only is not None:
        return answer
    return _not_of_a_form(answer, start, declared, record)


def answer_of(
    accepted: Accepted, gusts: Gusts | None, start: Start, declared: Model
) -> Explanation:
    """What is accepted and gusts, with what they leave and add."""
    last = start.first
    if accepted.fitted is not None:
        fitted = accepted.fitted
        model = fitted_model(declared, fitted)
        last = make_stage(model, fitted.joint, fitted.regression, start.regimes)
    structures = [s for s in last.structures if not gusts or s.channel not in PUSHED]
    added = contributions(accepted.fitted, accepted.names, start.system.model)
    return Explanation(accepted, gusts, last, structures, added)


def _gusts(accepted: Accepted, start: Start, known: Mapping[str, float] | None) -> Gusts | None:
    """Gusts beside what is accepted, where nothing hangs below that may lean to push so."""
    fitted = accepted.fitted
    gusts = find_gusts(
        *(
            (fitted.regression.system, fitted.joint)
            if fitted
            else (start.system, start.first.joint)
        ),
        known,
    )
    if not gusts:
        return None
    hanging = [name for name in accepted.names if name in HANGING]
    pulls = contributions(fitted, hanging, start.system.model)
    return None if load_may_push(gusts.force_N, pulls, start.system) else gusts


def _more_than_gusts(gusts: Gusts, fitted: Fitted) -> Decision:
    """Whether the wind of a fit is more than gusts leave in flights of finite length."""
    blown = gusts.may_explain_wind(fitted)
    because = "no more than gusts leave" if blown else "more than gusts leave"
    return Decision("more_than_gusts", not blown, because)


def _not_of_a_form(
    answer: Explanation, start: Start, declared: Model, record: Record
) -> Explanation:
    """The answer without names that may be what the form of a needed, but unmeasured thrust curve
    is wrong by.
    """
    accepted, thrust = answer.accepted, thrust_of(answer, start.system)
    if thrust is None:
        return answer
    for name, by in answer.added.items():
        if thrust.is_form_error(name, size_of_contribution(by, start.system)):
            because = "the form of the thrust curve that is needed may be wrong by as much"
            record.note(name, Decision("not_form_of_unmeasured_thrust", False, because))
            accepted = without(accepted, name)
    if accepted is answer.accepted:
        return answer
    return answer_of(accepted, answer.gusts, start, declared)


def thrust_of(answer: Explanation, system: System) -> UnmeasuredThrust | None:
    """Thrust that is far off beside all that was accepted, where nothing says why and no other
    names are open.
    """
    return None if answer.accepted.rivals else unmeasured_thrust(answer.last.joint, system)


def remaining(
    answer: Explanation, declared: Model, moved: bool
) -> tuple[Explanation, list[Structure]]:
    """The answer without rivals that a shifted balance (``moved``) makes idle, or that are needed
    beside what is proven for no more than healthy flights leave too; and the structure that is
    left.
    """
    accepted, left = answer.accepted, left_over(answer.structures, answer.last.model)
    known = declared.left_unexplained and not left
    if moved or known and accepted.names and not accepted.contested:
        accepted = dataclasses.replace(accepted, rivals=())
    return dataclasses.replace(answer, accepted=accepted), left


def with_open_modelled(
    answer: Explanation, left: list[Structure], start: Start, declared: Model, record: Record
) -> tuple[Explanation, list[Structure]]:
    """The same with all that is open modelled too, the likeliest in the last stage; nothing is open
    where one of it is a wind that the gusts leave.
    """
    if not answer.accepted.rivals:
        return answer, left
    accepted = with_alternatives(answer.accepted, record)
    wind = accepted.alternatives.get(WIND)
    if answer.gusts and wind and not (decision := _more_than_gusts(answer.gusts, wind)).passed:
        record.note(WIND, decision)
        idle = dataclasses.replace(answer.accepted, rivals=())
        return dataclasses.replace(answer, accepted=idle), left
    modelled = answer_of(accepted, answer.gusts, start, declared)
    return modelled, left_over(modelled.structures, modelled.last.model)


def practically_significant(name: str, size: Mapping, model: Model, record: Record) -> bool:
    """Decide whether a finding is above the practical significance threshold of its channel.

    Parameters
    ----------
    name : of the finding.
    size : of :func:`~ges.diagnose.estimate.contributions.size_of_contribution`.
    model : for the reference scale of the channel.
    record : gets the decision.
    """
    channel, share = size["channel"], size["share_of_weight"]
    least = least_size(name, channel, model) / model.reference_scale(channel) if channel else None
    passed = bool(channel) and share >= least
    because = f"{100.0 * share:.2g} % of the whole in {channel}" if channel else "shows nowhere"
    record.note(name, Decision("practically_significant", passed, because, share, least))
    return passed
