"""The page: whole without a network, every block of diagnosis.json, nothing that none acts on."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import pytest

from ges.diagnose.report import blocks, page
from ges.diagnose.types import words


class Parsed(HTMLParser):
    """Text, headings, sources and balance of a page."""

    VOID = {"meta", "img", "br"}
    SILENT = ("style", "script")

    def __init__(self, text: str):
        super().__init__()
        self.open, self.sources, self.texts, self.headings = [], [], [], []
        self.feed(text)
        assert self.open == []
        self.text = re.sub(r" +([:;,])", r"\1", " ".join(" ".join(self.texts).split()))

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in self.SILENT:
            self.texts.append(data)
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def text_of(content: dict, **more) -> str:
    return Parsed(page.render(content, **more)).text


def test_needs_no_network_and_no_other_file(content, traces):
    text = page.render(content, {"where": b"png", "over_time": b"png"}, traces)
    parsed = Parsed(text)
    assert parsed.sources and all(s.startswith("data:image/png;base64,") for s in parsed.sources)
    assert "default-src 'none'" in text and "@import" not in text and "url(" not in text


def test_a_page_runs_its_own_scripts_alone(content, traces):
    text = page.render(content, {}, traces)
    scripts = re.findall(r"<script>(.*?)</script>", text, flags=re.S)
    digests = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts]
    named = " ".join(f"'sha256-{digest}'" for digest in digests)
    assert len(scripts) == 2 and f"script-src {named}" in text


def test_blocks_come_in_their_order(content, traces):
    parsed = Parsed(page.render(content, {}, traces))
    assert parsed.headings == [
        "Where",
        "What, and how much",
        "On flights that took no part",
        "Recorded and simulated over time",
        "What these flights cannot tell",
        "Details",
        "What next",
        "What it was made from",
    ]
    order = ("missing physics", content["sentence"], "finding size in these flights", "GES 0.1.0")
    places = [parsed.text.index(part) for part in order]
    assert places == sorted(places)


def test_verdict_and_sentence_are_followed_by_the_picture_of_the_largest_residual(content):
    text = page.render(content, {"located": b"the picture", "where": b"the map"})
    first, second = re.findall("<img|<table|<section", text)[:2]
    assert text.index("<img") > text.index(content["sentence"])
    assert (first, second) == ("<img", "<table"), "it comes before the table of findings"
    assert text.count("<img") == 2


def test_the_last_block_says_what_it_was_made_from(content):
    text = text_of(content).split("What it was made from")[1]
    assert "two 20.0 s 15.5 s took no part" in text and "9.5 s on ground" in text
    assert "ges diagnose flights --out report" in text
    for digest in ("a" * 64, "b" * 64, "c" * 64):
        assert digest in text, "in full"


def test_names_of_flights_are_text_not_markup(content, traces):
    text = page.render(content, {}, traces)
    assert "<b>" not in text and "one &lt;b&gt;" in text and "one \\u003cb\\u003e" in text


def test_every_number_of_the_findings_is_there(content):
    text, p = text_of(content), content["findings"][0]["parameters"]["k_kg"]
    interval = f"{words.number_words(p['ci95'][0])} to {words.number_words(p['ci95'][1])}"
    assert f"k_kg {words.number_words(p['value'])} kg ({interval})" in text
    assert "3.0 % of weight, 0.42 N rms in the force forward; 0.26 N per m/s" in text
    assert "wind: 8955 times less likely" in text and text.count("Probability: the chance") == 1
    assert (
        "force forward, N 0.510 (3.6 %) 0.440 (3.1 %) 0.110 (0.8 %) −80 % to −71 % better" in text
    )


def test_equations_are_typeset(content):
    law = {
        "channel": "force_y",
        "form": "0.1 m g (V_x/v_h) - 2e-05 T",
        "reads_as": "an asymmetric frame",
        "regime": {"airspeed_m_s": [1.0, 2.0]},
        "r2": 0.3,
        "size": {},
        "terms": [{"term": "m g (V_x/v_h)", "coefficient": 0.1, "ci95": [0.09, 0.11]}],
    }
    (finding,) = content["findings"]
    finding["rival_law"] = {"channel": "force_x", "form": "0", "log_odds": -9.0}
    text = page.render(content | {"laws": [law]})
    assert text.count("<math") == 4 and "\\" not in text.partition("<body>")[2]
    assert finding["equation"] not in text
    finding["equation"] = "F = what another version wrote < this"
    assert "<code>F = what another version wrote &lt; this</code>" in page.render(content)


def test_smaller_entries_are_counted_and_left_out(content):
    content["located"] += [
        {**content["located"][0], "mean": 0.002},
        {**content["located"][0], "regime": {"climb_m_s": [0.01, 0.04]}},
    ]
    text = text_of(content)
    assert "2 smaller entries are in diagnosis.json alone" in text and "climb rate" not in text
    assert "speed forward 1.50 to 3.00 m/s −0.800 N (−5.7 %)" in text


def test_a_map_is_drawn_only_where_it_has_news(content):
    from ges.diagnose.locate.regimes import Cell
    from ges.diagnose.report.figures import map_figure

    cells = [
        Cell("force_z", "height_over_radius", 0.0, 1.0, 0.3, 0.1, 1.0, q, 9) for q in (1.0, 0.5)
    ]
    assert not map_figure(cells) and not map_figure([])
    news = Cell("force_z", "height_over_radius", 1.0, 2.0, 0.3, 0.1, 1.0, 0.002, 9)
    assert [name for name, *_ in map_figure([*cells, news])] == ["where"]


def test_rows_that_nobody_acts_on_are_named_and_left_out(content):
    text = text_of(content)
    assert "position x, m 0.200 0.150 0.0400 −73 %" in text
    assert "height, m" not in text and "Too small to act on, in diagnosis.json: height" in text


@pytest.mark.parametrize(
    ("stages", "interval", "remark"),
    [
        ((1.0, 0.4, 0.5), [-0.4, -0.1], "is worse (0.400 → 0.500 N), and not by chance"),
        ((1.0, 0.4, 0.42), [-0.2, 0.1], "is worse (0.400 → 0.420 N), which chance may do"),
        ((0.4, 0.6, 0.5), [0.1, 0.2], "Recalibration alone makes worse: force along thrust (0.400"),
    ],
)
def test_a_held_out_channel_that_gets_worse_is_remarked_on(content, stages, interval, remark):
    names = ("before", "recalibrated", "after")
    row = {**dict(zip(names, stages, strict=True)), "reduction_ci95": interval}
    assert not blocks.remarks(content)
    content["fit"]["channels"]["force_z_N"] = row
    assert any(remark in r for r in blocks.remarks(content)) and remark in text_of(content)


def test_a_rollout_that_gets_worse_is_remarked_on(content):
    content["fit"]["rollout"]["channels"]["p_z_m"] |= {"recalibrated": 0.2, "after": 0.3}
    assert "the height is farther off with the findings: 0.200 → 0.300 m" in text_of(content)


def test_a_rollout_that_is_off_by_less_than_a_reading_is_not(content):
    """Of velocities by their own unit: 0.03 m/s is less, 0.03 m is more."""
    content["fit"]["rollout"]["channels"] = {
        name: {"before": 0.01, "recalibrated": 0.01, "after": 0.03} for name in ("p_z_m", "v_z_m_s")
    }
    (remark,) = (r for r in blocks.remarks(content) if "ahead" in r)
    assert "height" in remark


def test_considered_names_have_the_first_rule_that_they_fail(content):
    text = text_of(content)
    assert "2 names effect probability rule that it fails why" in text
    assert "wind 0.31 probable 0.310, asked 0.900; parasitic drag explains these" in text
    assert "weak rotor, rotor 2 0.04 probable" in text and "rotor drag 0.97" not in text


def test_a_finding_that_stands_twice_has_its_place(content):
    first = content["findings"][0]
    content["findings"] = [{**first, "name": "weak_rotor", "place": f"rotor {k}"} for k in (1, 2)]
    text = text_of(content)
    assert "weak rotor, rotor 1" in text and "weak rotor, rotor 2" in text


@pytest.mark.parametrize(
    ("separates", "words"),
    [
        (["wind", "attitude_bias"], "it tells wind and attitude bias apart"),
        (["tether", "nothing more"], "it shows whether tether is there at all"),
        (
            ["wind", "tether", "nothing more"],
            "it tells wind and tether apart and shows whether wind or tether is there at all",
        ),
        (
            ["weak_rotor", "cg_offset+thrust_scale"],
            "weak rotor and cg offset with thrust scale apart",
        ),
    ],
)
def test_the_next_flight_is_the_first_step_and_nothing_is_no_rival(content, separates, words):
    content["next_flight"] = {"manoeuvre": "yaw_turn", "separates": separates, "flights": 1}
    first = blocks.next_steps(content)[0]
    assert first["words"].startswith(f"Fly yaw turn: {words}" if words[:2] == "it" else "Fly")
    assert words in first["words"] and "nothing more" not in text_of(content)
    assert first["command"] == "ges diagnose flights --out report --write-flight next_flight.csv"


def test_how_often_and_with_what_to_fly(content):
    advised = {"manoeuvre": "hover", "separates": ["wind", "tether"], "flights": 3}
    content["next_flight"] = advised
    assert "Fly hover 3 times: together these flights tell wind and tether apart" in text_of(
        content
    )
    content["next_flight"] = {**advised, "flights": 1, "preparation": "a new propeller on rotor 3"}
    assert "Fly hover with a new propeller on rotor 3: it tells" in text_of(content)


def test_where_no_flight_would_help_it_says_what_to_do_instead(content):
    content["next_flight"] = {"manoeuvre": None, "separates": ["thrust_curve", "nothing more"]}
    step = blocks.next_steps(content)[0]["words"]
    assert step.startswith(
        "No manoeuvre of the menu would show whether thrust curve is there at all."
    )
    assert "Instead change one thing on the vehicle" in step


def test_what_next_has_commands(content):
    text = text_of(content).split("What next")[1]
    for command in (
        "ges simulate vehicle.fitted.yaml",
        "ges diagnose LATER_FLIGHTS --vehicle vehicle.fitted.yaml",
        "ges compare . later",
        "ges explain . wind",
    ):
        assert command in text
    assert "log a rangefinder and the height (range_m, p_z_m): these flights say nothing" in text


def test_a_warning_stands_once_with_its_flights(content):
    assert "one <b> and two: has two clocks" in text_of(content)
    names = ["part1", "part11"]
    assert blocks.grouped_warnings(["part11: a", "part1: a", "part1 is b", "c", "c"], names) == [
        "part11 and part1: a",
        "part1 is b",
        "c",
    ]


@pytest.mark.parametrize("verdict", page.VERDICTS)
def test_every_verdict_makes_a_page_even_with_nothing_in_it(content, verdict):
    empty = {
        **content,
        "verdict": verdict,
        "fit": {"metric": "", "holdout_flights": [], "channels": {}, "rollout": {}},
        **dict.fromkeys(("findings", "located", "unexplained", "considered"), []),
        **dict.fromkeys(("detectable", "next_flight", "calibration", "not_tested", "origin"), {}),
    }
    text = text_of(empty)
    assert page.VERDICTS[verdict] in text and "No cause is proven" in text
    assert "No flight could be held out" in text and "Considered and not named" not in text


def test_a_place_that_flights_cannot_tell_from_another_says_so(content):
    """Two rotors of a coaxial pair in hover."""
    other = {"name": "weak_rotor", "place": "rotor 5", "log_odds": -0.3}
    rival = {"name": "wind", "log_odds": -9.1}
    lost = {"name": "weak_rotor", "place": "rotor 1", "alternatives": [other, rival]}
    text = text_of({**content, "findings": [{**content["findings"][0], **lost}]})
    assert "Instead of it: weak rotor of rotor 5" in text
    assert "These flights cannot tell where it acts" in text
    del content["findings"][0]["alternatives"][1:]
    assert "cannot tell where it acts" not in text_of(content)


def test_what_is_open_has_an_error_each(content):
    first, channels = content["findings"][0], content["fit"]["channels"]
    content |= {
        "verdict": "ambiguous",
        "findings": [
            {**first, "name": n, "open": True, "alternatives": []}
            for n in ("wind", "attitude_bias")
        ],
    }
    content["fit"]["alternatives"] = {
        "wind": dict.fromkeys(channels, 0.25),
        "attitude_bias": dict.fromkeys(channels, 0.5),
    }
    text = text_of(content)
    for expected in (
        "wind or attitude bias: the flights fit either",
        "of those that are open with wind, the likeliest",
        "with each that is open wind attitude bias force forward, N 0.250 0.500",
        "force along thrust height over rotor radius 0.50 to 2.00 0.310",
        "tether weight_N_m not visible",
    ):
        assert expected in text


def test_no_word_of_a_private_jargon(content, traces):
    text = text_of(content, traces=traces).lower()
    for word in ("vouch", "loose", "borrowed", "strain", "cushion", "told,", "foretold"):
        assert word not in text


def _browser() -> str:
    found = next((b for n in ("chromium", "google-chrome") if (b := shutil.which(n))), None)
    if not found:
        pytest.skip("no Chromium here to draw the charts with")
    return found


def test_a_browser_draws_the_charts_and_reports_no_error(content, traces, tmp_path):
    path = tmp_path / "report.html"
    path.write_text(page.render(content, {}, traces), encoding="utf-8")
    done = subprocess.run(
        [
            _browser(),
            *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--dump-dom"),
            *("--disable-background-networking", "--enable-logging=stderr", "--v=0"),
            *(f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=3000"),
            path.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "CONSOLE" not in done.stderr, done.stderr
    assert re.search(r'<html lang="en" class="live">', done.stdout)
    assert done.stdout.count("<canvas") == 2 and "two (took no part)" in done.stdout


def test_the_charts_hold_the_signals(content, traces):
    import numpy as np

    text = page.render(content, {}, traces)
    data = json.loads(re.search(r'id="series">(.*?)</script>', text, re.DOTALL)[1])
    assert data["shown"] == 1 and [s for s, _ in data["stages"]][0] == "recorded"
    flight, source = data["flights"][1], traces[1]
    assert flight["left_out"] == [[0.0, 5.0, "on ground"]]
    channel = flight["channels"][0]
    codes = {
        stage: np.frombuffer(base64.b64decode(c), "<i2") for stage, c in channel["series"].items()
    }
    values = channel["low"] + channel["step"] * (codes["recorded"] + 32767.0)
    assert values == pytest.approx(source.recorded[:, 0], abs=2.0 * channel["step"])
    assert np.array_equal(codes["after"] == -32768, ~source.used)


def test_the_licence_of_the_chart_library_is_on_the_page(content, traces):
    text = text_of(content, traces=traces)
    assert "uPlot, a part of this page under the MIT licence" in text and "Leon Sorokin" in text
    assert "uPlot" not in text_of(content)


def test_numbers_that_moved_far_and_that_nothing_accounts_for_are_remarked(content):
    moved = {"value": -0.55, "ci95": [-0.6, -0.5], "prior_sd": 0.11, "declared_sd": None}
    near = {"value": 0.02, "ci95": [0.0, 0.04], "prior_sd": 0.01, "declared_sd": 0.01}
    content["calibration"] = {"thrust_scale.scale": moved, "cg_offset.x_m": near}
    (remark,) = (r for r in blocks.remarks(content) if "Recalibration moved" in r)
    assert "moved thrust scale −55 % (5.0 prior sds) farther" in remark and "cg" not in remark
    content["findings"] = [{**content["findings"][0], "name": "thrust_scale"}]
    assert not [r for r in blocks.remarks(content) if "Recalibration moved" in r]
