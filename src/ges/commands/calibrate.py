"""``ges calibrate``: a vehicle file from flights that are known to be good."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("recordings", type=click.Path(path_type=Path), metavar="SET")
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Vehicle file to write."
)
def command(recordings: Path, out: Path) -> None:
    """Fit a vehicle's numbers, motor gains and trims to reference flights, within their tolerances.

    The file it writes goes with later flights and asks: what has changed since?

    Example: ges calibrate healthy --out drone7.yaml
    """
    from ges.diagnose.calibrate.calibrate import calibrate
    from ges.recordings.recording import load_set
    from ges.vehicle.file import save_vehicle

    found = calibrate(load_set(recordings))
    for warning in found.warnings:
        click.echo(f"warning: {warning}", err=True)
    click.echo(
        f"{'number':32s} {'correction':>11s} {'95 % interval':>24s} {'between flights':>16s}"
        f" {'doubt later':>12s}",
        err=True,
    )
    for key, n in found.numbers.items():
        interval = f"{n.ci95[0]:.3g} .. {n.ci95[1]:.3g}"
        click.echo(
            f"{key:32s} {n.value:11.3g} {interval:>24s} {n.flight_sd:16.2g} {n.later_sd:12.2g}",
            err=True,
        )
    save_vehicle(found.vehicle, out)
    click.echo(
        f"{out}: {found.seconds:.1f} s in the air; flights differ by {100 * found.spread:.1f} % in"
        " their trims",
        err=True,
    )
