"""Whatever a file holds, it is read, or refused in one sentence, in time and memory that a laptop
has. Longer, with other examples each time: GES_FUZZ=30 pytest tests/trust/test_fuzz.py -m slow
"""

from __future__ import annotations

import contextlib
import json
import resource
import signal
import sys
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from command_line import EXAMPLE
from hypothesis import given
from hypothesis import strategies as st
from strategies import LEAVES, damaged_bytes, damaged_trees, examples

from ges.conventions import (
    BODY_RATE,
    POSITION,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    command,
    rotor_speed,
)
from ges.diagnose.report import compare, explain
from ges.diagnose.report.saved import load_diagnosis
from ges.errors import GesError
from ges.recordings.readers import Options, open_log
from ges.recordings.readers.maps import load_map
from ges.recordings.readers.ros import TopicMap
from ges.recordings.recording import load_set, unit_of
from ges.study import config
from ges.vehicle.file import load_vehicle, vehicle_content

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "tests" / name) for name in ("recordings", "report")]

LONGEST_S, LARGEST_BYTES = 20, 2 << 30


class TooLong(BaseException):
    """More time than anybody waits for a file."""


@contextlib.contextmanager
def within_limits():
    """Twenty seconds and two gigabytes more than there are now; what is refused is refused in one
    line.
    """

    def stop(*_):
        raise TooLong

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = pages * resource.getpagesize() + LARGEST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    previous = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except GesError as error:
        assert "\n" not in str(error).strip(), str(error)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)
        resource.setrlimit(resource.RLIMIT_AS, before)


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
    path = folder / "vehicle.yaml"
    path.write_bytes(data)
    with within_limits():
        read_vehicle(path)


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
    path = folder / "topics.yaml"
    path.write_bytes(data)
    with within_limits():
        load_map(path, TopicMap)


CONFIG = config.read(ROOT / "config/default.yaml")


@pytest.mark.slow
@examples(300)
@given(st.one_of(damaged_trees(CONFIG).map(dumped), damaged_bytes(dumped(CONFIG))))
def test_configurations_of_the_study(folder, data):
    path = folder / "config.yaml"
    path.write_bytes(data)
    with within_limits():
        config.load(path)


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
    path = folder / "flight.parquet"
    path.write_bytes(data)
    with within_limits():
        open_log(path).frame()


# A diagnosis that was written.


def read_diagnosis(path: Path) -> None:
    content = load_diagnosis(path)
    explain.overview(content)
    for name in ("rotor_drag", "wind", "battery_sag"):
        with contextlib.suppress(GesError):
            explain.of_name(content, name)
    both = compare.compare(content, content, ["a", "b"])
    compare.as_text(both)
    compare.write_html(both, path.with_suffix(".html"))


def diagnosis() -> dict:
    from importlib.util import module_from_spec, spec_from_file_location

    spec = spec_from_file_location("report_content", ROOT / "tests/report/conftest.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.CONTENT


@pytest.mark.slow
@examples(400)
@given(
    st.one_of(
        damaged_trees(diagnosis()).map(lambda t: json.dumps(t, default=str).encode()),
        damaged_bytes(json.dumps(diagnosis()).encode()),
    )
)
def test_diagnoses_read_back(folder, data):
    path = folder / "diagnosis.json"
    path.write_bytes(data)
    with within_limits():
        read_diagnosis(path)
