"""``ges calibrate``: a vehicle file from flights that are known to be good."""

from __future__ import annotations

from pathlib import Path

import click

from ges.commands import PATH
from ges.files import require_file


@click.command()
@click.argument("recordings", type=PATH, metavar="SET...", nargs=-1, required=True)
@click.option("--out", type=PATH, required=True, help="Vehicle file to write.")
def command(recordings: tuple[Path, ...], out: Path) -> None:
    """Fit a vehicle's numbers, motor gains and trims to reference flights, within their tolerances.

    The file it writes goes with later flights and asks: what has changed since? Every SET is one
    session, a day say: flights of different days differ more than those of one, and two or more
    sessions tell by how much.

    Example: ges calibrate monday thursday --out drone7.yaml
    """
    require_file(out)

    from ges.diagnose.calibrate.calibrate import calibrate
    from ges.recordings.recording import load_set
    from ges.vehicle.file import save_vehicle

    # a session may be a single flight
    calibration = calibrate(*(load_set(one, least=1) for one in recordings))
    for warning in calibration.warnings:
        click.echo(f"warning: {warning}", err=True)
    click.echo(
        f"{'number':32s} {'correction':>11s} {'95 % interval':>24s} {'between flights':>16s}"
        f" {'between sessions':>17s} {'prior sd':>12s}",
        err=True,
    )
    for key, n in calibration.numbers.items():
        interval = f"{n.ci95[0]:.3g} .. {n.ci95[1]:.3g}"
        click.echo(
            f"{key:32s} {n.value:11.3g} {interval:>24s} {n.flight_sd:16.2g} {n.session_sd:17.2g}"
            f" {n.later_sd:12.2g}",
            err=True,
        )
    save_vehicle(calibration.vehicle, out)
    click.echo(
        f"{out}: {calibration.seconds:.1f} s in the air; in their trims"
        f" {calibration.spread_words()}",
        err=True,
    )
