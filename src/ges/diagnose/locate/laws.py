"""Terms of a law for residuals that no effect explains.

A term of :mod:`ges.simulator.laws` is a share of weight or thrust times a product of dimensionless
groups. A few are chosen by forward selection with exchange (Miller 2002, *Subset Selection in
Regression*, sec. 3.10). They are scored on blocks of time that they were not fitted to.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ges.conventions import POSITION
from ges.diagnose.design.residual import flown_columns, without_actuators
from ges.diagnose.design.system import System
from ges.diagnose.library.requirements import first_unmet
from ges.diagnose.select.search import log_odds_against_one_of
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator.laws import LAW, SCALES, Term

SPEEDS = ("V_x/v_h", "V_y/v_h", "V_z/v_h", "v_z/v_h")
HORIZONTAL = "V_h/v_h"
NEAR_GROUND = "R/h"
OTHERS = ("p/w_g", "q/w_g", "r/w_g", "x/L", "y/L")


def candidate_terms(channel: str, system: System) -> list[Term]:
    """Return the terms that these flights can show in a channel.

    Parameters
    ----------
    channel : response of the law, ``force_y``.
    system : of the flights.

    Notes
    -----
    Odd and even powers of speeds, products with the horizontal speed, powers of the nearness of the
    ground, and other groups alone. Rotor speeds are left out because they respond to the residual,
    see :mod:`~ges.diagnose.design.feedback`. So is the voltage, which falls with time and would
    predict any drift.
    """
    products = [
        *(({g: 1}, {}) for g in (*SPEEDS, HORIZONTAL, *OTHERS)),
        *((n, m) for g in SPEEDS for n, m in (({}, {g: 1}), ({g: 1}, {g: 1}), ({g: 2}, {}))),
        *(({g: 1, HORIZONTAL: 1}, {}) for g in SPEEDS),
        ({HORIZONTAL: 2}, {}),
        *(({NEAR_GROUND: n}, {}) for n in (1, 2, 3)),
        *(({g: 1, NEAR_GROUND: n}, {}) for g in (*SPEEDS, HORIZONTAL) for n in (1, 2)),
    ]
    # a constant as well: numbers and names may have taken up what a term is on average
    listed = [Term.of(channel, SCALES[0], {})]
    listed += [Term.of(channel, s, n, m) for s, (n, m) in itertools.product(SCALES, products)]
    listed += [Term.of(channel, SCALES[0], {}, near_m=place) for place in candidate_places(system)]
    return [t for t in listed if not first_unmet(t.needs, system.recordings, system.model)]


def candidate_places(system: System) -> list[tuple[float, float, float]]:
    """Return centres and widths of local terms that cover where the flights went.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    (x, y, width) in m, world; grids whose step is their width, halved from the extent of the
    flights.
    """
    x, y = _ground_track(system)
    across = max(float(np.ptp(x)), float(np.ptp(y)))
    places = []
    for halved in (2, 3, 4) if across > 0.0 else ():
        width = _round_place(across / 2**halved)
        cells = {
            (round(a / width), round(b / width))
            for a, b in zip(x.tolist(), y.tolist(), strict=True)
        }
        places += [
            (_round_place(a * width), _round_place(b * width), width) for a, b in sorted(cells)
        ]
    return places


def _ground_track(system: System) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y (m,) of all windows; one at the origin where no position was logged."""
    flights = [(r.windows.mean, r.flight.columns) for r in system.flights]
    if not all(c in columns for _, columns in flights for c in POSITION[:2]):
        return np.zeros(1), np.zeros(1)
    x, y = (np.concatenate([mean @ columns[c] for mean, columns in flights]) for c in POSITION[:2])
    return x, y


def neighbouring_terms(term: Term, system: System) -> list[Term]:
    """Return variations of a local term, over places where the flights went.

    The slope of a bell that stands elsewhere would be all that is seen of it, and its height a
    guess.

    Parameters
    ----------
    term : with a place.
    system : of the flights.

    Returns
    -------
    The term moved by half its width in each direction, with half, the same and twice its width.
    """
    x, y, width = term.near_m
    steps = itertools.product((-0.5, 0.0, 0.5), (-0.5, 0.0, 0.5), (0.5, 1.0, 2.0))
    places = [
        (_round_place(x + i * width), _round_place(y + j * width), _round_place(k * width))
        for i, j, k in steps
    ]
    along_x, along_y = _ground_track(system)
    return [
        dataclasses.replace(term, near_m=(a, b, w))
        for a, b, w in places
        if ((np.abs(along_x - a) <= 0.5 * w) & (np.abs(along_y - b) <= 0.5 * w)).any()
    ]


def _round_place(value: float) -> float:
    """Round to three digits: places are known no better, and people read them."""
    return float(f"{value:.3g}")


