"""Neural networks as scikit-learn regressors: standardised inputs, the best pass on validation
rows, one thread, the same bits every time.
"""

from __future__ import annotations

import math
from typing import Self

import numpy as np
import torch
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data
from torch import nn

# rows through a network at once: bounds memory
PREDICT_ROWS = 8192


class NetworkRegressor(RegressorMixin, BaseEstimator):
    """A torch network fitted to squared error.

    Rows X are (n, window_rows * channels), oldest row of the window first. The step size rises and
    falls over the passes, so all of them are made: a network that stops before has not cooled. The
    weights that did best on the validation rows are kept.

    Parameters
    ----------
    epochs : passes.
    batch_rows : rows a step.
    learning_rate : greatest step size.
    window_rows : rows of a window.
    random_state : seed of weights and order.

    Attributes
    ----------
    mean_, scale_ : (channels,) of the training rows.
    out_mean_, out_scale_ : of the target.
    weights_ : arrays of the network by name.
    validation_rmse_ : of every pass.

    References
    ----------
    Smith and Topin 2018, on one cycle of the step size.
    """

    def __init__(
        self,
        epochs: int = 40,
        batch_rows: int = 512,
        learning_rate: float = 0.003,
        window_rows: int = 1,
        random_state: int = 0,
    ) -> None:
        self.epochs = epochs
        self.batch_rows = batch_rows
        self.learning_rate = learning_rate
        self.window_rows = window_rows
        self.random_state = random_state

    def _network(self, channels: int) -> nn.Module:
        """Network from (n, window, channels) to (n,)."""
        raise NotImplementedError

    def fit(
        self,
        X: np.ndarray,
        y: np.ndarray,
        X_val: np.ndarray | None = None,
        y_val: np.ndarray | None = None,
    ) -> Self:
        """Fit the network; without validation rows the weights of the last pass are kept.

        Parameters
        ----------
        X, y : training rows (n, window_rows * channels) and targets (n,).
        X_val, y_val : the same for validation.
        """
        X, y = validate_data(self, X, y, dtype=np.float32, y_numeric=True)
        # with one thread, sums have one order: the same bits every time; torch's own switch for
        # that imports its compiler, 1.6 s of a job, and changes nothing on a processor
        torch.set_num_threads(1)
        torch.manual_seed(self.random_state)
        self._standardise(X, y)
        network = self._network(len(self.mean_))
        ahead = (
            None
            if X_val is None
            else (self._inputs(np.asarray(X_val, np.float32)), np.asarray(y_val, np.float32))
        )
        target = torch.from_numpy(((y - self.out_mean_) / self.out_scale_).astype(np.float32))
        self._descend(network, self._inputs(X), target, ahead)
        return self

    def _standardise(self, X: np.ndarray, y: np.ndarray) -> None:
        # a channel has one mean and one scale, wherever in the window a row stands
        rows = X.reshape(len(X) * self.window_rows, -1)
        # in double: sums of many squares in single precision lose digits
        scale, out_scale = rows.std(axis=0, dtype=np.float64), y.std(dtype=np.float64)
        self.mean_ = rows.mean(axis=0, dtype=np.float64).astype(np.float32)
        # a channel that never changes says nothing, and would be divided by zero
        self.scale_ = np.where(scale > 0, scale, 1.0).astype(np.float32)
        self.out_mean_ = np.float32(y.mean(dtype=np.float64))
        self.out_scale_ = np.float32(out_scale if out_scale > 0 else 1.0)

    def _inputs(self, X: np.ndarray) -> torch.Tensor:
        windows = X.reshape(len(X), self.window_rows, -1)
        return torch.from_numpy((windows - self.mean_) / self.scale_)

    def _descend(
        self, network: nn.Module, x: torch.Tensor, y: torch.Tensor, ahead: tuple | None
    ) -> None:
        batches = math.ceil(len(x) / self.batch_rows)
        optimiser = torch.optim.Adam(network.parameters(), lr=self.learning_rate)
        pace = torch.optim.lr_scheduler.OneCycleLR(
            optimiser, self.learning_rate, total_steps=self.epochs * batches
        )
        # a generator of its own: the order does not hang on how many weights torch has drawn
        order = np.random.default_rng(self.random_state)
        self.validation_rmse_: list[float] = []
        best = math.inf
        for _ in range(self.epochs):
            _one_pass(network, x, y, order.permutation(len(x)), self.batch_rows, optimiser, pace)
            error = self._error(network, ahead)
            if error < best or ahead is None:
                best, state = error, network.state_dict()
                self.weights_ = {k: v.detach().numpy().copy() for k, v in state.items()}

    def _error(self, network: nn.Module, ahead: tuple | None) -> float:
        if ahead is None:
            return math.nan
        # in the target's unit, in which the table of models scores
        error = self._outputs(network, ahead[0]) - ahead[1]
        self.validation_rmse_.append(float(np.sqrt(np.mean(error.astype(np.float64) ** 2))))
        return self.validation_rmse_[-1]

    def _outputs(self, network: nn.Module, x: torch.Tensor) -> np.ndarray:
        network.eval()
        with torch.no_grad():
            out = torch.cat([network(rows) for rows in x.split(PREDICT_ROWS)])
        return out.numpy() * self.out_scale_ + self.out_mean_

    def predict(self, X: np.ndarray) -> np.ndarray:
        """Return predictions of the target.

        Parameters
        ----------
        X : (n, window_rows * channels) rows.

        Returns
        -------
        (n,).
        """
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float32)
        torch.set_num_threads(1)
        network = self._network(len(self.mean_))
        network.load_state_dict({name: torch.from_numpy(w) for name, w in self.weights_.items()})
        return self._outputs(network, self._inputs(X))


