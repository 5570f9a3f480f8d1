"""Fixtures shared by all tests."""

import fcntl
import os
import subprocess
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, whatever the machine, and nothing kept between runs.
settings.register_profile("same", derandomize=True, database=None, deadline=None, max_examples=25)
settings.load_profile("same")

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def sanitized(tmp_path_factory) -> Path:
    """A build of the simulator that ends at the first bad address or undefined operation, once
    for all processes of a run.
    """
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    build = folder / "sanitized"
    flags = "-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all"
    make = ["make", "-s", "-j2", "-C", ROOT / "sim_c", f"BUILD={build}", "OPT=-O1"]
    with (folder / "sanitized.lock").open("w") as alone:
        fcntl.flock(alone, fcntl.LOCK_EX)
        compiled = subprocess.run([*make, f"SANITIZE={flags}"], capture_output=True, text=True)
    if "cannot find -lasan" in compiled.stderr or "libasan" in compiled.stderr:
        pytest.skip("the compiler has no sanitizer libraries")
    assert compiled.returncode == 0, compiled.stderr
    return build


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
