"""``ges explain``: what a diagnosis considered, and why a name was not given."""

from __future__ import annotations

from pathlib import Path

import click

from ges.commands import PATH


@click.command()
@click.argument("folder", type=PATH, metavar="DIR")
@click.argument("name", required=False)
def command(folder: Path, name: str | None) -> None:
    """Print what the diagnosis in DIR considered.

    With NAME it prints every rule that this effect had to pass, and what was measured.

    \b
    Examples:
      ges explain report
      ges explain report wind
    """
    from ges.diagnose.report import explain
    from ges.diagnose.report.saved import load_diagnosis
    from ges.diagnose.report.terminal import console

    content = load_diagnosis(folder)
    record = explain.decisions_about(content, name) if name else explain.overview(content)
    console().print(record)
