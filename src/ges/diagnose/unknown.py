"""Structure that no candidate explains: does a smooth function of the regime predict a flight it never saw?"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from .evidence import Board
from .locate import regimes
from .model import Model

LEAST_R2 = 0.02
DRAWS = 200
BLOCK_S = 5.0
LEAST_SHARE = 0.004  # of weight and its like
RIDGE = 3.0


@dataclasses.dataclass(frozen=True)
class Unexplained:
    """One channel with structure left: regime that carries it, R^2 on flights left out, threshold, size."""

    channel: str
    regime: str
    low: float
    high: float
    r2: float
    threshold: float
    rms: float


def _features(value: np.ndarray, knots: np.ndarray, scale: float) -> np.ndarray:
    """Piecewise-linear hats over the knots, centred."""
    hats = np.stack([np.interp(value, knots, np.eye(len(knots))[k]) for k in range(len(knots))], axis=1)
    return hats * scale


def _folds(flights: int, blocks: np.ndarray, flight_of: np.ndarray) -> np.ndarray:
    """Fold of every window: its flight; thirds of the blocks where there are fewer than three flights."""
    return flight_of if flights >= 3 else blocks % 3


def _held_out_r2(x: np.ndarray, y: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """1 - press/total for every column of y, ridge, fold by fold; (k,)."""
    press = np.zeros(y.shape[1])
    for f in np.unique(fold):
        out = fold == f
        a = x[~out]
        beta = np.linalg.solve(a.T @ a + RIDGE * np.eye(x.shape[1]), a.T @ y[~out])
        press += ((y[out] - x[out] @ beta) ** 2).sum(axis=0)
    return 1.0 - press / np.maximum((y**2).sum(axis=0), 1e-30)


def left_over(board: Board, raw: Sequence[np.ndarray], model: Model, seed: int = 0) -> list[Unexplained]:
    """Test what the accepted model leaves, channel by channel and regime by regime.

    The null flips the sign of whole blocks of time, which keeps autocorrelation and flights; the threshold is what the null
    exceeds over all channels and regimes once in fifty times. Residuals are taken as they are: a force that changes slowly
    along the flight would look like coloured noise to a whitening filter, and go.

    Parameters
    ----------
    raw : by flight, (m, C) residuals in the channels' units that the accepted model leaves.
    """
    told = [regimes(r.flight, r.windows, model) for r in board.system.flights]
    shared = [name for name in told[0] if all(name in t for t in told)]
    flight_of = np.concatenate([np.full(len(r.windows), f) for f, r in enumerate(board.system.flights)])
    _, number = np.unique(np.concatenate(board.system.blocks(BLOCK_S)), return_inverse=True)
    rng = np.random.default_rng(seed)
    flips = rng.choice([-1.0, 1.0], (number.max() + 1, DRAWS))[number] if len(number) else np.zeros((0, DRAWS))
    fold = _folds(len(board.system.flights), number, flight_of)
    tested, nulls = [], []
    for c, channel in enumerate(board.system.names):
        e = np.concatenate([left[:, c] for left in raw])
        used = np.isfinite(e)
        if used.sum() < 60 or len(np.unique(fold[used])) < 2:
            continue
        for name in shared:
            value = np.concatenate([t[name] for t in told])[used]
            knots = np.unique(np.quantile(value, np.linspace(0, 1, 7)))
            if len(knots) < 3:
                continue
            x = _features(value, knots, 1.0)
            y = np.column_stack([e[used], e[used][:, None] * flips[used]]) / max(float(np.std(e[used])), 1e-30)
            r2 = _held_out_r2(x, y, fold[used])
            beta = np.linalg.solve(x.T @ x + RIDGE * np.eye(x.shape[1]), x.T @ y[:, 0])
            peak = int(np.argmax(np.abs(beta)))
            sd = float(np.std(e[used]))
            tested.append(Unexplained(channel, name, float(knots[max(peak - 1, 0)]), float(knots[min(peak + 1, len(knots) - 1)]),
                                      float(r2[0]), 0.0, float(np.sqrt(np.mean((x @ beta) ** 2)) * sd)))  # fmt: skip
            nulls.append(r2[1:])
    if not tested:
        return []
    threshold = max(LEAST_R2, float(np.quantile(np.max(nulls, axis=0), 0.98)))
    least = {name: LEAST_SHARE * model.whole(name) for name in board.system.names}
    fired = [dataclasses.replace(t, threshold=threshold) for t in tested if t.r2 > threshold and t.rms > least[t.channel]]
    return _worst_by_channel(fired)


def _worst_by_channel(fired: Sequence[Unexplained]) -> list[Unexplained]:
    best: dict[str, Unexplained] = {}
    for t in fired:
        if t.channel not in best or t.r2 > best[t.channel].r2:
            best[t.channel] = t
    return sorted(best.values(), key=lambda t: -t.r2)
