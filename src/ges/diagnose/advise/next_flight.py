"""The next flight: the manoeuvre that best separates open names."""

from __future__ import annotations

from collections.abc import Sequence

from ges.diagnose.advise.recommend import Rival, as_rivals, open_sets, rank
from ges.diagnose.decide.accept import Accepted
from ges.diagnose.design.system import FlightRows, build
from ges.diagnose.detectors.balance import Shift
from ges.diagnose.detectors.thrust import VOLTAGE, UnmeasuredThrust
from ges.diagnose.library.candidates import flight_envelope
from ges.diagnose.library.grids import library
from ges.diagnose.select.evidence import Regression, make_regression
from ges.diagnose.select.search import SearchResult
from ges.diagnose.settings import settings


def next_flight(accepted: Accepted, unnamed_cause: Shift | UnmeasuredThrust | None) -> dict:
    """Return ``next_flight`` of diagnosis.json.

    Parameters
    ----------
    accepted : names and fits of the search.
    unnamed_cause : a shifted balance or unmeasured thrust, which has a next flight of its own; None
        without one.

    Returns
    -------
    The best manoeuvre and how often to fly it. Empty where nothing is open; without a manoeuvre
    where none of the menu would do.
    """
    if isinstance(unnamed_cause, UnmeasuredThrust):
        return _with_voltage(unnamed_cause)
    if unnamed_cause:
        return unnamed_cause.next_flight()
    s = settings.statistics
    doubtful = any(
        s.possible_probability < p < s.acceptance_probability
        for p in accepted.result.inclusion.values()
    )
    if not accepted.rivals and not doubtful:
        return {}
    return separating_manoeuvre(
        accepted.regression, accepted.system.flights, accepted.result, accepted.names
    )


def separating_manoeuvre(
    regression: Regression,
    flights: Sequence[FlightRows],
    result: SearchResult,
    proven: Sequence[str],
) -> dict:
    """Return the best manoeuvre between the sets of names that are open.

    Parameters
    ----------
    regression, flights, result : of the search.
    proven : names that are accepted.
    """
    rivals = as_rivals(regression, open_sets(result, proven))
    ranked = rank(regression, flights, rivals) if len(rivals) > 1 else []
    return ranked[0].content() if ranked else {}


def _with_voltage(thrust: UnmeasuredThrust) -> dict:
    """Return the manoeuvre that separates causes of another thrust, with the voltage logged."""
    system = thrust.system
    listed = library(system.model, flight_envelope(system.recordings, system.model.radius_m))
    variants = [v for name in thrust.rivals if name in listed for v in listed[name].variants]
    regression = make_regression(build(system.recordings, system.model, variants, system))
    rivals = [
        Rival(names, effects, _columns(regression, names))
        for names, effects in thrust.explanations().items()
    ]
    ranked = rank(regression, system.flights, rivals, also_logged=(VOLTAGE,))
    if not ranked:
        return {}
    return {**ranked[0].content(), "preparation": f"the battery voltage logged ({VOLTAGE})"}


def _columns(regression: Regression, names: Sequence[str]) -> tuple[int, ...]:
    """Return columns of these effects in the regression."""
    return tuple(
        k
        for (name, _), columns in regression.by_variant().items()
        if name in names
        for k in columns
    )
