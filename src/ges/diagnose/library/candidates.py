"""Candidates: the compiled effects, each as variants that are linear in their amplitudes.

A *variant* fixes the shape parameters of an effect (decay, length, form). The amplitude parameters
that multiply it are estimated. The effect's descriptor states which variants are tried; ``grids``
makes them for the flights at hand.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ges.diagnose.prepare.align import Prepared, no_attitude_derived
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

HULL = "hull"
"""Reach of a place on the body."""


@dataclasses.dataclass(frozen=True)
class Amplitude:
    """One coefficient of a variant.

    Attributes
    ----------
    parameter : of the effect.
    step : difference of the parameter that makes the column.
    low, high : bounds of the parameter.
    neutral : value at which the effect vanishes.
    level : coefficient at which the column is exact, for an effect that is not linear in the
        parameter; 0 for one that is.
    """

    parameter: str
    step: float
    low: float
    high: float
    neutral: float
    level: float = 0.0


@dataclasses.dataclass(frozen=True)
class Variant:
    """One shape of one effect, linear (or linearised) in its amplitudes.

    Attributes
    ----------
    effect : its name.
    shape : values of the shape parameters.
    amplitudes : the coefficients.
    given : prerequisite effects at a usual size, where the vehicle has none of them on.
    moment_gain : factor on all moments, in a search that tries several. None where they are as the
        effect makes them, or have a coefficient of their own.
    """

    effect: str
    shape: Mapping[str, float]
    amplitudes: tuple[Amplitude, ...]
    given: effect_table.Effects = dataclasses.field(default_factory=dict)
    moment_gain: float | None = None

    @property
    def places(self) -> tuple[str, ...]:
        """Where the amplitudes act, ``rotor 3``; empty for effects without several places."""
        if "many" not in effect_table.get(self.effect).hints:
            return ()
        return tuple(filter(None, (place_of(a.parameter) for a in self.amplitudes)))

    @property
    def key(self) -> str:
        """Unique text of shape, amplitudes and steps."""
        values = {
            **self.shape,
            **{f"{e}.{k}": v for e, values in self.given.items() for k, v in values.items()},
        }
        shape = ",".join(f"{k}={v:g}" for k, v in values.items())
        amplitudes = ",".join(f"{a.parameter} by {a.step:g}" for a in self.amplitudes)
        gain = "" if self.moment_gain is None else f"{{moment by {self.moment_gain:g}}}"
        return f"{self.effect}[{shape}]({amplitudes}){gain}"

    def parameters(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return all parameters of the effect.

        Parameters
        ----------
        values : amplitudes that are set; all others are neutral.
        """
        zero = {a.parameter: a.neutral for a in self.amplitudes}
        return {**effect_table.get(self.effect).neutral(), **self.shape, **zero, **values}


