"""Whatever a file holds, it is read, or refused in one sentence, in time and memory that a laptop
has. Longer, with other examples each time: GES_FUZZ=30 pytest tests/trust/test_fuzz.py -m slow
"""

from __future__ import annotations

import contextlib
import io
import json
import resource
import signal
import warnings
from collections.abc import Callable
from pathlib import Path

import models
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import test_cut_short
import test_ros
import yaml
from click.testing import CliRunner
from command_line import EXAMPLE
from diagnosis_content import CONTENT
from hypothesis import event, given
from hypothesis import strategies as st
from scipy.io import savemat
from strategies import LEAVES, damaged_bytes, damaged_trees, examples
from writers import motion

import ges
from ges.commands import compare, explain
from ges.conventions import (
    BODY_RATE,
    POSITION,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    command,
    rotor_speed,
)
from ges.diagnose.report.saved import load_diagnosis
from ges.errors import GesError
from ges.recordings.readers import Options, open_log
from ges.recordings.readers.maps import load_map
from ges.recordings.readers.ros import TopicMap
from ges.recordings.recording import load_set, unit_of
from ges.simulator.terrain import Terrain
from ges.study import config
from ges.vehicle.file import vehicle_content
from ges.vehicle.load import load_vehicle

ROOT = Path(__file__).resolve().parents[2]

LONGEST_S, LARGEST_BYTES = 20, 2 << 30


class TooLong(BaseException):
    """More time than anybody waits for a file."""


@contextlib.contextmanager
def within_limits():
    """Twenty seconds of a processor, whatever else runs, and two gigabytes more than there are now;
    what is refused is refused in one line.
    """

    def stop(*_):
        raise TooLong

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = pages * resource.getpagesize() + LARGEST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    previous = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except GesError as error:
        assert "\n" not in str(error).strip(), str(error)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, previous)
        resource.setrlimit(resource.RLIMIT_AS, before)


