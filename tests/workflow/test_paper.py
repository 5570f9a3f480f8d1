"""No result is typed into the paper; tables keep their origin; the same results give the
same PDF.
"""

import json
from pathlib import Path

import pytest

from ges.errors import GesError
from ges.paper import paper
from ges.provenance.runs import Code

ROOT = Path(__file__).resolve().parents[2]
CITATION = ROOT / "CITATION.cff"
CODE = Code(commit="0123456789", modified=False, sha256="0" * 64)


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("The error is 0.061 m.", ["0.061"]),
        ("A drop of -3 mm\nand 12,000 rows", ["-3", "12,000"]),
        ('#fig("fig03")[Over 30 seeds.]', ["30"]),
        ('#fig("fig03", [Over 30 seeds.])', ["30"]),
        ('At #num("agl_rms_30") in @fig12, where $x_2 = 3$ // 7 of them', []),
        ("#let inches = 5\n#set page(margin: 2cm,\n  columns: 2)\nprose", []),
        ("`ge_ff_3` and ```\n1 2 3\n``` <sec:4>", []),
    ],
)
def test_naked_numbers(source, found):
    assert [number for _, number in paper.naked_numbers(source)] == found


def test_line_of_a_naked_number(tmp_path):
    (tmp_path / "main.typ").write_text("/* 1\n2 */\n\nA mean of 5 m.\n")
    with pytest.raises(GesError, match=r"main.typ line 4: '5'"):
        paper.check_source([tmp_path / "main.typ"], tmp_path / "ok.json")
    assert not (tmp_path / "ok.json").exists()


def test_facts_and_latex(tmp_path):
    table = tmp_path / "table1.csv"
    table.write_text("model,rmse_m\nrandom_forest & co,0.00123456\nlinear,\n")
    paper.write_facts([table], {str(table): "make_table1"}, CODE, tmp_path / "facts.json")
    fact = json.loads((tmp_path / "facts.json").read_text())["table1"]
    assert (
        fact["rule"] == "make_table1" and fact["commit"] == "0123456789" and len(fact["data"]) == 12
    )
    paper.write_latex(table, tmp_path / "facts.json", tmp_path / "table1.tex")
    text = (tmp_path / "table1.tex").read_text()
    assert r"random\_forest \& co & 0.001235 \\" in text and "linear & -- " in text
    assert f"data {fact['data']}" in text


def test_pdf_is_the_same_twice_and_errors_are_sentences(tmp_path):
    (tmp_path / "results").mkdir()
    (tmp_path / "results/numbers.json").write_text('{"x": {"text": "4.2"}}')
    (tmp_path / "main.typ").write_text(
        # As the paper does: a document that does not say so bears the second it was made in.
        "#set document(date: none)\n"
        '#let n = json(sys.inputs.results + "/numbers.json")\nValue #n.x.text.\n'
    )
    made = [tmp_path / f"{i}.pdf" for i in range(2)]
    for pdf in made:
        paper.render(tmp_path / "main.typ", tmp_path / "results", CITATION, pdf)
    assert made[0].read_bytes() == made[1].read_bytes()
    (tmp_path / "main.typ").write_text("#nothing")
    with pytest.raises(GesError, match="unknown variable"):
        paper.render(tmp_path / "main.typ", tmp_path / "results", CITATION, tmp_path / "no.pdf")
    assert not (tmp_path / "no.pdf").exists()


def test_authors_are_those_of_the_citation_file(tmp_path):
    assert paper.authors(CITATION) == "The GES authors"
    file = tmp_path / "CITATION.cff"
    file.write_text("authors:\n- {given-names: Ada, family-names: Love}\n- {name: A group}\n")
    assert paper.authors(file) == "Ada Love, A group"
    (tmp_path / "main.typ").write_text('#assert.eq(sys.inputs.authors, "Ada Love, A group")\n')
    paper.render(tmp_path / "main.typ", tmp_path, file, tmp_path / "ok.pdf")


