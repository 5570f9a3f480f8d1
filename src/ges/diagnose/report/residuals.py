"""residuals.parquet: recorded and simulated signals by flight, time and channel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ges.diagnose.prove.traces import Trace
from ges.files import replacing

COLUMN_OF_STAGE = {"before": "given", "recalibrated": "recalibrated", "after": "fitted"}
"""Stages of the proof by their names in the file."""


def residual_table(traces: Sequence[Trace]) -> pa.Table:
    """Make the table of residuals.parquet: one row for each window, flights in sequence.

    Parameters
    ----------
    traces : one for each flight.

    Returns
    -------
    Table with ``flight``, ``held_out`` and ``used``, and ``t_s`` on the flight's own clock.
    ``timeline_s`` goes on from flight to flight, for viewers of a single time axis. By channel
    there are ``force_z_N/recorded``, ``/given``, ``/recalibrated`` and ``/fitted``. The models are
    NaN where ``used`` is false. A channel is NaN where a flight has not logged it.
    """
    channels = list(dict.fromkeys(name for t in traces for name in t.channels))
    columns = {
        "flight": np.concatenate([np.full(len(t.t_s), t.flight, dtype=object) for t in traces]),
        "held_out": np.concatenate([np.full(len(t.t_s), t.held_out) for t in traces]),
        "used": np.concatenate([t.used for t in traces]),
        "t_s": np.concatenate([t.t_s for t in traces]),
        "timeline_s": _timeline_s(traces),
    }
    for name in channels:
        columns[f"{name}/recorded"] = np.concatenate([_column(t, t.recorded, name) for t in traces])
        for stage, word in COLUMN_OF_STAGE.items():
            columns[f"{name}/{word}"] = np.concatenate(
                [_column(t, t.simulated[stage], name) for t in traces]
            )
    # numpy arrays keep NaN apart from null, which some viewers cannot read
    return pa.table({name: pa.array(values, from_pandas=False) for name, values in columns.items()})


def write_residuals(traces: Sequence[Trace], path: Path) -> None:
    """Write :func:`residual_table`, whole or not at all.

    Parameters
    ----------
    traces : one for each flight.
    path : of the file.
    """
    with replacing(path) as new:
        pq.write_table(residual_table(traces), new)


def _column(t: Trace, values: np.ndarray, name: str) -> np.ndarray:
    """Return (m,) of one channel."""
    if name not in t.channels:
        return np.full(len(t.t_s), np.nan)
    return values[:, t.channels.index(name)]


def _timeline_s(traces: Sequence[Trace]) -> np.ndarray:
    """Return times from the start of the first flight, with a second between flights."""
    times, start = [], 0.0
    for t in traces:
        times.append(t.t_s - t.t_s[0] + start)
        # a gap, so that a viewer of one axis does not join two flights
        start = float(times[-1][-1]) + 1.0
    return np.concatenate(times)
