"""Make concealed cases: fly them, write the recording sets, seal the truth and hash the seal."""

from __future__ import annotations

import itertools
import operator
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ges.blind.generator import ground
from ges.blind.generator.airframe import TrueVehicle, draw_airframe
from ges.blind.generator.concealed import LEVELS
from ges.blind.generator.flight import Simulation, Sortie
from ges.blind.generator.grid import (
    COMPOSITIONS,
    FLIGHTS,
    Circumstances,
    Spec,
    draw_circumstances,
    draw_numbers,
    specs,
    truth,
    with_companions,
)
from ges.blind.generator.plan import CONTROL_DT_S, Room, make_plan
from ges.blind.generator.sensing import Recorder
from ges.blind.generator.what_if import detectable_of
from ges.blind.generator.whereabouts import FAST_STEP, TRUTH_STEP, seen_channels
from ges.blind.protocol import seal
from ges.conventions import GRAVITY_M_S2
from ges.errors import GesError, UsageError
from ges.files import tree_hash, write_json
from ges.provenance.sources import PACKAGE, sources

BATCH = 12
ATTEMPTS, GENTLER = 8, 0.9
WITNESSED = (
    "p",
    "v",
    "q",
    "omega",
    "rotor_speed",
    "u",
    "battery",
    "ground",
    "extra_force",
    "extra_moment",
)
DRIVEN = {
    "battery_sag",
    "motor_lag",
    "esc_delay",
    "thrust_curve",
    "rotor_saturation",
    "actuator_mapping",
}


@dataclass
class Case:
    """A case on its way to being flown.

    Attributes
    ----------
    spec, around : what is to be concealed, and what surrounds it.
    craft : the vehicle.
    numbers : physical numbers by effect.
    grid : heights of the terrain, z[y, x] (m).
    sorties : its flights.
    world : name of the world that it is made for; empty for a case of a grid.
    """

    spec: Spec
    around: Circumstances
    craft: TrueVehicle
    numbers: dict[str, dict[str, float]]
    grid: np.ndarray
    sorties: list[Sortie]
    world: str = ""

    @property
    def names(self) -> list[str]:
        """All that is concealed, each after the effect that it needs to act on."""
        return with_companions(self.spec.names)


def make_cases(
    out: Path,
    seed: int,
    grid: str,
    processes: int = 1,
    tell: Callable[[int, int], None] = lambda *_: None,
) -> int:
    """Make all cases of a grid; interrupted, it goes on with the next batch.

    Parameters
    ----------
    out : folder that gets ``cases/`` and ``sealed/``.
    seed : of all random draws.
    grid : key of :data:`COMPOSITIONS`.
    processes : batches made at the same time.
    tell : called with the number of cases done and of all.

    Returns
    -------
    The number of cases.

    Raises
    ------
    UsageError
        For an unknown grid or a folder that already holds sealed cases.
    GesError
        When a case could not be flown at any severity.
    """
    if grid not in COMPOSITIONS:
        raise UsageError(f"unknown grid '{grid}'; known: {', '.join(COMPOSITIONS)}")
    if (out / "sealed" / seal.SUMS).exists():
        raise UsageError(f"'{out}' already holds sealed cases; name an empty folder")
    every = specs(grid, seed)
    about = {
        "grid": grid,
        "seed": seed,
        "cases": len(every),
        "generator": tree_hash(PACKAGE, sources(__name__)),
    }
    seal.begin(out, about)
    batches = [every[i : i + BATCH] for i in range(0, len(every), BATCH)]
    waiting = [b for b in batches if not all(_sealed(out, spec, grid, seed) for spec in b)]
    done = len(every) - sum(map(len, waiting))
    tell(done, len(every))
    for count in _spread(waiting, out, grid, seed, processes):
        done += count
        tell(done, len(every))
    os.replace(out / "sealed" / seal.BEGUN, out / "sealed" / seal.MADE)
    seal.close(out)
    return len(every)


def make_and_seal(sums: Path, grid: str, seed: int, processes: int = 2) -> None:
    """Make the cases of a workflow; go on where it was interrupted.

    Parameters
    ----------
    sums : list of hashes to be written, ``sealed/SHA256SUMS`` of the folder of cases.
    grid, seed, processes : as of :func:`make_cases`.
    """
    sums.unlink(missing_ok=True)
    make_cases(sums.parents[1], seed, grid, processes)


def _sealed(out: Path, spec: Spec, grid: str, seed: int) -> bool:
    return (out / "sealed" / f"{draw_circumstances(spec, grid, seed).identity}.json").exists()


_Job = tuple[Sequence[Spec], Path, str, int]


def _spread(
    batches: Sequence[Sequence[Spec]], out: Path, grid: str, seed: int, processes: int
) -> Iterator[int]:
    jobs = [(b, out, grid, seed) for b in batches]
    if processes == 1:
        yield from map(_make_batch, jobs)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(_make_batch, jobs)


