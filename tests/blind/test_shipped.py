"""Real flights that the package ships: complete, honest about their vehicle, sealed and scored."""

from __future__ import annotations

import importlib.util
import json
from importlib import resources
from pathlib import Path

import pandas as pd
import pytest

from ges.blind.foreign.shipped import CHANGES, WORLD, make_and_seal
from ges.blind.protocol import seal
from ges.blind.protocol.run import OUT
from ges.blind.score.shipped import score_changes
from ges.files import sha256, write_json
from ges.recordings.recording import load_set
from ges.vehicle.load import load_vehicle

ROOT = Path(__file__).resolve().parents[2]
FOLDER = resources.files("ges.recordings") / WORLD


@pytest.fixture(scope="module")
def sealed(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("changes")
    make_and_seal(out / "sealed/SHA256SUMS")
    return out


def test_sixteen_flights_with_their_licence():
    assert "MIT License" in (FOLDER / "LICENSE").read_text()
    sets = [load_set(f) for f in FOLDER.iterdir() if f.is_dir()]
    assert sum(len(s.flights) for s in sets) == 16
    # the file of the library, which knows none of these airframes
    assert all(s.vehicle == load_vehicle("crazyflie-2.1") for s in sets)


def test_flights_are_those_that_were_published(recordings_dir, tmp_path):
    """The shipped bytes are what the published logs give."""
    path = ROOT / "examples/make_crazypad_small.py"
    spec = importlib.util.spec_from_file_location("make_crazypad_small", path)
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    maker.FOLDER = tmp_path
    maker.convert(recordings_dir)
    made = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*.parquet"))
    assert len(made) == 16
    for name in made:
        new, shipped = pd.read_parquet(tmp_path / name), pd.read_parquet(FOLDER / name)
        pd.testing.assert_frame_equal(new, shipped, check_exact=True)


def test_nothing_that_is_diagnosed_says_what_was_done(sealed):
    """Names of cases and files are neutral; the vehicle file is the calibrated one."""
    words = {w for c in CHANGES for w in (*c.done.split(), c.flights[0], c.reference[0])}
    for case in (sealed / "cases").iterdir():
        assert sorted(p.name for p in case.iterdir()) == [
            "flight_1.parquet",
            "flight_2.parquet",
            "vehicle.yaml",
        ]
        said = case.name + (case / "vehicle.yaml").read_text().lower()
        assert not {w for w in words if len(w) > 6 and w in said} - {"propeller"}


def test_healthy_flights_serve_once(sealed):
    """The healthy set is calibrated on flights that are not diagnosed."""
    (healthy,) = (c for c in CHANGES if not c.truth.names)
    whole = load_set(FOLDER / healthy.reference[0]).flights
    assert not {f.name for f in whole[healthy.reference[1]]} & {
        f.name for f in whole[healthy.flights[1]]
    }


def _answer(name: str | None, probability: float = 0.97) -> dict:
    findings = [{"name": name, "place": "", "probability": probability}] if name else []
    error = {"before": 3.0, "recalibrated": 2.0, "after": 1.0}
    return {
        "verdict": "physics" if name else "nothing_proven",
        "findings": findings,
        "sentence": "So.",
        "fit": {"channels": {"force_z_N": error}},
    }


def test_score_follows_the_label(sealed, tmp_path):
    """One name for all: right where it is true, wrong where it is not; nothing is never wrong."""
    for name, expected in (("slung_load", "right"), (None, "partly")):
        hashes = {}
        for case in seal.cases(sealed):
            path = sealed / OUT / case / "diagnosis.json"
            write_json(path, _answer(name))
            hashes[case] = sha256(path)
        write_json(tmp_path / "batch.json", hashes)
        tables = [tmp_path / "changes.csv", tmp_path / "errors.csv"]
        score_changes(sealed / "sealed/SHA256SUMS", [tmp_path / "batch.json"], *tables)
        changes, errors = map(pd.read_csv, tables)
        answers = changes.set_index("done")["answer"]
        assert answers["weight on a string"] == expected
        assert answers["propeller 3 cut by 3 mm"] == ("wrong" if name else "partly")
        assert answers["nothing"] == ("wrong" if name else "right")
        assert errors["named"].notna().all() == (name is not None)
    assert json.loads((tmp_path / "batch.json").read_text()) == hashes
