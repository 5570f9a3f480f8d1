"""Where the mismatch lives: channels whose residual a regime predicts, cells of that regime, and
where the findings act.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import rotor_columns
from ges.diagnose.design.residual import model_along
from ges.diagnose.design.system import System
from ges.diagnose.design.weak import Windows
from ges.diagnose.locate.structure import PLACE, Regimes, Structure, shared, within
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.kinematics import to_body
from ges.diagnose.select.evidence import Regression, acts_of
from ges.diagnose.select.search import SearchResult
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model

PUSHING = ("force", "acc", "moment")
"""Kinds of channels in which the size of what is left may be reported."""


@dataclasses.dataclass(frozen=True)
class Cell:
    """One regime cell of one channel: bounds, mean residual in the channel's unit with its sd,
    share of the excess, q.
    """

    channel: str
    regime: str
    low: float
    high: float
    mean: float
    sd: float
    share: float
    q_value: float
    windows: int


def regimes(flight: Prepared, windows: Windows, model: Model) -> dict[str, np.ndarray]:
    """Regime variables of every window, (m,) each; what cannot be known is absent."""
    at = windows.center
    columns, said = model_along(flight, model, model.effects)
    found = {"time_s": windows.center_s - flight.t_s[0]}
    if "p_z_m" in columns:
        # as the rotors have it: each over the ground below it, which may be uneven
        height = said.stack(*rotor_columns("rotor_height_{}_m", model.n_rotors)).mean(axis=1)
        found["height_over_radius"] = height[at] / model.radius_m
    if flight.has("velocity"):
        v = flight.stack("velocity")[at]
        found |= {"airspeed_m_s": np.hypot(v[:, 0], v[:, 1]), "climb_m_s": v[:, 2]}
        if flight.has("attitude") and "attitude" not in flight.derived:
            along = to_body(flight.stack("attitude")[at], v)
            found |= {
                "forward_m_s": along[:, 0],
                "left_m_s": along[:, 1],
                "along_thrust_m_s": along[:, 2],
            }
    if flight.has("position"):
        found |= {"east_m": flight.columns["p_x_m"][at], "north_m": flight.columns["p_y_m"][at]}
    if flight.has("battery"):
        found["battery_V"] = flight.columns["battery_V"][at]
    return found


def regimes_of(system: System) -> list[dict[str, np.ndarray]]:
    """:func:`regimes` of every flight, (m,) by variable in the unit of its name."""
    return [regimes(r.flight, r.windows, system.model) for r in system.flights]


def edges(values: np.ndarray) -> np.ndarray:
    """Bin edges of one regime with values (m,): quantiles (b,), so that each bin holds as many
    windows.
    """
    return np.unique(np.quantile(values, np.linspace(0.0, 1.0, settings.report.bins + 1)))


def least(block: str, whole: float) -> float:
    """The least rms that matters in a block of channels, in their unit: no model is right to less.

    Parameters
    ----------
    block : ``force``, ``acc``, ``moment``, ``drive`` or ``range``; nothing matters in others.
    whole : what sizes in the block are shares of, in the unit of its channels.
    """
    s = settings.decide
    if block == "range":
        return settings.prepare.height_error_m
    shares = {
        **dict.fromkeys(("force", "acc"), s.least_force_share),
        "moment": s.least_moment_share,
        "drive": s.least_drive_share,
    }
    return shares.get(block, np.inf) * whole


def clear(
    found: Sequence[Structure], model: Model, least_r2: float, margin: float = 1.0
) -> list[Structure]:
    """Structures that no noise makes, that carry a part of the residual that matters, and that are
    large enough to matter, by a ``margin``; of the residual's size, a larger part, but over places:
    vibration and the attitude's noise grow with speed in any flight.
    """
    likely = [
        s
        for s in found
        if s.q_value <= settings.statistics.chance
        and s.r2 >= (_least_r2_of_size(s) if s.of_size else least_r2)
    ]
    return [s for s in likely if s.rms > _least(s, model, margin)]


def located(found: Sequence[Structure], model: Model) -> list[Structure]:
    """Structures that are reported."""
    return clear(found, model, settings.locate.r2_least)


def _least_r2_of_size(s: Structure) -> float:
    over_places = set(s.regime) <= set(PLACE)
    return settings.locate.r2_least if over_places else settings.statistics.large_part


def _least(s: Structure, model: Model, margin: float) -> float:
    """Smallest rms that counts; what the flights of the calibration show too does not."""
    known = settings.statistics.flights_ratio * model.left_unexplained.get(s.key, 0.0)
    # all of a residual is compared where its size depends on a regime, and not a part of it alone
    if s.of_size:
        margin = settings.decide.form_margin if s.kind in PUSHING else np.inf
    return max(margin * least(s.kind, model.reference_scale(s.channel)), known)


def cells(
    system: System, raw: Sequence[np.ndarray], regime_values: Regimes, found: Sequence[Structure]
) -> list[Cell]:
    """Mean residual of every channel in every bin of every regime, the mean of each flight left
    out.

    A cell is significant (its q is that of its channel over its regime) where that structure is
    clear and the cell's mean is beyond twice its standard error over blocks of time.

    Parameters
    ----------
    raw : by flight, (m, C) residuals in the channels' units after the fit of the nuisances alone.
    regime_values : of :func:`regimes_of`.
    found : structures of the same residuals.
    """
    block = np.concatenate(system.blocks(settings.statistics.block_s))
    values = {
        name: np.concatenate([t[name] for t in regime_values]) for name in shared(regime_values)
    }
    chance = {
        (s.channel, s.regime[0]): s.q_value
        for s in located(found, system.model)
        if len(s.regime) == 1 and not s.of_size
    }
    made: list[Cell] = []
    for c, channel in enumerate(system.main):
        e = np.concatenate([within(r)[:, c] for r in raw])
        used = np.isfinite(e)
        for name, value in values.items():
            if used.any() and np.ptp(value[used]) > settings.numerics.small:
                made += _cells_of(
                    channel,
                    name,
                    value[used],
                    e[used],
                    block[used],
                    chance.get((channel, name), 1.0),
                )
    return made


def _bins(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges, and the bin of every value."""
    limits = edges(value)
    return limits, np.clip(np.searchsorted(limits, value, side="right") - 1, 0, len(limits) - 2)


