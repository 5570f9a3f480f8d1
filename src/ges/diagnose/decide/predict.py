"""Whether a name predicts flights that it was not fitted to: training flights, left out in turn.

The log predictive density of a flight given the others is the log evidence of all less that of the
others (Gelman et al. 2014, *Bayesian Data Analysis*, sec. 7.2), here of the fit linearised at its
best. Flights that are held out take no part.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np

from ges.diagnose.decide.accept import Accepted, without
from ges.diagnose.estimate.contributions import contributions, size_of_contribution
from ges.diagnose.estimate.fit import Fitted, free_columns, wide_sds
from ges.diagnose.library.candidates import amplitude_of, has_prerequisite
from ges.diagnose.select.evidence import Gram, Posterior, Prior, flight_grams, posterior
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Decision, Record
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class PredictiveGain:
    """Training flights, each predicted from the others with a name and without it, (F,) each; empty
    where there is one flight.

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
    """What a name, and what acts through it alone, is worth to flights that it was not fitted to.

    Parameters
    ----------
    channel : in which errors are compared.
    """
    regression = fitted.regression
    grams = flight_grams(regression.whites, regression.system.columns, settings.evidence.tempering)
    if len(grams) < 2:
        return PredictiveGain(np.zeros(0), np.zeros(0))
    # the two fits differ by the name and what it carries; noise and linearisation are the same
    rest = set(fitted.effects) - {name}
    dropped = {name, *(n for n in rest if not has_prerequisite(n, rest))}
    at = regression.system.main.index(channel)
    (less, before), (more, after) = (
        _LinearFit(fitted, gone).predict_flights(grams, at) for gone in (dropped, ())
    )
    return PredictiveGain(more - less, after / np.maximum(before, settings.numerics.tiny))


class _LinearFit:
    """A fit, linearised at its best, with some effects ``dropped``: their columns held where the
    effects are neutral.
    """

    def __init__(self, fitted: Fitted, dropped: Collection[str]) -> None:
        self.system, regression = fitted.regression.system, fitted.regression
        columns, chosen = self.system.columns, free_columns(self.system)
        freed = {columns[k].key for k in chosen}
        # columns are linear about the fit, where neutral is the neutral less the fitted value
        self.held = {
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
        """Coefficients from some flights, and the log evidence of these."""
        # log_evidence is relative to all coefficients at 0; held columns move that reference,
        # so its own -|y|^2 / 2 has to count too
        total = sum(grams[1:], grams[0]).about(
            np.array(list(self.held), dtype=int), np.array(list(self.held.values()))
        )
        found = posterior(total, self.columns, self.prior)
        return found, found.log_evidence - 0.5 * total.yy

    def predict_flights(self, grams: Sequence[Gram], channel: int) -> tuple[np.ndarray, np.ndarray]:
        """Log density of each flight given the others, but for a constant, and its rms error by
        their coefficients in a channel, in the channel's unit; (F,) each.
        """
        told, whole = [], self._of(grams)[1]
        for left, rows in enumerate(self.system.flights):
            found, others = self._of([g for i, g in enumerate(grams) if i != left])
            terms = {**self.held, **dict(zip(found.columns, found.mean, strict=True))}
            # not whitened: a flight counts against a name only where its plain error grows, too
            error = (rows.y[:, channel] - rows.weighted_columns(terms, channel + 1)[:, channel])[
                rows.air
            ]
            rms = float(np.linalg.norm(error[np.isfinite(error)]) / np.sqrt(len(error)))
            # log p(y_f | y_-f) = log Z(y) - log Z(y_-f), equation (9) of docs/method.md
            told.append((whole - others, rms))
        density, error_rms = np.array(told).T
        return density, error_rms


def drop_unpredictive(accepted: Accepted, record: Record) -> Accepted:
    """Drop names that some flight, predicted from the others, speaks against: certainly less
    likely with the name, and off by more where it mainly acts; the worst first.
    """
    while (fitted := accepted.fitted) is not None:
        system = accepted.regression.system
        added = contributions(fitted, accepted.names, system.model)
        worst = {
            n: _worst(fitted, n, size_of_contribution(a, system)["channel"])
            for n, a in added.items()
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
        accepted = without(accepted, name)
    return accepted


def _worst(fitted: Fitted, name: str, channel: str) -> float:
    return predictive_gain(fitted, name, channel).worst if channel else 0.0
