"""What could be missing: every compiled effect, as columns that the library itself computes.

An effect enters a fit through *variants*: a setting of its shape parameters (decay, length, form)
with the amplitude parameters that multiply it. Which shapes are tried is search, not physics; the
equations stay in the library.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from ges.diagnose.prepare.align import Prepared, attitude_measured
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table

PARAMETER_EFFECTS = frozenset({"thrust_scale", "inertia", "torque_coefficient", "actuator_mapping"})
CUSHIONS_MODIFIED = (
    ("ground_effect_forward_flight", 1.0),
    ("ground_effect_forward_flight", 2.7),
    ("ground_effect_lag", 4.0),
)
SMALL_STEP = 0.1
LEAST_LAG_STEP_S, LAG_SHARES = 0.004, (0.25, 1.0, 3.0)
COMMAND_QUANTILES = (0.8, 0.95, 0.99, 0.999)
TAKE_OFF_SHARES = (0.1, 0.4, 0.7)
FINEST_SQUARE_M, MOST_PLACES = 0.125, 36
ABOVE_M, ABOVE_RADII = 0.5, 5.0
I_AXES = ("xx", "yy", "zz")
WIND = ("east_m_s", "north_m_s")
USUAL_ROUGHNESS_M, LOW_M = 0.03, 1.5
USUAL_DRAG = 0.02
"""Of the weight, at 1 m/s."""
DRAWN_M_PER_M = (0.6, 1.2)
"""How far behind a load may be drawn over the ground, over the height of flight."""
THREADS_M = (*(round(0.15 * 1.06**k, 3) for k in range(33)), 1.2, 1.7, 2.4)
"""Of hanging loads: a swing that is a twentieth too fast is out of step after ten."""
LYING_THREADS_M = (0.15, 0.2, 0.27, 0.36, 0.5, 0.7, 1.2, 2.4)
OUT_OF_STEP = 0.03
FREE_BELOW = {"below_m": 20.0}
DRAWN = {"start_x_m": 0.0, "start_y_m": 0.0}
"""First place of a load that lies on the ground: below, until the flights have moved it."""
NEEDS_ATTITUDE = frozenset(
    {
        "inertia",
        "torque_coefficient",
        "motor_lag",
        "esc_delay",
        "time_offset",
        "gyro_bias",
        "attitude_bias",
        "rotor_tilt",
        "rotor_inertia_reaction",
        "gyroscopic_moment",
        "rotor_drag",
        "parasitic_drag",
        "wind",
        "gusts",
        "wall_effect",
        "rotor_saturation",
    }
)
"""Effects that only a measured attitude or measured rates can show; a derived attitude tells the
slow balance alone.
"""


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


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect under test; it acts through one of those that it ``needs``."""

    name: str
    kind: str
    variants: tuple[Variant, ...]

    @property
    def needs(self) -> tuple[str, ...]:
        """See :func:`needs_of`."""
        return needs_of(self.name)

    @property
    def stands_alone(self) -> bool:
        """Whether it does anything where nothing else is on: it needs nothing, or its variants
        bring it.
        """
        return not self.needs or any(v.beside for v in self.variants)


@dataclasses.dataclass(frozen=True)
class Flown:
    """Where the flights went and what they asked of the motors; no force, no residual.

    Attributes
    ----------
    low_m, high_m : corners of the box of positions, world; None where no position was logged.
    middle_m : median of the positions by axis; None where no position was logged.
    places_m : middles of the squares of the ground plan that were visited, ``square_m`` wide.
    commands : levels near the top of the commands; empty where none were logged.
    tilt_seen : whether every flight logged its attitude.
    """

    low_m: tuple[float, ...] | None = None
    high_m: tuple[float, ...] | None = None
    middle_m: tuple[float, ...] | None = None
    places_m: tuple[tuple[float, float], ...] = ()
    square_m: float = 0.0
    commands: tuple[float, ...] = ()
    tilt_seen: bool = True


NOWHERE = Flown()


