"""Residuals, columns and feedback errors whitened by the noise of their channels."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.linalg import toeplitz

from ges.diagnose.design.feedback import EndogenousPart, values_of
from ges.diagnose.design.noise import NoiseModel, rows_followed, rows_in_run
from ges.diagnose.design.system import FlightRows
from ges.diagnose.design.table import Indices
from ges.diagnose.settings import settings
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class Innovations:
    """What turns rows of g channels into innovations in units of their sd.

    Attributes
    ----------
    rows : by lag, the n rows that it takes; of one run without a gap a slice.
    lines : line of the weights for each of the n rows, or of all.
    weights : (g, l, p + 1) by number of known rows before, and by lag.
    sd : (g, n) of the innovations.
    """

    rows: tuple[np.ndarray | slice, ...]
    lines: np.ndarray | slice
    weights: np.ndarray
    sd: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return innovations (g, w, n) of w columns (g, w, m) for each channel."""
        weights = self.weights[:, None, self.lines]
        # a few columns at a time, so that they stay in the processor's cache
        several = 1 + settings.numerics.cached_numbers // (1 + x.shape[-1])
        innovations = np.empty((*x.shape[:2], self.sd.shape[-1]))
        for first in range(0, x.shape[1], several):
            some, own = x[:, first : first + several], innovations[:, first : first + several]
            np.multiply(weights[..., 0], some[..., self.rows[0]], out=own)
            for lag, at in enumerate(self.rows[1:], 1):
                own += weights[..., lag] * some[..., at]
            own /= self.sd[:, None]
        return innovations


Columns = tuple[tuple[np.ndarray, ...], ...]
"""By channel, columns before they are whitened, (m,) each."""


@dataclasses.dataclass(frozen=True)
class FeedbackErrors:
    """Columns of one kind that feedback may have made follow the disturbances, of g channels.

    Attributes
    ----------
    parts : j endogenous parts of each channel.
    bound : (g, j) of :func:`_error_bounds`.
    disturbance : (g,) of the channels, see :class:`NoiseModel`.
    """

    parts: tuple[Sequence[EndogenousPart], ...]
    bound: np.ndarray
    disturbance: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """Whitened columns times it (g, j) are errors of unit prior sd."""
        # (5) of docs/method.md: the correlation in sds of the noise, times the bound. Nothing is
        # known of it but that it lies between -1 and 1: uniform, of sd one over the root of three
        return self.bound * self.disturbance[:, None] / math.sqrt(3.0)


@dataclasses.dataclass(frozen=True)
class Errors:
    """Columns of unit prior sd that residuals of g channels may err along.

    Attributes
    ----------
    by_drive : (g, d, n) model errors of a drive, whitened.
    by_feedback : errors that feedback may have caused.
    filter_rows : what whitens columns (g, w, m).
    """

    by_drive: np.ndarray
    by_feedback: tuple[FeedbackErrors, ...]
    filter_rows: Callable[[np.ndarray], np.ndarray]

    def columns(self) -> np.ndarray:
        """Return the columns whitened, (g, j, n)."""
        errors = [
            _whitened_parts(self.filter_rows, e.parts) * e.size[..., None] for e in self.by_feedback
        ]
        return np.concatenate([self.by_drive, *errors], axis=1)

    def shrink(self, rows: np.ndarray) -> np.ndarray:
        """Return rows times (1 + A^T A)^(-1/2), for the errors A.

        Parameters
        ----------
        rows : (g, w, n), whitened.
        """
        directions = self._shrunk_directions
        return rows - (rows @ directions.swapaxes(1, 2)) @ directions

    @functools.cached_property
    def _shrunk_directions(self) -> np.ndarray:
        """B (g, r, n) of (1 + A^T A)^(-1/2) = 1 - B^T B, for errors A of rank r."""
        # A A^T = V s V^T, and B = (q + q^2)^(-1/2) V^T A with q^2 = 1 + s
        columns = self.columns()
        eigenvalues, v = np.linalg.eigh(columns @ columns.swapaxes(1, 2))
        # many numbers of a drive do the same: what no channel has beyond rounding goes
        most = eigenvalues.max(axis=1, initial=0.0)
        rounding = eigenvalues.shape[1] * np.finfo(float).eps * most
        kept = (eigenvalues > rounding[:, None]).any(axis=0)
        root = np.sqrt(1.0 + np.maximum(eigenvalues[:, kept], 0.0))
        return (v[:, :, kept] / np.sqrt(root * (1.0 + root))[:, None]).swapaxes(1, 2) @ columns


