"""Closed-form Gaussian evidence of sets of candidate columns.

Nuisances are integrated out, common ones and those by flight; see section 7 of docs/method.md.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ges.diagnose.design.columns import DesignColumn, nuisance_of, variant_of
from ges.diagnose.design.noise import NoiseModel, estimate_noise, variance_covariate
from ges.diagnose.design.system import System
from ges.diagnose.design.whiten import White, WhiteGroup, whiten
from ges.diagnose.select.bounded import log_mass, log_mass_within
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class Gram:
    """Normal equations.

    Attributes
    ----------
    xx : (K, K) columns with columns.
    xy : (K,) columns with the residual.
    yy : residual with itself.
    n : number of rows.
    """

    xx: np.ndarray
    xy: np.ndarray
    yy: float
    n: float

    def __add__(self, other: Gram) -> Gram:
        return Gram(self.xx + other.xx, self.xy + other.xy, self.yy + other.yy, self.n + other.n)

    def __sub__(self, other: Gram) -> Gram:
        return Gram(self.xx - other.xx, self.xy - other.xy, self.yy - other.yy, self.n - other.n)

    def scale(self, factor: float) -> Gram:
        """Return the normal equations with every row counted several times.

        Parameters
        ----------
        factor : how many times; a pure number.
        """
        return Gram(self.xx * factor, self.xy * factor, self.yy * factor, self.n * factor)

    def about(self, columns: np.ndarray, mean: np.ndarray) -> Gram:
        """Return the normal equations with some coefficients counted from a mean.

        Parameters
        ----------
        columns : indices of k columns.
        mean : (k,) in the units of the coefficients.
        """
        # products with y - X mean in the place of y
        shift = self.xx[:, columns] @ mean
        return Gram(
            self.xx,
            self.xy - shift,
            self.yy - float(mean @ (2.0 * self.xy - shift)[columns]),
            self.n,
        )

    def without(self, drop: np.ndarray, sd: np.ndarray) -> Gram:
        """Integrate out some columns, which stay in place as zero.

        Parameters
        ----------
        drop : (d,) indices of the columns.
        sd : (d,) of their prior N(0, sd^2).
        """
        if not len(drop):
            return self
        # Schur complement: xx - x_d (x_dd + 1 / sd^2)^-1 x_d^T, and so xy and yy
        inner = self.xx[np.ix_(drop, drop)] + np.diag(1.0 / sd**2)
        gain = np.linalg.solve(inner, np.column_stack([self.xx[drop], self.xy[drop]]))
        xx = self.xx - self.xx[:, drop] @ gain[:, :-1]
        return Gram(
            xx,
            self.xy - self.xx[:, drop] @ gain[:, -1],
            self.yy - float(self.xy[drop] @ gain[:, -1]),
            self.n,
        )

    def take(self, keep: np.ndarray) -> Gram:
        """Return the normal equations of some columns.

        Parameters
        ----------
        keep : (k,) indices of the columns.
        """
        return Gram(self.xx[np.ix_(keep, keep)], self.xy[keep], self.yy, self.n)


def gram_of(white: White, tempering: float = 1.0) -> Gram:
    """Return the normal equations of a whitened flight, with feedback errors integrated out.

    Parameters
    ----------
    white : the flight.
    tempering : how many times every row counts; a pure number.
    """
    xx, xy, yy, n = np.zeros((white.count, white.count)), np.zeros(white.count), 0.0, 0.0
    for group in white.groups:
        gram = _gram_of_group(group, tempering)
        xx[np.ix_(group.columns, group.columns)] += gram.xx
        xy[group.columns] += gram.xy
        yy, n = yy + gram.yy, n + gram.n
    return Gram(xx, xy, yy, n)


def _gram_of_group(group: WhiteGroup, tempering: float) -> Gram:
    whole, inner, cross = (tempering * product for product in group.products)
    # Woodbury: (1 + C C^T)^-1 = 1 - C (1 + C^T C)^-1 C^T for the errors C
    whole = whole - cross.swapaxes(1, 2) @ np.linalg.solve(np.eye(inner.shape[1]) + inner, cross)
    count = tempering * float(group.y.size)
    return _gram_with_residuals(whole.sum(axis=0), count)


def _gram_with_residuals(products: np.ndarray, count: float) -> Gram:
    """Return normal equations from products of columns with the residual behind them."""
    return Gram(products[:-1, :-1], products[:-1, -1], float(products[-1, -1]), count)


def block_grams(white: White, wanted: np.ndarray, block: np.ndarray) -> list[Gram]:
    """Return normal equations by block of time, with feedback errors as in :func:`gram_of`.

    Parameters
    ----------
    white : the flight.
    wanted : indices of w columns.
    block : (m,) index of the block of every row.
    """
    blocks, block = np.unique(block, return_inverse=True)
    products = np.zeros((len(blocks), len(wanted) + 1, len(wanted) + 1))
    count = np.zeros(len(blocks))
    for group in white.groups:
        indices = np.flatnonzero(np.isin(wanted, group.columns))
        rows, own_block = group.shrunk_with_residuals(wanted[indices]), block[group.at]
        # rows of all channels side by side; they come in order of time, so that a block is one run
        rows, g = rows.transpose(1, 2, 0).reshape(rows.shape[1], -1), len(rows)
        first = np.flatnonzero(np.diff(own_block, prepend=-1))
        past = np.r_[first[1:], len(own_block)]
        runs = [rows[:, a:b] for a, b in zip(g * first, g * past, strict=True)]
        # the residual stands behind all columns
        at = np.r_[indices, len(wanted)]
        products[np.ix_(own_block[first], at, at)] += np.stack([own @ own.T for own in runs])
        count[own_block[first]] += g * (past - first)
    return [_gram_with_residuals(p, float(n)) for p, n in zip(products, count, strict=True)]


def _marginalise_copies(
    gram: Gram, inner: np.ndarray, cross: np.ndarray, right: np.ndarray
) -> Gram:
    """Integrate out further columns of unit prior sd.

    ``inner``, ``cross`` and ``right`` are their products with themselves, the columns, the
    residual.
    """
    # Woodbury: (1 + C C^T)^-1 = 1 - C (1 + C^T C)^-1 C^T for the further columns C
    gain = np.linalg.solve(np.eye(len(inner)) + inner, np.column_stack([cross.T, right]))
    return Gram(
        gram.xx - cross @ gain[:, :-1],
        gram.xy - cross @ gain[:, -1],
        gram.yy - float(right @ gain[:, -1]),
        gram.n,
    )


def flight_grams(
    whites: Sequence[White], columns: Sequence[DesignColumn], tempering: float
) -> list[Gram]:
    """Return the normal equations by flight, with what varies between flights integrated out.

    Parameters
    ----------
    whites : by flight.
    columns : of the design.
    tempering : how many times every row counts; a pure number.
    """
    varies = np.array(
        [k for k, c in enumerate(columns) if c.nuisance is not None and c.nuisance.flight_sd > 0],
        dtype=int,
    )
    sd = np.array([nuisance_of(columns[k]).flight_sd for k in varies])
    return each(lambda w: marginalise_deviations(gram_of(w, tempering), varies, sd), whites)


def marginalise_deviations(gram: Gram, varies: np.ndarray, sd: np.ndarray) -> Gram:
    """Integrate out each flight's own deviation of the varying columns, keeping the common ones.

    Parameters
    ----------
    gram : of one flight.
    varies : (k,) indices of the columns.
    sd : (k,) of the deviations N(0, sd^2).

    Notes
    -----
    A deviation is a copy of the column; both stand in Woodbury's identity.
    """
    if not len(varies):
        return gram
    # an own deviation is a copy of the column, scaled to unit sd, next to the common one
    return _marginalise_copies(
        gram,
        gram.xx[np.ix_(varies, varies)] * np.outer(sd, sd),
        gram.xx[:, varies] * sd,
        gram.xy[varies] * sd,
    )


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Coefficients of a set of columns.

    Attributes
    ----------
    columns : their numbers.
    mean : (k,).
    covariance : (k, k).
    log_evidence : over the null.
    """

    columns: tuple[int, ...]
    mean: np.ndarray
    covariance: np.ndarray
    log_evidence: float

    @classmethod
    def empty(cls) -> Posterior:
        """Return the posterior of no column.

        Returns
        -------
        With log evidence zero.
        """
        return cls((), np.zeros(0), np.zeros((0, 0)), 0.0)

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations, (k,), in the units of the coefficients."""
        return np.sqrt(np.diag(self.covariance))


@dataclasses.dataclass(frozen=True)
class Prior:
    """Truncated Gaussian prior of every coefficient, N(mean, sd^2) between bounds.

    Attributes
    ----------
    mean, sd, low, high : (K,) in the units of the coefficients.
    """

    mean: np.ndarray
    sd: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def take(self, keep: np.ndarray) -> Prior:
        """Return the prior of some columns.

        Parameters
        ----------
        keep : (k,) indices of the columns.
        """
        return Prior(*(getattr(self, f.name)[keep] for f in dataclasses.fields(self)))


def contribution_of(posterior: Posterior, names: Collection[str], system: System) -> np.ndarray:
    """Return what effects contribute by the coefficients of a posterior.

    Parameters
    ----------
    posterior : of the search.
    names : of the effects.
    system : of the flights.

    Returns
    -------
    (m, C) over the windows of all flights, main channels, in their units.
    """
    terms = {
        k: value
        for k, value in zip(posterior.columns, posterior.mean, strict=True)
        if variant_of(system.columns[k]).effect in names
    }
    return np.concatenate([r.weighted_columns(terms, len(system.main)) for r in system.flights])


def posteriors(
    gram: Gram,
    sets: Sequence[Sequence[int]] | np.ndarray,
    prior: Prior,
    more: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gaussian posteriors of sets of columns of one size.

    Parameters
    ----------
    gram : pooled normal equations.
    sets : s sets of k columns.
    prior : of all columns; bounds count in the evidence alone.
    more : added to the normal equations of each set, (s, k, k) and (s, k), and to its log evidence,
        (s,).

    Returns
    -------
    Mean (s, k), covariance (s, k, k) and log evidence over the null (s,).

    References
    ----------
    Equation (6) of docs/method.md.
    """
    at = np.asarray(sets, dtype=int)
    scale, low, high = prior.sd[at], prior.low[at], prior.high[at]
    # in units of the prior's sd: the determinant of inner is that of Gamma A, (6) of docs/method.md
    start = prior.mean[at] / scale
    outer = scale[:, :, None] * scale[:, None, :]
    xx, xy, more_evidence = more or (0.0, 0.0, 0.0)
    inner = np.eye(at.shape[1]) + (gram.xx[at[:, :, None], at[:, None, :]] + xx) * outer
    right = (gram.xy[at] + xy) * scale + start
    covariance = np.linalg.inv(inner)
    mean = np.einsum("sij,sj->si", covariance, right)
    # the evidence gains the mass that bounds leave of the posterior over that of the prior
    low, high = low / scale, high / scale
    within = log_mass_within(low, high, mean, covariance) - log_mass(low - start, high - start).sum(
        axis=1
    )
    gain = 0.5 * (mean * right - start**2).sum(axis=1) + within
    return (
        mean * scale,
        covariance * outer,
        gain - 0.5 * np.linalg.slogdet(inner)[1] + more_evidence,
    )


