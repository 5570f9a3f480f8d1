"""All worlds, and how their sets are made: in pieces, resumable, sealed when the last one stands.

The split is a rule: a seed belongs to one half (:func:`sets.half_of`). Each half has its own paths,
rates and noise, or its own conditions of real flights. What cannot be made here, or flown at all,
is skipped with a reason, which is kept beside the seal.
"""

from __future__ import annotations

import contextlib
import importlib.util
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ges.blind.foreign import (
    crazyflow,
    drone_models,
    given,
    home,
    logs,
    mujoco,
    multirotor,
    real,
    rotorpy,
    second,
)
from ges.blind.foreign.sets import NoSet, Place, Sources, check_half, half_of
from ges.blind.protocol import seal
from ges.errors import GesError, UsageError, unknown_name
from ges.extras import install_command
from ges.files import tree_hash, write_json
from ges.provenance.sources import PACKAGE, sources

# libraries that share the machine's cores among themselves would not give the same bytes
ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
ARRAYS = {**ALONE, "SCIPY_ARRAY_API": "1"}
JAX = {**ARRAYS, "JAX_ENABLE_X64": "1", "JAX_PLATFORMS": "cpu"}
Sets = Sequence[tuple[Any, int, Place]]


@dataclass(frozen=True)
class World:
    """A source of sets: a simulator, logs or published flights.

    Attributes
    ----------
    name, about : its name and what it is, in words.
    designs : lists what it makes for a half.
    make : writes some of these sets into a folder.
    batch : number of sets that are made together, in one process.
    modules : packages that must be importable.
    folder : folder that must be there; None where none is needed.
    environment : variables of the process.
    """

    name: str
    about: str
    designs: Callable[[str, Sources], Sequence[Any]]
    make: Callable[[Path, Sets, Sources], None]
    batch: int = 1
    modules: tuple[str, ...] = ()
    folder: Callable[[str, Sources], Path] | None = None
    environment: Mapping[str, str] = field(default_factory=lambda: ALONE)

    def missing(self, half: str, places: Sources) -> str:
        """Return why it cannot be made here.

        Returns
        -------
        The missing package or folder, in words; empty where nothing is missing.
        """
        lacking = [m for m in self.modules if importlib.util.find_spec(m) is None]
        if lacking:
            return f"{lacking[0]} is not installed; {install_command('simulators')}"
        folder = self.folder and self.folder(half, places)
        return f"'{folder}' is not there" if folder and not folder.is_dir() else ""


def _published(name: str) -> Callable[[str, Sources], Path]:
    return lambda half, places: places.recordings / name


def _flown(
    name: str, about: str, module: Any, batch: int = 1, environment: Mapping[str, str] = ALONE
) -> World:
    return World(
        name,
        about,
        lambda half, _: module.designs(half),
        module.make,
        batch,
        module.NEEDS,
        environment=environment,
    )


def _recorded(name: str, about: str, designs: Callable[[str], Sequence[Any]]) -> World:
    return World(
        name,
        about,
        lambda half, _: designs(half),
        real.maker(name),
        folder=_published(real.FOLDERS[name]),
    )


WORLDS: dict[str, World] = {
    world.name: world
    for world in (
        _flown(rotorpy.WORLD, "RotorPy, its controller and trajectories", rotorpy),
        World(
            given.WORLD,
            "gym-pybullet-drones, its own PID; sets made elsewhere",
            given.designs,
            given.make,
            batch=10,
            folder=given.folder_of,
        ),
        # one batch of all its sets: they are worlds of one simulation
        _flown(crazyflow.WORLD, "crazyflow, its Mellinger controller", crazyflow, 99, JAX),
        _flown(
            drone_models.WORLD,
            "drone-models under the blind pilot",
            drone_models,
            environment=ARRAYS,
        ),
        _flown(mujoco.WORLD, "MuJoCo's actuators, fluid, wind and tendons", mujoco),
        _flown(multirotor.WORLD, "multirotor's propellers and motors", multirotor),
        World(
            logs.WORLD,
            "logs of PX4 flying in Gazebo and in SIH",
            lambda half, _: logs.designs(half),
            logs.make,
            folder=_published("gazebo-iris"),
        ),
        _recorded(real.CRAZYPAD, "real Crazyflies, labelled changes", real.crazypad_designs),
        _recorded(real.IMRCLAB, "real Crazyflies with a payload", real.imrclab_designs),
        _recorded(real.APPIUS, "a real quadrotor near the ground", real.appius_designs),
        World(
            home.AS_IT_IS,
            "the home generator as it is",
            lambda half, _: home.designs(half),
            home.make,
            batch=10,
        ),
        World(
            home.OTHER_AIR,
            "the home generator in other airs",
            lambda half, _: home.designs(half),
            home.make_in_other_air,
            batch=10,
        ),
        _flown(second.WORLD, "the effects as a second author reads the papers", second, 20),
    )
}


