"""Whether a name foretells flights that it was not fitted to: training flights, left out in turn.

The log predictive density of a flight given the others is the log evidence of all less that of the
others (Gelman et al. 2014, *Bayesian Data Analysis*, sec. 7.2), here of the fit linearised at its
best. Flights that are held out take no part.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ges.diagnose.decide.accept import Accepted, without
from ges.diagnose.estimate.fit import Fitted, free_first, wide
from ges.diagnose.library.candidates import acts_among, amplitude_of
from ges.diagnose.select.evidence import Prior, posterior
from ges.diagnose.select.gram import Gram, flight_grams
from ges.diagnose.types.decision import Decision, Record
from ges.simulator import effects as effect_table


def foretold(fitted: Fitted, name: str) -> np.ndarray:
    """What a name, and what acts through it alone, is worth to flights that it was not fitted to:
    log density of each training flight, foretold from the others, with it less that without it,
    (F,); empty where there is one flight.
    """
    board = fitted.board
    grams = flight_grams(board.whites, board.system.columns, board.noise.worth)
    if len(grams) < 2:
        return np.zeros(0)
    # the two fits differ by the name and what it carries; noise and linearisation are the same
    rest = set(fitted.effects) - {name}
    dropped = {name, *(n for n in rest if not acts_among(n, rest))}
    less, more = (_Fit(fitted, gone).foretold(grams) for gone in (dropped, ()))
    return more - less


class _Fit:
    """A fit, linearised at its best, with some effects ``dropped``: their columns held where the
    effects are neutral.
    """

    def __init__(self, fitted: Fitted, dropped: Collection[str]) -> None:
        self.system, board = fitted.board.system, fitted.board
        columns, chosen = self.system.columns, free_first(self.system)
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
            int(k) for k in board.nuisance if board.prior.sd[k] > 0 and columns[k].key not in freed
        ]
        self.columns = [*kept, *common]
        mean, sd = np.zeros(len(columns)), board.prior.sd.copy()
        mean[common], sd[chosen] = board.prior.mean[common], wide(board, chosen)
        endless = np.full(len(columns), np.inf)
        self.prior = Prior(mean, sd, -endless, endless)

    def _log_evidence(self, grams: Sequence[Gram]) -> float:
        """Of some flights."""
        # log_evidence is relative to all coefficients at 0; held columns move that reference,
        # so its own -|y|^2 / 2 has to count too
        total = sum(grams[1:], grams[0]).about(
            np.array(list(self.held), dtype=int), np.array(list(self.held.values()))
        )
        return posterior(total, self.columns, self.prior).log_evidence - 0.5 * total.yy

    def foretold(self, grams: Sequence[Gram]) -> np.ndarray:
        """Log density of each flight given the others, but for a constant, (F,)."""
        whole = self._log_evidence(grams)
        others = ([*grams[:left], *grams[left + 1 :]] for left in range(len(grams)))
        # log p(y_f | y_-f) = log Z(y) - log Z(y_-f), equation (8) of docs/method.md
        return np.array([whole - self._log_evidence(o) for o in others])


def foretelling(accepted: Accepted, record: Record) -> Accepted:
    """Without the names with which flights, each foretold from the others, are less likely in all
    than without; the worst first.
    """
    while (fitted := accepted.fitted) is not None:
        gains = {n: float(foretold(fitted, n).sum()) for n in accepted.names}
        for name, gain in gains.items():
            because = f"log odds {gain:.3g} of flights left out of its fit in turn"
            record.note(name, Decision("foretells_flights", gain >= 0.0, because, gain, 0.0))
        name = min(gains, key=lambda n: gains[n])
        if gains[name] >= 0.0:
            break
        accepted = without(accepted, name)
    return accepted
