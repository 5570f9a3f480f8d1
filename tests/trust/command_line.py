"""Commands run as a person runs them, and what they left behind."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import resources
from pathlib import Path

GES = Path(sys.executable).parent / "ges"
EXAMPLE = Path(str(resources.files("ges.recordings") / "example"))


def environment(**changes: str | None) -> dict[str, str]:
    """This process's environment with some variables changed, or removed where None; what it finds
    modules by does not depend on the folder.
    """
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    here = {"PYTHONPATH": os.pathsep.join(os.path.abspath(p) for p in paths if p)}
    return {k: v for k, v in {**os.environ, **here, **changes}.items() if v is not None}


def run(*words: object, **options) -> subprocess.CompletedProcess:
    """``ges`` with these words; ``environ`` changes the environment."""
    environ = environment(**options.pop("environ", {}))
    return subprocess.run(
        [GES, *map(str, words)],
        **{"capture_output": True, "text": True, "timeout": 120, "env": environ, **options},
    )


def one_sentence(told: subprocess.CompletedProcess, code: int = 1) -> str:
    """What a command that failed said, without the steps of before."""
    assert told.returncode == code, told.stderr
    assert "Traceback" not in told.stderr
    said = [line for line in told.stderr.splitlines() if line.startswith("ges: ")]
    assert len(said) == 1 and told.stderr.endswith(f"{said[0]}\n"), told.stderr
    return said[0]


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder and of its folders, hidden ones among them."""
    files = (p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}
