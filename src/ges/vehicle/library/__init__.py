"""Vehicles that come with the package, by name: ``crazyflie-2.1``, ``gazebo-x500`` and so on.

One file a vehicle, every number with its source as a comment. A file here is a vehicle file like
any other; a new one needs no further mention.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent


def names() -> list[str]:
    """List the vehicles of the library, sorted by name.

    Examples
    --------
    >>> "crazyflie-2.1" in names()
    True
    """
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def path_of(name: str) -> Path:
    """Locate the file of a vehicle of the library.

    Parameters
    ----------
    name : one of :func:`names`; it is not checked.
    """
    return FOLDER / f"{name}.yaml"


def title(name: str) -> str:
    """Read the first line of a vehicle's file, which says what the vehicle is.

    Parameters
    ----------
    name : one of :func:`names`.
    """
    first, *_ = path_of(name).read_text(encoding="utf-8").splitlines()
    return first.lstrip("# ")
