"""Parts of diagnosis.json on data, calibration, and all that was not found."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.explanation import Explanation
from ges.diagnose.design.columns import variant_of
from ges.diagnose.design.feedback import instrument_strengths
from ges.diagnose.design.system import System
from ges.diagnose.detectors.gusts import GUSTS, shows_moving_air
from ges.diagnose.estimate.joint import JointFit
from ges.diagnose.library.candidates import flight_envelope, place_of
from ges.diagnose.library.grids import out_of_reach
from ges.diagnose.library.requirements import candidates_of, unmet_reference, unmet_requirement
from ges.diagnose.locate.regimes import (
    located_by_findings,
    located_by_open_names,
    located_by_residuals,
    strongest_entries,
)
from ges.diagnose.locate.stages import Start
from ges.diagnose.locate.structure import Structure
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.gate import Gate
from ges.diagnose.settings import changed_settings
from ges.diagnose.types.decision import Considered, Decision, DecisionLog
from ges.diagnose.types.finding import interval95
from ges.diagnose.types.model import Model, block_of
from ges.simulator import effects as effect_table


def located_entries(start: Start, explanation: Explanation) -> list[dict]:
    """Return ``located``: where the recalibrated model misfits, and where names act.

    Parameters
    ----------
    start : the recalibrated vehicle.
    explanation : accepted names with their contributions.
    """
    accepted, residuals = explanation.accepted, explanation.last.residuals
    entries = located_by_residuals(start.cells, start.first.structures, start.system)
    entries += located_by_findings(
        explanation.contributions, residuals, accepted.probability, start.regimes, start.system
    )
    # what is open is in no model yet, so the accepted residual still holds it
    if accepted.rivals:
        entries += located_by_open_names(
            accepted.result,
            accepted.regression.system.columns,
            accepted.system,
            residuals,
            start.regimes,
            accepted.names,
        )
    return strongest_entries(entries)


def data_used(
    flights: Sequence[Prepared],
    gate: Gate,
    system: System,
    off: Mapping[str, str],
    warnings: Sequence[str],
) -> dict:
    """Return ``data`` of diagnosis.json.

    Parameters
    ----------
    flights : that are used.
    gate : delays and offsets.
    system : of the recalibrated vehicle.
    off : channels without data, each with what to log.
    warnings : sentences for the reader.
    """
    reasons = sorted({r for f in flights for r in f.left_out})
    # without logged references there is no instrument, and no strength to report
    by_flight = [
        r.instruments for r in system.flights if r.instruments and r.flight.has("reference")
    ]
    return {
        "flights": len(flights),
        "seconds_used": float(sum(f.flying.sum() * f.dt_s for f in flights)),
        "left_out": {r: float(sum(f.left_out.get(r, 0.0) for f in flights)) for r in reasons},
        "channels_used": list(system.main),
        "channels_off": off,
        "delays": list(map(dataclasses.asdict, gate.delays)),
        "instruments": instrument_strengths(by_flight, system.main),
        "window_s": system.length_s,
        "reference_scale": {
            block_of(name): system.model.reference_scale(name) for name in system.main
        },
        "warnings": list(warnings),
        # the defaults stand in docs/settings.md
        **({"settings": changed_settings()} if changed_settings() else {}),
    }


def calibration_of(joint: JointFit, system: System, model: Model) -> dict[str, dict]:
    """Return ``calibration``: corrections of the nominal parameters with their prior sds.

    Parameters
    ----------
    joint : of the last fit, corrections counted from the vehicle file.
    system : that was fitted.
    model : of the vehicle file.

    Notes
    -----
    ``declared_sd`` is of the file, None where it has none. ``prior_sd`` is the file's or the usual
    one, with what the recording adds: commands that are held for an unknown time leave a lag
    uncertain. It is None where flights share no value.
    """
    return {
        key: {
            "value": value,
            "ci95": list(interval95(value, joint.common_sd[key])),
            "declared_sd": model.prior_sds.get(key),
            "prior_sd": system.prior_sd(key) or None,
        }
        for key, value in joint.common.items()
    }


def not_tested(system: System, fitted: Model) -> dict[str, str]:
    """Return ``not_tested``: candidates that these recordings cannot show, with what they lack.

    Parameters
    ----------
    system : of the recalibrated vehicle.
    fitted : the model with the findings.
    """
    flights, reasons = system.recordings, {}
    searched = {c.name for c in candidates_of(flights, system.model)}
    # the gate and the search for gusts cover these, though no column of theirs is searched
    searched |= {e.name for e in effect_table.table().values() if e.settled and e.kind == "sensor"}
    searched |= {GUSTS} if shows_moving_air(fitted.effects) else set()
    for name, effect in effect_table.table().items():
        # what modifies another effect is tried together with that one
        if name not in searched and not effect.modifies:
            reasons[name] = (
                unmet_requirement(name, flights, system.model)
                or effect.settled
                or out_of_reach(
                    effect, system.model, flight_envelope(flights, system.model.radius_m)
                )
                or "these flights do not excite it"
            )
    # what was named for all that has been tested
    named = fitted.effects.keys() - system.model.effects.keys()
    for name in sorted(searched - named):
        if why := unmet_reference(name, flights):
            reasons[name] = why
    return reasons


def unexplained_entries(remains: Sequence[Structure]) -> list[dict]:
    """Return ``unexplained``: structure with neither a name nor a law.

    Parameters
    ----------
    remains : structures of the last stage.
    """
    return [
        {
            "channel": u.channel,
            "regime": u.bounds,
            "r2": u.r2,
            "q_value": u.q_value,
            "rms": u.rms,
            "of_size": u.of_size,
        }
        for u in remains
    ]


def considered_candidates(
    accepted: Accepted, record: DecisionLog, reasons: Mapping[str, str]
) -> tuple[Considered, ...]:
    """Return ``considered``: every candidate with its decisions, the most probable first.

    Parameters
    ----------
    accepted : of the search.
    record : decisions by name.
    reasons : of :func:`not_tested`.
    """
    inclusion = accepted.result.inclusion
    entries = [
        Considered(name, places_of(accepted, name), inclusion.get(name), record.of(name))
        for name in dict.fromkeys((*inclusion, *record.names))
    ]
    entries += [
        Considered(name, "", None, (Decision("recorded", False, why),))
        for name, why in reasons.items()
        if name not in inclusion and name not in record.names
    ]
    return tuple(sorted(entries, key=lambda c: (-(c.probability or 0.0), c.name)))


def places_of(accepted: Accepted, name: str) -> str:
    """Return where an effect acts that may act in several places.

    Parameters
    ----------
    accepted : of the search.
    name : of the effect.

    Returns
    -------
    ``rotor 3``, as it was fitted, else by the best variant of the first search; '' for other
    effects.
    """
    fitted = accepted.alternatives.get(name, accepted.fitted)
    places = [place_of(p) for e, p in fitted.free if e == name] if fitted else []
    # a later round may have accepted it elsewhere
    if any(places):
        return " and ".join(filter(None, places))
    if name not in accepted.result.inclusion:
        return ""
    columns = accepted.regression.system.columns
    variants = (variant_of(columns[k]) for k in accepted.result.best_with(name).posterior.columns)
    return " and ".join(next(v for v in variants if v.effect == name).places)
