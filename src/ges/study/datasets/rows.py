"""Rows that models read: windows of features, never across the border of a block, and the target
ahead of them.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas as pd

from ges.errors import GesError
from ges.files import sha256
from ges.study.config import Window
from ges.study.datasets.columns import CONTACT, FEATURES, TARGET, WHEREABOUTS
from ges.study.datasets.flights import read_flight, seed_of


@dataclasses.dataclass(frozen=True)
class Rows:
    """n rows of one part.

    Attributes
    ----------
    x : (n, window, 13) float32, oldest row first; the last one is the present. Without the past,
        (n, 1, 13).
    y : (n,) target at the horizon.
    seed, row : (n,) flight and row of the present.
    places : true places at the present and ``ge_factor`` now, for analysis.
    """

    x: np.ndarray
    y: np.ndarray
    seed: np.ndarray
    row: np.ndarray
    places: dict[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.y)

    @property
    def now(self) -> np.ndarray:
        """Features of the present alone, (n, 13)."""
        return self.x[:, -1]

    @property
    def flat(self) -> np.ndarray:
        """Features of the whole window, (n, window * 13)."""
        return self.x.reshape(len(self.x), -1)


@dataclasses.dataclass(frozen=True)
class RowWindow:
    """How much of the past a row carries, and how far ahead its target lies.

    Attributes
    ----------
    rows : rows of a window, the present one included.
    step : rows of the data set between two rows of a window.
    horizon : rows from the present to the target.
    reserve : rows ahead that are kept free.
    """

    rows: int
    step: int
    horizon: int
    reserve: int

    @classmethod
    def of(
        cls, shape: Window, rate_hz: float, horizon_s: float, reserve_s: float = 0.0
    ) -> RowWindow:
        """Return the window of a configuration.

        Parameters
        ----------
        shape : rows and step.
        rate_hz : rows a second.
        horizon_s : how far ahead the target lies.
        reserve_s : how far ahead rows are kept free, so that several horizons have the same rows.
        """
        ahead = round(horizon_s * rate_hz)
        return cls(shape.rows, shape.step, ahead, max(ahead, round(reserve_s * rate_hz)))

    @property
    def _past(self) -> int:
        """Rows before the present that a window reaches back."""
        return (self.rows - 1) * self.step

    def _offsets(self) -> np.ndarray:
        """Return the rows of a window relative to the present, oldest first."""
        return np.arange(-self._past, 1, self.step)


def _eligible(blocks: pd.DataFrame, window: RowWindow) -> np.ndarray:
    """Rows of one flight's blocks whose window and target stay inside their own block."""
    # past and reserve are taken off each block, so no window looks across into another part
    spans = [
        np.arange(b.first_row + window._past, b.last_row - window.reserve + 1)
        for b in blocks.itertuples()
    ]
    return np.concatenate(spans) if spans else np.empty(0, dtype=int)


def _chosen(rows: np.ndarray, most: int | None, seed: int, flight: int) -> np.ndarray:
    """At most ``most`` rows of a flight, drawn by its own random numbers."""
    if most is None or len(rows) <= most:
        return rows
    # a generator a flight: its rows do not hang on which other flights are read
    return np.sort(np.random.default_rng([seed, flight]).choice(rows, most, replace=False))


def _gather(path: Path, rows: np.ndarray, window: RowWindow, past: bool) -> tuple:
    seed, data = read_flight(path, (*FEATURES, TARGET, *WHEREABOUTS, CONTACT))
    table = np.stack([data[name] for name in FEATURES], axis=1)
    if len(rows) and rows[-1] + window.reserve >= len(table):
        raise GesError(
            f"{Path(path).name} has {len(table)} rows; the split asks for row"
            f" {rows[-1] + window.reserve}"
        )
    # the whole window is asked even where only the present is read: all models get the same rows
    defined = np.isfinite(table).all(axis=1)[rows[:, None] + window._offsets()].all(axis=1)
    # touches so far: equal counts at both ends say that there is none between
    touched = np.concatenate([[0], np.cumsum(data[CONTACT] > 0)])
    rows = rows[defined & (touched[rows + window.reserve + 1] == touched[rows])]
    x = table[rows[:, None] + (window._offsets() if past else np.zeros(1, dtype=int))]
    places = {name: data[name][rows] for name in (*WHEREABOUTS, TARGET)}
    return np.full(len(rows), seed), x, data[TARGET][rows + window.horizon], rows, places


def _checked(report: Path, seeds: set[int]) -> dict[int, Path]:
    """Flights of seeds, proven to be those that the leakage check saw."""
    listed = json.loads(Path(report).read_text())["flights"]
    files = {seed_of(Path(name)): name for name in listed}
    for seed in sorted(seeds):
        if seed not in files:
            raise GesError(
                f"{Path(report).name} has no flight of seed {seed}; fly the data set again"
            )
        # the check vouches for bytes, not for a name
        if sha256(files[seed]) != listed[files[seed]]:
            raise GesError(
                f"{files[seed]} is not the flight that {Path(report).name} has checked; run the"
                " check again"
            )
    return {seed: Path(files[seed]) for seed in seeds}


def load_rows(
    flights: Path,
    split: Path,
    part: str,
    window: RowWindow,
    most: int | None,
    seed: int,
    past: bool = True,
) -> Rows:
    """Read the rows of a part; every model reads through here.

    Rows with an undefined feature are left out, as are those with a touch of the ground up to the
    end of the reserve.

    Parameters
    ----------
    flights : report of the leakage check, which names the flights and their hashes.
    split : table of blocks.
    part : 'train', 'validation' or 'test'.
    window : past and horizon.
    most : cap on all rows of the part, shared equally by its flights; None takes all.
    seed : of the draw.
    past : whether rows carry their window; which rows there are does not depend on it.

    Raises
    ------
    GesError
        When the part is empty, or a flight is missing or is not the one that was checked.
    """
    blocks = pd.read_csv(split)
    blocks = blocks[blocks["part"] == part]
    if blocks.empty:
        raise GesError(f"split {Path(split).name}: part '{part}' is empty")
    files = _checked(flights, set(blocks["seed"]))
    share = None if most is None else max(most // blocks["seed"].nunique(), 1)
    loaded = [
        _gather(files[s], _chosen(_eligible(b, window), share, seed, s), window, past)
        for s, b in blocks.groupby("seed")
    ]
    seeds, x, y, rows = (np.concatenate([f[i] for f in loaded]) for i in range(4))
    places = {k: np.concatenate([f[4][k] for f in loaded]) for k in loaded[0][4]}
    return Rows(x, y, seeds, rows, places)
