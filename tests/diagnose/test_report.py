"""The files of a diagnosis of simulated flights, and its pictures; what is drawn is read back from
the figures.
"""

import base64
import dataclasses
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from diagnosis_content import without_empty

import ges
from ges.diagnose.report import page as report
from ges.diagnose.report import pictures
from ges.diagnose.report.drawing import Drawing
from ges.diagnose.report.figures import map_figure, traces_of
from ges.diagnose.report.output import write_diagnosis
from ges.diagnose.report.saved import load_diagnosis
from ges.diagnose.types import words
from ges.simulator import manoeuvres
from ges.threads import at_once


@pytest.fixture(scope="module")
def vehicle(sheet):
    return sheet(torque_coefficient_Nm_s2=None)


@pytest.fixture(scope="module")
def flights(flown, vehicle) -> dict:
    table = manoeuvres.make("straight_runs", 20.0)
    return {
        f"run {k} <b>": flown(vehicle, {"rotor_drag": {"k_kg": 4e-5}}, table, k) for k in (1, 2, 3)
    }


@pytest.fixture(scope="module")
def watched(flights, vehicle) -> tuple:
    """A diagnosis, and what was told while it went on."""
    steps = []
    return ges.diagnose(flights, vehicle, watch=lambda *step: steps.append(step)), steps


@pytest.fixture(scope="module")
def content(watched) -> dict:
    return watched[0].content()


def _anonymous(content: dict, held: str) -> str:
    """What was found, without the names of flights."""
    found = {k: v for k, v in content.items() if k != "origin"}
    return json.dumps(found).replace(f'"{held}"', "")


def test_neither_names_nor_order_of_flights_matter(watched, flights, vehicle):
    renamed = {f"{9 - k}": frame for k, frame in enumerate(reversed(flights.values()))}
    (found, _), other = watched, ges.diagnose(renamed, vehicle)
    (held,), (held_too,) = (d.fit["holdout_flights"] for d in (found, other))
    assert renamed[held_too] is flights[held]
    assert _anonymous(other.content(), held_too) == _anonymous(found.content(), held)
    assert other.workings.accepted.result.inclusion == found.workings.accepted.result.inclusion, (
        "to the last digit"
    )


def test_the_map_is_drawn_while_the_search_goes_on_and_once(watched, tmp_path):
    found, ((located, cells), (fitted, names)) = watched
    assert (located, fitted, names) == ("located", "fitted", ("rotor_drag",))
    begun = []

    def begin(work, drawn):
        begun.append([name for name, *_ in drawn])
        return at_once(work, drawn)

    figures = Drawing(begin)
    figures.start(map_figure(cells))
    write_diagnosis(found, tmp_path, drawing=figures)
    assert (
        begun[0] == ["where"]
        and len(begun) == 2
        and "where" not in begun[1]
        and "rollout" in begun[1]
    )
    early = base64.b64encode((tmp_path / "where.png").read_bytes())
    assert early.decode() in (tmp_path / "report.html").read_text()


def test_the_strength_of_the_instruments_is_told_where_references_are_logged(
    content, flown, sheet, with_rates
):
    assert content["data"]["instruments"] == []
    vehicle, table = sheet(torque_coefficient_Nm_s2=None), manoeuvres.make("height_staircase", 15.0)
    told = ges.diagnose(
        [flown(vehicle, {}, table, k, with_rates) for k in (1, 2)], vehicle
    ).content()
    strong = {i["channel"]: i for i in told["data"]["instruments"]}
    assert {"force_z", "moment_x"} <= strong.keys() <= set(told["data"]["channels_used"])
    assert all(
        0.0 <= i["share"] <= 1.0 and i["flights_strong"] <= i["flights"] for i in strong.values()
    )
    assert (
        strong["force_z"]["flights_strong"] == strong["force_z"]["flights"] > 0
    )  # climbs that the references command
    assert "How far the references explain the commands" in report.render(told)


def test_the_flights_carry_a_finding_for_the_report(content):
    assert content["findings"], content["sentence"]
    assert content["fit"]["channels"]


def test_what_it_was_made_from(content, flights):
    rows = {row["name"]: row for row in content["origin"]["flights"]}
    assert list(rows) == sorted(flights) and content["origin"]["version"] == ges.__version__
    (held,) = content["fit"]["holdout_flights"]
    assert [n for n, row in rows.items() if row["part"] == "held_out"] == [held]
    assert sum(row["seconds_used"] for row in rows.values()) == pytest.approx(
        content["data"]["seconds_used"], abs=0.1
    )
    assert all(0.0 < row["seconds_used"] <= row["seconds"] for row in rows.values())


def test_a_drag_has_its_force_per_speed(content, vehicle):
    (finding,) = content["findings"]
    hover_rad_s = vehicle.hover_speed_rad_s()
    k_kg = finding["parameters"]["k_kg"]["value"]
    rate = finding["size"]["force_per_speed_N_s_m"]
    assert rate == pytest.approx(4.0 * hover_rad_s * k_kg, rel=1e-3)
    assert f"({words.number_words(rate, 2)} N per m/s)" in content["sentence"]


