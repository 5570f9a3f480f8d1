"""Variants of every effect, laid out as its descriptor asks: one rule a function.

A rule sees the effect, one row of its searches, the vehicle and where the flights went; no force
and no residual.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ges.diagnose.library.candidates import (
    Candidate,
    Flown,
    Variant,
    amplitude_of,
    usual_height_m,
)
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator.effects import Effect, Parameter, SearchHints

Rule = Callable[[Effect, SearchHints, Model, Flown], tuple[Variant, ...]]
NOWHERE = Flown()


def library(model: Model, reached: Flown = NOWHERE) -> dict[str, Candidate]:
    """Every candidate by name, of the shapes that the library flies."""
    moved = {key.split(".")[0] for key in model.moved}
    found = {}
    for effect in effect_table.table().values():
        # what the file has is known; what recalibration put there or moved may still be found
        known = effect.name in model.effects and effect.name not in moved
        if effect.settled or known and "many" not in effect.hints:
            continue
        variants = tuple(filter(_is_flown, _variants(effect, model, reached)))
        if variants:
            found[effect.name] = Candidate(effect.name, effect.about, variants)
    return found


def out_of_reach(effect: Effect, model: Model, reached: Flown) -> str:
    """Why no variant of an effect is tried: flights so wide, or so high, that what would act on
    them is beyond the bounds of its parameters; '' where that is not why.
    """
    listed = _variants(effect, model, reached)
    if not listed or any(map(_is_flown, listed)):
        return ""
    shape = listed[0].shape
    p = next(p for p in effect.parameters if p.name in shape and not _is_within(p, shape))
    return (
        f"it would take {p.name} {shape[p.name]:.3g} {p.unit} on flights as wide or as high as"
        f" these, and {p.low:g} to {p.high:g} is what it is known for"
    )


def _variants(effect: Effect, model: Model, reached: Flown) -> tuple[Variant, ...]:
    """All variants; without a search of its own all that can vanish, together."""
    if not effect.searches:
        here = effect.of_rotors(model.n_rotors)
        names = (p.name for p in here if not math.isnan(p.neutral))
        return (_variant(effect, tuple(names)),)
    listed = [v for s in effect.searches for v in RULES[s.rule](effect, s, model, reached)]
    usual = _usual_carrier(effect, model)
    return tuple(dataclasses.replace(v, beside=usual) if usual else v for v in listed)


def _is_flown(variant: Variant) -> bool:
    """Whether the shape lies within the bounds of its effect's parameters."""
    rows = (effect_table.get(variant.effect).parameter(name) for name in variant.shape)
    return all(_is_within(p, variant.shape) for p in rows)


def _is_within(p: Parameter, shape: Mapping[str, float]) -> bool:
    return p.low <= shape[p.name] <= p.high


def _usual_carrier(effect: Effect, model: Model) -> effect_table.Effects:
    """What an effect acts through, at its usual size, where the vehicle has none of it on: so large
    that at 1 m/s it makes its share of the weight.
    """
    if not effect.through or set(effect.through) & set(model.effects):
        return {}
    carrier = effect_table.get(effect.through[0])
    # a rotor drag, c v times the sum of speeds, is that share of the weight at 1 m/s in hover
    (p,) = (p for p in carrier.parameters if p.usual_share)
    return {
        carrier.name: {
            p.name: p.usual_share * model.weight_N / (model.n_rotors * model.hover_rad_s)
        }
    }


def _variant(effect: Effect, amplitudes: tuple[str, ...], **shape: float) -> Variant:
    return Variant(effect.name, shape, tuple(amplitude_of(effect.name, n) for n in amplitudes))


def _grid(effect: Effect, search: SearchHints, model: Model, reached: Flown) -> tuple[Variant, ...]:
    """One variant for each level of the axis and of what is declared across it, plain or with each
    effect that modifies it.
    """
    axes = {search.axis[0]: search.levels} if search.axis else {}
    if search.across:
        sd = model.plane_sd_m
        # a declared number that shapes the effect is tried across its doubt, or taken as certain
        most = round(settings.statistics.suggestive_sds)
        axes[search.across] = tuple(k * sd for k in range(-most, most + 1)) if sd > 0.0 else (0.0,)
    plain = tuple(
        _variant(
            effect,
            search.amplitudes,
            **search.fixed,
            **dict(zip(axes, values, strict=True)),
        )
        for values in itertools.product(*axes.values())
    )
    if not search.modified:
        return plain
    ways = [
        {other.name: {other.amplitudes[0]: level}}
        for other in effect_table.table().values()
        if other.modifies == effect.name and other.name not in model.effects
        for level in other.carried
    ]
    return tuple(dataclasses.replace(v, beside=way) for v in plain for way in ways)