def read_damaged(path: Path, data: bytes, read: Callable[[Path], object]) -> None:
    """Write a damaged file, and read it within limits."""
    path.write_bytes(data)
    with within_limits():
        read(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


def dumped(tree: object) -> bytes:
    return yaml.safe_dump(tree, allow_unicode=True).encode("utf-8", "surrogatepass")


# Files of YAML.

VEHICLE = yaml.safe_load((EXAMPLE / "vehicle.yaml").read_text()) | {
    "terrain": {"kind": "grid", "file": "ground.npz"},
    "effects": {"rotor_drag": {"k_kg": {"value": 1e-4, "sd": 1e-5, "ci95": [0.0, 2e-4]}}},
    "laws": [{"channel": "force_z", "form": "0.1 (V_x/v_h)^2", "sd": [0.01]}],
    "left_unexplained": {"force_z": 0.1},
}


def read_vehicle(path: Path) -> None:
    vehicle = load_vehicle(path)
    vehicle.parameters(), vehicle.effect_values(), vehicle.hover_speed_rad_s()
    vehicle_content(vehicle), vehicle.ground(path.parent)


@pytest.mark.slow
@examples(1500)
@given(st.one_of(damaged_trees(VEHICLE).map(dumped), damaged_bytes(dumped(VEHICLE))))
def test_vehicle_files(folder, data):
    read_damaged(folder / "vehicle.yaml", data, read_vehicle)


GROUND = io.BytesIO()
np.savez_compressed(GROUND, x_m=np.arange(4.0), y_m=np.arange(3.0), z_m=np.zeros((3, 4)))


@pytest.mark.slow
@examples(1500)
@given(damaged_bytes(GROUND.getvalue()))
def test_height_maps(folder, data):
    read_damaged(folder / "ground.npz", data, Terrain.load)


MODELS = {
    "iris.sdf": models.iris(),
    "cf2x.urdf": models.cf2x(),
    "hummingbird.py": models.HUMMINGBIRD,
    "sih": models.SIH,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_models_of_other_simulators(folder, name):
    path = folder / name

    @examples(400)
    @given(damaged_bytes(MODELS[name].encode()))
    def read(data):
        path.write_bytes(data)
        with within_limits():
            load_vehicle(path)

    read()


MAP = {
    "about": "a logger",
    "separator": ",",
    "decimal": ".",
    "layouts": [
        {
            "columns": {
                "t": {"to": "t_s", "unit": "ms", "factor": 1.0, "offset": 0.0, "missing": -1},
                "z": {"to": "p_z_m", "unit": "cm", "optional": True},
                "m": {"to": "u_1", "factor": 0.01},
            },
            "axes": "ned-frd",
        },
        {"columns": [{"to": "t_s"}, None, {"to": "p_z_m"}]},
    ],
}
TABLE = "t,z,m\n" + "".join(f"{20 * k},{k % 7},{k % 90}\n" for k in range(50))


@pytest.mark.slow
@examples(600)
@given(st.one_of(damaged_trees(MAP).map(dumped), damaged_bytes(dumped(MAP))))
def test_column_maps(folder, data):
    path, table = folder / "map.yaml", folder / "table.csv"
    path.write_bytes(data)
    table.write_text(TABLE)
    with within_limits():
        open_log(table, Options(mapping=str(path))).problem()


TOPICS = {
    "about": "a bag",
    "autopilot": "none",
    "topics": [{"topic": "/imu", "fields": {"a[0].x": {"to": "acc_x_m_s2"}}, "held": True}],
    "definitions": "messages",
}


@pytest.mark.slow
@examples(600)
@given(st.one_of(damaged_trees(TOPICS).map(dumped), damaged_bytes(dumped(TOPICS))))
def test_topic_maps(folder, data):
    read_damaged(folder / "topics.yaml", data, lambda path: load_map(path, TopicMap))


CONFIG = config.read(ROOT / "config/default.yaml")


@pytest.mark.slow
@examples(300)
@given(st.one_of(damaged_trees(CONFIG).map(dumped), damaged_bytes(dumped(CONFIG))))
def test_configurations_of_the_study(folder, data):
    read_damaged(folder / "config.yaml", data, config.load)


# Tables and recording sets.

CELLS = st.one_of(
    st.floats(-10, 10).map(repr),
    LEAVES.map(str),
    st.sampled_from(["", "nan", "-inf", '"', '"a\nb"', "1,5", "0x1p3", "9" * 400]),
)
NAMES = [
    *(*POSITION, *VELOCITY, *QUATERNION, *BODY_RATE, *SPECIFIC_FORCE),
    *(*command(4), *rotor_speed(4)),
    *("battery_V", "range_m", "ground_z_m", "yaw_ref_rad", "u_99", "rotor_speed_0_rad_s"),
]


@pytest.mark.slow
@examples(1500)
@given(
    names=st.lists(st.one_of(st.sampled_from(NAMES), st.text(max_size=9)), max_size=12),
    rows=st.lists(st.lists(CELLS, max_size=13), max_size=12),
    separator=st.sampled_from([",", ";", "\t"]),
    encoding=st.sampled_from(["utf-8", "utf-16", "latin-1"]),
)
def test_tables_of_text(folder, names, rows, separator, encoding):
    lines = [["t_s", *names], *([str(k), *row] for k, row in enumerate(rows))]
    text = "\n".join(separator.join(cells) for cells in lines)
    path = folder / "table.csv"
    path.write_bytes(text.encode(encoding, "replace"))
    with within_limits():
        open_log(path).frame()


def columns(rows: int) -> st.SearchStrategy[pa.Array]:
    """A column of a Parquet file: numbers mostly, else of any type."""
    floats = st.lists(st.one_of(st.floats(), st.none()), min_size=rows, max_size=rows)
    return st.one_of(
        st.floats(-20, 20).map(lambda v: pa.array([v] * rows)),
        floats.map(lambda v: pa.array(v, pa.float64())),
        floats.map(lambda v: pa.array([str(x) for x in v])),
        floats.map(lambda v: pa.array([str(x) for x in v]).dictionary_encode()),
        floats.map(lambda v: pa.array([[x] for x in v])),
        floats.map(lambda v: pa.array([{"a": x} for x in v])),
        st.integers(0, 2**62).map(lambda v: pa.array([v] * rows, pa.timestamp("ns"))),
        st.booleans().map(lambda v: pa.array([v] * rows)),
        st.just(pa.nulls(rows)),
        st.just(pa.array([1] * rows, pa.decimal128(9, 2))),
        st.just(pa.array([7] * rows, pa.uint64())),
    )


@st.composite
def flights(draw: st.DrawFn) -> pa.Table:
    rows = draw(st.integers(0, 40))
    names = draw(st.lists(st.one_of(st.sampled_from(NAMES), st.text(max_size=9)), max_size=20))
    made = {name: draw(columns(rows)) for name in names}
    times = pa.array(np.arange(rows) * draw(st.sampled_from([0.02, 0.0, -1.0, 1e300])))
    made["t_s"] = draw(st.one_of(st.just(times), columns(rows)))
    fields = []
    again = draw(st.lists(st.sampled_from(sorted(made)), max_size=1))
    made = [*made.items(), *((name, made[name]) for name in again)]
    for name, column in made:
        unit = draw(st.sampled_from([None, (unit_of(name) or "m").encode(), b"furlong", b"\xff"]))
        fields.append(pa.field(name, column.type, metadata={"unit": unit} if unit else None))
    return pa.table([column for _, column in made], schema=pa.schema(fields))


@pytest.mark.slow
@examples(800)
@given(st.lists(flights(), min_size=2, max_size=3))
def test_recording_sets(folder, tables):
    home = folder / "set"
    home.mkdir(exist_ok=True)
    for old in home.iterdir():
        old.unlink()
    (home / "vehicle.yaml").write_bytes((EXAMPLE / "vehicle.yaml").read_bytes())
    for k, table in enumerate(tables):
        pq.write_table(table, home / f"f{k}.parquet")
    with within_limits():
        load_set(home)


FLIGHT = (EXAMPLE / "stairs_fast.parquet").read_bytes()


@pytest.mark.slow
@examples(1000)
@given(damaged_bytes(FLIGHT))
def test_damaged_parquet(folder, data):
    read_damaged(folder / "flight.parquet", data, lambda path: open_log(path).frame())


# A diagnosis that was written.


def read_diagnosis(path: Path) -> None:
    for verb, *words in (
        (explain.command, path),
        *((explain.command, path, name) for name in ("rotor_drag", "wind", "battery_sag")),
        (compare.command, path, path, "--html", path.with_suffix(".html")),
    ):
        with contextlib.suppress(GesError):
            CliRunner().invoke(verb, [str(word) for word in words], catch_exceptions=False)
    load_diagnosis(path)


@pytest.mark.slow
@examples(400)
@given(
    st.one_of(
        damaged_trees(CONTENT).map(lambda t: json.dumps(t, default=str).encode()),
        damaged_bytes(json.dumps(CONTENT).encode()),
    )
)
def test_diagnoses_read_back(folder, data):
    read_damaged(folder / "diagnosis.json", data, read_diagnosis)


# Logs of autopilots.


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> dict[str, bytes]:
    """A short log of every format that is one file, by its name."""
    folder, short = tmp_path_factory.mktemp("logs"), {k: v[:100] for k, v in motion().items()}
    for name, write in test_cut_short.WRITTEN.items():
        write(folder / name, short)
    table = test_cut_short._table(short)
    table.to_parquet(folder / "f.parquet")
    savemat(folder / "f.mat", {name: values.to_numpy() for name, values in table.items()})
    store = test_ros._store(False)
    test_ros._bag(folder / "f.bag", test_ros._mavros(store, short, False), store, False)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


FORMATS = ["f.ulg", "log00", "f.bin", "f.bbl", "f.csv", "f.parquet", "f.mat", "f.bag"]


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_damaged_logs(folder, logs, name):
    path = folder / name

    @examples(20 if name == "f.mat" else 200)
    @given(damaged_bytes(logs[name]))
    def read(data):
        path.write_bytes(data)
        with within_limits():
            log = open_log(path)
            if not log.problem():
                log.frame()

    read()


# Flights that may be read, but that nobody would fly.


def flown() -> pd.DataFrame:
    frame = load_set(EXAMPLE).flights[0].frame
    return frame[frame["t_s"] < 10.0]


@st.composite
def odd_flights(draw: st.DrawFn, frame: pd.DataFrame) -> pd.DataFrame:
    """A flight with streams missing, silent, still, torn or drawn by lot."""
    found = frame.iloc[:: draw(st.sampled_from([1, 1, 2, 10]))]
    # less than three seconds in the air are refused, whatever else they hold
    first = draw(st.integers(0, len(found) // 4))
    rows = draw(st.integers(len(found) // 2, len(found)))
    found = found.iloc[first : first + rows].reset_index(drop=True)
    names = [name for name in found if name != "t_s"]
    for name in draw(st.lists(st.sampled_from(names), max_size=4, unique=True)):
        stem = name.split("_")[0]
        some = [n for n in found if n == name or (n.startswith(stem) and draw(st.booleans()))]
        some = [n for n in some if n != "t_s"]
        rows = slice(draw(st.integers(0, len(found))), None)
        what = draw(st.sampled_from(["drop", "silent", "still", "zero", "noise", "scaled", "late"]))
        if what == "drop":
            found = found.drop(columns=some)
        elif what == "silent":
            found.loc[rows, some] = np.nan
        elif what == "still":
            found.loc[rows, some] = found.loc[0, some].to_numpy()
        elif what == "zero":
            found.loc[rows, some] = 0.0
        elif what == "noise":
            noise = np.random.default_rng(draw(st.integers(0, 9))).normal(size=(len(found), 1))
            found[some] = noise * draw(st.sampled_from([1e-12, 1.0, 50.0])) * np.ones(len(some))
        elif what == "scaled":
            found[some] *= draw(st.sampled_from([1e-9, 0.5, -1.0, 3.0]))
        else:
            found[some] = found[some].shift(draw(st.integers(1, 60)))
    return found


@pytest.mark.slow
@examples(12)
@given(st.lists(odd_flights(flown()), min_size=2, max_size=3))
def test_odd_flights_are_diagnosed(folder, frames):
    with within_limits():
        found = ges.diagnose(frames, load_set(EXAMPLE).vehicle)
        json.dumps(found.content(), allow_nan=False)
        event(f"diagnosed: {found.verdict}")


# Requests of a browser that is none of ours.

PATHS = [
    *("/", "/logs", "/example", "/compare", "/static/ui.js", "/static/{}", "/logs/{}", "/{}"),
    *(f"/logs/{{}}/{what}" for what in ("files", "reading", "vehicle", "diagnose")),
    *("/diagnoses/{}", "/diagnoses/{}/events", "/diagnoses/{}/stop", "/diagnoses/{}/report"),
    *("/diagnoses/{}/results.zip", "/diagnoses/{}/results/{}"),
]
WORDS = st.one_of(
    st.text(max_size=30),
    st.sampled_from(["..", "%2e%2e", "<script>", "one.csv", "made", "x500", "'; rm -rf /"]),
    st.sampled_from(["1e999", "-1", "9" * 5000, "nan"]),
)
FIELDS = st.dictionaries(
    st.sampled_from(
        ["log", "source", "vehicle", "mass", "prop", "layout", "holdout", "map", "pwm_low"]
        + ["pwm_high", "rotor_order", "part", "with"]
    ),
    st.one_of(WORDS, st.lists(WORDS, max_size=3)),
    max_size=6,
)


@pytest.mark.slow
@examples(600)
@given(
    method=st.sampled_from(["GET", "POST", "POST", "HEAD", "PUT", "DELETE", "OPTIONS", "X"]),
    place=st.sampled_from(PATHS),
    known=st.booleans(),
    word=WORDS,
    form=FIELDS,
    files=st.lists(st.tuples(WORDS, st.binary(max_size=200)), max_size=3),
    headers=st.dictionaries(
        st.sampled_from(["origin", "host", "content-type", "last-event-id", "range", "cookie"]),
        st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=40),
        max_size=2,
    ),
)
def test_requests(server, method, place, known, word, form, files, headers):
    """None ends in an error of the server, and none writes outside of its folder."""
    from urllib.parse import quote

    client, home, key = server
    place = place.replace("{}", key if known else quote(word), 1).replace("{}", quote(word))
    params = form if method == "GET" else None
    data, sent = (form, [("files", file) for file in files]) if method == "POST" else (None, None)
    # a browser sends what it can encode
    answer = client.request(method, place, params=params, data=data, files=sent, headers=headers)
    assert answer.status_code < 500, answer.text
    assert "<script>" not in answer.text.replace('<script src="/static/ui.js"', "")
    assert {p.name for p in home.parent.iterdir()} == {home.name}


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A browser, the folder of the server, and the id of logs that are there."""
    from starlette.testclient import TestClient

    from ges.ui import app, jobs

    async def ask(words, cwd):
        return jobs.Ended(1, "", "ges: nothing is run here")

    home = tmp_path_factory.mktemp("server") / "home"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(app, "ask", ask)
        patched.setattr(jobs.Jobs, "begin", lambda *_: None)
        made = app.make_app(home, 1)
        with TestClient(
            made, base_url="http://127.0.0.1:8765", raise_server_exceptions=False
        ) as client:
            dropped = client.post("/logs", files=[("files", ("one.csv", b"t_s\n1\n"))])
            yield client, home, dropped.url.path.rsplit("/", 1)[1]
