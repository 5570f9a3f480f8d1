"""Which cases are made: what is concealed, how often, how strongly; circumstances drawn apart from
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ges.blind.generator import concealed
from ges.blind.generator.airframe import CLASSES, TrueVehicle
from ges.blind.generator.concealed import (
    COMPANIONS,
    EVERY,
    LEVELS,
    PARAMETER,
    PHYSICS,
    SENSOR,
    UNLISTED,
)
from ges.blind.generator.plan import FULL_MENU
from ges.blind.generator.sensing import NOISE_LEVELS, Logging

FLIGHTS = 5
POOR_MENUS = ("hover_low", "hover_high", "one_speed")
# designs in which one regime can hardly tell names apart, each of which is concealed in turn: menu,
# names, rotor speeds logged
CONFOUNDED = (
    ("hover_high", ("rotor_tilt", "wind"), True),
    ("hover_low", ("ground_effect", "thrust_scale"), True),
    ("hover_high", ("thrust_curve", "thrust_scale"), False),
    ("one_speed", ("rotor_drag", "parasitic_drag"), True),
    ("hover_high", ("cg_offset", "weak_rotor"), False),
)
# pairs and triples are drawn from effects of different groups, so that each has something of its
# own
GROUPS = (
    ("rotor_drag", "parasitic_drag", "wind"),
    ("axial_inflow", "translational_lift"),
    ("ground_effect", "fountain_lift"),
    ("battery_sag", "thrust_curve"),
    ("motor_lag", "esc_delay"),
    ("weak_rotor", "cg_offset"),
    ("rotor_tilt",),
    ("slung_load", "tether"),
    ("rotor_inertia_reaction",),
)
COMPOSITIONS = {
    "smoke": dict.fromkeys(("single", "null", "pair", "unknown"), 1),
    "glance": {
        "single": 4,
        "null": 2,
        **dict.fromkeys(("pair", "triple", "unknown", "parameter", "sensor", "confounded"), 1),
    },
    "tiny": {
        "single": 14,
        "null": 8,
        "pair": 4,
        "triple": 2,
        "unknown": 4,
        "parameter": 3,
        "sensor": 3,
        "confounded": 2,
    },
    "sample": {
        "single": 22,
        "null": 12,
        "pair": 6,
        "triple": 3,
        "unknown": 6,
        "parameter": 4,
        "sensor": 4,
        "confounded": 3,
    },
    "world": {
        "single": len(PHYSICS),
        "null": 8,
        "pair": 4,
        "unknown": 3,
        "parameter": 2,
        "sensor": 1,
    },
    "third": {
        "single": len(PHYSICS) * 6,
        "null": 100,
        "pair": 50,
        "triple": 20,
        "unknown": 34,
        "parameter": 17,
        "sensor": 17,
        "confounded": 17,
    },
    "full": {
        "single": len(PHYSICS) * 18,
        "null": 300,
        "pair": 150,
        "triple": 60,
        "unknown": 100,
        "parameter": 50,
        "sensor": 50,
        "confounded": 50,
    },
}
SECONDS = {
    "smoke": (11.0, 13.0),
    "glance": (11.0, 13.0),
    "tiny": (11.0, 13.0),
    "sample": (20.0, 27.0),
    "world": (16.0, 22.0),
    "third": (20.0, 27.0),
    "full": (20.0, 27.0),
}


@dataclass(frozen=True)
class Spec:
    """One case to make.

    Attributes
    ----------
    index : place in the grid.
    category : kind of case, a key of :data:`COMPOSITIONS`.
    names, levels : concealed effects, and their severities 0 to 2.
    size : class of vehicles.
    menu : 'full', or the one manoeuvre that all flights repeat.
    rivals : effects that the flights can hardly tell from the concealed one.
    logging : fields of :class:`Logging` that are not drawn.
    frame : 'quad', 'hexa' or 'x8'.
    """

    index: int
    category: str
    names: tuple[str, ...] = ()
    levels: tuple[int, ...] = ()
    size: str = "650g"
    menu: str = "full"
    rivals: tuple[str, ...] = ()
    logging: dict = field(default_factory=dict)
    frame: str = "quad"


def specs(grid: str, seed: int) -> list[Spec]:
    """Return all cases of a grid, in an order that reveals nothing of their kind.

    Parameters
    ----------
    grid : key of :data:`COMPOSITIONS`.
    seed : of order, vehicle classes and mixtures.
    """
    rng = np.random.default_rng([seed, 0xB11D])
    kinds = [(category, k) for category, n in COMPOSITIONS[grid].items() for k in range(n)]
    order = rng.permutation(len(kinds))
    sizes = {
        category: [str(s) for s in rng.permutation(list(CLASSES))]
        for category in COMPOSITIONS[grid]
    }
    every = [
        _spec(i, category, k, sizes[category], rng)
        for i, (category, k) in enumerate(kinds[j] for j in order)
    ]
    return [replace(spec, frame=_frame(spec)) for spec in every]


def _frame(spec: Spec) -> str:
    """A fifth of the cases have six rotors or eight; a wake from above needs a rotor above."""
    if "coaxial_wake" in spec.names:
        return "x8"
    return {3: "hexa", 8: "x8"}.get(spec.index % 10, "quad")


def _spec(
    index: int, category: str, k: int, sizes: Sequence[str], rng: np.random.Generator
) -> Spec:
    size = sizes[(k // 3 + k) % 6]
    if category == "null":
        return Spec(
            index,
            category,
            size=sizes[k % 6],
            menu=POOR_MENUS[k // 6 % 3] if k % 6 == 5 else "full",
        )
    if category == "confounded":
        turn, design = divmod(k, len(CONFOUNDED))
        menu, alike, speeds = CONFOUNDED[design]
        name = alike[turn % len(alike)]
        rivals = tuple(n for n in alike if n != name)
        return Spec(
            index, category, (name,), (2,), sizes[k % 6], menu, rivals, {"rotor_speeds": speeds}
        )
    if category in ("pair", "triple"):
        several = _mixture(2 if category == "pair" else 3, rng)
        return Spec(
            index, category, several, tuple(int(v) for v in rng.integers(0, 3, len(several))), size
        )
    # every name meets the three severities in three turns, then on the next size of vehicle
    names = list(
        {"single": PHYSICS, "unknown": UNLISTED, "parameter": PARAMETER, "sensor": SENSOR}[category]
    )
    turn, which = divmod(k, len(names))
    return Spec(
        index, category, (names[which],), ((which + turn) % 3,), sizes[(which + turn // 3) % 6]
    )


def _mixture(n: int, rng: np.random.Generator) -> tuple[str, ...]:
    groups = rng.choice(len(GROUPS), n, replace=False)
    return tuple(str(rng.choice(GROUPS[g])) for g in groups)


@dataclass(frozen=True)
class Circumstances:
    """What surrounds a concealed effect; the same draw whatever is concealed.

    Attributes
    ----------
    identity : name of the case's folder, 12 hex digits.
    terrain : 'flat', 'bumps' or 'step'.
    excited, parked : of each flight, whether it has excitation, and whether it starts on the
        ground.
    menu : manoeuvre of each flight.
    seconds : length of each flight.
    charge : state of charge at the start of each flight.
    battery : resistances and drain, as of :func:`drive.step_battery`.
    turbulence : sd of the acceleration by turbulence (m/s^2), before a factor of the mass.
    logging : rate, noise and streams of the log.
    """

    identity: str
    terrain: str
    excited: tuple[bool, ...]
    parked: tuple[bool, ...]
    menu: tuple[str, ...]
    seconds: tuple[float, ...]
    charge: tuple[float, ...]
    battery: dict[str, float]
    turbulence: float
    logging: Logging


def draw_circumstances(spec: Spec, grid: str, seed: int) -> Circumstances:
    """Draw terrain, flights and logging.

    Parameters
    ----------
    spec : of which only index, menu and logging have an influence, not the names.
    grid : decides the length of flights.
    seed : of all cases.
    """
    rng = np.random.default_rng([seed, spec.index, 1])
    logging = {
        "rate_hz": float(rng.choice([80.0, 100.0, 125.0])),
        "noise": str(rng.choice(list(NOISE_LEVELS), p=[0.35, 0.45, 0.2])),
        "rotor_speeds": bool(rng.random() < 0.6),
        "references": bool(rng.random() < 0.8),
        "battery": bool(rng.random() < 0.75),
        "currents": bool(rng.random() < 0.25),
        "ground": bool(rng.random() < 0.4),
    }
    excited = rng.random() < 0.75
    menu = rng.permutation(FULL_MENU) if spec.menu == "full" else [spec.menu] * FLIGHTS
    return Circumstances(
        identity=rng.bytes(6).hex(),
        terrain=str(rng.choice(["flat", "bumps", "step"], p=[0.4, 0.4, 0.2])),
        excited=tuple(
            bool(excited and spec.menu == "full" and m in ("mixed", "staircase")) for m in menu
        ),
        parked=tuple(bool(v) for v in rng.random(FLIGHTS) < 0.25),
        menu=tuple(str(m) for m in menu),
        seconds=tuple(rng.uniform(*SECONDS[grid], FLIGHTS)),
        charge=tuple(rng.permutation(np.linspace(0.98, 0.5, FLIGHTS))),
        battery={
            "resistance": float(rng.uniform(0.015, 0.05)),
            "polar_resistance": float(rng.uniform(0.01, 0.03)),
            "drain_1_s": float(rng.uniform(0.0005, 0.001)),
        },
        turbulence=float(rng.uniform(0.02, 0.08)),
        logging=Logging(**(logging | spec.logging)),
    )


def draw_numbers(
    spec: Spec, craft: TrueVehicle, seed: int, attempt: int
) -> dict[str, dict[str, float]]:
    """Draw the physical numbers of each concealed effect.

    Parameters
    ----------
    spec : names and severities.
    craft : the vehicle; sizes are shares of its weight or inertia.
    seed : of all cases.
    attempt : each has a stream of its own.

    Returns
    -------
    By effect, numbers that differ from :data:`NEUTRAL`.
    """
    rng = np.random.default_rng([seed, spec.index, 2, attempt])
    pairs = zip(spec.names, spec.levels, strict=True)
    return {name: EVERY[name](craft, level, rng) for name, level in pairs}


def truth(spec: Spec, numbers: dict[str, dict[str, float]], terrain: str) -> dict:
    """Return the truth of a case in the form of the contract.

    Parameters
    ----------
    spec : the case.
    numbers : physical numbers by effect.
    terrain : kind of the terrain; beside a ledge a partial ground effect is as right.

    Returns
    -------
    ``also_acceptable`` holds every other set of names that is right; category and concealed numbers
    stand beside.
    """
    names = [] if spec.category == "unknown" else with_companions(spec.names)
    findings = [
        {"name": n, "parameters": numbers.get(n, {})} | _place(n, numbers.get(n, {})) for n in names
    ]
    other = [[r] for r in spec.rivals] + _also(spec, names, terrain)
    return {
        "verdict": _verdict(spec),
        "findings": findings,
        "severity": LEVELS[min(spec.levels)] if spec.levels else "weak",
        "also_acceptable": other,
        "category": spec.category,
        "concealed": {name: numbers[name] for name in spec.names},
    }


def _place(name: str, numbers: dict[str, float]) -> dict[str, str]:
    """Return where an effect acts, if it is one rotor's."""
    return {"place": f"rotor {int(numbers['weak_index']) + 1}"} if name == "weak_rotor" else {}


