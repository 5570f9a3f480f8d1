"""Whether a name predicts flights that it was not fitted to: training flights, left out in turn.

The log predictive density of a flight given the others is the log evidence of all less that of the
others (Gelman et al. 2014, *Bayesian Data Analysis*, sec. 7.2). The fit is linearised at its
optimum. Held-out flights take no part.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np

from ges.diagnose.decide.accept import Accepted, without_name
from ges.diagnose.estimate.contributions import contributions, size_of_contribution
from ges.diagnose.estimate.fit import Fitted, free_columns, wide_sds
from ges.diagnose.library.candidates import amplitude_of, has_prerequisite
from ges.diagnose.select.evidence import Gram, Posterior, Prior, flight_grams, posterior
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Decision, DecisionLog
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class PredictiveGain:
    """Training flights, each predicted from the others with a name and without it.

    Arrays are (F,) for F flights, empty where there is one flight.

    Attributes
    ----------
    gain : log density with the name less that without.
    growth : rms error with the name over that without, in a channel.
    """

    gain: np.ndarray
    growth: np.ndarray

    @property
    def worst(self) -> float:
        """Log odds of the least likely of those flights whose error grows; 0 where none does."""
        return float(self.gain[self.growth > 1.0].min(initial=0.0))


def predictive_gain(fitted: Fitted, name: str, channel: str) -> PredictiveGain:
    """Return what a name, and what acts through it alone, adds to the prediction of other flights.

    Parameters
    ----------
    fitted : fit with the name.
    name : of the effect.
    channel : in which errors are compared.

    Returns
    -------
    Empty where there is one flight.

    References
    ----------
    Equation (9) of docs/method.md.
    """
    regression = fitted.regression
    grams = flight_grams(regression.whites, regression.system.columns, settings.evidence.tempering)
    if len(grams) < 2:
        return PredictiveGain(np.zeros(0), np.zeros(0))
    # the two fits differ by the name and what it carries; noise and linearisation are the same
    rest = set(fitted.effects) - {name}
    dropped = {name, *(n for n in rest if not has_prerequisite(n, rest))}
    at = regression.system.main.index(channel)
    (without_density, without_error), (with_density, with_error) = (
        _LinearFit(fitted, names).predict_flights(grams, at) for names in (dropped, ())
    )
    return PredictiveGain(
        with_density - without_density,
        with_error / np.maximum(without_error, settings.numerics.tiny),
    )


class _LinearFit:
    """A fit, linearised at its optimum, without some effects: their columns stay neutral."""

    def __init__(self, fitted: Fitted, dropped: Collection[str]) -> None:
        self.system, regression = fitted.regression.system, fitted.regression
        columns, chosen = self.system.columns, free_columns(self.system)
        freed = {columns[k].key for k in chosen}
        # columns are linear about the fit, where neutral is the neutral less the fitted value
        self.fixed = {
            k: amplitude_of(e, p).neutral - fitted.effects[e][p]
            for (e, p), k in zip(fitted.free, chosen, strict=False)
            if e in dropped and p not in effect_table.get(e).shapes
        }
        kept = [k for k in chosen if (v := columns[k].variant) is None or v.effect not in dropped]
        # what a fit has freed is not also a nuisance, or it would be counted twice
        common = [
            int(k)
            for k in regression.nuisance
            if regression.prior.sd[k] > 0 and columns[k].key not in freed
        ]
        self.columns = [*kept, *common]
        mean, sd = np.zeros(len(columns)), regression.prior.sd.copy()
        mean[common], sd[chosen] = regression.prior.mean[common], wide_sds(regression, chosen)
        endless = np.full(len(columns), np.inf)
        self.prior = Prior(mean, sd, -endless, endless)

    def _of(self, grams: Sequence[Gram]) -> tuple[Posterior, float]:
        """Return coefficients from some flights, and the log evidence of these."""
        # log_evidence is relative to all coefficients at 0; held columns move that reference,
        # so its own -|y|^2 / 2 has to count too
        total = sum(grams[1:], grams[0]).about(
            np.array(list(self.fixed), dtype=int), np.array(list(self.fixed.values()))
        )
        coefficients = posterior(total, self.columns, self.prior)
        return coefficients, coefficients.log_evidence - 0.5 * total.yy

    def predict_flights(self, grams: Sequence[Gram], channel: int) -> tuple[np.ndarray, np.ndarray]:
        """Predict each flight from the others, (F,) each.

        Returns the log density, but for a constant, and the rms error in a channel, in its unit.
        """
        rows_of_flights, total = [], self._of(grams)[1]
        for number, rows in enumerate(self.system.flights):
            coefficients, others = self._of([g for i, g in enumerate(grams) if i != number])
            terms = {
                **self.fixed,
                **dict(zip(coefficients.columns, coefficients.mean, strict=True)),
            }
            # not whitened: a flight counts against a name only where its plain error grows, too
            error = (rows.y[:, channel] - rows.weighted_columns(terms, channel + 1)[:, channel])[
                rows.air
            ]
            rms = float(np.linalg.norm(error[np.isfinite(error)]) / np.sqrt(len(error)))
            # log p(y_f | y_-f) = log Z(y) - log Z(y_-f), equation (9) of docs/method.md
            rows_of_flights.append((total - others, rms))
        density, error_rms = np.array(rows_of_flights).T
        return density, error_rms


def drop_unpredictive(accepted: Accepted, record: DecisionLog) -> Accepted:
    """Drop names that certainly make some flight less probable, the worst first.

    Parameters
    ----------
    accepted : names and fits.
    record : takes every decision.

    Notes
    -----
    A flight counts if its error also grows in the channel where the name mainly acts.
    """
    while (fitted := accepted.fitted) is not None:
        system = accepted.regression.system
        by_name = contributions(fitted, accepted.names, system.model)
        worst = {
            n: _worst(fitted, n, size_of_contribution(a, system)["channel"])
            for n, a in by_name.items()
        }
        least = -settings.statistics.certain_log_odds
        for name, gain in worst.items():
            against = f"a flight left out of its fit is off by more with it, log odds {gain:.3g}"
            because = against if gain < 0.0 else "no flight left out of its fit speaks against it"
            decision = Decision("predicts_flights", gain >= least, because, gain, least)
            record.note(name, decision)
        name = min(worst, key=lambda n: worst[n])
        if worst[name] >= least:
            break
        accepted = without_name(accepted, name)
    return accepted


def _worst(fitted: Fitted, name: str, channel: str) -> float:
    return predictive_gain(fitted, name, channel).worst if channel else 0.0
