"""Verdicts as they are read."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ges.errors import GesError
from ges.files import sha256


def read_verdict(folder: Path) -> dict:
    """Return the content of a case's ``diagnosis.json``.

    Parameters
    ----------
    folder : of the case's verdict.

    Raises
    ------
    GesError
        When there is none or it lacks what the contract demands.
    """
    path = folder / "diagnosis.json"
    try:
        content = json.loads(path.read_text())
        if not isinstance(content, dict) or not {"verdict", "findings"} <= content.keys():
            raise ValueError("verdict or findings are missing")
    except FileNotFoundError:
        raise GesError(f"case '{folder.name}' has no verdict; run ges blind run first") from None
    except ValueError as error:
        raise GesError(f"{path} is not a diagnosis: {error}") from None
    return content


def check_batches(folder: Path, diagnosed: str, verdicts: Sequence[Path]) -> None:
    """Compare verdicts with the hashes that the batches wrote.

    Parameters
    ----------
    folder : of the cases.
    diagnosed : folder of the verdicts in it.
    verdicts : files of hashes, one a batch.

    Raises
    ------
    GesError
        When a verdict is not the one that its batch wrote.
    """
    for path in verdicts:
        for name, digest in json.loads(path.read_text()).items():
            if sha256(folder / diagnosed / name / "diagnosis.json") != digest:
                raise GesError(
                    f"the verdict of case '{name}' is not the one that its batch wrote; run the"
                    " batch again"
                )
