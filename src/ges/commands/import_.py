"""``ges import``: foreign logs into a recording set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ges.errors import GesError, UsageError

if TYPE_CHECKING:
    import pandas as pd

_BEGINNINGS = {b"ULog": "ulog", b"\xbc": "usd"}


def _format(path: Path) -> str:
    """Format of a log, from its first bytes."""
    try:
        with path.open("rb") as file:
            head = file.read(4)
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror}") from None
    return next((kind for magic, kind in _BEGINNINGS.items() if head.startswith(magic)), "csv")


def _read(
    path: Path, kind: str, mapping: Path | None, n_rotors: int, pwm: tuple[float, float] | None
):
    if kind == "ulog":
        from ges.recordings.ulog import read_ulog

        return read_ulog(path, n_rotors, pwm)
    if kind == "usd":
        from ges.recordings.usd import read_usd

        return read_usd(path)
    if mapping is None:
        raise UsageError(
            f"{path.name} is read as CSV, which needs a column map; give --map MAP.yaml (examples"
            " in config/imports)"
        )
    from ges.recordings.columns import load_map
    from ges.recordings.csv import read_csv

    return read_csv(path, load_map(mapping))


def _names(sources: tuple[Path, ...]) -> list[str]:
    names = [path.stem for path in sources]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}_{path.stem}" for path in sources]
    if len(set(names)) < len(names):
        raise UsageError(
            "two of the files would become flights of the same name; rename one or import them"
            " apart"
        )
    return names


def _parts(name: str, frame: pd.DataFrame, count: int) -> list[tuple[str, pd.DataFrame]]:
    """The log as ``count`` consecutive flights of equal length in time."""
    if count == 1:
        return [(name, frame)]
    t = frame["t_s"]
    share = (t - t.iloc[0]) / (t.iloc[-1] - t.iloc[0])
    number = (share * count).astype(int).clip(upper=count - 1)
    return [
        (f"{name}_part{k + 1:0{len(str(count))}d}", frame[number == k].reset_index(drop=True))
        for k in range(count)
    ]


def _summary(name: str, frame: pd.DataFrame) -> str:
    from ges.recordings.recording import unit_of

    kept = [column for column in frame if not unit_of(column)]
    seconds = frame["t_s"].iloc[-1] - frame["t_s"].iloc[0]
    return f"{name}: {len(frame)} samples, {seconds:.1f} s" + (
        f"; kept, not used: {', '.join(kept)}" if kept else ""
    )


@click.command("import")
@click.argument("sources", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--format",
    "kind",
    type=click.Choice(["auto", "csv", "ulog", "usd"]),
    default="auto",
    show_default=True,
    help=(
        "csv by a column map, PX4 ULog, or Crazyflie micro-SD; auto goes by the file's first bytes."
    ),
)
@click.option(
    "--map", "mapping", type=click.Path(path_type=Path), help="Column map (YAML) for CSV files."
)
@click.option(
    "--pwm",
    type=(float, float),
    metavar="LOW HIGH",
    help="ULog: pulse widths (us) that mean 0 and 1; default: the log's PWM_MIN and PWM_MAX.",
)
@click.option(
    "--parts",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Cut each log into so many flights; a diagnosis needs two or more.",
)
@click.option(
    "--vehicle",
    "vehicle_path",
    type=click.Path(path_type=Path),
    required=True,
    help="Vehicle file of these flights.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder of the recording set."
)
def command(sources, kind, mapping, pwm, parts, vehicle_path, out) -> None:
    """Bring logs of one vehicle into a recording set, one flight a file.

    Example: ges import flights/*.csv --map config/imports/appius.yaml --vehicle
    config/vehicles/appius.yaml --out set
    """
    from ges.recordings.recording import make_set, write_set
    from ges.vehicle.file import load_vehicle

    vehicle = load_vehicle(vehicle_path)
    if pwm and not pwm[1] > pwm[0]:
        raise UsageError(f"--pwm {pwm[0]:g} {pwm[1]:g}: the first pulse width must be the smaller")
    flights = []
    for name, path in zip(_names(sources), sources, strict=True):
        frame, warnings = _read(
            path, _format(path) if kind == "auto" else kind, mapping, len(vehicle.rotors), pwm
        )
        made = make_set(vehicle, _parts(name, frame, parts))
        for warning in (*warnings, *made.warnings):
            click.echo(f"warning: {warning}", err=True)
        for flight in made.flights:
            click.echo(_summary(flight.name, flight.frame), err=True)
            flights.append((flight.name, flight.frame))
    if len(flights) < 2:
        click.echo(
            "warning: one flight only; a diagnosis needs two or more, --parts 4 cuts a long one",
            err=True,
        )
    write_set(out, vehicle, flights)
