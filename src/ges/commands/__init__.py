"""Commands of ``ges``, one a module, and the options that several of them share."""

from __future__ import annotations

from pathlib import Path

import click

PATH = click.Path(path_type=Path)
LAYOUT = click.option(
    "--frame",
    "--layout",
    "layout",
    metavar="NAME|FILE",
    help=(
        "LOG: order and spins of the motors, as x, hexa-x, x8 or y6, where the log lacks them; or a"
        " file with the mixer of Betaflight or INAV (what diff all prints)."
    ),
)
OPEN = click.option(
    "--open/--no-open",
    "opened",
    default=None,
    help="Open the page in a browser. Default: at a terminal with a display.",
)
