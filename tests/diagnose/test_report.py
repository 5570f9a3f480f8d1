"""The report and its pictures, made from a diagnosis of simulated flights; what is drawn is read
back from the figures.
"""

import base64
import dataclasses
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

import ges
from ges.diagnose.report import page as report
from ges.diagnose.report import pictures, verdict
from ges.diagnose.report.drawing import Drawing
from ges.diagnose.report.output import map_figure, write_diagnosis
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


@pytest.fixture(scope="module")
def page(content) -> str:
    shown = {"held_out": pictures.png(pictures.held_out_bars(content["fit"]["channels"]))}
    return report.render(content, shown)


def test_neither_names_nor_order_of_flights_matter(watched, flights, vehicle):
    renamed = {f"{9 - k}": frame for k, frame in enumerate(reversed(flights.values()))}
    (found, _), other = watched, ges.diagnose(renamed, vehicle)
    (held,), (held_too,) = (d.fit["holdout_flights"] for d in (found, other))
    assert renamed[held_too] is flights[held]
    assert json.dumps(other.content()).replace(f'"{held_too}"', "") == json.dumps(
        found.content()
    ).replace(f'"{held}"', "")
    assert other.workings.accepted.found.inclusion == found.workings.accepted.found.inclusion, (
        "to the last digit"
    )


def test_the_map_is_drawn_while_the_search_goes_on_and_once(watched, tmp_path):
    found, ((located, cells), (fitted, names)) = watched
    assert (located, fitted, names) == ("located", "fitted", ("rotor_drag",))
    begun = []

    def begin(work, drawn):
        begun.append([name for name, *_ in drawn])
        return at_once(work, drawn)

    figures = Drawing(tmp_path, begin)
    figures.start(map_figure(cells))
    early = (tmp_path / "where.png").read_bytes()
    write_diagnosis(found, tmp_path, drawing=figures)
    assert (
        begun[0] == ["where"]
        and len(begun) == 2
        and "where" not in begun[1]
        and "rollout" in begun[1]
    )
    assert base64.b64encode(early).decode() in (tmp_path / "report.html").read_text()
    write_diagnosis(found, tmp_path / "alone")
    assert {p.name for p in tmp_path.iterdir()} - {"alone"} == {
        p.name for p in (tmp_path / "alone").iterdir()
    }


class _Balanced(HTMLParser):
    VOID = {"meta", "img", "br"}

    def __init__(self):
        super().__init__()
        self.open, self.sources, self.text, self.headings = [], [], [], []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text.append(data)
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def _parsed(page: str) -> tuple[str, _Balanced]:
    parser = _Balanced()
    parser.feed(page)
    assert parser.open == []
    return re.sub(r" +([:;,.])", r"\1", " ".join(" ".join(parser.text).split())), parser


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
    assert "What the references vouch for" in _parsed(report.render(told, {}))[0]


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (0.995, "hardly show it"),
        (0.6, "1.50 N as given, 1.00 recalibrated and 0.600 with it"),
        (1.3, "no error falls by 2 %, and that"),
    ],
)
def test_the_sentence_says_what_flights_that_took_no_part_show(after, said):
    fit = {"channels": {"force_z_N": {"before": 1.5, "recalibrated": 1.0, "after": after}}}
    assert said in verdict.sentence_of("physics", (), (), (), fit, {}, ())


def test_the_sentence_says_what_each_of_the_open_names_does():
    table = {"force_z_N": {"before": 1.5, "recalibrated": 1.0, "after": 0.6}}
    fit = {
        "channels": table,
        "alternatives": {"ground_effect": {"force_z_N": 0.6}, "fountain_lift": {"force_z_N": 0.9}},
    }
    said = verdict.sentence_of("ambiguous", (), (), (), fit, {}, ())
    assert (
        "1.50 N as given, 1.00 recalibrated, 0.600 with ground_effect and 0.900 with fountain_lift."
        in said
    )


def test_what_stays_unknown_is_told_with_its_place():
    left = {"channel": "acc_z", "regime": {"battery_V": [7.92, 8.09]}}
    said = verdict.sentence_of("unknown", (), (), [left], {}, {}, ())
    assert said.startswith(
        "The simulator is wrong first in the accelerometer along thrust at battery voltage 7.9 to"
        " 8.1 V. No"
    )


def test_the_flights_carry_a_finding_for_the_report(content):
    assert content["findings"], content["sentence"]
    assert content["fit"]["channels"]


def test_page_is_whole_and_needs_no_network(page):
    _, parser = _parsed(page)
    assert parser.sources and all(s.startswith("data:image/png;base64,") for s in parser.sources)
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", page) and "<script" not in page


def test_sentence_comes_first_then_where_what_how_sure_and_the_limits(page, content):
    text, parser = _parsed(page)
    assert parser.headings == [
        "Where",
        "What, and how much",
        "How sure",
        "What these flights cannot tell",
        "Details",
    ]
    assert content["sentence"] in text and page.index('class="sentence"') < page.index("<h2>Where")


def test_every_number_of_the_findings_is_on_the_page(page, content):
    text, _ = _parsed(page)
    for f in content["findings"]:
        assert f["equation"] in page.replace("&gt;", ">").replace("&#39;", "'")
        for name, p in f["parameters"].items():
            span = f"{words.number_words(p['ci95'][0])} to {words.number_words(p['ci95'][1])}"
            unit = "" if p["unit"] == "1" else p["unit"]
            told = (name, p.get("note", ""), words.number_words(p["value"]), span, unit)
            assert " ".join(word for word in told if word) in text
    for c in content["fit"]["channels"].values():
        assert (
            " ".join(words.number_words(c[s]) for s in ("before", "recalibrated", "after")) in text
        )


