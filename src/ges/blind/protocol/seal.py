"""The seal: truths and recordings under one list of hashes that is written before any diagnosis."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ges.errors import GesError
from ges.files import read_kept, sha256, write_json, write_text

SUMS = "SHA256SUMS"
BEGUN, MADE = "begun.json", "made.json"
"""What cases are made by, in ``sealed/``: while that goes on, and afterwards."""


def begin(folder: Path, about: Mapping[str, Any]) -> None:
    """Keep the cases of an interrupted run of the very same makers and seed; clear away others.

    Parameters
    ----------
    folder : of the cases.
    about : makers, grid and seed.
    """
    note = folder / "sealed" / BEGUN
    if read_kept(note, dict) == about:
        return
    for name in ("cases", "sealed"):
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir(parents=True)
    write_json(note, about)


def makers(folder: Path) -> dict[str, Any]:
    """Read what the cases of a folder were made by; empty where that was not kept.

    Parameters
    ----------
    folder : of the cases.
    """
    return read_kept(folder / "sealed" / MADE, dict)


def close(folder: Path) -> None:
    """Write the list of hashes over all of ``sealed/`` and ``cases/``.

    It is the last file to be written, so that a seal is whole.

    Parameters
    ----------
    folder : of the cases; the list is ``sealed/SHA256SUMS``.
    """
    sealed = folder / "sealed"
    files = sorted(
        f
        for part in ("sealed", "cases")
        for f in (folder / part).rglob("*")
        if f.is_file() and f.name != SUMS
    )
    write_text(
        sealed / SUMS,
        "".join(f"{sha256(f)}  {Path(os.path.relpath(f, sealed)).as_posix()}\n" for f in files),
    )


def listed(folder: Path) -> dict[str, str]:
    """Return the hashes that the seal states.

    Returns
    -------
    Hash by file, whose name is relative to ``sealed/``.

    Raises
    ------
    GesError
        When there is no seal, or a line of it cannot be read.
    """
    path = folder / "sealed" / SUMS
    if not path.is_file():
        raise GesError(
            f"'{folder}' has no sealed/{SUMS}; cases must be sealed before they are diagnosed"
        )
    hashes = {}
    for number, line in enumerate(path.read_text().splitlines(), 1):
        # as sha256sum writes it, so that anybody can check the seal
        value, _, name = line.partition("  ")
        if len(value) != 64 or not name:
            raise GesError(f"{path}, line {number}: '{line[:80]}' is not '<sha256>  <file>'")
        hashes[name.removeprefix("./")] = value
    return hashes


def cases(folder: Path) -> list[str]:
    """Return the names of all cases; every one must have a sealed truth.

    Raises
    ------
    GesError
        For a case whose truth was not sealed, or a folder without cases.
    """
    if not (folder / "cases").is_dir():
        raise GesError(f"'{folder}' has no folder cases/; make one with ges blind make")
    # a name with a dot in front is a set that is still being written
    names = sorted(
        p.name for p in (folder / "cases").iterdir() if p.is_dir() and not p.name.startswith(".")
    )
    sums = listed(folder)
    for name in names:
        if f"{name}.json" not in sums:
            raise GesError(
                f"case '{name}' has no truth under sealed/{SUMS}; a case must be sealed before it"
                " is diagnosed"
            )
    if not names:
        raise GesError(f"'{folder}/cases' is empty; there is nothing to diagnose")
    return names


def check(folder: Path, names: list[str]) -> None:
    """Hash the files that the seal lists under these names (relative to ``sealed/``) anew.

    Raises
    ------
    GesError
        For the first file that is missing or has changed.
    """
    sums = listed(folder)
    for name in names:
        path = folder / "sealed" / name
        if not path.is_file():
            raise GesError(f"'{name}' is under the seal of '{folder}' but the file is gone")
        if sha256(path) != sums[name]:
            raise GesError(
                f"'{name}' has changed since '{folder}' was sealed; the scores would prove nothing"
            )


def truth(folder: Path, name: str) -> dict:
    """Return the truth of one case, after checking its hash.

    Raises
    ------
    GesError
        When the file is missing or has changed since it was sealed.
    """
    check(folder, [f"{name}.json"])
    return json.loads((folder / "sealed" / f"{name}.json").read_text())