def posterior(gram: Gram, columns: Sequence[int], prior: Prior) -> Posterior:
    """Return the posterior of one set of columns.

    Parameters
    ----------
    gram : pooled normal equations.
    columns : indices of the columns.
    prior : of all columns.
    """
    if not len(columns):
        return Posterior.empty()
    mean, covariance, log_evidence = posteriors(gram, [tuple(columns)], prior)
    return Posterior(tuple(int(k) for k in columns), mean[0], covariance[0], float(log_evidence[0]))


@dataclasses.dataclass(frozen=True)
class Regression:
    """Whitened flights with normal equations and priors: all that a search needs.

    Attributes
    ----------
    system, noise : what was whitened, and by what.
    whites : by flight; empty where they are no longer needed.
    by_flight : normal equations; empty where they were not counted.
    rms : (C, K) of every column in each main channel, see :func:`rms_of`.
    prior : of all columns.
    nuisance : indices of the nuisance columns.
    """

    system: System
    noise: NoiseModel
    whites: tuple[White, ...]
    by_flight: tuple[Gram, ...]
    rms: np.ndarray
    prior: Prior
    nuisance: np.ndarray

    def by_variant(self) -> dict[tuple[str, str], list[int]]:
        """Return the columns that the flights excite.

        Returns
        -------
        Numbers of the columns by effect and variant.
        """
        columns: dict[tuple[str, str], list[int]] = {}
        for k, column in enumerate(self.system.columns):
            if column.variant is not None and self.prior.sd[k] > 0:
                columns.setdefault((column.variant.effect, column.variant.key), []).append(k)
        return columns

    def without_rows(self) -> Regression:
        """Return it without the flights, for what asks for columns and normal equations alone."""
        system = dataclasses.replace(self.system, flights=())
        return dataclasses.replace(self, system=system, whites=())

    def pool(self, but: Collection[int] = ()) -> Gram:
        """Return the normal equations of all flights, with common nuisances integrated out.

        Parameters
        ----------
        but : indices of nuisance columns that stay.
        """
        total = self.by_flight[0].scale(0.0)
        for gram in self.by_flight:
            total = total + gram
        # what has no sd over vehicles has nothing to integrate out, and 1 / sd^2 no value
        common = np.array(
            [k for k in self.nuisance if self.prior.sd[k] > 0 and k not in but], dtype=int
        )
        return total.about(common, self.prior.mean[common]).without(common, self.prior.sd[common])


