"""Parts of diagnosis.json that sum up what was there: data, calibration, what was not tested, what
stays unexplained, what was considered.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.withdraw import Explanation
from ges.diagnose.design.answers import strengths
from ges.diagnose.design.system import System, variant_of
from ges.diagnose.detectors.gusts import GUSTS, shows_moving_air
from ges.diagnose.estimate.fit import JointFit
from ges.diagnose.library.candidates import flight_envelope
from ges.diagnose.library.grids import out_of_reach
from ges.diagnose.library.requirements import lacking
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
from ges.diagnose.settings import changed
from ges.diagnose.types.decision import Considered, Decision, Record
from ges.diagnose.types.diagnosis import interval95
from ges.diagnose.types.model import Model, block_of
from ges.simulator import effects as effect_table


def located_by(start: Start, answer: Explanation) -> list[dict]:
    """``located`` of diagnosis.json: where the recalibrated vehicle misses the recordings, where
    findings act, and where something open does.
    """
    accepted, left = answer.accepted, answer.last.residuals
    entries = located_by_residuals(start.cells, start.first.structures, start.system)
    entries += located_by_findings(
        answer.added, left, accepted.probability, start.regimes, start.system
    )
    # what is open is in no model yet, so the accepted residual still holds it
    if accepted.rivals:
        entries += located_by_open_names(
            accepted.found, accepted.regression, left, start.regimes, accepted.names
        )
    return strongest_entries(entries)


def data_used(
    flights: Sequence[Prepared],
    gate: Gate,
    system: System,
    off: Mapping[str, str],
    warnings: Sequence[str],
) -> dict:
    """``data`` of diagnosis.json."""
    reasons = sorted({r for f in flights for r in f.left_out})
    # without logged references there is no instrument, and no strength to tell of
    by_flight = [
        r.instruments for r in system.flights if r.instruments and r.flight.has("reference")
    ]
    return {
        "flights": len(flights),
        "seconds_used": float(sum(f.flying.sum() * f.dt_s for f in flights)),
        "left_out": {r: float(sum(f.left_out.get(r, 0.0) for f in flights)) for r in reasons},
        "channels_used": list(system.main),
        "channels_off": off,
        "delays": [
            {
                "stream": d.stream,
                "delay_s": d.delay_s,
                "sd_s": d.sd_s,
                "correlation": d.correlation,
            }
            for d in gate.delays
        ],
        "instruments": strengths(by_flight, system.main),
        "window_s": system.length_s,
        "reference_scale": {
            block_of(name): system.model.reference_scale(name) for name in system.main
        },
        "warnings": list(warnings),
        # the defaults stand in docs/settings.md
        **({"settings": changed()} if changed() else {}),
    }


def calibration_of(joint: JointFit, model: Model) -> dict[str, dict]:
    """What the declared numbers came to, each beside its declared doubt."""
    return {
        key: {
            "value": value,
            "ci95": list(interval95(value, joint.common_sd[key])),
            "declared_sd": model.prior_sds.get(key),
        }
        for key, value in joint.common.items()
    }


def not_tested(system: System, found: Model) -> dict[str, str]:
    """Candidates that these recordings cannot speak about, each with what they lack.

    Parameters
    ----------
    system : of the first search; found : the model with the findings.
    """
    flights, reasons = system.recordings, {}
    searched = {c.variant.effect for c in system.columns if c.variant is not None}
    # the gate and the search for gusts speak about these, though no column of theirs is searched
    searched |= {e.name for e in effect_table.table().values() if e.settled and e.kind == "sensor"}
    searched |= {GUSTS} if shows_moving_air(found.effects) else set()
    for name, effect in effect_table.table().items():
        # what modifies another effect is tried together with that one
        if name not in searched and not effect.modifies:
            reasons[name] = (
                lacking(name, flights, system.model)
                or effect.settled
                or out_of_reach(
                    effect, system.model, flight_envelope(flights, system.model.radius_m)
                )
                or "these flights do not excite it"
            )
    # in closed loop only references, as instruments, explain a controller's motion
    references = any(f.has("reference") for f in flights)
    # what was named for all that has been tested
    named = found.effects.keys() - system.model.effects.keys()
    moved = {n for n in searched - named if effect_table.get(n).feedback == "dynamic"}
    for name in sorted(moved) if not references else ():
        reasons[name] = (
            "needs the references that the controller followed, or its answers to disturbances look"
            " like this effect"
        )
    return reasons


def unexplained_by(remains: Sequence[Structure]) -> list[dict]:
    """Structure for which there is neither a name nor a law."""
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


def considered(
    accepted: Accepted, record: Record, reasons: Mapping[str, str]
) -> tuple[Considered, ...]:
    """Every candidate with its posterior probability and the decisions about it, the likeliest
    first; what was not weighed with the reason.
    """
    inclusion = accepted.found.inclusion
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
    """Where an effect that acts in one of several places does, ``rotor 3``, by the best variant;
    '' for all others.
    """
    if name not in accepted.found.inclusion:
        return ""
    columns = accepted.regression.system.columns
    variants = (variant_of(columns[k]) for k in accepted.found.best_with(name).posterior.columns)
    return " and ".join(next(v for v in variants if v.effect == name).places)