def flown(flights: Sequence[Prepared]) -> Flown:
    """Sum up where flights went, samples in the air alone, and what they asked."""
    levels = _asked(flights)
    tilt_seen = attitude_measured(flights)
    positions = [f.stack("position")[f.flying] for f in flights if f.has("position")]
    if not positions or not sum(len(p) for p in positions):
        return Flown(commands=levels, tilt_seen=tilt_seen)
    p = np.concatenate(positions)
    places, square = _places(p[:, :2])
    return Flown(
        tuple(p.min(axis=0)),
        tuple(p.max(axis=0)),
        tuple(np.median(p, axis=0)),
        places,
        square,
        levels,
        tilt_seen,
    )


def _asked(flights: Sequence[Prepared]) -> tuple[float, ...]:
    """Levels near the top of the commands in the air, and between there and what a take-
    off asks.
    """
    told = [f for f in flights if f.has("command") and f.flying.any()]
    if not told:
        return ()
    air = np.concatenate([f.stack("command")[f.flying].ravel() for f in told])
    top, most = float(air.max()), max(float(f.stack("command")[f.driven].max()) for f in told)
    between = top + (most - top) * np.array(TAKE_OFF_SHARES) if most > top else ()
    return tuple(float(level) for level in (*np.quantile(air, COMMAND_QUANTILES), *between))


def _places(plan: np.ndarray) -> tuple[tuple[tuple[float, float], ...], float]:
    """Squares of the ground plan that were visited, coarse enough to be few."""
    square = FINEST_SQUARE_M
    while True:
        corner = np.floor(plan / square)
        cells = np.unique(
            corner[:, 0] + 1j * corner[:, 1]
        )  # in the order of rows, and several times as fast
        if len(cells) <= MOST_PLACES:
            return (
                tuple(
                    (float((c.real + 0.5) * square), float((c.imag + 0.5) * square)) for c in cells
                ),
                square,
            )
        square *= 1.25


def kind_of(name: str) -> str:
    """Kind of a finding: physics, parameter or sensor."""
    if name in PARAMETER_EFFECTS:
        return "parameter"
    return "sensor" if effect_table.get(name).kind == "sensor" else "physics"


def amplitude_of(effect: str, name: str) -> Amplitude:
    """A parameter as a coefficient: a small step of its usual size, its bounds, and neutral at zero
    where it states none.
    """
    p = effect_table.get(effect).parameter(name)
    neutral = 0.0 if math.isnan(p.neutral) else p.neutral
    siblings = [
        q
        for q in effect_table.get(effect).parameters
        if q.unit == p.unit and not math.isnan(q.neutral)
    ]
    typical = (
        p.default - neutral
        or max((abs(q.default - q.neutral) for q in siblings), default=0.0)
        or 0.1 * (p.high - p.low)
    )
    return Amplitude(name, SMALL_STEP * typical, p.low, p.high, neutral)


def _variant(effect: str, amplitudes: tuple[str, ...], **shape: float) -> Variant:
    return Variant(effect, shape, tuple(amplitude_of(effect, name) for name in amplitudes))


def _plain(effect: str) -> tuple[Variant, ...]:
    """All parameters that can vanish, together."""
    names = tuple(p.name for p in effect_table.get(effect).parameters if not math.isnan(p.neutral))
    return (_variant(effect, names),)


def _grid(
    effect: str,
    amplitudes: tuple[str, ...],
    fixed: Mapping[str, float] | None = None,
    **axes: tuple[float, ...],
):
    return tuple(
        _variant(effect, amplitudes, **(fixed or {}), **dict(zip(axes, values, strict=True)))
        for values in itertools.product(*axes.values())
    )


def _plane_offsets(model: Model) -> tuple[float, ...]:
    return (
        tuple(model.plane_sd_m * k for k in (-1.5, -0.75, 0.0, 0.75, 1.5))
        if model.plane_sd_m > 0
        else (0.0,)
    )


def _ground_effect(model: Model) -> tuple[Variant, ...]:
    """Plain cushions, and some that fade with speed or lag: where one does, a fountain is nearer
    than any plain one.
    """
    offsets = _plane_offsets(model)
    scaled = _cushions(3.0, 0.35, 0.5, 0.75, 1.1, 1.6, 2.6) + _cushions(4.0, 0.4, 0.6, 0.9, 1.4)
    others = _grid(
        "ground_effect",
        ("amplitude",),
        {"high": 10.0},
        form=(0.0, 1.0, 2.0),
        rotor_plane_offset_m=offsets,
    )
    some = _cushions(3.0, 0.35) + _cushions(4.0, 0.4, 0.6, 0.9)
    ways = [{effect: {"c": c}} for effect, c in CUSHIONS_MODIFIED if effect not in model.effects]
    modified = [dataclasses.replace(v, beside=way) for v in some for way in ways]
    return (*scaled, *others, *modified)


