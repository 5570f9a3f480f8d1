"""Laws of a vehicle file as a function in another simulator's language, without dependencies."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ges.conventions import BODY_RATE, MAX_ROTORS, POSITION, VELOCITY, rotor_speed
from ges.errors import GesError
from ges.simulator import laws
from ges.simulator.effects import Samples, evaluate_terms
from ges.simulator.laws import Group, Term
from ges.simulator.terrain import Terrain
from ges.vehicle.file import Vehicle

# one of everything, level and high enough for the height itself to count: a group is then one over
# its reference, and R/h the radius
_ONE = {
    **dict.fromkeys((*VELOCITY, *POSITION), 1.0),
    **dict.fromkeys((*BODY_RATE, "battery_V"), 1.0),
    **dict.fromkeys(rotor_speed(MAX_ROTORS), 1.0),
}
GROUND = "R"
"""Quantity of the one group whose reference varies, and not its quantity."""


@dataclasses.dataclass(frozen=True)
class _Language:
    """How a function is written in a language.

    Attributes
    ----------
    comment : what begins a line of comment.
    head : beginning of the function, from the names of its arguments.
    constant : a named constant, from name and value.
    nearness : line that limits the height over the ground.
    assign : sum in a channel, from ``force`` or ``moment``, axis and expression.
    magnitude, exponential : functions of the language.
    tail : end of the function.
    """

    comment: str
    head: Callable[[Sequence[str]], str]
    constant: Callable[[str, str], str]
    nearness: str
    assign: Callable[[str, int, str], str]
    magnitude: str
    exponential: str
    tail: str


_PYTHON = _Language(
    comment="# ",
    head=lambda names: f"def law({', '.join(names)}):\n    force, moment = [0.0] * 3, [0.0] * 3",
    constant=lambda name, value: f"    {name} = {value}",
    nearness="    h = max(h, 0.5 * R)",
    assign=lambda vector, axis, value: f"    {vector}[{axis}] = {value}",
    magnitude="abs",
    exponential="math.exp",
    tail="    return force, moment",
)
_C = _Language(
    comment="// ",
    head=lambda names: (
        "#include <math.h>\n\nstatic void law("
        + ", ".join([*(f"double {n}" for n in names), "double force[3]", "double moment[3]"])
        + ") {\n  for (int k = 0; k < 3; k++) force[k] = moment[k] = 0.0;"
    ),
    constant=lambda name, value: f"  const double {name} = {value};",
    nearness="  h = fmax(h, 0.5 * R);",
    assign=lambda vector, axis, value: f"  {vector}[{axis}] = {value};",
    magnitude="fabs",
    exponential="exp",
    tail="}",
)
LANGUAGES: Mapping[str, _Language] = {"python": _PYTHON, "c": _C}


def law_as(vehicle: Vehicle, language: str) -> str:
    """Write the laws of a vehicle as a function that gives force and moment in the body frame.

    Parameters
    ----------
    vehicle : the vehicle, with its laws.
    language : a key of :data:`LANGUAGES`.

    Returns
    -------
    Source text. Its comment names the arguments of the function with their units.

    Raises
    ------
    GesError
        When the vehicle has no laws.

    Examples
    --------
    >>> from ges.vehicle.load import load_vehicle
    >>> from ges.vehicle.file import Law
    >>> law = Law(channel="force_y", form="0.1 m g (V_x/v_h)")
    >>> vehicle = load_vehicle("crazyflie-2.1").model_copy(update={"laws": (law,)})
    >>> "force[1] = 0.1 * m_g * (V_x / v_h)" in law_as(vehicle, "python")
    True
    """
    if not vehicle.laws:
        raise GesError(
            f"vehicle '{vehicle.name}' has no laws; 'ges diagnose' writes those that it finds into"
            " vehicle.fitted.yaml"
        )
    words, form = LANGUAGES[language], [(w.channel, w.terms()) for w in vehicle.laws]
    terms = [t for _, of in form for t in of]
    used = [
        group
        for k, group in enumerate(laws.groups().values())
        if any(t.power[k] + t.magnitude[k] for t in terms)
    ]
    thrust = any(t.scale == "T" for t in terms)
    # a place is the quantity of the position's own groups, over no reference
    local = any(t.local for t in terms)
    named = [*used, *(g for q in ("x/L", "y/L") if local and (g := laws.groups()[q]) not in used)]
    names = [*(["T"] if thrust else []), *map(_varies, named)]
    lines = [
        f"Law of {vehicle.name}: force (N) and moment (N m) on the body, x forward, y left, z along"
        " thrust.",
        *(["T: thrust of all rotors out of ground effect, N"] if thrust else []),
        *(f"{_varies(g)}: {_words(g)}, {g.unit}" for g in named),
    ]
    values = _constants(vehicle, used, any(t.channel.startswith("moment") for t in terms))
    body = [words.constant(name, repr(value)) for name, value in values.items()]
    body += [words.nearness] if GROUND in values else []
    body += [
        words.assign(channel.split("_")[0], "xyz".index(channel[-1]), _sum(of, words))
        for channel, of in form
    ]
    comment = [f"{words.comment}{line}" for line in lines]
    imported = ["import math\n"] if local and language == "python" else []
    return "\n".join([*comment, *imported, words.head(names), *body, words.tail]) + "\n"


def _varies(group: Group) -> str:
    """Give the symbol of a group that changes in flight."""
    return group.reference if group.quantity == GROUND else group.quantity


def _words(group: Group) -> str:
    return "mean height of the rotors over the ground" if group.quantity == GROUND else group.doc


def _constants(vehicle: Vehicle, used: Sequence[Group], moments: bool) -> dict[str, float]:
    """Compute weight, arm, and the constant of every group, by symbol, in the simulator."""
    parameters = vehicle.parameters()
    # the first group of a reference: of (1, 1) m/s the horizontal speed is not one
    first = {g.reference: g for g in reversed(laws.groups().values())}
    used = list(dict.fromkeys(first[g.reference] for g in used))
    samples = Samples.from_columns(
        {"t_s": np.zeros(1), **{name: np.full(1, value) for name, value in _ONE.items()}}
    )
    asked = [Term.of("force_x", "m g", {g.text: 1}) for g in used]
    # a rotor that lies off the origin's height would count in h: the ground is put below the mean
    height_m = 1.0 + float(vehicle.rotor_arrays()["z_m"].mean())
    constant = [Term.of("force_x", "m g", {}), Term.of("moment_x", "m g", {})]
    force, moment, *each = evaluate_terms(
        [*constant, *asked], parameters, samples, {}, Terrain.flat(height_m - 1.0)
    )[0]
    values = {"m_g": float(force), **({"L": float(moment / force)} if moments else {})}
    for group, value in zip(used, each, strict=True):
        ratio = float(value / force)
        own = group.quantity == GROUND
        values[group.quantity if own else group.reference] = ratio if own else 1.0 / ratio
    return values


def _sum(terms: Mapping[Term, float], words: _Language) -> str:
    parts = []
    for term, coefficient in terms.items():
        factors = [repr(coefficient), "T" if term.scale == "T" else "m_g"]
        factors += ["L"] if term.channel.startswith("moment") else []
        for group, n, m in zip(laws.groups().values(), term.power, term.magnitude, strict=True):
            ratio = f"({group.quantity} / {group.reference})"
            factors += [ratio] * n + [f"{words.magnitude}{ratio}"] * m
        if term.local:
            x, y, width = map(repr, term.near_m)
            away = " + ".join(f"({q} - {at}) * ({q} - {at})" for q, at in (("x", x), ("y", y)))
            factors.append(f"{words.exponential}(-({away}) / (2.0 * {width} * {width}))")
        parts.append(" * ".join(factors))
    return " + ".join(parts)
