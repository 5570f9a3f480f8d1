"""``ges diagnose``: a set or logs in, files out; what is wrong with them is a sentence."""

import json
import re

import click
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from ges.commands import diagnose as verb
from ges.diagnose.prepare.split import cut
from ges.diagnose.run import Request, gather_inputs
from ges.diagnose.types.model import from_vehicle
from ges.errors import GesError, UsageError
from ges.files import sha256
from ges.recordings.readers import flight_names
from ges.recordings.recording import write_set
from ges.simulator import flight as sim
from ges.simulator import manoeuvres
from ges.vehicle.file import save_vehicle
from ges.vehicle.load import load_vehicle

COLUMNS = (
    *("t_s", "p_x_m", "p_y_m", "p_z_m", "v_x_m_s", "v_y_m_s", "v_z_m_s"),
    *("attitude_w", "attitude_x", "attitude_y", "attitude_z"),
    *(f"rotor_speed_{i}_rad_s" for i in range(1, 5)),
)
QUATERNIONS = {f"attitude_{a}": f"q_{a}" for a in "wxyz"}


def flown(vehicle, seconds: float, seed: int) -> pd.DataFrame:
    """A recorded flight of a vehicle of the library, with a rotor drag that its file has not."""
    table = manoeuvres.make("straight_runs", seconds)
    numbers = {
        **vehicle.parameters(),
        "seed": seed,
        "altitude_source": 1,
        "mode": "none",
        "inputs_dt_s": manoeuvres.STEP_S,
        "duration_s": (len(table) - 1) * manoeuvres.STEP_S,
        "telemetry_every": 10,
    }
    effects = {**vehicle.effect_values(), "rotor_drag": {"k_kg": 1e-4}}
    (record,) = sim.fly([sim.Flight(numbers, effects, vehicle.ground(), table)], COLUMNS)
    rng = np.random.default_rng(seed)
    noisy = {
        name: values + (rng.normal(0.0, 0.02, len(values)) if name.startswith("v_") else 0.0)
        for name, values in record.columns.items()
    }
    return pd.DataFrame(noisy).rename(columns=QUATERNIONS)


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("hummingbird")


@pytest.fixture(scope="module")
def log(vehicle, tmp_path_factory):
    """One long table in the contract's columns, as a log."""
    path = tmp_path_factory.mktemp("logs") / "long run.parquet"
    flown(vehicle, 24.0, 1).to_parquet(path)
    return path


@pytest.fixture(scope="module")
def result(log, tmp_path_factory):
    """A run from one log on two cores, and where its files are."""
    out = tmp_path_factory.mktemp("run") / "report"
    words = [str(log), "--vehicle", "hummingbird", "--out", str(out)]
    with pytest.MonkeyPatch.context() as told:
        told.setenv("OMP_NUM_THREADS", "2")
        done = CliRunner().invoke(verb.command, words, prog_name="ges diagnose")
    assert done.exception is None, done.output
    return done, out


def test_one_log_becomes_a_page(result):
    done, out = result
    names = {"report.html", "diagnosis.json", "residuals.parquet", "vehicle.fitted.yaml"}
    assert names <= {p.name for p in out.iterdir()}
    content = json.loads((out / "diagnosis.json").read_text())
    assert content["sentence"] in done.stdout
    assert [f["name"] for f in content["findings"]] == ["rotor_drag"]
    assert content["findings"][0]["parameters"]["k_kg"]["value"] == pytest.approx(1e-4, rel=0.1)


def test_steps_and_warnings_stand_once_on_stderr(result):
    done, out = result
    steps = re.findall(r"^(.+): [\d.]+ s$", done.stderr, re.MULTILINE)
    assert steps == [
        "reading long run.parquet",
        "cutting the log into flights",
        "finding when it flies, and where the simulator differs",
        "looking for physics that explains it",
        "flying again what took no part",
        "writing the page",
    ]
    assert done.stderr.count("is the only log, so it was cut into 4 flights") == 1
    assert done.stderr.splitlines()[-1].endswith("report.html")


