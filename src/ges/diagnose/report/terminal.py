"""Tables on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

WIDE = 160
"""Characters a line where the output is no terminal: a row of any table here."""


def console() -> Console:
    """Return standard output, as wide as the terminal, or :data:`WIDE`.

    Notes
    -----
    A file or a pipe has no width of its own.
    """
    output = Console()
    return output if output.is_terminal else Console(width=WIDE)


def table_of(*columns: str, numbers: Sequence[str] = ()) -> Table:
    """Return an empty table without lines.

    Parameters
    ----------
    columns : their headings.
    numbers : the columns that are aligned right.
    """
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in columns:
        table.add_column(column, justify="right" if column in numbers else "left", overflow="fold")
    return table
