"""What programs read: residuals.parquet, and diagnosis.json read back."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from diagnosis_content import without_empty

from ges.diagnose.report.residuals import residual_table, write_residuals
from ges.diagnose.report.saved import load_diagnosis
from ges.errors import GesError


def test_a_row_a_window_and_four_columns_a_channel(traces, tmp_path):
    write_residuals(traces, tmp_path / "residuals.parquet")
    table = pq.read_table(tmp_path / "residuals.parquet").to_pandas()
    assert list(table.columns[:5]) == ["flight", "held_out", "used", "t_s", "timeline_s"]
    stages = ("recorded", "given", "recalibrated", "fitted")
    assert list(table.columns[5:9]) == [f"force_x_N/{s}" for s in stages]
    two = table[table.flight == "two"]
    assert two.held_out.all() and np.array_equal(two.t_s, traces[1].t_s)
    error = two["force_x_N/recorded"] - two["force_x_N/fitted"]
    assert error[two.used].to_numpy() == pytest.approx(
        0.1 * np.sin(0.5 * two.t_s[two.used].to_numpy())
    )
    assert error[~two.used].isna().all() and two["force_x_N/recorded"].notna().all()


def test_one_time_axis_over_all_flights_for_viewers_that_have_one(traces):
    table = residual_table(traces).to_pandas()
    step = np.diff(table.timeline_s)
    assert (step > 0).all() and step[len(traces[0].t_s) - 1] == pytest.approx(1.0)


def test_a_channel_that_one_flight_lacks_is_nan_there(traces):
    import dataclasses

    first, second = traces
    fewer = dataclasses.replace(
        second,
        channels=("force_z_N",),
        recorded=second.recorded[:, 1:],
        simulated={s: v[:, 1:] for s, v in second.simulated.items()},
    )
    table = residual_table([first, fewer]).to_pandas()
    assert table[table.flight == "two"]["force_x_N/recorded"].isna().all()
    assert table[table.flight == "two"]["force_z_N/recorded"].notna().all()


def test_no_value_is_null_which_some_viewers_cannot_read(traces):
    assert all(column.null_count == 0 for column in residual_table(traces).columns)


def test_a_diagnosis_is_read_from_its_folder_or_its_file(content, tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(content))
    assert load_diagnosis(tmp_path) == load_diagnosis(path)
    assert without_empty(load_diagnosis(path)) == without_empty(content)


def test_keys_of_other_versions_are_kept_and_missing_ones_are_empty(content, tmp_path):
    content["data"]["of_another_version"] = [1, {"a": None}]
    content["findings"][0]["size"]["of_another_version"] = "x"
    for key in ("calibration", "considered", "laws", "origin"):
        content.pop(key, None)
    del content["findings"][0]["title"]
    (tmp_path / "diagnosis.json").write_text(json.dumps(content))
    read = load_diagnosis(tmp_path)
    assert read["data"]["of_another_version"] == [1, {"a": None}]
    assert read["findings"][0]["size"]["of_another_version"] == "x"
    assert read["calibration"] == {} and read["considered"] == read["laws"] == []
    assert read["findings"][0]["title"] == "" and read["origin"]["vehicle"]["name"] == ""


def test_another_file_than_the_diagnosis_says_which_to_give(tmp_path):
    (tmp_path / "report.html").write_text("<html></html>")
    with pytest.raises(GesError, match="report.html is no diagnosis; give the folder .*json"):
        load_diagnosis(tmp_path / "report.html")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "give the folder that 'ges diagnose --out' wrote"),
        ("{", "is not JSON"),
        ("[]", "is no diagnosis that this version reads"),
        ('{"schema": 2}', "(schema: input should be 1)"),
        ("\xff", "it is not text"),
        ("[" * 100000, "is not JSON"),
    ],
)
def test_what_is_no_diagnosis_is_refused_in_a_sentence(tmp_path, text, sentence):
    if text is not None:
        (tmp_path / "diagnosis.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(GesError) as error:
        load_diagnosis(tmp_path)
    assert sentence in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("findings", 0, "probability"), "high"),
        (("findings", 0, "parameters"), []),
        (("fit", "channels", "force_x_N"), {}),
        (("considered", 0, "decisions"), "none"),
        (("findings", 0, "size", "force_per_speed_N_s_m"), [0]),
        (("located", 0, "regime", "forward_m_s"), "fast"),
        (("data", "reference_scale", "force"), "heavy"),
        (("verdict",), "fine"),
        (("data",), None),
    ],
)
def test_a_part_of_the_wrong_kind_is_named(content, tmp_path, path, value):
    part = content
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    (tmp_path / "diagnosis.json").write_text(json.dumps(content))
    with pytest.raises(GesError, match=str(path[0])):
        load_diagnosis(tmp_path)
