"""Files that are whole or not there: written under another name, then renamed."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ges.errors import GesError


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a name in the same folder to write to; it becomes ``path`` when the block ends well,
    and goes away if not.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield new
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)


def require_folder(path: Path) -> None:
    """Say that a folder cannot be written into, before the work whose result would be lost; nothing
    is made yet.

    Raises
    ------
    GesError
        When it, or what it would lie in, is a file or may not be written.
    """
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    reason = ""
    if not there.is_dir():
        reason = "it is a file" if there == path else f"{there} is a file"
    elif not os.access(there, os.W_OK):
        reason = "permission denied"
    if reason:
        raise GesError(f"cannot write into the folder {path}: {reason}; name another")


def write_text(path: str | Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with replacing(path) as new:
        new.write_text(text, encoding="utf-8")


def write_json(path: str | Path, content: Any) -> None:
    """Write JSON with sorted keys, so that equal contents are equal bytes."""
    write_text(path, json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n")


def sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def tree_hash(root: Path, files: Iterable[Path]) -> str:
    """Hash over names (relative to ``root``) and contents of files."""
    listing = "".join(
        f"{sha256(file)}  {file.relative_to(root).as_posix()}\n" for file in sorted(files)
    )
    return hashlib.sha256(listing.encode()).hexdigest()