def test_signals_have_the_errors_of_the_table(watched):
    found = watched[0]
    traces = traces_of(found)
    assert [t.flight for t in traces] == sorted(t.flight for t in traces) and len(traces) == 3
    (held,) = (t for t in traces if t.held_out)
    assert held.ahead == set(found.fit["rollout"]["channels"])
    for c, name in enumerate(held.channels[: -len(held.ahead)]):
        for stage, values in held.simulated.items():
            error = (held.recorded - values)[held.used, c]
            rms = float(np.sqrt(np.mean(error[np.isfinite(error)] ** 2)))
            assert rms == pytest.approx(found.fit["channels"][name][stage], rel=1e-9), name
    lift_N = held.recorded[held.used, held.channels.index("force_z_N")]
    assert 9.5 < np.median(lift_N) < 11.5, "what carries the weight of 1 kg that leans a little"
    assert np.isnan(held.simulated["after"][~held.used]).all()


def test_what_is_simulated_ahead_starts_anew_every_second(watched):
    (held,) = (t for t in traces_of(watched[0]) if t.held_out)
    c = held.channels.index("p_x_m")
    drift = np.abs(held.recorded - held.simulated["before"])[:, c]
    late = drift[np.isfinite(drift)]
    again = np.count_nonzero(np.diff(late) < -0.02)
    assert 8 < again < 22, "some twenty seconds, a horizon of one second each"
    better = np.abs(held.recorded - held.simulated["after"])[:, c]
    assert np.nanmax(better) < 0.5 * late.max()


def test_the_folder_has_every_file_and_reads_back(watched, tmp_path):
    found = watched[0]
    (tmp_path / "where.png").write_bytes(b"of an earlier diagnosis")
    quiet = dataclasses.replace(found, workings=dataclasses.replace(found.workings, cells=[]))
    write_diagnosis(quiet, tmp_path)
    assert not (tmp_path / "where.png").exists()
    assert without_empty(load_diagnosis(tmp_path)) == without_empty(found.content())
    page = (tmp_path / "report.html").read_text()
    assert found.sentence in page and "uPlot" in page and "run 1 &lt;b&gt;" in page
    table = pq.read_table(tmp_path / "residuals.parquet")
    assert set(table["flight"].to_pylist()) == {"run 1 <b>", "run 2 <b>", "run 3 <b>"}
    assert (tmp_path / "over_time.png").stat().st_size > 1e4


def test_the_picture_over_time_has_a_line_a_stage_and_grey_spans(watched):
    t = traces_of(watched[0])[0]
    from ges.diagnose.prove.traces import Span

    t = dataclasses.replace(t, left_out=(Span(1.0, 2.0, "on_ground"),))
    axes = np.reshape(pictures.over_time(t).axes, (len(t.channels) - len(t.ahead), 2))
    for c, (left, right) in enumerate(axes):
        assert np.array_equal(left.lines[0].get_ydata(), t.recorded[:, c])
        for line, values in zip(left.lines[1:], t.simulated.values(), strict=True):
            assert np.array_equal(line.get_ydata(), values[:, c], equal_nan=True)
        assert len(right.lines) == 1 + len(t.simulated)
        assert left.patches[0].get_extents().width > 0.0


def test_drawn_the_same_every_time(content):
    figures = [("held_out", "held_out_bars", (content["fit"]["channels"],))]
    first, again = (Drawing().pictures(figures)["held_out"] for _ in range(2))
    assert first == again and first["png"][1:4] == b"PNG" and first["pdf"][1:4] == b"PDF"


def test_bars_have_the_lengths_and_whiskers_of_the_table(content):
    channels = content["fit"]["channels"]
    axis = pictures.held_out_bars(channels).axes[0]
    for bars, stage in zip(
        axis.containers[:2] + axis.containers[3:], ("before", "recalibrated", "after"), strict=False
    ):
        if hasattr(bars, "patches"):
            assert [b.get_width() for b in bars] == pytest.approx(
                [c[stage] / c["before"] for c in channels.values()]
            )
    whiskers = next(c for c in axis.containers if hasattr(c, "has_xerr")).lines[2][0].get_segments()
    for segment, c in zip(whiskers, channels.values(), strict=True):
        ends = [(1.0 - r) * c["recalibrated"] / c["before"] for r in reversed(c["reduction_ci95"])]
        value = c["after"] / c["before"]
        assert segment[:, 0] == pytest.approx([min(ends[0], value), max(ends[1], value)], abs=1e-9)


@dataclasses.dataclass
class _Cell:
    channel: str
    regime: str
    low: float
    high: float
    mean: float
    sd: float
    q_value: float


