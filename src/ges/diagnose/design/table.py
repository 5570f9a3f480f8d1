"""Sparse table of one flight's columns: only what acts on a channel is stored."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

Indices = Sequence[int] | np.ndarray
"""Whole numbers that pick columns or channels."""


@dataclasses.dataclass(frozen=True)
class ColumnTable:
    """Columns (m, C, K) by channel.

    Attributes
    ----------
    shape : (m, C, K).
    at : by channel, (k,) numbers of the columns that act there, ascending.
    values : by channel, (m, k) those columns.
    """

    shape: tuple[int, int, int]
    at: tuple[np.ndarray, ...]
    values: tuple[np.ndarray, ...]

    def of(self, channel: int, wanted: Indices) -> np.ndarray:
        """Return some columns of one channel.

        Parameters
        ----------
        channel : its number.
        wanted : numbers of w columns.

        Returns
        -------
        (m, w), zero for columns that do not act there.
        """
        return pick_columns(self.values[channel], self.at[channel], wanted)

    def finite(self) -> np.ndarray:
        """Return where every column that acts on a channel is finite.

        Returns
        -------
        (m, C).
        """
        return np.stack([np.isfinite(v).all(axis=1) for v in self.values], axis=1)

    def column(self, column: int) -> dict[int, np.ndarray]:
        """Return one column.

        Parameters
        ----------
        column : its number.

        Returns
        -------
        By channel that it acts on, (m,).
        """
        places = ((c, np.flatnonzero(at == column)) for c, at in enumerate(self.at))
        return {c: self.values[c][:, place[0]] for c, place in places if len(place)}

    def weighted_sum(self, terms: Mapping[int, float], count: int) -> np.ndarray:
        """Return a linear combination of columns.

        Parameters
        ----------
        terms : coefficients by column.
        count : the first channels that are summed.

        Returns
        -------
        (m, count).
        """
        wanted, size = list(terms), np.array(list(terms.values()))
        return np.stack([self.of(c, wanted) @ size for c in range(count)], axis=1)


def table_of(columns: Sequence[Mapping[int, np.ndarray]], rows: int, channels: int) -> ColumnTable:
    """Make a table.

    Parameters
    ----------
    columns : each by the channels that it acts on, (m,).
    rows, channels : m and C.
    """
    at = [[k for k, column in enumerate(columns) if c in column] for c in range(channels)]
    values = (
        np.stack([columns[k][c] for k in ks], axis=1) if ks else np.zeros((rows, 0))
        for c, ks in enumerate(at)
    )
    return ColumnTable(
        (rows, channels, len(columns)), tuple(np.array(ks, dtype=int) for ks in at), tuple(values)
    )


def pick_columns(values: np.ndarray, at: np.ndarray, wanted: Indices) -> np.ndarray:
    """Pick columns from those that are stored.

    Parameters
    ----------
    values : (m, k) stored columns.
    at : (k,) their numbers, ascending.
    wanted : w numbers.

    Returns
    -------
    (m, w), zero where a column is not stored.
    """
    numbers = np.asarray(wanted, dtype=int)
    if not len(at):
        return np.zeros((len(values), len(numbers)))
    place = np.minimum(np.searchsorted(at, numbers), len(at) - 1)
    return values[:, place] * (at[place] == numbers)
