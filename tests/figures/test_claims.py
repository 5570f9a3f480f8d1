"""Verdicts follow their rules, every claim says where ours is found, and the text quotes only what
exists.
"""

import json
import math
import re
from pathlib import Path

import pandas as pd
import pytest

from ges.errors import GesError
from ges.paper import paper
from ges.study import claims, claims_text, config
from ges.study.claims import DIRECTION, NOT, REPRODUCED, UNMEASURED, Claim, Ours

ROOT = Path(__file__).resolve().parents[2]
SEEDS = config.load(ROOT / "config/default.yaml").seeds


def claim(**given) -> Claim:
    return Claim.model_validate(
        {"id": "x", "section": "1", "says": "x", "table": "t.csv", "value": "v", **given}
    )


@pytest.mark.parametrize(
    ("given", "found", "baseline", "expected"),
    [
        ({"paper": 1.0}, (1.04,), None, REPRODUCED),
        ({"paper": 1.0}, (1.06,), None, NOT),
        ({"paper": 0.998, "value": "r2"}, (0.96, 0.95, 0.97), None, NOT),
        ({"paper": 0.998, "value": "r2"}, (0.9979, 0.9978, 0.99802), None, REPRODUCED),
        (
            {"paper": 0.998, "value": "r2", "paper_baseline": 0.85},
            (0.96, 0.95, 0.97),
            0.8,
            DIRECTION,
        ),
        ({"paper": 1.0}, (1.2, 0.95, 1.45), None, REPRODUCED),
        (
            {"paper": 1.0},
            (1.2, -3.0, 5.4),
            None,
            NOT,
        ),  # an interval that reaches further than the number proves nothing
        ({"paper": 1.0, "paper_baseline": 2.0}, (0.5, 0.4, 0.6), 3.0, DIRECTION),
        ({"paper": 1.0, "paper_baseline": 2.0}, (3.5, 3.4, 3.6), 3.0, NOT),
        ({"paper": -1.0, "value": "difference"}, (-0.2, -0.3, -0.1), None, DIRECTION),
        ({"paper": -1.0, "value": "difference"}, (-0.2, -0.5, 0.1), None, NOT),
        ({"kind": "sign", "paper": 1.0}, (9.0, 8.0, 10.0), None, REPRODUCED),
        ({"kind": "sign", "paper": 1.0}, (9.0, -1.0, 10.0), None, DIRECTION),
        ({"kind": "sign", "paper": 1.0}, (-9.0, -10.0, -8.0), None, NOT),
        ({"kind": "null", "margin": 0.5}, (0.1, -0.1, 0.3), None, REPRODUCED),
        ({"kind": "null", "margin": 0.1}, (0.2, -9.0, 9.0), None, NOT),
        ({"kind": "null", "margin": 0.5}, (0.2, 0.1, 0.3), None, DIRECTION),
        ({"kind": "null", "margin": 0.1}, (0.2, 0.1, 0.3), None, NOT),
        ({"kind": "above", "bound": 1.0}, (2.0, 1.5, 2.5), None, REPRODUCED),
        ({"kind": "above", "bound": 1.0}, (2.0, 0.5, 2.5), None, DIRECTION),
        ({"kind": "above", "bound": 1.0}, (0.9,), None, NOT),
        ({"kind": "below", "bound": 1.0}, (0.5, 0.4, 0.6), None, REPRODUCED),
        ({"kind": "below", "bound": 1.0}, (0.5, 0.4, 1.6), None, DIRECTION),
        ({"kind": "below", "bound": 1.0}, (1.5, 1.4, 1.6), None, NOT),
        ({"kind": "not_below"}, (-0.1, -0.3, 0.1), None, REPRODUCED),
        ({"kind": "not_below"}, (-0.2, -0.3, -0.1), None, NOT),
    ],
)
def test_verdict(given, found, baseline, expected):
    ours = Ours(**dict(zip(("value", "low", "high"), found, strict=False)))
    assert (
        claims.verdict(claim(**given), ours, Ours(value=baseline) if baseline else None) == expected
    )


def test_nothing_found_is_not_measured():
    assert claims.verdict(claim(paper=1.0), None) == UNMEASURED


