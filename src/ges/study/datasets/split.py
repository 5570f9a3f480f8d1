"""Splits: which rows of which seed train, validate and test.

A split is a table of blocks (seed, first_row, last_row, part). The seed-wise one gives whole
flights to a part. The block-wise one, for comparison with earlier practice, deals blocks of seconds
and so lets one terrain into all parts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from ges.errors import GesError
from ges.files import write_csv
from ges.study.config import DataSeeds

PARTS = ("train", "validation", "test")
KINDS = ("seedwise", "blockwise")


def _seedwise(seeds: DataSeeds, rows: int) -> pd.DataFrame:
    """Whole flights: the seed lists of the configuration."""
    blocks = [(s, 0, rows - 1, part) for part in PARTS for s in getattr(seeds, part).list()]
    return pd.DataFrame(blocks, columns=["seed", "first_row", "last_row", "part"])


def _blockwise(seeds: DataSeeds, rows: int, block_rows: int, seed: int) -> pd.DataFrame:
    """Blocks of every flight, dealt at random in the proportion of the seed lists."""
    # the last instant is one row more than whole blocks; it joins the last, not a block of its own
    starts = np.arange(0, rows - 1, block_rows)
    ends = [*(starts[1:] - 1), rows - 1]
    every = [(s, a, b) for s in seeds.data() for a, b in zip(starts, ends, strict=True)]
    share = np.cumsum([getattr(seeds, part).count for part in PARTS]) / len(seeds.data())
    order = np.random.default_rng(seed).permutation(len(every))
    # rank k of n goes to the part whose cumulative share holds (k + 1/2) / n: fixed counts, random
    # places
    place = np.searchsorted(share, (order + 0.5) / len(every))
    table = pd.DataFrame(every, columns=["seed", "first_row", "last_row"])
    return table.assign(part=np.array(PARTS)[np.minimum(place, len(PARTS) - 1)])


def _rows_of(duration_s: float, rate_hz: float) -> int:
    """Rows of a flight, its first instant included."""
    return round(duration_s * rate_hz) + 1


def write_split(
    split: Path,
    kind: str,
    seeds: DataSeeds,
    duration_s: float,
    rate_hz: float,
    block_s: float,
    seed: int,
) -> None:
    """Write the blocks of a split as CSV.

    Parameters
    ----------
    split : to write: ``seed``, ``first_row``, ``last_row`` and ``part`` of each block.
    kind : 'seedwise' (whole flights) or 'blockwise' (blocks of every flight, dealt at random).
    seeds : seed lists of the parts.
    duration_s : length of a flight.
    rate_hz : rows a second.
    block_s : length of a block of the block-wise split.
    seed : of the dealing.

    Raises
    ------
    GesError
        For another kind.
    """
    rows = _rows_of(duration_s, rate_hz)
    if kind not in KINDS:
        raise GesError(f"unknown split '{kind}'; known: {', '.join(KINDS)}")
    table = (
        _seedwise(seeds, rows)
        if kind == "seedwise"
        else _blockwise(seeds, rows, round(block_s * rate_hz), seed)
    )
    write_csv(split, table)