def test_map_shows_score_and_significance_where_they_belong():
    rng = np.random.default_rng(0)
    bounds = np.array([0.2, 0.5, 1.0, 3.0])
    cells = [
        dataclasses.asdict(_Cell(c, "height_over_radius", low, high, rng.normal(), 0.3, q))
        for c in ("force_z", "moment_x")
        for low, high, q in zip(bounds[:-1], bounds[1:], (0.9, 0.01, 0.2), strict=True)
    ]
    axis = pictures.location_map(cells).axes[0]
    expected = np.array([c["mean"] / c["sd"] for c in cells]).reshape(2, 3)
    assert np.allclose(axis.images[0].get_array(), expected)
    assert sorted(tuple(float(v) for v in line.get_xydata()[0]) for line in axis.lines) == [
        (1.0, 0.0),
        (1.0, 1.0),
    ]
    assert [t.get_text() for t in axis.get_yticklabels()] == [
        "force along thrust",
        "moment in roll",
    ]


def test_bins_give_means_and_intervals_that_count_blocks():
    rng = np.random.default_rng(1)
    covered = []
    for _ in range(200):
        blocks = np.repeat(np.arange(12), 25)
        x, y = rng.uniform(0, 1, 300), np.repeat(rng.normal(0, 1, 12), 25) + rng.normal(0, 0.1, 300)
        center, mean, half = pictures.bin_means(x, y, blocks, np.array([0.0, 0.5, 1.0]))
        assert mean[0] == pytest.approx(y[x < 0.5].mean()) and center[1] == pytest.approx(
            x[x >= 0.5].mean()
        )
        covered.append(abs(mean[0]) < half[0])
    assert 0.90 < np.mean(covered) < 0.99


def test_curves_of_both_models_are_drawn_over_the_recorded_bins():
    rng = np.random.default_rng(2)
    x = rng.uniform(0.5, 4.0, 600)
    truth = 0.5 / x**2
    figure = pictures.residual_against(
        x,
        truth + rng.normal(0, 0.02, 600),
        {"recalibrated": 0 * x, "after": truth},
        np.arange(600) // 40,
        "height over rotor radius",
        "force, N",
    )
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    after = lines[words.stage_words("after")]
    edges = np.quantile(x, np.linspace(0, 1, pictures.BINS + 1))
    inside = x <= edges[1]
    assert after.get_ydata()[0] == pytest.approx(truth[inside].mean(), rel=1e-6)
    assert np.all(lines[words.stage_words("recalibrated")].get_ydata() == 0.0)


@pytest.mark.filterwarnings("error")
def test_bins_of_a_single_block_have_means_and_no_interval():
    x, y = np.linspace(0.5, 4.0, 60), np.linspace(-1.0, 2.0, 60)
    block = np.zeros(60, dtype=int)
    axis = pictures.residual_against(x, y, {"after": y}, block, "x", "y").axes[0]
    low, high = axis.get_ylim()
    assert low <= y[:5].mean() and high >= y[-5:].mean()


def test_rollout_lines_are_rms_over_the_starts():
    rng, t = np.random.default_rng(3), np.linspace(0.1, 1.0, 10)
    e = {
        stage: rng.normal(0, size, (30, 10)) * t
        for stage, size in (("before", 0.2), ("recalibrated", 0.1), ("after", 0.05))
    }
    axis = pictures.rollout_growth(t, {"p_z_m": e}).axes[0]
    for line, stage in zip(axis.lines, e, strict=True):
        assert line.get_ydata() == pytest.approx(np.sqrt((e[stage] ** 2).mean(axis=0)))
    assert axis.get_title() == "height"


def test_interval_plot_shows_value_interval_and_prior_sd():
    rows = [
        {
            "label": "mass_kg",
            "value": 1.1,
            "ci95": [1.05, 1.15],
            "unit": "kg",
            "nominal": 1.0,
            "prior_sd": 0.02,
        }
    ]
    figure = pictures.parameter_intervals(rows)
    axis = figure.axes[0]
    bar = next(line for line in axis.lines if line.get_linewidth() == 3.0)
    assert list(bar.get_xdata()) == pytest.approx([1.05 / 1.15, 1.0]), (
        "on a scale from zero to the end of the interval"
    )
    band = axis.collections[0].get_paths()[0].get_extents()
    assert [band.x0, band.x1] == pytest.approx([0.96 / 1.15, 1.04 / 1.15])
    assert (
        axis.texts[0].get_text() == "mass_kg = 1.10 kg  (95 %: 1.05 to 1.15; nominal: 1.00 ± 0.040)"
    )
    told = {t.get_text() for t in figure.legends[0].get_texts()}
    assert told == {"fitted", "95 % interval", "nominal, with two prior sds", "zero"}
    assert len(pictures.parameter_intervals(rows * 30).axes[0].texts) == pictures.MOST_PARAMETERS, (
        "one page"
    )


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (0.0, "0"),
        (1234.5, "1234"),
        (0.01234, "0.0123"),
        (-2.0, "−2.00"),
        (1.05e-5, "1.05·10⁻⁵"),
        (None, "not known"),
        (float("nan"), "not known"),
    ],
)
def test_numbers_in_words(value, told):
    assert words.number_words(value) == told
