"""No published recording is left out of the page of them, nor of what makes it."""

from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
ROWS = yaml.safe_load((ROOT / "examples" / "real_logs.yaml").read_text())
PUBLISHED = yaml.safe_load((ROOT / "src" / "ges" / "recordings" / "published.yaml").read_text())
PAGE = (ROOT / "docs" / "real-logs.md").read_text()


@pytest.mark.parametrize("name", sorted(set(PUBLISHED) - {"example"}))
def test_every_published_recording_is_diagnosed(name):
    assert any(f"recordings/{name}/" in line for commands in ROWS.values() for line in commands)


@pytest.mark.parametrize("name", ROWS)
def test_every_diagnosis_has_its_row(name):
    assert sum(line.startswith(f"| {name} | ") for line in PAGE.splitlines()) == 1
    assert all(isinstance(command, str) for command in ROWS[name])


def test_no_row_is_of_nothing():
    table = PAGE.split("| --- | --- | --- | --- |\n")[1].split("\n\n")[0].splitlines()
    assert len(table) == len(ROWS)
