"""What could be missing: every compiled effect, as columns that the library itself computes.

An effect enters a fit through *variants*: a setting of its shape parameters (decay, length, form)
with the amplitude parameters that multiply it. Which are tried stands in the effect's descriptor;
``grids`` lays them out over the flights.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ges.diagnose.prepare.align import Prepared, attitude_measured
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table


@dataclasses.dataclass(frozen=True)
class Amplitude:
    """One coefficient of a variant: the parameter it moves, its step for the column, and its
    bounds.

    ``level`` is the coefficient that the column holds at where the effect is not linear in it; 0
    where it is.
    """

    parameter: str
    step: float
    low: float
    high: float
    neutral: float
    level: float = 0.0


@dataclasses.dataclass(frozen=True)
class Variant:
    """One shape of one effect, linear (or linearised) in its amplitudes; ``beside`` are effects
    through which it acts, at a usual size, where the vehicle has none of them on.
    """

    effect: str
    shape: Mapping[str, float]
    amplitudes: tuple[Amplitude, ...]
    beside: effect_table.Effects = dataclasses.field(default_factory=dict)

    @property
    def places(self) -> tuple[str, ...]:
        """Where an effect acts that may act in several places, ``rotor 3``, by its numbered
        amplitudes; none for all others.
        """
        if "many" not in effect_table.get(self.effect).hints:
            return ()
        return tuple(filter(None, (place_of(a.parameter) for a in self.amplitudes)))

    @property
    def key(self) -> str:
        """A name for the shape, the amplitudes and their steps."""
        known = {
            **self.shape,
            **{f"{e}.{k}": v for e, values in self.beside.items() for k, v in values.items()},
        }
        shape = ",".join(f"{k}={v:g}" for k, v in known.items())
        amplitudes = ",".join(f"{a.parameter} by {a.step:g}" for a in self.amplitudes)
        return f"{self.effect}[{shape}]({amplitudes})"

    def parameters(self, values: Mapping[str, float]) -> dict[str, float]:
        """The effect's parameters with the given amplitudes, all others neutral."""
        zero = {a.parameter: a.neutral for a in self.amplitudes}
        return {**effect_table.get(self.effect).neutral(), **self.shape, **zero, **values}


