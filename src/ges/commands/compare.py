"""``ges compare``: two diagnoses side by side."""

from __future__ import annotations

from pathlib import Path

import click

from ges.commands import PATH
from ges.files import require_file, write_text


@click.command()
@click.argument("first", type=PATH, metavar="DIR")
@click.argument("second", type=PATH, metavar="DIR")
@click.option("--html", type=PATH, metavar="FILE", help="Write the comparison as a page, too.")
def command(first: Path, second: Path, html: Path | None) -> None:
    """Lay two diagnoses side by side.

    Shows verdicts, findings with intervals that overlap or do not, and errors on flights that took
    no part.

    Example: ges compare reports/monday reports/tuesday
    """
    if html:
        require_file(html)
    from ges.diagnose.report import compare
    from ges.diagnose.report.saved import load_diagnosis
    from ges.diagnose.report.terminal import console

    names = [str(first), str(second)]
    comparison = compare.compare(load_diagnosis(first), load_diagnosis(second), names)
    console().print(compare.as_text(comparison))
    if html:
        write_text(html, compare.as_html(comparison))
        click.echo(html, err=True)