def rms_of(system: System) -> np.ndarray:
    """Return the rms of every column in each main channel.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    (C, K) over all windows with the channel, in its unit over that of the coefficient.
    """
    square, count = np.zeros((len(system.main), len(system.columns))), np.zeros(len(system.main))
    for r in system.flights:
        there = np.isfinite(r.y[:, : len(count)])
        count += there.sum(axis=0)
        for c in range(len(count)):
            square[c, r.x.at[c]] += (r.x.all_of(c)[there[:, c]] ** 2).sum(axis=0)
    return np.sqrt(square / np.maximum(count, 1.0)[:, None])


def _prior_sds_of_candidates(system: System, rms: np.ndarray, share: float) -> np.ndarray:
    """Return prior sd of every candidate's coefficient, (K,).

    It is the size at which the column makes ``share`` of the reference scale in its greatest
    channel, and no more than is plausible. The rms of the columns is (C, K).
    """
    # an error of a rangefinder may be as large as its whole, not a share of it
    of_whole = [1.0 / share if name == "range" else 1.0 for name in system.main]
    scale = system.reference_scales * of_whole
    with np.errstate(divide="ignore"):
        # the least over channels is that of the channel where it acts most
        sizes = np.where(rms > 0, share * scale[:, None] / rms, np.inf).min(axis=0)
    return np.array(
        [_plausible_scale(column, size) for column, size in zip(system.columns, sizes, strict=True)]
    )


