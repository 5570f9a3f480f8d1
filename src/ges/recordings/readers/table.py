"""CSV and Parquet tables, read by a column map.

The map is the user's, a shipped one that fits, or the contract's own column names.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv

from ges.errors import GesError, UsageError
from ges.recordings.readers.log import Log, Options, Stream, increasing, named_streams
from ges.recordings.readers.maps import (
    ADVICE,
    Column,
    ColumnMap,
    Layout,
    convert,
    in_contract,
    load_map,
    presets,
)
from ges.recordings.recording import read_parquet, unit_of

_Content = tuple[dict[str, np.ndarray], Layout, list[str]]

_PARQUET = b"PAR1"
_SEPARATORS = ",;\t"
_LATEST_START_S = 1e6  # a clock that starts later is the calendar's
# A first line that is so seldom text says that a file is no table.
_TEXT = set(range(32, 127)) | set(b"\t\r\n\f") | set(range(128, 256))


def _lines(path: Path, separator: str) -> tuple[pa.Table, list[str]]:
    """Read all cells as bytes, with the header if there is one; and what was noticed."""
    data = path.read_bytes()
    # spreadsheets save UTF-16
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", errors="replace").encode()
    if not data.strip():
        raise GesError(f"{path.name} is empty; there is no flight in it")
    width, notes = len(_first_line(data, separator)), []
    # a logger that lost its power leaves half a line
    last = data.rstrip().rsplit(b"\n", 1)
    if len(last) == 2 and len(_first_line(last[1], separator)) < width:
        data = last[0]
        notes.append("the last line is cut short and was left out")
    names = [f"f{k}" for k in range(width)]
    try:
        # cells stay bytes: a column that no map names may hold anything
        table = pa_csv.read_csv(
            io.BytesIO(data),
            pa_csv.ReadOptions(column_names=names, use_threads=False),
            pa_csv.ParseOptions(delimiter=separator, newlines_in_values=True),
            pa_csv.ConvertOptions(
                check_utf8=False,
                column_types=dict.fromkeys(names, pa.binary()),
                strings_can_be_null=False,
            ),
        )
    except (pa.ArrowException, UnicodeDecodeError) as error:
        row = re.search(r"Row #(\d+): Expected (\d+) columns, got (\d+)", str(error))
        if row:
            line, first, count = row.groups()
            raise GesError(
                f"{path.name} line {line} has {count} columns, the first line {first}; mend or cut"
                " the file there"
            ) from None
        raise GesError(
            f"{path.name} cannot be read as a table: {str(error).splitlines()[0][:200]}"
        ) from None
    return table, notes


def _first_line(data: bytes, separator: str) -> list[str]:
    """Split the first line that is not empty into cells."""
    line = data.removeprefix(b"\xef\xbb\xbf").lstrip().split(b"\n", 1)[0]
    try:
        (row,) = pa_csv.read_csv(
            io.BytesIO(line + b"\n"),
            pa_csv.ReadOptions(autogenerate_column_names=True),
            pa_csv.ParseOptions(delimiter=separator),
            pa_csv.ConvertOptions(check_utf8=False),
        ).to_pylist()
    except (pa.ArrowException, ValueError):
        return line.decode(errors="replace").split(separator)
    return [str(cell) for cell in row.values()]


def _text(cells: pa.ChunkedArray) -> list[str]:
    return [(cell or b"").decode(errors="replace").strip() for cell in cells.to_pylist()]


def _numbers(cells: pa.ChunkedArray, decimal: str, name: str, first_line: int) -> np.ndarray:
    """Convert a column to numbers; an empty cell is NaN."""
    text = pc.ascii_trim_whitespace(pc.cast(cells, pa.large_string(), safe=False))
    if decimal != ".":
        text = pc.replace_substring(text, decimal, ".")
    text = pc.if_else(pc.equal(text, ""), None, text)
    try:
        return pc.cast(text, pa.float64()).to_numpy(zero_copy_only=False)
    except pa.ArrowInvalid:
        pass
    # the cast says that a cell is no number, but not which
    for line, cell in enumerate(_text(cells), first_line):
        try:
            float(cell.replace(decimal, ".") or "nan")
        except ValueError:
            raise GesError(
                f"{name} line {line}: '{cell[:40]}' is no number; a column that the map names must"
                " hold numbers"
            ) from None
    raise GesError(f"{name}: a column that the map names must hold numbers")


def _fitting(
    mapping: ColumnMap, first: list[str], name: str
) -> tuple[Layout, dict[int, Column], bool]:
    """Find the layout that fits the first line.

    Returns
    -------
    The layout, its columns by their place, and whether that line is a header.
    """
    for layout in mapping.layouts:
        if (named := layout.named(first)) is not None:
            return layout, {first.index(n): column for n, column in named.items()}, True
        if isinstance(layout.columns, list) and len(layout.columns) == len(first):
            by_place = {k: c for k, c in enumerate(layout.columns) if c is not None}
            # a first line with a number in it is a sample
            return layout, by_place, not any(_is_number(first[k]) for k in by_place)
    layouts = [
        (
            f"{len(layout.columns)} columns"
            if isinstance(layout.columns, list)
            else "the named columns "
            + ", ".join(n for n, c in layout.columns.items() if not c.optional)
        )
        for layout in mapping.layouts
    ]
    raise GesError(f"{name} line 1 has {len(first)} columns; the map knows {' or '.join(layouts)}")


def _is_number(cell: str) -> bool:
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True


def own_names(header: list[str]) -> ColumnMap | None:
    """Make the map of a table that has the contract's column names already.

    Parameters
    ----------
    header : names of the table's columns.

    Returns
    -------
    The map of its known columns; None where ``t_s`` is not among them.
    """
    if "t_s" not in header:
        return None
    columns = {name: Column(to=name) for name in header if unit_of(name)}
    return ColumnMap(layouts=[Layout(columns=columns)])


def map_for(header: list[str], options: Options, name: str) -> tuple[ColumnMap, str]:
    """Choose the map of a table.

    It is the one that the user names, else the contract's own names, else a shipped map of named
    columns that fits.

    Parameters
    ----------
    header : names of the table's columns.
    options : ``mapping`` is used.
    name : name of the file, for messages.

    Returns
    -------
    The map, and a sentence on the choice; '' where there is nothing to say.

    Raises
    ------
    UsageError
        When no map fits.
    """
    if options.mapping is not None:
        return load_map(options.mapping, ColumnMap), ""
    if (own := own_names(header)) is not None:
        return own, ""
    for preset, mapping in presets(ColumnMap).items():
        if any(layout.named(header) is not None for layout in mapping.layouts):
            return mapping, f"its columns are those of the map '{preset}'"
    raise UsageError(
        f"{name} is a table and needs a column map, as nothing says what its columns are; give"
        " --map MAP.yaml (docs/importing.md shows one) or a preset:"
        f" {', '.join(presets(ColumnMap))}"
    )


def streams_of(
    columns: Mapping[str, np.ndarray], layout: Layout, name: str, source: str = ""
) -> tuple[dict[str, Stream], list[str]]:
    """Make streams of the columns of a table.

    Parameters
    ----------
    columns : (n,) by contract name, SI, with ``t_s``.
    layout : has the frames of the columns.
    name : name of the file, for messages.
    source : what the log calls the table.

    Returns
    -------
    Streams in ENU and FLU, and remarks. A clock that counts from a calendar's beginning starts at
    0.

    Raises
    ------
    UsageError
        When ``t_s`` is missing.
    GesError
        When there is no sample, or a time is not finite.
    """
    if "t_s" not in columns:
        raise UsageError(f"{name}: the map sends no column to t_s; a flight needs its time")
    t_s = columns["t_s"]
    if len(t_s) == 0:
        raise GesError(f"{name} holds a header and no sample; there is no flight in it")
    if not np.isfinite(t_s).all():
        row = int(np.argmin(np.isfinite(t_s)))
        raise GesError(
            f"{name}: the time column is not a number in row {row}; every row needs its time"
        )
    good, dropped = increasing(t_s)
    # a calendar's clock: t = 0 is the first sample then
    if t_s[0] > _LATEST_START_S:
        t_s = t_s - t_s[0]
    rest = {n: v[good] for n, v in columns.items() if n != "t_s"}
    rest = in_contract(rest, layout.axes)
    return named_streams(t_s[good], rest, source), [dropped] if dropped else []


class Table:
    """Reader of CSV and Parquet tables.

    Attributes
    ----------
    name, title, advice : as of :class:`~ges.recordings.readers.log.Reader`.
    """

    name = "table"
    title = "CSV or Parquet by a column map"
    advice = ADVICE

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether it is Parquet, or text throughout with a separator in the first line."""
        if head.startswith(_PARQUET):
            return True
        if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
            return True
        line = head.lstrip().split(b"\n", 1)[0]
        return bool(head) and set(head) <= _TEXT and any(s.encode() in line for s in _SEPARATORS)

    def read(self, path: Path, options: Options) -> Log:
        """Read a table; all streams are at the times of its ``t_s``.

        Parameters
        ----------
        path : the file.
        options : ``mapping`` is used.

        Returns
        -------
        Streams in ENU and FLU.

        Raises
        ------
        GesError
            When a line has another number of columns than the first, or a cell is no number.
        UsageError
            When there is no map for it.
        """
        with path.open("rb") as file:
            is_parquet = file.read(4) == _PARQUET
        read = self._parquet if is_parquet else self._csv
        columns, layout, notes = read(path, options)
        streams, dropped = streams_of(columns, layout, path.name)
        return Log(path.stem, self.name, "", streams, {}, tuple(notes + dropped))

    def _csv(self, path: Path, options: Options) -> _Content:
        mapping = None if options.mapping is None else load_map(options.mapping, ColumnMap)
        if mapping is not None:
            separator = mapping.separator
        else:
            with path.open("rb") as file:
                line = file.read(65536).lstrip().split(b"\n", 1)[0]
            separator = max(_SEPARATORS, key=lambda s: line.count(s.encode()))
        cells, notes = _lines(path, separator)
        first = [_text(column.slice(0, 1))[0] for column in cells.columns]
        chosen = ""
        if mapping is None:
            mapping, chosen = map_for(first, options, path.name)
        layout, places, header = _fitting(mapping, first, path.name)
        columns = {
            column.to: convert(
                _numbers(cells.column(k).slice(header), mapping.decimal, path.name, 1 + header),
                column,
            )
            for k, column in places.items()
        }
        return columns, layout, notes + ([chosen] if chosen else [])

    def _parquet(self, path: Path, options: Options) -> _Content:
        table = read_parquet(path)
        mapping, chosen = map_for(table.column_names, options, path.name)
        layout, places, _ = _fitting(mapping, table.column_names, path.name)
        columns = {}
        for k, column in places.items():
            field = table.schema.field(k)
            if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
                raise GesError(f"{path.name}: column {field.name} holds {field.type}, not numbers")
            values = table.column(k).to_numpy().astype(float)
            columns[column.to] = convert(values, column)
        return columns, layout, [chosen] if chosen else []
