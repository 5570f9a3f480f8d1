"""The numbers of a flight: a flat table of named numbers, which the compiled simulator lists."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np

from ges.conventions import MAX_ROTORS
from ges.errors import UsageError, unknown_name
from ges.simulator import _lib


@dataclasses.dataclass(frozen=True)
class FlightParameter:
    """One number of a flight.

    Attributes
    ----------
    name : its name.
    unit : ``1`` where it has none.
    doc : its meaning, in words.
    default : value where none is given, in ``unit``.
    low, high : bounds, in ``unit``, both allowed.
    """

    name: str
    unit: str
    doc: str
    default: float
    low: float
    high: float


@functools.lru_cache(maxsize=1)
def parameters() -> dict[str, FlightParameter]:
    """List every number of a flight, by name.

    Examples
    --------
    >>> parameters()["dt_s"].default
    0.001
    """
    return {row[0]: FlightParameter(*row) for row in _lib.parameter_table()}


def rotors_of(given: Mapping[str, float | str]) -> int:
    """Give the number of rotors of the vehicle that these numbers of a flight describe.

    Parameters
    ----------
    given : numbers of a flight by name; the simulator's default where ``rotors`` is missing.

    Raises
    ------
    UsageError
        When no vehicle has so many.
    """
    count = float(given.get("rotors", parameters()["rotors"].default))
    # asked before the simulator checks its numbers
    if not 1 <= count <= MAX_ROTORS:
        raise UsageError(f"rotors is {count:g}; allowed is 1 to {MAX_ROTORS}")
    return int(count)


def parameter_vector(given: Mapping[str, float]) -> np.ndarray:
    """Put the numbers of a flight into the order of the compiled library.

    Parameters
    ----------
    given : numbers by name, in the units of their names.

    Returns
    -------
    All parameters, (k,); defaults where none is given.

    Raises
    ------
    UsageError
        When a name is unknown.
    """
    defaults, places = _defaults()
    vector = defaults.copy()
    for name, value in given.items():
        if name not in places:
            raise unknown_name("parameter", name, parameters())
        vector[places[name]] = value
    return vector


@functools.lru_cache(maxsize=1)
def _defaults() -> tuple[np.ndarray, dict[str, int]]:
    """Return every default (k,), and the place of each name."""
    known = parameters()
    defaults = np.array([p.default for p in known.values()])
    return defaults, {name: i for i, name in enumerate(known)}
