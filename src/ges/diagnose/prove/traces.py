"""Recorded and simulated signals over time.

Channels are averaged over windows, as in every error. Positions and velocities are simulated ahead
from the recorded state.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from ges.conventions import POSITION, VELOCITY
from ges.diagnose.design.drives import Drive
from ges.diagnose.design.residual import evaluate, residual
from ges.diagnose.design.weak import Windows, make_windows
from ges.diagnose.estimate.shoot import can_roll_out, fly_rollouts
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import channels, unit_of
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator.effects import Replay, replay_rows

AHEAD = (*POSITION, *VELOCITY)


@dataclasses.dataclass(frozen=True)
class Span:
    """A stretch of a flight that is left out.

    Attributes
    ----------
    start_s, end_s : on the flight's own clock.
    reason : why.
    """

    start_s: float
    end_s: float
    reason: str


@dataclasses.dataclass(frozen=True)
class Trace:
    """One flight as it was recorded and as each model makes it.

    Attributes
    ----------
    flight : its name.
    held_out : whether it took no part in fitting or choosing.
    t_s : (m,) centres of the windows, on the flight's own clock.
    used : (m,) True where the whole window flies.
    channels : names with their units: ``force_z_N``, body frame; ``p_z_m``, world.
    ahead : those that are simulated ahead, again and again from the recorded state.
    recorded : (m, C) signals of the recording.
    simulated : by stage, (m, C) signals of a model; NaN where a window is not used.
    left_out : spans that are not used.
    """

    flight: str
    held_out: bool
    t_s: np.ndarray
    used: np.ndarray
    channels: tuple[str, ...]
    ahead: frozenset[str]
    recorded: np.ndarray
    simulated: Mapping[str, np.ndarray]
    left_out: tuple[Span, ...]


def trace(
    flight: Prepared, name: str, held_out: bool, models: Mapping[str, Model], length_s: float
) -> Trace:
    """Return one flight under every model.

    Parameters
    ----------
    flight : prepared recording.
    name, held_out : of the flight, given back.
    models : by stage.
    length_s : support of a window.
    """
    everywhere = make_windows(flight.t_s, np.ones(len(flight.t_s), bool), length_s)
    used = everywhere.within(flight.flying)
    windows, first = everywhere.select(used), next(iter(models.values()))
    names = channels(flight, first)
    recorded = recorded_signals(flight, everywhere, first, names)
    simulated = {stage: np.full_like(recorded, np.nan) for stage in models}
    for stage, model in models.items():
        # residual is recorded less model
        simulated[stage][used] = recorded[used] - residual(flight, windows, model, names)
    named = tuple(f"{n}_{unit_of(n)}" for n in names)
    if can_roll_out(flight):
        rolled = {s: _rollout_signals(flight, everywhere, model) for s, model in models.items()}
        recorded = np.hstack([recorded, next(iter(rolled.values()))[0]])
        simulated = {s: np.hstack([simulated[s], rolled[s][1]]) for s in models}
        named += AHEAD
    return Trace(
        flight=name,
        held_out=held_out,
        t_s=everywhere.center_s,
        used=used,
        channels=named,
        ahead=frozenset(AHEAD) & set(named),
        recorded=recorded,
        simulated=simulated,
        left_out=excluded_spans(flight),
    )


def _rollout_signals(
    flight: Prepared, windows: Windows, model: Model
) -> tuple[np.ndarray, np.ndarray]:
    """Return recorded and simulated :data:`AHEAD` at the centres of the windows, (m, 6) each.

    Every horizon starts again from the recording; NaN where none is flown.
    """
    n = int(round(settings.report.horizon_s / flight.dt_s))
    rolled, at = fly_rollouts(flight, model, n), windows.center
    recorded = np.stack([rolled.recorded[name][at] for name in AHEAD], axis=1)
    simulated = np.full_like(recorded, np.nan)
    for start, record in zip(rolled.starts, rolled.flown, strict=True):
        rows = np.flatnonzero((at >= start) & (at < start + n))
        # beyond where the simulator gave up, nothing was simulated
        clock, late_s = record["t_s"] - record["t_s"][0], (at[rows] - start) * flight.dt_s
        for c, name in enumerate(AHEAD):
            simulated[rows, c] = np.interp(late_s, clock, record[name], right=np.nan)
    return recorded, simulated


def recorded_signals(
    flight: Prepared, windows: Windows, model: Model, names: Sequence[str]
) -> np.ndarray:
    """Return the signals of the recording: the residual of a model without force and moment.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight.
    model : for mass and inertia; no sensor is corrected.
    names : of the C channels.

    Returns
    -------
    (m, C), in the channels' units.
    """
    no_effects = dataclasses.replace(model, effects={})
    # equation (1) of docs/method.md with the model's force and moment zero
    n_rotors, rows = model.n_rotors, replay_rows(model.n_rotors)
    no_model_output = Replay(np.zeros((len(rows), len(flight.t_s))), n_rotors, tuple(rows))
    for name in ("mass_kg", "ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"):
        no_model_output.data[rows[name]] = model.number(name)
    still = np.zeros((len(flight.t_s), n_rotors))
    signals = evaluate(
        flight, windows, no_effects, names, drive=Drive(still, still), output=no_model_output
    )
    return signals.stack(names)


def excluded_spans(flight: Prepared) -> tuple[Span, ...]:
    """Return every stretch that is left out, in order of time.

    Parameters
    ----------
    flight : prepared recording.
    """
    spans = []
    for reason, at in flight.excluded.items():
        # padded, so that every stretch turns on and off, one at an end of the flight too
        turns = np.flatnonzero(np.diff(np.r_[False, at, False].astype(np.int8)))
        ends = np.r_[flight.t_s, flight.t_s[-1] + flight.dt_s]
        spans += [
            Span(float(ends[a]), float(ends[b]), reason) for a, b in list(pairwise(turns))[::2]
        ]
    return tuple(sorted(spans, key=lambda span: (span.start_s, span.end_s, span.reason)))
