"""What every world hands over: flown flights with what was concealed in them, as a sealed set.

A world flies its designs. This module draws how they are logged, writes the recording set, and
seals the truth with its detection limit (:mod:`ges.blind.limit`).
"""

from __future__ import annotations

import hashlib
import itertools
import os
import shutil
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from ges.blind.foreign.recorder import LogSettings, record
from ges.blind.generator.airframe import TrueVehicle
from ges.blind.generator.detectable import (
    INERTIA,
    NAME_OF_WRONG,
    NOTHING,
    TrueFlight,
    detectable,
)
from ges.blind.generator.pilot import Pilot
from ges.blind.noise import Noise
from ges.conventions import rotor_speed
from ges.errors import GesError, UsageError
from ges.files import write_json

HALVES = ("development", "evaluation")
FIRST_OF_EVALUATION = 1000
FLAT = {"kind": "flat", "z_m": 0.0}


def half_of(seed: int) -> str:
    """Return the half that a seed belongs to.

    Returns
    -------
    'evaluation' from :data:`FIRST_OF_EVALUATION` on, 'development' below.
    """
    return HALVES[seed >= FIRST_OF_EVALUATION]


def check_half(half: str, seed: int) -> None:
    """Refuse a seed of the other half.

    Raises
    ------
    UsageError
        When ``seed`` belongs to the other half.
    """
    if half_of(seed) != half:
        raise UsageError(
            f"seed {seed} belongs to {half_of(seed)}, not to {half}; seeds below"
            f" {FIRST_OF_EVALUATION} are for development, the others for evaluation"
        )


class NoSet(GesError):
    """A set cannot be made here; the other sets of its world can."""


class OffPath(NoSet):
    """A vehicle left its path however gently it was flown."""


@dataclass(frozen=True)
class Sources:
    """Folders of what cannot be made here.

    Attributes
    ----------
    recordings : published flights.
    given : sets made elsewhere.
    """

    recordings: Path = Path("recordings")
    given: Path = Path("worlds")


@dataclass(frozen=True)
class Place:
    """Which set of a world this is; all random draws for it follow from it.

    Attributes
    ----------
    world : name of the world.
    key : name of the design, unique in the world.
    half : 'development' or 'evaluation'.
    seed : of all sets of a run.
    """

    world: str
    key: str
    half: str
    seed: int

    @property
    def identity(self) -> str:
        """Name of the set's folder, 12 hex digits that reveal neither world nor design."""
        text = f"{self.world}/{self.key}/{self.half}/{self.seed}"
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def rng(self, purpose: str) -> np.random.Generator:
        """Return the random stream of one purpose.

        Parameters
        ----------
        purpose : any word; each has a stream of its own, whatever the others have drawn.
        """
        parts = (self.world, self.key, self.half, purpose)
        return np.random.default_rng([self.seed, *(zlib.crc32(p.encode()) for p in parts)])


# two levels of noise for each half, over the ordinary one, and the rates of each half
LEVELS = {
    "development": {"low": 0.4, "high": 1.5},
    "evaluation": {"low": 0.6, "high": 1.9},
}
RATES_HZ = {"development": (50.0, 100.0, 250.0, 500.0), "evaluation": (62.5, 125.0, 200.0, 400.0)}


