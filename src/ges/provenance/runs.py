"""What a run of the workflow was made of: one manifest a run, written after everything else.

A manifest lies in ``results/runs/<id>/manifest.json``. Its id is made from the configuration and
the project's files. The same question asked with the same code has the same id, on any machine and
any day.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import itertools
import json
import os
import platform
import re
import subprocess
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ges.errors import GesError, unknown_name
from ges.extras import install_command
from ges.files import sha256, write_json
from ges.study.config import Study


class StrictRun(BaseModel):
    """A part of a manifest; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid")


class Output(StrictRun):
    """One file that the run made.

    Attributes
    ----------
    rule : workflow rule that made it.
    sha256 : SHA-256 of the file, hexadecimal.
    size_bytes : size of the file.
    """

    rule: str
    sha256: str = Field(pattern="^[0-9a-f]{64}$")
    size_bytes: int = Field(ge=0)


class Code(StrictRun):
    """State of the project's files.

    Attributes
    ----------
    commit : git commit; ``unknown`` outside a checkout.
    modified : whether files differed from the commit.
    sha256 : hash over the project's files.
    """

    commit: str
    modified: bool
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class Environment(StrictRun):
    """Machine and software of a run.

    Attributes
    ----------
    python : version of Python.
    platform, processor : operating system with machine type, and model of the processor.
    cores : number of cores of the machine.
    compiler : first line of the C compiler's version.
    packages : installed versions by package.
    """

    python: str
    platform: str
    processor: str
    cores: int
    compiler: str
    packages: dict[str, str]


class Timing(StrictRun):
    """Cost of one job, named ``<stage>/<job>``.

    Attributes
    ----------
    wall_s : elapsed time.
    cpu_s : processor time; None where it was not measured.
    peak_MiB : largest resident memory; None where it was not measured.
    started_s : start after that of the first job recorded.
    starting_cpu_s : part of ``cpu_s`` before the work began: interpreter and imports.
    """

    wall_s: float
    cpu_s: float | None
    peak_MiB: float | None
    started_s: float
    starting_cpu_s: float | None


class Manifest(StrictRun):
    """Origin of a run's numbers, with hashes to check them.

    Attributes
    ----------
    manifest_version : 1.
    id : id of the run, see :func:`run_id`.
    config, config_sha256 : configuration and its hash.
    code, environment : what ran, and where.
    seeds : seeds by list.
    inputs : SHA-256 of the project's files, and of recordings, that were read, by path.
    outputs : files that were made, by path.
    metrics : numbers that the paper quotes, by name.
    timings : cost of each job.
    """

    manifest_version: int = Field(ge=1, le=1)
    id: str
    config: dict[str, Any]
    config_sha256: str
    code: Code
    environment: Environment
    seeds: dict[str, list[int]]
    inputs: dict[str, str]
    outputs: dict[str, Output]
    metrics: dict[str, float]
    timings: dict[str, Timing]


def config_hash(config: Mapping[str, Any]) -> str:
    """Hash a configuration, independent of the order and layout of its file.

    Parameters
    ----------
    config : the configuration, as JSON has it.

    Returns
    -------
    SHA-256, 64 hexadecimal digits.
    """
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()


def run_id(config: Mapping[str, Any], code_sha256: str) -> str:
    """Name the run of a configuration with given code.

    Parameters
    ----------
    config : the configuration, as JSON has it.
    code_sha256 : hash over the project's files.

    Returns
    -------
    First 8 digits of both hashes, with a hyphen between.
    """
    return f"{config_hash(config)[:8]}-{code_sha256[:8]}"


def _output_of(*command: str, cwd: Path | None = None) -> str:
    try:
        done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


def commit(root: Path) -> tuple[str, bool]:
    """Find the commit of a checkout.

    Parameters
    ----------
    root : folder of the checkout.

    Returns
    -------
    First 10 digits of the commit, or ``unknown``, and whether tracked files differ from it.
    """
    revision = _output_of("git", "rev-parse", "--short=10", "HEAD", cwd=root) or "unknown"
    return revision, bool(
        _output_of("git", "status", "--porcelain", "--untracked-files=no", cwd=root)
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown"
    return next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
        "unknown",
    )


def _environment() -> Environment:
    versions = {d.metadata["Name"].lower(): d.version for d in importlib.metadata.distributions()}
    compiler = _output_of(*os.environ.get("CC", "cc").split(), "--version").partition("\n")[0]
    return Environment(
        python=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        processor=_processor(),
        cores=os.cpu_count() or 1,
        compiler=compiler or "unknown",
        packages=dict(sorted(versions.items())),
    )


def _number(text: str) -> float | None:
    return None if text in {"-", "NA", ""} else float(text)


def _logged(log: Path, what: str) -> float | None:
    """Read the processor time that a job's log gives for ``what``."""
    match = (
        re.search(rf"([\d.]+) s of processor time {what}", log.read_text(errors="replace"))
        if log.is_file()
        else None
    )
    return float(match[1]) if match else None


