"""Normal equations of whitened flights: added, counted from a mean, and with columns integrated
out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ges.diagnose.design.system import Column, nuisance_of
from ges.diagnose.design.whiten import Part, White


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


def gram_of(white: White, worth: np.ndarray | None = None) -> Gram:
    """Normal equations of one whitened flight, what a controller's answer may have done to them
    integrated out.

    Parameters
    ----------
    worth : how often a row of each channel counts, (C,); in full where not given.
    """
    xx, xy, yy, n = np.zeros((white.count, white.count)), np.zeros(white.count), 0.0, 0.0
    for part in white.parts:
        gram = _of_part(part, 1.0 if worth is None else float(worth[part.channel]))
        xx[np.ix_(part.columns, part.columns)] += gram.xx
        xy[part.columns] += gram.xy
        yy, n = yy + gram.yy, n + gram.n
    return Gram(xx, xy, yy, n)


def _of_part(part: Part, worth: float) -> Gram:
    gram, answer = Gram(*part.products, float(len(part.at))).scaled(worth), part.answer
    if not answer.shape[1]:
        return gram
    inner, cross, right = answer.T @ answer, part.x.T @ answer, answer.T @ part.y
    return _without_copies(gram, worth * inner, worth * cross, worth * right)


def unanswered(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Columns (n, k) and residuals (n,) weighted down along the answers, so that their products are
    those of :func:`gram_of`.
    """
    # (1 + A A^T)^(-1/2) for the answers A: 1 / sqrt(1 + s^2) along each left singular vector
    u, size, _ = np.linalg.svd(part.answer, full_matrices=False)
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
    whites: Sequence[White], columns: Sequence[Column], worth: np.ndarray
) -> list[Gram]:
    """Normal equations by flight, rows as often as they are ``worth`` (C,); what may differ from
    flight to flight is integrated out of each.
    """
    varies = np.array(
        [k for k, c in enumerate(columns) if c.nuisance is not None and c.nuisance.flight_sd > 0],
        dtype=int,
    )
    sd = np.array([nuisance_of(columns[k]).flight_sd for k in varies])
    return [without_deviations(gram_of(w, worth), varies, sd) for w in whites]


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