def term_columns(terms: Sequence[Term], system: System, model: Model) -> list[np.ndarray]:
    """Compute the windowed means of terms with a coefficient of one.

    Parameters
    ----------
    terms : of one channel.
    system : of the flights.
    model : whose air and ground the groups are computed with.

    Returns
    -------
    By flight, (m, terms) in N or N m.
    """
    columns = []
    for rows in system.flights:
        state = flown_columns(rows.flight, model, model.effects)
        samples = effect_table.Samples.from_columns(state)
        effects = {k: v for k, v in without_actuators(model.effects).items() if k != LAW}
        # averaged one by one: terms are many, and samples more than windows
        added = effect_table.each_term(terms, model.parameters, samples, effects, model.terrain)
        columns.append(np.stack([rows.windows.mean @ term for term in added], axis=1))
    return columns


@dataclasses.dataclass(frozen=True)
class SparseForm:
    """A few terms of one channel.

    Attributes
    ----------
    terms : that were chosen.
    r2 : share of the variance that they predict on blocks they were not fitted to.
    """

    terms: tuple[Term, ...]
    r2: float


@dataclasses.dataclass(frozen=True)
class RivalLaw:
    """A law of as many numbers as a name has, fitted in its place.

    Attributes
    ----------
    channel : response of the law, ``force_y``.
    coefficients : by term.
    log_odds : of the law over the name; negative where the name predicts more.
    """

    channel: str
    coefficients: Mapping[Term, float]
    log_odds: float


def sparse_form(
    e: Sequence[np.ndarray],
    x: Sequence[np.ndarray],
    terms: Sequence[Term],
    blocks: Sequence[np.ndarray],
) -> SparseForm:
    """Choose few terms that together explain a residual.

    Parameters
    ----------
    e : by flight, (m,) residual in the channel's unit, NaN where it is absent.
    x : by flight, (m, terms), of :func:`term_columns`.
    terms : of the channel.
    blocks : by flight, index of the block of time of every window, (m,).

    Returns
    -------
    The set with the greatest score of equation (12) of docs/method.md; no term where none is
    positive.
    """
    table = _Table.of(e, x, blocks)
    # every term tried is as likely as any other
    price = log_odds_against_one_of(table.count) + settings.statistics.acceptance_log_odds
    best, worth = SparseForm((), 0.0), 0.0
    for chosen, r2 in table.growing_sets(settings.report.terms):
        score = table.log_odds(chosen, r2) - len(chosen) * price
        if score > worth:
            best, worth = SparseForm(tuple(terms[table.moving[k]] for k in chosen), r2), score
    return best


def rival_law(
    channel: str,
    e: Sequence[np.ndarray],
    contribution: Sequence[np.ndarray],
    x: Sequence[np.ndarray],
    terms: Sequence[Term],
    blocks: Sequence[np.ndarray],
    numbers: int,
    rivals: int,
) -> RivalLaw:
    """Fit the law that could stand in a name's place.

    Parameters
    ----------
    channel : response of the law.
    e : by flight, (m,) residual of all but the name, in the channel's unit, NaN where it is absent.
    contribution : by flight, (m,) of the name.
    x, terms, blocks : as for :func:`sparse_form`.
    numbers : how many the name has fitted, and the law may have.
    rivals : names that were searched.

    References
    ----------
    Equation (13) of docs/method.md.
    """
    table = _Table.of(e, x, blocks)
    name = _Table.of(e, [a[:, None] for a in contribution], blocks)
    *_, (chosen, r2) = ((), 0.0), *table.growing_sets(numbers)
    named = (0,) if name.count else ()
    r2_of_name = float(name.folds.r2(np.array([named]))[0]) if named else 0.0
    # both by the same number of independent values, the smaller
    n = min(table.independent_count(chosen), name.independent_count(named))
    price = len(chosen) * log_odds_against_one_of(table.count) - log_odds_against_one_of(rivals)
    fitted = zip(chosen, table.coefficients(chosen).tolist(), strict=True)
    return RivalLaw(
        channel,
        {terms[table.moving[k]]: c for k, c in fitted},
        0.5 * n * (_log_missed(r2_of_name) - _log_missed(r2)) - price,
    )


def _log_missed(r2: float) -> float:
    """Return the log of the share of the variance that is missed."""
    return math.log(max(1.0 - r2, settings.numerics.tiny))