def _checked_by_the_compiler(folder, numbers, checks):
    """Assertions in Typst over the paper's own functions, with these numbers as results."""
    (folder / "lib.typ").write_text((ROOT / "paper/lib.typ").read_text())
    results = {"numbers": numbers, "facts": {}, "config": {}, "claims_rules": {}}
    for name, content in results.items():
        (folder / f"{name}.json").write_text(json.dumps(content))
    (folder / "main.typ").write_text("\n".join(['#import "lib.typ": *', *checks]))
    paper.render(folder / "main.typ", folder, CITATION, folder / "ok.pdf")


def test_words_follow_the_sign(tmp_path):
    """A rerun that turns a result turns the word that tells it, and one that cannot tell
    says so.
    """
    spans = {
        "up": (1, [0.5, 2]),
        "down": (-1, [-2, -0.5]),
        "either": (1, [-1, 3]),
        "absent": (None, None),
        "alone": (-3, None),
    }
    numbers = {name: {"value": value, "ci95": span} for name, (value, span) in spans.items()}
    said = {"up": "trails", "down": "leads", "either": "level", "absent": "level", "alone": "leads"}
    checks = [
        f'#assert.eq(word("{name}", "trails", "leads", "level"), "{words}")'
        for name, words in said.items()
    ]
    checks += [
        '#assert(less("down", "up") and not less("up", "down") and not less("absent", "up"))',
        '#assert(apart("up") and apart("down"))',
        '#assert(not (apart("either") or apart("absent") or apart("alone")))',
    ]
    _checked_by_the_compiler(tmp_path, numbers, checks)


def test_cells_of_a_column_have_the_same_digits(tmp_path):
    """What was cut keeps its zeros; what was given with few digits gets none; signs are signs."""
    shown = {
        ("0.0597", 1000): "59.70",
        ("0.064", 1000): "64.00",
        ("0.99503", 1): "0.9950",
        ("0.75", 1): "0.75",
        ("12", 1): "12",
        ("-0.02", 1): "−0.02",
        ("0", 1000): "0",
        ("bias +0.02 - -0.02", 1): "bias +0.02 less −0.02",
        (">= 0.9", 1): "≥ 0.9",
        ("held-out", 1): "held-out",
    }
    checks = [f'#assert.eq(shown("{c}", {f}), "{words}")' for (c, f), words in shown.items()]
    _checked_by_the_compiler(tmp_path, {}, checks)


def test_what_is_told_of_real_flights_follows_their_absence(tmp_path):
    """Without recordings, title, abstract, aims and limits claim no more than the flights that the
    package ships.
    """
    checks = [
        "#let told(any) = told-of-real-flights(any).pairs()",
        "#let words(any) = told(any).map(((part, said)) => (part, repr(said))).to-dict()",
        "#assert.eq(repr([]), words(false).title)",
        '#assert(words(true).title.contains("real flights"))',
        '#assert(words(false).abstract.contains("one small quadrotor"))',
        '#assert(words(true).abstract.contains("Published flights"))',
        '#assert(words(false).aim.contains("not at hand"))',
        '#assert(words(true).limits.contains("level floor"))',
        '#assert(not words(false).limits.contains("level floor"))',
        '#assert(words(true).airframes.contains("real airframes"))',
        '#assert(words(false).airframes.contains("of one type"))',
    ]
    _checked_by_the_compiler(tmp_path, {}, checks)
    # the paper's own words are these
    source = (ROOT / "paper/main.typ").read_text()
    for part in ("title", "abstract", "aim", "limits", "airframes"):
        assert source.count(f"#of-real.{part}") == 1


@pytest.mark.parametrize(
    ("value", "cell"),
    [
        (float("nan"), "--"),
        (0.123456, "0.1235"),
        ("dominant mode", "dominant mode"),
        ("50 % of a_b", r"50 \% of a\_b"),
        ("back\\slash {x}", r"back\textbackslash{}slash \{x\}"),
    ],
)
def test_a_cell_of_latex_says_what_the_table_says(value, cell):
    assert paper._cell(value) == cell
