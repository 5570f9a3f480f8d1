"""Ranking of manoeuvres for the next flight.

The likeliest of the explanations that are still open is flown over a menu of manoeuvres, and
evaluated as a real flight would be. Each explanation is replayed along that path, as if it were
true. The manoeuvre that separates them most is recommended.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.special import softmax

from ges.conventions import MAX_ROTORS
from ges.diagnose.design.system import FlightRows, flight_residuals, flight_rows
from ges.diagnose.design.whiten import whiten
from ges.diagnose.estimate.fit import starting_values
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.gate import prepare
from ges.diagnose.select.evidence import Gram, Regression, flight_grams, posterior
from ges.diagnose.select.search import Hypothesis, SearchResult
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import flight as sim
from ges.simulator import manoeuvres
from ges.threads import each

READINGS = {f"omega_{a}_rad_s": f"gyro_{a}_rad_s" for a in "xyz"}


@dataclasses.dataclass(frozen=True)
class Rival:
    """An explanation that is still open.

    Attributes
    ----------
    names : its effects.
    effects : with their parameters.
    columns : its columns in the regression.
    """

    names: tuple[str, ...]
    effects: Mapping[str, Mapping[str, float]]
    columns: tuple[int, ...]


@dataclasses.dataclass(frozen=True)
class Option:
    """One manoeuvre.

    Attributes
    ----------
    manoeuvre : name in the menu.
    separates : explanations that it would separate from all others, with one that stands for the
        rest.
    stays_open : explanations that it would leave open among themselves.
    expected_log_odds : of the true explanation over its best rival afterwards, averaged over the
        present probabilities.
    so_far : log odds of the best explanation from the flights so far.
    log_odds_per_flight : by which one such flight raises the expected log odds.
    """

    manoeuvre: str
    separates: tuple[str, ...]
    stays_open: tuple[str, ...]
    expected_log_odds: float
    so_far: float
    log_odds_per_flight: float

    @property
    def flights(self) -> int | None:
        """How often to fly it until an acceptance is expected; None where that takes too many."""
        lacking = settings.statistics.acceptance_log_odds - self.expected_log_odds
        if lacking <= 0.0:
            return 1
        if self.log_odds_per_flight <= 0.0:
            return None
        # evidence of independent flights adds up, so that each brings the same
        wanted = 1 + int(np.ceil(lacking / self.log_odds_per_flight))
        return wanted if wanted <= settings.advise.flights_most else None

    def content(self) -> dict:
        """Return ``next_flight`` of diagnosis.json.

        Returns
        -------
        ``manoeuvre`` is None where this one would not do.
        """
        return {
            "manoeuvre": self.manoeuvre if self.flights else None,
            "flights": self.flights,
            "separates": list(self.separates),
            "stays_open": list(self.stays_open),
            "expected_log_odds": self.expected_log_odds,
            "so_far_log_odds": self.so_far,
        }


def as_rivals(regression: Regression, hypotheses: Sequence[Hypothesis]) -> list[Rival]:
    """Return each open hypothesis as a :class:`Rival`, with starting values of its parameters.

    Parameters
    ----------
    regression : of the search.
    hypotheses : that are open. One without names is nothing more than what is accepted.
    """
    return [Rival(h.names, starting_values(regression, h), h.posterior.columns) for h in hypotheses]


def open_sets(result: SearchResult, proven: Sequence[str]) -> list[Hypothesis]:
    """Return the best set with each name that is neither accepted nor ruled out.

    Parameters
    ----------
    result : of the search.
    proven : names that are accepted.

    Returns
    -------
    Hypotheses. The best set of accepted names alone is among them where it is possible.
    """
    names = [
        n for n in sorted(result.inclusion, key=lambda n: -result.inclusion[n]) if n not in proven
    ]
    names = [n for n in names if result.inclusion[n] > settings.statistics.possible_probability]
    sets = [
        max((h for h in result.hypotheses if n in h.names), key=lambda h: h.log_evidence)
        for n in names[: settings.search.beam]
    ]
    # nothing more than what is proven is an explanation like others, if it is possible
    without = [h for h in result.hypotheses if set(h.names) <= set(proven)]
    if sum(h.probability for h in without) > settings.statistics.possible_probability:
        sets.append(max(without, key=lambda h: h.log_evidence))
    return list({h.names: h for h in sets}.values())


def _logged_columns(flights: Sequence[Prepared]) -> list[str]:
    """Return columns that every recording had, without derived ones."""
    made = {name for f in flights for stream in f.derived for name in f.streams[stream]}
    common = set.intersection(*(set(f.columns) for f in flights)) - made
    return ["t_s", *sorted(common & {*sim.columns(MAX_ROTORS), *READINGS, "ground_z_m"})]


def simulate(model: Model, rival: Rival, plan: str, logged: Sequence[str]) -> Prepared | None:
    """Fly one manoeuvre with a rival's effects, recorded as the flights so far were.

    Parameters
    ----------
    model : of the vehicle.
    rival : whose effects act.
    plan : name of the manoeuvre.
    logged : columns that are recorded.

    Returns
    -------
    The flight; None where it could not be flown, or hardly leaves the ground.
    """
    table = manoeuvres.make(plan, settings.advise.duration_s)
    numbers: dict[str, float | str] = {
        **model.parameters,
        "attitude_kp": settings.advise.attitude_kp,
        # critically damped, kd = 2 sqrt(kp)
        "attitude_kd": 2.0 * math.sqrt(settings.advise.attitude_kp),
        "seed": settings.statistics.seed,
        "altitude_source": 1,
        "mode": "none",
        "inputs_dt_s": manoeuvres.STEP_S,
        "duration_s": (len(table) - 1) * manoeuvres.STEP_S,
    }
    effects = model.with_effects(rival.effects).effects
    wanted = [READINGS.get(name, name) for name in logged]
    (record,) = sim.fly([sim.Flight(numbers, effects, model.terrain, table)], wanted)
    if record.status != "ok":
        return None
    frame = pd.DataFrame(
        {name: record[source] for name, source in zip(logged, wanted, strict=True)}
    )
    flight = prepare(frame, model)
    return flight if flight.flying.mean() > 0.5 else None


def _columns_in_use(regression: Regression, rivals: Sequence[Rival]) -> np.ndarray:
    """Return indices of the nuisance columns in use and of the rivals' columns."""
    used = [k for k in regression.nuisance if regression.prior.sd[k] > 0]
    return np.array(sorted({*used, *(k for r in rivals for k in r.columns)}), dtype=int)


