"""Weak-form errors and open-loop rollouts of every stage on held-out flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import POSITION, QUANTILES_95, VELOCITY
from ges.diagnose.design.residual import residual
from ges.diagnose.design.weak import block_windows, make_windows
from ges.diagnose.estimate.shoot import can_roll_out, fly_rollouts
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import channels, least_rms_in, unit_of
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.diagnose.types.words import channel_words, number_words, stage_words, unit_words

STAGES = ("before", "recalibrated", "after")


def stage_errors(
    flights: Sequence[Prepared], models: Mapping[str, Model], names: Sequence[str], length_s: float
) -> dict[str, list[np.ndarray]]:
    """Compute the weak-form residuals of every stage.

    Parameters
    ----------
    flights : held out.
    models : by stage.
    names : of the C channels.
    length_s : support of the test functions.

    Returns
    -------
    By stage and flight, (m, C) in the channels' units; NaN where a channel is absent.
    """
    out: dict[str, list[np.ndarray]] = {stage: [] for stage in models}
    for flight in flights:
        windows = make_windows(flight.t_s, flight.flying, length_s)
        for stage, model in models.items():
            here = channels(flight, model)
            full = np.full((len(windows), len(names)), np.nan)
            full[:, [names.index(n) for n in here]] = residual(flight, windows, model, here)
            out[stage].append(full)
    return out


def _block_sums(e: np.ndarray, block: int) -> np.ndarray:
    """Return sums of squares and counts by block, (b, 2)."""
    good = np.isfinite(e)
    edges = np.arange(0, len(e), block)
    return np.stack(
        [
            np.add.reduceat(np.where(good, e, 0.0) ** 2, edges),
            np.add.reduceat(good.astype(float), edges),
        ],
        axis=1,
    )


def rms(of_flights: Sequence[np.ndarray]) -> float:
    """Return the root mean square over flights.

    Parameters
    ----------
    of_flights : errors (m,) by flight; NaN is left out.
    """
    pooled = np.concatenate(of_flights)
    return float(np.sqrt(np.mean(pooled[np.isfinite(pooled)] ** 2)))


def reduction_ci95(
    before: Sequence[np.ndarray], after: Sequence[np.ndarray], block: int
) -> list[float]:
    """Return the 95 % interval of 1 - after/before of the rms, by a block bootstrap.

    Parameters
    ----------
    before, after : by flight, errors (m,) in one unit.
    block : windows in a block of time.
    """
    pairs = [
        np.hstack([_block_sums(b, block), _block_sums(a, block)])
        for b, a in zip(before, after, strict=True)
        if len(b)
    ]
    # squares and counts of both stages by block: a draw of blocks is a sum of rows, in pairs
    table = np.vstack(pairs) if pairs else np.full((1, 4), np.nan)
    rng, count = np.random.default_rng(settings.statistics.seed), settings.statistics.resamples
    drawn = table[rng.integers(0, len(table), (count, len(table)))].sum(axis=1)
    # a draw without any reading is 0 / 0, and no quantile counts it
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 1.0 - np.sqrt((drawn[:, 2] / drawn[:, 3]) / (drawn[:, 0] / drawn[:, 1]))
    return [float(v) for v in np.nanquantile(share, QUANTILES_95)]


def stages_row(by_stage: Mapping[str, Sequence[np.ndarray]], block: int) -> dict:
    """Return the rms of every stage, and the interval of the reduction.

    Parameters
    ----------
    by_stage : by stage and flight, errors (m,) in one unit.
    block : windows in a block of time.

    Returns
    -------
    Rms by stage, and ``reduction_ci95`` of 'after' against 'recalibrated'.
    """
    interval = reduction_ci95(by_stage["recalibrated"], by_stage["after"], block)
    return {**{stage: rms(each) for stage, each in by_stage.items()}, "reduction_ci95": interval}


def channel_table(
    errors: Mapping[str, Sequence[np.ndarray]], names: Sequence[str], spacing_s: float
) -> dict[str, dict]:
    """Return ``fit.channels`` of diagnosis.json.

    Parameters
    ----------
    errors : by stage and flight, (m, C) in the channels' units.
    names : of the C channels.
    spacing_s : of the windows.
    """
    block = block_windows(spacing_s)
    by_name = {
        n: {s: [e[:, c] for e in by] for s, by in errors.items()} for c, n in enumerate(names)
    }
    return {
        f"{n}_{unit_of(n)}": stages_row(by, block)
        for n, by in by_name.items()
        if _has_errors(by["before"])
    }


def recalibration_warnings(channels: Mapping[str, Mapping], model: Model) -> list[str]:
    """Return a sentence for every channel that recalibration makes worse on held-out flights.

    Parameters
    ----------
    channels : of :func:`channel_table`.
    model : for the reference scale of each channel.

    Notes
    -----
    What grows by less than the practical significance threshold is not worth a sentence.
    """
    return [
        f"on the flights that took no part the {channel_words(name)} is"
        f" {number_words(rms['recalibrated'])} {unit_words(name)} off with numbers of the file"
        f" recalibrated, {number_words(rms['before'])} as given: they were bent to physics that the"
        " file lacks, or flights differ by more than they can"
        for name, rms in channels.items()
        if rms["recalibrated"] - rms["before"] > least_rms_in(name, model)
    ]


def rms_table(errors: Sequence[np.ndarray], names: Sequence[str]) -> dict[str, float]:
    """Return the rms of one stage by channel, without absent channels.

    Parameters
    ----------
    errors : by flight, (m, C) in the channels' units.
    names : of the C channels.
    """
    by_name = {n: [e[:, c] for e in errors] for c, n in enumerate(names)}
    return {f"{n}_{unit_of(n)}": rms(each) for n, each in by_name.items() if _has_errors(each)}


def _has_errors(each: Sequence[np.ndarray]) -> bool:
    return any(np.isfinite(e).any() for e in each)


def errors_elsewhere(
    errors: Mapping[str, Sequence[np.ndarray]],
    names: Sequence[str],
    located: Sequence[Mapping],
    regimes: Sequence[Mapping[str, np.ndarray]],
    spacing_s: float,
) -> dict[str, dict]:
    """Return ``fit.elsewhere``: errors outside the regimes in which a channel was found wrong.

    Parameters
    ----------
    errors : of :func:`stage_errors`, (m, C) by stage and flight in the channels' units.
    names : of the C channels.
    located : entries of the diagnosis.
    regimes : by flight, regime variables of every window, (m,) each.
    spacing_s : of the windows.

    Returns
    -------
    By channel: rms ``recalibrated`` and ``after``, the interval ``change_ci95`` of
    after/recalibrated - 1, and ``worse``. Channels without such regimes, or without windows
    outside, are left out.

    Notes
    -----
    A finding must not make these errors worse.
    """
    block, table = block_windows(spacing_s), {}
    for c, name in enumerate(names):
        wrong = [item["regime"] for item in located if item["channel"] == name]
        if not wrong:
            continue
        masks = [~np.any([_inside(r, bounds) for bounds in wrong], axis=0) for r in regimes]
        pick = {
            s: [np.where(m, e[:, c], np.nan) for e, m in zip(errors[s], masks, strict=True)]
            for s in STAGES[1:]
        }
        # fewer than two blocks leave nothing to resample
        if sum(np.isfinite(e).sum() for e in pick["after"]) < 2 * block:
            continue
        low, high = reduction_ci95(pick["recalibrated"], pick["after"], block)
        table[f"{name}_{unit_of(name)}"] = {
            **{stage: rms(each) for stage, each in pick.items()},
            # a change is minus a reduction, so the ends of the interval swap
            "change_ci95": [-high, -low],
            "worse": -high > settings.statistics.least_gain,
        }
    return table


def _inside(values: Mapping[str, np.ndarray], bounds: Mapping[str, Sequence[float]]) -> np.ndarray:
    """Return windows within all bounds; none where a variable is not known."""
    inside = np.ones(len(next(iter(values.values()))), bool)
    for name, (low, high) in bounds.items():
        inside &= (values[name] >= low) & (values[name] <= high) if name in values else False
    return inside


def horizon_times_s() -> np.ndarray:
    """Return the times (p,) in a rollout at which errors are taken, s.

    Notes
    -----
    From 0 to ``report.horizon_s``, both included.
    """
    longest_s = settings.report.horizon_s
    return np.linspace(0.0, longest_s, round(longest_s / settings.design.coarsest_s) + 1)


def rollout_errors(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Compute open-loop errors of one flight, see :mod:`~ges.diagnose.estimate.shoot`.

    Parameters
    ----------
    flight : held out.
    model : that is flown.

    Returns
    -------
    By contract column (``p_z_m`` ...), (starts, points), simulated minus recorded; the first point
    is the start.
    """
    n = int(round(settings.report.horizon_s / flight.dt_s))
    rolled = fly_rollouts(flight, model, n)
    if not len(rolled.starts):
        return {}
    at = np.linspace(0.0, n * flight.dt_s, len(horizon_times_s()))
    clock = np.arange(n + 1) * flight.dt_s
    errors = {}
    for name in POSITION + VELOCITY:
        simulated = np.array([np.interp(at, r["t_s"] - r["t_s"][0], r[name]) for r in rolled.flown])
        recorded = np.array(
            [np.interp(at, clock, rolled.recorded[name][s : s + n + 1]) for s in rolled.starts]
        )
        errors[name] = simulated - recorded
    return errors


