"""A rule is run again when, and only when, code that it can reach has changed."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from ges.provenance import sources

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "module",
    ["ges.simulator.flight", "ges.study.config", "ges.provenance.runs", "ges.commands.runs"],
)
def test_every_file_that_an_import_runs_is_found(module):
    """Compared with what Python itself loads."""
    look = (
        f"import sys, {module}; print('\\n'.join(m.__file__ for n, m in sys.modules.items() if"
        " n.split('.')[0] == 'ges'))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", look], capture_output=True, text=True, check=True
    ).stdout.split()
    assert {Path(f) for f in loaded} <= set(sources.sources(module))


def test_nothing_of_another_topic():
    names = {f.name for f in sources.sources("ges.simulator.flight")}
    assert "flight.py" in names and "runs.py" not in names


def test_unknown_module_has_no_sources():
    assert importlib.util.find_spec("json") and sources.sources("json") == ()