def _timing(path: Path, log: Path) -> Timing:
    """Read the cost of a job.

    Processor time is that of the job's log, else of the benchmark, which misses what ends between
    two samples.
    """
    keys, values = (line.split("\t") for line in path.read_text().splitlines()[:2])
    row = dict(zip(keys, values, strict=True))
    cpu_s = _logged(log, "in all")
    return Timing(
        wall_s=float(row["s"]),
        cpu_s=_number(row["cpu_time"]) if cpu_s is None else cpu_s,
        peak_MiB=_number(row["max_rss"]),
        # the benchmark is written when the job ends
        started_s=path.stat().st_mtime - float(row["s"]),
        starting_cpu_s=_logged(log, "to start"),
    )


def _timings(folder: Path, logs: Path) -> dict[str, Timing]:
    """Read the timing of every job; a benchmark file is written when its job ends."""
    names = {
        f: f.relative_to(folder).with_suffix("").as_posix() for f in sorted(folder.rglob("*.tsv"))
    }
    rows = {name: _timing(f, logs / f"{name}.log") for f, name in names.items()}
    first = min((row.started_s for row in rows.values()), default=0.0)
    return {
        name: row.model_copy(update={"started_s": round(row.started_s - first, 2)})
        for name, row in rows.items()
    }


def write_manifest(
    made: list[Path],
    numbers: Path,
    study: Study,
    makers: dict[str, str],
    read: dict[str, str],
    code: Code,
    benchmarks: Path,
    logs: Path,
    manifest: Path,
) -> None:
    """Write the manifest of a finished run.

    Parameters
    ----------
    made : every result; named in the manifest as given, relative to where the workflow ran.
    numbers : JSON of the numbers quoted in the paper, the run's metrics.
    study : the configuration.
    makers : rule that made each result, by its path.
    read : SHA-256 of the files that the run read, by path.
    code : state of the project's files.
    benchmarks, logs : folders of Snakemake's benchmark files and of the logs, with a folder for
        each stage.
    manifest : file to write.
    """
    config = study.model_dump(mode="json")
    values = {name: entry["value"] for name, entry in json.loads(numbers.read_text()).items()}
    record = Manifest(
        manifest_version=1,
        id=run_id(config, code.sha256),
        config=config,
        config_sha256=config_hash(config),
        code=code,
        environment=_environment(),
        seeds={name: getattr(study.seeds, name).list() for name in type(study.seeds).model_fields},
        inputs=read,
        outputs={
            str(f): Output(rule=makers[str(f)], sha256=sha256(f), size_bytes=f.stat().st_size)
            for f in made
            if f.is_file()
        },
        metrics={name: value for name, value in values.items() if isinstance(value, int | float)},
        timings=_timings(benchmarks, logs),
    )
    write_json(manifest, record.model_dump(mode="json"))


class Cost(NamedTuple):
    """Cost of a stage, or of the whole run.

    Attributes
    ----------
    jobs : number of jobs.
    wall_s : time in which any of them ran.
    cpu_s, starting_cpu_s : sums over the jobs.
    peak_MiB : most memory that jobs running at the same time can have held.
    """

    jobs: int
    wall_s: float
    cpu_s: float
    starting_cpu_s: float
    peak_MiB: float


def _together(timings: Iterable[Timing]) -> Iterator[tuple[float, list[Timing]]]:
    """Split time at starts and ends of jobs: length, and the jobs that ran in it."""
    timings = list(timings)
    # between two neighbouring edges the set of running jobs is constant
    edges = sorted({edge for t in timings for edge in (t.started_s, t.started_s + t.wall_s)})
    for low, high in itertools.pairwise(edges):
        yield (
            high - low,
            [t for t in timings if t.started_s < high and t.started_s + t.wall_s > low],
        )


def cost(timings: Collection[Timing]) -> Cost:
    """Add up the cost of jobs.

    Parameters
    ----------
    timings : timing of each job.

    Returns
    -------
    Total cost; times and memory that were not measured count as 0.
    """
    stretches = [(length, jobs) for length, jobs in _together(timings) if jobs]
    return Cost(
        jobs=len(timings),
        wall_s=sum(length for length, _ in stretches),
        cpu_s=sum(t.cpu_s or 0.0 for t in timings),
        starting_cpu_s=sum(t.starting_cpu_s or 0.0 for t in timings),
        peak_MiB=max((sum(t.peak_MiB or 0.0 for t in jobs) for _, jobs in stretches), default=0.0),
    )


def stages(run: Manifest) -> dict[str, Cost]:
    """Add up the cost of every stage of a run.

    Parameters
    ----------
    run : manifest of the run.

    Returns
    -------
    Cost by stage, in the order in which they began, and of the whole under ``all``.
    """
    groups: dict[str, list[Timing]] = {}
    for name, timing in sorted(run.timings.items(), key=lambda item: item[1].started_s):
        groups.setdefault(name.partition("/")[0], []).append(timing)
    return {
        **{name: cost(group) for name, group in groups.items()},
        "all": cost(run.timings.values()),
    }


