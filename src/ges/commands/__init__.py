"""Commands of ``ges``, one a module, and the options that several of them share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

PATH = click.Path(path_type=Path)


class ParsedType(click.ParamType):
    """A value that a function of :mod:`ges.vehicle.parsing` reads.

    Parameters
    ----------
    name : name of the function.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read what was given; click adds the name of the option to an error."""
        from ges.errors import UsageError
        from ges.vehicle import parsing

        try:
            return getattr(parsing, self.name)(value)
        except UsageError as error:
            self.fail(str(error), param, ctx)


MASS = click.option(
    "--mass",
    "mass_kg",
    type=ParsedType("parse_mass_kg"),
    metavar="KG",
    help="LOG: what was flown, weighed; a vehicle file is made from the log.",
)
PROP = click.option(
    "--prop",
    type=ParsedType("require_propeller"),
    metavar="SIZE",
    help="Propellers, as 10in, 10x4.5, 5x4.3x3 (inches, inches, blades) or 0.254m.",
)
WHEELBASE = click.option(
    "--wheelbase",
    "wheelbase_m",
    type=ParsedType("parse_length_m"),
    metavar="LENGTH",
    help="LOG: distance of opposite motors, as 500mm, where it is known better than the log does.",
)
ARM = click.option(
    "--arm",
    "arm_m",
    type=ParsedType("parse_length_m"),
    metavar="LENGTH",
    help="LOG: distance of a motor from the centre, half of the wheelbase.",
)
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


def airframe_options(function: Callable) -> Callable:
    """Add what is said of a vehicle that is made from a log.

    Parameters
    ----------
    function : the command; takes ``mass_kg``, ``prop``, ``wheelbase_m``, ``arm_m``, ``layout``.

    Returns
    -------
    The command with the options, in their order.
    """
    # decorators apply from the last to the first, and help has them in this order
    for option in (LAYOUT, ARM, WHEELBASE, PROP, MASS):
        function = option(function)
    return function


def wheelbase_of(wheelbase_m: float | None, arm_m: float | None) -> float | None:
    """Choose the distance of opposite motors, m, as one of two options says it.

    Raises
    ------
    UsageError
        When both are given.
    """
    from ges.errors import UsageError

    if wheelbase_m and arm_m:
        raise UsageError("--wheelbase is twice --arm; give one of them")
    return 2.0 * arm_m if arm_m else wheelbase_m
