"""Variants of every effect, made as its descriptor asks: one function for each rule of layout.

A rule sees the effect, one row of its search hints, the vehicle and the flight envelope. It sees no
force and no residual.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ges.conventions import SDS_95
from ges.diagnose.library.candidates import (
    Candidate,
    FlightEnvelope,
    Variant,
    amplitude_of,
    usual_height_m,
)
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.model import Model
from ges.simulator import effects as effect_table
from ges.simulator.effects import Effect, Parameter, SearchHints

NOWHERE = FlightEnvelope()


@dataclasses.dataclass(frozen=True)
class _Search:
    """One search of an effect, which a rule lays out for a vehicle and its flights."""

    effect: Effect
    hints: SearchHints
    model: Model
    envelope: FlightEnvelope

    def variant(self, **shape: float) -> Variant:
        """Return the variant of all amplitudes with this shape."""
        return _variant(self.effect, self.hints.amplitudes, **self.hints.fixed, **shape)


def library(model: Model, envelope: FlightEnvelope = NOWHERE) -> dict[str, Candidate]:
    """Return every candidate that can be searched, by name.

    Parameters
    ----------
    model : of the vehicle. Effects of its file are known and no candidates, unless recalibration
        put them there or they may act several times.
    envelope : of the flights.
    """
    corrected = {ParameterKey.of(key).effect for key in model.corrections}
    candidates = {}
    for effect in effect_table.table().values():
        # what the file has is known; what recalibration put there or moved may still be found
        already_on = effect.name in model.effects and effect.name not in corrected
        if effect.settled or already_on and "many" not in effect.hints:
            continue
        variants = tuple(filter(_within_bounds, _variants(effect, model, envelope)))
        if variants:
            candidates[effect.name] = Candidate(effect.name, effect.about, variants)
    return candidates


def out_of_reach(effect: Effect, model: Model, envelope: FlightEnvelope) -> str:
    """Explain why no variant of an effect is tried.

    Parameters
    ----------
    effect : of the library.
    model : of the vehicle.
    envelope : of the flights.

    Returns
    -------
    The parameter that flights so wide or so high put beyond its bounds; '' where that is not why.
    """
    listed = _variants(effect, model, envelope)
    if not listed or any(map(_within_bounds, listed)):
        return ""
    shape = listed[0].shape
    p = next(p for p in effect.parameters if p.name in shape and not _in_range(p, shape))
    return (
        f"it would take {p.name} {shape[p.name]:.3g} {p.unit} on flights as wide or as high as"
        f" these, and {p.low:g} to {p.high:g} is what it is known for"
    )


def _variants(effect: Effect, model: Model, envelope: FlightEnvelope) -> tuple[Variant, ...]:
    """Return all variants of an effect.

    Without search hints it is one, of all parameters that can vanish.
    """
    if not effect.searches:
        here = effect.of_rotors(model.n_rotors)
        names = (p.name for p in here if not math.isnan(p.neutral))
        return (_variant(effect, tuple(names)),)
    listed = [
        v for s in effect.searches for v in RULES[s.rule](_Search(effect, s, model, envelope))
    ]
    usual = _usual_prerequisite(effect, model)
    return tuple(
        dataclasses.replace(v, given=usual or v.given, moment_gain=gain)
        for v in listed
        for gain in _moment_gains(effect)
    )


def _moment_gains(effect: Effect) -> tuple[float | None, ...]:
    """Return the factors to try on an effect's moments; (None,) where they are not varied.

    Near the ground a rotor's gain spreads to its neighbours by an unknown share q. That scales
    moments by 1 + q and leaves forces alone. The q of ``ground_effect_moment`` is tried at each
    level of its descriptor, so that one amplitude serves force and moment.
    """
    moment_effects = _modifiers(effect, are_levers=True)
    return tuple(1.0 + q for other in moment_effects for q in other.carried) or (None,)


def _modifiers(effect: Effect, are_levers: bool) -> list[Effect]:
    """Return what modifies an effect: its moment's lever alone, or all else that it does."""
    return [
        other
        for other in effect_table.table().values()
        if other.modifies == effect.name and ("lever_of_carrier" in other.hints) == are_levers
    ]


