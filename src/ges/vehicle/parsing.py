"""Quantities of a vehicle as users write them, on the command line and on the page."""

from __future__ import annotations

import math
import re

from ges.errors import UsageError
from ges.vehicle.propeller import UNITS_M, Propeller

LIGHTEST_KG, HEAVIEST_KG = 0.005, 200.0
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


def parse_number(text: str) -> float:
    """Read a number.

    Parameters
    ----------
    text : with a decimal point or a decimal comma.

    Raises
    ------
    UsageError
        When it is no finite number, or its comma may separate thousands.

    Examples
    --------
    >>> parse_number("1.5"), parse_number("1,5")
    (1.5, 1.5)
    """
    given = text.strip()
    if _THOUSANDS.fullmatch(given):
        raise UsageError(
            f"'{given[:80]}' may be {given.replace(',', '.', 1)} or {given.replace(',', '')};"
            " write a decimal point and no separator of thousands"
        )
    try:
        value = float(given.replace(",", "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"'{given[:80]}' is no number; write it as in 1.5")
    return value


def parse_mass_kg(text: str) -> float:
    """Read a mass, kg.

    Parameters
    ----------
    text : see :func:`parse_number`.

    Raises
    ------
    UsageError
        When it is no number, or none that a vehicle weighs.

    Examples
    --------
    >>> parse_mass_kg("0.034")
    0.034
    """
    value = parse_number(text)
    require_mass(value)
    return value


def require_mass(value_kg: float) -> None:
    """Refuse a mass that no vehicle has.

    Parameters
    ----------
    value_kg : the mass, kg.

    Raises
    ------
    UsageError
        When it is not from 5 g to 200 kg.
    """
    if not LIGHTEST_KG <= value_kg <= HEAVIEST_KG:
        raise UsageError(
            f"a vehicle of {value_kg:g} kg is not simulated; allowed is {LIGHTEST_KG:g} to"
            f" {HEAVIEST_KG:g} kg, so give the mass as flown in kg"
        )


def require_propeller(text: str) -> str:
    """Check the size of a propeller.

    Parameters
    ----------
    text : see :meth:`~ges.vehicle.propeller.Propeller.parse`, which reads it.

    Returns
    -------
    The text as given.

    Raises
    ------
    UsageError
        When it is no size.

    Examples
    --------
    >>> require_propeller("10x4.5")
    '10x4.5'
    """
    Propeller.parse(text)
    return text


def parse_length_m(text: str) -> float:
    """Read a length.

    Parameters
    ----------
    text : as ``500mm``, ``0.5m`` or ``20in``; a plain number is in metres.

    Returns
    -------
    Length, m.

    Raises
    ------
    UsageError
        When it is no length, or none between 2 cm and 5 m.

    Examples
    --------
    >>> parse_length_m("500mm")
    0.5
    """
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*(mm|cm|in|m|\"|)", text.strip().lower())
    metres = float(match[1]) * (UNITS_M[match[2]] if match[2] else 1.0) if match else math.nan
    if not 0.02 <= metres <= 5.0:
        raise UsageError(f"'{text}' is no length from 0.02 to 5 m; write it as in 500mm or 0.5m")
    return metres
