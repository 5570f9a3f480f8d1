"""Structure in residuals: does a smooth function of a regime predict unseen blocks of time?

The statistic is R^2 on blocks of time left out, tested as the log of a ratio of variances. That has
no ceiling, which a strong structure would reach. Time and voltage run along with a flight, and
neighbouring blocks predict any drift. So of those whole flights are left out, where there are two.

The null flips signs of whole blocks of what the prediction misses, which keeps autocorrelation (ter
Braak 1992). The largest standardised statistic counts over all channels and regimes, and over
channels that one cause moves together (Westfall and Young 1993). Residuals are not whitened: a
filter would remove a force that changes slowly along the flight.

The same test of the logarithm of the residual's energy asks where its size depends on the regime.
Examples are a buffet, or a field whose direction turns faster than the regime resolves.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.sparse import csr_array

from ges.conventions import MAX_ROTORS, SDS_95, rotor_columns
from ges.diagnose.settings import settings

PLACE = ("east_m", "north_m")
RUNNING = frozenset({"time_s", "battery_V"})
TOGETHER = (
    ("force_x", "force_y", "acc_x", "acc_y"),
    ("force_z", "acc_z"),
    ("moment_x", "moment_y"),
    rotor_columns("drive_{}", MAX_ROTORS),
)
Regimes = Sequence[Mapping[str, np.ndarray]]


@dataclasses.dataclass(frozen=True)
class Structure:
    """One channel over one regime: one variable, or a place of two.

    Attributes
    ----------
    channel : name of the channel.
    regime : its variables.
    low, high : bounds by variable of the cell in which the prediction is largest.
    r2 : on blocks of time left out.
    q_value : chance of so clear a structure anywhere, in flights without any.
    rms : of the prediction, in the channel's unit. If ``of_size``, of the residual within the
        bounds, without the share that rows do not resolve.
    of_size : whether the residual's size depends on the regime, and not its mean.
    """

    channel: str
    regime: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    r2: float
    q_value: float
    rms: float
    of_size: bool = False

    @property
    def key(self) -> str:
        """Key in ``left_unexplained`` of a vehicle file: the channel, with ``_size`` for a size."""
        return f"{self.channel}_size" if self.of_size else self.channel

    @property
    def bounds(self) -> dict[str, list[float]]:
        """Bounds by variable, as the contract writes a regime."""
        return {name: [a, b] for name, a, b in zip(self.regime, self.low, self.high, strict=True)}


@dataclasses.dataclass(frozen=True)
class _Basis:
    """Hat functions over a regime for the n windows in use.

    Attributes
    ----------
    regime : its variables.
    knots : of each variable.
    x : (n, K) values of the functions.
    fold : (n,) fold of every window.
    fold_of : (b,) fold of every block of time.
    gram : normal equations by fold, (K, K).
    inverse : inverse of the normal equations without each fold, (K, K).
    """

    regime: tuple[str, ...]
    knots: tuple[np.ndarray, ...]
    x: np.ndarray
    fold: np.ndarray
    fold_of: np.ndarray
    gram: Mapping[int, np.ndarray]
    inverse: Mapping[int, np.ndarray]

    def peak(self, beta: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the bounds of the cell around the largest coefficient.

        Parameters
        ----------
        beta : (K,) coefficients.

        Returns
        -------
        Lower and upper bounds by variable, in its unit.
        """
        shape = tuple(len(k) for k in self.knots)
        at = [int(i) for i in np.unravel_index(int(np.argmax(np.abs(beta))), shape)]
        low = tuple(float(k[max(i - 1, 0)]) for i, k in zip(at, self.knots, strict=True))
        return low, tuple(
            float(k[min(i + 1, len(k) - 1)]) for i, k in zip(at, self.knots, strict=True)
        )


def pool_variables(regimes: Regimes) -> dict[str, np.ndarray]:
    """Pool the regime variables that every flight has.

    Parameters
    ----------
    regimes : by flight.

    Returns
    -------
    (m,) values over the windows of all flights in a row, by variable.
    """
    shared = [name for name in regimes[0] if all(name in t for t in regimes)]
    return {name: np.concatenate([t[name] for t in regimes]) for name in shared}