def make_worlds(
    out: Path,
    half: str,
    seed: int,
    only: Sequence[str] = (),
    every: int = 1,
    places: Sources | None = None,
    processes: int = 2,
    minutes: float | None = None,
    tell: Callable[[int, int], None] = lambda *_: None,
) -> tuple[int, int, dict[str, str]]:
    """Make the sets of a half that are not there yet, and seal the folder when all are.

    Parameters
    ----------
    out : folder of the sets.
    half : 'development' or 'evaluation'.
    seed : of all random draws; belongs to the half.
    only : worlds to restrict to; by default all.
    every : one set of so many is made.
    places : folders of what cannot be made here.
    processes : batches made at the same time.
    minutes : after which no more is begun; the next call goes on.
    tell : called with the number of sets done and of all.

    Returns
    -------
    Sets that are done with, sets in all, and reasons of worlds, or sets, that were skipped.

    Raises
    ------
    UsageError
        For an unknown world, a seed of the other half, or a folder that is sealed already.
    GesError
        When none of the worlds can be made here.
    """
    check_half(half, seed)
    for name in only:
        if name not in WORLDS:
            raise unknown_name("world", name, WORLDS)
    if (out / "sealed" / seal.SUMS).exists():
        raise UsageError(f"'{out}' already holds sealed cases; name an empty folder")
    places = places or Sources()
    # processes work in folders of their own, where relative paths mean other places
    out, places = out.resolve(), Sources(places.recordings.resolve(), places.given.resolve())
    chosen = {name: world for name, world in WORLDS.items() if not only or name in only}
    skipped = {n: why for n, w in chosen.items() if (why := w.missing(half, places))}
    sets = {
        name: _sets(world, half, seed, every, places)
        for name, world in chosen.items()
        if name not in skipped
    }
    total = sum(map(len, sets.values()))
    if not total:
        raise GesError(
            "no world can be made here: " + "; ".join(f"{n}: {why}" for n, why in skipped.items())
        )
    about = _about(half, seed, every, sets, skipped)
    seal.begin(out, about)
    jobs = list(_jobs(out, sets))
    remaining = sum(len(job) for _, job in jobs)
    tell(total - remaining, total)
    deadline = None if minutes is None else time.monotonic() + 60.0 * minutes
    failed: dict[str, str] = {}
    for batch, why in _run(out, jobs, places, processes, deadline):
        remaining -= len(batch)
        failed |= {p.identity: why for _, _, p in batch if not _sealed(out, p)}
        tell(total - remaining, total)
    if not remaining:
        # the note first, then the seal over it
        write_json(out / "sealed" / seal.MADE, {**about, "lost": failed})
        (out / "sealed" / seal.BEGUN).unlink()
        seal.close(out)
    return total - remaining, total, {**skipped, **failed}


def make_and_seal(sums: Path, seed: int, every: int, recordings: str, given: str) -> None:
    """Make the sets of a workflow; go on where it was interrupted.

    Parameters
    ----------
    sums : list of hashes to be written, ``sealed/SHA256SUMS`` of the folder of sets.
    seed : of all random draws; decides the half.
    every : one set of so many is made.
    recordings, given : folders of published flights and of sets made elsewhere.
    """
    sums.unlink(missing_ok=True)
    sources = Sources(Path(recordings), Path(given))
    make_worlds(sums.parents[1], half_of(seed), seed, (), every, sources)


def _sets(world: World, half: str, seed: int, every: int, places: Sources) -> Sets:
    designs = list(world.designs(half, places))
    whole = [(d, k, Place(world.name, d.key, half, seed)) for k, d in enumerate(designs)]
    return whole[every // 2 :: every] or whole[:1]


def _about(
    half: str, seed: int, every: int, sets: Mapping[str, Sets], skipped: Mapping[str, str]
) -> dict[str, Any]:
    return {
        "half": half,
        "seed": seed,
        "every": every,
        "worlds": {name: len(part) for name, part in sets.items()},
        "skipped": dict(skipped),
        # sets of other sources than these are made anew
        "generator": tree_hash(PACKAGE, sources(__name__)),
    }


def _jobs(out: Path, sets: Mapping[str, Sets]) -> Iterator[tuple[World, Sets]]:
    """Yield batches that are not complete.

    A batch is made as a whole. What its sets share then does not depend on where an earlier run was
    interrupted.
    """
    for name, part in sets.items():
        size = WORLDS[name].batch
        for start in range(0, len(part), size):
            batch = part[start : start + size]
            if not all(_sealed(out, p) for _, _, p in batch):
                yield WORLDS[name], batch


def _sealed(out: Path, place: Place) -> bool:
    return (out / "sealed" / f"{place.identity}.json").exists()


def _run(
    out: Path,
    jobs: Sequence[tuple[World, Sets]],
    places: Sources,
    processes: int,
    deadline: float | None,
) -> Iterator[tuple[Sets, str]]:
    """Make batches, those of one environment in one pool.

    Yield each, and why not all of it could be made.
    """
    environments = {tuple(sorted(world.environment.items())) for world, _ in jobs}
    for environment in sorted(environments):
        waiting = [job for job in jobs if tuple(sorted(job[0].environment.items())) == environment]
        # spawned, not forked: libraries read these variables when they are imported
        spawn = multiprocessing.get_context("spawn")
        with environment_of(dict(environment)), ProcessPoolExecutor(processes, spawn) as pool:
            running: dict[Future, Sets] = {}
            while waiting or running:
                # no more is begun than runs at once, so that little is under way at the deadline
                late = deadline is not None and time.monotonic() > deadline
                while waiting and len(running) < processes and not late:
                    world, batch = waiting.pop(0)
                    running[pool.submit(_make, world.name, out, batch, places)] = batch
                if not running:
                    break
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for job in done:
                    yield running.pop(job), job.result()


@contextlib.contextmanager
def environment_of(values: Mapping[str, str]) -> Iterator[None]:
    """Set variables for processes that are started meanwhile.

    Parameters
    ----------
    values : of the variables by name; afterwards they are as before.
    """
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _make(world: str, out: Path, batch: Sets, places: Sources) -> str:
    """Make a batch in a folder of its own: some simulators leave logs where they are started.

    Return why not all of it could be made; nothing where it could.
    """
    with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
        try:
            WORLDS[world].make(out, batch, places)
        except NoSet as why:
            return str(why)
    return ""
