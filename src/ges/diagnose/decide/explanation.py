"""Accepted names with gusts and structure on the flights as a whole, and what is open besides."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.decide.accept import (
    Accepted,
    accept,
    confirm_along_rollouts,
    fit_along_rollouts,
    fit_alternatives,
    fit_causes,
)
from ges.diagnose.decide.rules import parameters_at_bounds, practically_significant
from ges.diagnose.design.system import System
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.gusts import HANGING, PUSHED, Gusts, find_gusts, load_may_push
from ges.diagnose.detectors.thrust import UnmeasuredThrust, unmeasured_thrust
from ges.diagnose.estimate.contributions import contributions
from ges.diagnose.estimate.fit import fitted_model, with_levers
from ges.diagnose.locate.regimes import unexplained_structures
from ges.diagnose.locate.stages import Stage, Start, far_corrections, make_stage, relinearise
from ges.diagnose.locate.structure import Structure
from ges.diagnose.prepare.channels import least_rms_in
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Decision, DecisionLog
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Explanation:
    """Accepted names with gusts, and the residual structure of their model.

    Attributes
    ----------
    accepted : names and fits.
    gusts : found besides them, or None.
    last : the stage with both.
    structures : residual structures that no gust makes.
    contributions : of every accepted effect, by name and flight, (m, C) in the channels' units.
    """

    accepted: Accepted
    gusts: Gusts | None
    last: Stage
    structures: list[Structure]
    contributions: Mapping[str, Sequence[np.ndarray]]

    @functools.cached_property
    def unexplained(self) -> list[Structure]:
        """The structures that no name explains."""
        return unexplained_structures(self.structures, self.last.model)


def explain_flights(
    start: Start,
    nominal_gusts: Mapping[str, float] | None,
    record: DecisionLog,
    only: Sequence[str] | None,
) -> tuple[Start, Explanation]:
    """Accept what the library explains, fit it in full, and find gusts in the residuals.

    Parameters
    ----------
    start : the recalibrated vehicle.
    nominal_gusts : parameters of the gusts that the vehicle file has.
    record : takes every decision.
    only : fit exactly these names, whatever speaks against them.

    Returns
    -------
    The start, linearised where the nominal parameters are with the accepted names, and the
    explanation.
    """
    accepted = accept(start.system, record, only)
    if accepted.fitted is not None and only is None:
        start, accepted = _accept_where_numbers_are(start, accepted, record)
    gusts = _gusts(accepted, start, nominal_gusts)
    if gusts and accepted.fitted is not None and only is None:
        start, accepted, gusts = _accept_in_gusts(start, accepted, gusts, nominal_gusts, record)
    refined = (
        confirm_along_rollouts(accepted, start.nominal, start.first.model, record)
        if only is None
        else fit_along_rollouts(accepted)
    )
    if refined.fitted is not None:
        # decided on with moments of their own; what is told flies with a lever
        fitted = with_levers(refined.fitted, refined.system)
        refined = dataclasses.replace(refined, fitted=fitted)
    return start, explanation_of(refined, gusts, start)


def _accept_where_numbers_are(
    start: Start, accepted: Accepted, record: DecisionLog
) -> tuple[Start, Accepted]:
    """Search again where the strongest name puts the nominal parameters, if that is far.

    Both arguments come back where they are not, or where what is accepted there leads elsewhere.
    """
    # of what carries most evidence alone: what stands beside it may only make up for the place
    singles = (h for h in accepted.result.hypotheses if len(h.names) == 1)
    strongest = next((h.names[0] for h in singles if h.names[0] in accepted.names), None)
    effects = {n: v for n, v in accepted.fit.effects.items() if n == strongest}
    moved = relinearise(start, effects)
    if moved is None:
        return start, accepted
    decisions = DecisionLog()
    again = accept(moved.system, decisions)
    fitted = again.fitted
    # what is accepted there has to lead there, too, or to be the number that moved
    leads_there = (fitted and fitted.corrects_vehicle(moved.system)) or far_corrections(
        start, fitted.effects if fitted else {}
    )
    if not leads_there:
        return start, accepted
    record.become(decisions)
    # without names the recalibrated vehicle is what there is
    return (moved if fitted else start), again


def _accept_in_gusts(
    start: Start,
    accepted: Accepted,
    gusts: Gusts,
    nominal_gusts: Mapping[str, float] | None,
    record: DecisionLog,
) -> tuple[Start, Accepted, Gusts]:
    """Search again with a mean wind of each flight, as large as the gusts make it.

    Where no drag is accepted with them, all comes back as it was.
    """
    blown = start.linearised_about(gusts.blow_in(start.system.model, accepted.fit.effects))
    decisions = DecisionLog()
    again = accept(blown.system, decisions)
    still = _gusts(again, start, nominal_gusts)
    if not still:
        # gusts act through a drag: it stands, however little of it mean winds leave certain
        kept = [name for name in accepted.names if not effect_table.get(name).moves_air]
        again = accept(blown.system, decisions, kept)
        still = _gusts(again, start, nominal_gusts)
    if not still:
        return start, accepted, gusts
    record.become(decisions)
    return blown, again, still


def explanation_of(accepted: Accepted, gusts: Gusts | None, start: Start) -> Explanation:
    """Return the explanation of accepted names and gusts, with residuals and contributions.

    Parameters
    ----------
    accepted : names and fits.
    gusts : that were found, or None.
    start : the recalibrated vehicle.
    """
    last = start.first
    if accepted.fitted is not None:
        fitted = accepted.fitted
        model = fitted_model(start.nominal, fitted)
        last = make_stage(model, fitted.joint, fitted.regression, start.regimes)
    structures = [s for s in last.structures if not gusts or s.channel not in PUSHED]
    contributions_by_name = contributions(accepted.fitted, accepted.names, start.nominal)
    return Explanation(accepted, gusts, last, structures, contributions_by_name)


def _gusts(
    accepted: Accepted, start: Start, nominal_gusts: Mapping[str, float] | None
) -> Gusts | None:
    """Return gusts that matter in the residuals, where no suspended load may make them."""
    fitted = accepted.fitted
    system = fitted.regression.system if fitted else start.system
    joint = fitted.joint if fitted else start.first.joint
    gusts = find_gusts(system, joint, nominal_gusts)
    if not gusts or gusts.force_N < least_rms_in("force_x", start.system.model):
        return None
    hanging = [name for name in accepted.names if name in HANGING]
    pulls = contributions(fitted, hanging, start.system.model)
    return None if load_may_push(gusts.force_N, pulls, start.system) else gusts


def thrust_of(explanation: Explanation, system: System) -> UnmeasuredThrust | None:
    """Return an unmeasured thrust besides all that was accepted.

    Parameters
    ----------
    explanation : accepted names with their fit.
    system : of the recalibrated vehicle.

    Returns
    -------
    None where other names are open, or its cause is measured.
    """
    if explanation.accepted.rivals:
        return None
    return unmeasured_thrust(explanation.last.joint, system, explanation.accepted.names)


def without_idle_rivals(
    explanation: Explanation, nominal: Model, balance_shifted: bool
) -> Explanation:
    """Drop rivals that nothing asks for.

    Parameters
    ----------
    explanation : accepted names with their fit.
    nominal : the vehicle file's model.
    balance_shifted : whether a shifted balance explains the same.

    Notes
    -----
    Rivals are also dropped if only healthy flights' structure asks for them besides accepted names.
    """
    accepted = explanation.accepted
    shown_when_calibrated = nominal.left_unexplained and not explanation.unexplained
    if balance_shifted or shown_when_calibrated and accepted.names and not accepted.contested:
        accepted = dataclasses.replace(accepted, rivals=())
    return dataclasses.replace(explanation, accepted=accepted)


def refit_with_open_names(
    explanation: Explanation, start: Start, balance: Shift | None, record: DecisionLog
) -> Explanation:
    """Refit with each open name or cause; the most probable becomes part of the last stage.

    Parameters
    ----------
    explanation : accepted names with their fit.
    start : the recalibrated vehicle.
    balance : a shifted balance, whose causes are open; None where there is none.
    record : takes every decision.

    Returns
    -------
    The explanation, without open names that stand at a bound in their full fit, or make less than
    what matters there. Of the others the likeliest is modelled, where it is possible at all.
    """
    if balance:
        accepted = fit_causes(explanation.accepted, balance.effects())
    elif explanation.accepted.rivals:
        accepted = fit_alternatives(explanation.accepted, record)
        # the most probable stand first
        fits = {
            n: f for n, f in accepted.alternatives.items() if _matters(accepted, n, start, record)
        }
        idle = [n for n in accepted.alternatives if n not in fits]
        for name in idle:
            because = "at a bound, or makes less than what matters, in its full fit"
            record.note(name, Decision("open", False, because))
        if not fits:
            without = explanation.accepted.without_rivals()
            return dataclasses.replace(explanation, accepted=without)
        rivals = tuple(n for n in accepted.rivals if n not in idle)
        accepted = dataclasses.replace(accepted, rivals=rivals, alternatives=fits)
        # flights ask for more than what stands at a bound can be: it would not fly as they did
        likeliest = next(iter(fits))
        if accepted.result.inclusion[likeliest] >= settings.statistics.possible_probability:
            accepted = dataclasses.replace(accepted, fitted=fits[likeliest])
    else:
        return explanation
    return explanation_of(accepted, explanation.gusts, start)


def _matters(accepted: Accepted, name: str, start: Start, record: DecisionLog) -> bool:
    """Return whether an open name makes what matters, and is off its bounds."""
    fitted = accepted.alternatives[name]
    if any(effect == name for effect, _ in parameters_at_bounds(fitted)):
        return False
    models = start.nominal, start.first.model
    (decision,) = practically_significant(fitted, (name,), *models).values()
    record.note(name, decision)
    return decision.passed
