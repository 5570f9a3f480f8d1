"""Files that are whole or not there: written under another name, then renamed."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
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
    """Make a folder that is to be written into, before the work whose result would be lost.

    Raises
    ------
    GesError
        When it is a file, or nothing can be written there.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        reason = "it is a file" if path.is_file() else error.strerror
        raise GesError(f"cannot write into the folder {path}: {reason}; name another") from None


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
