"""``ges import``: flight logs into a recording set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ges.commands import PATH, ParsedType

if TYPE_CHECKING:
    from collections.abc import Callable

    import pandas as pd

    from ges.recordings.readers import Log


def _order(
    context: click.Context, option: click.Parameter, given: str | None
) -> tuple[int, ...] | None:
    """Numbers between commas or spaces."""
    if given is None:
        return None
    words = given.replace(",", " ").split()
    if not words or not all(word.isdigit() for word in words):
        raise click.BadParameter(f"'{given}' is no list of numbers; write it as 2,4,1,3")
    return tuple(map(int, words))


READING = (
    click.option(
        "--format",
        "kind",
        default="auto",
        show_default=True,
        help=(
            "px4, ardupilot, betaflight, ros, crazyflie, table (CSV, Parquet) or matlab; auto goes"
            " by the file's first bytes."
        ),
    ),
    click.option(
        "--map",
        "mapping",
        help=(
            "Column map of a table or MATLAB file, topic map of a ROS bag: a YAML file or a"
            " preset's name."
        ),
    ),
    click.option(
        "--pwm",
        type=(ParsedType("parse_number"), ParsedType("parse_number")),
        metavar="LOW HIGH",
        help="Motor outputs (us) that mean 0 and 1; default: what the log's parameters say.",
    ),
    click.option(
        "--rotor-order",
        callback=_order,
        metavar="N,N,...",
        help="For every motor in turn the number of the speed reading that is its own, where the"
        " log does not say, as 2,4,1,3.",
    ),
    click.option(
        "--part",
        type=click.IntRange(min=1),
        help="Which flight of a file that holds several (Betaflight); default: the longest.",
    ),
)
"""Options of every verb that reads a flight log."""


MEND = click.option(
    "--mend",
    "mends",
    multiple=True,
    metavar="NAME",
    help=(
        "Read the columns otherwise than they are told, as quaternion-xyzw or motors-2341; the"
        " sentence that refuses a log offers it. May be given again."
    ),
)
"""Option of every verb that makes a recording set."""


def reading_options(function: Callable) -> Callable:
    """Add :data:`READING` to a command, whose values :func:`read_log` takes.

    Parameters
    ----------
    function : the command.

    Returns
    -------
    The command with the options, in their order.
    """
    # decorators apply from the last to the first, and help has them in this order
    for option in reversed(READING):
        function = option(function)
    return function


def read_log(path: Path, kind: str, **options: Any) -> Log:
    """Read a log as the options of :data:`READING` say.

    Parameters
    ----------
    path, kind : see :func:`ges.recordings.readers.open_log`.
    **options : see :class:`ges.recordings.readers.Options`.

    Raises
    ------
    GesError
        When the log cannot be read.
    UsageError
        When an option is wrong.
    """
    from ges.recordings.readers import Options, open_log

    return open_log(path, Options(**options), kind)


def _parts(name: str, frame: pd.DataFrame, count: int) -> list[tuple[str, pd.DataFrame]]:
    """Cut the log into ``count`` consecutive flights of equal length in time."""
    if count == 1:
        return [(name, frame)]
    t = frame["t_s"]
    share = (t - t.iloc[0]) / (t.iloc[-1] - t.iloc[0])
    # the last sample has a share of one, and belongs to the last part
    number = (share * count).astype(int).clip(upper=count - 1)
    return [
        (f"{name}_part{k + 1:0{len(str(count))}d}", frame[number == k].reset_index(drop=True))
        for k in range(count)
    ]


def _within(name: str, frame: pd.DataFrame, between: tuple[float, float] | None) -> pd.DataFrame:
    """Select the rows of these seconds, counted from the first row."""
    from ges.errors import UsageError

    if between is None:
        return frame
    since_s = frame["t_s"] - frame["t_s"].iloc[0]
    kept = frame[(since_s >= between[0]) & (since_s <= between[1])]
    if kept.empty:
        raise UsageError(
            f"--between {between[0]:g} {between[1]:g} leaves no row of {name}, which lasts"
            f" {since_s.iloc[-1]:.1f} s"
        )
    return kept.reset_index(drop=True)


def _without_empty(
    parts: list[tuple[str, pd.DataFrame]],
) -> tuple[list[tuple[str, pd.DataFrame]], list[str]]:
    """Drop the columns that hold nothing in a flight.

    Returns
    -------
    Name and table of each flight, and a sentence for flights that lack the same columns.
    """
    lacking: dict[tuple[str, ...], list[str]] = {}
    kept = []
    for name, frame in parts:
        # a slow or late stream may have no sample in a part of the log
        empty = tuple(c for c in frame if frame[c].isna().all())
        kept.append((name, frame.drop(columns=list(empty))))
        if empty:
            lacking.setdefault(empty, []).append(name)
    return kept, [
        f"{', '.join(names)}: no sample of {', '.join(columns)}"
        for columns, names in lacking.items()
    ]


def _summary(name: str, frame: pd.DataFrame) -> str:
    from ges.recordings.recording import unit_of

    kept = [column for column in frame if not unit_of(column)]
    seconds = frame["t_s"].iloc[-1] - frame["t_s"].iloc[0]
    return f"{name}: {len(frame)} samples, {seconds:.1f} s" + (
        f"; kept, not used: {', '.join(kept)}" if kept else ""
    )


@click.command("import")
@click.argument("sources", nargs=-1, required=True, type=PATH, metavar="LOG...")
@reading_options
@MEND
@click.option(
    "--parts",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Cut each log into so many flights; a diagnosis needs two or more.",
)
@click.option(
    "--between",
    type=(float, float),
    metavar="START END",
    help="Keep these seconds of each log, on its own clock from its first sample on.",
)
@click.option(
    "--vehicle",
    "vehicle_path",
    type=PATH,
    required=True,
    help="Vehicle of these flights: a file, a simulator's model, or a name (ges vehicle --list).",
)
@click.option("--out", type=PATH, required=True, help="Folder of the recording set.")
def command(
    sources: tuple[Path, ...],
    mends: tuple[str, ...],
    parts: int,
    between: tuple[float, float] | None,
    vehicle_path: Path,
    out: Path,
    **reading: Any,
) -> None:
    """Bring logs of one vehicle into a recording set, one flight a file.

    Example: ges import flights/*.ulg --vehicle vehicle.yaml --out set
    """
    from ges.errors import visible
    from ges.files import require_folder
    from ges.recordings.readers import find_logs, flight_names
    from ges.recordings.recording import make_set, write_set
    from ges.vehicle.load import load_vehicle

    require_folder(out)
    vehicle = load_vehicle(vehicle_path)
    flights: list[tuple[str, pd.DataFrame]] = []
    noticed: dict[str, list[str]] = {}
    for name, path in flight_names(find_logs(sources)).items():
        log = read_log(path, **reading)
        cut, empty = _without_empty(_parts(name, _within(name, log.frame(), between), parts))
        recordings = make_set(vehicle, cut, mends=mends)
        # what a reader notes is mostly the same of all logs: said once, with their names
        for note in log.notes:
            noticed.setdefault(note, []).append(path.name)
        for warning in (*empty, *recordings.warnings):
            click.echo(f"warning: {visible(warning)}", err=True)
        for flight in recordings.flights:
            click.echo(visible(_summary(flight.name, flight.frame)), err=True)
            flights.append((flight.name, flight.frame))
    for note, names in noticed.items():
        click.echo(f"warning: {', '.join(names)}: {visible(note)}", err=True)
    if len(flights) < 2:
        click.echo(
            "warning: one flight only; a diagnosis needs two or more, --parts 4 cuts a long one",
            err=True,
        )
    write_set(out, vehicle, flights)
