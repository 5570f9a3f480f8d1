"""Published flights by name, fetched from a pinned commit or copied, and always checked.

Each has a source repository, commit, path and SHA-256. The package itself holds two small sets:
:data:`SHIPPED`.
"""

from __future__ import annotations

import hashlib
import urllib.error
import urllib.request
from collections.abc import Iterator
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

import pydantic
import yaml

from ges.errors import GesError, unknown_name
from ges.files import replacing


class Source(pydantic.BaseModel):
    """One published data set.

    Attributes
    ----------
    repository : owner and name on GitHub.
    commit : commit that the files are of.
    licence, about : for people.
    files : path in the repository and SHA-256, by local path.
    """

    model_config = pydantic.ConfigDict(extra="forbid")

    repository: str
    commit: str
    licence: str
    about: str
    files: dict[str, tuple[str, str]]


TIMEOUT_S = 60.0
SHIPPED = {
    "example": "simulated flights near the ground",
    "crazypad-small": "real flights of a Crazyflie, healthy and with one labelled change; MIT",
}
"""Sets that the package holds, and what they are."""


def sources() -> dict[str, Source]:
    """List every known data set, those that the package holds left out.

    Returns
    -------
    Sources by name.
    """
    content = yaml.safe_load((resources.files("ges.recordings") / "published.yaml").read_text())
    return {name: Source.model_validate(entry) for name, entry in content.items()}


def check(content: bytes, sha256: str, name: str) -> bytes:
    """Check that bytes are those that were published.

    Parameters
    ----------
    content : the bytes.
    sha256 : SHA-256 of those that were published, hexadecimal.
    name : name of the file, for messages.

    Returns
    -------
    ``content``.

    Raises
    ------
    GesError
        When they are not.
    """
    digest = hashlib.sha256(content).hexdigest()
    if digest != sha256:
        raise GesError(
            f"{name} has SHA-256 {digest[:12]}..., published was {sha256[:12]}...; it was changed,"
            " take a fresh copy"
        )
    return content


def _download(source: Source, path: str, timeout_s: float) -> bytes:
    address = f"https://raw.githubusercontent.com/{source.repository}/{source.commit}/{path}"
    try:
        with urllib.request.urlopen(address, timeout=timeout_s) as response:
            return response.read()
    except (urllib.error.URLError, OSError) as error:
        raise GesError(
            f"cannot fetch {source.repository}/{path}: {error}; name a folder with copies by --from"
            " or GES_RECORDINGS"
        ) from None


def _copy(folder: Path, local: str) -> bytes:
    try:
        return (folder / local).read_bytes()
    except OSError as error:
        raise GesError(f"{folder} has no {local}: {error.strerror}") from None


def fetch(
    name: str, out: Path, copies: Path | None, timeout_s: float = TIMEOUT_S
) -> Iterator[Path]:
    """Bring one data set into a folder; a file that is there as published is not fetched again.

    Parameters
    ----------
    name : a key of :func:`sources` or of :data:`SHIPPED`.
    out : folder for the files.
    copies : folder with copies; None to download from the repository.
    timeout_s : time after which a repository that does not answer is given up.

    Yields
    ------
    Path of each file, once it is complete.

    Raises
    ------
    UsageError
        When the name is unknown.
    GesError
        When a file is missing, or is not as published.
    """
    if name in SHIPPED:
        yield from _copy_shipped(resources.files("ges.recordings") / name, out / name)
        return
    known = sources()
    if name not in known:
        raise unknown_name("data set", name, [*known, *SHIPPED])
    source = known[name]
    for local, (path, sha256) in source.files.items():
        target = out / local
        if not target.is_file() or hashlib.sha256(target.read_bytes()).hexdigest() != sha256:
            given = _copy(copies, local) if copies else _download(source, path, timeout_s)
            with replacing(target) as new:
                new.write_bytes(check(given, sha256, local))
        yield target


def _copy_shipped(folder: Traversable, out: Path) -> Iterator[Path]:
    for entry in sorted(folder.iterdir(), key=lambda e: e.name):
        if entry.is_dir():
            yield from _copy_shipped(entry, out / entry.name)
            continue
        with replacing(out / entry.name) as new:
            new.write_bytes(entry.read_bytes())
        yield out / entry.name
