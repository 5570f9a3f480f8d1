"""Tables of several jobs as one."""

from __future__ import annotations

from pathlib import Path

from ges.errors import GesError
from ges.files import write_text


def join_tables(parts: list[Path], table: Path) -> None:
    """Write the rows of all parts as they stand, so that no number is rounded twice.

    Parameters
    ----------
    parts : tables with the same columns.
    table : to write.

    Raises
    ------
    GesError
        When columns differ.
    """
    headings, bodies = zip(*(Path(part).read_text().split("\n", 1) for part in parts), strict=True)
    if len(set(headings)) > 1:
        raise GesError(
            f"{Path(table).name}: its parts have different columns; run the workflow again to make"
            " them anew"
        )
    write_text(table, headings[0] + "\n" + "".join(bodies))