@dataclasses.dataclass(frozen=True)
class _Table:
    """A residual with terms that may explain it, over the usable windows of all flights.

    Attributes
    ----------
    y : (n,) residual.
    x : (n, K) terms that are not zero throughout.
    moving : (K,) their numbers among those given.
    flight : (n,) flight of every row.
    folds : normal equations by fold.
    """

    y: np.ndarray
    x: np.ndarray
    moving: np.ndarray
    flight: np.ndarray
    folds: _Folds

    @classmethod
    def of(
        cls, e: Sequence[np.ndarray], x: Sequence[np.ndarray], blocks: Sequence[np.ndarray]
    ) -> _Table:
        """Make it from residuals (m,), terms (m, K) and indices of blocks (m,), by flight."""
        good = [np.isfinite(of_flight) for of_flight in e]
        block = np.concatenate([b[g] for b, g in zip(blocks, good, strict=True)])
        # dealt out in turn, so that every fold spans all flights
        fold = np.unique(block, return_inverse=True)[1] % settings.statistics.folds
        y = np.concatenate([v[g] for v, g in zip(e, good, strict=True)])
        table = np.concatenate([v[g] for v, g in zip(x, good, strict=True)])
        size = np.sqrt(np.mean(table**2, axis=0))
        moving = np.flatnonzero(size > settings.numerics.small * size.max(initial=0.0))
        flight = np.repeat(np.arange(len(good)), [int(g.sum()) for g in good])
        folds = _Folds.of(table[:, moving] / size[moving], y, fold)
        return cls(y, table[:, moving], moving, flight, folds)

    @property
    def count(self) -> int:
        """Number of terms that move."""
        return len(self.moving)

    def growing_sets(self, most: int) -> Iterator[tuple[tuple[int, ...], float]]:
        """Return the best sets of one term, two and so on, with the R^2 that they predict."""
        chosen: tuple[int, ...] = ()
        # a term may predict little until another is in the set
        while len(chosen) < min(most, self.count):
            chosen, r2 = _exchange(self.folds, (*chosen, *self.folds.best_addition(chosen)))
            yield chosen, r2

    def coefficients(self, chosen: Sequence[int]) -> np.ndarray:
        """Return coefficients (k,) of some terms by least squares."""
        return np.linalg.lstsq(self.x[:, list(chosen)], self.y, rcond=None)[0]

    def log_odds(self, chosen: Sequence[int], r2: float) -> float:
        """Return the log predictive density of Gaussian errors over that of no term."""
        # equation (12) of docs/method.md
        return -0.5 * self.independent_count(chosen) * _log_missed(r2)

    def independent_count(self, chosen: Sequence[int]) -> float:
        """Return how many independent values the error of some terms has."""
        error = self.y - self.x[:, list(chosen)] @ self.coefficients(chosen)
        return _independent_count(error, self.flight)


def _independent_count(residual: np.ndarray, flight: np.ndarray) -> float:
    """Return the effective number of independent values of a residual (n,), n (1 - r) / (1 + r).

    r is the correlation from one window to the next within a flight (Bartlett 1946, J. R. Stat.
    Soc. Suppl. 8, 27).
    """
    same = flight[1:] == flight[:-1]
    power = max(float(residual @ residual), settings.numerics.tiny)
    r = float(np.clip((residual[1:] * residual[:-1])[same].sum() / power, 0.0, 1.0))
    return len(residual) * (1.0 - r) / (1.0 + r)


@dataclasses.dataclass(frozen=True)
class _Folds:
    """Normal equations by fold: (F, K, K), (F, K) and (F,)."""

    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, fold: np.ndarray) -> _Folds:
        """Make it from columns (n, K), a residual (n,) and the fold of every row (n,)."""
        each = [(x[fold == f], y[fold == f]) for f in np.unique(fold)]
        return cls(
            np.array([a.T @ a for a, _ in each]),
            np.array([a.T @ b for a, b in each]),
            np.array([b @ b for _, b in each]),
        )

    def r2(self, sets: np.ndarray) -> np.ndarray:
        """Return the share of the variance that fits to the other folds predict, (s,).

        ``sets`` of columns are (s, k).
        """
        xx, xy = self.xx[:, sets[:, :, None], sets[:, None, :]], self.xy[:, sets]
        others = xx.sum(axis=0) - xx + settings.statistics.ridge_windows * np.eye(sets.shape[1])
        beta = np.linalg.solve(others, (xy.sum(axis=0) - xy)[..., None])
        # |y|^2 - |y - x b|^2 = b'(2 x'y - x'x b)
        gain = (beta[..., 0] * (2.0 * xy - (xx @ beta)[..., 0])).sum(axis=(0, 2))
        return gain / max(float(self.yy.sum()), settings.numerics.tiny)

    def best_addition(self, chosen: tuple[int, ...]) -> tuple[int]:
        """Return the column that predicts most together with those chosen."""
        tried = [k for k in range(self.xy.shape[1]) if k not in chosen]
        return (tried[int(np.argmax(self.r2(np.array([(*chosen, k) for k in tried]))))],)


def _exchange(folds: _Folds, chosen: tuple[int, ...]) -> tuple[tuple[int, ...], float]:
    """Exchange single columns of a set while that predicts more; the set and its R^2."""
    r2 = float(folds.r2(np.array([chosen]))[0])
    while True:
        rests = [(*chosen[:i], *chosen[i + 1 :]) for i in range(len(chosen))]
        others = [(*rest, *folds.best_addition(rest)) for rest in rests]
        gained = folds.r2(np.array(others))
        if gained.max() <= r2 + settings.numerics.small:
            return chosen, r2
        chosen, r2 = others[int(np.argmax(gained))], float(gained.max())