def rollout_errors_by_stage(
    flights: Sequence[Prepared], models: Mapping[str, Model]
) -> dict[str, dict[str, np.ndarray]]:
    """Compute :func:`rollout_errors` over all flights.

    Parameters
    ----------
    flights : held out.
    models : by stage.

    Returns
    -------
    By contract column and stage, (starts, points).
    """
    by_column: dict[str, dict[str, np.ndarray]] = {}
    for stage, model in models.items():
        pieces = [p for f in flights if can_roll_out(f) for p in [rollout_errors(f, model)] if p]
        for name in pieces[0] if pieces else ():
            by_column.setdefault(name, {})[stage] = np.concatenate([p[name] for p in pieces])
    return by_column


def rollout_table(errors: Mapping[str, Mapping[str, np.ndarray]]) -> dict:
    """Return ``fit.rollout``: rms error at the end of a horizon.

    Parameters
    ----------
    errors : by contract column and stage, (r, p) of r rollouts, in the unit of the column.
    """
    channels = {
        n: {s: float(np.sqrt(np.mean(e[:, -1] ** 2))) for s, e in by.items()}
        for n, by in errors.items()
    }
    return {"horizon_s": settings.report.horizon_s, "channels": channels} if channels else {}


def finite_rollouts(
    errors: Mapping[str, Mapping[str, np.ndarray]],
) -> tuple[dict[str, dict[str, np.ndarray]], list[str]]:
    """Leave out rollouts that stop being finite in some stage.

    Parameters
    ----------
    errors : of :func:`rollout_errors_by_stage`.

    Returns
    -------
    The others, (starts, points) by contract column and stage, and a sentence for every stage that
    lost some.

    Notes
    -----
    Stages compare on the same rollouts alone: all stages fly one to its end, or it does not count.
    """
    diverged = {
        stage: ~np.all([np.isfinite(by[stage]).all(axis=1) for by in errors.values()], axis=0)
        for stage in next(iter(errors.values()), {})
    }
    good = ~np.any(list(diverged.values()), axis=0)
    warnings = [
        f"{of_stage.sum()} of {len(of_stage)} simulations {settings.report.horizon_s:g} s ahead"
        f" stop being finite ({stage_words(stage)}), and count in no stage"
        for stage, of_stage in diverged.items()
        if of_stage.any()
    ]
    if not good.any():
        return {}, warnings
    return {n: {s: e[good] for s, e in by.items()} for n, by in errors.items()}, warnings
