"""Terms of a law for what no effect explains.

Terms are those of :mod:`ges.simulator.laws`: a share of weight or thrust times a product of
dimensionless groups. Few of them are chosen by orthogonal matching (Pati et al. 1993), each kept
only while it predicts flights that it was not fitted to, or blocks of time where there is one
flight alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ges.diagnose.design.residual import but_actuators, model_along
from ges.diagnose.design.system import System
from ges.diagnose.library.requirements import unmet
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator.laws import LAW, SCALES, Term, along, groups

SPEEDS = ("V_x/v_h", "V_y/v_h", "V_z/v_h", "v_z/v_h")
HORIZONTAL = "V_h/v_h"
NEAR_GROUND = "R/h"
OTHERS = ("p/w_g", "q/w_g", "r/w_g", "x/L", "y/L", "w/w_h", "U/U_0")


def tried(channel: str, system: System) -> list[Term]:
    """Terms that these flights can speak about in a channel: speeds, with their squares and along
    with the horizontal speed, powers of the nearness of the ground and speeds near it, and what
    else there is, each alone.
    """
    products = [
        *(({g: 1}, {}) for g in (*SPEEDS, HORIZONTAL, *OTHERS)),
        *(({g: 1}, {g: 1}) for g in SPEEDS),
        *(({g: 1, HORIZONTAL: 1}, {}) for g in SPEEDS),
        ({HORIZONTAL: 2}, {}),
        *(({NEAR_GROUND: n}, {}) for n in (1, 2, 3)),
        *(({g: 1, NEAR_GROUND: n}, {}) for g in (*SPEEDS, HORIZONTAL) for n in (1, 2)),
    ]
    listed = [Term.of(channel, s, n, m) for s, (n, m) in itertools.product(SCALES, products)]
    return [t for t in listed if not unmet(t.needs, system.recordings, system.model)]


def columns(terms: Sequence[Term], system: System, model: Model) -> list[np.ndarray]:
    """Windowed means of what terms with a coefficient of one add, by flight (m, terms), N or N m.

    Parameters
    ----------
    model : along whose air and ground the groups are taken.
    """
    found = []
    for rows in system.flights:
        state, _ = model_along(rows.flight, model, model.effects)
        samples = effect_table.Samples.from_columns(state)
        effects = {k: v for k, v in but_actuators(model.effects).items() if k != LAW}
        found.append(
            rows.windows.mean @ along(terms, model.parameters, samples, effects, model.terrain)
        )
    return found


def sparse_terms(
    e: Sequence[np.ndarray],
    x: Sequence[np.ndarray],
    terms: Sequence[Term],
    blocks: Sequence[np.ndarray],
) -> tuple[list[Term], float]:
    """Choose few terms that together explain a residual; none where not even one does.

    Parameters
    ----------
    e : by flight, (m,) residual in the channel's unit, NaN where it is absent.
    x : by flight, (m, terms), of :func:`columns`.
    terms : of the channel.
    blocks : by flight, number of the block of time of every window, (m,).

    Returns
    -------
    the terms, and the share of the variance that they predict of what they were not fitted to.
    """
    good = [np.isfinite(of_flight) for of_flight in e]
    number = np.concatenate([np.full(g.sum(), f) for f, g in enumerate(good)])
    block = np.concatenate([b[g] for b, g in zip(blocks, good, strict=True)])
    several = len(np.unique(number)) > 1
    fold = (number if several else block) % settings.statistics.folds
    # a constant of each flight is its trim's, and no law's
    y = np.concatenate([v[g] - v[g].mean() for v, g in zip(e, good, strict=True) if g.any()])
    table = np.concatenate(
        [v[g] - v[g].mean(axis=0) for v, g in zip(x, good, strict=True) if g.any()]
    )
    size = np.sqrt(np.mean(table**2, axis=0))
    moving = size > settings.numerics.small * np.max(np.abs(table), initial=0.0)
    chosen: list[int] = []
    best = 0.0
    while len(chosen) < settings.report.terms and moving.any():
        left = y - table[:, chosen] @ _fit(table[:, chosen], y)
        # orthogonal matching: all chosen terms are fitted again before the next is matched
        match = np.where(moving, np.abs(left @ table) / np.where(moving, size, 1.0), -1.0)
        match[chosen] = -1.0
        more = [*chosen, int(np.argmax(match))]
        r2 = _r2(table[:, more], y, fold)
        if r2 < best + settings.statistics.least_gain:
            break
        chosen, best = more, r2
    return [terms[k] for k in chosen], best


def _fit(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(x, y, rcond=None)[0]


def _r2(x: np.ndarray, y: np.ndarray, fold: np.ndarray) -> float:
    """Share of the variance of ``y`` that fits on the other folds predict."""
    left = [y[fold == f] - x[fold == f] @ _fit(x[fold != f], y[fold != f]) for f in np.unique(fold)]
    return 1.0 - float(np.concatenate(left).var() / max(y.var(), settings.numerics.tiny))
