"""What the tests of the closed-loop experiments share."""

from pathlib import Path

import pytest

from ges.study import config


@pytest.fixture(scope="session")
def root() -> Path:
    return Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def tiny(root):
    """The study in its tiny version."""
    return config.load(root / "config/default.yaml", root / "config/tiny.yaml")
