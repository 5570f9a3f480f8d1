"""What others do with the same recordings: stepwise p-values, sparse regression, a fit of all
parameters, a black box.

All get the residuals, candidate columns and held-out flights of ``ges.diagnose``, which is
generous; they differ in how they choose. Each answers in the contract's form.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable

import numpy as np

from ges.blind.protocol import arithmetic
from ges.diagnose.design.columns import DesignColumn, nuisance_of, variant_of
from ges.diagnose.design.system import System, build
from ges.diagnose.library.grids import library
from ges.diagnose.prepare.channels import unit_of
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.prepare.split import digest, split
from ges.diagnose.types.model import from_vehicle
from ges.errors import GesError
from ges.recordings.recording import RecordingSet
from ges.simulator import effects as effect_table

P_VALUE = 0.05
MOST_TERMS = 12
THRESHOLDS = np.geomspace(0.003, 0.5, 12)
OUTSIDE_SD = 3.0
BOOSTED_ROWS = 3000


@dataclasses.dataclass(frozen=True)
class BaselineRows:
    """Stacked rows of some flights.

    Channels are in units of their spread on the training flights.

    Attributes
    ----------
    y, raw : (n,) residual after and before calibration.
    x : (n, k) columns of the candidates.
    nuisance : (n, m) columns of nominal parameters, trims and biases.
    state : (n, f) logged channels at the centre of each window.
    channel, flight : (n,) numbers of channel and flight.
    """

    y: np.ndarray
    raw: np.ndarray
    x: np.ndarray
    nuisance: np.ndarray
    state: np.ndarray
    channel: np.ndarray
    flight: np.ndarray


@dataclasses.dataclass(frozen=True)
class BaselineProblem:
    """A case as the baselines see it.

    Attributes
    ----------
    names : channels.
    scale : (channels,) spread on the training flights.
    candidates, nuisances : what the columns stand for.
    train, held_out : rows of the flights.
    holdout : names of the held-out flights.
    """

    names: tuple[str, ...]
    scale: np.ndarray
    candidates: tuple[DesignColumn, ...]
    nuisances: tuple[DesignColumn, ...]
    train: BaselineRows
    held_out: BaselineRows
    holdout: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class BaselineClaim:
    """What a baseline states of a name.

    Attributes
    ----------
    probability : 0 to 1.
    statistic : what it was chosen by.
    """

    probability: float
    statistic: float


FittedMethod = tuple[dict[str, BaselineClaim], Callable[[BaselineRows], np.ndarray]]


def prepare(recordings: RecordingSet) -> BaselineProblem:
    """Return residuals and columns of the training and the held-out flights.

    Residuals are calibrated within the prior sds.

    Raises
    ------
    GesError
        When the held-out flight has other channels than the training flights.
    """
    model = from_vehicle(recordings.vehicle, recordings.folder)
    frames = [f.frame for f in recordings.flights]
    gate = pass_gate(frames, model)
    train, held_out = split([digest(f) for f in frames], list(gate.flights), None)
    # one shape an effect; what acts through another effect alone has no column without it
    variants = [c.variants[0] for c in library(model).values() if not c.prerequisites]
    parts = [build([gate.flights[i] for i in part], model, variants) for part in (train, held_out)]
    first = parts[0]
    if parts[1].names != first.names:
        raise GesError(
            "the held-out flight has other channels than the training flights; a baseline cannot"
            " use them"
        )
    # channels of different units weigh alike
    scale = np.array(
        [
            np.nanstd(np.concatenate([f.y[:, c] for f in first.flights])) or 1.0
            for c in range(len(first.names))
        ]
    )
    free = np.array([c.nuisance is not None for c in first.columns])
    rows = [_stack(system, scale, free) for system in parts]
    # a prior sd for each flight counts as one for all
    sd = np.array(
        [max(c.nuisance.sd, c.nuisance.flight_sd) for c in first.columns if c.nuisance is not None]
    )
    # maximum a posteriori with unit noise and the prior N(0, sd^2): (X' X + S^-2) b = X' y
    x = rows[0].nuisance
    beta = np.linalg.solve(x.T @ x + np.diag(1.0 / sd**2), x.T @ rows[0].raw)
    train_rows, held_out_rows = (dataclasses.replace(r, y=r.raw - r.nuisance @ beta) for r in rows)
    columns = np.array(first.columns, dtype=object)
    names = tuple(recordings.flights[i].name for i in held_out)
    return BaselineProblem(
        first.names,
        scale,
        tuple(columns[~free]),
        tuple(columns[free]),
        train_rows,
        held_out_rows,
        names,
    )


def _stack(system: System, scale: np.ndarray, free: np.ndarray) -> BaselineRows:
    parts = []
    for number, rows in enumerate(system.flights):
        m, c = rows.y.shape
        states = np.stack([v[rows.windows.center] for v in rows.flight.columns.values()], axis=1)
        channel = np.tile(np.arange(c), m)
        # rows of one window follow each other, a channel each
        every = np.arange(len(system.columns))
        x = np.stack([rows.x.of(i, every) / scale[i] for i in range(c)], axis=1).reshape(m * c, -1)
        y = (rows.y / scale).ravel()
        good = np.isfinite(y)
        parts.append((y, x, np.repeat(states, c, axis=0), channel, np.full(m * c, number), good))
    # a flight may have logged more than another; one table needs one width
    width = min(p[2].shape[1] for p in parts)
    y, x, state, channel, flight = (
        np.concatenate([(p[k][:, :width] if k == 2 else p[k])[p[5]] for p in parts])
        for k in range(5)
    )
    return BaselineRows(y, y, x[:, ~free], x[:, free], state, channel, flight)


def stepwise(problem: BaselineProblem) -> FittedMethod:
    """Select forward at p < 0.05, rows taken as independent.

    Returns
    -------
    Claims by effect, with 1 - p and the t value, and the prediction of the residual from rows.
    """
    from scipy.stats import t as student

    rows = problem.train
    kept: list[int] = []
    claims: dict[str, BaselineClaim] = {}
    x, y = rows.x.copy(), rows.y.copy()
    while len(kept) < MOST_TERMS:
        # projections on the columns; of one that the kept explain only rounding is left
        norm = np.linalg.norm(x, axis=0)
        fit = np.where(
            norm > 1e-6 * np.linalg.norm(rows.x, axis=0), x.T @ y / np.maximum(norm, 1e-30), 0.0
        )
        best = int(np.argmax(np.abs(fit)))
        freedom = len(y) - len(kept) - 1
        # t value of the last coefficient: the projection over the sd of what it leaves
        statistic = float(abs(fit[best]) / np.sqrt((y @ y - fit[best] ** 2) / freedom))
        p_value = float(2.0 * student.sf(statistic, freedom))
        if not p_value < P_VALUE:
            break
        kept.append(best)
        claims.setdefault(
            variant_of(problem.candidates[best]).effect, BaselineClaim(1.0 - p_value, statistic)
        )
        # Gram and Schmidt: what is kept is taken out of all columns and of the residual
        unit = x[:, best] / norm[best]
        x, y = x - np.outer(unit, unit @ x), y - unit * (unit @ y)
    beta = np.linalg.lstsq(rows.x[:, kept], rows.y, rcond=None)[0] if kept else np.zeros(0)
    return claims, lambda r: r.x[:, kept] @ beta


def sindy(problem: BaselineProblem) -> FittedMethod:
    """Fit by sequentially thresholded least squares of pysindy.

    The threshold is chosen by leaving one flight out. A flight's rows are passed as their
    triangular factor, which has the same least squares.

    Returns
    -------
    Claims by effect, with the scaled coefficient, and the prediction of the residual from rows.

    References
    ----------
    Brunton, Proctor and Kutz 2016, PNAS 113, on which pysindy's STLSQ is built.
    """
    from pysindy.optimizers import STLSQ

    rows = problem.train
    # one threshold for all needs columns of one size
    size = np.sqrt((rows.x**2).mean(axis=0))
    size[size == 0.0] = 1.0
    flights = np.unique(rows.flight)
    packed = {
        f: np.linalg.qr(np.column_stack([rows.x / size, rows.y])[rows.flight == f], mode="r")
        for f in flights
    }

    def fit(chosen: np.ndarray, threshold: float) -> np.ndarray:
        table = np.concatenate([packed[f] for f in chosen])
        optimizer = STLSQ(threshold=threshold, alpha=1e-3, max_iter=20)
        optimizer.fit(table[:, :-1], table[:, -1:])
        return np.ravel(optimizer.coef_)

    def error(threshold: float) -> float:
        # |R [-b, 1]| = |y - X b| of the flight that was left out
        residuals = [
            packed[f] @ np.r_[-fit(flights[flights != f], threshold), 1.0] for f in flights
        ]
        return float(sum(e @ e for e in residuals))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        beta = (
            fit(flights, min(THRESHOLDS, key=error) if len(flights) > 1 else THRESHOLDS[0]) / size
        )
    claims: dict[str, BaselineClaim] = {}
    # the largest column of a name comes first and stands for it
    for k in sorted(np.flatnonzero(beta), key=lambda k: -abs(beta[k]) * size[k]):
        name = variant_of(problem.candidates[k]).effect
        claims.setdefault(name, BaselineClaim(1.0, float(abs(beta[k]) * size[k])))
    return claims, lambda r: r.x @ beta


def parameters(problem: BaselineProblem) -> FittedMethod:
    """Fit all nominal parameters, trims and biases by least squares.

    Returns
    -------
    Claims of the names whose number ends beyond three prior sds, and the prediction of the
    residual from rows. Top speed has no name.
    """
    rows = problem.train
    beta, *_ = np.linalg.lstsq(rows.nuisance, rows.raw, rcond=None)
    claims: dict[str, BaselineClaim] = {}
    for column, value in zip(problem.nuisances, beta, strict=True):
        n = nuisance_of(column)
        # distance from the nominal parameter in its prior sds
        outside = float(abs(value) / max(n.sd, n.flight_sd))
        if n.effect != "vehicle" and outside > OUTSIDE_SD:
            before = claims.get(n.effect, BaselineClaim(1.0, 0.0)).statistic
            claims[n.effect] = BaselineClaim(1.0, max(outside, before))
    # predictions are of what calibration leaves: its share of the coefficients is taken off
    calibrated = rows.raw - rows.y
    prior = np.linalg.lstsq(rows.nuisance, calibrated, rcond=None)[0]
    return claims, lambda r: r.nuisance @ (beta - prior)


def boosting(problem: BaselineProblem) -> FittedMethod:
    """Fit gradient boosting of the residual on all logged channels, channel by channel.

    Returns
    -------
    No claims, and the prediction of the residual from rows.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    rows, models = problem.train, {}
    for c in np.unique(rows.channel):
        here = np.flatnonzero(rows.channel == c)
        here = here[:: max(1, len(here) // BOOSTED_ROWS)]
        models[c] = HistGradientBoostingRegressor(max_iter=60, random_state=0).fit(
            rows.state[here], rows.y[here]
        )

    def predict(r: BaselineRows) -> np.ndarray:
        out = np.zeros(len(r.y))
        for c, model in models.items():
            here = r.channel == c
            if here.any():
                out[here] = model.predict(r.state[here])
        return out

    return {}, predict


METHODS: dict[str, Callable[[BaselineProblem], FittedMethod]] = {
    method.__name__: method for method in (stepwise, sindy, parameters, boosting)
}


def diagnose(recordings: RecordingSet, method: str) -> dict:
    """Return a baseline's diagnosis in the form of ``diagnosis.json``.

    Parameters
    ----------
    recordings : the set.
    method : key of :data:`METHODS` here or of :data:`arithmetic.METHODS`.

    Returns
    -------
    Every finding has its ``statistic``.
    """
    fit: dict = {}
    if method in arithmetic.METHODS:
        findings = arithmetic.METHODS[method](recordings)
    else:
        problem = prepare(recordings)
        claims, predict = METHODS[method](problem)
        findings = [
            {
                "name": name,
                "kind": effect_table.get(name).about,
                "probability": claim.probability,
                "parameters": {},
                "statistic": claim.statistic,
            }
            for name, claim in claims.items()
        ]
        fit = {
            "holdout_flights": list(problem.holdout),
            "channels": _table(problem, predict(problem.held_out)),
        }
    kinds = {f["kind"] for f in findings}
    verdict = next((k for k in ("physics", "parameter", "sensor") if k in kinds), "nothing_proven")
    return {
        "schema": 1,
        "verdict": verdict,
        "sentence": f"baseline {method}",
        "findings": findings,
        "located": [],
        "unexplained": [],
        "detectable": {},
        "fit": fit,
    }


def _table(problem: BaselineProblem, predicted: np.ndarray) -> dict:
    """Return errors on the held-out flights by channel: before, recalibrated and after.

    Channels of faster test functions are left out.
    """
    rows, table = problem.held_out, {}
    for c, name in enumerate(problem.names):
        here = rows.channel == c
        if here.any() and "/" not in name:
            stages = {"before": rows.raw, "recalibrated": rows.y, "after": rows.y - predicted}
            errors = {
                k: float(np.sqrt(np.mean(v[here] ** 2)) * problem.scale[c])
                for k, v in stages.items()
            }
            table[f"{name}_{unit_of(name)}"] = errors
    return table
