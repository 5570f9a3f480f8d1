"""The home generator's effects, read from the papers by a second author (:mod:`ges.blind.second`).

Vehicles, controller, paths, sensors and every form are others than those of the generator that the
diagnosis was tuned on. The limit follows from the loads that each effect made along the flown path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ges.blind.foreign.paths import Scale, references
from ges.blind.foreign.sets import Concealed, OffPath, Place, Sources, draw_log, write_flown
from ges.blind.generator.airframe import TrueVehicle, draw_nominal
from ges.blind.generator.detectable import TrueFlight, body_of, driven
from ges.blind.noise import Air
from ges.blind.second.air import TURBULENCE
from ges.blind.second.flight import (
    CONTROL,
    DRIVES,
    DT_S,
    TURN_PER_M,
    SecondSimulation,
    SecondSortie,
)
from ges.blind.second.secrets import (
    LAYOUT,
    LEVELS,
    SECRETS,
    UNLISTED,
    VEHICLES,
    Craft,
    true_numbers,
)

WORLD = "home-second-author"
NEEDS = ()
SECONDS = {"development": 15.0, "evaluation": 16.0}
OFF_PATH_M = 3.0
ATTEMPTS, GENTLER = 5, 0.8
COMPANION = {
    "wind": "rotor_drag",
    "gusts": "rotor_drag",
    "ground_effect_forward_flight": "ground_effect",
    "ground_effect_lag": "ground_effect",
    "ground_effect_moment": "ground_effect",
}
PARAMETERS = ("thrust_scale", "inertia", "torque_coefficient")
METHOD = "loads along the path that each effect made, kept by the generator itself"


@dataclass(frozen=True)
class SecondDesign:
    """A set to fly by the second author's simulator.

    Attributes
    ----------
    vehicle : class of vehicles.
    names : concealed effects.
    level : severity, 0 weak, 1 medium, 2 strong.
    copy : number among sets that are the same otherwise.
    """

    vehicle: str
    names: tuple[str, ...] = ()
    level: int = 1
    copy: int = 0

    @property
    def key(self) -> str:
        """Name in the table of cases: vehicle class, concealed names, severity, copy."""
        names = "+".join(self.names) or "nothing"
        return f"{self.vehicle} {names} {LEVELS[self.level]} #{self.copy}"

    def all_names(self) -> tuple[str, ...]:
        """Return the concealed names, each after the effect that it needs to act on."""
        names: list[str] = []
        for name in self.names:
            names += [n for n in (COMPANION.get(name), name) if n and n not in names]
        return tuple(names)

    def concealed(self) -> Concealed:
        """Return the truth of the set.

        Returns
        -------
        Wind and gusts may be named without the drag that they act through. The verdict on an effect
        that no library has is ``unknown``.
        """
        severity = LEVELS[self.level]
        if self.names and self.names[0] in UNLISTED:
            return Concealed(severity=severity, verdict="unknown", category="unknown")
        alone = len(self.names) == 1
        parameter = alone and self.names[0] in PARAMETERS
        return Concealed(
            self.all_names(),
            severity,
            optional=("gyroscopic_moment",) if "rotor_inertia_reaction" in self.names else (),
            # moving air is felt through the drag alone
            instead=tuple((n,) for n in self.names if alone and n in ("wind", "gusts")),
            verdict="parameter" if parameter else "",
            category="parameter" if parameter else "single" if alone else "",
        )


def designs(half: str) -> list[SecondDesign]:
    """Return the sets of a half.

    Returns
    -------
    Seven without anything concealed, every effect once, at severities that differ between the
    halves, and four pairs.
    """
    shift = {"development": 0, "evaluation": 1}[half]
    sizes = list(VEHICLES)
    physics = [n for n in SECRETS if n not in PARAMETERS]
    listed = [SecondDesign(sizes[k % 4], copy=k) for k in range(7)]
    listed += [
        SecondDesign(sizes[(k + shift) % 4], (n,), (k + shift) % 3) for k, n in enumerate(physics)
    ]
    listed += [
        SecondDesign(sizes[(k + 2 * shift) % 4], (n,), (k + 1 + shift) % 3)
        for k, n in enumerate((*PARAMETERS, *UNLISTED))
    ]
    pairs = (
        ("rotor_drag", "weak_rotor"),
        ("ground_effect", "axial_inflow"),
        ("parasitic_drag", "motor_lag"),
        ("slung_load", "rotor_drag"),
    )
    return listed + [
        SecondDesign(sizes[(k + shift) % 4], p, 1 + shift) for k, p in enumerate(pairs)
    ]


def make(out: Path, sets: Sequence[tuple[SecondDesign, int, Place]], sources: Sources) -> None:
    """Fly designs abreast and seal them.

    A set whose vehicle left its path or touched the ground is flown again, slower and higher.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    sets : designs, each with its number in the world and its place.
    sources : of which nothing is needed.

    Raises
    ------
    OffPath
        When a vehicle was lost in all :data:`ATTEMPTS`.
    """
    waiting = list(sets)
    for attempt in range(ATTEMPTS):
        waiting = _make(out, waiting, GENTLER**attempt)
        if not waiting:
            return
    keys = ", ".join(f"'{design.key}'" for design, _, _ in waiting)
    raise OffPath(f"{keys} left their paths {ATTEMPTS} times, which are too fast for them")


def _make(out: Path, sets: Sequence[tuple[SecondDesign, int, Place]], gentle: float) -> list:
    """Fly sets abreast and seal those that were flown well; return the others."""
    drawn = [_sorties(design, place, gentle) for design, _, place in sets]
    sorties = [sortie for _, flown in drawn for sortie in flown]
    book = SecondSimulation(sorties).run()
    # the changes of a name are kept for the flights that have it alone: their places among those
    where = {n: [f for f, s in enumerate(sorties) if n in s.names] for n in SECRETS | UNLISTED}
    failed, at = [], 0
    for (craft, flown), (design, number, place) in zip(drawn, sets, strict=True):
        own = range(at, at + len(flown))
        at += len(flown)
        if not all(_flew(book["p"][:, :, f], sorties[f].plan) for f in own):
            failed.append((design, number, place))
            continue
        flights = [_flown(craft, sorties[f], f, book, where) for f in own]
        log = draw_log(place, number)
        write_flown(out, place, craft, flights, log, design.concealed(), METHOD)
    return failed


def _flew(p: np.ndarray, plan: np.ndarray) -> bool:
    return bool(np.abs(p - plan[:3].T).max() < OFF_PATH_M and p[:, 2].min() > 0.0)


def _sorties(
    design: SecondDesign, place: Place, gentle: float = 1.0
) -> tuple[TrueVehicle, list[SecondSortie]]:
    true = true_numbers(design.vehicle, place.rng("vehicle"))
    _, radius, lever, _, _, _ = VEHICLES[design.vehicle]
    x, y, spin = (tuple(int(row[k]) for row in LAYOUT) for k in range(3))
    craft = TrueVehicle(
        size=design.vehicle,
        radius_m=radius,
        rotor_x_m=tuple(lever * v for v in x),
        rotor_y_m=tuple(lever * v for v in y),
        rotor_z_m=round(0.2 * radius, 4),
        spin=spin,
        battery_V=12.6,
        nominal=draw_nominal(true, place.rng("file")),
        true=true,
    )
    rng = place.rng("secret")
    table = SECRETS | UNLISTED
    numbers: dict[str, float] = {}
    for name in design.names:
        numbers |= table[name](Craft(design.vehicle, true), design.level, rng)
    names = design.all_names()
    # gentler is higher as well as slower: what touched the ground is flown anew
    low = (1.3 * radius + 0.03) / gentle
    # like flights have speeds that go with the root of the size (Froude)
    pace = 1.1 * gentle * float(np.sqrt(radius / 0.03))
    scale = Scale(low, radius, pace, 0.2 + 3.0 * true["lag"])
    rng = place.rng("paths")
    plans = references(place.half, SECONDS[place.half], CONTROL * DT_S, scale, rng)
    turbulence = float(rng.uniform(0.02, 0.07))
    hubs = np.stack([craft.rotor_x_m, craft.rotor_y_m, [craft.rotor_z_m] * 4], axis=1)
    return craft, [
        SecondSortie(
            true=true,
            nominal=craft.nominal,
            radius_m=radius,
            rotor_m=hubs,
            spin=np.array(spin),
            numbers=numbers,
            names=names,
            plan=plan,
            turbulence=turbulence,
            charge=float(rng.uniform(0.5, 0.98)),
            seed=int(rng.integers(2**31)),
        )
        for plan in plans
    ]


def _flown(
    craft: TrueVehicle,
    sortie: SecondSortie,
    f: int,
    book: Mapping[str, np.ndarray],
    where: Mapping[str, Sequence[int]],
) -> TrueFlight:
    rows = {n: v[:, :, f].astype(float) for n, v in book.items() if not n.startswith("change/")}
    plain = rows.pop("plain_speed")
    changes = {}
    for name in sortie.names:
        if name in DRIVES:
            # against a plain drive at the same commands
            off = rows["rotor_speed"] - plain
            changes[name] = driven(body_of(craft), craft.true, rows["rotor_speed"], off)
        else:
            part = book[f"change/{name}"][:, :, where[name].index(f)].astype(float)
            changes[name] = {"force_N": part[:, :3], "moment_Nm": part[:, 3:]}
    rows |= {
        "p_ref": sortie.plan[:3].T,
        "v_ref": sortie.plan[3:6].T,
        "yaw_ref": sortie.plan[9:10].T,
    }
    # (sd, correlation time) of each process of the air, as the limit takes it
    scales = tuple((share * sortie.turbulence, time) for share, time in TURBULENCE)
    return TrueFlight(CONTROL * DT_S, rows, changes, Air(scales, TURN_PER_M))
