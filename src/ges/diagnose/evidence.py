"""Closed-form Gaussian evidence of sets of candidate columns, with nuisances integrated out, common and by flight."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from .system import Column, System
from .whiten import Noise, White, estimate, unrest_of, whiten

TEMPERING = 0.25
SHARES_OF_DECLARED, WIDE_SHARE = frozenset({"thrust_scale", "inertia", "torque_coefficient"}), 0.3


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

    def without(self, drop: np.ndarray, sd: np.ndarray) -> Gram:
        """Columns ``drop`` integrated out under N(0, sd^2); they stay in place, as zero."""
        if not len(drop):
            return self
        inner = self.xx[np.ix_(drop, drop)] + np.diag(1.0 / sd**2)
        gain = np.linalg.solve(inner, np.column_stack([self.xx[drop], self.xy[drop]]))
        xx = self.xx - self.xx[:, drop] @ gain[:, :-1]
        return Gram(xx, self.xy - self.xx[:, drop] @ gain[:, -1], self.yy - float(self.xy[drop] @ gain[:, -1]), self.n)

    def take(self, keep: np.ndarray) -> Gram:
        """Only some columns."""
        return Gram(self.xx[np.ix_(keep, keep)], self.xy[keep], self.yy, self.n)


def gram_of(white: White) -> Gram:
    """Normal equations of one whitened flight."""
    k = white.x.shape[2]
    x, y = white.x.reshape(-1, k), white.y.ravel()
    return Gram(x.T @ x, x.T @ y, float(y @ y), float(white.used.sum()))


def flight_grams(whites: Sequence[White], columns: Sequence[Column], tempering: float) -> list[Gram]:
    """Normal equations by flight; what may differ from flight to flight is integrated out of each."""
    varies = np.array([k for k, c in enumerate(columns) if c.nuisance is not None and c.nuisance.flight_sd > 0], dtype=int)
    sd = np.array([columns[k].nuisance.flight_sd for k in varies])
    return [_with_flight_effects(gram_of(w).scaled(tempering), varies, sd) for w in whites]


def _with_flight_effects(gram: Gram, varies: np.ndarray, sd: np.ndarray) -> Gram:
    """Marginalise a copy of the varying columns, keeping the originals (Woodbury)."""
    if not len(varies):
        return gram
    inner = np.diag(1.0 / sd**2) + gram.xx[np.ix_(varies, varies)]
    cross = gram.xx[:, varies]
    gain = np.linalg.solve(inner, np.column_stack([cross.T, gram.xy[varies]]))
    return Gram(
        gram.xx - cross @ gain[:, :-1], gram.xy - cross @ gain[:, -1], gram.yy - float(gram.xy[varies] @ gain[:, -1]), gram.n
    )


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Coefficients of a set of columns: mean, covariance, log evidence over the null."""

    columns: tuple[int, ...]
    mean: np.ndarray
    covariance: np.ndarray
    log_evidence: float

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def posterior(gram: Gram, columns: Sequence[int], prior_sd: np.ndarray, one_sided: np.ndarray | None = None) -> Posterior:
    """Gaussian posterior of some columns under N(0, prior_sd^2); half-normal where ``one_sided``."""
    at = np.asarray(columns, dtype=int)
    scale = prior_sd[at]
    xx, xy = gram.xx[np.ix_(at, at)] * np.outer(scale, scale), gram.xy[at] * scale
    inner = np.eye(len(at)) + xx
    chol = np.linalg.cholesky(inner)
    half = np.linalg.solve(chol, xy)
    mean = np.linalg.solve(chol.T, half)
    covariance = np.linalg.inv(inner)
    log_evidence = 0.5 * float(half @ half) - float(np.log(np.diag(chol)).sum())
    if one_sided is not None and one_sided[at].any():
        z = mean / np.sqrt(np.diag(covariance))
        log_evidence += float((np.log(2.0) + norm.logcdf(z))[one_sided[at]].sum())
    return Posterior(tuple(int(k) for k in at), mean * scale, covariance * np.outer(scale, scale), log_evidence)


@dataclasses.dataclass(frozen=True)
class Board:
    """Everything that the search needs: normal equations by flight and pooled, prior scales, signs."""

    system: System
    noise: Noise
    whites: tuple[White, ...]
    by_flight: tuple[Gram, ...]
    prior_sd: np.ndarray
    one_sided: np.ndarray
    nuisance: np.ndarray

    def pooled(self, leave_out: int | None = None) -> Gram:
        """All flights (but one), common nuisances integrated out."""
        total = self.by_flight[0].scaled(0.0)
        for f, gram in enumerate(self.by_flight):
            total = total if f == leave_out else total + gram
        common = np.array([k for k in self.nuisance if self.prior_sd[k] > 0], dtype=int)
        return total.without(common, self.prior_sd[common])


def _size_of(column: Column, k: int, system: System, share: float) -> float:
    """Prior scale of a candidate's coefficient: the size at which it makes ``share`` of weight (or of weight times arm)."""
    model, scales = system.model, []
    unit = {"force": model.weight_N, "acc": model.weight_N, "moment": model.weight_N * model.arm_m,
            "drive": model.number("max_rotor_speed_rad_s"), "range": model.radius_m / share}  # fmt: skip
    for c, name in enumerate(system.names):
        values = np.concatenate([r.x[np.isfinite(r.x[:, c, k]), c, k] for r in system.flights])
        rms = float(np.sqrt((values**2).mean())) if len(values) else 0.0
        if rms > 0:
            scales.append(share * unit[name.split("_")[0]] / rms)
    return min(scales, default=0.0)


def make_board(system: System, chosen: Sequence[int] = (), tempering: float = TEMPERING, share: float = 0.05) -> Board:
    """Whiten and count, with the noise that the chosen columns leave."""
    noise = estimate(system, chosen)
    whites = tuple(whiten(r, noise, u) for r, u in zip(system.flights, unrest_of(system.flights), strict=True))
    grams = tuple(flight_grams(whites, system.columns, tempering))
    prior = np.array([c.nuisance.sd if c.nuisance else _size_of(c, k, system, share) for k, c in enumerate(system.columns)])
    for k, column in enumerate(system.columns):
        if column.variant is not None and column.variant.effect in SHARES_OF_DECLARED:
            prior[k] = min(prior[k], WIDE_SHARE)
        if column.part == "moment":
            prior[k] = prior[k - 1]
    sided = np.array([_one_sided(c) for c in system.columns])
    nuisance = np.array([k for k, c in enumerate(system.columns) if c.nuisance is not None], dtype=int)
    return Board(system, noise, whites, grams, prior, sided, nuisance)


def _one_sided(column: Column) -> bool:
    if column.variant is None or column.part == "moment":
        return False
    a = column.variant.amplitudes[column.amplitude]
    return a.low >= a.neutral
