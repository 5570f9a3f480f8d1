"""Diagnosis of published flights of a real quadrotor near the ground (A. X. Appius), its vehicle
file ignorant of the ground.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import ges
from ges.diagnose.report.output import write_diagnosis
from ges.recordings.readers import Options, open_log
from ges.recordings.recording import load_set, write_set
from ges.vehicle.load import load_vehicle

ROOT = Path(__file__).resolve().parents[2]


FLIGHTS = ("HOVERING", "VERTICAL_SPEEDS", "NO_COMPENSATION_V_050", "HIGH_ALTITUDE_V_050")
HELD_OUT = "NO_COMPENSATION_V_050"
FILES = {"diagnosis.json", "report.html", "vehicle.fitted.yaml"}

# Another host: with a scheme anywhere, or without one where a browser takes it for an address.
ADDRESS = re.compile(r"""\w+://[^\s"'<>)]*|(?:=|\()\s*["']?//\w[^\s"'<>)]*""")
# What names an address and asks for nothing: XML's names, and comments as that of a licence.
NAMED_ONLY = re.compile(r"http://www\.w3\.org|/\*!.*?\*/", re.DOTALL)


def _addresses(page: str) -> list[str]:
    """Addresses that a browser may turn to."""
    return ADDRESS.findall(NAMED_ONLY.sub("", page))


@pytest.fixture(scope="module")
def frames(recordings_dir):
    folder, options = recordings_dir / "appius-ground-effect", Options("appius")
    return {name: open_log(folder / f"{name}.csv", options).frame() for name in FLIGHTS}


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("appius")


@pytest.fixture(scope="module")
def diagnosis(frames, vehicle):
    return ges.diagnose(frames, vehicle, holdout=[HELD_OUT])


def test_ground_effect_is_named_with_its_size(diagnosis):
    found = {f.name: f for f in diagnosis.findings}
    assert diagnosis.verdict == "physics" and found["ground_effect"].probability > 0.7
    p = found["ground_effect"].parameters
    low, high = p["c_a"].ci95
    assert 0 < low < high
    gain_at_one_radius = p["c_a"].value * np.exp(-p["decay"].value)
    assert 0.02 < gain_at_one_radius < 0.12
    assert "rotor_plane_offset_m" in p["c_a"].note, (
        "that gain and rotor plane cannot be told apart has to be said"
    )
    half = np.ptp(p["rotor_plane_offset_m"].ci95) / 2
    assert half > 0.05, "nothing in these flights tells the height of the rotor plane"


def test_the_mismatch_is_located_low_over_the_ground(diagnosis):
    first = diagnosis.located[0]
    assert first["channel"] == "force_z" and "height_over_radius" in first["regime"]
    assert first["regime"]["height_over_radius"][0] < 1.5 and first["mean"] > 0


def test_flight_that_took_no_part_gets_better_than_by_recalibration(diagnosis):
    told = diagnosis.fit["channels"]["force_z_N"]
    assert diagnosis.fit["holdout_flights"] == [HELD_OUT]
    assert told["after"] < told["recalibrated"] < told["before"]
    assert told["reduction_ci95"][0] > 0
    rolled = diagnosis.fit["rollout"]["channels"]["p_z_m"]
    assert rolled["after"] < 0.85 * rolled["recalibrated"] < rolled["before"]


@pytest.mark.slow
def test_names_and_order_of_the_flights_do_not_matter(frames, vehicle, diagnosis):
    names = {f"f{i}": frames[name] for i, name in enumerate(reversed(FLIGHTS))}
    again = ges.diagnose(names, vehicle, holdout=[f"f{FLIGHTS[::-1].index(HELD_OUT)}"])
    assert {f.name for f in again.findings} == {f.name for f in diagnosis.findings}
    for f in again.findings:
        old = next(g for g in diagnosis.findings if g.name == f.name)
        assert f.probability == pytest.approx(old.probability, abs=1e-6)


def test_nothing_near_the_ground_is_invented_high_above_it(frames, vehicle):
    high = frames["HIGH_ALTITUDE_V_050"]
    middle = high["t_s"].median()
    parts = {
        "a": high[high["t_s"] < middle],
        "b": high[high["t_s"] >= middle].reset_index(drop=True),
    }
    found = ges.diagnose(parts, vehicle)
    near_ground = {
        "ground_effect",
        "fountain_lift",
        "partial_ground_effect",
        "ground_effect_lag",
        "tether",
        "ceiling_effect",
    }
    assert not near_ground & {f.name for f in found.findings}


@pytest.mark.parametrize(
    "text",
    [
        '<script src="https://host/a.js">',
        "<img src=//host/a.png>",
        "@import url(//host/a.css)",
        "new WebSocket('ws://host')",
        "/*! licence */ fetch('http://host/') /*! licence */",
    ],
)
def test_an_address_is_seen_as_one(text):
    assert _addresses(text)


def test_files_of_the_contract_and_a_vehicle_that_flies(diagnosis, frames, vehicle, tmp_path):
    from click.testing import CliRunner

    from ges.cli import cli

    write_diagnosis(diagnosis, tmp_path / "out")
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert FILES | {"where.png", "located.png", "held_out.png", "rollout.png"} <= names
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert (
        content["schema"] == 1
        and content["findings"]
        and content["fit"]["rollout"]["horizon_s"] == 1.0
    )
    assert not _addresses((tmp_path / "out" / "report.html").read_text())
    flown = CliRunner().invoke(
        cli,
        [
            "simulate",
            str(tmp_path / "out" / "vehicle.fitted.yaml"),
            "--plan",
            "hover",
            "--duration",
            "5",
            "--out",
            str(tmp_path / "flight.parquet"),
        ],
    )
    assert flown.exit_code == 0, flown.output
    fitted = load_vehicle(tmp_path / "out" / "vehicle.fitted.yaml")
    assert fitted.effects["ground_effect"]["c_a"].ci95 is not None
    write_set(tmp_path / "set", vehicle, frames.items())
    assert len(load_set(tmp_path / "set").flights) == len(FLIGHTS)
