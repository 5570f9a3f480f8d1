"""The baseline: the ground effect of flat ground at the height that the rangefinder reads."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import Tags
from sklearn.utils.validation import validate_data

from ges.simulator import effects
from ges.study.datasets.columns import FEATURES

HEIGHT = FEATURES.index("range_m")
SPEED_RAD_S = 400.0


def flat_ground_factor(height_m: np.ndarray, vehicle: Mapping[str, float]) -> np.ndarray:
    """Return the flat-ground formula's factor, evaluated by the compiled effect.

    Parameters
    ----------
    height_m : (n,) of the hubs over the ground.
    vehicle : simulator numbers of the airframe.

    Returns
    -------
    (n,) thrust over that far from the ground; it does not depend on rotor speed.

    References
    ----------
    Cheeseman and Bennett 1955.
    """
    speed = np.full(len(height_m), SPEED_RAD_S)
    level = {
        "t_s": np.arange(len(height_m), dtype=float),
        "p_z_m": np.asarray(height_m, dtype=float),
    }
    samples = effects.Samples.from_columns(
        {**level, **{f"rotor_speed_{i}_rad_s": speed for i in range(1, 5)}}
    )
    # level ground: without the corrections of slope and curvature the factor is the formula
    form = {"form": 0.0, "amplitude": 1.0, "slope_exponent": 0.0, "curvature_gain_m": 0.0}
    gained = effects.evaluate("ground_effect", form, samples, vehicle)
    # the effect adds k w^2 (f - 1) to a rotor's k w^2
    return 1.0 + gained["thrust_1_N"] / (vehicle["thrust_coefficient_N_s2"] * SPEED_RAD_S**2)


class AnalyticalBaseline(RegressorMixin, BaseEstimator):
    """Regressor that learns nothing and needs no fit.

    Parameters
    ----------
    vehicle : simulator numbers of the airframe.
    column : column of X that holds the height over ground (m).
    """

    def __init__(self, vehicle: Mapping[str, float], column: int = HEIGHT) -> None:
        self.vehicle = vehicle
        self.column = column

    def fit(self, X: np.ndarray, y: np.ndarray) -> AnalyticalBaseline:
        """Check the rows; nothing is learned.

        Parameters
        ----------
        X : (n, k) rows.
        y : (n,) factors.
        """
        validate_data(self, X, y)
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:
        """Return the factor at the height that a column holds.

        Parameters
        ----------
        X : (n, k) rows.

        Returns
        -------
        (n,).
        """
        return flat_ground_factor(validate_data(self, X, reset=False)[:, self.column], self.vehicle)

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        tags.requires_fit = False
        tags.regressor_tags.poor_score = True
        return tags