def _cells_of(
    channel: str, name: str, value: np.ndarray, e: np.ndarray, block: np.ndarray, q: float
) -> list[Cell]:
    limits, which = _bins(value)
    rows = []
    for k in range(len(limits) - 1):
        inside = which == k
        # a cell seen in few blocks has no standard error to speak of
        if np.count_nonzero(np.bincount(block[inside])) >= settings.statistics.folds:
            rows.append(
                (k, float(e[inside].mean()), _error(e[inside], block[inside]), int(inside.sum()))
            )
    # a mean's square holds its variance as well: E m^2 = mu^2 + sd^2
    excess = [n * max(0.0, mean**2 - sd**2) for _, mean, sd, n in rows]
    total = sum(excess) or 1.0
    return [
        Cell(
            channel,
            name,
            float(limits[k]),
            float(limits[k + 1]),
            mean,
            sd,
            x / total,
            q if abs(mean) > settings.statistics.suggestive_sds * sd else 1.0,
            n,
        )
        for (k, mean, sd, n), x in zip(rows, excess, strict=True)
    ]


def _error(e: np.ndarray, block: np.ndarray) -> float:
    """Standard error of a mean whose blocks are independent and whose windows are not."""
    sums = np.bincount(block, e - e.mean())
    # variance of a mean with clusters, sum of (sum e)^2 over n^2, corrected for few of them
    live = len(np.unique(block))
    return float(np.sqrt((sums**2).sum() * live / (live - 1.0)) / len(e))


