"""Where the mismatch lives: whitened residuals by regime cell, against a null that keeps flights and autocorrelation."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import false_discovery_control, norm

from .align import Prepared
from .evidence import Board
from .fit import Joint
from .model import Model
from .residual import model_along, to_body
from .weak import Windows

BLOCK_S = 5.0
BINS = 6
FALSE_DISCOVERY_RATE = 0.05
LEAST_BLOCKS = 4


@dataclasses.dataclass(frozen=True)
class Cell:
    """One regime cell of one channel: bounds, mean residual in the channel's unit with its sd, share of the excess, q."""

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
        height = said.stack(*(f"rotor_height_{i}_m" for i in range(1, 5))).mean(axis=1)
        found["height_over_radius"] = height[at] / model.radius_m
    if flight.has("velocity"):
        v = flight.stack("velocity")[at]
        found |= {"airspeed_m_s": np.hypot(v[:, 0], v[:, 1]), "climb_m_s": v[:, 2]}
        if flight.has("attitude") and "attitude" not in flight.derived:
            along = to_body(flight.stack("attitude")[at], v)
            found |= {"forward_m_s": along[:, 0], "left_m_s": along[:, 1]}
    if flight.has("position"):
        found |= {"east_m": flight.columns["p_x_m"][at], "north_m": flight.columns["p_y_m"][at]}
    if flight.has("battery"):
        found["battery_V"] = flight.columns["battery_V"][at]
    return found


def edges(values: np.ndarray) -> np.ndarray:
    """Bin edges of one regime: quantiles, so that each bin holds as many windows."""
    return np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)))


def _block_sums(e: np.ndarray, inside: np.ndarray, block: np.ndarray) -> np.ndarray:
    return np.bincount(block, weights=np.where(inside, e, 0.0))


def cells(board: Board, joint: Joint, model: Model, raw: Sequence[np.ndarray]) -> list[Cell]:
    """Test every cell of every channel; false discovery rate by Benjamini and Hochberg over all of them.

    Parameters
    ----------
    joint : fit of the nuisances alone; its whitened residuals are tested.
    raw : by flight, (m, C) residuals in the channels' units after that fit, for the size of what is found.
    """
    told = [regimes(r.flight, r.windows, model) for r in board.system.flights]
    shared = [name for name in told[0] if all(name in t for t in told)]
    block_all = np.concatenate(board.system.blocks(BLOCK_S))
    found, p = [], []
    for c, channel in enumerate(board.system.names):
        e = np.concatenate([left[:, c] for left in joint.left])
        used = np.concatenate([w.used[:, c] for w in board.whites])
        size = np.concatenate([r[:, c] for r in raw])
        for name in shared:
            value = np.concatenate([t[name] for t in told])
            if not used.any() or np.ptp(value[used]) < 1e-9:
                continue
            for cell, chance in _cells_of(channel, name, value, e, used, size, block_all):
                found.append(cell)
                p.append(chance)
    if not found:
        return []
    q = false_discovery_control(np.array(p))
    return [dataclasses.replace(cell, q_value=float(v)) for cell, v in zip(found, q, strict=True)]


def _cells_of(channel: str, name: str, value: np.ndarray, e: np.ndarray, used: np.ndarray, size: np.ndarray, block: np.ndarray):
    limits = edges(value[used])
    total = 0.0
    made = []
    for low, high, last in zip(limits[:-1], limits[1:], np.arange(len(limits) - 1) == len(limits) - 2, strict=True):
        inside = used & (value >= low) & ((value <= high) if last else (value < high))
        sums = _block_sums(e, inside, block)
        live = np.bincount(block, weights=inside.astype(float)) > 0
        if live.sum() < LEAST_BLOCKS:
            continue
        spread = np.sqrt((sums[live] ** 2).sum())
        z = abs(sums[live].sum()) / spread if spread > 0 else 0.0
        excess = max(0.0, float(sums[live].sum() ** 2 / max(inside.sum(), 1) - 1.0))
        total += excess
        good = inside & np.isfinite(size)
        mean = float(size[good].mean())
        made.append(
            (
                low,
                high,
                mean,
                mean / z if z > 0 else np.inf,
                excess,
                int(inside.sum()),
                float(2.0 * norm.sf(_small_sample(z, live.sum()))),
            )
        )
    for low, high, mean, sd, excess, n, chance in made:
        yield (
            Cell(channel, name, float(low), float(high), mean, abs(float(sd)), excess / total if total > 0 else 0.0, 1.0, n),
            chance,
        )


def _small_sample(z: float, blocks: int) -> float:
    """Self-normalised sums are bounded by sqrt(n): a t statistic with n - 1 degrees of freedom, as a normal quantile."""
    from scipy.stats import t as student

    if z * z >= blocks:
        return 8.0
    statistic = z * np.sqrt((blocks - 1) / (blocks - z * z))
    return float(norm.isf(max(student.sf(statistic, blocks - 1), 1e-16)))


def merged(found: Sequence[Cell], model: Model) -> list[dict]:
    """Neighbouring significant cells of one sign joined, the largest (energy, as a share of the whole) first."""
    out: list[dict] = []
    for channel in dict.fromkeys(c.channel for c in found):
        for regime in dict.fromkeys(c.regime for c in found if c.channel == channel):
            chain: list[Cell] = []
            for cell in [c for c in found if c.channel == channel and c.regime == regime] + [None]:
                keep = cell is not None and cell.q_value < FALSE_DISCOVERY_RATE
                if chain and (not keep or np.sign(cell.mean) != np.sign(chain[-1].mean)):
                    out.append(_joined(chain))
                    chain = []
                if keep:
                    chain.append(cell)
    return sorted(out, key=lambda item: -item.pop("windows") * (item["mean"] / model.whole(item["channel"])) ** 2)


def _joined(chain: Sequence[Cell]) -> dict:
    windows = sum(c.windows for c in chain)
    return {
        "channel": chain[0].channel,
        "regime": {chain[0].regime: [chain[0].low, chain[-1].high]},
        "share_of_excess": float(sum(c.share for c in chain)),
        "q_value": float(min(c.q_value for c in chain)),
        "mean": float(sum(c.mean * c.windows for c in chain) / windows),
        "windows": windows,
    }


def strongest(located: Sequence[Mapping], most: int = 12) -> list[dict]:
    """The clearest entries, at most three of a channel."""
    kept: list[dict] = []
    for item in located:
        if sum(k["channel"] == item["channel"] for k in kept) < 3:
            kept.append(dict(item))
    return kept[:most]