def _each(effect: Effect, search: SearchHints, model: Model, reached: Flown) -> tuple[Variant, ...]:
    """One variant an amplitude."""
    return tuple(_variant(effect, (name,)) for name in search.amplitudes)


def _places(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """At each place, one amplitude a place, and at each two of them; towards more of it alone, as
    no blade heals.
    """
    here = [n for n in search.amplitudes if effect.parameter(n).rotor <= model.n_rotors]
    sets = (c for n in (1, 2) for c in itertools.combinations(here, n))
    return tuple(_one_way(_variant(effect, names), low=0.0) for names in sets)


def _axes(effect: Effect, search: SearchHints, model: Model, reached: Flown) -> tuple[Variant, ...]:
    """Every subset of the axes: an error of one axis does not pay for the others. Levels are steps
    of the columns, each of which holds on its side of neutral.
    """
    sets = [
        _variant(effect, names)
        for n in range(1, len(search.amplitudes) + 1)
        for names in itertools.combinations(search.amplitudes, n)
    ]
    if not search.levels:
        return tuple(sets)
    sides = [{"step": s, ("low" if s > 0.0 else "high"): 0.0} for s in search.levels]
    return tuple(_one_way(v, **side) for side in sides for v in sets)


def _one_way(variant: Variant, **changes: Any) -> Variant:
    """The variant with other steps or bounds of all of its amplitudes."""
    changed = tuple(dataclasses.replace(a, **changes) for a in variant.amplitudes)
    return dataclasses.replace(variant, amplitudes=changed)


def _at_level(variant: Variant, *steps: float, **changes: Any) -> Variant:
    """The variant with columns of these whole steps, which hold about them."""
    moved = zip(variant.amplitudes, steps, strict=True)
    return dataclasses.replace(
        variant,
        amplitudes=tuple(dataclasses.replace(a, step=s, level=s, **changes) for a, s in moved),
    )


def _at_levels(
    effect: Effect, search: SearchHints, levels: tuple[float, ...]
) -> tuple[Variant, ...]:
    plain = _variant(effect, search.amplitudes)
    return tuple(_at_level(plain, level - plain.amplitudes[0].neutral) for level in levels)


def _levels(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """For what is not linear in its parameter: each column is the whole step from the neutral value
    to a level.
    """
    return _at_levels(effect, search, search.levels)


def _asked(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """Levels near the top of what was asked of the motors in the air, and shares of the way from
    there to what a take-off asks; no ceiling that the rotors were logged to turn faster than.
    """
    (p,) = map(effect.parameter, search.amplitudes)
    top, most = reached.asked_most
    between = [top + (most - top) * share for share in search.levels] if most > top else []
    # levels that are all but equal would be copies of one column
    levels = sorted({round(q, 3) for q in (*reached.commands, *between) if p.low < q < p.high})
    turned = reached.speed_most_rad_s / model.number("max_rotor_speed_rad_s")
    return _at_levels(effect, search, tuple(q for q in levels if q >= turned))


def _slower(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """Slower than declared by shares of it, slowing down no sooner than speeding up; faster ones
    are within the declared doubt or another matter.
    """
    both, declared = _variant(effect, search.amplitudes), model.number("motor_time_constant_s")
    # below the finest step of a grid a lag does not show in any log
    levels = [
        max(share * declared, settings.prepare.grid_step_shortest_s) for share in search.levels
    ]
    return tuple(
        _at_level(both, up, down, low=0.0)
        for i, up in enumerate(levels)
        # down as slow as up, or one level slower
        for down in levels[i : i + 2]
    )


def _above(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """A little above the greatest height of the rotors, by radii."""
    if reached.high_m is None:
        return ()
    top = reached.high_m[2] + float(model.of_rotors("z_m").max())
    heights = (top + k * model.radius_m for k in search.levels)
    return tuple(_variant(effect, search.amplitudes, **{search.axis[0]: z}) for z in heights)


def _beside(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """A radius beyond each side of what was flown; where a pull is exponential, how far is one with
    how strong.
    """
    if reached.low_m is None or reached.high_m is None:
        return ()
    distance, bearing = search.axis
    # bearings east, north, west and south, with the edge of the box along each
    sides = (
        (0.0, reached.high_m[0]),
        (0.5 * math.pi, reached.high_m[1]),
        (math.pi, -reached.low_m[0]),
        (-0.5 * math.pi, -reached.low_m[1]),
    )
    return tuple(
        _variant(effect, search.amplitudes, **{bearing: b, distance: d + model.radius_m})
        for b, d in sides
    )


def _over_places(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """Above each place that was visited, as wide as the places are apart, so many radii above the
    highest.
    """
    if reached.high_m is None:
        return ()
    x_name, y_name, z_name, width = search.axis
    # over the highest that was flown anywhere: a rotor never passes through what is there
    (radii,) = search.levels
    above = reached.high_m[2] + radii * model.radius_m
    wide = max(0.5 * reached.square_m, model.radius_m)
    return tuple(
        _variant(
            effect,
            search.amplitudes,
            **search.fixed,
            **{width: wide, x_name: x, y_name: y, z_name: above},
        )
        for x, y in reached.places_m
    )


def _hanging(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """Free below the middle, where the tilt shows a swing."""
    return _grid(effect, search, model, reached) if reached.tilt_seen else ()


def _lying(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """On threads that are longer than the flights are low: the load lies on the ground there."""
    lowest_m = reached.low_m[2] if reached.low_m else 0.0
    levels = tuple(length for length in search.levels if length > lowest_m)
    return _hanging(effect, dataclasses.replace(search, levels=levels), model, reached)


def _hubs(model: Model) -> list[tuple[float, float]]:
    return list(zip(model.of_rotors("x_m"), model.of_rotors("y_m"), strict=True))


def _at(
    effect: Effect, search: SearchHints, places: Iterable[tuple[float, float]]
) -> tuple[Variant, ...]:
    """At each of these places (x, y)."""
    x_name, y_name = search.axis
    return tuple(
        _variant(effect, search.amplitudes, **search.fixed, **{x_name: x, y_name: y})
        for x, y in places
    )


def _at_hubs(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """Free below each rotor."""
    return _at(effect, search, _hubs(model)) if reached.tilt_seen else ()


def _on_body(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """In the middle, at each hub, and halfway between; a fit moves it from there."""
    hubs = [(k * x, k * y) for k in (0.5, 1.0) for x, y in _hubs(model)]
    return _at(effect, search, dict.fromkeys([(0.0, 0.0), *hubs]))


def _coaxial(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """Where a rotor lies over another."""
    return _grid(effect, search, model, reached) if model.coaxial else ()


def _drawn(
    effect: Effect, search: SearchHints, model: Model, reached: Flown
) -> tuple[Variant, ...]:
    """Drawn over the ground on threads longer than the height of flight, below the middle and below
    each rotor; none that stays slack all the way. Levels are how far behind, over that height.
    """
    if reached.low_m is None or reached.high_m is None:
        return ()
    length_name, x_name, y_name = search.axis
    height = usual_height_m(model, reached)
    way = max(high - low for high, low in zip(reached.high_m[:2], reached.low_m[:2], strict=True))
    # a taut thread with its load k heights behind
    lengths = [
        height * math.hypot(1.0, k) for k in search.levels if height > 0.0 and k * height < way
    ]
    return tuple(
        _variant(
            effect,
            search.amplitudes,
            **{length_name: length, x_name: x, y_name: y},
            **search.fixed,
        )
        for x, y in ((0.0, 0.0), *_hubs(model))
        for length in lengths
    )


RULES: Mapping[str, Rule] = {
    "": _grid,
    "each": _each,
    "places": _places,
    "axes": _axes,
    "levels": _levels,
    "asked": _asked,
    "slower": _slower,
    "above": _above,
    "beside": _beside,
    "over_places": _over_places,
    "hanging": _hanging,
    "at_hubs": _at_hubs,
    "on_body": _on_body,
    "coaxial": _coaxial,
    "lying": _lying,
    "drawn": _drawn,
}
"""Layouts that a descriptor can ask for (``ges_search.rule``)."""
