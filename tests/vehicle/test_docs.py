"""The page on vehicles: its commands run, its file loads."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from ges.vehicle.file import parse_vehicle
from ges.vehicle.layouts import LAYOUTS

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
    rotor, block = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    vehicle = yaml.safe_load(block)
    assert len(parse_vehicle(vehicle).rotors) == 4
    canted = parse_vehicle({**vehicle, "rotors": [*vehicle["rotors"], *yaml.safe_load(rotor)]})
    assert canted.rotors[4].unit_axis[0] > 0.0
    assert all(f"`{name}`" in PAGE for name in LAYOUTS)
