"""The page on vehicles: its commands run, its file loads."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from ges.vehicle.airframe import LAYOUTS
from ges.vehicle.file import parse_vehicle

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "vehicle.md").read_text()


@pytest.mark.slow
def test_its_commands_run(recordings_dir, tmp_path):
    pytest.importorskip("ges.recordings.readers")
    (tmp_path / "flight.ulg").symlink_to(recordings_dir / "px4-flights" / "battery_brownout.ulg")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL):
        told = subprocess.run(
            ["bash", "-euc", block],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env={**os.environ, "PATH": path},
        )
        assert told.returncode == 0, f"{block}\n{told.stderr}"
    assert yaml.safe_load((tmp_path / "drone.yaml").read_text())["mass_kg"]["value"] == 2.0


def test_its_file_is_a_vehicle_and_its_layouts_are_all():
    (block,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    assert len(parse_vehicle(yaml.safe_load(block)).rotors) == 4
    assert all(f"`{name}`" in PAGE for name in LAYOUTS)