def test_names_of_flights_are_text_not_markup(page, content):
    assert any("<b>" in name for name in content["fit"]["holdout_flights"])
    assert "<b>" not in page and "&lt;b&gt;" in page


@pytest.mark.parametrize("verdict", report.VERDICTS)
def test_every_verdict_makes_a_page_even_with_nothing_in_it(content, verdict):
    bare = {
        **content,
        "verdict": verdict,
        "findings": [],
        "located": [],
        "unexplained": [],
        "detectable": {},
        "next_flight": {},
        "calibration": {},
        "not_tested": {},
        "fit": {"metric": "", "holdout_flights": [], "channels": {}, "rollout": {}},
    }
    text, _ = _parsed(report.render(bare, {}))
    assert (
        report.VERDICTS[verdict] in text
        and "No flight could be held out" in text
        and "No cause is proven" in text
    )


def test_what_is_open_is_told(content):
    finding, channels = content["findings"][0], content["fit"]["channels"]
    told = {
        **content,
        "verdict": "ambiguous",
        "findings": [{**finding, "name": n, "open": True} for n in ("wind", "attitude_bias")],
        "fit": {
            **content["fit"],
            "alternatives": {
                "wind": dict.fromkeys(channels, 0.25),
                "attitude_bias": dict.fromkeys(channels, 0.5),
            },
        },
        "unexplained": [
            {"channel": "force_z", "regime": {"height_over_radius": [0.5, 2.0]}, "r2": 0.31}
        ],
        "detectable": {
            "wind": {
                "parameter": "east_m_s",
                "smallest": 0.4,
                "unit": "m/s",
                "limited_by": "attitude_bias",
            },
            "tether": {"parameter": "weight_N_m", "smallest": None},
        },
        "next_flight": {
            "manoeuvre": "yaw_turn",
            "separates": ["wind", "attitude_bias"],
            "expected_log_odds": 12.0,
        },
    }
    text, _ = _parsed(report.render(json.loads(json.dumps(told)), {}))
    for expected in (
        "wind or attitude bias: the flights fit either",
        "of those that are open with wind, the likeliest",
        "after, with each that is open wind attitude bias",
        "force forward, N 0.250 0.500",
        "force along thrust height over rotor radius 0.50 to 2.00 0.310",
        "wind east_m_s 0.400 m/s attitude bias",
        "tether weight_N_m not visible noise",
        (
            "Fly yaw turn: simulated with each explanation, it tells wind and attitude bias apart"
            " (expected log odds 12.0)."
        ),
    ):
        assert expected in text


def test_a_finding_that_fails_on_flights_it_never_saw_is_told(content):
    table = content["fit"]["channels"]
    name = next(iter(table))
    poor = {**table, name: {**table[name], "reduction_ci95": [-0.4, -0.1]}}
    text, _ = _parsed(report.render({**content, "fit": {**content["fit"], "channels": poor}}, {}))
    assert "is worse on these flights than recalibration alone" in text
    assert "is worse on these flights" not in _parsed(report.render(content, {}))[0]


def test_how_to_fly_what_one_flight_does_not_settle(content):
    told = {
        "manoeuvre": "hover",
        "separates": ["a", "b"],
        "expected_log_odds": 1.5,
        "so_far_log_odds": 0.1,
    }
    text, _ = _parsed(report.render({**content, "next_flight": {**told, "flights": 3}}, {}))
    assert (
        "Fly hover 3 times: simulated with each explanation, together they tell a and b apart"
        in text
    )
    text, _ = _parsed(
        report.render(
            {**content, "next_flight": {**told, "preparation": "a new propeller on rotor 3"}}, {}
        )
    )
    assert (
        "Fly hover with a new propeller on rotor 3: it tells a and b apart (expected log odds 1.50,"
        " so far 0.100)." in text
    )


def test_a_flight_that_would_not_help_is_not_recommended(content):
    told = {
        "manoeuvre": None,
        "separates": ["tether", "nothing more"],
        "expected_log_odds": 0.4,
        "so_far_log_odds": 0.1,
    }
    text, _ = _parsed(report.render({**content, "next_flight": told}, {}))
    assert (
        "No manoeuvre of the menu would tell tether and nothing more apart (best expected log odds"
        " 0.400)." in text
    )


def test_written_whole_and_the_same_every_time(tmp_path, content):
    shown = {
        "held_out": pictures.save(
            pictures.held_out_bars(content["fit"]["channels"]), tmp_path, "held_out"
        )
    }
    report.write_report(content, shown, tmp_path / "report.html")
    first = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    pictures.save(pictures.held_out_bars(content["fit"]["channels"]), tmp_path, "held_out")
    report.write_report(content, shown, tmp_path / "report.html")
    assert set(first) == {"held_out.png", "held_out.pdf", "report.html"}
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == first


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
        center, mean, half = pictures.binned(x, y, blocks, np.array([0.0, 0.5, 1.0]))
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


def test_interval_plot_shows_value_interval_and_declared_doubt():
    rows = [
        {
            "label": "mass_kg",
            "value": 1.1,
            "ci95": [1.05, 1.15],
            "unit": "kg",
            "declared": 1.0,
            "declared_sd": 0.02,
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
        axis.texts[0].get_text()
        == "mass_kg = 1.10 kg  (95 %: 1.05 to 1.15; declared: 1.00 ± 0.040)"
    )
    told = {t.get_text() for t in figure.legends[0].get_texts()}
    assert told == {"fitted", "95 % interval", "declared, with two standard deviations", "zero"}
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
