"""Where the model misfits: channels and cells of a regime, and where findings act."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ges.conventions import SDS_95, rotor_columns
from ges.diagnose.design.columns import DesignColumn
from ges.diagnose.design.residual import replay_model
from ges.diagnose.design.system import System, with_columns
from ges.diagnose.design.weak import Windows
from ges.diagnose.locate.structure import PLACE, Regimes, Structure, pool_variables, without_mean
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import ACC, FORCE, MOMENT, least_rms_in
from ges.diagnose.prepare.kinematics import to_body
from ges.diagnose.select.evidence import contribution_of
from ges.diagnose.select.search import SearchResult
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model, block_of

PUSHING = ("force", "acc", "moment")
"""Blocks of channels in which the size of what is left may be reported."""


@dataclasses.dataclass(frozen=True)
class Cell:
    """Residual of one channel in one bin of a regime variable.

    Attributes
    ----------
    channel, regime : names of both.
    low, high : bounds of the bin, in the variable's unit.
    mean : mean residual, in the channel's unit.
    sd : its standard error.
    share : of the excess over all bins.
    q_value : that of the channel over the variable; 1 where the mean is not clear.
    windows : number of windows in the bin.
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


def regime_variables(flight: Prepared, windows: Windows, model: Model) -> dict[str, np.ndarray]:
    """Return the regime variables at the centre of every window.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight.
    model : for the heights of the rotors over the ground.

    Returns
    -------
    (m,) by variable, in the unit of its name; without those that were not logged.
    """
    at = windows.center
    columns, model_output = replay_model(flight, model, model.effects)
    variables = {"time_s": windows.center_s - flight.t_s[0]}
    if "p_z_m" in columns:
        # as the rotors have it: each over the ground below it, which may be uneven
        height = model_output.stack(*rotor_columns("rotor_height_{}_m", model.n_rotors)).mean(
            axis=1
        )
        variables["height_over_radius"] = height[at] / model.radius_m
    if flight.has("velocity"):
        v = flight.stack("velocity")[at]
        variables |= {"airspeed_m_s": np.hypot(v[:, 0], v[:, 1]), "climb_m_s": v[:, 2]}
        if flight.has("attitude") and "attitude" not in flight.derived:
            v_body = to_body(flight.stack("attitude")[at], v)
            variables |= {
                "forward_m_s": v_body[:, 0],
                "left_m_s": v_body[:, 1],
                "along_thrust_m_s": v_body[:, 2],
            }
    if flight.has("gyro"):
        variables["yaw_rate_rad_s"] = flight.columns["omega_z_rad_s"][at]
    if flight.has("position"):
        variables |= {"east_m": flight.columns["p_x_m"][at], "north_m": flight.columns["p_y_m"][at]}
    if flight.has("battery"):
        variables["battery_V"] = flight.columns["battery_V"][at]
    return variables


def regimes_of(system: System) -> list[dict[str, np.ndarray]]:
    """Return the :func:`regime_variables` of every flight of a system.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    By flight, (m,) by variable in the unit of its name.
    """
    return [regime_variables(r.flight, r.windows, system.model) for r in system.flights]


def with_known_speeds(residuals: Sequence[np.ndarray], system: System) -> list[np.ndarray]:
    """Return residuals without windows whose rotor speeds hang on those before the first command.

    Parameters
    ----------
    residuals : by flight, (m, C).
    system : of the flights.

    Returns
    -------
    NaN in these windows.

    Notes
    -----
    Without logged speeds these are unknown. As far off as they may be, of their thrust a share
    below the least that matters is left later on.
    """
    forgotten_s = -math.log(settings.decide.least_thrust_share) * system.model.number(
        "motor_time_constant_s"
    )
    known = [
        r.flight.has("rotor_speed")
        | (r.windows.center_s - 0.5 * r.windows.length_s - r.flight.t_s[0] > forgotten_s)
        for r in system.flights
    ]
    return [np.where(k[:, None], e, np.nan) for k, e in zip(known, residuals, strict=True)]


def unresolved_variances(system: System) -> list[np.ndarray]:
    """Return the variance that rows leave open in what the rotors do, by window and channel.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    By flight, (m, C) in squares of the channels' units; 0 for channels other than forces, the
    accelerometer's and moments.

    Notes
    -----
    The mean of a force over a row is uniform between the readings at its ends. Its variance is a
    twelfth of their squared difference. A step of a controller may be as short as a row.
    """
    return [_unresolved_variance(r.flight, r.windows, system) for r in system.flights]


