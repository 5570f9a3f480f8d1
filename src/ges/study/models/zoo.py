"""Models by name: what each is made of, and which view of a row it reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sklearn.base import RegressorMixin
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.tree import DecisionTreeRegressor

from ges.errors import GesError
from ges.study.config import BoostingFit, Fit, ForestFit, NetworkFit, Quadrotor, TreeFit, Window
from ges.study.datasets.rows import Rows

SEQUENCE_MODELS = ("lstm", "transformer")
VALIDATED = ("gradient_boosting", "mlp", *SEQUENCE_MODELS)


def features(name: str, rows: Rows) -> np.ndarray:
    """Return what a model reads of rows.

    Returns
    -------
    The whole window (n, window * 13) for sequence models, else the present (n, 13).
    """
    return rows.flat if name in SEQUENCE_MODELS else rows.now


def make(
    name: str, fit: Fit | None, window: Window, vehicle: Quadrotor, seed: int
) -> RegressorMixin:
    """Return the unfitted model of a name.

    Parameters
    ----------
    name : of the model.
    fit : its part of the configuration; the analytical baseline has none.
    window : window of the sequence models.
    vehicle : airframe of the analytical baseline.
    seed : of its random numbers.

    Raises
    ------
    GesError
        When another model has no part in the configuration.
    """
    if name == "analytical":
        from ges.study.models.analytical import AnalyticalBaseline

        return AnalyticalBaseline(vehicle.parameters())
    if fit is None:
        raise GesError(f"model '{name}' has no part in the configuration; give it one")
    if isinstance(fit, NetworkFit):
        return _network(name, fit, window, seed)
    return _tabular(name, fit, seed)


def _tabular(name: str, fit: Fit, seed: int) -> RegressorMixin:
    if name == "linear":
        # predictions of least squares hang on no unit, but rad/s beside metres cost digits
        return make_pipeline(StandardScaler(), LinearRegression())
    if name == "decision_tree":
        assert isinstance(fit, TreeFit)
        return DecisionTreeRegressor(min_samples_leaf=fit.min_leaf_rows, random_state=seed)
    if name == "random_forest":
        assert isinstance(fit, ForestFit)
        return RandomForestRegressor(
            fit.trees,
            min_samples_leaf=fit.min_leaf_rows,
            max_features=fit.features_share,
            random_state=seed,
            n_jobs=1,
        )
    assert isinstance(fit, BoostingFit)
    # tol 0, since it is absolute and the squared error of a factor small: any gain counts
    return HistGradientBoostingRegressor(
        max_iter=fit.trees,
        max_leaf_nodes=fit.leaves,
        min_samples_leaf=fit.min_leaf_rows,
        learning_rate=fit.learning_rate,
        early_stopping=True,
        n_iter_no_change=fit.patience,
        tol=0.0,
        random_state=seed,
    )


def _network(name: str, fit: NetworkFit, window: Window, seed: int) -> RegressorMixin:
    from ges.study.models import networks

    kinds = {
        "mlp": networks.MlpRegressor,
        "lstm": networks.LstmRegressor,
        "transformer": networks.TransformerRegressor,
    }
    settings: Mapping[str, Any] = fit.model_dump(exclude={"train_rows"})
    rows = window.rows if name in SEQUENCE_MODELS else 1
    return kinds[name](window_rows=rows, random_state=seed, **settings)


def fitted(
    name: str, model: RegressorMixin, train: Rows | None, validation: Rows | None
) -> RegressorMixin:
    """Fit a model to rows.

    Parameters
    ----------
    name : of the model.
    model : unfitted.
    train : rows; None leaves the model as it is.
    validation : rows for models that stop early or keep their best pass; the others never see them.

    Raises
    ------
    GesError
        When a model needs validation rows and has none.
    """
    if train is None:
        return model
    x = features(name, train)
    if name not in VALIDATED:
        return model.fit(x, train.y)
    if validation is None:
        raise GesError(f"model '{name}' looks at validation rows and has none; keep some")
    return model.fit(x, train.y, X_val=features(name, validation), y_val=validation.y)