def test_the_origin_is_the_log(result, log):
    content = json.loads((result[1] / "diagnosis.json").read_text())
    origin, digest = content["origin"], sha256(log)
    assert [f["name"] for f in origin["flights"]] == [f"long run_part{k}" for k in (1, 2, 3, 4)]
    assert {f["sha256"] for f in origin["flights"]} == {digest}
    assert origin["vehicle"]["file"] == "hummingbird.yaml" and origin["vehicle"]["sha256"]
    assert origin["command"].startswith(f"ges diagnose '{log}' --out ")
    assert "--vehicle hummingbird" in origin["command"]


def test_without_a_page_there_are_the_files_for_programs_alone(result, log, tmp_path):
    (tmp_path / "report.html").write_text("of an earlier diagnosis")
    words = [str(log), "--vehicle", "hummingbird", "--out", str(tmp_path), "--no-page"]
    done = CliRunner().invoke(verb.command, words, prog_name="ges diagnose")
    assert done.exception is None, done.output
    assert done.stderr.splitlines()[-1].endswith("diagnosis.json")
    files = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert set(files) == {"diagnosis.json", "residuals.parquet", "vehicle.fitted.yaml"}
    assert files["residuals.parquet"] == (result[1] / "residuals.parquet").read_bytes()


@pytest.mark.slow
def test_the_same_request_gives_the_same_bytes_on_one_core(result, log, monkeypatch):
    out = result[1]
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    words = [str(log), "--vehicle", "hummingbird", "--out", str(out), "--no-open"]
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    done = CliRunner().invoke(verb.command, words, prog_name="ges diagnose")
    assert done.exception is None
    assert {p.name: p.read_bytes() for p in out.iterdir()} == before


def test_parts_are_as_long_in_the_air_as_each_other(vehicle):
    frame = flown(vehicle, 30.0, 2)
    t = frame.t_s.to_numpy()
    # the rotors stand still for the first eight seconds
    on_ground = t < 8.0
    frame.loc[on_ground, [c for c in frame if c.startswith("rotor_speed")]] = 0.0
    frame.loc[on_ground, "p_z_m"] = 0.0
    parts = cut("run", frame, from_vehicle(vehicle))
    assert [name for name, _ in parts] == ["run_part1", "run_part2", "run_part3"]
    assert sum(len(part) for _, part in parts) == len(frame)
    seconds = [np.ptp(part.t_s) for _, part in parts]
    assert seconds[0] == pytest.approx(8.0 + seconds[1], abs=1.5)
    assert seconds[1] == pytest.approx(seconds[2], abs=0.1)


def test_too_little_in_the_air_for_two_parts_is_refused(vehicle):
    frame = flown(vehicle, 10.0, 2)
    with pytest.raises(GesError, match=r"run is 5\.\d s in the air; .* takes 6 s or more"):
        cut("run", frame[frame.t_s < 5.5], from_vehicle(vehicle))


def test_several_logs_are_flights_as_they_are(vehicle, tmp_path):
    for k in (1, 2):
        flown(vehicle, 6.0, k).to_parquet(tmp_path / f"flight{k}.parquet")
    (tmp_path / "empty.parquet").write_bytes((tmp_path / "flight1.parquet").read_bytes())
    flown(vehicle, 6.0, 3)[["t_s", "p_x_m"]].to_parquet(tmp_path / "empty.parquet")
    request = Request(sources=sorted(tmp_path.glob("*.parquet")), vehicle="hummingbird")
    inputs = gather_inputs(request, len)
    assert [f.name for f in inputs.recordings.flights] == ["flight1", "flight2"]
    (warning,) = (w for w in inputs.recordings.warnings if "left out" in w)
    assert warning.startswith("empty was left out: the log says nothing of the drive")
    with pytest.raises(GesError, match="empty.parquet: the log says nothing of the drive"):
        gather_inputs(Request(sources=[tmp_path / "empty.parquet"], vehicle="hummingbird"), len)


