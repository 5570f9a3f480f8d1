"""Structure in residuals: does a smooth function of a regime variable predict a flight it never saw, and by chance how often?

The statistic is R^2 on flights left out. Its null flips the sign of whole blocks of time of what the prediction misses (as
ter Braak 1992 permutes residuals of the full model: signs of the signal itself would hide a strong one), which keeps
autocorrelation and flights. Over all channels and regimes together the largest standardised statistic counts (Westfall and
Young 1993), so that a set of flights without structure shows any at all with the stated probability. Residuals are taken as
they are: to a whitening filter a force that changes slowly along the flight would look like coloured noise, and go.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

KNOTS = 7
PLACE_KNOTS = 5
PLACE = ("east_m", "north_m")
DRAWS = 499
RIDGE = 3.0
LEAST_WINDOWS = 60
FEWEST_FLIGHTS = 3

Told = Sequence[Mapping[str, np.ndarray]]


@dataclasses.dataclass(frozen=True)
class Structure:
    """One channel over one regime (one variable, or a place: two).

    Attributes
    ----------
    low, high : by variable, where the prediction is largest.
    r2 : on flights left out.
    q_value : chance of so clear a structure anywhere, in flights without any.
    rms : of the prediction, in the channel's unit.
    """

    channel: str
    regime: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    r2: float
    q_value: float
    rms: float

    @property
    def bounds(self) -> dict[str, list[float]]:
        """``regime`` as the contract writes it."""
        return {name: [a, b] for name, a, b in zip(self.regime, self.low, self.high, strict=True)}


@dataclasses.dataclass(frozen=True)
class Basis:
    """Hats over the knots of a regime's variables for the windows in use, (n, K), and the normal equations by fold."""

    regime: tuple[str, ...]
    knots: tuple[np.ndarray, ...]
    x: np.ndarray
    gram: Mapping[int, np.ndarray]
    inverse: Mapping[int, np.ndarray]

    def peak(self, beta: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Bounds of the cell around the largest coefficient."""
        at = np.unravel_index(int(np.argmax(np.abs(beta))), [len(k) for k in self.knots])
        low = tuple(float(k[max(i - 1, 0)]) for i, k in zip(at, self.knots, strict=True))
        return low, tuple(float(k[min(i + 1, len(k) - 1)]) for i, k in zip(at, self.knots, strict=True))


def shared(told: Told) -> list[str]:
    """Regime variables that every flight has."""
    return [name for name in told[0] if all(name in t for t in told)]


def hats(value: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Piecewise-linear functions, 1 at one knot and 0 at all others, (n, K)."""
    return np.stack([np.interp(value, knots, row) for row in np.eye(len(knots))], axis=1)


def _basis(values: Mapping[str, np.ndarray], regime: tuple[str, ...], fold: np.ndarray) -> Basis | None:
    count = KNOTS if len(regime) == 1 else PLACE_KNOTS
    knots = tuple(np.unique(np.quantile(values[name], np.linspace(0.0, 1.0, count))) for name in regime)
    if min(len(k) for k in knots) < 3:
        return None
    x = hats(values[regime[0]], knots[0])
    for name, k in zip(regime[1:], knots[1:], strict=True):
        x = (x[:, :, None] * hats(values[name], k)[:, None, :]).reshape(len(x), -1)
    gram = {int(f): x[fold == f].T @ x[fold == f] for f in np.unique(fold)}
    total = sum(gram.values()) + RIDGE * np.eye(x.shape[1])
    return Basis(regime, knots, x, gram, {f: np.linalg.inv(total - g) for f, g in gram.items()})


def _regimes(names: Sequence[str]) -> list[tuple[str, ...]]:
    return [(name,) for name in names] + ([PLACE] if set(PLACE) <= set(names) else [])


def _fold_of_blocks(block: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """Fold of every block: its flight; thirds of the blocks where there are fewer than three flights."""
    numbers = np.arange(block.max(initial=-1) + 1)
    if len(np.unique(flight)) < FEWEST_FLIGHTS:
        return numbers % FEWEST_FLIGHTS
    of = np.zeros(len(numbers), dtype=int)
    of[block] = flight
    return of


def _gain(basis: Basis, y: np.ndarray, block: np.ndarray, fold_of: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """R^2 on folds left out, of ``y`` (n,) with its blocks' signs flipped as in ``signs`` (b, d); (d,)."""
    sums = np.stack([np.bincount(block, column * y, minlength=len(fold_of)) for column in basis.x.T], axis=1)
    right = {f: sums[fold_of == f].T @ signs[fold_of == f] for f in basis.gram}
    total, gain = sum(right.values()), 0.0
    for f, gram in basis.gram.items():
        beta = basis.inverse[f] @ (total - right[f])
        gain = gain + 2.0 * (beta * right[f]).sum(axis=0) - (beta * (gram @ beta)).sum(axis=0)
    return gain / max(float(y @ y), 1e-30)


def _missed(basis: Basis, y: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """What the prediction from the other folds leaves of ``y``."""
    left, total = y.copy(), basis.x.T @ y
    for f, inverse in basis.inverse.items():
        here = basis.x[fold == f]
        left[fold == f] -= here @ (inverse @ (total - here.T @ y[fold == f]))
    return left


def structures(raw: Sequence[np.ndarray], told: Told, names: Sequence[str], blocks: Sequence[np.ndarray],
               seed: int = 0) -> list[Structure]:  # fmt: skip
    """Test every channel over every regime.

    Parameters
    ----------
    raw : by flight, (m, C) residuals in the channels' units, NaN where a channel is absent.
    told : by flight, regime variables of every window, (m,) each.
    names : of the C channels.
    blocks : by flight, number of the block of time of every window.
    """
    values = {name: np.concatenate([t[name] for t in told]) for name in shared(told)}
    flight = np.concatenate([np.full(len(r), f) for f, r in enumerate(raw)])
    _, block = np.unique(np.concatenate(blocks), return_inverse=True)
    fold_of = _fold_of_blocks(block, flight)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (len(fold_of), DRAWS))
    kept: dict[bytes, list[Basis]] = {}
    tested, chance = [], []
    for c, channel in enumerate(names):
        e = np.concatenate([r[:, c] for r in raw])
        used = np.isfinite(e)
        fold = fold_of[block[used]]
        if used.sum() < LEAST_WINDOWS or len(np.unique(fold)) < 2:
            continue
        if used.tobytes() not in kept:
            bases = [_basis({n: v[used] for n, v in values.items()}, r, fold) for r in _regimes(list(values))]
            kept[used.tobytes()] = [b for b in bases if b is not None]
        for basis in kept[used.tobytes()]:
            found, draws = _tested(channel, basis, e[used], block[used], fold_of, signs)
            tested.append(found)
            chance.append(draws)
    return _judged(tested, np.array(chance))


def _tested(channel: str, basis: Basis, e: np.ndarray, block: np.ndarray, fold_of: np.ndarray, signs: np.ndarray):
    """One structure, its chance not known yet, and R^2 of its null draws."""
    size = max(float(np.sqrt(np.mean(e**2))), 1e-30)
    y = e / size
    r2 = float(_gain(basis, y, block, fold_of, np.ones((len(fold_of), 1)))[0])
    draws = _gain(basis, _missed(basis, y, fold_of[block]), block, fold_of, signs)
    beta = np.linalg.solve(sum(basis.gram.values()) + RIDGE * np.eye(basis.x.shape[1]), basis.x.T @ y)
    low, high = basis.peak(beta)
    rms = float(np.sqrt(np.mean((basis.x @ beta) ** 2))) * size
    return Structure(channel, basis.regime, low, high, r2, 1.0, rms), draws


def _judged(tested: Sequence[Structure], chance: np.ndarray) -> list[Structure]:
    """Chance that the largest standardised statistic of all tests reaches each one's."""
    if not tested:
        return []
    mean, sd = chance.mean(axis=1), np.maximum(chance.std(axis=1), 1e-12)
    largest = ((chance - mean[:, None]) / sd[:, None]).max(axis=0)
    z = (np.array([t.r2 for t in tested]) - mean) / sd
    q = [(1.0 + float((largest >= v).sum())) / (1.0 + len(largest)) for v in z]
    return [dataclasses.replace(t, q_value=v) for t, v in zip(tested, q, strict=True)]
