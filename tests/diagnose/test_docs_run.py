"""The commands of the documentation, run as they are written, and the numbers that it promises of
them.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def _commands(page: str) -> list[str]:
    """Shell blocks of a page, in order."""
    return re.findall(r"```sh\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)


def _run(page: str, folder: Path, recordings: Path) -> None:
    (folder / "config").symlink_to(ROOT / "config")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for block in _commands(page):
        told = subprocess.run(
            ["bash", "-euc", block],
            cwd=folder,
            capture_output=True,
            text=True,
            env={**os.environ, "PATH": path, "GES_RECORDINGS": str(recordings)},
        )
        assert told.returncode == 0, f"{block}\n{told.stderr}"


@pytest.mark.slow
def test_the_worked_example_gives_what_it_says(recordings_dir, tmp_path):
    page = "from-log-to-vehicle.md"
    _run(page, tmp_path, recordings_dir)
    told = json.loads((tmp_path / "work" / "diagnosis" / "diagnosis.json").read_text())
    assert {f["name"] for f in told["findings"]} == {"ground_effect", "axial_inflow", "rotor_drag"}
    promised = re.search(
        r"([\d.]+) N as given, ([\d.]+) N recalibrated, ([\d.]+) N with",
        (ROOT / "docs" / page).read_text(),
    )
    measured = [
        told["fit"]["channels"]["force_z_N"][stage] for stage in ("before", "recalibrated", "after")
    ]
    assert [float(v) for v in promised.groups()] == pytest.approx(measured, rel=0.05)
    assert {"moment_x", "drive_1"} <= set(told["data"]["channels_off"])
    assert (tmp_path / "work" / "flight.parquet").stat().st_size > 0


@pytest.mark.slow
def test_what_has_changed_since_gives_what_it_says(recordings_dir, tmp_path):
    _run("diagnosis-on-small-quadrotors.md", tmp_path, recordings_dir)
    told = json.loads((tmp_path / "result" / "diagnosis.json").read_text())
    assert [(f["name"], list(f["parameters"])) for f in told["findings"]] == [
        ("weak_rotor", ["loss_3"])
    ]
