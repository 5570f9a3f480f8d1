"""Diagnose every published recording and print the table of docs/real-logs.md.

``python examples/real_logs.py RECORDINGS`` runs the commands of ``real_logs.yaml`` with the
recordings of ``ges recordings fetch``; a row that was run already is kept in ``build/real-logs``.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

ROWS = Path(__file__).with_suffix(".yaml")
WORK = Path(__file__).resolve().parents[1] / "build" / "real-logs"
SAID = "said.txt"
STAGES = ("before", "recalibrated", "after")


def run(name: str, commands: Sequence[str], recordings: Path) -> Path:
    """The folder of a row in which its commands were run, in a shell, until one of them failed."""
    folder = WORK / re.sub(r"\W+", "-", name)
    if (folder / SAID).exists():
        return folder
    # what was interrupted leaves a folder in which the same commands are refused
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "recordings").symlink_to(recordings.resolve())
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for command in commands:
        ended = subprocess.run(
            ["bash", "-o", "pipefail", "-c", command],
            cwd=folder,
            env={**os.environ, "PATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        if ended.returncode:
            break
    (folder / SAID).write_text(ended.stderr)
    return folder


def _finding(f: Mapping[str, Any]) -> str:
    """A name, its place and its probability."""
    place = f" ({f['place']})" if f.get("place") else ""
    return f"{f['name']}{place} {f['probability']:.2f}{' open' if f.get('open') else ''}"


def _errors(channels: Mapping[str, Mapping[str, float]]) -> str:
    """The forces on flights that took no part, as given, recalibrated and with the findings; the
    moments where there are no forces.
    """
    forces = {n: e for n, e in channels.items() if n.startswith("force")}
    told = forces or {n: e for n, e in channels.items() if n.startswith("moment")}
    return "<br>".join(f"{n} " + " / ".join(f"{e[s]:.3g}" for s in STAGES) for n, e in told.items())


def row(name: str, folder: Path) -> str:
    """A line of the table: recording, verdict, names, errors on flights that took no part."""
    path = folder / "out" / "diagnosis.json"
    if not path.exists():
        said = (folder / SAID).read_text().strip().splitlines()
        return f"| {name} | refused | {said[-1].removeprefix('Error: ')} | |"
    content = json.loads(path.read_text())
    found = "<br>".join(map(_finding, content["findings"])) or "-"
    return f"| {name} | {content['verdict']} | {found} | {_errors(content['fit']['channels'])} |"


def main(recordings: Path) -> None:
    """Run what was not run yet, and print the table."""
    print("| recording | verdict | names | unseen flights: as given / recalibrated / with names |")
    print("| --- | --- | --- | --- |")
    for name, commands in yaml.safe_load(ROWS.read_text()).items():
        print(row(name, run(name, commands, recordings)), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