def _make_batch(job: _Job) -> int:
    batch, out, grid, seed = job
    fly_batch(batch, out, seed, lambda spec, attempt: draw_case(spec, grid, seed, attempt))
    return len(batch)


def fly_batch(
    batch: Sequence[Spec], out: Path, seed: int, draw: Callable[[Spec, int], Case]
) -> None:
    """Fly cases abreast and write them.

    A case that cannot be flown is drawn anew and flown gentler.

    Parameters
    ----------
    batch : cases to fly.
    out : folder that gets ``cases/`` and ``sealed/``.
    seed : of the errors of sensors and maps.
    draw : returns a case from its spec and the number of the attempt.

    Raises
    ------
    GesError
        When a case could not be flown at any severity.
    """
    waiting = list(batch)
    for attempt in range(ATTEMPTS * len(LEVELS)):
        cases = [draw(spec, attempt) for spec in waiting]
        # vehicles with as many rotors fly abreast
        rotors = operator.attrgetter("craft.n_rotors")
        groups = itertools.groupby(sorted(cases, key=rotors), key=rotors)
        written = {
            case.spec.index for _, group in groups for case in _fly_alike(list(group), out, seed)
        }
        waiting = [spec for spec in waiting if spec.index not in written]
        if not waiting:
            return
    raise GesError(
        f"case {waiting[0].index} ({waiting[0].names}) could not be flown at any severity"
    )


def _fly_alike(cases: Sequence[Case], out: Path, seed: int) -> list[Case]:
    """Fly cases of vehicles with as many rotors, and write those that could be flown."""
    book = Simulation([s for c in cases for s in c.sorties]).run()
    parts = [
        [{n: v[:, :, k * FLIGHTS + f] for n, v in book.items()} for f in range(FLIGHTS)]
        for k in range(len(cases))
    ]
    well = [(c, p) for c, p in zip(cases, parts, strict=True) if _flew(c, p)]
    limits = detectable_of([c for c, _ in well], [p for _, p in well])
    for (case, part), limit in zip(well, limits, strict=True):
        _write_case(case, part, limit, out, seed)
    return [case for case, _ in well]


