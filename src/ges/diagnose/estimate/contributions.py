"""Contribution of fitted effects to the flights, and its size."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from ges.diagnose.design.residual import residual
from ges.diagnose.design.system import FlightRows, System
from ges.diagnose.estimate.fit import Fitted
from ges.diagnose.prepare.channels import channels
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.diagnose.types.words import size_unit
from ges.simulator import effects as effect_table
from ges.threads import each


def rms_by_channel(values: Sequence[np.ndarray], system: System) -> np.ndarray:
    """Return the rms of every plain channel over all flights.

    Parameters
    ----------
    values : by flight, (m, C) or more channels, in the channels' units; NaN where absent.
    system : of the flights, with C plain channels.

    Returns
    -------
    (C,), 0 where a channel is absent throughout.
    """
    together = np.concatenate([v[:, : len(system.main)] for v in values]).T
    finite = [column[np.isfinite(column)] for column in together]
    return np.array([np.sqrt(np.mean(column**2)) if len(column) else 0.0 for column in finite])


def size_of_contribution(contribution: Sequence[np.ndarray], system: System) -> dict[str, Any]:
    """Return the rms of an effect's contribution in the channel where it is largest.

    Parameters
    ----------
    contribution : by flight, (m, C) of :func:`contributions`, in the channels' units.
    system : of the flights.

    Returns
    -------
    ``value`` in ``unit``, ``share_of_weight`` (of the channel's reference scale), and ``channel``;
    '' where the effect shows nowhere.

    Notes
    -----
    Force and accelerometer show one push alike but for rounding; the first is named.
    """
    more = 1.0 + settings.numerics.small
    best: dict[str, Any] = {"value": 0.0, "unit": "N", "share_of_weight": 0.0, "channel": ""}
    for channel, rms in zip(
        system.main, rms_by_channel(contribution, system).tolist(), strict=True
    ):
        unit, scale = size_unit(channel), system.model.reference_scale(channel)
        if rms / scale > more * best["share_of_weight"]:
            best = {"value": rms, "unit": unit, "share_of_weight": rms / scale, "channel": channel}
    return best


def contributions(
    fitted: Fitted | None, names: Collection[str], nominal: Model
) -> dict[str, list[np.ndarray]]:
    """Return what fitted effects add to the nominal model.

    Parameters
    ----------
    fitted : the fit; None gives nothing.
    names : of the effects.
    nominal : the model to compare with.

    Returns
    -------
    By name and flight, (m, C) in the channels' units.
    """
    if fitted is None:
        return {}
    system = fitted.regression.system
    return {n: contributions_of(system.model.effects, n, system, nominal) for n in names}


def contributions_of(
    effects: effect_table.Effects, name: str, system: System, nominal: Model
) -> list[np.ndarray]:
    """Return what one effect adds to the nominal model.

    Parameters
    ----------
    effects : all that are on.
    name : of the effect.
    system : of the flights.
    nominal : the model to compare with.

    Returns
    -------
    By flight, (m, C) in the channels' units.
    """
    model = dataclasses.replace(system.model, effects=effects)
    bare = model.with_effect_of(name, nominal)
    return each(
        lambda rows: _contribution_of_flight(rows, bare, model, system.main), system.flights
    )


def _contribution_of_flight(
    rows: FlightRows, bare: Model, model: Model, names: tuple[str, ...]
) -> np.ndarray:
    """Return the residual of the bare model less that of the model, (m, C).

    NaN where a channel is absent.
    """
    here = channels(rows.flight, model)
    out = np.full((len(rows.windows), len(names)), np.nan)
    # residual is recorded less model: what an effect adds to the model it takes from the residual
    without_effects, with_effects = (
        residual(rows.flight, rows.windows, m, here) for m in (bare, model)
    )
    out[:, [names.index(n) for n in here]] = without_effects - with_effects
    return np.where(np.isfinite(rows.y[:, : len(names)]), out, np.nan)
