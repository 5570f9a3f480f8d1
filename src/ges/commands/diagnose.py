"""``ges diagnose``: what a simulator lacks, from recorded flights."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from ges.commands import OPEN, PATH, airframe_options, wheelbase_of
from ges.commands.import_ import MEND, reading_options
from ges.commands.settings import SET
from ges.errors import GesError, visible
from ges.files import NEW, require_file, require_folder, write_csv

SHOWN = ("--open", "--no-open", "--page", "--no-page", "--write-flight")
"""Options that change nothing of the diagnosis."""


@click.command()
@click.argument("sources", nargs=-1, required=True, type=PATH, metavar="SET|LOG...")
@click.option("--out", type=PATH, required=True, help="Folder for the page and its files.")
@click.option(
    "--vehicle",
    metavar="NAME|FILE",
    help="A vehicle of the library, or a vehicle file. Default: the set's, or made from the log.",
)
@airframe_options
@click.option(
    "--holdout",
    multiple=True,
    metavar="FLIGHT",
    help=(
        "A flight (its file's name without ending) that takes no part; may be given again. Default:"
        " a rule that does not look at the flights."
    ),
)
@reading_options
@MEND
@click.option(
    "--write-flight",
    type=PATH,
    metavar="FILE.csv",
    help=(
        "Write the recommended next flight as a set-point file, which ges simulate --references"
        " flies too."
    ),
)
@click.option(
    "--page/--no-page",
    default=True,
    help="Write the page and its figures, or, for programs, the other files alone.",
)
@OPEN
@SET
@click.pass_context
def command(
    context: click.Context,
    sources: tuple[Path, ...],
    out: Path,
    vehicle: str | None,
    mass_kg: float | None,
    prop: str | None,
    wheelbase_m: float | None,
    arm_m: float | None,
    layout: str | None,
    holdout: tuple[str, ...],
    kind: str,
    mends: tuple[str, ...],
    write_flight: Path | None,
    page: bool,
    opened: bool | None,
    pairs: tuple[str, ...],
    **reading: Any,
) -> None:
    """Find what a simulator lacks, from recorded flights.

    Locates where simulator and flights differ, names what is missing, fits it, and shows the fit
    improve. SET is a folder of 'ges import'; a LOG is read as it is, whatever autopilot wrote it.
    Any other folder stands for the logs in it.

    \b
    Examples:
      ges diagnose flight.ulg --mass 2.0 --prop 10in --out report
      ges diagnose logs --vehicle x500 --out report
      ges diagnose flights/monday --out reports/monday
    """
    from ges.diagnose.report.drawing import drawing
    from ges.diagnose.settings import parse, using

    _require_own(out)
    if write_flight:
        require_file(write_flight)
    # drawing before the imports: its process reads matplotlib while this one reads the rest
    pictures = drawing() if page else contextlib.nullcontext()
    with using(parse(pairs)), pictures as figures, DiagnoseProgress() as progress:
        from ges.diagnose.run import Request, run
        from ges.recordings.readers import Options

        request = Request(
            sources=sources,
            vehicle=vehicle,
            mass_kg=mass_kg,
            prop=prop,
            wheelbase_m=wheelbase_of(wheelbase_m, arm_m),
            layout=layout,
            holdout=holdout,
            options=Options(**reading),
            kind=kind,
            mends=mends,
            command=command_line(context),
        )
        diagnosis = run(request, out, figures, progress.step, page)
    _tell(diagnosis, out)
    if write_flight:
        click.echo(_flight_written(diagnosis.next_flight, write_flight), err=True)
    written = out / ("report.html" if page else "diagnosis.json")
    click.echo(written, err=True)
    if page and (at_a_display() if opened is None else opened):
        click.launch(written.resolve().as_uri())


class DiagnoseProgress:
    """Progress of a diagnosis on stderr.

    At a terminal there is a spinner. A step that has ended gives a line with its seconds.
    """

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(stderr=True, highlight=False)
        self._status = self._console.status("")
        self._words, self._since = "", 0.0

    def __enter__(self) -> DiagnoseProgress:
        self._status.start()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        # a step that failed has no time to tell
        if kind is None:
            self.step("")
        self._status.stop()

    def step(self, words: str) -> None:
        """End the last step, and begin another one.

        Parameters
        ----------
        words : what begins; '' for nothing.
        """
        now = time.monotonic()
        if self._words:
            self._console.print(f"{self._words}: {now - self._since:.1f} s", style="dim")
        self._words, self._since = words, now
        self._status.update(words)


def _require_own(out: Path) -> None:
    """Say that a folder is no place for a diagnosis, before the work."""
    require_folder(out)
    # what has neither a diagnosis nor what is left of one has a vehicle file of somebody's own
    ours = any((out / name).exists() for name in ("diagnosis.json", NEW))
    if (out / "vehicle.yaml").exists() and not ours:
        raise GesError(
            f"{out} holds a vehicle.yaml that no diagnosis wrote, as recording sets do; name"
            " another folder for --out"
        )


def command_line(context: click.Context) -> str:
    """Write the command as it was given, without options that change nothing of the result.

    Parameters
    ----------
    context : of the command.

    Returns
    -------
    One line, quoted for a shell.
    """
    words = ["ges", "diagnose"]
    for parameter in context.command.params:
        # only what was typed: a default is that of the version, which the page names as well
        if (
            context.get_parameter_source(parameter.name)
            is not click.core.ParameterSource.COMMANDLINE
        ):
            continue
        value = context.params[parameter.name]
        values = value if isinstance(value, tuple) else (value,)
        if isinstance(parameter, click.Argument):
            words += [str(v) for v in values]
        elif not set(parameter.opts) & set(SHOWN):
            words += [w for v in values for w in (parameter.opts[0], str(v))]
    return shlex.join(words)


def at_a_display() -> bool:
    """Tell whether a person sits in front of a screen.

    Returns
    -------
    True if stdout is a terminal and there is a display.
    """
    # a pipe, or a job without a screen, opens no browser
    display = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return display and sys.stdout.isatty()


def _tell(diagnosis: Any, out: Path) -> None:
    from ges.diagnose.report.blocks import flight_names, grouped_warnings

    content = {"origin": diagnosis.origin}
    # on stderr, so that standard output is the answer alone
    for warning in grouped_warnings(diagnosis.data["warnings"], flight_names(content)):
        click.echo(f"warning: {visible(warning)}", err=True)
    click.echo(diagnosis.sentence)
    if diagnosis.remark:
        click.echo(diagnosis.remark)


def _flight_written(advised: Mapping[str, Any], path: Path) -> str:
    """Write the set points of the advised manoeuvre; what was done, as a sentence."""
    from ges.simulator import manoeuvres

    if not advised.get("manoeuvre"):
        return "no next flight is needed: nothing is open that another manoeuvre would separate"
    write_csv(path, manoeuvres.to_frame(manoeuvres.make(advised["manoeuvre"])))
    prepared = f" (to be flown with {advised['preparation']})" if "preparation" in advised else ""
    return (
        f"{path}: set points of {advised['manoeuvre']}{prepared}, to separate"
        f" {' from '.join(advised['separates'])}"
    )