def with_companions(names: Sequence[str]) -> list[str]:
    """Return concealed names, each after the effect that it needs to act on."""
    out: list[str] = []
    for name in names:
        out += [n for n in (*COMPANIONS.get(name, ()), name) if n not in out]
    return out


def _also(spec: Spec, names: Sequence[str], terrain: str) -> list[list[str]]:
    """Return the other answers that are right.

    These are the air or the mapping alone, and the partial ground effect of a ledge.
    """
    out = []
    if len(spec.names) == 1 and spec.names[0] in ("wind", "gusts", "actuator_mapping"):
        out.append([spec.names[0]])
    if len(spec.names) == 1:
        out += [[relative] for relative in concealed.RELATED.get(spec.names[0], ())]
    # a mass beside the centre is, to first order, more weight and a centre that moved
    if "payload" in names:
        rest = [n for n in names if n != "payload"]
        out += [[*rest, "thrust_scale", "cg_offset"], [*rest, "thrust_scale"]]
    if terrain == "step" and "ground_effect" in names:
        out += [[*a, "partial_ground_effect"] for a in [names, *out] if "ground_effect" in a]
    return out


def _verdict(spec: Spec) -> str:
    by_category = {"null": "nothing_proven", "unknown": "unknown", "confounded": "ambiguous"}
    if spec.category in by_category:
        return by_category[spec.category]
    for verdict, table in (("physics", concealed.PHYSICS), ("parameter", PARAMETER)):
        if any(n in table for n in spec.names):
            return verdict
    return "sensor"
