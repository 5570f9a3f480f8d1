"""Every figure from small made-up tables: three files, equal bytes twice, what is shown is what was
given.
"""

import itertools
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ges.study import config
from ges.study.figures import closed_loop, diagrams, ground, offline, style

ROOT = Path(__file__).resolve().parents[2]
STUDY = config.load(ROOT / "config/default.yaml", ROOT / "config/tiny.yaml")
SHORT = STUDY.closed_loop.model_copy(update={"duration_s": 2.0})
MODES = list(style.MODE_LABELS)


def files(folder: Path, name: str = "x") -> dict[str, Path]:
    return {
        "data": folder / f"{name}.csv",
        "pdf": folder / f"{name}.pdf",
        "png": folder / f"{name}.png",
    }


def summary(**columns) -> pd.DataFrame:
    """Rows as ges.study.stats.paired.compare makes them, for every combination of the
    given values.
    """
    rows = pd.DataFrame(itertools.product(*columns.values()), columns=list(columns))
    mean = 0.06 + 0.001 * np.arange(len(rows))
    rows = rows.assign(seeds=3, mean=mean, sd=0.004, mean_low=mean - 0.002, mean_high=mean + 0.002)
    rows = rows.assign(difference=mean - 0.061, low=mean - 0.062, high=mean - 0.060, p_holm=0.5)
    reference = rows["condition"].isin(["analytical", "0"]) if "condition" in rows else []
    rows.loc[reference, ["difference", "low", "high"]] = np.nan
    return rows


def table1() -> pd.DataFrame:
    rows = pd.DataFrame(
        itertools.product(
            ["published", "consistent"], ["seedwise", "blockwise"], style.MODEL_LABELS
        ),
        columns=["plan", "split", "model"],
    )
    for name, sign in (("rmse", 1.0), ("mae", 1.0), ("r2", -1.0)):
        value = 0.5 + sign * 0.01 * np.arange(len(rows))
        rows = rows.assign(
            **{name: value, f"{name}_low": value - 0.005, f"{name}_high": value + 0.005}
        )
    return rows


def stored(folder: Path, name: str, table: pd.DataFrame) -> Path:
    table.to_csv(folder / f"{name}.csv", index=False)
    return folder / f"{name}.csv"


def poles() -> pd.DataFrame:
    rows = itertools.product(
        ["none", "oracle"], ["1/sqrt(f)", "1/f"], ["of height", "constant"], [1.0, 1.6]
    )
    table = pd.DataFrame(rows, columns=["mode", "mapping", "factor_is", "factor"])
    return table.assign(real_1_s=-1.0, imaginary_1_s=2.0)


def pulse() -> dict[str, pd.DataFrame]:
    trace = pd.DataFrame(
        {
            "after_s": [0.0, 1.0, 2.0],
            "change_m": [0.0, -0.003, 0.001],
            "low_m": -0.004,
            "high_m": 0.002,
        }
    )
    tests = pd.DataFrame(
        {
            "metric": ["shadow_mae", "clearance_m"],
            "window_s": "0-0.5",
            "difference": 0.1,
            "low": 0,
            "high": 0.2,
        }
    )
    return {"trace": trace, "tests": tests}


def causes() -> pd.DataFrame:
    table = summary(
        metric=["agl_rms_m"],
        reference=["analytical, per rotor", "no ground effect, per rotor"],
        mode=["none", "oracle"],
    )
    return table.assign(condition=table["mode"] + ", per rotor").drop(columns="mode")