def _cushions(form: float, *decays: float) -> tuple[Variant, ...]:
    return _grid(
        "ground_effect", ("c_a",), {"form": form, "amplitude": 1.0, "high": 10.0}, decay=decays
    )


def _hubs(model: Model) -> list[tuple[float, float]]:
    return [(model.number(f"rotor_{i}_x_m"), model.number(f"rotor_{i}_y_m")) for i in range(1, 5)]


def usual_height_m(model: Model, reached: Flown) -> float:
    """Over the ground, at the median of the positions."""
    x, y, z = reached.middle_m
    return z - float(model.terrain.at(np.array([x]), np.array([y])).height_m[0])


def _slung_load(model: Model, reached: Flown) -> tuple[Variant, ...]:
    """Hanging where the tilt shows its swing, on threads of several lengths below the middle and on
    one below each rotor, and drawn over the ground. Where the flights come lower than a thread is
    long, its load lies on the ground, or there is none there: they took off from a table, say.
    """
    drawn = _drawn_load(model, reached)
    if not reached.tilt_seen:
        return drawn
    lowest_m = reached.low_m[2] if reached.low_m else 0.0
    free = _grid("slung_load", ("mass_kg",), FREE_BELOW, length_m=THREADS_M)
    lying = _grid(
        "slung_load",
        ("mass_kg",),
        length_m=tuple(length for length in LYING_THREADS_M if length > lowest_m),
    )
    hubs = tuple(
        _variant("slung_load", ("mass_kg",), length_m=0.6, attach_x_m=x, attach_y_m=y, **FREE_BELOW)
        for x, y in _hubs(model)
    )
    return free + hubs + lying + drawn


def _drawn_load(model: Model, reached: Flown) -> tuple[Variant, ...]:
    """On threads longer than the height of flight, below the middle and below each rotor; none that
    stays slack all the way.
    """
    if reached.middle_m is None:
        return ()
    height = usual_height_m(model, reached)
    way = max(high - low for high, low in zip(reached.high_m[:2], reached.low_m[:2], strict=True))
    lengths = [
        height * math.hypot(1.0, k) for k in DRAWN_M_PER_M if height > 0.0 and k * height < way
    ]
    return tuple(
        _variant("slung_load", ("mass_kg",), length_m=length, attach_x_m=x, attach_y_m=y, **DRAWN)
        for x, y in ((0.0, 0.0), *_hubs(model))
        for length in lengths
    )


def _single(effect: str, names: tuple[str, ...]) -> tuple[Variant, ...]:
    return tuple(_variant(effect, (name,)) for name in names)


def _axes(effect: str, names: tuple[str, ...], **changes) -> tuple[Variant, ...]:
    """Every subset of the axes: an error of one axis does not pay for the others."""
    sets = [
        _variant(effect, c)
        for n in range(1, len(names) + 1)
        for c in itertools.combinations(names, n)
    ]
    return tuple(
        dataclasses.replace(
            v, amplitudes=tuple(dataclasses.replace(a, **changes) for a in v.amplitudes)
        )
        for v in sets
    )


def _at_level(variant: Variant, *steps: float, **changes) -> Variant:
    """The variant with columns of these whole steps, which hold about them."""
    moved = zip(variant.amplitudes, steps, strict=True)
    return dataclasses.replace(
        variant,
        amplitudes=tuple(dataclasses.replace(a, step=s, level=s, **changes) for a, s in moved),
    )


def _levels(effect: str, parameter: str, levels: tuple[float, ...]) -> tuple[Variant, ...]:
    """For what is not linear in its parameter: each column is the whole step from the neutral value
    to a level.
    """
    plain = _variant(effect, (parameter,))
    return tuple(_at_level(plain, level - plain.amplitudes[0].neutral) for level in levels)


