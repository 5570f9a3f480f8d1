"""A bias pulse on the oracle, each flight beside the same flight without it: does the disturbance
grow or die out?
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from ges.files import write_csv, write_json
from ges.simulator.flight import Record
from ges.study.config import Flights, Pulse, PulseMap, SeedRange, Simulator
from ges.study.fly.flights import Condition, flown
from ges.study.stats.paired import contrasts

COLUMNS = ("t_s", "agl_m", "ge_factor", "ge_shadow")
BEFORE_S = 0.5
TRACE_EVERY = 2
RESAMPLES = 999


def _pulse_pair(start_s: float, bias: float, duration_s: float) -> tuple[Condition, Condition]:
    """The oracle without and with a pulse, the network running beside it."""
    plain = Condition("unpulsed", {"mode": "oracle", "shadow": 1.0})
    kick = {"pulse": bias, "pulse_start_s": start_s, "pulse_duration_s": duration_s}
    return plain, plain.but("pulsed", **kick)


def _rows(name: str, seed: int, record: Record, pulse: Pulse) -> Iterator[dict]:
    after = record["t_s"] - (pulse.start_s + pulse.duration_s)
    error = np.abs(record["ge_shadow"] - record["ge_factor"])
    for low, high in itertools.pairwise(pulse.window_edges_s):
        inside = (after >= low) & (after < high)
        clearance, shadow = float(record["agl_m"][inside].mean()), float(error[inside].mean())
        yield {
            "condition": name,
            "seed": seed,
            "window_s": f"{low:g}-{high:g}",
            "clearance_m": clearance,
            "shadow_mae": shadow,
        }


def _tests(windows: pd.DataFrame) -> pd.DataFrame:
    """Return paired tests of pulsed against unpulsed by window.

    Holm's correction is over all windows of a metric and both metrics.
    """
    # windows side by side as metrics: one table, over which Holm's correction goes
    wide = windows.pivot(
        index=["condition", "seed"], columns="window_s", values=["clearance_m", "shadow_mae"]
    )
    wide.columns = [f"{metric} {window}" for metric, window in wide.columns]
    names = [
        f"{metric} {window}"
        for metric in ("clearance_m", "shadow_mae")
        for window in windows["window_s"].unique()
    ]
    table = contrasts(wide.reset_index(), names, [("pulsed", "unpulsed")])
    split = table.pop("metric").str.split(" ", expand=True)
    table.insert(0, "metric", split[0])
    table.insert(1, "window_s", split[1])
    return table


def _near(t_s: np.ndarray, pulse: Pulse) -> tuple[np.ndarray, np.ndarray]:
    """(rows around the pulse, their times after its end)."""
    after = t_s - (pulse.start_s + pulse.duration_s)
    near = np.flatnonzero(
        (after >= -BEFORE_S - pulse.duration_s) & (after < pulse.window_edges_s[-1])
    )[::TRACE_EVERY]
    return near, after[near].round(6)


def _trace(after_s: np.ndarray, change_m: np.ndarray) -> pd.DataFrame:
    """Return the mean change of clearance over seeds against time after the pulse.

    It has its 95 % interval; ``change_m`` is (seeds, rows).
    """
    from scipy.stats import t as student_t

    mean, n = change_m.mean(axis=0), len(change_m)
    # t interval of the mean at each instant by itself
    half = (
        student_t.ppf(0.975, n - 1) * change_m.std(axis=0, ddof=1) / np.sqrt(n) if n > 1 else np.nan
    )
    return pd.DataFrame(
        {"after_s": after_s, "change_m": mean, "low_m": mean - half, "high_m": mean + half}
    )


def _response(after_s: np.ndarray, change_m: np.ndarray) -> dict[str, float]:
    """Return depth of a response, its rebound, and when they occur.

    It settles when it stays within a tenth of the depth.
    """
    after, change = after_s[after_s >= 0], change_m[after_s >= 0]
    low = int(change.argmin())
    # a rebound comes after the depth; what was high before it is none
    high = low + int(change[low:].argmax())
    outside = np.flatnonzero(np.abs(change) > 0.1 * abs(change[low]))
    # the row after the last one outside; the end of the trace where it never stays
    settled = min(outside[-1] + 1, len(after) - 1) if len(outside) else 0
    names = (
        "lowest_m",
        "lowest_after_s",
        "rebound_m",
        "rebound_after_s",
        "settled_after_s",
        "last_m",
    )
    values = change[low], after[low], change[high], after[high], after[settled], change[-1]
    return dict(zip(names, map(float, values), strict=True))


def _mean_response(after_s: np.ndarray, change_m: np.ndarray) -> dict[str, float]:
    """Response of the mean over seeds; ``x_low``, ``x_high``: 95 % of what resampled seeds give."""
    # depth and time of an extreme of a mean curve have no formula: seeds are drawn anew, each with
    # its whole curve
    picks = np.random.default_rng(0).integers(0, len(change_m), (RESAMPLES, len(change_m)))
    resampled = pd.DataFrame(
        [_response(after_s, change_m[pick].mean(axis=0)) for pick in picks]
    ).quantile([0.025, 0.975])
    low, high = (
        resampled.iloc[i].add_suffix(suffix).to_dict() for i, suffix in enumerate(("_low", "_high"))
    )
    return {**_response(after_s, change_m.mean(axis=0)), **low, **high}


def fly_pulse(
    simulator: Simulator,
    plan: Flights,
    pulse: Pulse,
    closed_loop: SeedRange,
    flights: Path,
    tests: Path,
    trace: Path,
    response: Path,
) -> None:
    """Fly every seed with and without a bias pulse on the oracle.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    pulse : height, start, length, and windows after its end.
    closed_loop : seeds.
    flights : to write: mean clearance and shadow error of every flight and window after the pulse.
    tests : to write: paired tests of pulsed against unpulsed in every window.
    trace : to write: mean change of clearance against time.
    response : to write (JSON): depth, rebound and settling of that mean, with their intervals.
    """
    seeds, pair = closed_loop.list(), _pulse_pair(pulse.start_s, pulse.bias, pulse.duration_s)
    arms = [(c, seed) for c in pair for seed in seeds]
    records = list(flown([c.flight(simulator, plan, seed) for c, seed in arms], COLUMNS))
    rows = [
        row
        for (c, seed), r in zip(arms, records, strict=True)
        for row in _rows(c.name, seed, r, pulse)
    ]
    table, clearance = pd.DataFrame(rows), np.array([r["agl_m"] for r in records])
    near, after_s = _near(records[0]["t_s"], pulse)
    # equal ground and noise on both sides: what is left is the pulse's doing
    change = (clearance[len(seeds) :] - clearance[: len(seeds)])[:, near]
    write_csv(flights, table)
    write_csv(tests, _tests(table))
    write_csv(trace, _trace(after_s, change))
    write_json(response, _mean_response(after_s, change))


def _outcome(
    unpulsed: Record, pulsed: Record, start_s: float, end_s: float, how: PulseMap
) -> dict[str, float]:
    """Return what a pulse did to one flight.

    That is the deepest loss of clearance, what is left of it, and the seconds on the ground that it
    adds.
    """
    change, t_s = pulsed["agl_m"] - unpulsed["agl_m"], pulsed["t_s"]
    last = t_s >= end_s + how.recovery_s - how.judged_s
    after = t_s >= start_s
    row_s = float(t_s[1] - t_s[0])
    # over the last seconds, not at the end: a curve that swings through zero has not returned
    residual = float(np.sqrt(np.mean(change[last] ** 2)))
    return {
        "greatest_loss_m": float(-change.min()),
        "left_m": residual,
        "returned": float(residual <= how.tolerance_m),
        # beside the contact that the flight would have had anyway
        "touched_s": float(
            (pulsed["contact"][after].sum() - unpulsed["contact"][after].sum()) * row_s
        ),
    }


def _map_rows(
    simulator: Simulator,
    plan: Flights,
    start_s: float,
    how: PulseMap,
    seeds: list[int],
    duration_s: float,
) -> Iterator[dict]:
    end = start_s + duration_s
    # nothing is judged after the recovery, and no estimate of the network is looked at
    short = plan.model_copy(update={"duration_s": end + how.recovery_s})
    # one unpulsed flight a seed serves every height
    arms = [
        _pulse_pair(start_s, 0.0, duration_s)[0],
        *(_pulse_pair(start_s, b, duration_s)[1] for b in how.biases),
    ]
    arms = [c.but(c.name, shadow=0.0) for c in arms]
    columns = ("t_s", "agl_m", "contact")
    records = list(
        flown([c.flight(simulator, short, seed) for c in arms for seed in seeds], columns)
    )
    unpulsed, rest = records[: len(seeds)], records[len(seeds) :]
    for (bias, seed), record in zip(itertools.product(how.biases, seeds), rest, strict=True):
        outcome = _outcome(unpulsed[seeds.index(seed)], record, start_s, end, how)
        yield {"bias": bias, "duration_s": duration_s, "seed": seed, **outcome}


def fly_pulse_map(
    simulator: Simulator,
    plan: Flights,
    start_s: float,
    pulse_map: PulseMap,
    closed_loop: SeedRange,
    flights: Path,
    summary: Path,
    limits: Path,
) -> None:
    """Fly pulses of every height and length, to see which return and which touch the ground.

    Parameters
    ----------
    simulator, plan : what is flown, and how.
    start_s : start of every pulse.
    pulse_map : heights, lengths and the recovery.
    closed_loop : seeds.
    flights : to write: a row a pulsed flight, against the same flight without the pulse.
    summary : to write: share of seeds that returned and that touched the ground more than without,
        for every pulse.
    limits : to write: a row a length and sign. It holds the greatest height up to which every seed
        returned, and up to which none touched more. They are 0 where the smallest already fails.
    """
    seeds = closed_loop.list()
    rows = [
        row
        for length in pulse_map.durations_s
        for row in _map_rows(simulator, plan, start_s, pulse_map, seeds, length)
    ]
    table = pd.DataFrame(rows)
    grouped = table.assign(touches=table["touched_s"] > 0).groupby(
        ["bias", "duration_s"], as_index=False
    )
    shares = grouped.agg(
        seeds=("seed", "size"),
        returned=("returned", "mean"),
        touched=("touches", "mean"),
        loss_m=("greatest_loss_m", "mean"),
        greatest_loss_m=("greatest_loss_m", "max"),
        left_m=("left_m", "max"),
    )
    write_csv(flights, table)
    write_csv(summary, shares)
    write_csv(limits, _limits(shares))


def _up_to(cell: pd.DataFrame, good: pd.Series) -> float:
    """Greatest |bias| below which every pulse is good; cell sorted by |bias|."""
    # 1 up to the first that fails, 0 from there on: a good one beyond it does not count
    passed = good.to_numpy().cumprod().sum()
    return float(cell["bias"].abs().iloc[passed - 1]) if passed else 0.0


def _limits(shares: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for (length, sign), cell in shares.groupby(["duration_s", np.sign(shares["bias"])]):
        cell = cell.sort_values("bias", key=np.abs)
        returned = _up_to(cell, cell["returned"] == 1)
        untouched = _up_to(cell, cell["touched"] == 0)
        highest = float(cell["bias"].abs().max())
        rows.append((length, "+" if sign > 0 else "-", returned, untouched, highest))
    return pd.DataFrame(
        rows, columns=["duration_s", "sign", "returns_up_to", "untouched_up_to", "tried_up_to"]
    )