def load_manifest(path: Path) -> Manifest:
    """Read and check a manifest.

    Parameters
    ----------
    path : manifest.json of a run.

    Raises
    ------
    GesError
        When it cannot be read, or its content is wrong.
    """
    try:
        return Manifest.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        first = error.errors()[0] if isinstance(error, ValidationError) else None
        where, problem = (first["loc"], first["msg"]) if first else ((), str(error))
        raise GesError(
            f"manifest {path}: {'.'.join(map(str, where))}: {problem}; run the workflow again to"
            " write it anew"
        ) from None


def manifests(results: Path) -> dict[str, Path]:
    """List the manifest files below a results folder.

    Parameters
    ----------
    results : folder that holds ``runs``.

    Returns
    -------
    Paths by id of the run, newest last.
    """
    files = sorted(
        results.glob("runs/*/manifest.json"), key=lambda f: (f.stat().st_mtime, f.parent.name)
    )
    return {f.parent.name: f for f in files}


def find(results: Path, name: str) -> Manifest:
    """Find a run.

    Parameters
    ----------
    results : folder that holds ``runs``.
    name : id or its beginning; ``latest`` for the newest.

    Returns
    -------
    Manifest of the run.

    Raises
    ------
    GesError
        When there is no run, several fit, or the manifest cannot be read.
    UsageError
        When none fits; the message has the nearest id.
    """
    runs = manifests(results)
    if not runs:
        raise GesError(
            f"no run in {results / 'runs'}; 'make all' makes one, --results names another folder"
        )
    fitting = (
        [list(runs)[-1]] if name == "latest" else [run for run in runs if run.startswith(name)]
    )
    if len(fitting) != 1:
        raise (
            unknown_name("run", name, runs)
            if not fitting
            else GesError(f"run '{name}' may be " + " or ".join(fitting))
        )
    return load_manifest(runs[fitting[0]])


def changed_files(run: Manifest, folder: Path) -> dict[str, str]:
    """List outputs of a run that are no longer what they were.

    Parameters
    ----------
    run : manifest of the run.
    folder : folder that the paths in the manifest are relative to.

    Returns
    -------
    ``missing`` or ``changed``, by path.
    """
    wrong = {}
    for name, output in run.outputs.items():
        file = folder / name
        if not file.is_file():
            wrong[name] = "missing"
        elif sha256(file) != output.sha256:
            wrong[name] = "changed"
    return wrong


def flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested keys to dotted ones.

    Parameters
    ----------
    tree : nested mappings.
    prefix : what every key begins with.

    Examples
    --------
    >>> flat({"a": {"b": 1}, "c": 2})
    {'a.b': 1, 'c': 2}
    """
    rows: dict[str, Any] = {}
    for key, value in tree.items():
        inner = isinstance(value, Mapping)
        rows |= flat(value, f"{prefix}{key}.") if inner else {f"{prefix}{key}": value}
    return rows


def differences(a: Manifest, b: Manifest) -> dict[str, dict[str, tuple[Any, Any]]]:
    """List what differs between two runs.

    Parameters
    ----------
    a, b : manifests of the runs.

    Returns
    -------
    Both values by group (``config``, ``code``, ``environment``, ``metrics``, ``outputs``) and key;
    None where one has none.
    """

    def facts(run: Manifest) -> dict[str, dict[str, Any]]:
        return {
            "config": flat(run.config),
            "code": {"commit": run.code.commit, "sha256": run.code.sha256},
            "environment": flat(run.environment.model_dump()),
            "metrics": run.metrics,
            "outputs": {name: output.sha256 for name, output in run.outputs.items()},
        }

    both = ((group, facts(a)[group], facts(b)[group]) for group in facts(a))
    return {
        group: {k: (x.get(k), y.get(k)) for k in sorted({*x, *y}) if x.get(k) != y.get(k)}
        for group, x, y in both
        if x != y
    }


def export_mlflow(run: Manifest, uri: str, experiment: str) -> str:
    """Write a run into an MLflow store, once.

    Parameters
    ----------
    run : manifest of the run.
    uri : tracking address, or the name of an SQLite file.
    experiment : name of the experiment.

    Returns
    -------
    MLflow's own id of the run; that of the existing one if it was written before.

    Raises
    ------
    GesError
        When MLflow is not installed.
    """
    try:
        import mlflow
    except ImportError:
        raise GesError(f"MLflow is not installed; {install_command('mlflow')} adds it") from None
    mlflow.set_tracking_uri(uri if "://" in uri else f"sqlite:///{Path(uri).resolve()}")
    mlflow.set_experiment(experiment)
    # a run is its id: asked again, it is not written twice
    same = f"attributes.run_name = '{run.id}'"
    if existing := mlflow.search_runs(
        experiment_names=[experiment], filter_string=same, output_format="list"
    ):
        return existing[0].info.run_id
    with mlflow.start_run(run_name=run.id) as started:
        mlflow.log_params({key: str(value) for key, value in flat(run.config).items()})
        mlflow.log_metrics(run.metrics)
        mlflow.log_metrics({f"wall_s/{name}": t.wall_s for name, t in run.timings.items()})
        mlflow.set_tags(
            {
                "commit": run.code.commit,
                "modified": run.code.modified,
                "config_sha256": run.config_sha256,
            }
        )
        mlflow.log_dict(run.model_dump(mode="json"), "manifest.json")
    return started.info.run_id