CELLS = {
    "slope_exponent": [0.5, 1.0],
    "curvature_factor": [0.5, 1.0],
    "metric": ["agl_rms_m"],
    "condition": MODES,
}
LISTS = {
    "seed_list": ["closed_loop_small", "closed_loop"],
    "metric": ["agl_rms_m", "gyro_rms_rad_s"],
    "condition": MODES,
}
BIASES = {"metric": list(closed_loop.BIAS_METRICS), "condition": ["-0.02", "0", "0.02"]}
WORLDS = {
    "metric": ["agl_rms_m"],
    "form": ["hayden", "exponential"],
    "mapping": ["1/sqrt(f)", "1/f"],
    "condition": MODES,
}
TABLES = {
    "models": (offline.models, {"table1": table1()}, {}),
    "splits": (offline.splits, {"table1": table1()}, {"plan": "published"}),
    "small": (closed_loop.small, {"summary": summary(**LISTS)}, {}),
    "modes": (closed_loop.modes, {"summary": summary(**LISTS)}, {}),
    "bias": (closed_loop.bias, {"summary": summary(**BIASES)}, {}),
    "pulse": (closed_loop.pulse, pulse(), {}),
    "restricted": (
        closed_loop.restricted,
        {"summary": summary(metric=["agl_rms_restricted_m"], condition=MODES)},
        {},
    ),
    "grid": (closed_loop.grid, {"summary": summary(**CELLS)}, {}),
    "poles": (closed_loop.poles, {"poles": poles()}, {}),
    "causes": (closed_loop.causes, {"tests": causes()}, {}),
    "worlds": (closed_loop.worlds, {"summary": summary(**WORLDS)}, {}),
    "pulse_map": (
        closed_loop.pulse_map,
        {
            "summary": pd.DataFrame(
                {"bias": [-0.1, 0.1], "duration_s": 0.1, "touched": [0.0, 1.0], "returned": 1.0}
            )
        },
        {},
    ),
    "system": (diagrams.system, {}, {}),
    "decision": (diagrams.decision, {}, {}),
    "pipeline": (diagrams.pipeline, {}, {}),
    "terrain": (ground.terrain, {}, {"simulator": STUDY.simulator, "seed": 5}),
    "track": (ground.track, {}, {"simulator": STUDY.simulator, "plan": SHORT, "seed": 5}),
    "traces": (closed_loop.traces, {}, {"simulator": STUDY.simulator, "plan": SHORT, "seed": 5}),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_figure_is_the_same_twice_and_shows_rows(name, tmp_path):
    function, tables, parameters = TABLES[name]
    given = {key: stored(tmp_path, key, table) for key, table in tables.items()}
    for attempt in ("first", "second"):
        function(**given, **parameters, **files(tmp_path, attempt))
    for kind in ("csv", "pdf", "png"):
        made = (tmp_path / f"first.{kind}").read_bytes()
        assert made == (tmp_path / f"second.{kind}").read_bytes()
    assert len(pd.read_csv(tmp_path / "first.csv")) > 0


def test_predictions_are_those_of_the_best_model(tmp_path):
    rows = pd.DataFrame({"truth": [1.0, 1.1, 1.2], "predicted": [1.0, 1.11, 1.19]})
    for name, shift in (("analytical", 0.0), ("mlp", 1.0)):
        rows.assign(predicted=rows["predicted"] + shift).to_parquet(
            tmp_path / f"{name}.predictions.parquet"
        )
    table = table1().assign(r2=lambda t: (t["model"] == "analytical").astype(float))
    offline.predicted(
        stored(tmp_path, "table1", table),
        sorted(tmp_path.glob("*.parquet")),
        "published",
        **files(tmp_path),
    )
    assert pd.read_csv(tmp_path / "x.csv")["predicted"].max() == pytest.approx(1.19)


def test_flat_formula_is_the_published_one():
    z, radius = np.array([0.06, 0.1, 0.3]), STUDY.simulator.vehicle.rotor_radius_m
    assert ground.formula(z, STUDY.simulator) == pytest.approx(1 / (1 - (radius / (4 * z)) ** 2))


def _seen(colour: str, matrix: np.ndarray) -> np.ndarray:
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(matrix @ linear, 0, 1)
    return np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)


# Machado, Oliveira and Fernandes 2009, severity 1, linear RGB.
DEUTERANOPIA = np.array(
    [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]
)
PROTANOPIA = np.array(
    [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ]
)


@pytest.mark.parametrize("matrix", [np.eye(3), DEUTERANOPIA, PROTANOPIA])
def test_colours_of_the_modes_differ_for_every_eye(matrix):
    colours = [_seen(c, matrix) for c in style.MODE_COLOURS.values()]
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(colours, 2)) > 0.15
