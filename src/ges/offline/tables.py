"""Tables of several jobs as one."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from ..files import replacing


def join_tables(parts: list[Path], table: Path) -> None:
    """Write the rows of all parts, in their order, as text, so that no number is rounded twice."""
    with replacing(table) as new:
        pd.concat([pd.read_csv(part, dtype=str) for part in parts]).to_csv(new, index=False)