def _grams(
    regression: Regression,
    flights: Sequence[FlightRows],
    flight: Prepared,
    keep: np.ndarray,
    rivals: Sequence[Rival],
) -> list[Gram]:
    """Return the normal equations of one more flight if each rival were true.

    They are in the noise of the flights so far.
    """
    system, columns = regression.system, [regression.system.columns[k] for k in keep]
    rows = flight_rows(flight, system.model, system.names, columns, flights[0].windows.length_s)
    # h of equation (4), over the median of the flights so far: their noise model is in that unit
    usual = np.median(np.concatenate([r.covariate for r in flights])) or 1.0
    grams = []
    for rival in rivals:
        # what was flown drops out of the difference, and the rival less the model is left
        rest = flight_residuals(rows, system.names, system.model.with_effects(rival.effects))
        if_true = dataclasses.replace(rows, y=rows.y - rest)
        white = whiten([if_true], regression.noise, [rows.covariate / usual])
        grams += flight_grams(white, columns, settings.evidence.tempering)
    return grams


def _log_evidence(
    regression: Regression, gram: Gram, keep: np.ndarray, rivals: Sequence[Rival]
) -> np.ndarray:
    """Return log evidence of every rival on these normal equations."""
    index = {int(k): i for i, k in enumerate(keep)}
    # nuisances are integrated out once, of all flights together: they are the same in each rival
    drop = np.array([index[int(k)] for k in keep if k in set(regression.nuisance)], dtype=int)
    marginal = gram.without(drop, regression.prior.sd[keep][drop])
    sets = [[index[int(k)] for k in r.columns] for r in rivals]
    prior = regression.prior.take(keep)
    return np.array([posterior(marginal, at, prior).log_evidence if at else 0.0 for at in sets])


