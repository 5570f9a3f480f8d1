"""Division of flights into those for fitting and those held out, and of one into parts."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import pandas as pd

from ges.diagnose.prepare.gate import prepare
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.errors import GesError


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


def cut(name: str, frame: pd.DataFrame, model: Model) -> list[tuple[str, pd.DataFrame]]:
    """Cut a recording into consecutive parts of equal time in the air.

    Parameters
    ----------
    name : of the recording; the parts are ``name_part1`` ...
    frame : table with contract columns.
    model : of the vehicle, which shows when it flies.

    Returns
    -------
    Names and tables of the parts: as many as there are folds. They are fewer where a part would be
    shorter than twice the shortest usable flight.

    Raises
    ------
    GesError
        Where not even two parts would fly long enough.
    """
    flight = prepare(frame, model)
    seconds, shortest_s = np.cumsum(flight.flying) * flight.dt_s, settings.prepare.flight_shortest_s
    if seconds[-1] < 2.0 * shortest_s:
        raise GesError(
            f"{name} is {seconds[-1]:.1f} s in the air; to fit a part and hold another out takes"
            f" {2.0 * shortest_s:g} s or more, or a second log"
        )
    count = int(np.clip(seconds[-1] // (2.0 * shortest_s), 2, settings.statistics.folds))
    ends = [flight.t_s[np.searchsorted(seconds, seconds[-1] * k / count)] for k in range(1, count)]
    part = np.searchsorted(ends, frame["t_s"].to_numpy(dtype=float), side="right")
    return [(f"{name}_part{k + 1}", frame[part == k].reset_index(drop=True)) for k in range(count)]
