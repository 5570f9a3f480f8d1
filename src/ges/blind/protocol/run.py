"""Diagnose every case of a folder, each by a process that can read that case alone."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from ges.blind.protocol import jail, seal, worker
from ges.errors import GesError, UsageError, unknown_name
from ges.files import read_kept, sha256, tree_hash, write_json
from ges.provenance.sources import sources
from ges.simulator._lib import library_path

OUT = "diagnosed"
SAME = (
    "import runpy, sys; sys.path.insert(0, sys.argv.pop(1));"
    " runpy.run_module('ges.blind.protocol.worker', run_name='__main__')"
)
"""An isolated interpreter would take the package that is installed, whichever one makes the
verdicts.
"""
SIMPLE = ("means", "losses", "stepwise", "parameters")
"""Baselines that stand beside the tool in every table of the worlds."""
BASELINES = (*SIMPLE, "sindy", "boosting")
METHODS: dict[str, dict] = {
    "ges": {},
    **{name: {"baseline": name} for name in BASELINES},
    "without-instruments": {"set": {"design.instruments": False}},
    "without-whitening": {"set": {"noise.whitening": False}},
    "without-tolerance": {"set": {"design.nominal_tolerance": False}},
}
LIMIT_S = 600


def method_options(method: str, numbers: Mapping[str, Any] | None = None) -> dict:
    """Return the worker's options of a method.

    Parameters
    ----------
    method : key of :data:`METHODS`: this tool, a baseline, or this tool without a part.
    numbers : settings by name.

    Raises
    ------
    UsageError
        For an unknown method, or settings of a baseline, which has none.
    """
    if method not in METHODS:
        raise unknown_name("method", method, METHODS)
    if not numbers:
        return METHODS[method]
    if "baseline" in METHODS[method]:
        raise UsageError(f"{method} has no settings; leave out --set or --of {method}")
    return {"set": {**METHODS[method].get("set", {}), **numbers}}


def method_folder(method: str, numbers: Mapping[str, Any] | None = None) -> str:
    """Return the name of the folder of a method's verdicts beside ``cases/``.

    Parameters
    ----------
    method : key of :data:`METHODS`.
    numbers : settings by name; they become a part of the name.
    """
    parts = [] if method == "ges" else [method]
    parts += [f"{key}={value}".replace(" ", "") for key, value in sorted((numbers or {}).items())]
    return "-".join([OUT, *parts])


def run_cases(
    folder: Path,
    processes: int = 2,
    only: list[str] | None = None,
    out: str = OUT,
    options: dict | None = None,
    minutes: float | None = None,
    tell: Callable[[int, int], None] = lambda *_: None,
) -> tuple[int, int]:
    """Diagnose the cases that have no verdict yet.

    Parameters
    ----------
    folder : of sealed cases.
    processes : diagnoses at the same time.
    only : names of the cases to restrict the run to.
    out : folder beside ``cases/`` for the verdicts.
    options : of the worker, see :func:`method_options`.
    minutes : after which no case is begun.
    tell : called with the number of cases done and of all.

    Returns
    -------
    How many were diagnosed now, and how many are left.

    Raises
    ------
    GesError
        For a case that is not sealed, a recording changed since, or a folder that the walls could
        not hide.
    """
    _hidden(folder)
    names = [n for n in seal.cases(folder) if only is None or n in only]
    tool = _tool_state(options or {})
    # what has a verdict of this very tool is kept, so that an interrupted run goes on
    waiting = [n for n in names if not finished(folder / out / n, tool)]
    # the recordings of the waiting cases only: truths stay closed
    seal.check(
        folder,
        [
            s
            for s in seal.listed(folder)
            if s.startswith("../cases/") and s.split("/")[2] in waiting
        ],
    )
    before = len(names) - len(waiting)
    tell(before, len(names))
    deadline = None if minutes is None else time.monotonic() + 60.0 * minutes

    def diagnose(name: str) -> bool:
        if deadline is not None and time.monotonic() > deadline:
            return False
        _one(folder / "cases" / name, folder / out / name, options or {}, tool)
        return True

    done = 0
    # threads do nothing but wait: each diagnosis is a process of its own
    with ThreadPoolExecutor(processes) as pool:
        jobs = [pool.submit(diagnose, name) for name in waiting]
        for job in as_completed(jobs):
            done += job.result()
            tell(before + done, len(names))
    return done, len(waiting) - done


def run_batch(sums: Path, verdicts: Path, batch: int, batches: int, method: str = "ges") -> None:
    """Diagnose every ``batches``-th case of a workflow's folder.

    What an interrupted batch had done is kept and not done again.

    Parameters
    ----------
    sums : list of hashes ``sealed/SHA256SUMS`` of the folder.
    verdicts : file that gets the hash of each diagnosis.
    batch, batches : number of the batch and of all.
    method : key of :data:`METHODS`.
    """
    folder, out = sums.parents[1], method_folder(method)
    names = seal.cases(folder)[batch::batches]
    run_cases(folder, 1, names, out, method_options(method))
    write_json(verdicts, {n: sha256(folder / out / n / "diagnosis.json") for n in names})


def _tool_state(options: dict) -> str:
    """Return the hash of all that makes a verdict.

    These are sources of the diagnosis, the compiled simulator and options.
    """
    root = Path(__file__).parents[2]
    parts = [
        tree_hash(root, sources(worker.__name__)),
        sha256(library_path()),
        json.dumps(options, sort_keys=True),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def finished(verdict: Path, tool: str) -> bool:
    """Return whether a case has its verdict from this very tool.

    Parameters
    ----------
    verdict : folder of the verdict.
    tool : hash of sources, simulator and options.

    Returns
    -------
    False as well for a diagnosis that failed: it is tried again.
    """
    about = read_kept(verdict / "run.json", dict)
    return (about.get("ended"), about.get("tool")) == ("well", tool)


def _hidden(folder: Path) -> None:
    real = folder.resolve()
    for root in (*jail.interpreter(), *jail.package()):
        if real.is_relative_to(root):
            raise GesError(
                f"'{folder}' lies in {root}, which a diagnosis may read; move the cases elsewhere"
            )


def _one(case: Path, final: Path, options: dict, tool: str) -> None:
    """Diagnose one case under a name that reveals nothing, and move the whole result into place."""
    with tempfile.TemporaryDirectory(prefix="") as scratch:
        given, made, home = (Path(scratch) / secrets.token_hex(6) for _ in range(3))
        for each in (given, made, home):
            each.mkdir()
        anonymous(case, given)
        start = time.perf_counter()
        failure = _process(given, made, home, options)
        about = {
            "ended": "well" if failure is None else "failed",
            "tool": tool,
            "wall_s": round(time.perf_counter() - start, 3),
        }
        if failure is not None:
            write_json(
                made / "diagnosis.json",
                {"schema": 1, "verdict": "failed", "sentence": failure, "findings": []},
            )
        worker = made / "worker.json"
        if worker.exists():
            about |= json.loads(worker.read_text())
            worker.unlink()
        write_json(made / "run.json", about)
        _move(made, final)


def _process(given: Path, made: Path, home: Path, options: dict) -> str | None:
    """Run the worker; return None, or its last error line when it failed."""
    # nothing of the caller's environment, which may tell; one thread and one hash seed make
    # verdicts the same to the last bit
    quiet = {
        "PATH": os.defpath,
        "HOME": str(home),
        "TMPDIR": str(made),
        "MPLCONFIGDIR": str(made),
        "LC_ALL": "C.UTF-8",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONHASHSEED": "0",
        "GES_LIBRARY": str(library_path().resolve()),
    }
    command = [
        sys.executable,
        "-I",
        "-B",
        "-c",
        SAME,
        str(jail.OWN),
        str(given),
        str(made),
        json.dumps(options),
    ]
    try:
        done = subprocess.run(
            command, cwd=given, env=quiet, capture_output=True, text=True, timeout=LIMIT_S
        )
    except subprocess.TimeoutExpired:
        return f"no verdict within {LIMIT_S} s"
    return (
        None
        if done.returncode == 0
        else (done.stderr.strip().splitlines() or ["no word"])[-1][:400]
    )


def _move(made: Path, final: Path) -> None:
    final.parent.mkdir(parents=True, exist_ok=True)
    # beside its place first: an interrupted copy is never taken for a verdict
    new = final.with_name(f".{final.name}.{os.getpid()}")
    shutil.rmtree(new, ignore_errors=True)
    shutil.copytree(made, new)
    shutil.rmtree(final, ignore_errors=True)
    os.replace(new, final)


def anonymous(case: Path, given: Path) -> None:
    """Copy a recording set without anything that could reveal its origin.

    Names, the order of flights, times of files, metadata and stray files stay behind.

    Parameters
    ----------
    case : folder of the set.
    given : empty folder for the copy.
    """
    import pyarrow.parquet as pq
    import yaml

    vehicle = yaml.safe_load((case / "vehicle.yaml").read_text())
    vehicle["name"] = "vehicle"
    map_file = (vehicle.get("terrain") or {}).get("file")
    if map_file:
        shutil.copyfile(case / map_file, given / "terrain.npz")
        vehicle["terrain"]["file"] = "terrain.npz"
    (given / "vehicle.yaml").write_text(yaml.safe_dump(vehicle, sort_keys=False))
    # by hash: the maker's order may follow what is concealed
    flights = sorted(case.glob("*.parquet"), key=sha256)
    for number, path in enumerate(flights, 1):
        pq.write_table(
            pq.read_table(path).replace_schema_metadata(None), given / f"flight_{number}.parquet"
        )
    for path in given.iterdir():
        os.utime(path, (0, 0))
