"""Scores of laws: whether what no library has was found by its terms, and by its size.

A sealed truth gives a law in SI units, as powers of speeds and rates. A diagnosis gives products of
dimensionless groups, which are evaluated at unit speeds with the references of the vehicle file.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ges.blind.score.statistics import proportion
from ges.simulator import laws
from ges.simulator.effects import Samples, evaluate_terms
from ges.simulator.terrain import Terrain
from ges.vehicle.file import Law, Vehicle
from ges.vehicle.load import load_vehicle

CLOSE = 0.05
"""Relative error of a coefficient that counts as right."""
STATE_OF = {"V_x": "v_x_m_s", "V_y": "v_y_m_s", "V_z": "v_z_m_s", "r": "omega_z_rad_s"}
"""Recorded state behind a quantity, of a level vehicle in still air."""


@dataclass(frozen=True)
class LawOutcome:
    """What a diagnosis says of a law that is true.

    Attributes
    ----------
    case : the set.
    form : what is reported, '' for nothing.
    right : whether it has the true terms and no other.
    error : largest relative error of their coefficients; NaN where the terms are not right.
    """

    case: str
    form: str
    right: bool
    error: float


def law_outcome(
    case: str, truth: Mapping[str, Any], diagnosis: Mapping[str, Any], vehicle: Vehicle
) -> LawOutcome:
    """Compare the laws of a diagnosis with those of a sealed truth.

    Parameters
    ----------
    case : the set.
    truth : sealed, with ``laws``.
    diagnosis : content of ``diagnosis.json``.
    vehicle : of the set, whose numbers are the references of groups.
    """
    reported = {
        (law["channel"], frozenset(_powers(term).items())): (term, coefficient)
        for law in diagnosis.get("laws", [])
        for term, coefficient in laws.parse(law["channel"], law["form"]).items()
    }
    true = {
        (law["channel"], frozenset(law["powers"].items())): law["coefficient_SI"]
        for law in truth["laws"]
    }
    form = "; ".join(f"{law['channel']} = {law['form']}" for law in diagnosis.get("laws", []))
    if set(reported) != set(true):
        return LawOutcome(case, form, False, np.nan)
    errors = [
        abs(_in_SI(*reported[key], dict(key[1]), vehicle) / coefficient - 1.0)
        for key, coefficient in true.items()
    ]
    return LawOutcome(case, form, True, max(errors))


def true_laws(true: Sequence[Mapping[str, Any]], vehicle: Vehicle) -> tuple[Law, ...]:
    """Write sealed laws as a vehicle file holds them.

    Parameters
    ----------
    true : channel, powers by quantity and ``coefficient_SI`` of each term.
    vehicle : whose numbers are the references of groups.
    """
    texts = {group.quantity: text for text, group in laws.groups().items()}
    terms: dict[str, dict[laws.Term, float]] = {}
    for law in true:
        powers = {texts[quantity]: power for quantity, power in law["powers"].items()}
        term = laws.Term.of(law["channel"], laws.SCALES[0], powers)
        coefficient = law["coefficient_SI"] / _in_SI(term, 1.0, law["powers"], vehicle)
        terms.setdefault(law["channel"], {})[term] = coefficient
    return tuple(Law(channel=c, form=laws.written(own)) for c, own in terms.items())


def _powers(term: laws.Term) -> dict[str, int]:
    """Return exponents by quantity; a place is no quantity, and makes the term another."""
    own = {
        group.quantity: n + m
        for group, n, m in zip(laws.groups().values(), term.power, term.magnitude, strict=True)
        if n or m
    }
    return own | ({"place": 1} if term.local else {})


def _in_SI(
    term: laws.Term, coefficient: float, powers: Mapping[str, int], vehicle: Vehicle
) -> float:
    """Return force (N) or moment (N m) at unit speeds and rates, in hover's thrust."""
    ones = {state: 1.0 for quantity, state in STATE_OF.items() if quantity in powers}
    # thrust is the weight where the vehicle hovers, and only there a speed is one by itself
    weight = dataclasses.replace(term, scale=laws.SCALES[0])
    # columns that are absent are zero and level; high above the ground R/h is zero, too
    state = {name: np.array([value]) for name, value in {"t_s": 0.0, "p_z_m": 1e3, **ones}.items()}
    samples = Samples.from_columns(state, len(vehicle.rotors))
    value = evaluate_terms([weight], vehicle.parameters(), samples, {}, Terrain.flat())
    return coefficient * float(value[0, 0])


def law_scores(outcomes: Sequence[LawOutcome]) -> dict[str, tuple[float, float, float, int]]:
    """Return score, 95 % interval (low, high) and number of sets, by name.

    Returns
    -------
    Nothing without sets. Coefficients are scored where the terms are right.
    """
    right = [a.right for a in outcomes]
    close = [a.error <= CLOSE for a in outcomes if a.right]
    scores = {"laws with the right terms": right, f"their coefficients within {CLOSE:.0%}": close}
    return {name: (*proportion(hits), len(hits)) for name, hits in scores.items() if hits}


def laws_of_sets(
    folder: Path, truths: Mapping[str, Mapping], diagnoses: Mapping[str, Mapping]
) -> list[LawOutcome]:
    """Return the outcomes of all sets in which a law is true.

    Parameters
    ----------
    folder : of the sets.
    truths, diagnoses : by set.
    """
    return [
        law_outcome(
            name, truth, diagnoses[name], load_vehicle(folder / "cases" / name / "vehicle.yaml")
        )
        for name, truth in truths.items()
        if truth.get("laws")
    ]
