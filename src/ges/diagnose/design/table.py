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
    at : by channel, (k,) indices of the columns that act there, ascending.
    values : by channel, those k columns, (m,) each.

    Notes
    -----
    Tables of the same flight share the columns that they have in common.
    """

    shape: tuple[int, int, int]
    at: tuple[np.ndarray, ...]
    values: tuple[tuple[np.ndarray, ...], ...]

    def of(self, channel: int, wanted: Indices) -> np.ndarray:
        """Return some columns of one channel.

        Parameters
        ----------
        channel : its index.
        wanted : indices of w columns.

        Returns
        -------
        (m, w), zero for columns that do not act there.
        """
        return pick_columns(self.values[channel], self.at[channel], wanted, self.shape[0])

    def all_of(self, channel: int) -> np.ndarray:
        """Return all columns that act on a channel.

        Parameters
        ----------
        channel : its index.

        Returns
        -------
        (m, k), in the order of :attr:`at`.
        """
        return self.of(channel, self.at[channel])

    def finite(self) -> np.ndarray:
        """Return where every column that acts on a channel is finite.

        Returns
        -------
        (m, C).
        """
        rows = np.ones(self.shape[0], dtype=bool)
        return np.stack(
            [np.logical_and.reduce([rows, *map(np.isfinite, v)]) for v in self.values], axis=1
        )

    def columns(self, wanted: Indices) -> list[dict[int, np.ndarray]]:
        """Return some columns.

        Parameters
        ----------
        wanted : indices of w columns.

        Returns
        -------
        Each by channel that it acts on, (m,).
        """
        columns: dict[int, dict[int, np.ndarray]] = {int(k): {} for k in wanted}
        for c, at in enumerate(self.at):
            for k, values in zip(at.tolist(), self.values[c], strict=True):
                if k in columns:
                    columns[k][c] = values
        return list(columns.values())

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
    return ColumnTable(
        (rows, channels, len(columns)),
        tuple(np.array(ks, dtype=int) for ks in at),
        tuple(tuple(columns[k][c] for k in ks) for c, ks in enumerate(at)),
    )


def pick_columns(
    values: Sequence[np.ndarray], at: np.ndarray, wanted: Indices, rows: int
) -> np.ndarray:
    """Pick columns from those that are stored.

    Parameters
    ----------
    values : k stored columns, (m,) each.
    at : (k,) their numbers, ascending.
    wanted : w numbers.
    rows : m.

    Returns
    -------
    (m, w), zero where a column is not stored.
    """
    stored, absent = dict(zip(at.tolist(), values, strict=True)), np.zeros(rows)
    picked = [stored.get(k, absent) for k in np.asarray(wanted, dtype=int).tolist()]
    return np.stack(picked).T if picked else np.zeros((rows, 0))