def place_of(parameter: str) -> str:
    """``rotor 3`` of a numbered parameter, ``loss_3``; '' of all others."""
    numbered = re.fullmatch(r".*_(\d+)", parameter)
    return f"rotor {numbered[1]}" if numbered else ""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect under test; it acts through one of its ``carriers``."""

    name: str
    kind: str
    variants: tuple[Variant, ...]

    @property
    def carriers(self) -> tuple[str, ...]:
        """Effects of which one must be on for this one to act."""
        return effect_table.get(self.name).carriers

    @property
    def stands_alone(self) -> bool:
        """Whether it does anything where nothing else is on: it needs no carrier, or its variants
        bring one.
        """
        return not self.carriers or any(v.beside for v in self.variants)


@dataclasses.dataclass(frozen=True)
class Flown:
    """Where the flights went and what they asked of the motors; no force, no residual.

    Attributes
    ----------
    low_m, high_m : corners of the box of positions, world; None where no position was logged.
    middle_m : median of the positions by axis; None where no position was logged.
    places_m : middles of the squares of the ground plan that were visited, ``square_m`` wide.
    commands : levels near the top of the commands in the air; empty where none were logged.
    asked_most : the largest of those, and of a take-off's too.
    speed_most_rad_s : the fastest that any rotor was logged to turn; 0 where none was logged.
    tilt_seen : whether every flight logged its attitude.
    """

    low_m: tuple[float, ...] | None = None
    high_m: tuple[float, ...] | None = None
    middle_m: tuple[float, ...] | None = None
    places_m: tuple[tuple[float, float], ...] = ()
    square_m: float = 0.0
    commands: tuple[float, ...] = ()
    asked_most: tuple[float, float] = (0.0, 0.0)
    speed_most_rad_s: float = 0.0
    tilt_seen: bool = True


NOWHERE = Flown()


def flown(flights: Sequence[Prepared], radius_m: float) -> Flown:
    """Sum up where flights went, samples in the air alone, and what they asked; no square of the
    ground plan is finer than a rotor of this radius.
    """
    levels, most = _asked(flights)
    tilt_seen = attitude_measured(flights)
    turned = [float(f.stack("rotor_speed").max()) for f in flights if f.has("rotor_speed")]
    fastest = max(turned, default=0.0)
    positions = [f.stack("position")[f.flying] for f in flights if f.has("position")]
    if not positions or not sum(len(p) for p in positions):
        return Flown(
            commands=levels, asked_most=most, speed_most_rad_s=fastest, tilt_seen=tilt_seen
        )
    p = np.concatenate(positions)
    places, square = _places(p[:, :2], 2.0 * radius_m)
    return Flown(
        tuple(p.min(axis=0)),
        tuple(p.max(axis=0)),
        tuple(np.median(p, axis=0)),
        places,
        square,
        levels,
        most,
        fastest,
        tilt_seen,
    )


def _asked(flights: Sequence[Prepared]) -> tuple[tuple[float, ...], tuple[float, float]]:
    """Levels near the top of the commands in the air, the largest there, and that of a take-off."""
    told = [f for f in flights if f.has("command") and f.flying.any()]
    if not told:
        return (), (0.0, 0.0)
    air = np.concatenate([f.stack("command")[f.flying].ravel() for f in told])
    most = max(float(f.stack("command")[f.driven].max()) for f in told)
    levels = np.quantile(air, settings.library.command_quantiles)
    return tuple(map(float, levels)), (float(air.max()), most)


def _places(plan: np.ndarray, square: float) -> tuple[tuple[tuple[float, float], ...], float]:
    """Squares of the ground plan that were visited, so wide or coarse enough to be few."""
    while True:
        corner = np.floor(plan / square)
        cells = np.unique(
            corner[:, 0] + 1j * corner[:, 1]
        )  # in the order of rows, and several times as fast
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
    """A parameter as a coefficient: a small step of its usual size, its bounds, and neutral at zero
    where it states none.
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


def usual_height_m(model: Model, reached: Flown) -> float:
    """Over the ground, at the median of the positions.

    Raises
    ------
    ValueError : where no position was logged.
    """
    if reached.middle_m is None:
        raise ValueError("no height without a position; log one")
    x, y, z = reached.middle_m
    return z - float(model.terrain.at(np.array([x]), np.array([y])).height_m[0])


def reach_of(name: tuple[str, str], values: effect_table.Effects, model: Model) -> float:
    """How far a parameter that is a place, or a thread's length, may move in one round of a fit, m:
    a share of what it acts over; 0 for all others.
    """
    effect, parameter = name
    p = effect_table.get(effect).parameter(parameter)
    if not p.reach:
        return 0.0
    if p.reach_over == "radius":
        return p.reach * model.radius_m
    # a rotor averages over its disc: what is narrower still acts over a radius
    over = values[effect][p.reach_over]
    return p.reach * (over if p.reach_over == parameter else max(over, model.radius_m))


def modifiers_of(variant: Variant) -> effect_table.Effects:
    """What a variant brings with it that acts through its effect."""
    return {
        name: values
        for name, values in variant.beside.items()
        if variant.effect in effect_table.get(name).carriers
    }


def family_of(name: str) -> set[str]:
    """Effects that act in the same place, this one among them."""
    family = effect_table.get(name).family
    return {e.name for e in effect_table.table().values() if e.family == family}


def acts_among(name: str, present: Collection[str]) -> bool:
    """Whether an effect does anything beside those that are present."""
    carriers = effect_table.get(name).carriers
    return not carriers or not set(carriers).isdisjoint(present)