def _within_bounds(variant: Variant) -> bool:
    """Return whether the shape lies within the bounds of its effect's parameters."""
    rows = (effect_table.get(variant.effect).parameter(name) for name in variant.shape)
    return all(_in_range(p, variant.shape) for p in rows)


def _in_range(p: Parameter, shape: Mapping[str, float]) -> bool:
    return p.low <= shape[p.name] <= p.high


def _usual_prerequisite(effect: Effect, model: Model) -> effect_table.Effects:
    """Return a prerequisite at its usual size, where the vehicle has none on.

    At 1 m/s it makes its usual share of the weight.
    """
    if not effect.requires_one_of or set(effect.requires_one_of) & set(model.effects):
        return {}
    prerequisite = effect_table.get(effect.requires_one_of[0])
    # a rotor drag, c v times the sum of speeds, is that share of the weight at 1 m/s in hover
    (p,) = (p for p in prerequisite.parameters if p.usual_share)
    return {
        prerequisite.name: {
            p.name: p.usual_share * model.weight_N / (model.n_rotors * model.hover_rad_s)
        }
    }


def _variant(effect: Effect, amplitudes: tuple[str, ...], **shape: float) -> Variant:
    return Variant(effect.name, shape, tuple(amplitude_of(effect.name, n) for n in amplitudes))


def _grid(search: _Search) -> tuple[Variant, ...]:
    """Return one variant for each level of the axis and of the number across it.

    Effects that modify this one are given with the variant, one at a time, where the hints ask for
    them.
    """
    axes = {search.hints.axis[0]: search.hints.levels} if search.hints.axis else {}
    if search.hints.across:
        sd = search.model.plane_sd_m
        # a nominal parameter that shapes the effect is tried across its prior sd, or taken as
        # certain
        most = round(SDS_95)
        axes[search.hints.across] = (
            tuple(k * sd for k in range(-most, most + 1)) if sd > 0.0 else (0.0,)
        )
    plain = tuple(
        search.variant(**dict(zip(axes, values, strict=True)))
        for values in itertools.product(*axes.values())
    )
    if not search.hints.modified:
        return plain
    ways = [
        {other.name: {other.amplitudes[0]: level}}
        for other in _modifiers(search.effect, are_levers=False)
        if other.name not in search.model.effects
        for level in other.carried
    ]
    return tuple(dataclasses.replace(v, given=way) for v in plain for way in ways)


def _each(search: _Search) -> tuple[Variant, ...]:
    """Return one variant for each amplitude."""
    return tuple(_variant(search.effect, (name,)) for name in search.hints.amplitudes)


def _places(search: _Search) -> tuple[Variant, ...]:
    """Return one amplitude for each place, and each pair of places.

    Losses are bounded at zero: no blade heals.
    """
    most, rotor_of = search.model.n_rotors, {p.name: p.rotor for p in search.effect.parameters}
    here = [n for n in search.hints.amplitudes if rotor_of[n] <= most]
    sets = (c for n in (1, 2) for c in itertools.combinations(here, n))
    return tuple(_with_amplitudes(_variant(search.effect, names), low=0.0) for names in sets)


def _axes(search: _Search) -> tuple[Variant, ...]:
    """Return every subset of the axes: an error of one axis does not pay for the others.

    With levels there is one column for each side of neutral, bounded there.
    """
    sets = [
        _variant(search.effect, names)
        for n in range(1, len(search.hints.amplitudes) + 1)
        for names in itertools.combinations(search.hints.amplitudes, n)
    ]
    if not search.hints.levels:
        return tuple(sets)
    sides = [{"step": s, ("low" if s > 0.0 else "high"): 0.0} for s in search.hints.levels]
    return tuple(_with_amplitudes(v, **side) for side in sides for v in sets)