def _one_pass(
    network: nn.Module,
    x: torch.Tensor,
    y: torch.Tensor,
    order: np.ndarray,
    batch_rows: int,
    optimiser: torch.optim.Optimizer,
    pace: torch.optim.lr_scheduler.LRScheduler,
) -> None:
    network.train()
    for start in range(0, len(order), batch_rows):
        rows = torch.from_numpy(order[start : start + batch_rows])
        optimiser.zero_grad()
        nn.functional.mse_loss(network(x[rows]), y[rows]).backward()
        optimiser.step()
        pace.step()


class MlpRegressor(NetworkRegressor):
    """Multilayer perceptron over the window's rows side by side, as the firmware flies it.

    Notes
    -----
    Two hidden layers of 64 and 32 rectified units.
    """

    def _network(self, channels: int) -> nn.Module:
        layers = (
            nn.Linear(channels * self.window_rows, 64),
            nn.ReLU(),
            nn.Linear(64, 32),
            nn.ReLU(),
            nn.Linear(32, 1),
        )
        return nn.Sequential(nn.Flatten(), *layers, nn.Flatten(0))


class _Lstm(nn.Module):
    def __init__(self, channels: int, units: int) -> None:
        super().__init__()
        self.cell = nn.LSTM(channels, units, batch_first=True)
        self.out = nn.Linear(units, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.out(self.cell(x)[0][:, -1])[:, 0]


class LstmRegressor(NetworkRegressor):
    """One LSTM layer, read out at the present row.

    References
    ----------
    Hochreiter and Schmidhuber 1997, Neural Computation 9.
    """

    def __init__(
        self,
        epochs: int = 20,
        batch_rows: int = 512,
        learning_rate: float = 0.005,
        window_rows: int = 1,
        random_state: int = 0,
        units: int = 32,
    ) -> None:
        super().__init__(epochs, batch_rows, learning_rate, window_rows, random_state)
        self.units = units

    def _network(self, channels: int) -> nn.Module:
        return _Lstm(channels, self.units)


class _Transformer(nn.Module):
    def __init__(self, channels: int, rows: int, units: int, heads: int, layers: int) -> None:
        super().__init__()
        self.embed = nn.Linear(channels, units)
        self.place = nn.Parameter(torch.zeros(rows, units))
        # the last layer stands apart, since of what it makes only the present row is read
        before = [_encoder_layer(units, heads) for _ in range(layers - 1)]
        self.before, self.last = nn.Sequential(*before), _encoder_layer(units, heads)
        self.out = nn.Linear(units, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.out(_present_row(self.last, self.before(self.embed(x) + self.place)))[:, 0]


def _encoder_layer(units: int, heads: int) -> nn.TransformerEncoderLayer:
    return nn.TransformerEncoderLayer(
        units, heads, 2 * units, dropout=0.0, batch_first=True, norm_first=True
    )


def _present_row(layer: nn.TransformerEncoderLayer, x: torch.Tensor) -> torch.Tensor:
    """Return the last row (n, units) of what a layer makes of x (n, rows, units).

    The other rows are left out: only this one is read.
    """
    # the encoder layer's own steps, norm first: x + attention(norm x), then + feedforward(norm);
    # keys and values of all rows, the query of the present one
    normed = layer.norm1(x)
    attended, _ = layer.self_attn(normed[:, -1:], normed, normed, need_weights=False)
    here = x[:, -1] + attended[:, 0]
    return here + layer.linear2(layer.activation(layer.linear1(layer.norm2(here))))


class TransformerRegressor(NetworkRegressor):
    """Transformer encoder with learned places, read out at the present row.

    References
    ----------
    Vaswani et al. 2017, *Attention is all you need*.
    """

    def __init__(
        self,
        epochs: int = 20,
        batch_rows: int = 512,
        learning_rate: float = 0.003,
        window_rows: int = 1,
        random_state: int = 0,
        units: int = 32,
        heads: int = 4,
        layers: int = 2,
    ) -> None:
        super().__init__(epochs, batch_rows, learning_rate, window_rows, random_state)
        self.units = units
        self.heads = heads
        self.layers = layers

    def _network(self, channels: int) -> nn.Module:
        return _Transformer(channels, self.window_rows, self.units, self.heads, self.layers)