def draw_log(place: Place, number: int, noise: Noise | None = None) -> LogSettings:
    """Draw how a set is logged.

    Parameters
    ----------
    place : its half decides rates and noise levels; which streams are logged is drawn for it.
    number : of the set in its world; rates and levels go round with it.
    noise : ordinary noise of the sensors; by default :class:`Noise` as it is.
    """
    rng = place.rng("log")
    rates, levels = RATES_HZ[place.half], LEVELS[place.half]
    # shifted by one at each round of rates, so that every rate meets both levels
    level = list(levels)[(number // len(rates) + number) % 2]
    rate = rates[number % len(rates)]
    sensors = (noise or Noise()).scaled(levels[level])
    # motion capture is slower than an inertial sensor that is logged at every turn of the loop
    every = 4 if rate > 300.0 else 1
    return LogSettings(
        rate,
        replace(sensors, pose_every=every),
        level,
        rotor_speeds=bool(rng.random() < 0.6),
        references=bool(rng.random() < 0.8),
    )


@dataclass(frozen=True)
class Concealed:
    """What is true of a set, and how it is counted.

    Attributes
    ----------
    names : effects and wrong numbers that are to be named.
    severity : 'weak', 'medium' or 'strong'.
    optional : names that are true as well, but small.
    instead : whole answers that are as right as ``names``.
    verdict, category : by default they follow from the names.
    places : rotors that a name acts at, by name.
    parameters : true parameters, by name.
    note : remark beside the truth.
    laws : of what no library has: ``channel``, ``powers`` of speeds and rates in SI units, and
        ``coefficient_SI``.
    heavier : whether the vehicle is heavier than its file states. A payload is then as right as a
        loss of thrust.
    """

    names: tuple[str, ...] = ()
    severity: str = "medium"
    optional: tuple[str, ...] = ()
    instead: tuple[tuple[str, ...], ...] = ()
    verdict: str = ""
    category: str = ""
    places: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    note: str = ""
    laws: tuple[Mapping[str, Any], ...] = ()
    heavier: bool = False

    def truth(self) -> dict[str, Any]:
        """Return the truth in the form of the contract, with its category.

        Returns
        -------
        ``also_acceptable`` holds every other set of names that is right.
        """
        return {
            "verdict": self.verdict or ("physics" if self.names else "nothing_proven"),
            "findings": self._findings(self.names),
            "severity": self.severity,
            "also_acceptable": self._other(),
            "category": self.category or CATEGORY_OF_SIZE[min(len(self.names), 3)],
            "note": self.note,
            "laws": [dict(law) for law in self.laws],
        }

    def _findings(self, names: Iterable[str]) -> list[dict[str, Any]]:
        return [
            {"name": n, "parameters": dict(self.parameters.get(n, {}))} | place
            for n in names
            # a name that acts at several places is as many findings
            for place in ([{"place": p} for p in self.places.get(n, ())] or [{}])
        ]

    def _with_payload(self) -> list[tuple[str, ...]]:
        changed = tuple("payload" if n == "thrust_scale" else n for n in self.names)
        return [changed] if self.heavier else []

    def _other(self) -> list[list[str]]:
        # every choice of the small names, beside the answer itself or one that is as right
        whole = [
            sorted({*names, *more})
            for names in (self.names, *self._with_payload(), *self.instead)
            for size in range(len(self.optional) + 1)
            for more in itertools.combinations(self.optional, size)
        ]
        unlike = [names for names in whole if set(names) != set(self.names)]
        return [list(names) for names in dict.fromkeys(map(tuple, unlike))]


CATEGORY_OF_SIZE = ("null", "single", "pair", "triple")


@dataclass(frozen=True)
class Design:
    """A set to fly with a simulator; each simulator adds what its vehicles may have.

    Attributes
    ----------
    vehicle : name of one of the simulator's vehicles.
    wrong : factors by which the file is wrong, by the numbers of :data:`NAME_OF_WRONG`.
    copy : number among sets that are the same otherwise.
    """

    vehicle: str
    wrong: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    copy: int = field(default=0, kw_only=True)

    @property
    def key(self) -> str:
        """Name in the table of cases: vehicle, what differs, how the file is wrong, copy."""
        parts = [*self._parts(), *(f"file {n} {f:g}" for n, f in self.wrong.items())]
        return f"{self.vehicle} {', '.join(parts) or 'nothing'} #{self.copy}"

    def concealed(self) -> Concealed:
        """Return the truth; each simulator has its own."""
        raise NotImplementedError

    def _parts(self) -> list[str]:
        """Return the fields that differ from their defaults, in words."""
        own = (f for f in fields(self) if f.name not in ("vehicle", "wrong", "copy"))
        changed = [(f, getattr(self, f.name)) for f in own if getattr(self, f.name) != f.default]
        return [f.metadata.get("words") or f"{f.name} {value:g}" for f, value in changed]

    def _concealed(self, effects: Iterable[str], severity: str, **more: Any) -> Concealed:
        """Return the truth: effects that act, and what the file is wrong about."""
        names = (*effects, *(NAME_OF_WRONG[w] for w in self.wrong))
        if len(names) == 1 and self.wrong and "lag" not in self.wrong:
            more |= {"verdict": "parameter", "category": "parameter"}
        return Concealed(names, severity, heavier=self.wrong.get("mass", 1.0) < 1.0, **more)


Fly = Callable[[Any, Place, float], tuple[TrueVehicle, Sequence[TrueFlight]]]


def one_by_one(fly: Fly, method: str) -> Callable[..., None]:
    """Return the function that flies designs, one after the other, and seals them.

    Parameters
    ----------
    fly : returns vehicle and true flights of a design, its place and the rate of the log (Hz). It
        raises :class:`OffPath` where the vehicle left its path.
    method : how the limit is known, in words.
    """

    def make(out: Path, sets: Sequence[tuple[Design, int, Place]], sources: Sources) -> None:
        for design, number, place in sets:
            log = draw_log(place, number)
            craft, flights = fly(design, place, log.rate_hz)
            write_flown(out, place, craft, flights, log, design.concealed(), method, design.wrong)

    return make


def write_flown(
    out: Path,
    place: Place,
    craft: TrueVehicle,
    flights: Sequence[TrueFlight],
    log: LogSettings,
    concealed: Concealed,
    method: str,
    wrong: Mapping[str, float] = NOTHING,
) -> None:
    """Record flown flights, write the set, and seal its truth and detection limit.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    place : which set it is.
    craft : true vehicle, and what its file honestly declares.
    flights : true flights.
    log : how they are logged.
    concealed : the truth.
    method : how the limit is known, in words.
    wrong : factors by which the file is wrong beyond its stated uncertainty, by the numbers of
        :data:`NAME_OF_WRONG`.
    """
    rng = place.rng("sensors")
    frames = [record(flown, log, rng) for flown in flights]
    # the file is made wrong only after this: the limit takes the factors by themselves
    limits = detectable(flights, log.rate_hz, log.sensors, craft, wrong)
    craft = replace(craft, nominal=_with_wrong_nominal(craft.nominal, wrong))
    content = concealed.truth() | {
        "detectable": limits | {"method": method},
        "situation": _situation(place, craft.size, log) | {"rotors": craft.n_rotors},
    }
    write_set(out, place, craft.vehicle_file(FLAT), frames, content)


def _situation(place: Place, vehicle: str, log: LogSettings) -> dict[str, Any]:
    """Return what surrounds a set, for the table of cases."""
    return {
        "world": place.world,
        "design": place.key,
        "vehicle": vehicle,
        "noise": log.level,
        "rate_hz": log.rate_hz,
        "rotor_speeds": log.rotor_speeds,
        "references": log.references,
    }


def unknown_limit(why: str) -> dict[str, Any]:
    """Return the detection limit of a set whose noise-free truth nobody has.

    Parameters
    ----------
    why : it is not known, in words.
    """
    return {"whole": None, "without": {}, "method": why}


def write_recorded(
    out: Path,
    place: Place,
    vehicle: Mapping[str, Any],
    frames: Sequence[pd.DataFrame],
    truth: Mapping[str, Any],
    limit: str,
    situation: Mapping[str, str],
) -> None:
    """Write a set of recorded flights, whose detection limit is not known.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    place : which set it is.
    vehicle : content of the vehicle file.
    frames : flights in columns of the contract.
    truth : as of :meth:`Concealed.truth`.
    limit : why it is not known, in words.
    situation : what else surrounds the set.
    """
    content = dict(truth) | {
        "detectable": unknown_limit(limit),
        "situation": {
            "world": place.world,
            "rotor_speeds": rotor_speed(1)[0] in frames[0],
            **situation,
        },
    }
    write_set(out, place, vehicle, frames, content)


def write_set(
    out: Path,
    place: Place,
    vehicle: Mapping[str, Any],
    frames: Sequence[pd.DataFrame],
    truth: Mapping[str, Any],
) -> None:
    """Write one recording set and its truth, whole or not at all.

    The folder's name reveals nothing, files have no times, and the truth is written last.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    place : which set it is.
    vehicle : content of the vehicle file.
    frames : flights in columns of the contract; all but ``t_s`` become single precision.
    truth : content of the sealed file.
    """
    final, folder = out / "cases" / place.identity, out / "cases" / f".{place.identity}"
    for stale in (final, folder):
        shutil.rmtree(stale, ignore_errors=True)
    folder.mkdir(parents=True)
    for number, frame in enumerate(frames, 1):
        # single precision is finer than any sensor here, but not than the clock
        rounded = frame.astype({c: "float32" for c in frame.columns if c != "t_s"})
        rounded.to_parquet(folder / f"flight_{number}.parquet", index=False, compression="zstd")
    (folder / "vehicle.yaml").write_text(yaml.safe_dump(dict(vehicle), sort_keys=False))
    # times of files would tell the order in which sets were made
    for path in (*folder.iterdir(), folder):
        os.utime(path, (0, 0))
    os.replace(folder, final)
    write_json(out / "sealed" / f"{place.identity}.json", truth)


def untrimmed(
    craft: TrueVehicle, wrong: Mapping[str, float], lag_s: float, dt: float, flights: int = 1
) -> Pilot:
    """Return a controller that believes a wrong file, and that no flight before has trimmed.

    Parameters
    ----------
    craft : the vehicle.
    wrong : factors by which its file is wrong.
    lag_s : time constant of the drive that the gains are tuned for.
    dt : time from one command to the next (s).
    flights : that are flown abreast.
    """
    nominal = _with_wrong_nominal(craft.nominal, wrong)
    hubs, spin = craft.hubs_m[:, :2, None], np.array(craft.spin, dtype=float)[:, None]
    x, y, spin = (np.repeat(row, flights, axis=1) for row in (hubs[:, 0], hubs[:, 1], spin))
    many = {k: np.full(flights, v) for k, v in nominal.items()}
    pilot = Pilot(many, x, y, spin, np.full(flights, lag_s), dt)
    pilot.trim_moment = np.zeros((3, flights))
    return pilot


def _with_wrong_nominal(
    nominal: Mapping[str, float], wrong: Mapping[str, float]
) -> dict[str, float]:
    """Return what a wrong file declares; 'inertia' is wrong about all three axes."""
    return {k: v * wrong.get("inertia" if k in INERTIA else k, 1.0) for k, v in nominal.items()}