def _evidence_ahead(evidence: np.ndarray, truth: int) -> float:
    """Return by how much log evidence the true rival leads the best other."""
    return float(evidence[truth] - np.delete(evidence, truth).max())


def _expected_lead(probability: np.ndarray, leads: Sequence[float]) -> float:
    """Return the lead of the true rival, averaged by the probability of each to be true.

    A lead beyond what settles the question is worth no more than that.
    """
    return float(probability @ np.minimum(leads, settings.advise.settled_log_odds))


def _labels(rivals: Sequence[Rival]) -> tuple[str, ...]:
    """Return names of each rival that not all of them have."""
    shared = set.intersection(*(set(r.names) for r in rivals))
    return tuple("+".join(n for n in r.names if n not in shared) or "nothing more" for r in rivals)


def rank(
    regression: Regression,
    flights: Sequence[FlightRows],
    rivals: Sequence[Rival],
    plans: Sequence[str] = tuple(manoeuvres.MENU),
    also_logged: Collection[str] = (),
) -> list[Option]:
    """Rank the manoeuvres, best first.

    Parameters
    ----------
    regression : of the search over the flights so far.
    flights : so far, whatever their columns.
    rivals : two or more open explanations.
    plans : names of the menu in ``ges.simulator.manoeuvres``.
    also_logged : columns that only the next flight will have; the flights so far then count as no
        evidence.
    """
    model, keep = regression.system.model, _columns_in_use(regression, rivals)
    logged = [*_logged_columns([r.flight for r in flights]), *also_logged]
    past = sum((g.take(keep) for g in regression.by_flight[1:]), regression.by_flight[0].take(keep))
    past = past.scale(0.0) if also_logged else past
    now = _log_evidence(regression, past, keep, rivals)
    so_far, probability = float(np.sort(now)[-1] - np.sort(now)[-2]), softmax(now)
    labels, options, reserves = _labels(rivals), [], {}
    expected_now = _expected_lead(
        probability, [_evidence_ahead(now, i) for i in range(len(rivals))]
    )
    likeliest = rivals[int(np.argmax(now))]
    made = each(lambda plan: simulate(model, likeliest, plan, logged), plans)
    flown = {plan: f for plan, f in zip(plans, made, strict=True) if f is not None}
    grams_by_plan = each(lambda f: _grams(regression, flights, f, keep, rivals), flown.values())
    for plan, grams in zip(flown, grams_by_plan, strict=True):
        after = [_log_evidence(regression, past + gram, keep, rivals) for gram in grams]
        leads = [_evidence_ahead(evidence, i) for i, evidence in enumerate(after)]
        # what would still be open although it were true
        still_open = tuple(
            label
            for label, lead in zip(labels, leads, strict=True)
            if lead <= settings.statistics.acceptance_log_odds
        )
        separated = tuple(label for label in labels if label not in still_open)
        expected = _expected_lead(probability, leads)
        separates, open_still = (
            (separated + still_open[:1], still_open) if separated else (labels, ())
        )
        options.append(
            Option(plan, separates, open_still, expected, so_far, expected - expected_now)
        )
        reserves[plan] = min(leads)
    # of those that settle it, the one that has most to spare
    return sorted(options, key=lambda o: (-o.expected_log_odds, -reserves[o.manoeuvre]))
