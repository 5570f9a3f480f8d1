"""Plain CSV by a column map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from ges.errors import GesError
from ges.recordings.columns import (
    Column,
    ColumnMap,
    Layout,
    convert,
    increasing,
    with_quaternion,
    with_specific_force,
)


def _lines(path: Path) -> list[tuple[int, str]]:
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise GesError(f"cannot read {path.name} as text: {error}") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise GesError(f"{path.name} is empty; there is no flight in it")
    return lines


def _without_cut_end(lines: list[tuple[int, str]], separator: str, name: str) -> tuple[list[tuple[int, str]], list[str]]:
    """A last line that is short was cut while it was written: leave it out and say so."""
    number, last = lines[-1]
    if len(lines) < 3 or last.count(separator) >= lines[-2][1].count(separator):
        return lines, []
    return lines[:-1], [f"{name}: the last line ({number}) is cut short and was left out"]


def _named(layout: Layout, header: list[str]) -> list[Column | None] | None:
    if not isinstance(layout.columns, dict) or not set(layout.columns) <= set(header):
        return None
    return [layout.columns.get(name) for name in header]


def _layout(mapping: ColumnMap, first: list[str], name: str) -> tuple[list[Column | None], bool]:
    """The layout that fits the first line, and whether that line is a header."""
    for layout in mapping.layouts:
        if named := _named(layout, first):
            return named, True
        if isinstance(layout.columns, list) and len(layout.columns) == len(first):
            return layout.columns, False
    known = [
        str(len(x.columns)) if isinstance(x.columns, list) else "the named columns " + ", ".join(x.columns)
        for x in mapping.layouts
    ]
    raise GesError(f"{name} line 1 has {len(first)} columns; the column map knows {' or '.join(known)}")


def _numbers(lines: list[tuple[int, str]], separator: str, width: int, name: str) -> np.ndarray:
    table = np.empty((len(lines), width))
    for row, (number, line) in enumerate(lines):
        cells = line.split(separator)
        if len(cells) != width:
            raise GesError(
                f"{name} line {number} has {len(cells)} columns, the lines before it {width}; mend or cut the file there"
            )
        try:
            table[row] = [float(cell) if cell.strip() else np.nan for cell in cells]
        except ValueError as error:
            raise GesError(f"{name} line {number}: {error}; every column must hold numbers") from None
    return table


def read_csv(path: str | Path, mapping: ColumnMap) -> tuple[pd.DataFrame, list[str]]:
    """One flight from a CSV file.

    Returns
    -------
    frame, warnings : contract columns, and what was noticed.

    Raises
    ------
    GesError Naming the line where the file has another number of columns than the map, or something
    that is no number.
    """
    path = Path(path)
    lines = _lines(path)
    lines, cut = _without_cut_end(lines, mapping.separator, path.name)
    first = [cell.strip() for cell in lines[0][1].split(mapping.separator)]
    columns, header = _layout(mapping, first, path.name)
    table = _numbers(lines[header:], mapping.separator, len(columns), path.name)
    if len(table) == 0:
        raise GesError(f"{path.name} holds a header and no sample; there is no flight in it")
    values = {c.to: convert(table[:, k], c) for k, c in enumerate(columns) if c is not None}
    if "t_s" not in values:
        raise GesError(f"{path.name}: the column map sends no column to t_s; a flight needs its time")
    frame, repeats = increasing(pd.DataFrame(with_specific_force(with_quaternion(values))), path.name)
    return frame, cut + repeats
