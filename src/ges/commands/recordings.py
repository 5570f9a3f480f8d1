"""``ges recordings``: published flights."""

from __future__ import annotations

from pathlib import Path

import click

from ges.commands import PATH
from ges.recordings import published


@click.group()
def command() -> None:
    """List the published flights, or fetch them.

    Example: ges recordings fetch appius-ground-effect --out recordings
    """


@command.command("list")
def list_sets() -> None:
    """Names, sources and licences."""
    for name, source in published.sources().items():
        click.echo(
            f"{name:22s} {len(source.files):3d} files  {source.repository} @ {source.commit[:10]} "
            f" licence: {source.licence}"
        )
        click.echo(f"{'':22s} {source.about}")
    for name, about in published.SHIPPED.items():
        click.echo(f"{name:22s} in the package: {about}")


@command.command()
@click.argument("names", nargs=-1)
@click.option("--out", type=PATH, required=True, help="Folder to bring them to.")
@click.option(
    "--from",
    "copies",
    type=PATH,
    envvar="GES_RECORDINGS",
    help="Take copies from this folder.",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=0.0, min_open=True),
    default=published.TIMEOUT_S,
    show_default=True,
    help="Seconds after which a source that does not answer is given up.",
)
def fetch(names: tuple[str, ...], out: Path, copies: Path | None, timeout_s: float) -> None:
    """Fetch sets by name, or all that are published; every file's SHA-256 is checked.

    Example: ges recordings fetch example --out recordings
    """
    for name in names or published.sources():
        for path in published.fetch(name, out, copies, timeout_s):
            click.echo(path, err=True)
