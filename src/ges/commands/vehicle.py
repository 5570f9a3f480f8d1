"""``ges vehicle``: a vehicle file from a log, from another simulator, or back to one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ges.commands import PATH, airframe_options, wheelbase_of
from ges.commands.import_ import read_log, reading_options
from ges.errors import GesError, UsageError, visible

if TYPE_CHECKING:
    from ges.vehicle.datasheet import Datasheet
    from ges.vehicle.propeller import Propeller

KINDS = ("sdf", "rotorpy", "urdf", "sih")


def _listed(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Print the library and leave."""
    # a shell that completes words parses as well, and nothing may be printed then
    if not wanted or context.resilient_parsing:
        return
    from ges.vehicle import library

    width = max(map(len, library.names()))
    for name in library.names():
        click.echo(f"{name:{width}s}  {library.title(name)}")
    context.exit()


@click.command()
@click.argument("source", type=PATH, metavar="LOG|MODEL|FILE|NAME")
@airframe_options
@click.option(
    "--models",
    multiple=True,
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    metavar="FOLDER",
    help="MODEL: where included Gazebo models lie; may be given again.",
)
@reading_options
@click.option("--name", help="Name of the vehicle.")
@click.option("--to", "target", type=click.Choice(KINDS), help="Write for that simulator instead.")
@click.option(
    "--law-as",
    "language",
    type=click.Choice(("c", "python")),
    help="Write the laws of a vehicle file as one function instead.",
)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_listed,
    help="List the vehicles that come with ges.",
)
def command(
    source: Path,
    mass_kg: float | None,
    prop: str | None,
    wheelbase_m: float | None,
    arm_m: float | None,
    layout: str | None,
    models: tuple[Path, ...],
    name: str | None,
    target: str | None,
    language: str | None,
    **reading: Any,
) -> None:
    """Print a vehicle file, every number with its source and standard deviation.

    From a flight log, its mass and propellers; from a Gazebo model (SDF), a RotorPy parameter file,
    a gym-pybullet-drones URDF or PX4 SIH parameters; from a vehicle file or a name of the library.
    What the source or the target cannot express is said on stderr.

    \b
    Examples:
      ges vehicle flight.ulg --mass 2.0 --prop 10in > drone.yaml
      ges vehicle x500/model.sdf > x500.yaml
      ges vehicle out/vehicle.fitted.yaml --to sdf > fitted.sdf
      ges vehicle out/vehicle.fitted.yaml --law-as python > law.py
    """
    from ges.vehicle import formats, load
    from ges.vehicle.law_export import law_as
    from ges.vehicle.propeller import Propeller

    propellers = Propeller.parse(prop) if prop else None
    log_only = {"--mass": mass_kg, "--wheelbase": wheelbase_m, "--arm": arm_m, "--frame": layout}
    wheelbase = wheelbase_of(wheelbase_m, arm_m)
    log_only |= {"--map": reading["mapping"], "--pwm": reading["pwm"]}
    path = load.vehicle_path(source)
    remarks: tuple[str, ...] = ()
    if not path.is_file() and not path.is_dir():
        raise GesError(f"there is no file {path}; give a log, a model, a vehicle file or a name")
    # as it is, comments and all: read and written again it would lose them
    if path.suffix in load.YAML_ENDINGS:
        _refuse({**log_only, "--prop": prop, "--name": name}, "a vehicle file says it; edit that")
        vehicle, text = load.load_vehicle(path), path.read_text(encoding="utf-8")
    else:
        if kind := formats.kind_of(path) if path.is_file() else None:
            _refuse(log_only, f"{path.name} says it")
            sheet = formats.read_model(path, kind, propellers, models)
        else:
            sheet = _from_log(path, mass_kg, propellers, wheelbase, layout, reading)
        sheet = sheet.renamed(name) if name else sheet
        vehicle, text, remarks = sheet.vehicle, sheet.to_yaml(), sheet.remarks
    if target and language:
        raise UsageError("--to writes a vehicle, --law-as its laws; ask for one of them")
    if language:
        text = law_as(vehicle, language)
    if target:
        export = formats.write_model(vehicle, target)
        text, remarks = export.text, (*remarks, *export.remarks)
    # on stderr: standard output is the file, to be sent into one
    for remark in remarks:
        click.echo(f"note: {visible(remark)}", err=True)
    click.echo(text, nl=False)


def _refuse(options: Mapping[str, object], why: str) -> None:
    """Refuse options that would be ignored."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise UsageError(f"{given[0]} is not for this source: {why}")


def _from_log(
    path: Path,
    mass_kg: float | None,
    prop: Propeller | None,
    wheelbase_m: float | None,
    layout: str | None,
    reading: dict[str, Any],
) -> Datasheet:
    from ges.vehicle.from_log import describe_log

    log = read_log(path, **reading)
    if mass_kg is None or prop is None:
        raise UsageError(
            f"{path.name} is a flight log, which does not say what the vehicle weighed or which"
            " propellers it had; give --mass and --prop, as in --mass 2.0 --prop 10in"
        )
    for note in log.notes:
        click.echo(f"note: {visible(note)}", err=True)
    return describe_log(log, mass_kg, prop, layout=layout, wheelbase_m=wheelbase_m)