def from_residuals(made: Sequence[Cell], found: Sequence[Structure], system: System) -> list[dict]:
    """Entries of ``located`` from what the recalibrated vehicle leaves: neighbouring significant
    cells of one sign joined, and places that no single variable shows.
    """
    size = {(s.channel, s.regime[0]): s.rms for s in found if len(s.regime) == 1 and not s.of_size}
    entries = _merged([c for c in made if c.q_value <= settings.statistics.chance], made, size)
    channels = {item["channel"] for item in entries}
    for s in sorted(located(found, system.model), key=lambda s: -s.r2):
        if s.channel not in channels:
            channels.add(s.channel)
            entries.append(
                {
                    "channel": s.channel,
                    "regime": s.bounds,
                    "share_of_excess": min(1.0, s.r2),
                    "q_value": s.q_value,
                    "mean": s.rms,
                    "energy": s.rms**2,
                }
            )
    return _weightiest(entries, system)


def _merged(
    kept: Sequence[Cell], made: Sequence[Cell], size: Mapping[tuple[str, str], float]
) -> list[dict]:
    out: list[dict] = []
    for channel, regime in dict.fromkeys((c.channel, c.regime) for c in kept):
        chain: list[Cell] = []
        here = [c for c in made if (c.channel, c.regime) == (channel, regime)]
        # None closes a chain that runs to the last cell
        for cell in [*here, None]:
            significant = cell if cell and cell.q_value <= settings.statistics.chance else None
            if chain and (not significant or np.sign(significant.mean) != np.sign(chain[-1].mean)):
                out.append({**_joined(chain), "energy": size[channel, regime] ** 2})
                chain = []
            if significant:
                chain.append(significant)
    return out


def _joined(chain: Sequence[Cell]) -> dict:
    return {
        "channel": chain[0].channel,
        "regime": {chain[0].regime: [chain[0].low, chain[-1].high]},
        "share_of_excess": float(sum(c.share for c in chain)),
        "q_value": chain[0].q_value,
        "mean": float(sum(c.mean * c.windows for c in chain) / sum(c.windows for c in chain)),
    }


def from_findings(
    added: Mapping[str, Sequence[np.ndarray]],
    left: Sequence[np.ndarray],
    probability: Mapping[str, float],
    regime_values: Regimes,
    system: System,
) -> list[dict]:
    """Entries of ``located`` from what was found: channels in which a finding stands out of what
    the model leaves, each with the regime that its contribution follows most closely.

    Parameters
    ----------
    added : by finding and flight, (m, C) of what it adds; NaN where a channel is absent.
    left : by flight, (m, C) residuals with the findings.
    probability : of each finding.
    """
    values = {
        name: np.concatenate([t[name] for t in regime_values]) for name in shared(regime_values)
    }
    noise, entries = np.concatenate(left), []
    for name, parts in added.items():
        acts = np.concatenate(parts)
        for c, channel in enumerate(system.main):
            good = np.isfinite(acts[:, c]) & np.isfinite(noise[:, c])
            if _rms(acts[good, c]) > settings.statistics.large_part * _rms(noise[good, c]):
                where = _acting(acts[good, c], {n: v[good] for n, v in values.items()})
                entries.append(
                    {
                        "channel": channel,
                        **where,
                        "q_value": max(0.0, 1.0 - probability[name]),
                        "finding": name,
                    }
                )
    return _weightiest(entries, system)


