"""Closed-form Gaussian evidence of sets of candidate columns, with nuisances integrated out, common
and by flight.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from ges.diagnose.design.system import DesignColumn, System, nuisance_of, variant_of
from ges.diagnose.design.whiten import (
    NoiseModel,
    White,
    WhitePart,
    estimate_noise,
    variance_covariate,
    whiten,
)
from ges.diagnose.select.bounded import log_mass, log_mass_within
from ges.diagnose.settings import settings
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Gram:
    """Normal equations: ``xx`` (K, K), ``xy`` (K,), ``yy``, and the number of rows."""

    xx: np.ndarray
    xy: np.ndarray
    yy: float
    n: float

    def __add__(self, other: Gram) -> Gram:
        return Gram(self.xx + other.xx, self.xy + other.xy, self.yy + other.yy, self.n + other.n)

    def __sub__(self, other: Gram) -> Gram:
        return Gram(self.xx - other.xx, self.xy - other.xy, self.yy - other.yy, self.n - other.n)

    def scaled(self, factor: float) -> Gram:
        """Every row counted ``factor`` times."""
        return Gram(self.xx * factor, self.xy * factor, self.yy * factor, self.n * factor)

    def about(self, columns: np.ndarray, mean: np.ndarray) -> Gram:
        """With the coefficients of k columns counted from a mean (k,)."""
        # products with y - X mean in the place of y
        moved = self.xx[:, columns] @ mean
        return Gram(
            self.xx,
            self.xy - moved,
            self.yy - float(mean @ (2.0 * self.xy - moved)[columns]),
            self.n,
        )

    def without(self, drop: np.ndarray, sd: np.ndarray) -> Gram:
        """Columns ``drop`` (d,) integrated out under N(0, sd^2), sd (d,); they stay in place, as
        zero.
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
        """Only the columns ``keep`` (k,)."""
        return Gram(self.xx[np.ix_(keep, keep)], self.xy[keep], self.yy, self.n)


def gram_of(white: White, tempering: float = 1.0) -> Gram:
    """Normal equations of one whitened flight, every row counted ``tempering`` times, what a
    controller's answer may have done to them integrated out.
    """
    xx, xy, yy, n = np.zeros((white.count, white.count)), np.zeros(white.count), 0.0, 0.0
    for part in white.parts:
        gram = _of_part(part, tempering)
        xx[np.ix_(part.columns, part.columns)] += gram.xx
        xy[part.columns] += gram.xy
        yy, n = yy + gram.yy, n + gram.n
    return Gram(xx, xy, yy, n)


def _of_part(part: WhitePart, tempering: float) -> Gram:
    gram, answer = Gram(*part.products, float(len(part.at))).scaled(tempering), part.feedback_errors
    if not answer.shape[1]:
        return gram
    inner, cross, right = answer.T @ answer, part.x.T @ answer, answer.T @ part.y
    return _without_copies(gram, tempering * inner, tempering * cross, tempering * right)


def unanswered(part: WhitePart) -> tuple[np.ndarray, np.ndarray]:
    """Columns (n, k) and residuals (n,) weighted down along the answers, so that their products are
    those of :func:`gram_of`.
    """
    # (1 + A A^T)^(-1/2) for the answers A: 1 / sqrt(1 + s^2) along each left singular vector
    u, size, _ = np.linalg.svd(part.feedback_errors, full_matrices=False)
    lost = u * (1.0 - 1.0 / np.sqrt(1.0 + size**2))
    return part.x - lost @ (u.T @ part.x), part.y - lost @ (u.T @ part.y)


