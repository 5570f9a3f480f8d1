"""The application in a folder of its own, and a diagnosis that is there already."""

import copy
import json
import sys

import pytest
from starlette.testclient import TestClient

from ges.ui import jobs
from ges.ui.app import make_app

ADDRESS = "http://127.0.0.1:8765"
LIMIT_MB = 1
FOUND = {
    "schema": 1,
    "verdict": "physics",
    "sentence": "Missing in the simulator: rotor drag.",
    "findings": [],
    "located": [],
    "unexplained": [],
    "fit": {"holdout_flights": ["two"], "channels": {}, "rollout": {"channels": {}}},
    "detectable": {},
    "next_flight": {},
    "data": {"flights": 2, "seconds_used": 40.5},
    "calibration": {},
}


@pytest.fixture
def folder(tmp_path):
    """What the user names."""
    return tmp_path / "flights"


@pytest.fixture
def client(folder):
    """A browser on the same computer."""
    with TestClient(make_app(folder, LIMIT_MB), base_url=ADDRESS) as client:
        yield client


@pytest.fixture
def answer(monkeypatch):
    """What ``ges doctor`` says of any log from now on."""
    found = {"name": "flight.csv", "format": "table", "seconds": 20.0, "usable": True}

    async def ask(words, cwd):
        logs = [{**found, "name": name} for name in words[words.index("--") + 1 :]]
        return jobs.Ended(0, json.dumps(logs), "")

    monkeypatch.setattr("ges.ui.app.ask", ask)
    return found


@pytest.fixture
def ges(monkeypatch):
    """Put a few lines of Python in the place of the command line."""

    def become(code):
        monkeypatch.setattr(jobs, "GES", (sys.executable, "-c", code))

    return become


@pytest.fixture
def dropped(client, answer):
    """Address of two logs and a vehicle file."""
    files = [("files", (name, b"t_s\n1\n")) for name in ("one.csv", "two.csv", "mine.yaml")]
    return client.post("/logs", files=files).url.path


@pytest.fixture
def diagnosed(folder, client):
    """Make diagnoses that are done; their ids."""

    def make(vehicle, sentence=FOUND["sentence"]):
        diagnosis = workspace(folder).new_diagnosis(
            {"logs": "0" * 16, "files": ["one.csv"], "vehicle": vehicle, "state": "done"}
        )
        content = copy.deepcopy(FOUND) | {"sentence": sentence}
        diagnosis.results.mkdir()
        (diagnosis.results / "diagnosis.json").write_text(json.dumps(content))
        (diagnosis.results / "report.html").write_text("<h1>The page</h1>")
        return diagnosis.id

    return make


def workspace(folder):
    from ges.ui.folder import Workspace

    return Workspace(folder)
