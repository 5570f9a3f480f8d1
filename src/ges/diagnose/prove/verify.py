"""Proof on flights that took no part: weak-form errors and open-loop rollouts, before, recalibrated
and after.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import POSITION, QUANTILES_95, VELOCITY
from ges.diagnose.design.residual import residual
from ges.diagnose.design.weak import make_windows
from ges.diagnose.estimate.shoot import can_roll, rollouts_of
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import channels, unit_of
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model

STAGES = ("before", "recalibrated", "after")


def errors(
    flights: Sequence[Prepared], models: Mapping[str, Model], names: Sequence[str], length_s: float
) -> dict[str, list[np.ndarray]]:
    """Weak-form residuals by stage: a list over flights of (m, C), NaN where a channel is
    absent.
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


def _blocks(e: np.ndarray, block: int) -> np.ndarray:
    """Sums of squares and counts by block, (b, 2)."""
    good = np.isfinite(e)
    edges = np.arange(0, len(e), block)
    return np.stack(
        [
            np.add.reduceat(np.where(good, e, 0.0) ** 2, edges),
            np.add.reduceat(good.astype(float), edges),
        ],
        axis=1,
    )


def rms(each: Sequence[np.ndarray]) -> float:
    """Of errors by flight (m,), without what is absent."""
    told = np.concatenate(each)
    return float(np.sqrt(np.mean(told[np.isfinite(told)] ** 2)))


