"""Tables on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

WIDE = 160
"""Characters a line where the output is no terminal: a row of any table here."""


def console() -> Console:
    """Standard output, as wide as the terminal, or :data:`WIDE`."""
    output = Console()
    return output if output.is_terminal else Console(width=WIDE)


def table_of(*columns: str, numbers: Sequence[str] = ()) -> Table:
    """An empty table without lines; ``numbers`` are the columns set to the right."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in columns:
        table.add_column(column, justify="right" if column in numbers else "left", overflow="fold")
    return table