def test_every_kind_of_claim_has_a_rule_and_every_id_is_its_own():
    listed = claims.claims()
    assert {c.kind for c in listed} == set(claims.RULES)
    assert len({c.id for c in listed}) == len(listed) > 80
    for c in listed:
        assert c.paper is not None or c.kind in ("null", "above", "below", "not_below"), c.id
        assert (c.kind in ("above", "below")) == (c.bound is not None), c.id
        assert (c.kind == "null") == (c.margin is not None), c.id
        assert (c.baseline is None) == (c.paper_baseline is None), c.id


@pytest.mark.parametrize("listed", claims.claims(), ids=lambda c: c.id)
def test_every_claim_can_come_out_and_can_fail(listed):
    """Over numbers of either sign and any size, each as sure as can be."""
    sizes = [0.0, *(s * 10.0**k for k in range(-6, 4) for s in (1, -1))]
    about = [listed.paper, listed.bound] if listed.paper or listed.bound else [0.0]
    tried = [a + v for a in about if a is not None for v in sizes]
    found = {claims.verdict(listed, Ours(value=v, low=v, high=v), Ours(value=v)) for v in tried}
    assert {REPRODUCED, NOT} <= found


def test_look_finds_one_row_with_its_interval():
    table = pd.DataFrame(
        {
            "m": ["a", "b", "b"],
            "k": [1, 0.5, 0.25],
            "v": [1.0, 2.0, 3.0],
            "v_low": [0.0, 1.0, 2.0],
            "v_high": 4.0,
        }
    )
    assert claims.look(table, {"m": "b", "k": 0.5}, "v") == Ours(value=2.0, low=1.0, high=4.0)
    assert claims.look(table, {"m": "c"}, "v") is None
    assert claims.look(table, {"m": "b"}, "v", "max").value == 3.0
    with pytest.raises(GesError, match="2 rows fit"):
        claims.look(table, {"m": "b"}, "v")
    with pytest.raises(GesError, match="'n'; its table has m, k"):
        claims.look(table, {"n": "b"}, "v")


def test_difference_of_rows_has_the_interval_that_always_holds():
    table = pd.DataFrame(
        {"m": ["a", "b"], "v": [3.0, 1.0], "v_low": [2.5, 0.5], "v_high": [3.5, 1.5]}
    )
    found = claims.ours(claim(where={"m": "a"}, minus={"m": "b"}, scale=10.0), {"t.csv": table})
    assert (found.value, found.low, found.high) == (20.0, 10.0, 30.0)


def _written(folder: Path) -> pd.DataFrame:
    (folder / "closed_loop").mkdir()
    table = folder / "closed_loop/bias_tests.csv"
    table.write_text(
        "metric,condition,difference,low,high\nagl_rms_m,0.02,-0.0003,-0.0006,-0.0001\nclearance_p5_m,0.02,0.001,0.0005,0.002\n"
    )
    claims.write_claims(
        claims.LISTED, [table], folder, SEEDS, folder / "claims.csv", folder / "rules.json"
    )
    return pd.read_csv(folder / "claims.csv", keep_default_na=False).set_index("id")


def test_claims_table(tmp_path):
    found = _written(tmp_path)
    assert found.loc["s45.rms2", "verdict"] == REPRODUCED and found.loc["s45.rms2", "why"] == ""
    assert found.loc["s45.p5", "verdict"] == NOT and found.loc["s45.p5", "why"]
    assert found.loc["s45.p5", "seeds"] == "2001-2030 (30)"
    assert found.loc["t1.mlp.rmse", "verdict"] == UNMEASURED
    assert json.loads((tmp_path / "rules.json").read_text()) == claims.RULES