def _slower(model: Model) -> tuple[Variant, ...]:
    """Motors slower than declared, slowing down no sooner than they speed up; faster ones are
    within the declared doubt or another matter.
    """
    both, declared = (
        _variant("motor_lag", ("up_s", "down_s")),
        model.number("motor_time_constant_s"),
    )
    levels = [max(share * declared, LEAST_LAG_STEP_S) for share in LAG_SHARES]
    return tuple(
        _at_level(both, up, down, low=0.0)
        for i, up in enumerate(levels)
        for down in levels[i : i + 2]
    )


def _ceilings(model: Model, reached: Flown) -> tuple[Variant, ...]:
    """Ceilings a little above the greatest height."""
    if reached.high_m is None:
        return ()
    top = reached.high_m[2] + max(model.number(f"rotor_{i}_z_m") for i in range(1, 5))
    return _grid(
        "ceiling_effect",
        ("amplitude",),
        ceiling_z_m=tuple(top + k * model.radius_m for k in (0.5, 1.0, 2.0, 4.0)),
    )


def _walls(model: Model, reached: Flown) -> tuple[Variant, ...]:
    """A wall beyond each side of what was flown; how far is one with how strong, since the pull is
    exponential.
    """
    if reached.high_m is None:
        return ()
    sides = (
        (0.0, reached.high_m[0]),
        (0.5 * math.pi, reached.high_m[1]),
        (math.pi, -reached.low_m[0]),
        (-0.5 * math.pi, -reached.low_m[1]),
    )
    return tuple(
        _variant("wall_effect", ("c",), bearing_rad=b, distance_m=d + model.radius_m)
        for b, d in sides
    )


def _other_vehicles(model: Model, reached: Flown) -> tuple[Variant, ...]:
    """Another vehicle above each place that was visited, with a wake as wide as the places are
    apart.
    """
    if reached.high_m is None:
        return ()
    above, wide = reached.high_m[2] + max(ABOVE_M, ABOVE_RADII * model.radius_m), {"spread": 0.0}
    wide["width_m"] = max(0.5 * reached.square_m, model.radius_m)
    return tuple(
        _variant("downwash", ("force_N",), **wide, other_x_m=x, other_y_m=y, other_z_m=above)
        for x, y in reached.places_m
    )


def wind_speed_m_s(values: Mapping[str, float]) -> float:
    """Of a wind by its parameters, at the heights of flights near ground."""
    low = effect_table.Samples.from_columns({"t_s": np.zeros(1), "p_z_m": np.full(1, LOW_M)})
    return float(
        np.linalg.norm(
            effect_table.replay({}, low, {"wind": values}).stack("wind_x_m_s", "wind_y_m_s")
        )
    )


def _winds(model: Model) -> tuple[Variant, ...]:
    """Uniform, or growing with height; through the drag that is on, else through a usual one."""
    found = _grid("wind", WIND, roughness_m=(0.0, USUAL_ROUGHNESS_M))
    if set(_CHILDREN["wind"]) & set(model.effects):
        return found
    usual = {"rotor_drag": {"k_kg": USUAL_DRAG * model.weight_N / (4.0 * model.hover_rad_s)}}
    return tuple(dataclasses.replace(v, beside=usual) for v in found)


def reach_of(name: tuple[str, str], values: effect_table.Effects, model: Model) -> float:
    """How far a parameter that is a place, or a thread's length, may move in one round of a fit, m:
    half of what it acts over, or what puts a swing out of step; 0 for all others.
    """
    if name == ("slung_load", "length_m"):
        return OUT_OF_STEP * values["slung_load"]["length_m"]
    if name[0] == "downwash" and name[1] != "force_N":
        return 0.5 * max(values["downwash"]["width_m"], model.radius_m)
    return 0.5 * model.radius_m if name == ("ceiling_effect", "ceiling_z_m") else 0.0


def _saturations(model: Model, reached: Flown) -> tuple[Variant, ...]:
    """The speed is cut at a level near the top of what was asked."""
    return _levels(
        "rotor_saturation",
        "share",
        tuple(sorted({round(q, 3) for q in reached.commands if 0.1 < q < 1.0})),
    )


