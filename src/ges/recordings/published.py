"""Published flights by name: source repository, pinned commit, path and SHA-256, fetched or copied,
always checked. The package itself holds one small set, ``example``, simulated.
"""

from __future__ import annotations

import hashlib
import urllib.error
import urllib.request
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import pydantic
import yaml

from ges.errors import GesError, unknown_name
from ges.files import replacing


class Source(pydantic.BaseModel):
    """One published data set: ``files`` maps the local path to (path there, SHA-256)."""

    model_config = pydantic.ConfigDict(extra="forbid")

    repository: str
    commit: str
    licence: str
    about: str
    files: dict[str, tuple[str, str]]


EXAMPLE = "example"


def sources() -> dict[str, Source]:
    """Every known data set by name."""
    content = yaml.safe_load((resources.files("ges.recordings") / "published.yaml").read_text())
    return {name: Source.model_validate(entry) for name, entry in content.items()}


def check(content: bytes, sha256: str, name: str) -> bytes:
    """The same bytes, if they are those that were published."""
    found = hashlib.sha256(content).hexdigest()
    if found != sha256:
        raise GesError(
            f"{name} has SHA-256 {found[:12]}..., published was {sha256[:12]}...; it was changed,"
            " take a fresh copy"
        )
    return content


def _download(source: Source, path: str) -> bytes:
    address = f"https://raw.githubusercontent.com/{source.repository}/{source.commit}/{path}"
    try:
        with urllib.request.urlopen(address, timeout=60) as answer:
            return answer.read()
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


def fetch(name: str, out: Path, copies: Path | None) -> Iterator[Path]:
    """Bring one data set to ``out``, from its repository or from a folder with copies; gives each
    path as it is done.
    """
    if name == EXAMPLE:
        yield from _example(out / EXAMPLE)
        return
    known = sources()
    if name not in known:
        raise unknown_name("data set", name, [*known, EXAMPLE])
    source = known[name]
    for local, (path, sha256) in source.files.items():
        target = out / local
        with replacing(target) as new:
            given = _copy(copies, local) if copies else _download(source, path)
            new.write_bytes(check(given, sha256, local))
        yield target


def _example(out: Path) -> Iterator[Path]:
    for file in (resources.files("ges.recordings") / EXAMPLE).iterdir():
        with replacing(out / file.name) as new:
            new.write_bytes(file.read_bytes())
        yield out / file.name