def test_a_folder_without_a_vehicle_file_stands_for_its_logs(vehicle, tmp_path):
    for k in (2, 1):
        flown(vehicle, 6.0, k).to_parquet(tmp_path / f"flight{k}.parquet")
    (tmp_path / "LICENSE").write_text("Copyright, all rights reserved\n")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG" + bytes(50))
    (tmp_path / "deeper").mkdir()
    request = Request(sources=[tmp_path], vehicle="hummingbird")
    recordings = gather_inputs(request, len).recordings
    assert [f.name for f in recordings.flights] == ["flight1", "flight2"]
    (left_out,) = (w for w in recordings.warnings if "left out" in w)
    assert left_out.startswith("LICENSE was left out: ")
    with pytest.raises(UsageError, match="give --mass KG and --prop SIZE, or --vehicle"):
        gather_inputs(Request(sources=[tmp_path]), len)
    with pytest.raises(GesError, match="deeper holds no flight log, and no vehicle.yaml"):
        gather_inputs(Request(sources=[tmp_path / "deeper"], vehicle="hummingbird"), len)


def test_a_set_keeps_its_vehicle_unless_another_is_named(vehicle, tmp_path):
    write_set(tmp_path, vehicle, {f"f{k}": flown(vehicle, 6.0, k) for k in (1, 2)}.items())
    inputs = gather_inputs(Request(sources=[tmp_path]), len)
    assert inputs.vehicle_file["file"] == "vehicle.yaml"
    assert inputs.hashes == {f"f{k}": sha256(tmp_path / f"f{k}.parquet") for k in (1, 2)}
    save_vehicle(vehicle.model_copy(update={"name": "another"}), tmp_path / "other.yaml")
    other = gather_inputs(Request(sources=[tmp_path], vehicle=str(tmp_path / "other.yaml")), len)
    assert other.recordings.vehicle.name == "another"
    # the rotors of this one stand in another order
    with pytest.raises(GesError, match="commands and rotor speeds are in another order"):
        gather_inputs(Request(sources=[tmp_path], vehicle="x500"), len)
    with pytest.raises(UsageError, match="mass is said of logs"):
        gather_inputs(Request(sources=[tmp_path], mass_kg=1.0), len)
    with pytest.raises(UsageError, match="format is said of logs"):
        gather_inputs(Request(sources=[tmp_path], kind="px5"), len)


def test_a_log_needs_a_vehicle_or_mass_and_propeller(log):
    with pytest.raises(UsageError, match="give --mass KG and --prop SIZE, or --vehicle"):
        gather_inputs(Request(sources=[log], mass_kg=1.0), len)


@pytest.mark.parametrize("words", [("--wheelbase", "380mm"), ("--arm", "0.19")])
def test_the_wheelbase_of_a_vehicle_made_from_a_log_is_stated(log, words, monkeypatch):
    asked = []
    monkeypatch.setattr("ges.diagnose.run.run", lambda request, *_: asked.append(request) or 1 / 0)
    told = [str(log), "--mass", "0,5", "--prop", "8in", *words, "--out", str(log.parent / "out")]
    CliRunner().invoke(verb.command, told)
    (request,) = asked
    assert request.mass_kg == 0.5 and request.wheelbase_m == pytest.approx(0.38)
    given = []
    monkeypatch.setattr(
        "ges.diagnose.run.describe_log", lambda *_, **said: given.append(said) or 1 / 0
    )
    with pytest.raises(ZeroDivisionError):
        gather_inputs(request, len)
    assert given[0]["wheelbase_m"] == request.wheelbase_m


def test_names_of_flights_are_told_apart_by_folders(tmp_path):
    a, b = tmp_path / "a" / "log.ulg", tmp_path / "b" / "log.ulg"
    assert flight_names([a, b]) == {"a_log": a, "b_log": b}
    with pytest.raises(UsageError, match="flights of the same name"):
        flight_names([a, a])


def test_a_browser_opens_only_at_a_terminal_with_a_display(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    assert not verb.at_a_display()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert verb.at_a_display()
    monkeypatch.setattr("sys.stdout.isatty", lambda: False, raising=False)
    assert not verb.at_a_display()


def test_the_command_line_leaves_out_what_changes_nothing():
    words = ["a b", "c", "--out", "o", "--holdout", "x", "--holdout", "y", "--no-open"]
    context = verb.command.make_context("diagnose", [*words, "--write-flight", "next.csv"])
    with context:
        assert verb.command_line(click.get_current_context()) == (
            "ges diagnose 'a b' c --out o --holdout x --holdout y"
        )
