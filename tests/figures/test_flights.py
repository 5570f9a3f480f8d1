"""Real flights: what is fitted comes back from made-up blocks, changed bytes are refused, absence
is said in words.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ges.errors import GesError
from ges.study import config
from ges.study.figures import flights, real
from ges.vehicle.load import load_vehicle

ROOT = Path(__file__).resolve().parents[2]
VEHICLE = "appius"
MAPPING = ROOT / "src/ges/recordings/readers/presets/appius.yaml"
STUDY = config.load(ROOT / "config/default.yaml")


def made_up_blocks(path: Path, form: str, **constants: float) -> Path:
    """Two flights with different scales through a known form, with noise of half a percent."""
    z, rng = np.geomspace(0.75, 18.0, 60), np.random.default_rng(3)
    row = pd.Series({"offset_m": 0.03, "c_a": np.nan, "decay": np.nan, **constants})
    factor = flights.form_curve(form, row, z, load_vehicle(VEHICLE))
    table = pd.DataFrame(
        {
            "flight": np.where(np.arange(60) % 2, "A", "B"),
            "block": range(60),
            "t_s": 0.0,
            "z_over_r": z,
        }
    )
    table["ratio"] = (
        factor * np.where(table["flight"] == "A", 0.85, 0.9) * (1 + 0.005 * rng.standard_normal(60))
    )
    table.assign(factor=table["ratio"]).to_csv(path, index=False)
    return path


def test_the_form_that_made_the_blocks_is_found(tmp_path):
    blocks = made_up_blocks(tmp_path / "b.csv", "hayden")
    flights.fit_forms(blocks, VEHICLE, tmp_path / "f.csv")
    fitted = pd.read_csv(tmp_path / "f.csv").set_index("form")
    assert fitted["aicc"].drop("exponential").idxmin() == "hayden"
    assert fitted.loc["hayden", "offset_low_m"] < 0.03 < fitted.loc["hayden", "offset_high_m"]
    assert fitted.loc["hayden", "rmse"] < 0.007


def test_constants_of_the_exponential_form_come_back(tmp_path):
    blocks = made_up_blocks(tmp_path / "b.csv", "exponential", c_a=0.3, decay=0.9)
    flights.fit_forms(blocks, VEHICLE, tmp_path / "f.csv")
    fitted = pd.read_csv(tmp_path / "f.csv").set_index("form").loc["exponential"]
    assert fitted["rank"] == 1 and fitted["decay"] == pytest.approx(0.9, rel=0.15)
    assert flights.form_curve(
        "exponential", fitted, np.array([1.0]), load_vehicle(VEHICLE)
    ) == pytest.approx(1 + 0.3 * np.exp(-0.9 * (1 + 0.03 / 0.12)), abs=0.01)


def test_without_recordings_tables_have_headings_and_figures_say_so(tmp_path):
    flights.thrust_blocks([], VEHICLE, MAPPING, tmp_path / "b.csv")
    flights.fit_forms(tmp_path / "b.csv", VEHICLE, tmp_path / "f.csv")
    flights.hover_dispersion(
        [], VEHICLE, MAPPING, STUDY.simulator, STUDY.closed_loop, 1, tmp_path / "s.csv"
    )
    three = {"data": tmp_path / "x.csv", "pdf": tmp_path / "x.pdf", "png": tmp_path / "x.png"}
    real.thrust(tmp_path / "b.csv", tmp_path / "f.csv", VEHICLE, **three)
    assert (
        pd.read_csv(tmp_path / "b.csv").empty
        and pd.read_csv(tmp_path / "f.csv").empty
        and pd.read_csv(three["data"]).empty
    )
    real.dispersion(tmp_path / "s.csv", **three)
    assert (
        set(pd.read_csv(tmp_path / "s.csv")["source"]) == {"simulated"}
        and pd.read_csv(three["data"]).empty
    )


def test_changed_recording_is_refused(tmp_path, recordings_dir):
    given = (recordings_dir / "appius-ground-effect/HOVERING.csv").read_bytes()
    copy = tmp_path / "appius-ground-effect/HOVERING.csv"
    copy.parent.mkdir()
    copy.write_bytes(given.replace(b"1", b"2", 1))
    with pytest.raises(GesError, match="it was changed"):
        flights.thrust_blocks([copy], VEHICLE, MAPPING, tmp_path / "b.csv")


def test_real_hover_shows_ground_effect(tmp_path, recordings_dir):
    path = recordings_dir / "appius-ground-effect/HOVERING.csv"
    flights.thrust_blocks([path], VEHICLE, MAPPING, tmp_path / "b.csv")
    shown = real.binned(pd.read_csv(tmp_path / "b.csv"))
    lowest, highest = shown.iloc[0], shown.iloc[-1]
    assert lowest["low"] > 1.04 and highest["low"] < 1.0 < highest["high"]