def _with_amplitudes(variant: Variant, **changes: Any) -> Variant:
    """Return the variant with fields of all its amplitudes replaced."""
    changed = tuple(dataclasses.replace(a, **changes) for a in variant.amplitudes)
    return dataclasses.replace(variant, amplitudes=changed)


def _at_level(variant: Variant, *steps: float, **changes: Any) -> Variant:
    """Return the variant with columns of these whole steps, exact at them."""
    stepped = zip(variant.amplitudes, steps, strict=True)
    return dataclasses.replace(
        variant,
        amplitudes=tuple(dataclasses.replace(a, step=s, level=s, **changes) for a, s in stepped),
    )


def _at_levels(search: _Search, levels: tuple[float, ...]) -> tuple[Variant, ...]:
    plain = search.variant()
    return tuple(_at_level(plain, level - plain.amplitudes[0].neutral) for level in levels)


def _levels(search: _Search) -> tuple[Variant, ...]:
    """Return variants for effects that are not linear.

    Each column is the whole step from neutral to a level.
    """
    return _at_levels(search, search.hints.levels)


def _commanded(search: _Search) -> tuple[Variant, ...]:
    """Return levels near the largest commands in the air, and towards those of a take-off.

    A ceiling is no level where rotors were logged to turn faster.
    """
    (p,) = map(search.effect.parameter, search.hints.amplitudes)
    top, most = search.envelope.largest_commands
    between = [top + (most - top) * share for share in search.hints.levels] if most > top else []
    # levels that are all but equal would be copies of one column
    levels = sorted(
        {round(q, 3) for q in (*search.envelope.commands, *between) if p.low < q < p.high}
    )
    turned = search.envelope.fastest_rad_s / search.model.number("max_rotor_speed_rad_s")
    return _at_levels(search, tuple(q for q in levels if q >= turned))


def _slower(search: _Search) -> tuple[Variant, ...]:
    """Return variants slower motors than nominal, slowing down no sooner than speeding up.

    Faster ones are within the prior sd, or another effect.
    """
    plain, nominal_s = search.variant(), search.model.number("motor_time_constant_s")
    # below the finest step of a grid a lag does not show in any log
    levels = [
        max(share * nominal_s, settings.prepare.grid_step_shortest_s)
        for share in search.hints.levels
    ]
    return tuple(
        _at_level(plain, up, down, low=0.0)
        for i, up in enumerate(levels)
        # down as slow as up, or one level slower
        for down in levels[i : i + 2]
    )


def _above(search: _Search) -> tuple[Variant, ...]:
    """Return a little above the greatest height of the rotors, in radii."""
    if search.envelope.high_m is None:
        return ()
    top = search.envelope.high_m[2] + float(search.model.of_rotors("z_m").max())
    heights = (top + k * search.model.radius_m for k in search.hints.levels)
    return tuple(search.variant(**{search.hints.axis[0]: z}) for z in heights)


def _outside_box(search: _Search) -> tuple[Variant, ...]:
    """Return a radius beyond each side of the box that was flown."""
    if search.envelope.low_m is None or search.envelope.high_m is None:
        return ()
    distance, bearing = search.hints.axis
    # bearings east, north, west and south, with the edge of the box along each
    sides = (
        (0.0, search.envelope.high_m[0]),
        (0.5 * math.pi, search.envelope.high_m[1]),
        (math.pi, -search.envelope.low_m[0]),
        (-0.5 * math.pi, -search.envelope.low_m[1]),
    )
    return tuple(
        search.variant(**{bearing: b, distance: d + search.model.radius_m}) for b, d in sides
    )