def _whitened_parts(
    filter_rows: Callable[[np.ndarray], np.ndarray], parts: Sequence[Sequence[EndogenousPart]]
) -> np.ndarray:
    """Return j endogenous parts of each of g channels whitened, (g, j, n)."""
    return filter_rows(np.stack([values_of(own) for own in parts]))


def _whitened(filter_rows: Callable[[np.ndarray], np.ndarray], columns: Columns) -> np.ndarray:
    """Return w columns of each of g channels whitened, (g, w, n)."""
    flat = [column for own in columns for column in own]
    return filter_rows(np.stack(flat).reshape(len(columns), len(columns[0]), -1))


@dataclasses.dataclass(frozen=True)
class WhiteGroup:
    """Channels of a whitened flight that have the same rows, columns and kinds of errors.

    Attributes
    ----------
    channels : indices of the g channels.
    at : (n,) usable rows.
    columns : (k,) indices of the columns that act there.
    y : (g, n) residuals of g channels.
    unfiltered : those k columns of each channel.
    innovations : what whitens columns (g, w, m).
    errors : that the residuals may have.
    log_sd : sum of the log sds of all innovations, in the units of the channels.
    first : the same channels in the first round of a fit, which all rounds share errors with.

    Notes
    -----
    Whitened columns are made where they are asked for: those of all candidates are many times as
    large as a long flight.
    """

    channels: tuple[int, ...]
    at: np.ndarray
    columns: np.ndarray
    y: np.ndarray
    unfiltered: Columns
    innovations: Callable[[np.ndarray], np.ndarray]
    errors: Errors
    log_sd: float = 0.0
    first: WhiteGroup | None = None

    def of(self, wanted: Indices) -> np.ndarray:
        """Return some whitened columns.

        Parameters
        ----------
        wanted : indices of w of the columns that act there.

        Returns
        -------
        (g, w, n).
        """
        at = np.searchsorted(self.columns, wanted)
        if not len(at):
            return np.zeros((len(self.y), 0, len(self.at)))
        picked = tuple(tuple(own[i] for i in at) for own in self.unfiltered)
        return _whitened(self.innovations, picked)

    @functools.cached_property
    def products(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Products of all columns that act there and the residuals, and with feedback errors.

        Columns with residuals behind them, times themselves, (g, k + 1, k + 1). Errors times
        errors, (g, j, j), and times those columns, (g, j, k + 1).
        """
        rows = np.concatenate([self.of(self.columns), self.y[:, None]], axis=1)
        errors, turned = self.errors.columns(), rows.swapaxes(1, 2)
        return rows @ turned, errors @ errors.swapaxes(1, 2), errors @ turned

    @functools.cached_property
    def shrunk(self) -> np.ndarray:
        """All columns that act there, whitened and shrunk along the errors, (g, k, n)."""
        return self.errors.shrink(self.of(self.columns))

    def shrunk_with_residuals(self, wanted: Indices) -> np.ndarray:
        """Return some columns and the residuals, whitened and shrunk along the errors.

        Parameters
        ----------
        wanted : indices of w of the columns that act there.

        Returns
        -------
        (g, w + 1, n). Their products are those that errors leave when they are integrated out.
        """
        first, indices = self.first or self, np.asarray(wanted, dtype=int)
        # columns that the first round had, too, are the same objects
        index_by_ids = {
            tuple(map(id, own)): i for i, own in enumerate(zip(*first.unfiltered, strict=True))
        }
        own = list(zip(*self.unfiltered, strict=True))
        at = np.array(
            [
                index_by_ids.get(tuple(map(id, own[k])), -1)
                for k in np.searchsorted(self.columns, indices)
            ],
            dtype=int,
        )
        rows = np.empty((len(self.y), len(indices) + 1, len(self.at)))
        known, new = np.flatnonzero(at >= 0), np.flatnonzero(at < 0)
        rows[:, known] = first.shrunk[:, at[known]]
        rows[:, np.r_[new, len(indices)]] = self.errors.shrink(
            np.concatenate([self.of(indices[new]), self.y[:, None]], axis=1)
        )
        return rows

    def with_feedback_errors(self, errors: FeedbackErrors) -> WhiteGroup:
        """Return a copy with more errors that feedback may have caused.

        Parameters
        ----------
        errors : to add.
        """
        by_feedback = (*self.errors.by_feedback, errors)
        return dataclasses.replace(
            self, errors=dataclasses.replace(self.errors, by_feedback=by_feedback)
        )


@dataclasses.dataclass(frozen=True)
class White:
    """One whitened flight.

    Attributes
    ----------
    groups : channels with usable rows, by what they have in common.
    count : number of all columns.
    """

    groups: tuple[WhiteGroup, ...]
    count: int

    def with_errors_of(self, other: White) -> White | None:
        """Return it with the errors of another one; None where their rows are not the same.

        Parameters
        ----------
        other : the same flight, whitened by the same noise.
        """
        pairs = list(zip(self.groups, other.groups, strict=False))
        same = len(self.groups) == len(other.groups) and all(
            one.channels == known.channels
            and np.array_equal(one.at, known.at)
            and np.array_equal(one.errors.by_drive, known.errors.by_drive)
            for one, known in pairs
        )
        groups = tuple(
            dataclasses.replace(one, errors=known.errors, first=known.first or known)
            for one, known in pairs
        )
        return White(groups, self.count) if same else None


def whiten(
    flights: Sequence[FlightRows],
    noise: NoiseModel,
    covariate: Sequence[np.ndarray],
    reuse: Sequence[White] = (),
) -> tuple[White, ...]:
    """Filter residuals and columns by the same noise model.

    Parameters
    ----------
    flights : rows by flight.
    noise : of the channels.
    covariate : by flight, (m,) of :func:`variance_covariate`.
    reuse : the same flights, whitened by the same noise with the same endogenous parts. They share
        their errors, where the rows are the same.

    Notes
    -----
    The first rows of a run on the ground are predicted by the few before them: take-offs are short.
    """
    short = any(not rows.air.all() for rows in flights)
    filters = [_prediction_filter(ar) if short else _full_filter(ar)[None] for ar in noise.ar]
    whites = tuple(
        each(lambda rows, u: _whiten_flight(rows, noise, filters, u), flights, covariate)
    )
    shared = [white.with_errors_of(known) for white, known in zip(whites, reuse, strict=False)]
    if reuse and all(shared):
        return tuple(white for white in shared if white)
    return _with_feedback_errors(flights, whites, noise)


def _with_feedback_errors(
    flights: Sequence[FlightRows], whites: Sequence[White], noise: NoiseModel
) -> tuple[White, ...]:
    """Return whitened flights with the errors that feedback may have caused."""
    powers = each(_power_of_endogenous, flights, whites)
    by_channels = [{group.channels: group for group in white.groups} for white in whites]
    # one kind of response has one cause over all flights and channels, so they are bounded
    # together; the disturbance is larger than the noise by all that chosen effects explain
    for kind in dict.fromkeys(kind for power in powers for kind, _ in power):
        of_kind = [{c: p for (k, c), p in power.items() if k == kind} for power in powers]
        for rows, own, bounds in zip(flights, by_channels, _error_bounds(of_kind), strict=True):
            for channels in [channels for channels in own if channels[0] in bounds]:
                parts, at = _acting_parts(rows, kind, channels)
                if at:
                    bound = np.stack([bounds[c][at] for c in channels])
                    errors = FeedbackErrors(parts, bound, noise.disturbance[list(channels)])
                    own[channels] = own[channels].with_feedback_errors(errors)
    return tuple(
        White(tuple(own.values()), white.count)
        for own, white in zip(by_channels, whites, strict=True)
    )


def _power_of_endogenous(rows: FlightRows, white: White) -> dict[tuple[str, int], np.ndarray]:
    """Return mean squares (j,) of the whitened endogenous parts, by kind and channel."""
    power: dict[tuple[str, int], np.ndarray] = {}
    for group in white.groups:
        channels = group.channels
        for kind in (kind for kind, channel in rows.endogenous if channel == channels[0]):
            parts, at = _acting_parts(rows, kind, channels)
            mean_squares = np.zeros((len(channels), len(rows.endogenous[kind, channels[0]])))
            if at:
                whitened = _whitened_parts(group.innovations, parts)
                mean_squares[:, at] = (whitened**2).mean(axis=2)
            power.update(((kind, c), own) for c, own in zip(channels, mean_squares, strict=True))
    return power


def _acting_parts(
    rows: FlightRows, kind: str, channels: Sequence[int]
) -> tuple[tuple[list[EndogenousPart], ...], list[int]]:
    """Return the endogenous parts of those columns that act on some of g channels.

    They come with their indices among all of the kind.
    """
    every = [list(rows.endogenous[kind, c].values()) for c in channels]
    at = [i for i, own in enumerate(zip(*every, strict=True)) if any(p.acts for p in own)]
    return tuple([own[i] for i in at] for own in every), at


def _error_bounds(power: Sequence[Mapping[int, np.ndarray]]) -> list[dict[int, np.ndarray]]:
    """Return how large errors are by endogenous parts of one kind, in those times the correlation.

    Parameters
    ----------
    power : mean squares of the whitened parts by flight and channel, (j,).

    Returns
    -------
    By flight and channel, (j,).

    Notes
    -----
    Feedback makes a column follow the disturbances. Its coefficient then errs by up to their
    correlation over the column's size in noise. The error has the same cause in every flight and
    channel. So those that share the column's power count as one.
    """
    every = [p for of_flight in power for p in of_flight.values()]
    # participation ratio: among how many flights and channels the column's power is shared
    shared_count = sum(every) ** 2 / np.maximum(sum(p**2 for p in every), settings.numerics.tiny)
    # (5) of docs/method.md: root mean square rho in sds of the noise, times the root of that number
    return [
        {
            c: np.sqrt(shared_count / np.maximum(p, settings.numerics.tiny))
            for c, p in of_flight.items()
        }
        for of_flight in power
    ]


def _whiten_flight(
    rows: FlightRows, noise: NoiseModel, filters: Sequence[np.ndarray], covariate: np.ndarray
) -> White:
    """Return a whitened flight, without errors that feedback may have caused."""
    groups: list[WhiteGroup] = []
    order, past = noise.ar.shape[1], rows_followed(rows.y, rows_in_run(rows.follows))
    # replays settle from a start that they guess
    later = rows.windows.center > (order + 1) * rows.windows.half
    opening = later & ~rows.air
    for channels in _channel_groups(rows, past, filters):
        c, listed = channels[0], list(channels)
        weights = np.stack([filters[c] for c in channels])
        at = np.flatnonzero(
            (past[:, c] >= order) | (past[:, c] >= 0) & opening & (weights.shape[1] > 1)
        )
        if not len(at):
            continue
        # (4) of docs/method.md: the innovation's sd grows with what a slow stream may hide
        growth = np.sqrt(1.0 + noise.growth[listed, None] * covariate[at] ** 2)
        innovations = _innovations(at, past[at, c], weights, noise.sd[listed, None] * growth)
        drive_errors = (
            innovations(np.array([[rows.drive_error[c]] for c in channels]))
            if c in rows.drive_error
            else np.zeros((len(channels), 0, len(at)))
        )
        # one filter for residual, columns and errors: y = X beta + e holds after it, with e white
        groups.append(
            WhiteGroup(
                channels,
                at,
                rows.x.at[c],
                innovations(rows.y[:, None, listed].T)[:, 0],
                tuple(rows.x.values[c] for c in channels),
                innovations,
                Errors(drive_errors, (), innovations),
                float(np.log(innovations.sd).sum()),
            )
        )
    return White(tuple(groups), rows.x.shape[2])


def _channel_groups(
    rows: FlightRows, past: np.ndarray, filters: Sequence[np.ndarray]
) -> list[tuple[int, ...]]:
    """Return the channels in groups of the same rows, columns and kinds of errors.

    Many small products of matrices take less time in one call.
    """
    groups: dict[tuple, list[int]] = {}
    errors: dict[int, list[tuple[str, int]]] = {}
    for (kind, c), parts in rows.endogenous.items():
        errors.setdefault(c, []).append((kind, len(parts)))
    for c, weights in enumerate(filters):
        in_common = (
            past[:, c].tobytes(),
            len(weights),
            rows.x.at[c].tobytes(),
            tuple(errors.get(c, ())),
            c in rows.drive_error,
        )
        groups.setdefault(in_common, []).append(c)
    return [tuple(group) for group in groups.values()]


def _full_filter(ar: np.ndarray) -> np.ndarray:
    """Return weights (p + 1,) of a row and the p before it that give its innovation."""
    return np.r_[1.0, -ar]


def _prediction_filter(ar: np.ndarray) -> np.ndarray:
    """Return weights (p + 1, p + 1) of the innovation of a row, by the rows before it.

    Line j has j rows before it.

    Each is in sds of one with a full past (Brockwell and Davis 1991, sec. 5.2). The last line
    stands alone where such noise would grow without bound.
    """
    order = len(ar)
    full, lag = _full_filter(ar), np.arange(order + 1)
    # Yule-Walker for the covariances g, in variances of the innovation:
    # sum_j a_j g(|i - j|) = 1 where i = 0, else 0
    of_lag = np.zeros((order + 1, order + 1))
    np.add.at(
        of_lag,
        (np.repeat(lag, order + 1), np.abs(lag[:, None] - lag).ravel()),
        np.tile(full, order + 1),
    )
    covariance = toeplitz(np.linalg.lstsq(of_lag, np.eye(order + 1)[0], rcond=None)[0])
    if np.linalg.eigvalsh(covariance)[0] <= settings.numerics.tiny:
        return full[None]
    # line j of the inverse Cholesky factor: a value less what the j before it predict, in sds
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    return np.stack(
        [np.r_[whitening[j, j::-1], np.zeros(order - j)] for j in range(order)] + [full]
    )


def _innovations(
    at: np.ndarray, past: np.ndarray, weights: np.ndarray, sd: np.ndarray
) -> Innovations:
    """Return what predicts the rows ``at`` from their ``past`` rows, over ``sd``."""
    # lines count from the last, the full filter, which may be the only one;
    # places before the known past repeat its first row, with weight zero
    order = weights.shape[2] - 1
    lags = np.minimum(past, order)
    if (lags == order).all() and at[-1] - at[0] == len(at) - 1:
        rows = tuple(slice(at[0] - lag, at[-1] + 1 - lag) for lag in range(order + 1))
        return Innovations(rows, slice(-1, None), weights, sd)
    before = tuple(at - np.minimum(lag, lags) for lag in range(order + 1))
    return Innovations(before, lags - order - 1, weights, sd)
