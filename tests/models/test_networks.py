"""Networks: the best pass on validation rows is kept, and the same seed gives the same bits."""

import numpy as np
import pytest
import torch

from ges.study.models import networks
from ges.study.models.networks import LstmRegressor, MlpRegressor, TransformerRegressor

RNG = np.random.default_rng(0)
X = RNG.normal(size=(400, 6 * 3)).astype(np.float32)
Y = X[:, -3] - 0.5 * X[:, 0] + 0.1 * RNG.normal(size=400)
KINDS = [
    MlpRegressor(epochs=40, batch_rows=64, learning_rate=0.01, window_rows=6, random_state=1),
    LstmRegressor(
        epochs=40, batch_rows=64, learning_rate=0.02, window_rows=6, random_state=1, units=8
    ),
    TransformerRegressor(
        epochs=40,
        batch_rows=64,
        learning_rate=0.01,
        window_rows=6,
        random_state=1,
        units=8,
        heads=2,
        layers=1,
    ),
]


@pytest.mark.parametrize("model", KINDS, ids=lambda m: type(m).__name__)
def test_learns_from_the_past_and_repeats_itself(model):
    first = model.fit(X[:300], Y[:300], X[300:], Y[300:]).predict(X)
    again = model.fit(X[:300], Y[:300], X[300:], Y[300:]).predict(X)
    assert np.array_equal(first, again)
    assert np.corrcoef(first[300:], Y[300:])[0, 1] > 0.85


def test_the_present_row_is_that_of_the_whole_layer():
    torch.manual_seed(3)
    network = networks._Transformer(channels=3, rows=6, units=8, heads=2, layers=2)
    x = torch.randn(5, 6, 3)
    whole = network.last(network.before(network.embed(x) + network.place))
    torch.testing.assert_close(network(x), network.out(whole[:, -1])[:, 0])


def test_keeps_the_weights_of_the_best_pass():
    """Validation rows of another law: every pass of learning makes them worse, so the first weights
    are kept, and all passes are made.
    """
    model = MlpRegressor(
        epochs=12, batch_rows=32, learning_rate=0.01, window_rows=6, random_state=1
    )
    model.fit(X[:300], Y[:300], X[300:], -3 * Y[300:])
    assert len(model.validation_rmse_) == 12 and int(np.argmin(model.validation_rmse_)) < 11
    kept = float(np.sqrt(np.mean((model.predict(X[300:]) + 3 * Y[300:]) ** 2)))
    assert kept == pytest.approx(min(model.validation_rmse_), rel=1e-5)
