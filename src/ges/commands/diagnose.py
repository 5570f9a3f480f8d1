"""``ges diagnose``: what a simulator lacks, from recorded flights."""

from __future__ import annotations

from pathlib import Path

import click

NEXT = {
    "located": "looking for physics that explains it",
    "fitted": "flying again what took no part",
}
"""What goes on once a step has ended."""


@click.command()
@click.argument("recordings", type=click.Path(path_type=Path), metavar="SET")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="Folder for the report and its files.",
)
@click.option(
    "--holdout",
    multiple=True,
    metavar="FLIGHT",
    help=(
        "A flight (file name without .parquet) that takes no part; may be given again. Default: a"
        " rule that does not look at the flights."
    ),
)
@click.option(
    "--vehicle",
    "vehicle_path",
    type=click.Path(path_type=Path),
    help="Another vehicle than the set's own: a file, a simulator's model, or a name.",
)
@click.option(
    "--write-flight",
    type=click.Path(path_type=Path),
    metavar="FILE.csv",
    help=(
        "Write the recommended next flight as a set-point file, which ges simulate --references"
        " flies too."
    ),
)
def command(recordings, out, holdout, vehicle_path, write_flight) -> None:
    """Locate where the simulator and the flights of SET differ, name what is missing, fit it, and
    show the fit improve.

    Example: ges diagnose flights/monday --out reports/monday
    """
    from rich.console import Console

    from ges.diagnose.report.drawing import drawing

    with (
        drawing(out) as figures,
        Console(stderr=True).status(f"locating where {recordings} differs") as status,
    ):
        found = _diagnosed(recordings, out, list(holdout) or None, vehicle_path, figures, status)
    for warning in found.data["warnings"]:
        click.echo(f"warning: {warning}", err=True)
    click.echo(found.sentence)
    if write_flight:
        click.echo(_flight_written(found.next_flight, write_flight), err=True)
    click.echo(f"{out / 'report.html'}", err=True)


def _diagnosed(
    recordings: Path,
    out: Path,
    holdout: list[str] | None,
    vehicle_path: Path | None,
    figures,
    status,
):
    """The diagnosis of a set, its files written; what that takes is imported here, while
    ``figures`` get ready to be drawn.
    """
    from ges.diagnose.pipeline import diagnose
    from ges.diagnose.report.output import map_figure, write_diagnosis
    from ges.recordings.recording import load_set
    from ges.vehicle.file import load_vehicle

    def watch(step: str, known) -> None:
        if step == "located":
            figures.start(map_figure(known))
        status.update(NEXT[step])

    vehicle = load_vehicle(vehicle_path) if vehicle_path else None
    folder = vehicle_path.parent if vehicle_path else recordings
    found = diagnose(load_set(recordings), vehicle, holdout=holdout, folder=folder, watch=watch)
    write_diagnosis(found, out, folder, figures)
    return found


def _flight_written(advised, path: Path) -> str:
    """Write the set points of the advised manoeuvre; what was done, as a sentence."""
    from ges.files import replacing
    from ges.simulator import manoeuvres

    if not advised.get("manoeuvre"):
        return "no next flight is needed: nothing is open that another manoeuvre would separate"
    with replacing(path) as new:
        manoeuvres.to_frame(manoeuvres.make(advised["manoeuvre"])).to_csv(new, index=False)
    prepared = f" (to be flown with {advised['preparation']})" if "preparation" in advised else ""
    return (
        f"{path}: set points of {advised['manoeuvre']}{prepared}, to separate"
        f" {' from '.join(advised['separates'])}"
    )