_LAID_OUT: Mapping[str, Callable[[Model, Flown], tuple[Variant, ...]]] = {
    "ceiling_effect": _ceilings,
    "wall_effect": _walls,
    "downwash": _other_vehicles,
    "rotor_saturation": _saturations,
    "slung_load": _slung_load,
}
"""Candidates whose shapes depend on where the flights went."""
_SEARCH: Mapping[str, Callable[[Model], tuple[Variant, ...]]] = {
    "ground_effect": _ground_effect,
    "fountain_lift": lambda m: _grid("fountain_lift", ("c_b",), c_s=(0.5, 1.0, 2.0, 3.0)),
    "parasitic_drag": lambda m: _grid("parasitic_drag", ("area_m2",), vertical_ratio=(1.0, 1.7)),
    "weak_rotor": lambda m: _single("weak_rotor", tuple(f"loss_{i}" for i in range(1, 5))),
    "partial_ground_effect": lambda m: _levels("partial_ground_effect", "k", (0.4, 0.7, 1.0, 1.5)),
    "wind": _winds,
    "ground_effect_forward_flight": lambda m: _levels(
        "ground_effect_forward_flight", "c", (0.4, 1.0, 2.2, 5.0)
    ),
    "ground_effect_lag": lambda m: _levels("ground_effect_lag", "c", (0.7, 2.0, 5.0)),
    "battery_sag": lambda m: (
        _variant("battery_sag", ("sensitivity",), nominal_V=m.number("battery_nominal_V")),
    ),
    "tether": lambda m: (_variant("tether", ("weight_N_m",)),),
    "motor_lag": _slower,
    "esc_delay": lambda m: _levels("esc_delay", "delay_s", (0.005, 0.012, 0.03)),
    "accelerometer_bias": lambda m: _axes("accelerometer_bias", ("x_m_s2", "y_m_s2", "z_m_s2")),
    "attitude_bias": lambda m: _axes("attitude_bias", ("x_rad", "y_rad")),
    "rotor_tilt": lambda m: _axes("rotor_tilt", ("x_rad", "y_rad")),
    "cg_offset": lambda m: _axes("cg_offset", ("x_m", "y_m")),
    "inertia": lambda m: (
        _axes("inertia", I_AXES, step=0.4, low=0.0) + _axes("inertia", I_AXES, step=-0.3, high=0.0)
    ),
    "rangefinder_bias": lambda m: _single("rangefinder_bias", ("bias_m", "scale")),
    "rangefinder_lag": lambda m: _levels("rangefinder_lag", "tau_s", (0.05, 0.12, 0.3)),
}
NOT_SEARCHED: Mapping[str, str] = {
    "gusts": "they push through drag, and none is known or found here",
    "time_offset": "settled before the search, by the delay between streams",
    "gyro_bias": "settled before the search, by the attitude's own rate",
}
"""Effects that are flown but enter no search, and why."""
_CHILDREN: Mapping[str, tuple[str, ...]] = {"wind": ("rotor_drag", "parasitic_drag")}


def needs_of(name: str) -> tuple[str, ...]:
    """Effects of which one must be on for this one to act; none for most."""
    modifies = effect_table.get(name).modifies
    return (modifies,) if modifies else _CHILDREN.get(name, ())


def modifiers_of(variant: Variant) -> effect_table.Effects:
    """What a variant brings with it that acts through its effect."""
    return {
        name: values for name, values in variant.beside.items() if variant.effect in needs_of(name)
    }


def acts_among(name: str, present: Collection[str]) -> bool:
    """Whether an effect does anything beside those that are present."""
    return not needs_of(name) or not set(needs_of(name)).isdisjoint(present)


def _variants(name: str, model: Model, reached: Flown) -> tuple[Variant, ...]:
    if name in _LAID_OUT:
        return _LAID_OUT[name](model, reached)
    return _SEARCH[name](model) if name in _SEARCH else _plain(name)


def library(model: Model, reached: Flown = NOWHERE) -> dict[str, Candidate]:
    """Every candidate by name."""
    found = {}
    for name in effect_table.table():
        if (
            name in NOT_SEARCHED
            or name in model.effects
            and name not in ("weak_rotor", "cg_offset")
        ):
            continue
        variants = _variants(name, model, reached)
        if not variants:
            continue
        found[name] = Candidate(name, kind_of(name), variants)
    return found