def _without_copies(gram: Gram, inner: np.ndarray, cross: np.ndarray, right: np.ndarray) -> Gram:
    """Further columns of unit prior sd integrated out: their products with themselves, with the
    columns, with the residual.
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
    """Normal equations by flight; what may differ from flight to flight is integrated out
    of each.
    """
    varies = np.array(
        [k for k, c in enumerate(columns) if c.nuisance is not None and c.nuisance.flight_sd > 0],
        dtype=int,
    )
    sd = np.array([nuisance_of(columns[k]).flight_sd for k in varies])
    return [without_deviations(gram_of(w, tempering), varies, sd) for w in whites]


def without_deviations(gram: Gram, varies: np.ndarray, sd: np.ndarray) -> Gram:
    """Marginalise a copy of the k varying columns (k,), of prior N(0, sd^2), keeping the originals
    (Woodbury).
    """
    if not len(varies):
        return gram
    # an own deviation is a copy of the column, scaled to unit sd, beside the common one
    return _without_copies(
        gram,
        gram.xx[np.ix_(varies, varies)] * np.outer(sd, sd),
        gram.xx[:, varies] * sd,
        gram.xy[varies] * sd,
    )


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Coefficients of a set of columns: mean, covariance, log evidence over the null."""

    columns: tuple[int, ...]
    mean: np.ndarray
    covariance: np.ndarray
    log_evidence: float

    @classmethod
    def of_nothing(cls) -> Posterior:
        """Of no column."""
        return cls((), np.zeros(0), np.zeros((0, 0)), 0.0)

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations, (k,), in the units of the coefficients."""
        return np.sqrt(np.diag(self.covariance))


@dataclasses.dataclass(frozen=True)
class Prior:
    """N(mean, sd^2) of every coefficient between ``low`` and ``high``, (K,) each."""

    mean: np.ndarray
    sd: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def take(self, keep: np.ndarray) -> Prior:
        """Only the columns ``keep`` (k,)."""
        return Prior(*(getattr(self, f.name)[keep] for f in dataclasses.fields(self)))


def acts_of(found: Posterior, names: Collection[str], system: System) -> np.ndarray:
    """What these effects add together by their coefficients, (m, C): windows of all flights, main
    channels, in the channels' units.
    """
    terms = {
        k: value
        for k, value in zip(found.columns, found.mean, strict=True)
        if variant_of(system.columns[k]).effect in names
    }
    return np.concatenate([r.weighted_columns(terms, len(system.main)) for r in system.flights])


def posteriors(
    gram: Gram,
    sets: Sequence[Sequence[int]] | np.ndarray,
    prior: Prior,
    more: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gaussian posteriors of sets of columns, all of one size; bounds count in the evidence alone.

    ``more`` is added to the normal equations of each, (s, k, k) and (s, k), and to their log
    evidence, (s,).

    Returns
    -------
    mean (s, k), covariance (s, k, k) and log evidence over the null (s,).
    """
    at = np.asarray(sets, dtype=int)
    scale, low, high = prior.sd[at], prior.low[at], prior.high[at]
    # in units of the prior's sd: the determinant of inner is that of Gamma A, (6) of docs/method.md
    start = prior.mean[at] / scale
    both = scale[:, :, None] * scale[:, None, :]
    xx, xy, known = more or (0.0, 0.0, 0.0)
    inner = np.eye(at.shape[1]) + (gram.xx[at[:, :, None], at[:, None, :]] + xx) * both
    right = (gram.xy[at] + xy) * scale + start
    covariance = np.linalg.inv(inner)
    mean = np.einsum("sij,sj->si", covariance, right)
    # the evidence gains the mass that bounds leave of the posterior over that of the prior
    low, high = low / scale, high / scale
    within = log_mass_within(low, high, mean, covariance) - log_mass(low - start, high - start).sum(
        axis=1
    )
    gain = 0.5 * (mean * right - start**2).sum(axis=1) + within
    return mean * scale, covariance * both, gain - 0.5 * np.linalg.slogdet(inner)[1] + known


def posterior(gram: Gram, columns: Sequence[int], prior: Prior) -> Posterior:
    """Of one set of columns."""
    if not len(columns):
        return Posterior.of_nothing()
    mean, covariance, log_evidence = posteriors(gram, [tuple(columns)], prior)
    return Posterior(tuple(int(k) for k in columns), mean[0], covariance[0], float(log_evidence[0]))


@dataclasses.dataclass(frozen=True)
class Regression:
    """Everything that the search needs: normal equations by flight and pooled, priors of the
    coefficients.
    """

    system: System
    noise: NoiseModel
    whites: tuple[White, ...]
    by_flight: tuple[Gram, ...]
    prior: Prior
    nuisance: np.ndarray

    def by_variant(self) -> dict[tuple[str, str], list[int]]:
        """Columns that the flights excite at all, by effect and variant."""
        found: dict[tuple[str, str], list[int]] = {}
        for k, column in enumerate(self.system.columns):
            if column.variant is not None and self.prior.sd[k] > 0:
                found.setdefault((column.variant.effect, column.variant.key), []).append(k)
        return found

    def pooled(self, but: Collection[int] = ()) -> Gram:
        """All flights, common nuisances integrated out ``but`` for some."""
        total = self.by_flight[0].scaled(0.0)
        for gram in self.by_flight:
            total = total + gram
        # what has no doubt over vehicles has nothing to integrate out, and 1 / sd^2 no value
        common = np.array(
            [k for k in self.nuisance if self.prior.sd[k] > 0 and k not in but], dtype=int
        )
        return total.about(common, self.prior.mean[common]).without(common, self.prior.sd[common])


