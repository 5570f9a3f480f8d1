"""Proof on flights that took no part: errors of every stage, rollouts, closed loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ges.diagnose.design.system import common_channels
from ges.diagnose.design.weak import make_windows
from ges.diagnose.locate.regimes import regimes
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prove.closed_loop import closed_loop
from ges.diagnose.prove.verify import (
    channel_table,
    elsewhere,
    errors,
    rms_table,
    rollout_table,
    rollouts,
)
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


def metric() -> str:
    """``metric`` of the fit, in words."""
    return (
        "rms of the weak-form residual (windowed average, nothing differentiated) on flights that"
        " took no part; reduction_ci95: share by which 'after' is below 'recalibrated', 95 %"
        f" interval over blocks of {settings.statistics.block_s:g} s"
    )


@dataclasses.dataclass(frozen=True)
class Proof:
    """Errors before, recalibrated and after on the held-out flights.

    Attributes
    ----------
    fit : ``fit`` of diagnosis.json.
    flights : the held-out flights.
    channels : names of the channels.
    errors : by stage, residuals by flight, (m, C).
    rollouts : errors by contract column and stage, (starts, steps).
    regimes : of every window, by flight.
    length_s : support of the test functions, s.
    """

    fit: Mapping[str, Any]
    flights: Sequence[Prepared] = ()
    channels: Sequence[str] = ()
    errors: Mapping[str, Sequence[np.ndarray]] = dataclasses.field(default_factory=dict)
    rollouts: Mapping[str, Mapping[str, np.ndarray]] = dataclasses.field(default_factory=dict)
    regimes: Sequence[Mapping[str, np.ndarray]] = ()
    length_s: float = 0.0


def prove(
    held_out: Mapping[str, Prepared],
    models: Mapping[str, Model],
    alternatives: Mapping[str, Model],
    located: Sequence[Mapping],
    length_s: float,
) -> Proof:
    """Compare the stages on held-out flights.

    Parameters
    ----------
    held_out : flights by name.
    models : of the stages ``before``, ``recalibrated``, ``after``.
    alternatives : with each of the names that are open.
    located : entries of the diagnosis.
    length_s : support of the test functions, s.
    """
    flights = list(held_out.values())
    if not flights:
        return Proof({"metric": metric(), "holdout_flights": [], "channels": {}, "rollout": {}})
    channels, spacing_s = common_channels(flights, models["before"]), 0.5 * length_s
    windows = [make_windows(f.t_s, f.flying, length_s) for f in flights]
    told = [regimes(f, w, models["after"]) for f, w in zip(flights, windows, strict=True)]
    left, rolled = errors(flights, models, channels, length_s), rollouts(flights, models)
    fit = {
        "metric": metric(),
        "holdout_flights": list(held_out),
        "channels": channel_table(left, channels, spacing_s),
        "alternatives": {
            name: rms_table(own, channels)
            for name, own in errors(flights, alternatives, channels, length_s).items()
        },
        "elsewhere": elsewhere(left, channels, located, told, spacing_s),
        "rollout": rollout_table(rolled),
        "closed_loop": closed_loop(flights, models, length_s),
    }
    return Proof(fit, flights, channels, left, rolled, told, length_s)
