"""Load a vehicle: from a vehicle file, from the library or from a model of another simulator."""

from __future__ import annotations

from pathlib import Path

from ges.errors import unknown_name
from ges.plain_yaml import read_yaml
from ges.vehicle import library
from ges.vehicle.file import Vehicle, parse_vehicle

YAML_ENDINGS = (".yaml", ".yml")


def vehicle_path(source: str | Path) -> Path:
    """Find the file of a vehicle.

    Parameters
    ----------
    source : name of a vehicle in :mod:`ges.vehicle.library`, or path of a vehicle file.

    Returns
    -------
    Path of the file, which need not exist if ``source`` is a path.

    Raises
    ------
    UsageError
        When it is a name that the library does not have; the message has the nearest one.
    """
    path = Path(source)
    if str(source) in library.names():
        return library.path_of(str(source))
    # neither a path nor an ending of a file: a name of the library, misspelt
    if not path.exists() and path.name == str(source) and path.suffix not in YAML_ENDINGS:
        raise unknown_name("vehicle", path.name, library.names())
    return path


def load_vehicle(source: str | Path) -> Vehicle:
    """Read a vehicle.

    Parameters
    ----------
    source : a vehicle file (YAML), a name of :mod:`ges.vehicle.library`, or a model of another
        simulator that :mod:`ges.vehicle.formats` reads.

    Returns
    -------
    The vehicle, checked.

    Raises
    ------
    GesError
        When there is no such vehicle, or its file cannot be read.
    UsageError
        When its content is not possible; the message names the key.

    Examples
    --------
    >>> from ges.vehicle.load import load_vehicle
    >>> vehicle = load_vehicle("hummingbird")
    >>> vehicle.mass_kg
    Quantity(value=0.5, sd=0.02)
    """
    path = vehicle_path(source)
    # what is no YAML may be a model of another simulator, known by its content
    if path.suffix not in YAML_ENDINGS and path.is_file():
        # formats need scipy, whose import takes longer than all else here
        from ges.vehicle import formats

        if kind := formats.kind_of(path):
            return formats.read_model(path, kind).vehicle
    return parse_vehicle(read_yaml(path, "vehicle file"), path.name)
