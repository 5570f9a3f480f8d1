"""Growth of a force with speed: the usual measure of a drag."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ges.conventions import FAR_FROM_GROUND_M, VELOCITY, rotor_speed
from ges.diagnose.types.finding import Finding
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

LINEAR = 0.05
"""Departure from proportion, over twice the speed, at which a force no longer counts as linear."""


def force_per_speed_N_s_m(name: str, model: Model) -> float | None:
    """Return the force that an effect makes in hover for each m/s of speed, in still air.

    Parameters
    ----------
    name : an effect that is on in ``model``.
    model : vehicle with its effects.

    Returns
    -------
    For the body axis on which it is greatest, N per m/s. None where the force is not proportional
    to speed, depends on the past, or is that of a moving air.

    Notes
    -----
    The compiled effect is evaluated at rest, at 1 and at 2 m/s along each body axis, far from the
    ground.
    """
    effect = effect_table.get(name)
    # moving air changes with speed what a drag makes of it, and is in proportion to none
    if effect.n_states or effect.kind != "wrench":
        return None
    # axis by axis: at rest, at 1 m/s and at 2 m/s
    speeds = np.array([[s * (a == b) for b in range(3)] for a in range(3) for s in (0.0, 1.0, 2.0)])
    columns = {
        "t_s": np.arange(float(len(speeds))),
        "p_z_m": np.full(len(speeds), FAR_FROM_GROUND_M),
        **dict(zip(VELOCITY, speeds.T, strict=True)),
        **dict.fromkeys(rotor_speed(model.n_rotors), np.full(len(speeds), model.hover_rad_s)),
    }
    others = {k: v for k, v in model.effects.items() if k != name}
    samples = effect_table.Samples.from_columns(columns)
    # by difference, as the effect may act through others that are on
    with_it, without = effect_table.replay_each(
        model.parameters, samples, [model.effects, others], model.terrain
    )
    force = (with_it.force_N - without.force_N).reshape(3, 3, 3)
    # what acts at rest already is no drag
    once, twice = (np.linalg.norm(force[:, k] - force[:, 0], axis=1) for k in (1, 2))
    axis = int(np.argmax(once))
    # F(2 v) = 2 F(v) for a linear drag, 4 F(v) for a quadratic one
    if once[axis] <= 0.0 or abs(twice[axis] - 2.0 * once[axis]) > LINEAR * twice[axis]:
        return None
    return float(once[axis])


def with_force_per_speed(findings: Sequence[Finding], model: Model) -> list[Finding]:
    """Return the findings with the force per speed in their ``size``.

    Parameters
    ----------
    findings : those that the model lacks stay as they are.
    model : vehicle with all findings, as one may act through another.
    """
    rates = [
        force_per_speed_N_s_m(f.name, model) if f.name in model.effects else None for f in findings
    ]
    return [
        dataclasses.replace(f, size={**f.size, "force_per_speed_N_s_m": rate}) if rate else f
        for f, rate in zip(findings, rates, strict=True)
    ]