def reduction_ci95(
    before: Sequence[np.ndarray], after: Sequence[np.ndarray], block: int
) -> list[float]:
    """95 % interval of 1 - after/before of the rms, resampling blocks of time within flights.

    Parameters
    ----------
    before, after : by flight, errors (m,) in one unit.
    block : windows in a block of time.
    """
    pairs = [
        np.hstack([_blocks(b, block), _blocks(a, block)])
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
    """Rms of every stage, and by how much 'after' is below 'recalibrated', of errors by flight
    (m,).
    """
    interval = reduction_ci95(by_stage["recalibrated"], by_stage["after"], block)
    return {**{stage: rms(each) for stage, each in by_stage.items()}, "reduction_ci95": interval}


def block_windows(spacing_s: float) -> int:
    """Windows in a block of time."""
    return max(1, int(round(settings.statistics.block_s / spacing_s)))


def channel_table(
    told: Mapping[str, Sequence[np.ndarray]], names: Sequence[str], spacing_s: float
) -> dict[str, dict]:
    """``channels`` of the fit, as the contract writes them.

    Parameters
    ----------
    told : by stage and flight, errors (m, C) in the channels' units.
    names : of the C channels.
    spacing_s : of the windows.
    """
    block = block_windows(spacing_s)
    by_name = {n: {s: [e[:, c] for e in by] for s, by in told.items()} for c, n in enumerate(names)}
    return {
        f"{n}_{unit_of(n)}": stages_row(by, block)
        for n, by in by_name.items()
        if _present(by["before"])
    }


def worse_recalibrated(channels: Mapping[str, Mapping]) -> list[str]:
    """A sentence for every channel of :func:`channel_table` that the recalibrated model misses by
    more than the vehicle file as given does.
    """
    return [
        f"on the flights that took no part the error of {name} is {told['before']:.3g} as given and"
        f" {told['recalibrated']:.3g} recalibrated: the flights differ by more than the declared"
        " numbers can"
        for name, told in channels.items()
        if told["recalibrated"] > (1.0 + settings.statistics.least_gain) * told["before"]
    ]


def rms_table(left: Sequence[np.ndarray], names: Sequence[str]) -> dict[str, float]:
    """Rms of one stage of :func:`errors` by channel, as the channels of :func:`channel_table`;
    without those that are absent.

    Parameters
    ----------
    left : by flight, errors (m, C) in the channels' units.
    """
    by_name = {n: [e[:, c] for e in left] for c, n in enumerate(names)}
    return {f"{n}_{unit_of(n)}": rms(each) for n, each in by_name.items() if _present(each)}


def _present(each: Sequence[np.ndarray]) -> bool:
    return any(np.isfinite(e).any() for e in each)


def elsewhere(
    told: Mapping[str, Sequence[np.ndarray]],
    names: Sequence[str],
    located: Sequence[Mapping],
    regimes: Sequence[Mapping[str, np.ndarray]],
    spacing_s: float,
) -> dict[str, dict]:
    """``elsewhere`` of the fit: the same errors outside every regime in which a channel was found
    wrong: must not get worse.

    Parameters
    ----------
    told : of :func:`errors`, (m, C) by stage and flight in the channels' units.
    located : entries of the diagnosis.
    regimes : by flight, regime variables of every window, (m,) each.

    Returns
    -------
    by channel, of those that have such regimes and windows outside: rms ``recalibrated`` and
    ``after``, the 95 % interval ``change_ci95`` of after/recalibrated - 1, and ``worse``: whether
    it lies above what counts as a change.
    """
    block, table = block_windows(spacing_s), {}
    for c, name in enumerate(names):
        wrong = [item["regime"] for item in located if item["channel"] == name]
        if not wrong:
            continue
        masks = [~np.any([_inside(r, bounds) for bounds in wrong], axis=0) for r in regimes]
        pick = {
            s: [np.where(m, e[:, c], np.nan) for e, m in zip(told[s], masks, strict=True)]
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
    """Windows within all bounds; none where a variable is not known."""
    inside = np.ones(len(next(iter(values.values()))), bool)
    for name, (low, high) in bounds.items():
        inside &= (values[name] >= low) & (values[name] <= high) if name in values else False
    return inside


def along_horizon_s() -> np.ndarray:
    """Times in a rollout at which its error is told, (p,)."""
    longest_s = settings.report.horizon_s
    return np.linspace(0.0, longest_s, round(longest_s / settings.design.coarsest_s) + 1)


def rollout(flight: Prepared, model: Model) -> dict[str, np.ndarray]:
    """Open-loop errors along one horizon, see :mod:`~ges.diagnose.estimate.shoot`.

    Returns
    -------
    error by contract column (``p_z_m`` ...), (starts, points), the first of them at the start.
    """
    n = int(round(settings.report.horizon_s / flight.dt_s))
    rolled = rollouts_of(flight, model, n)
    if not len(rolled.starts):
        return {}
    at, clock = (
        np.linspace(0.0, n * flight.dt_s, len(along_horizon_s())),
        np.arange(n + 1) * flight.dt_s,
    )
    errors = {}
    for name in POSITION + VELOCITY:
        said = np.array([np.interp(at, r["t_s"] - r["t_s"][0], r[name]) for r in rolled.flown])
        seen = np.array(
            [np.interp(at, clock, rolled.recorded[name][s : s + n + 1]) for s in rolled.starts]
        )
        errors[name] = said - seen
    return errors


def rollouts(
    flights: Sequence[Prepared], models: Mapping[str, Model]
) -> dict[str, dict[str, np.ndarray]]:
    """Errors of :func:`rollout` by contract column and stage over all flights, (starts, points)."""
    told: dict[str, dict[str, np.ndarray]] = {}
    for stage, model in models.items():
        pieces = [p for f in flights if can_roll(f) for p in [rollout(f, model)] if p]
        for name in pieces[0] if pieces else ():
            told.setdefault(name, {})[stage] = np.concatenate([p[name] for p in pieces])
    return told


def rollout_table(told: Mapping[str, Mapping[str, np.ndarray]]) -> dict:
    """``rollout`` of the fit: rms error after one horizon by channel and stage.

    Parameters
    ----------
    told : by contract column and stage, errors (r, p) along r rollouts, in the unit of the column.
    """
    channels = {
        n: {s: float(np.sqrt(np.mean(e[:, -1] ** 2))) for s, e in by.items()}
        for n, by in told.items()
    }
    return {"horizon_s": settings.report.horizon_s, "channels": channels} if channels else {}
