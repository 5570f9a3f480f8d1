"""Vehicles of other simulators: read into a vehicle file, and written from one.

====================  ======================================================  ===================
kind                  what it is                                              known by
====================  ======================================================  ===================
``sdf``               Gazebo model with a motor model plugin a rotor          root element ``sdf``
``urdf``              gym-pybullet-drones                                     root element ``robot``
``rotorpy``           parameter file of RotorPy (``quad_params``)             ending ``.py``
``sih``               parameters of PX4's simulator in hardware (``SIH_*``)   a line with ``SIH_``
====================  ======================================================  ===================
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ges.errors import GesError, UsageError
from ges.vehicle.datasheet import Datasheet
from ges.vehicle.file import Vehicle
from ges.vehicle.formats import rotorpy, sdf, sih, urdf
from ges.vehicle.formats.neutral import Export
from ges.vehicle.propeller import Propeller

WRITERS: Mapping[str, Callable[[Vehicle], Export]] = {
    "sdf": sdf.write,
    "rotorpy": rotorpy.write,
    "urdf": urdf.write,
    "sih": sih.write,
}
LARGEST_BYTES = 5_000_000


def kind_of(path: Path) -> str | None:
    """Find the format of a model by its content, or by the ending ``.py``.

    Parameters
    ----------
    path : the file.

    Returns
    -------
    ``sdf``, ``urdf``, ``rotorpy`` or ``sih``; None where it is none of these.

    Raises
    ------
    GesError
        When the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            head = file.read(65536)
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror}") from None
    if path.suffix == ".py":
        return "rotorpy"
    # a zero byte: a log or an image, and none of these formats
    if b"\0" in head:
        return None
    if element := re.search(rb"<(sdf|robot)[\s>]", head):
        return {b"sdf": "sdf", b"robot": "urdf"}[element[1]]
    return "sih" if re.search(rb"\bSIH_[A-Z]", head) else None


def read_model(
    path: Path, kind: str, prop: Propeller | None = None, models: Sequence[Path] = ()
) -> Datasheet:
    """Read another simulator's vehicle.

    Parameters
    ----------
    path : the model.
    kind : one of those of :func:`kind_of`.
    prop : propellers, where the file does not say how large they are, or says it wrongly.
    models : folders in which included Gazebo models are looked for, beside the model's own.

    Returns
    -------
    The vehicle with the source of each number.

    Raises
    ------
    GesError
        When it cannot be read or is of no multirotor, in one sentence.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise UsageError(f"{path.name} is larger than {LARGEST_BYTES // 10**6} MB; no model is")
        data = path.read_bytes()
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror}") from None
    if kind == "sdf":
        return sdf.read(data, path, prop, models)
    return {"urdf": urdf.read, "rotorpy": rotorpy.read, "sih": sih.read}[kind](
        data, path.name, prop
    )


def write_model(vehicle: Vehicle, kind: str) -> Export:
    """Write a vehicle as another simulator reads it.

    Parameters
    ----------
    vehicle : the vehicle.
    kind : a key of :data:`WRITERS`.

    Returns
    -------
    The text of the file, and remarks on what it cannot express.

    Raises
    ------
    GesError
        When the format cannot hold this vehicle.
    """
    return WRITERS[kind](vehicle)
