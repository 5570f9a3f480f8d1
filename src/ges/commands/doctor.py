"""``ges doctor``: what is in a flight log, what can be told from it, what to log next time."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ges.commands import PATH, ParsedType
from ges.errors import GesError, visible

if TYPE_CHECKING:
    from rich.console import Console


def _show(examined: dict[str, Any], console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    from ges.examine import sentences

    title = f"{examined['name']}: {examined['autopilot'] or examined['format']},"
    title += f" {examined['seconds']:g} s"
    table = Table()
    for heading in ("stream", "Hz", "from s", "to s", "logged as"):
        table.add_column(heading, justify="left" if heading in ("stream", "logged as") else "right")
    for s in examined["streams"]:
        # as Text: a name in brackets would be read as a style
        cells = (s["name"], f"{s['rate_hz']:g}", f"{s['from_s']:g}", f"{s['to_s']:g}", s["source"])
        table.add_row(*(Text(visible(cell)) for cell in cells))
    console.print(Text(visible(title), style="bold"))
    console.print(table)
    for line, style in sentences(examined):
        console.print(Text(visible(line), style=style), soft_wrap=not console.is_terminal)


@click.command("doctor")
@click.argument("logs", nargs=-1, required=True, type=PATH, metavar="LOG|FOLDER...")
@click.option("--format", "kind", default="auto", show_default=True, help="As of 'ges import'.")
@click.option("--map", "mapping", help="Column or topic map: a YAML file or a preset's name.")
@click.option(
    "--pwm",
    type=(ParsedType("parse_number"), ParsedType("parse_number")),
    metavar="LOW HIGH",
    help="As of 'ges import'.",
)
@click.option("--part", type=click.IntRange(min=1), help="As of 'ges import'.")
@click.option("--json", "as_json", is_flag=True, help="Machine-readable, a list with one a log.")
def command(logs: tuple[Path, ...], kind: str, as_json: bool, **reading: Any) -> None:
    """Say what is in flight logs, what can be told from them, and what to log next time.

    Of a FOLDER, as a recording set is one, the logs in it are read.

    \b
    Examples:
      ges doctor flight.ulg
      ges doctor recordings/example
    """
    from rich.console import Console

    from ges.examine import examine
    from ges.recordings.readers import Options, find_logs

    options, console = Options(**reading), Console()
    examined, unread = [], 0
    for path in find_logs(logs):
        try:
            examined.append(examine(path, options, kind))
        # the other logs are told of all the same
        except GesError as error:
            unread += 1
            examined.append({"name": path.name, "usable": False, "problem": str(error)})
            if not as_json:
                click.echo(f"ges: {error}", err=True)
            continue
        if not as_json:
            _show(examined[-1], console)
    if as_json:
        click.echo(json.dumps(examined, indent=1))
    if unread:
        sys.exit(1)