def hat_functions(value: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Return piecewise linear functions, 1 at one knot and 0 at the others.

    Parameters
    ----------
    value : (n,) of a regime variable.
    knots : (K,) in its unit.

    Returns
    -------
    (n, K).
    """
    return np.stack([np.interp(value, knots, row) for row in np.eye(len(knots))], axis=1)


def varied_regimes(values: Mapping[str, np.ndarray]) -> list[str]:
    """Return the regime variables that vary by more than a disturbance would move them.

    Parameters
    ----------
    values : by variable, (m,) in the unit of its name.
    """
    q = settings.statistics.extreme_quantile
    ends = {name: np.quantile(v, (q, 1.0 - q)) for name, v in values.items()}
    spread = {name: float(high - low) for name, (low, high) in ends.items()}
    return [name for name, s in spread.items() if s >= _least_spread(name, values[name])]


def _least_spread(name: str, values: np.ndarray) -> float:
    """Return the spread below which a variable was moved by the disturbance itself.

    A height has to vary by a large part of itself.
    """
    if name == "height_over_radius":
        return settings.locate.height_spread_least * float(np.median(values))
    return settings.numerics.tiny if name in RUNNING else settings.locate.spread_least


def _basis(
    values: Mapping[str, np.ndarray],
    regime: tuple[str, ...],
    block: np.ndarray,
    fold_of: np.ndarray,
) -> _Basis:
    fold = fold_of[block]
    q = settings.statistics.extreme_quantile
    # knots end at extreme quantiles: a rare excursion sets none, and the last hat stays at one
    spans = {name: np.quantile(values[name], (q, 1.0 - q)) for name in regime}
    knots = tuple(_knots(name, *span) for name, span in spans.items())
    x = hat_functions(values[regime[0]], knots[0])
    # a place: products of the hats of both axes, bilinear between knots
    for name, k in zip(regime[1:], knots[1:], strict=True):
        x = (x[:, :, None] * hat_functions(values[name], k)[:, None, :]).reshape(len(x), -1)
    # normal equations without a fold are the total less its own; one inverse serves every channel
    # and draw, and the ridge keeps knots that nobody visited at zero
    gram = {int(f): x[fold == f].T @ x[fold == f] for f in np.unique(fold)}
    total = sum(gram.values()) + settings.statistics.ridge_windows * np.eye(x.shape[1])
    return _Basis(
        regime,
        knots,
        x,
        fold,
        fold_of,
        gram,
        {f: np.linalg.inv(total - g) for f, g in gram.items()},
    )


def _knots(name: str, low: float, high: float) -> np.ndarray:
    """Return knots of a regime variable from its lowest to its highest value."""
    # what a ground does falls with powers of the height: equal ratios, not equal steps
    if name == "height_over_radius" and low > 0.0:
        return np.geomspace(low, high, settings.locate.knots)
    return np.linspace(low, high, settings.locate.knots)


def _cross_validated_r2(
    basis: _Basis, y: np.ndarray, of_block: csr_array, signs: np.ndarray
) -> np.ndarray:
    """Return R^2 on the folds left out, (C, d), of channels ``y`` (n, C) and d draws of signs.

    ``signs`` (b, d) flip blocks; ``of_block`` (b, n) sums rows by block.
    """
    # signs of blocks act on the blocks' sums of x y alone: one product makes all draws
    sums = np.stack([of_block @ (basis.x * channel[:, None]) for channel in y.T], axis=2).reshape(
        len(signs), -1
    )
    blocks = {f: basis.fold_of == f for f in basis.gram}
    right = {f: (sums[at].T @ signs[at]).reshape(basis.x.shape[1], -1) for f, at in blocks.items()}
    total, predicted = sum(right.values()), np.zeros(y.shape[1] * signs.shape[1])
    for f, gram in basis.gram.items():
        # power of a fold that the others' fit predicts: |y|^2 - |y - x b|^2 = b'(2 x'y - x'x b)
        beta = basis.inverse[f] @ (total - right[f])
        predicted = predicted + (beta * (2.0 * right[f] - gram @ beta)).sum(axis=0)
    return (
        predicted.reshape(y.shape[1], -1)
        / np.maximum((y**2).sum(axis=0), settings.numerics.tiny)[:, None]
    )


def _fold_residuals(basis: _Basis, y: np.ndarray) -> np.ndarray:
    """Return residuals of ``y`` (n, C) after prediction from the other folds."""
    missed, total = y.copy(), basis.x.T @ y
    for f, inverse in basis.inverse.items():
        at = basis.fold == f
        missed[at] -= basis.x[at] @ (inverse @ (total - basis.x[at].T @ y[at]))
    return missed


def structures(
    residuals: Sequence[np.ndarray],
    regimes: Regimes,
    names: Sequence[str],
    blocks: Sequence[np.ndarray],
    unresolved: Sequence[np.ndarray],
) -> list[Structure]:
    """Test mean and size of every channel over every regime, within the flights.

    Parameters
    ----------
    residuals : by flight, (m, C) in the channels' units, NaN where a channel is absent.
    regimes : by flight, regime variables of every window, (m,) each.
    names : of the C channels.
    blocks : by flight, index of the block of time of every window.
    unresolved : by flight, (m, C) variances that rows do not resolve, in squares of the units.

    Notes
    -----
    The mean of each flight is subtracted first: thrust and trims differ between flights.
    """
    residuals = [without_mean(r) for r in residuals]
    return [
        *_mean_structures(residuals, regimes, names, blocks),
        *_size_structures(residuals, regimes, names, blocks, unresolved),
    ]


def without_mean(e: np.ndarray) -> np.ndarray:
    """Return the residuals of one flight less their mean in every channel.

    Parameters
    ----------
    e : (m, C), NaN where a channel is absent.

    Returns
    -------
    (m, C).
    """
    good = np.isfinite(e)
    return e - np.where(good, e, 0.0).sum(axis=0) / np.maximum(good.sum(axis=0), 1)


def _mean_structures(
    residuals: Sequence[np.ndarray],
    regimes: Regimes,
    names: Sequence[str],
    blocks: Sequence[np.ndarray],
) -> list[Structure]:
    values = pool_variables(regimes)
    _, block = np.unique(np.concatenate(blocks), return_inverse=True)
    rng, folds = np.random.default_rng(settings.statistics.seed), settings.statistics.folds
    count = int(block.max(initial=-1)) + 1
    by_block = rng.permutation(count) % folds
    # the same signs for all channels and regimes: under the null the tests depend on each other
    # as they do in the flights, which the largest statistic needs
    signs = rng.choice([-1.0, 1.0], (count, settings.statistics.resamples))
    by_flight = np.zeros(count, dtype=int)
    by_flight[block] = np.repeat(np.arange(len(residuals)), [len(r) for r in residuals])
    e = np.concatenate(residuals)
    by_channel: dict[int, list[tuple[Structure, np.ndarray]]] = {}
    # channels that are there in the same windows share the basis and its inverses
    for channels in _channels_with_equal_windows(e):
        used = np.isfinite(e[:, channels[0]])
        here, at = {n: v[used] for n, v in values.items()}, block[used]
        # every fold has to have something to predict, and the others more windows than knots
        if used.sum() < folds * settings.locate.knots or len(np.unique(by_block[at])) < folds:
            continue
        several = len(np.unique(by_flight[at])) > 1
        of_block = csr_array((np.ones(len(at)), (at, np.arange(len(at)))), shape=(count, len(at)))
        varied = varied_regimes(here)
        places = [PLACE] if set(PLACE) <= set(varied) else []
        for regime in [*((name,) for name in varied), *places]:
            basis = _basis(
                here, regime, at, by_flight if several and regime[0] in RUNNING else by_block
            )
            tested = _test_channels(
                [names[c] for c in channels], basis, e[np.ix_(used, channels)], of_block, signs
            )
            for c, of_channel in zip(channels, tested, strict=True):
                by_channel.setdefault(c, []).append(of_channel)
    listed = [of_channel for c in sorted(by_channel) for of_channel in by_channel[c]]
    return _with_q_values(
        [tested for tested, _ in listed], np.array([draws for _, draws in listed])
    )


def _channels_with_equal_windows(e: np.ndarray) -> list[list[int]]:
    """Return groups of channels (columns of ``e``) that have the same windows."""
    groups: dict[bytes, list[int]] = {}
    for c, there in enumerate(np.isfinite(e).T):
        groups.setdefault(there.tobytes(), []).append(c)
    return list(groups.values())


def _size_structures(
    residuals: Sequence[np.ndarray],
    regimes: Regimes,
    names: Sequence[str],
    blocks: Sequence[np.ndarray],
    unresolved: Sequence[np.ndarray],
) -> list[Structure]:
    """Return the same test for the logarithm of the residuals' energy.

    Each flight's own mean is subtracted: air that is rougher in one flight is in no regime. A
    controller acts most where most happens, so rows resolve least there, and their share of the
    energy is none of a structure's. It is that of all rows: a moment that was wrong in one of them
    leaves rates that are wrong after it.
    """
    # one window's square is mostly scatter, its logarithm more so: a few are averaged first
    length = settings.design.response_windows
    energy = [
        uniform_filter1d(np.where(np.isfinite(r), r, 0.0) ** 2, length, axis=0) for r in residuals
    ]
    # in logarithms a factor of roughness is an offset, and the test of means serves
    logs = [
        np.where(np.isfinite(r), np.log(np.maximum(e, settings.numerics.tiny)), np.nan)
        for r, e in zip(residuals, energy, strict=True)
    ]
    values = pool_variables(regimes)
    structures = _mean_structures([without_mean(row) for row in logs], regimes, names, blocks)
    pooled, share = np.concatenate(energy), np.concatenate(unresolved).mean(axis=0)
    at = {name: c for c, name in enumerate(names)}
    return [
        _as_size_structure(s, pooled[:, at[s.channel]], float(share[at[s.channel]]), values)
        for s in structures
    ]


def _as_size_structure(
    structure: Structure, energy: np.ndarray, unresolved: float, values: Mapping[str, np.ndarray]
) -> Structure:
    """Return a structure of size, with the rms of the resolved residual within its bounds."""
    inside = np.ones(len(energy), bool)
    for name, (low, high) in structure.bounds.items():
        inside &= (values[name] >= low) & (values[name] <= high)
    resolved = float(energy[inside].mean()) - unresolved if inside.any() else 0.0
    return dataclasses.replace(structure, rms=max(resolved, 0.0) ** 0.5, of_size=True)


def _test_channels(
    names: Sequence[str], basis: _Basis, e: np.ndarray, of_block: csr_array, signs: np.ndarray
) -> list:
    """Return for every channel of ``e`` (n, C) its structure, and R^2 of the null draws.

    The structure has no q value yet.
    """
    size = np.maximum(np.sqrt(np.mean(e**2, axis=0)), settings.numerics.tiny)
    y = e / size
    r2 = _cross_validated_r2(basis, y, of_block, np.ones((len(signs), 1)))[:, 0]
    draws = _cross_validated_r2(basis, _fold_residuals(basis, y), of_block, signs)
    # once it is tested, all folds together show where it peaks and how large it is
    beta = np.linalg.solve(
        sum(basis.gram.values()) + settings.statistics.ridge_windows * np.eye(basis.x.shape[1]),
        basis.x.T @ y,
    )
    rms = np.sqrt(np.mean((basis.x @ beta) ** 2, axis=0)) * size
    return [
        (
            Structure(
                name, basis.regime, *basis.peak(beta[:, c]), float(r2[c]), 1.0, float(rms[c])
            ),
            draws[c],
        )
        for c, name in enumerate(names)
    ]


def _with_q_values(tested: Sequence[Structure], null_r2: np.ndarray) -> list[Structure]:
    """Return structures with the chance that the largest standardised statistic reaches theirs.

    The largest is taken over all tests, and over sums of channels that go together. The R^2 of null
    draws are by test, (tests, d).
    """
    if not tested:
        return []
    tiny = settings.numerics.tiny
    # column 0 is what was flown, the rest are null draws; a log of variances has no ceiling that
    # strong structures reach
    r2 = np.column_stack([np.array([t.r2 for t in tested]), null_r2])
    z = -np.log(np.maximum(1.0 - r2, tiny))
    # each test by its own null mean and sd
    mean, sd = z[:, 1:].mean(axis=1), np.maximum(z[:, 1:].std(axis=1), tiny)
    z = (z - mean[:, None]) / sd[:, None]
    # a cause that moves several channels is clear in their sum before it is in any of them
    groups = [at for at in _groups(tested) if len(at) > 1]
    joint = [z[at].sum(axis=0) for at in groups]
    every = np.vstack([z, *(((j - j[1:].mean()) / max(j[1:].std(), tiny))[None] for j in joint)])
    largest = every[:, 1:].max(axis=0)
    # a permutation test counts what was flown among the draws: its q is never zero
    q = np.array([(1.0 + float((largest >= v).sum())) / (1.0 + len(largest)) for v in every[:, 0]])
    for at, together in zip(groups, q[len(tested) :], strict=True):
        # only channels that lean that way themselves share in the chance of the sum
        clear = [i for i in at if z[i, 0] > SDS_95]
        q[clear] = np.minimum(q[clear], together)
    return [
        dataclasses.replace(t, q_value=float(v))
        for t, v in zip(tested, q[: len(tested)], strict=True)
    ]


def _groups(tested: Sequence[Structure]) -> list[list[int]]:
    """Return tests of one regime in channels that one cause moves together."""
    regimes = dict.fromkeys(t.regime for t in tested)
    return [
        [i for i, t in enumerate(tested) if t.regime == r and t.channel in names]
        for r in regimes
        for names in TOGETHER
    ]