def place_of(parameter: str) -> str:
    """Return where a parameter acts.

    Parameters
    ----------
    parameter : a numbered one, ``loss_3``, acts at a rotor.

    Returns
    -------
    ``rotor 3``; '' for parameters without a number.
    """
    numbered = re.fullmatch(r".*_(\d+)", parameter)
    return f"rotor {numbered[1]}" if numbered else ""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect under test.

    Attributes
    ----------
    name, kind : of the effect.
    variants : its shapes that are tried.
    """

    name: str
    kind: str
    variants: tuple[Variant, ...]

    @property
    def prerequisites(self) -> tuple[str, ...]:
        """Effects of which one must be on for this one to act; empty for most."""
        return effect_table.get(self.name).prerequisites

    @property
    def stands_alone(self) -> bool:
        """Whether it acts where nothing else is on: it needs no prerequisite, or brings one."""
        return not self.prerequisites or any(v.given for v in self.variants)


@dataclasses.dataclass(frozen=True)
class FlightEnvelope:
    """Where the flights went and what they commanded; no force and no residual.

    Attributes
    ----------
    low_m, high_m : corners of the box of positions, world; None where no position was logged.
    middle_m : median position by axis, world; None where no position was logged.
    places_m : centres (x, y) of the squares of the ground plan that were visited.
    square_m : width of the squares.
    commands : high quantiles of the commands in the air, 0 to 1; empty where none were logged.
    largest_commands : the largest command in the air, and including take-offs.
    fastest_rad_s : fastest logged rotor speed; 0 where none was logged.
    attitude_derived : whether some flight's attitude was derived from its acceleration.
    """

    low_m: tuple[float, ...] | None = None
    high_m: tuple[float, ...] | None = None
    middle_m: tuple[float, ...] | None = None
    places_m: tuple[tuple[float, float], ...] = ()
    square_m: float = 0.0
    commands: tuple[float, ...] = ()
    largest_commands: tuple[float, float] = (0.0, 0.0)
    fastest_rad_s: float = 0.0
    attitude_derived: bool = False


def flight_envelope(flights: Sequence[Prepared], radius_m: float) -> FlightEnvelope:
    """Return the envelope of flights, from samples in the air.

    Parameters
    ----------
    flights : prepared recordings.
    radius_m : rotor radius; squares of the ground plan are at least twice as wide.
    """
    levels, most = _command_levels(flights)
    turned = [float(f.stack("rotor_speed").max()) for f in flights if f.has("rotor_speed")]
    envelope = FlightEnvelope(
        commands=levels,
        largest_commands=most,
        fastest_rad_s=max(turned, default=0.0),
        attitude_derived=not no_attitude_derived(flights),
    )
    positions = [f.stack("position")[f.flying] for f in flights if f.has("position")]
    if not sum(len(p) for p in positions):
        return envelope
    p = np.concatenate(positions)
    places, square = _visited_squares(p[:, :2], 2.0 * radius_m)
    return dataclasses.replace(
        envelope,
        low_m=tuple(p.min(axis=0)),
        high_m=tuple(p.max(axis=0)),
        middle_m=tuple(np.median(p, axis=0)),
        places_m=places,
        square_m=square,
    )


def _command_levels(flights: Sequence[Prepared]) -> tuple[tuple[float, ...], tuple[float, float]]:
    """Return high quantiles of the commands in the air, and the largest commands.

    The latter are those in the air and in a take-off.
    """
    commanded = [f for f in flights if f.has("command") and f.flying.any()]
    if not commanded:
        return (), (0.0, 0.0)
    air = np.concatenate([f.stack("command")[f.flying].ravel() for f in commanded])
    most = max(float(f.stack("command")[f.driven].max()) for f in commanded)
    levels = np.quantile(air, settings.library.command_quantiles)
    return tuple(map(float, levels)), (float(air.max()), most)


def _visited_squares(
    plan: np.ndarray, square: float
) -> tuple[tuple[tuple[float, float], ...], float]:
    """Return centres and width of the visited squares of the ground plan (n, 2).

    They are widened until they are few.
    """
    while True:
        corner = np.floor(plan / square)
        # in the order of rows, and several times as fast
        cells = np.unique(corner[:, 0] + 1j * corner[:, 1])
        if len(cells) <= settings.library.places_most:
            return (
                tuple(
                    (float((c.real + 0.5) * square), float((c.imag + 0.5) * square)) for c in cells
                ),
                square,
            )
        # twice the area halves the count or so: squares stay as fine as the limit allows
        square *= math.sqrt(2.0)


def amplitude_of(effect: str, name: str) -> Amplitude:
    """Return a parameter as a coefficient with step, bounds and neutral value.

    Parameters
    ----------
    effect : name of the effect.
    name : of the parameter; one that states no neutral value is neutral at zero.

    Notes
    -----
    The step is a small share of the parameter's usual size.
    """
    p, share = effect_table.get(effect).parameter(name), settings.library.step_share
    neutral = 0.0 if math.isnan(p.neutral) else p.neutral
    siblings = [
        q
        for q in effect_table.get(effect).parameters
        if q.unit == p.unit and not math.isnan(q.neutral)
    ]
    # neutral by default, a parameter borrows its size from one of the same unit, or its range
    typical = (
        p.default - neutral
        or max((abs(q.default - q.neutral) for q in siblings), default=0.0)
        or share * (p.high - p.low)
    )
    return Amplitude(name, share * typical, p.low, p.high, neutral)


def usual_height_m(model: Model, envelope: FlightEnvelope) -> float:
    """Return the height over the ground at the median position.

    Parameters
    ----------
    model : with the terrain.
    envelope : of the flights.

    Raises
    ------
    ValueError
        Where no position was logged.
    """
    if envelope.middle_m is None:
        raise ValueError("no height without a position; log one")
    x, y, z = envelope.middle_m
    return z - float(model.terrain.at(np.array([x]), np.array([y])).height_m[0])


def reach_of(name: tuple[str, str], values: effect_table.Effects, model: Model) -> float:
    """Return how far a place or a thread's length may move in one round of a fit, m.

    Parameters
    ----------
    name : effect and parameter.
    values : current parameters of all effects.
    model : for the rotor radius.

    Returns
    -------
    A share of the distance that the effect acts over; 0 for all other parameters.
    """
    effect, parameter = name
    p = effect_table.get(effect).parameter(parameter)
    if not p.reach:
        return 0.0
    if p.reach_over in ("radius", HULL):
        return p.reach * (model.hull_m if p.reach_over == HULL else model.radius_m)
    # a rotor averages over its disc: what is narrower still acts over a radius
    over = values[effect][p.reach_over]
    return p.reach * (over if p.reach_over == parameter else max(over, model.radius_m))


def fit_bounds(name: tuple[str, str], model: Model) -> tuple[float, float]:
    """Return the bounds of a parameter in a fit.

    Parameters
    ----------
    name : effect and parameter.
    model : for the hull, which a place on the body does not leave.
    """
    p = effect_table.get(name[0]).parameter(name[1])
    reach = model.hull_m if p.reach_over == HULL else math.inf
    return max(p.fit_low, -reach), min(p.fit_high, reach)


def modifiers_of(variant: Variant) -> effect_table.Effects:
    """Return the effects given with a variant that act through its own effect.

    Parameters
    ----------
    variant : of any effect.
    """
    return effect_table.only(variant.given, lambda e: variant.effect in e.prerequisites)


def family_of(name: str) -> set[str]:
    """Return the names of all effects that act in the same place, this one included.

    Parameters
    ----------
    name : of an effect.
    """
    family = effect_table.get(name).family
    return {e.name for e in effect_table.table().values() if e.family == family}


def has_prerequisite(name: str, present: Collection[str]) -> bool:
    """Return whether an effect can act, given which others are present.

    Parameters
    ----------
    name : of the effect; one without prerequisites always acts.
    present : names of effects that are on.
    """
    prerequisites = effect_table.get(name).prerequisites
    return not prerequisites or not set(prerequisites).isdisjoint(present)
