"""``ges import``: foreign logs into a recording set."""

from __future__ import annotations

from pathlib import Path

import click

from ..errors import GesError, UsageError


def _format(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        return "csv"
    return "ulog" if suffix in (".ulg", ".ulog") else "usd"


def _reader(kind: str, mapping: Path | None, n_rotors: int):
    if kind == "csv":
        from ..io.columns import load_map
        from ..io.csv import read_csv

        if mapping is None:
            raise UsageError("a CSV file needs a column map; give --map MAP.yaml (examples in config/imports)")
        loaded = load_map(mapping)
        return lambda path: read_csv(path, loaded)
    if kind == "ulog":
        from ..io.ulog import read_ulog

        return lambda path: read_ulog(path, n_rotors)
    from ..io.usd import read_usd

    return read_usd


def _names(sources: tuple[Path, ...]) -> list[str]:
    names = [path.stem for path in sources]
    if len(set(names)) == len(names):
        return names
    return [f"{path.parent.name}_{path.stem}" for path in sources]


@click.command("import")
@click.argument("sources", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--format", "kind", type=click.Choice(["auto", "csv", "ulog", "usd"]), default="auto", show_default=True,
              help="csv by a column map, PX4 ULog, or Crazyflie micro-SD; auto goes by the file's ending.")  # fmt: skip
@click.option("--map", "mapping", type=click.Path(path_type=Path), help="Column map (YAML) for CSV files.")
@click.option("--vehicle", "vehicle_path", type=click.Path(path_type=Path), required=True, help="Vehicle file of these flights.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the recording set.")
def command(sources: tuple[Path, ...], kind: str, mapping: Path | None, vehicle_path: Path, out: Path) -> None:
    """Bring logs of one vehicle into a recording set, one flight a file.

    Example: ges import flights/*.csv --map config/imports/appius.yaml --vehicle config/vehicles/appius.yaml --out set
    """
    from ..io.recording import checked_frame, write_set
    from ..vehicle import load_vehicle

    vehicle = load_vehicle(vehicle_path)
    names = _names(sources)
    if len(set(names)) < len(names):
        raise GesError("two of the files would become flights of the same name; rename one or import them apart")
    frames = []
    for name, path in zip(names, sources, strict=True):
        frame, warnings = _reader(_format(path) if kind == "auto" else kind, mapping, len(vehicle.rotors))(path)
        good, noticed = checked_frame(name, frame)
        for warning in (*warnings, *noticed):
            click.echo(f"warning: {warning}", err=True)
        click.echo(f"{name}: {len(good)} samples, {good['t_s'].iloc[-1] - good['t_s'].iloc[0]:.1f} s", err=True)
        frames.append((name, good))
    write_set(out, vehicle, frames)