def draw_case(spec: Spec, grid: str, seed: int, attempt: int = 0) -> Case:
    """Draw everything of a case.

    A further attempt keeps the circumstances, draws the numbers anew and is gentler. After every
    :data:`ATTEMPTS` of them the severity falls: what a vehicle cannot fly with is in no log.

    Parameters
    ----------
    spec : what is to be concealed.
    grid : decides the length of flights.
    seed : of all cases.
    attempt : number of the attempt.
    """
    # first flown gentler at the same severity, then with less concealed
    eased = tuple(max(0, level - attempt // ATTEMPTS) for level in spec.levels)
    spec = replace(spec, levels=eased)
    around = draw_circumstances(spec, grid, seed)
    rng = np.random.default_rng([seed, spec.index, 3, attempt])
    craft = draw_airframe(spec.size, rng, spec.frame)
    numbers = draw_numbers(spec, craft, seed, attempt)
    z = ground.draw_terrain(around.terrain, craft.radius_m, rng)
    merged = around.battery | {k: v for one in numbers.values() for k, v in one.items()}
    gentle = GENTLER ** (attempt % ATTEMPTS)
    sorties = [
        _sortie(f, around, craft, merged, z, [seed, spec.index, 4, attempt, f], gentle)
        for f in range(FLIGHTS)
    ]
    return Case(spec, around, craft, numbers, z, sorties)


def _sortie(
    f: int,
    around: Circumstances,
    craft: TrueVehicle,
    numbers: dict[str, float],
    z: np.ndarray,
    stream: list[int],
    gentle: float,
) -> Sortie:
    rng = np.random.default_rng(stream)
    low = max(1.3 * craft.radius_m, 0.6 * craft.radius_m + 0.04)
    # large vehicles fly faster, slow motors get smoother references, light ones are shaken more
    pace = gentle * float(np.clip(np.sqrt(craft.radius_m / 0.06), 0.7, 1.25))
    agility = float(np.clip(craft.nominal["lag"] / 0.03, 0.9, 2.2))
    room = Room(around.seconds[f], craft.radius_m, low, pace, agility, z)
    plan = make_plan(around.menu[f], room, around.excited[f], around.parked[f], rng)
    turbulence = around.turbulence * float(np.clip((0.65 / craft.true["mass"]) ** 0.15, 0.8, 1.5))
    return Sortie(craft, numbers, plan, z, around.charge[f], turbulence, int(rng.integers(2**62)))


def _flew(case: Case, flights: Sequence[Mapping[str, np.ndarray]]) -> bool:
    """Say whether every flight stayed up and near its references."""
    for sortie, flight in zip(case.sorties, flights, strict=True):
        n = sortie.plan.reference.shape[1]
        p, ref = flight["p"][:n], sortie.plan.reference[:3].T
        # cosine of the tilt, the attitude matrix's R33
        upright = 1.0 - 2.0 * (flight["q"][:n, 1] ** 2 + flight["q"][:n, 2] ** 2)
        if not (np.isfinite(p).all() and np.abs(p - ref).max() < 3.5 and upright.min() > 0.5):
            return False
    return True


def _write_case(
    case: Case, flights: Sequence[Mapping[str, np.ndarray]], limit: dict, out: Path, seed: int
) -> None:
    identity = case.around.identity
    final, folder = out / "cases" / identity, out / "cases" / f".{identity}"
    for stale in (final, folder):
        shutil.rmtree(stale, ignore_errors=True)
    folder.mkdir(parents=True)
    rng = np.random.default_rng([seed, case.spec.index, 5])
    flights = [
        {k: v[: s.plan.reference.shape[1]] for k, v in f.items()}
        for s, f in zip(case.sorties, flights, strict=True)
    ]
    for k, (sortie, flight) in enumerate(zip(case.sorties, flights, strict=True)):
        frame = Recorder(flight, sortie, case.around.logging, rng).frame()
        frame = frame.astype({c: "float32" for c in frame.columns if c != "t_s"})
        frame.to_parquet(folder / f"flight_{k + 1}.parquet", index=False, compression="zstd")
    terrain = _terrain_entry(case, folder, rng)
    text = yaml.safe_dump(case.craft.vehicle_file(terrain), sort_keys=False)
    (folder / "vehicle.yaml").write_text(text)
    for path in (*folder.iterdir(), folder):
        os.utime(path, (0, 0))
    os.replace(folder, final)
    _write_truth(case, flights, limit, out / "sealed" / identity)


def _terrain_entry(case: Case, folder: Path, rng: np.random.Generator) -> dict:
    """Write the case's map, with a survey error of some millimetres, and return its entry."""
    if case.around.terrain == "flat":
        return {"kind": "flat", "z_m": 0.0}
    x = ground.axis()
    # a survey's errors go together over two metres
    coarse = 0.003 * rng.standard_normal((9, 9))
    at = np.linspace(-ground.HALF_SIZE_M, ground.HALF_SIZE_M, 9)
    rows = np.stack([np.interp(x, at, row) for row in coarse])
    error = np.stack([np.interp(x, at, column) for column in rows.T], axis=1)
    z = np.round(case.grid + error, 4)
    np.savez_compressed(folder / "terrain.npz", x_m=x, y_m=x, z_m=z)
    return {"kind": "grid", "file": "terrain.npz"}


def _write_truth(
    case: Case, flights: Sequence[Mapping[str, np.ndarray]], limit: dict, stem: Path
) -> None:
    content = truth(case.spec, case.numbers, case.around.terrain)
    content |= seen_channels(case, flights)
    content["situation"] = {
        "vehicle": case.craft.size,
        "rotors": case.craft.n_rotors,
        "noise": case.around.logging.noise,
        "rotor_speeds": case.around.logging.rotor_speeds,
        "references": case.around.logging.references,
        "excitation": any(case.around.excited),
        "terrain": case.around.terrain,
        "menu": case.spec.menu,
        "rate_hz": case.around.logging.rate_hz,
    } | ({"world": case.world} if case.world else {})
    content["detectable"] = limit
    content["true_values"] = case.craft.true | {
        "weight_N": case.craft.true["mass"] * GRAVITY_M_S2,
        "battery_V": case.craft.battery_V,
    }
    if not case.world:
        witness: dict[str, Any] = _witness(case, flights)
        np.savez_compressed(stem.with_suffix(".npz"), **witness)
    write_json(stem.with_suffix(".json"), content)


def _witness(case: Case, flights: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return what the oracle is given of a case.

    States and extra loads are at 25 Hz, the drive at 125 Hz where it is concerned.
    """
    kept: dict[str, np.ndarray] = {}
    for k, flight in enumerate(flights, 1):
        spin_up = np.gradient(flight["rotor_speed"], CONTROL_DT_S, axis=0)
        slow = {name: flight[name] for name in WITNESSED} | {"rotor_acceleration": spin_up}
        kept |= {
            f"flight_{k}/{name}": rows[::TRUTH_STEP].astype(np.float32)
            for name, rows in slow.items()
        }
        if set(case.spec.names) & DRIVEN:
            fast = {name: flight[name] for name in ("u", "rotor_speed", "battery")}
            kept |= {
                f"flight_{k}/fast_{name}": rows[::FAST_STEP].astype(np.float32)
                for name, rows in fast.items()
            }
    return kept