def rms_of(system: System) -> np.ndarray:
    """Root mean square of every column in each main channel, (C, K), over all windows that have the
    channel.
    """
    square, count = np.zeros((len(system.main), len(system.columns))), np.zeros(len(system.main))
    for r in system.flights:
        there = np.isfinite(r.y[:, : len(count)])
        count += there.sum(axis=0)
        for c in range(len(count)):
            square[c, r.x.at[c]] += (r.x.values[c][there[:, c]] ** 2).sum(axis=0)
    return np.sqrt(square / np.maximum(count, 1.0)[:, None])


def _sizes(system: System, share: float) -> np.ndarray:
    """Prior scale of every candidate's coefficient, (K,): the size at which it makes ``share`` of
    weight (or of weight times arm) in its greatest channel, and no more than is plausible.
    """
    rms = rms_of(system)
    # an error of a rangefinder may be as large as its whole, not a share of it
    whole = np.array(
        [
            system.model.reference_scale(name) * (1.0 if name != "range" else 1.0 / share)
            for name in system.main
        ]
    )
    with np.errstate(divide="ignore"):
        # the least over channels is that of the channel where it acts most
        sizes = np.where(rms > 0, share * whole[:, None] / rms, np.inf).min(axis=0)
    return np.array(
        [_plausible(column, size) for column, size in zip(system.columns, sizes, strict=True)]
    )


def _plausible(column: DesignColumn, size: float) -> float:
    """The size where nothing better is known, but no more than half of its room in the library; 0
    where nothing shows it.
    """
    if column.variant is None or not np.isfinite(size):
        return 0.0
    a = column.variant.amplitudes[column.amplitude]
    # about a level the prior is as wide as the level itself
    if a.level:
        return abs(a.level)
    known = effect_table.get(column.variant.effect).parameter(a.parameter)
    plausible = known.plausible or size
    # half of the room on the wider side: two sds of the prior stay within the bounds there
    return min(
        plausible if known.corrects else min(plausible, size),
        0.5 * max(a.high - a.neutral, a.neutral - a.low),
    )


def make_regression(
    system: System,
    chosen: Sequence[int] = (),
    together: Mapping[int, float] = MappingProxyType({}),
) -> Regression:
    """Whiten and count, with the noise that columns leave, by what
    :func:`~ges.diagnose.design.whiten.noise_residuals` makes of them.
    """
    regression = whitened(system, estimate_noise(system, chosen, together))
    grams = flight_grams(regression.whites, system.columns, settings.evidence.tempering)
    return dataclasses.replace(regression, by_flight=tuple(grams))


def whitened(system: System, noise: NoiseModel) -> Regression:
    """Whiten with a known noise and count nothing: what a fit needs."""
    whites = whiten(system.flights, noise, variance_covariate(system.flights))
    nuisance = np.array(
        [k for k, c in enumerate(system.columns) if c.nuisance is not None], dtype=int
    )
    return Regression(system, noise, whites, (), _prior(system), nuisance)


def _prior(system: System) -> Prior:
    sd = _sizes(system, settings.evidence.prior_share)
    mean, low, high = np.array([_bounds(c) for c in system.columns]).T
    for k, column in enumerate(system.columns):
        if column.nuisance is not None:
            mean[k], sd[k] = column.nuisance.mean, column.nuisance.sd
        # it stands right behind the force's part of the same amplitude, and has its scale
        if column.part == "moment":
            sd[k] = sd[k - 1]
    return Prior(mean, sd, low, high)


def _bounds(column: DesignColumn) -> tuple[float, float, float]:
    """Level, lowest and highest coefficient: about the level, or what the effect's bounds leave."""
    # a moment's part is not how large the effect is, and the bounds of that say nothing of it
    if column.variant is None or column.part == "moment":
        return 0.0, -np.inf, np.inf
    a = column.variant.amplitudes[column.amplitude]
    if a.level:
        reach = settings.evidence.level_reach
        low, high = sorted((a.level / reach, a.level * reach))
        return a.level, low, high
    return 0.0, a.low - a.neutral, a.high - a.neutral
