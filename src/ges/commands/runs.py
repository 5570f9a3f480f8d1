"""``ges runs``: what was run, from what, and whether it is still there."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from ges.commands import PATH
from ges.provenance import runs

RESULTS = click.option(
    "--results",
    type=PATH,
    default=Path("results"),
    show_default=True,
    help="Folder of the results.",
)
RUN = click.argument("run", default="latest")


@click.group()
def command() -> None:
    """List, show, compare and verify runs of the workflow.

    Example: ges runs diff 3f2a latest
    """


def _print(table: Table) -> None:
    # in a file or a pipe no row wraps
    Console(width=None if sys.stdout.isatty() else 1000).print(table)


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(heading, no_wrap=True)
    return table


@command.command("list")
@RESULTS
def list_runs(results: Path) -> None:
    """One line a run, the newest last."""
    table = _table("run", "commit", "outputs", "metrics", "job seconds")
    for path in runs.manifests(results).values():
        run = runs.load_manifest(path)
        state = run.code.commit + (" + changes" if run.code.modified else "")
        spent = sum(t.wall_s for t in run.timings.values())
        table.add_row(run.id, state, str(len(run.outputs)), str(len(run.metrics)), f"{spent:.0f}")
    _print(table)


@command.command()
@RUN
@RESULTS
@click.option("--json", "as_json", is_flag=True, help="The whole manifest.")
def show(run: str, results: Path, as_json: bool) -> None:
    """Where a run came from and what it measured."""
    manifest = runs.find(results, run)
    if as_json:
        click.echo(manifest.model_dump_json(indent=1))
        return
    click.echo(
        f"run      {manifest.id}\ncommit  "
        f" {manifest.code.commit}{' + changes' if manifest.code.modified else ''}"
    )
    click.echo(
        f"config   {manifest.config_sha256}\npython   {manifest.environment.python},"
        f" {manifest.environment.compiler}"
    )
    table = _table("metric", "value")
    for name, value in manifest.metrics.items():
        table.add_row(name, f"{value:g}")
    _print(table)
    table = _table("job", "seconds", "peak MiB")
    for name, t in sorted(manifest.timings.items(), key=lambda item: -item[1].wall_s):
        table.add_row(name, f"{t.wall_s:.1f}", "" if t.peak_MiB is None else f"{t.peak_MiB:.0f}")
    _print(table)


@command.command()
@RUN
@RESULTS
def cost(run: str, results: Path) -> None:
    """Print time and memory of a run by stage.

    'starting' is interpreter and imports, memory what jobs at once held at most.
    """
    manifest = runs.find(results, run)
    table = _table("stage", "jobs", "wall s", "CPU s", "starting CPU s", "peak MiB")
    for name, c in runs.stages(manifest).items():
        table.add_row(name, str(c.jobs), *(f"{v:.0f}" for v in c[1:]))
    _print(table)


def _short(value: Any) -> str:
    return "-" if value is None else str(value)[:40]


@command.command()
@click.argument("a")
@click.argument("b")
@RESULTS
def diff(a: str, b: str, results: Path) -> None:
    """List what differs between two runs: configuration, code, packages, metrics, files."""
    first, second = runs.find(results, a), runs.find(results, b)
    table = _table("what", "key", first.id, second.id)
    for group, keys in runs.differences(first, second).items():
        for key, (x, y) in keys.items():
            table.add_row(group, key, _short(x), _short(y))
    click.echo("the same") if not table.row_count else _print(table)


@command.command()
@RUN
@RESULTS
def verify(run: str, results: Path) -> None:
    """Hash every file of a run again; exit 1 if one is missing or changed."""
    manifest = runs.find(results, run)
    wrong = runs.changed_files(manifest, results.parent)
    for name, what in wrong.items():
        click.echo(f"{what}: {name}")
    click.echo(
        f"run {manifest.id}: {len(manifest.outputs) - len(wrong)} of {len(manifest.outputs)} files"
        " are as they were made"
    )
    sys.exit(1 if wrong else 0)


@command.command()
@RUN
@RESULTS
@click.option(
    "--mlflow", "uri", required=True, metavar="STORE", help="SQLite file, or a tracking address."
)
@click.option("--experiment", default="ges", show_default=True, help="MLflow experiment.")
def export(run: str, results: Path, uri: str, experiment: str) -> None:
    """Write a run into an MLflow store.

    Example: ges runs export latest --mlflow mlflow.db
    """
    click.echo(f"MLflow run {runs.export_mlflow(runs.find(results, run), uri, experiment)}")