def _unresolved_variance(flight: Prepared, windows: Windows, system: System) -> np.ndarray:
    """Return the variances of one flight, (m, C)."""
    _, output = replay_model(flight, system.model, system.model.effects)
    made = dict(zip((*FORCE, *MOMENT), (*output.force_N.T, *output.moment_Nm.T), strict=True))
    made |= {a: made[f] for a, f in zip(ACC, FORCE, strict=True)}
    weights = windows.mean.power(2)
    variances = np.zeros((len(windows.center), len(system.main)))
    for c, name in ((c, n) for c, n in enumerate(system.main) if n in made):
        variances[:, c] = weights @ (np.diff(made[name], append=made[name][-1]) ** 2 / 12.0)
    return variances


def bin_edges(values: np.ndarray) -> np.ndarray:
    """Return edges of bins with equally many windows.

    Parameters
    ----------
    values : (m,) of a regime variable.

    Returns
    -------
    (b,) quantiles, in the unit of the values.
    """
    return np.unique(np.quantile(values, np.linspace(0.0, 1.0, settings.report.bins + 1)))


def clear_structures(
    structures: Sequence[Structure], model: Model, least_r2: float, margin: float = 1.0
) -> list[Structure]:
    """Select structures that are significant, predict enough, and are large enough to matter.

    Parameters
    ----------
    structures : structures of a stage.
    model : for reference scales, and structure that the calibration flights show.
    least_r2 : share of the variance, 0 to 1, that a structure must predict.
    margin : factor on the rms that it must reach.

    Notes
    -----
    A structure of size must predict more, except over places: vibration and attitude noise grow
    with speed in any flight.
    """
    likely = [
        s
        for s in structures
        if s.q_value <= settings.statistics.chance
        and s.r2 >= (_least_r2_of_size(s) if s.of_size else least_r2)
    ]
    return [s for s in likely if s.rms > _least_rms_of(s, model, margin)]


def reported_structures(structures: Sequence[Structure], model: Model) -> list[Structure]:
    """Select the structures that are reported.

    Parameters
    ----------
    structures : structures of a stage.
    model : as for :func:`clear_structures`.
    """
    return clear_structures(structures, model, settings.locate.r2_least)


def unexplained_structures(structures: Sequence[Structure], model: Model) -> list[Structure]:
    """Select the structures that stay unexplained.

    Parameters
    ----------
    structures : structures in the residuals of the accepted model.
    model : for reference scales, and structure that the calibration flights show.

    Returns
    -------
    Of each channel the structure that predicts most, the largest share first. Structures of size
    count where none of the mean does.

    Notes
    -----
    A structure must be significant, and large or a large part of the residual. Healthy flights
    below the asked chance show smaller ones.
    """
    r2 = settings.statistics.least_gain
    large = [
        *reported_structures(structures, model),
        *clear_structures(structures, model, r2, settings.decide.form_margin),
    ]
    best: dict[str, Structure] = {}
    for s in sorted([s for s in large if not s.of_size] or large, key=lambda s: (-s.r2, s.regime)):
        best.setdefault(s.channel, s)
    return list(best.values())


def _least_r2_of_size(s: Structure) -> float:
    over_places = set(s.regime) <= set(PLACE)
    return settings.locate.r2_least if over_places else settings.locate.large_r2


def _least_rms_of(s: Structure, model: Model, margin: float) -> float:
    """Return the smallest rms of a structure that counts.

    It is more than the calibration flights show.
    """
    calibrated = settings.statistics.flights_ratio * model.left_unexplained.get(s.key, 0.0)
    # all of a residual is compared where its size depends on a regime, and not a part of it alone
    if s.of_size:
        margin = settings.decide.form_margin if block_of(s.channel) in PUSHING else np.inf
    return max(margin * least_rms_in(s.channel, model), calibrated)


def regime_cells(
    system: System,
    raw: Sequence[np.ndarray],
    regime_values: Regimes,
    structures: Sequence[Structure],
) -> list[Cell]:
    """Compute the mean residual of every channel in every bin of every regime variable.

    Parameters
    ----------
    system : of the flights.
    raw : by flight, (m, C) residuals in the channels' units after the fit of the nuisances alone.
    regime_values : of :func:`regimes_of`.
    structures : structures of the same residuals.

    Notes
    -----
    The mean of each flight is subtracted. A cell is significant where its structure is reported and
    its mean is beyond twice the standard error over blocks of time.
    """
    block = np.concatenate(system.blocks(settings.statistics.block_s))
    values = pool_variables(regime_values)
    q_values = {
        (s.channel, s.regime[0]): s.q_value
        for s in reported_structures(structures, system.model)
        if len(s.regime) == 1 and not s.of_size
    }
    cells: list[Cell] = []
    for c, channel in enumerate(system.main):
        e = np.concatenate([without_mean(r)[:, c] for r in raw])
        used = np.isfinite(e)
        for name, value in values.items():
            if used.any() and np.ptp(value[used]) > settings.numerics.small:
                cells += _cells_of(
                    channel,
                    name,
                    value[used],
                    e[used],
                    block[used],
                    q_values.get((channel, name), 1.0),
                )
    return cells


