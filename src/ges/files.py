"""Files that are complete or absent: written under a temporary name, then renamed."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
import unicodedata
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ges.errors import GesError, UsageError

if TYPE_CHECKING:
    import pandas as pd


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Write to a temporary file that replaces another one when the block succeeds.

    Parameters
    ----------
    path : file to replace; its folder is made where it is missing.

    Yields
    ------
    Path of the temporary file, in the same folder. It is removed if the block fails.

    Raises
    ------
    OSError
        Where the folder or the file cannot be written.
    """
    path = Path(path)
    new = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield new
        os.replace(new, path)
    except OSError as error:
        # a full disk names no file, and nobody knows the other name
        if error.errno is None or error.filename not in (None, new, str(new)):
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
    finally:
        # where even the folder could not be made, there is nothing to remove
        with contextlib.suppress(NotADirectoryError):
            new.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing_together(folder: Path, last: str) -> Iterator[Path]:
    """Write files into a folder, all of them or none.

    They come to their place together when the block ends well. Of two processes that write into one
    folder, one waits.

    Parameters
    ----------
    folder : made where it is missing, and removed again where nothing came to be in it.
    last : the file without which the others count for nothing: it goes first and comes last.

    Yields
    ------
    The folder to write the files to.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    new, lock = folder / NEW, os.open(folder, os.O_RDONLY)
    try:
        # some file systems know no locks
        with contextlib.suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        # what is there is of a process that was killed
        shutil.rmtree(new, ignore_errors=True)
        # with the folder, which another one that ended without files may have taken away
        new.mkdir(parents=True)
        yield new
        (folder / last).unlink(missing_ok=True)
        for file in sorted(new.iterdir(), key=lambda file: file.name == last):
            os.replace(file, folder / file.name)
    finally:
        shutil.rmtree(new, ignore_errors=True)
        with contextlib.suppress(OSError):
            if made:
                folder.rmdir()
        os.close(lock)


Kind = TypeVar("Kind", dict, list)
NEW = ".new"
"""Folder of what :func:`replacing_together` has not brought to its place yet."""


def require_file(path: Path) -> None:
    """Say that a file cannot be written, before the work whose result would be lost.

    Raises
    ------
    GesError
        When it is a folder, or its folder cannot be written into.
    """
    if path.is_dir():
        raise GesError(f"cannot write the file {path}: it is a folder; name a file in it")
    require_folder(path.parent)


def require_folder(path: Path) -> None:
    """Check that a folder can be written into, without making it or leaving a file.

    It is called before long work, whose result would otherwise be lost.

    Parameters
    ----------
    path : the folder, which need not exist yet.

    Raises
    ------
    GesError
        When the folder, or its nearest existing parent, is a file or takes no file.
    """
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    reason = ""
    if not there.is_dir():
        reason = "it is a file" if there == path else f"{there} is a file"
    else:
        # tried: some file systems refuse what their permissions allow
        try:
            with tempfile.TemporaryFile(dir=there):
                pass
        except OSError as error:
            reason = f"{os.strerror(error.errno or errno.EIO)} in {there}"
    if reason:
        raise GesError(f"cannot write into the folder {path}: {reason}; name another")


def require_text(name: str) -> None:
    """Refuse a name that no page, terminal or Parquet file can hold as it is.

    Raises
    ------
    UsageError
        When it has control characters, or bytes that are not UTF-8.
    """
    if any(unicodedata.category(letter) in ("Cc", "Cs") for letter in name):
        raise UsageError(
            f"the name {name!r} holds control characters or is not UTF-8; rename the file or folder"
        )


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, complete or not at all.

    Parameters
    ----------
    path : file to replace; its folder is made where it is missing.
    text : content.
    """
    with replacing(path) as new:
        new.write_text(text, encoding="utf-8")


def write_csv(path: str | Path, table: pd.DataFrame, digits: int | None = None) -> None:
    """Write a table without its index, complete or not at all.

    Parameters
    ----------
    path : file to replace; its folder is made where it is missing.
    table : content.
    digits : significant digits of its numbers; all bits without.
    """
    with replacing(path) as new:
        table.to_csv(new, index=False, float_format=f"%.{digits}g" if digits else None)


def write_json(path: str | Path, content: Any) -> None:
    """Write JSON with sorted keys, so that equal contents give equal bytes.

    Parameters
    ----------
    path : file to replace; its folder is made where it is missing.
    content : what :mod:`json` can write.

    Raises
    ------
    ValueError
        Where a number is not finite, which JSON cannot write.
    """
    write_text(path, json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n")


def read_kept(path: Path, kind: type[Kind]) -> Kind:
    """Read JSON that this program kept for later, as :func:`write_json` wrote it.

    Parameters
    ----------
    path : the file.
    kind : ``dict`` or ``list``.

    Returns
    -------
    Its content; an empty one where there is no such file, or a damaged one: what it held is worked
    out again.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError, RecursionError):
        return kind()
    return content if isinstance(content, kind) else kind()


def sha256(path: str | Path) -> str:
    """Hash the bytes of a file.

    Parameters
    ----------
    path : the file.

    Returns
    -------
    SHA-256, 64 hexadecimal digits.
    """
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def tree_hash(root: Path, files: Iterable[Path]) -> str:
    """Hash the names and contents of several files.

    Parameters
    ----------
    root : folder that names are relative to.
    files : files below ``root``, in any order.

    Returns
    -------
    SHA-256, 64 hexadecimal digits, of a listing as ``sha256sum`` prints it.
    """
    listing = "".join(
        f"{sha256(file)}  {file.relative_to(root).as_posix()}\n" for file in sorted(files)
    )
    return hashlib.sha256(listing.encode()).hexdigest()
