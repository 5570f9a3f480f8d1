"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, whatever the machine, and nothing kept between runs.
settings.register_profile("same", derandomize=True, database=None, deadline=None, max_examples=25)
settings.load_profile("same")

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def recordings_dir() -> Path:
    """Folder of the published flights: $GES_RECORDINGS, or shared/recordings beside the
    checkout.
    """
    given = os.environ.get("GES_RECORDINGS")
    folder = Path(given) if given else ROOT.parent / "shared" / "recordings"
    if not folder.is_dir():
        pytest.skip(
            "the published recordings are not here; 'ges recordings fetch' gets them,"
            " GES_RECORDINGS names their folder"
        )
    return folder