def _bins(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return edges, and the bin of every value."""
    limits = bin_edges(value)
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
                (
                    k,
                    float(e[inside].mean()),
                    _standard_error(e[inside], block[inside]),
                    int(inside.sum()),
                )
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
            q if abs(mean) > SDS_95 * sd else 1.0,
            n,
        )
        for (k, mean, sd, n), x in zip(rows, excess, strict=True)
    ]


def _standard_error(e: np.ndarray, block: np.ndarray) -> float:
    """Return standard error of a mean, with blocks as clusters."""
    sums = np.bincount(block, e - e.mean())
    # variance of a mean with clusters, sum of (sum e)^2 over n^2, corrected for few of them
    live = len(np.unique(block))
    return float(np.sqrt((sums**2).sum() * live / (live - 1.0)) / len(e))


def located_by_residuals(
    cells: Sequence[Cell], structures: Sequence[Structure], system: System
) -> list[dict]:
    """Return entries of ``located`` from the residuals of the recalibrated vehicle.

    Parameters
    ----------
    cells : cells of :func:`regime_cells`.
    structures : structures of the same residuals.
    system : of the flights.

    Notes
    -----
    Neighbouring significant cells of one sign are joined. Places count where no single variable
    shows the channel. Of a place ``share_of_excess`` is the R^2, and ``mean`` the rms, of its
    structure. A ``q_value`` is that of the structure, of the largest statistic over all tests.
    """
    size = {
        (s.channel, s.regime[0]): s.rms for s in structures if len(s.regime) == 1 and not s.of_size
    }
    entries = _merge_cells(
        [c for c in cells if c.q_value <= settings.statistics.chance], cells, size
    )
    channels = {item["channel"] for item in entries}
    for s in sorted(reported_structures(structures, system.model), key=lambda s: -s.r2):
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
    return _by_energy(entries, system)


def _merge_cells(
    kept: Sequence[Cell], cells: Sequence[Cell], size: Mapping[tuple[str, str], float]
) -> list[dict]:
    """Return an entry of ``located`` for each chain of neighbouring significant cells of one sign.

    Sizes are rms by channel and regime variable.
    """
    entries: list[dict] = []
    for channel, regime in dict.fromkeys((c.channel, c.regime) for c in kept):
        chain: list[Cell] = []
        here = [c for c in cells if (c.channel, c.regime) == (channel, regime)]
        # None closes a chain that runs to the last cell
        for cell in [*here, None]:
            significant = cell if cell and cell.q_value <= settings.statistics.chance else None
            if chain and (not significant or np.sign(significant.mean) != np.sign(chain[-1].mean)):
                entries.append({**_join_cells(chain), "energy": size[channel, regime] ** 2})
                chain = []
            if significant:
                chain.append(significant)
    return entries


def _join_cells(chain: Sequence[Cell]) -> dict:
    """Return the entry of ``located`` of neighbouring cells, but for its ``energy``."""
    return {
        "channel": chain[0].channel,
        "regime": {chain[0].regime: [chain[0].low, chain[-1].high]},
        "share_of_excess": float(sum(c.share for c in chain)),
        "q_value": chain[0].q_value,
        "mean": float(sum(c.mean * c.windows for c in chain) / sum(c.windows for c in chain)),
    }


def located_by_findings(
    contributions: Mapping[str, Sequence[np.ndarray]],
    residuals: Sequence[np.ndarray],
    probability: Mapping[str, float],
    regime_values: Regimes,
    system: System,
) -> list[dict]:
    """Return entries of ``located`` from what the findings contribute.

    Parameters
    ----------
    contributions : by finding and flight, (m, C) in the channels' units; NaN where a channel is
        absent.
    residuals : by flight, (m, C) with the findings.
    probability : of each finding.
    regime_values : by flight, regime variables of all windows.
    system : of the flights.

    Returns
    -------
    One entry for each channel in which a finding exceeds the residual, with its most affected
    regime. Its ``q_value`` is one less the probability of the finding.
    """
    values = pool_variables(regime_values)
    noise, entries = np.concatenate(residuals), []
    for name, of_flights in contributions.items():
        contribution = np.concatenate(of_flights)
        for c, channel in enumerate(system.main):
            good = np.isfinite(contribution[:, c]) & np.isfinite(noise[:, c])
            if _shows(contribution[good, c], noise[good, c]):
                where = _most_affected_regime(
                    contribution[good, c], {n: v[good] for n, v in values.items()}
                )
                entries.append(
                    {
                        "channel": channel,
                        **where,
                        "q_value": _complement(probability[name]),
                        "finding": name,
                    }
                )
    return _by_energy(entries, system)


def located_by_open_names(
    result: SearchResult,
    columns: Sequence[DesignColumn],
    system: System,
    residuals: Sequence[np.ndarray],
    regime_values: Regimes,
    proven: Sequence[str],
) -> list[dict]:
    """Return entries of ``located`` where names are open.

    Parameters
    ----------
    result, columns : of the search.
    system : of the flights, without candidates.
    residuals : by flight, (m, C) with what is proven.
    regime_values : by flight, regime variables of all windows.
    proven : names that are accepted.

    Returns
    -------
    Channels in which something unproven acts whichever open explanation is true. Their
    probabilities must sum to that of an acceptance; ``q_value`` is one less the sum.
    """
    noise = np.concatenate(residuals)
    probability: dict[str, float] = {}
    negligible = 1.0 - settings.statistics.certain_probability
    shown: dict[str, np.ndarray] = {}
    hypotheses = [
        h for h in result.hypotheses if h.probability > negligible and set(h.names) - set(proven)
    ]
    # columns of all candidates are as large as the flights: made again for those that are open
    used = sorted({k for h in hypotheses for k in h.posterior.columns})
    design = with_columns(system, [columns[k] for k in used])
    for h in hypotheses:
        own = dataclasses.replace(h.posterior, columns=tuple(map(used.index, h.posterior.columns)))
        contribution = contribution_of(own, set(h.names) - set(proven), design)
        for c, channel in enumerate(system.main):
            good = np.isfinite(contribution[:, c]) & np.isfinite(noise[:, c])
            if _shows(contribution[good, c], noise[good, c]):
                # hypotheses exclude each other, so their probabilities add
                probability[channel] = probability.get(channel, 0.0) + h.probability
                shown.setdefault(channel, np.where(good, contribution[:, c], np.nan))
    values = pool_variables(regime_values)
    entries = []
    for channel in (
        c for c, p in probability.items() if p >= settings.statistics.acceptance_probability
    ):
        good = np.isfinite(shown[channel])
        where = _most_affected_regime(shown[channel][good], {n: v[good] for n, v in values.items()})
        where.pop("energy")
        entries.append({"channel": channel, **where, "q_value": _complement(probability[channel])})
    return entries


def _shows(contribution: np.ndarray, noise: np.ndarray) -> bool:
    """Return whether a contribution (m,) has the least share of the noise's variance (m,)."""
    return bool((contribution**2).sum() > settings.locate.r2_least * (noise**2).sum())


def _most_affected_regime(a: np.ndarray, values: Mapping[str, np.ndarray]) -> dict:
    """Return the regime whose bins explain most of ``a``.

    Its bounds are those of the bins of at least half of the peak.
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
    low, high = _run_around(
        np.abs(level) >= 0.5 * np.abs(level).max(), int(np.argmax(np.abs(level)))
    )
    inside, energy = slice(low, high), weight * level**2
    return {
        "regime": {regime: [float(edges[low]), float(edges[high])]},
        "share_of_excess": float(energy[inside].sum() / max(energy.sum(), settings.numerics.tiny)),
        "mean": float(weight[inside] @ level[inside] / max(weight[inside].sum(), 1)),
        "energy": float(np.mean(a**2)),
    }


def _run_around(high: np.ndarray, at: int) -> tuple[int, int]:
    """Return the first and one past the last of the true values around ``at``."""
    low, end = at, at + 1
    while low > 0 and high[low - 1]:
        low -= 1
    while end < len(high) and high[end]:
        end += 1
    return low, end


def strongest_entries(entries: Sequence[Mapping]) -> list[dict]:
    """Select the entries that are reported.

    Parameters
    ----------
    entries : of ``located``, strongest first.

    Returns
    -------
    A few of each channel, every channel once before any twice. An accelerometer's entry is dropped
    where its force has one.
    """
    forces = {item["channel"] for item in entries if item["channel"].startswith("force")}
    by_channel: dict[str, list[dict]] = {}
    for item in entries:
        # a force is never dropped: only an accelerometer's entry is, where its force has one
        if item["channel"].replace("acc_", "force_") not in forces - {item["channel"]}:
            by_channel.setdefault(item["channel"], []).append(dict(item))
    each, most = settings.report.entries_by_channel, settings.report.entries
    kept = [items[k] for k in range(each) for items in by_channel.values() if len(items) > k]
    return kept[:most]


def _by_energy(entries: Sequence[dict], system: System) -> list[dict]:
    """Return entries by decreasing ``energy`` over weight, without that key.

    Those that differ by rounding alone keep the order of the channels.
    """
    weight = [
        float(f"{item.pop('energy') / system.model.reference_scale(item['channel']) ** 2:.6g}")
        for item in entries
    ]
    return [entries[i] for i in sorted(range(len(entries)), key=lambda i: -weight[i])]


def _complement(probability: float) -> float:
    """Return one less a probability, to the digits that a sum over many sets is known to."""
    return max(0.0, round(1.0 - probability, 9))