def _plausible_scale(column: DesignColumn, size: float) -> float:
    """Return the prior sd of one coefficient, at most half of the range that its parameter has.

    Zero where no flight shows the column.
    """
    if column.variant is None or not np.isfinite(size):
        return 0.0
    a = column.variant.amplitudes[column.amplitude]
    # about a level the prior is as wide as the level itself
    if a.level:
        return abs(a.level)
    descriptor = effect_table.get(column.variant.effect).parameter(a.parameter)
    plausible = descriptor.plausible or size
    # half of the room on the wider side: two sds of the prior stay within the bounds there
    return min(
        plausible if descriptor.corrects else min(plausible, size),
        0.5 * max(a.high - a.neutral, a.neutral - a.low),
    )


def make_regression(
    system: System,
    chosen: Sequence[int] = (),
    together: Mapping[int, float] = MappingProxyType({}),
) -> Regression:
    """Whiten a system and compute its normal equations.

    Parameters
    ----------
    system : of the flights.
    chosen, together : columns that do not count as noise, as for
        :func:`~ges.diagnose.design.whiten.noise_residuals`.
    """
    regression = whiten_system(system, estimate_noise(system, chosen, together))
    grams = flight_grams(regression.whites, system.columns, settings.evidence.tempering)
    return dataclasses.replace(regression, by_flight=tuple(grams))


def whiten_system(system: System, noise: NoiseModel, reuse: Sequence[White] = ()) -> Regression:
    """Whiten a system by a known noise, without normal equations: what a fit needs.

    Parameters
    ----------
    system : of the flights.
    noise : of its channels.
    reuse : as of :func:`~ges.diagnose.design.whiten.whiten`.
    """
    whites = whiten(system.flights, noise, variance_covariate(system.flights), reuse)
    nuisance = np.array(
        [k for k, c in enumerate(system.columns) if c.nuisance is not None], dtype=int
    )
    rms = rms_of(system)
    return Regression(system, noise, whites, (), rms, _prior(system, rms), nuisance)


def _prior(system: System, rms: np.ndarray) -> Prior:
    sd = _prior_sds_of_candidates(system, rms, settings.evidence.prior_share)
    mean, low, high = np.array([_bounds(c) for c in system.columns]).T
    for k, column in enumerate(system.columns):
        if column.nuisance is not None:
            mean[k], sd[k] = column.nuisance.mean, column.nuisance.sd
        # it stands right behind the force's part of the same amplitude, and has its scale
        if column.part == "moment":
            sd[k] = sd[k - 1]
    return Prior(mean, sd, low, high)


def _bounds(column: DesignColumn) -> tuple[float, float, float]:
    """Return level, lowest and highest coefficient.

    The bounds lie about the level, or are those of the effect's parameter.
    """
    # a moment's part is not how large the effect is, and the bounds of that say nothing of it
    if column.variant is None or column.part == "moment":
        return 0.0, -np.inf, np.inf
    a = column.variant.amplitudes[column.amplitude]
    if a.level:
        reach = settings.evidence.level_reach
        low, high = sorted((a.level / reach, a.level * reach))
        return a.level, low, high
    return 0.0, a.low - a.neutral, a.high - a.neutral
