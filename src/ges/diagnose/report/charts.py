"""Data of the page's charts over time, small enough to be part of it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ges.diagnose.prove.traces import Trace
from ges.diagnose.types.model import block_of
from ges.diagnose.types.words import channel_words, stage_words, unit_words

LEVELS = 65534
"""Steps between the least and the greatest value of a channel: finer than any screen shows, and two
bytes a number.
"""
# the one number of two bytes that no level takes: they run from -32767 to 32767
MISSING = -32768


def chart_data(traces: Sequence[Trace]) -> dict[str, Any]:
    """Return what ``charts.js`` draws.

    Parameters
    ----------
    traces : one for each flight, in the order of the menu. The first held-out one is shown first.
    """
    shown = next((i for i, t in enumerate(traces) if t.held_out), 0)
    stages = [["recorded", "recorded"], *([s, stage_words(s)] for s in traces[0].simulated)]
    return {"shown": shown, "stages": stages, "flights": [_flight(t) for t in traces]}


def _flight(t: Trace) -> dict[str, Any]:
    return {
        "name": t.flight,
        "held_out": t.held_out,
        "t_s": [round(float(v), 3) for v in t.t_s],
        "used": [int(v) for v in t.used],
        "left_out": [
            [round(s.start_s, 3), round(s.end_s, 3), s.reason.replace("_", " ")] for s in t.left_out
        ],
        "channels": [
            {
                "block": block_of(name),
                "label": channel_words(name),
                "unit": unit_words(name),
                **_pack(
                    {
                        "recorded": t.recorded[:, c],
                        **{stage: values[:, c] for stage, values in t.simulated.items()},
                    }
                ),
            }
            for c, name in enumerate(t.channels)
        ],
    }


def _pack(series: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return signals (n,) of one channel as 16-bit numbers, little-endian, base64.

    The value is ``low`` + ``step`` * (number + 32767), :data:`MISSING` where there is none.
    """
    finite = np.concatenate([v[np.isfinite(v)] for v in series.values()])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    # rounded before levels are counted, as the page multiplies by the rounded step;
    # a constant channel would have a step of zero, and divide by it
    low, step = float(f"{low:.7g}"), float(f"{(high - low) / LEVELS or 1.0:.7g}")
    codes = {}
    for name, values in series.items():
        level = np.clip(np.nan_to_num((values - low) / step), 0, LEVELS).round() - 32767
        number = np.where(np.isfinite(values), level, MISSING).astype("<i2")
        codes[name] = base64.b64encode(number.tobytes()).decode()
    return {"low": low, "step": step, "series": codes}