def _over_places(search: _Search) -> tuple[Variant, ...]:
    """Return variants above each place that was visited, as wide as the places are apart.

    The height is so many radii above the highest position.
    """
    if search.envelope.high_m is None:
        return ()
    x_name, y_name, z_name, width = search.hints.axis
    # over the highest that was flown anywhere: a rotor never passes through what is there
    (radii,) = search.hints.levels
    above = search.envelope.high_m[2] + radii * search.model.radius_m
    wide = max(0.5 * search.envelope.square_m, search.model.radius_m)
    return tuple(
        search.variant(**{width: wide, x_name: x, y_name: y, z_name: above})
        for x, y in search.envelope.places_m
    )


def _hanging(search: _Search) -> tuple[Variant, ...]:
    """Return variants hanging freely below the middle, where a logged attitude shows a swing."""
    return () if search.envelope.attitude_derived else _grid(search)


def _lying(search: _Search) -> tuple[Variant, ...]:
    """Return variants on threads longer than the lowest height: the load lies there."""
    lowest_m = search.envelope.low_m[2] if search.envelope.low_m else 0.0
    levels = tuple(length for length in search.hints.levels if length > lowest_m)
    return _hanging(
        dataclasses.replace(search, hints=dataclasses.replace(search.hints, levels=levels))
    )


def _hubs(model: Model) -> list[tuple[float, float]]:
    return list(zip(model.of_rotors("x_m"), model.of_rotors("y_m"), strict=True))


def _at_places(search: _Search, places: Iterable[tuple[float, float]]) -> tuple[Variant, ...]:
    """Return variants at each of these places (x, y)."""
    x_name, y_name = search.hints.axis
    return tuple(search.variant(**{x_name: x, y_name: y}) for x, y in places)


def _at_hubs(search: _Search) -> tuple[Variant, ...]:
    """Return variants hanging freely below each rotor."""
    return () if search.envelope.attitude_derived else _at_places(search, _hubs(search.model))


def _on_body(search: _Search) -> tuple[Variant, ...]:
    """Return variants in the middle, at each hub, and halfway between.

    A fit moves them from there.
    """
    hubs = [(k * x, k * y) for k in (0.5, 1.0) for x, y in _hubs(search.model)]
    return _at_places(search, dict.fromkeys([(0.0, 0.0), *hubs]))


def _coaxial(search: _Search) -> tuple[Variant, ...]:
    """Return variants where a rotor lies over another."""
    return _grid(search) if search.model.coaxial else ()


def _drawn(search: _Search) -> tuple[Variant, ...]:
    """Return variants drawn over the ground on threads longer than the height of flight.

    They hang below the middle and each rotor.

    Levels are how far behind the load follows, over that height. Threads that stay slack throughout
    are left out.
    """
    if search.envelope.low_m is None or search.envelope.high_m is None:
        return ()
    length_name, x_name, y_name = search.hints.axis
    height = usual_height_m(search.model, search.envelope)
    way = max(
        high - low
        for high, low in zip(search.envelope.high_m[:2], search.envelope.low_m[:2], strict=True)
    )
    # a taut thread with its load k heights behind
    lengths = [
        height * math.hypot(1.0, k)
        for k in search.hints.levels
        if height > 0.0 and k * height < way
    ]
    return tuple(
        search.variant(**{length_name: length, x_name: x, y_name: y})
        for x, y in ((0.0, 0.0), *_hubs(search.model))
        for length in lengths
    )


RULES: Mapping[str, Callable[[_Search], tuple[Variant, ...]]] = {
    "": _grid,
    "each": _each,
    "places": _places,
    "axes": _axes,
    "levels": _levels,
    "asked": _commanded,
    "slower": _slower,
    "above": _above,
    "beside": _outside_box,
    "over_places": _over_places,
    "hanging": _hanging,
    "at_hubs": _at_hubs,
    "on_body": _on_body,
    "coaxial": _coaxial,
    "lying": _lying,
    "drawn": _drawn,
}
"""Layouts that a descriptor can ask for (``rule`` of a search)."""