def test_numbers_to_print(tmp_path):
    _written(tmp_path)
    (tmp_path / "real").mkdir()
    (tmp_path / "real/forms.csv").write_text(
        "form,c_a,decay,offset_m,aicc,rmse\nexponential,0.12345,0.7,0,1,1\n"
    )
    claims_text.write_numbers(
        claims_text.LISTED,
        tmp_path / "claims.csv",
        [tmp_path / "real/forms.csv"],
        tmp_path,
        tmp_path / "n.json",
    )
    made = json.loads((tmp_path / "n.json").read_text())
    assert made["s45.rms2"]["full"] == "\u22120.300 [\u22120.600, \u22120.100]\u202fmm"
    assert (
        made["s45.rms2"]["paper"] == "\u22120.351\u202fmm"
        and made["s45.rms2"]["verdict"] == REPRODUCED
    )
    assert made["real.c_a"]["text"] == "0.123" and made["t1.mlp.rmse"]["text"] == "n/a"
    assert (
        made["claims.reproduced"]["value"] == 1 and made["claims.reproduced_fitted"]["value"] == 0
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.5, "0.500"),
        (-12.34, "\u221212.3"),
        (1234567.0, "1234567"),
        (30.0, "30"),
        (3.2e-5, "3.20 × 10⁻⁵"),
        (math.nan, "n/a"),
    ],
)
def test_digits(value, text):
    assert claims_text.digits(value) == text


def test_what_was_measured_keeps_its_digits_where_it_is_whole():
    measured = claims_text.Ours(value=0.062, low=0.0597, high=0.064)
    assert claims_text.entry(measured, "m")["full"] == "62.0 [59.7, 64.0]\u202fmm"
    assert claims_text.entry(claims_text.Ours(value=0.062), "m")["full"] == "62\u202fmm"
    assert claims_text.entry(claims_text.Ours(value=0.0, low=0.0, high=0.5), "1")["full"] == (
        "0 [0, 0.500]"
    )


def test_the_paper_quotes_what_exists_and_types_no_number(tmp_path):
    source = ROOT / "paper/main.typ"
    paper.check_source([source], tmp_path / "ok.json")
    text = source.read_text()
    known = {c.id for c in claims.claims()} | set(claims_text.quoted())
    known |= {
        f"claims.{name}"
        for name in (
            "all",
            "derived",
            "reproduced",
            "reproduced_fitted",
            "same_direction",
            "not_reproduced",
            "not_measured",
        )
    }
    calls = "num|ours|theirs|verdict|beside|word|known|less|apart|below-zero"
    asked = rf'\b({calls})\("([^"]+)"(?:, "([^"]+)")?'
    quoted = {
        name
        for call, *names in re.findall(asked, text)
        for name in names[: 1 + (call == "less")]
        if name
    }
    assert quoted and quoted <= known


def test_every_figure_is_shown_once_and_twelve_at_most_in_the_body():
    rules = (ROOT / "workflow/rules/figures.smk").read_text()
    made = re.findall(r'^    "(\w+)": \($', rules, flags=re.MULTILINE)
    made += re.findall(r'^    "(\w+)": \("', rules, flags=re.MULTILINE)
    body, _, further = (ROOT / "paper/main.typ").read_text().partition("#show: appendix")
    in_body, in_appendix = (re.findall(r'\b(?:fig|plate)\("([^"]+)"', t) for t in (body, further))
    assert len(in_body) <= 12
    assert sorted(in_body + in_appendix) == sorted([*made, "detection", "outcomes"])


def test_no_claim_says_a_key_twice():
    """YAML would take the last one and say nothing."""
    lines = claims.LISTED.read_text().splitlines()
    assert not [line for line in lines if len(re.findall(r'\bwhy: "', line)) > 1]


@pytest.mark.parametrize(
    ("a", "b", "low", "high"),
    [
        ((1.0, 0.5, 2.0), (2.0, 1.0, 4.0), 0.125, 2.0),
        ((-0.1, -1.0, 1.0), (1.0, 0.5, 2.0), -2.0, 2.0),
        ((1.0, 0.5, 2.0), (-2.0, -4.0, -1.0), -2.0, -0.125),
        ((1.0, 0.5, 2.0), (1.0, -1.0, 3.0), math.nan, math.nan),
        ((1.0,), (2.0, 1.0, 4.0), math.nan, math.nan),
    ],
)
def test_the_interval_of_a_ratio_holds_every_quotient(a, b, low, high):
    """And is none where the divisor may be zero, or a number has none."""
    ours = [Ours(**dict(zip(("value", "low", "high"), given, strict=False))) for given in (a, b)]
    found = claims._combined(*ours, subtract=False)
    assert found.value == a[0] / b[0]
    assert (found.low, found.high) == pytest.approx((low, high), nan_ok=True)
