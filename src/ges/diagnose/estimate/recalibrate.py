"""The best that the declared numbers can do, where they are too far off for one linear step.

Residuals are linear in small corrections only: a thrust scale, a thrust curve and a top speed
multiply each other. One Gauss-Newton step from the vehicle file is taken for the answer where the
model, flown with it, gains what the linearisation predicted. Else the maximum of the posterior is
searched within the library's bounds by a trust-region method (Branch, Coleman and Li 1999, as
``scipy.optimize.least_squares`` has it), and all is linearised anew there.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.optimize import least_squares

from ges.diagnose.design.system import nuisance_of, residuals_with
from ges.diagnose.design.table import spread, table_of
from ges.diagnose.design.whiten import variance_covariate, whiten
from ges.diagnose.estimate.fit import Joint, calibrated, correction_bounds
from ges.diagnose.select.evidence import Regression, unanswered
from ges.diagnose.settings import settings


def operating_point(regression: Regression, joint: Joint) -> dict[str, float]:
    """Corrections of the declared numbers about which all has to be linearised.

    Parameters
    ----------
    regression, joint : of the null fit, linearised at the vehicle file or where it was moved to.

    Returns
    -------
    ``effect.parameter`` to correction, in the parameter's unit; empty where the linear step does
    what it predicts.
    """
    posterior, moved = _Posterior(regression), regression.system.model.moved
    linear = np.array([joint.common[k] - moved.get(k, 0.0) for k in posterior.keys]) / posterior.sd
    # a bound that stopped a step says nothing of where the best inside is, until that was searched
    stopped = (linear != 0.0) & ((linear <= posterior.low) | (linear >= posterior.high))
    if moved or not stopped.any():
        # trust-region ratio: actual fall of the cost over what the linear step predicted
        given, stepped = posterior.cost(np.zeros(len(linear))), posterior.cost(linear)
        if given - stepped >= settings.numerics.gain_ratio_least * (given - joint.cost):
            return {}
    inside = np.clip(0.0, posterior.low, posterior.high)
    found = least_squares(
        posterior.residuals,
        inside,
        bounds=(posterior.low, posterior.high),
        ftol=settings.estimate.recalibration_tolerance,
        max_nfev=settings.numerics.fit_rounds,
    )
    further = dict(zip(posterior.keys, (found.x * posterior.sd).tolist(), strict=True))
    return {key: moved.get(key, 0.0) + value for key, value in further.items()}


class _Posterior:
    """Minus twice the log posterior of the common nuisances as a sum of squares, at points (k,) of
    their deviations from the vehicle file in sds; those of each flight are at their best beside.
    """

    def __init__(self, regression: Regression) -> None:
        self.regression, self.covariate = regression, variance_covariate(regression.system.flights)
        columns, model = regression.system.columns, regression.system.model
        known = {int(k): nuisance_of(columns[k]) for k in regression.nuisance}
        common = [n for n in known.values() if n.sd > 0]
        self.keys = [n.key for n in common]
        self.sd = np.array([n.sd for n in common])
        self.mean = np.array([n.mean for n in common]) / self.sd
        room = np.array([correction_bounds(n.key, model) for n in common]).reshape(-1, 2)
        self.low, self.high = (room / self.sd[:, None]).T
        # what differs between flights is small: its columns stay as they were linearised
        varying = [k for k, n in known.items() if n.flight_sd > 0]
        unit = np.array([known[k].flight_sd for k in varying])
        self.by_flight = [
            np.concatenate(
                [spread(unanswered(part)[0], part.columns, varying) * unit for part in white.parts]
            )
            for white in regression.whites
        ]

    def cost(self, point: np.ndarray) -> float:
        """The sum of squares."""
        return float((self.residuals(point) ** 2).sum())

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Whitened residuals of all flights and deviations of all numbers from their priors in
        sds.
        """
        system = self.regression.system
        common = dict(zip(self.keys, point * self.sd, strict=True))
        moved = residuals_with(system, calibrated(system.model, common))
        rows = [
            dataclasses.replace(r, y=y, x=table_of([], *y.shape))
            for r, y in zip(system.flights, moved, strict=True)
        ]
        left = []
        for white, x in zip(
            whiten(rows, self.regression.noise, self.covariate), self.by_flight, strict=True
        ):
            y = np.concatenate([unanswered(part)[1] for part in white.parts])
            # variable projection: a flight's own numbers, in sds, are solved for at every point
            own = np.linalg.solve(np.eye(x.shape[1]) + x.T @ x, x.T @ y)
            # their priors are rows as well, or the flights' numbers would cost nothing
            left += [y - x @ own, own]
        return np.concatenate([*left, point - self.mean])
