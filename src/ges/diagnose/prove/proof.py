"""Proof on held-out flights: errors of every stage, rollouts, closed loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ges.diagnose.design.system import channels_of_any
from ges.diagnose.design.weak import make_windows
from ges.diagnose.locate.regimes import regime_variables
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prove.closed_loop import closed_loop
from ges.diagnose.prove.verify import (
    channel_table,
    errors_elsewhere,
    finite_rollouts,
    rms_table,
    rollout_errors_by_stage,
    rollout_table,
    stage_errors,
)
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model


def _metric_words() -> str:
    """Return text of ``fit.metric``."""
    return (
        "rms of the weak-form residual (windowed average, nothing differentiated) on flights that"
        " took no part; reduction_ci95: share by which 'after' is below 'recalibrated', 95 %"
        f" interval over blocks of {settings.statistics.block_s:g} s"
    )


@dataclasses.dataclass(frozen=True)
class Proof:
    """Errors of the stages on the held-out flights.

    Attributes
    ----------
    fit : ``fit`` of diagnosis.json.
    flights : the held-out flights.
    channels : names of the channels.
    errors : by stage, residuals by flight, (m, C), in the channels' units.
    rollouts : errors by contract column and stage, (starts, steps).
    regimes : by flight, regime variables of every window.
    length_s : support of the test functions.
    warnings : what stages could not fly.
    """

    fit: Mapping[str, Any]
    flights: Sequence[Prepared] = ()
    channels: Sequence[str] = ()
    errors: Mapping[str, Sequence[np.ndarray]] = dataclasses.field(default_factory=dict)
    rollouts: Mapping[str, Mapping[str, np.ndarray]] = dataclasses.field(default_factory=dict)
    regimes: Sequence[Mapping[str, np.ndarray]] = ()
    length_s: float = 0.0
    warnings: Sequence[str] = ()


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
    alternatives : the model with each of the open names.
    located : entries of the diagnosis.
    length_s : support of the test functions.
    """
    flights = list(held_out.values())
    if not flights:
        return Proof(
            {"metric": _metric_words(), "holdout_flights": [], "channels": {}, "rollout": {}}
        )
    channels, spacing_s = channels_of_any(flights, models["before"]), 0.5 * length_s
    windows = [make_windows(f.t_s, f.flying, length_s) for f in flights]
    regimes = [
        regime_variables(f, w, models["after"]) for f, w in zip(flights, windows, strict=True)
    ]
    errors_by_stage = stage_errors(flights, models, channels, length_s)
    rollouts, warnings = finite_rollouts(rollout_errors_by_stage(flights, models))
    fit = {
        "metric": _metric_words(),
        "holdout_flights": list(held_out),
        "channels": channel_table(errors_by_stage, channels, spacing_s),
        "alternatives": {
            name: rms_table(own, channels)
            for name, own in stage_errors(flights, alternatives, channels, length_s).items()
        },
        "elsewhere": errors_elsewhere(errors_by_stage, channels, located, regimes, spacing_s),
        "rollout": rollout_table(rollouts),
        "closed_loop": closed_loop(flights, models, length_s),
    }
    return Proof(fit, flights, channels, errors_by_stage, rollouts, regimes, length_s, warnings)
