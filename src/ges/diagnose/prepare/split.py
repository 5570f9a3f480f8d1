"""Which flights take part in fitting, and which are held out."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import pandas as pd


def split(
    digests: Sequence[str], usable: Sequence[int], holdout: Sequence[int] | None
) -> tuple[list[int], list[int]]:
    """Training and held-out flights.

    Without a request a quarter of the flights (at least one where there are two) is held out, drawn
    by the flights' :func:`digest`: the rule sees no content, and neither names nor order matter.
    """
    if holdout is not None:
        held = [i for i in usable if i in set(holdout)]
        return [i for i in usable if i not in set(held)], held
    ranked = sorted(usable, key=lambda i: digests[i])
    count = max(1, len(usable) // 4) if len(usable) > 1 else 0
    held = sorted(ranked[:count])
    return [i for i in usable if i not in set(held)], held


def digest(frame: pd.DataFrame) -> str:
    """Hash of what a flight recorded."""
    numbers = frame.reindex(sorted(frame.columns), axis=1).to_numpy(dtype=float)
    return hashlib.sha256(np.ascontiguousarray(numbers).tobytes()).hexdigest()
