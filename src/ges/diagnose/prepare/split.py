"""Division of the flights into those for fitting and those held out."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import pandas as pd


def split(
    digests: Sequence[str], usable: Sequence[int], holdout: Sequence[int] | None
) -> tuple[list[int], list[int]]:
    """Divide flights into training and held-out ones.

    Parameters
    ----------
    digests : of every flight, by :func:`digest`.
    usable : indices of the flights that can be used.
    holdout : indices to hold out; None lets the rule choose.

    Returns
    -------
    Indices of the training flights, and of the held-out ones.

    Notes
    -----
    The rule holds out a quarter, at least one of two, drawn by the digests. It sees no content, and
    neither names nor order matter.
    """
    if holdout is not None:
        held_out = [i for i in usable if i in set(holdout)]
        return [i for i in usable if i not in set(held_out)], held_out
    ranked = sorted(usable, key=lambda i: digests[i])
    count = max(1, len(usable) // 4) if len(usable) > 1 else 0
    held_out = sorted(ranked[:count])
    return [i for i in usable if i not in set(held_out)], held_out


def digest(frame: pd.DataFrame) -> str:
    """Return a hash of the numbers that a flight recorded.

    Parameters
    ----------
    frame : table with contract columns; their order does not matter.
    """
    numbers = frame.reindex(sorted(frame.columns), axis=1).to_numpy(dtype=float)
    return hashlib.sha256(np.ascontiguousarray(numbers).tobytes()).hexdigest()