def from_open(
    found: SearchResult,
    regression: Regression,
    left: Sequence[np.ndarray],
    regime_values: Regimes,
    proven: Sequence[str],
) -> list[dict]:
    """Entries of ``located`` where something is open: channels in which, whichever of the open
    explanations holds, something that is not proven acts; the sum of their probabilities has to
    reach that of an acceptance.

    Parameters
    ----------
    found, regression : of the search.
    left : by flight, (m, C) residuals of what is proven.
    """
    system, noise = regression.system, np.concatenate(left)
    chance: dict[str, float] = {}
    negligible = 1.0 - settings.statistics.certain_probability
    shown: dict[str, np.ndarray] = {}
    for h in (
        h for h in found.hypotheses if h.probability > negligible and set(h.names) - set(proven)
    ):
        acts = acts_of(h.posterior, set(h.names) - set(proven), regression.system)
        for c, channel in enumerate(system.main):
            good = np.isfinite(acts[:, c]) & np.isfinite(noise[:, c])
            if _rms(acts[good, c]) > settings.statistics.large_part * _rms(noise[good, c]):
                # hypotheses exclude each other, so their probabilities add
                chance[channel] = chance.get(channel, 0.0) + h.probability
                shown.setdefault(channel, np.where(good, acts[:, c], np.nan))
    values = {
        name: np.concatenate([t[name] for t in regime_values]) for name in shared(regime_values)
    }
    entries = []
    for channel in (
        c for c, p in chance.items() if p >= settings.statistics.acceptance_probability
    ):
        good = np.isfinite(shown[channel])
        where = _acting(shown[channel][good], {n: v[good] for n, v in values.items()})
        where.pop("energy")
        entries.append({"channel": channel, **where, "q_value": max(0.0, 1.0 - chance[channel])})
    return entries


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _acting(a: np.ndarray, values: Mapping[str, np.ndarray]) -> dict:
    """Regime whose bins explain most of ``a``, and the run of bins around its peak that hold at
    least half of the peak.
    """
    best: tuple[str, float, np.ndarray, np.ndarray, np.ndarray]
    best = ("", -1.0, np.zeros(1), np.zeros(1), np.zeros(1))
    for name, value in values.items():
        if np.ptp(value) > settings.numerics.small:
            limits, which = _bins(value)
            count = np.bincount(which, minlength=len(limits) - 1)
            mean = np.bincount(which, a, len(count)) / np.maximum(count, 1)
            # sum of squares between bins, as in an analysis of variance
            between = float(count @ (mean - a.mean()) ** 2)
            if between > best[1]:
                best = (name, between, limits, mean, count)
    regime, _, edges, level, weight = best
    low, high = _run(np.abs(level) >= 0.5 * np.abs(level).max(), int(np.argmax(np.abs(level))))
    inside, energy = slice(low, high), weight * level**2
    return {
        "regime": {regime: [float(edges[low]), float(edges[high])]},
        "share_of_excess": float(energy[inside].sum() / max(energy.sum(), settings.numerics.tiny)),
        "mean": float(weight[inside] @ level[inside] / max(weight[inside].sum(), 1)),
        "energy": float(np.mean(a**2)),
    }


def _run(high: np.ndarray, at: int) -> tuple[int, int]:
    """First and one past the last of the true values around ``at``."""
    low, end = at, at + 1
    while low > 0 and high[low - 1]:
        low -= 1
    while end < len(high) and high[end]:
        end += 1
    return low, end


def strongest(entries: Sequence[Mapping]) -> list[dict]:
    """The clearest entries, a few of a channel, every channel once before any twice; the
    accelerometer where the force, which it measures too, has none.
    """
    forces = {item["channel"] for item in entries if item["channel"].startswith("force")}
    by_channel: dict[str, list[dict]] = {}
    for item in entries:
        # a force is not its own twin: only an accelerometer's entry goes, where its force has one
        if item["channel"].replace("acc_", "force_") not in forces - {item["channel"]}:
            by_channel.setdefault(item["channel"], []).append(dict(item))
    each, most = settings.report.entries_by_channel, settings.report.entries
    kept = [items[k] for k in range(each) for items in by_channel.values() if len(items) > k]
    return kept[:most]


def _weightiest(entries: Sequence[dict], system: System) -> list[dict]:
    """Entries by their ``energy`` over weight, which they lose; what differs by rounding alone
    stays in the channels' order.
    """
    weight = [
        float(f"{item.pop('energy') / system.model.reference_scale(item['channel']) ** 2:.6g}")
        for item in entries
    ]
    return [entries[i] for i in sorted(range(len(entries)), key=lambda i: -weight[i])]
