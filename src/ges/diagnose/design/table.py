"""Columns of one flight, by channel: most act on few channels, and what is zero there is neither
kept nor counted with.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

Indices = Sequence[int] | np.ndarray
"""Whole numbers that pick columns or channels."""


@dataclasses.dataclass(frozen=True)
class ColumnTable:
    """Columns (m, C, K): by channel the numbers ``at`` (k,) of those that act there, ascending, and
    what they are, (m, k).
    """

    shape: tuple[int, int, int]
    at: tuple[np.ndarray, ...]
    values: tuple[np.ndarray, ...]

    def of(self, channel: int, wanted: Indices) -> np.ndarray:
        """The k wanted columns of one channel, (m, k)."""
        return spread(self.values[channel], self.at[channel], wanted)

    def finite(self) -> np.ndarray:
        """Where every column that acts on a channel is a number, (m, C)."""
        return np.stack([np.isfinite(v).all(axis=1) for v in self.values], axis=1)

    def alone(self, column: int) -> dict[int, np.ndarray]:
        """One column by the channels that it acts on, (m,) each."""
        places = ((c, np.flatnonzero(at == column)) for c, at in enumerate(self.at))
        return {c: self.values[c][:, place[0]] for c, place in places if len(place)}

    def summed(self, terms: Mapping[int, float], count: int) -> np.ndarray:
        """Sum of columns times ``terms`` in the first ``count`` channels, (m, count)."""
        wanted, size = list(terms), np.array(list(terms.values()))
        return np.stack([self.of(c, wanted) @ size for c in range(count)], axis=1)


def table_of(columns: Sequence[Mapping[int, np.ndarray]], rows: int, channels: int) -> ColumnTable:
    """The table of columns that are given by the channels that they act on, (m,) each."""
    at = [[k for k, column in enumerate(columns) if c in column] for c in range(channels)]
    values = (
        np.stack([columns[k][c] for k in ks], axis=1) if ks else np.zeros((rows, 0))
        for c, ks in enumerate(at)
    )
    return ColumnTable(
        (rows, channels, len(columns)), tuple(np.array(ks, dtype=int) for ks in at), tuple(values)
    )


def spread(values: np.ndarray, at: np.ndarray, wanted: Indices) -> np.ndarray:
    """Those of columns (m, k) with the ascending numbers ``at`` (k,) that are wanted, (m, w), zero
    where there is none.
    """
    asked = np.asarray(wanted, dtype=int)
    if not len(at):
        return np.zeros((len(values), len(asked)))
    place = np.minimum(np.searchsorted(at, asked), len(at) - 1)
    return values[:, place] * (at[place] == asked)
