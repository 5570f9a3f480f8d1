"""Rows: windows and targets stay in their block, the same rows for every model, and only flights
that were checked.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ges.errors import GesError
from ges.study import config
from ges.study.datasets.columns import CONTACT, FEATURES, TARGET
from ges.study.datasets.flights import fly_batch, read_flight
from ges.study.datasets.leakage import check_leakage
from ges.study.datasets.rows import RowWindow, load_rows
from ges.study.datasets.split import PARTS, write_split

ROOT = Path(__file__).resolve().parents[2]
STUDY = config.load(ROOT / "config/default.yaml")
SEEDS = STUDY.seeds.model_copy(
    update={
        "train": config.SeedRange(first=1, count=2),
        "validation": config.SeedRange(first=241, count=1),
        "test": config.SeedRange(first=271, count=1),
    }
)
WINDOW = RowWindow(rows=5, step=3, horizon=10, reserve=25)


@pytest.fixture
def data(tmp_path, monkeypatch) -> Path:
    """Four flights of 6 s, both splits and the report of the check, in the working folder."""
    monkeypatch.chdir(tmp_path)
    flights = [Path(f"seed{s:04d}.parquet") for s in SEEDS.data()]
    fly_batch(flights, STUDY.simulator, STUDY.data.plans["consistent"], 6.0, 100.0)
    for kind in ("seedwise", "blockwise"):
        write_split(Path(f"rows.{kind}.csv"), kind, SEEDS, 6.0, 100.0, 1.5, 1)
    check()
    return tmp_path


def check() -> None:
    flights, splits = sorted(Path().glob("seed*.parquet")), sorted(Path().glob("rows.*.csv"))
    check_leakage(flights, splits, Path("report.json"), STUDY.simulator.terrain)


def rows(
    part: str,
    kind: str = "blockwise",
    most: int | None = None,
    past: bool = True,
    window: RowWindow = WINDOW,
):
    return load_rows(Path("report.json"), Path(f"rows.{kind}.csv"), part, window, most, 1, past)


def test_windows_and_targets_stay_in_their_block(data):
    blocks = pd.read_csv("rows.blockwise.csv")
    for part in PARTS:
        found, mine = rows(part), blocks[blocks["part"] == part]
        assert len(found)
        for seed, row in zip(found.seed, found.row, strict=True):
            inside = mine[
                (mine["seed"] == seed)
                & (mine["first_row"] <= row - 12)
                & (mine["last_row"] >= row + 25)
            ]
            assert len(inside) == 1


def test_rows_are_the_flight(data):
    found = rows("test", "seedwise")
    _, flight = read_flight(Path("seed0271.parquet"), (*FEATURES, TARGET, CONTACT))
    table = np.stack([flight[name] for name in FEATURES], axis=1)
    assert np.array_equal(found.y, flight[TARGET][found.row + 10])
    for i, back in enumerate((12, 9, 6, 3, 0)):
        assert np.array_equal(found.x[:, i], table[found.row - back])
    assert not any(flight[CONTACT][r : r + 26].any() for r in found.row)


def test_every_model_and_horizon_has_the_same_rows(data):
    with_past, without = rows("train", most=200), rows("train", most=200, past=False)
    farther = rows("train", most=200, window=RowWindow(rows=5, step=3, horizon=25, reserve=25))
    assert without.x.shape[1:] == (1, len(FEATURES)) and np.array_equal(with_past.now, without.now)
    assert np.array_equal(with_past.row, without.row) and np.array_equal(
        with_past.seed, without.seed
    )
    assert np.array_equal(with_past.row, farther.row) and not np.array_equal(with_past.y, farther.y)
    assert len(with_past) <= 200


def test_a_flight_that_was_not_checked_is_not_read(data):
    shutil.copy("seed0001.parquet", "seed0002.parquet")
    with pytest.raises(
        GesError, match="seed0002.parquet is not the flight that report.json has checked"
    ):
        rows("train", "seedwise")


def test_a_flight_of_another_part_is_found_out(data):
    shutil.copy("seed0001.parquet", "seed0271.parquet")
    with pytest.raises(
        GesError, match="seed0271.parquet is not the flight of its seed: it says seed 1"
    ):
        check()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda blocks: blocks.assign(part="train", seed=blocks["seed"].replace(271, 1)),
            "seed 1 are in two blocks",
        ),
        (
            lambda blocks: blocks.assign(part=blocks["part"].replace("test", "tset")),
            "has a part 'tset'",
        ),
        (
            lambda blocks: pd.concat(
                [blocks.assign(last_row=299), blocks.assign(first_row=300, part="test")]
            ),
            "is in both",
        ),
    ],
)
def test_leaks_in_a_split_are_found_out(data, change, said):
    change(pd.read_csv("rows.seedwise.csv")).to_csv("rows.seedwise.csv", index=False)
    with pytest.raises(GesError, match=said):
        check()


def test_the_report_says_what_was_checked(data):
    report = json.loads(Path("report.json").read_text())
    assert sorted(report["flights"]) == sorted(f"seed{s:04d}.parquet" for s in SEEDS.data())
    assert report["rows.seedwise.csv"]["train"] == {"seeds": 2, "rows": 1202}
