"""Vehicles that come with the package, by name: ``crazyflie-2.1``, ``gazebo-x500`` and so on.

One file a vehicle, every number with its source as a comment. A file here is a vehicle file like
any other; a new one needs no further mention.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent


def names() -> list[str]:
    """Names of the vehicles, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def path_of(name: str) -> Path:
    """File of a vehicle that is in the library."""
    return FOLDER / f"{name}.yaml"


def title(name: str) -> str:
    """First line of what its file says of a vehicle."""
    first, *_ = path_of(name).read_text(encoding="utf-8").splitlines()
    return first.lstrip("# ")
