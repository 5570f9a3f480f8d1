"""Numbers of the method stand in one module, with unit, meaning and source, and can be set."""

import ast
import dataclasses
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from click.testing import CliRunner

import ges
from ges.blind.protocol.run import method_folder, method_options
from ges.commands import settings as page_of
from ges.diagnose.settings import (
    Convention,
    Measured,
    Numerical,
    Settings,
    changed_settings,
    of_method,
    parse,
    setting_rows,
    settings,
    using,
)
from ges.errors import UsageError
from ges.recordings.recording import load_set
from ges.threads import each

PACKAGE = Path(ges.__file__).parent / "diagnose"
FILES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "settings.py")
WORDS = {*(PACKAGE / "report").glob("*.py"), PACKAGE / "types" / "words.py"}
"""Their numbers lay the page out: how many digits are written, what is too small to read, how large
a picture is. They change no diagnosis.
"""
ROOT = PACKAGE.parents[2]
ALL = {key: (value, about) for key, value, about in setting_rows(Settings())}


def _numbers(tree: ast.AST) -> list[float]:
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and type(node.value) in (int, float)
    ]


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_number_stands_at_the_head_of_a_module(path):
    tree = ast.parse(path.read_text())
    heads = [n for n in tree.body if isinstance(n, ast.Assign | ast.AnnAssign) and n.value]
    assert path in WORDS or not [ast.unparse(n) for n in heads if _numbers(n.value)]


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_default_is_a_number_of_the_method_or_frozen_when_it_is_read(path):
    tree = ast.parse(path.read_text())
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.Lambda)]
    defaults = [d for f in functions for d in (*f.args.defaults, *f.args.kw_defaults) if d]
    assert path in WORDS or not [ast.unparse(d) for d in defaults if set(_numbers(d)) - {0, 1}]
    heads = [n.value for n in tree.body if isinstance(n, ast.Assign | ast.AnnAssign) and n.value]
    fields = [
        n.value
        for c in tree.body
        if isinstance(c, ast.ClassDef)
        for n in c.body
        if isinstance(n, ast.AnnAssign) and n.value
    ]
    assert not [t for t in map(ast.unparse, (*defaults, *heads, *fields)) if "settings." in t]


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_numbers_in_functions_are_those_of_formulas(path):
    """Counts, halves and powers, what units and percents take, and Gaussian integrals."""
    if path in WORDS:
        return
    tree = ast.parse(path.read_text())
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.ClassDef)]
    met = {value for f in functions for value in _numbers(f)}
    assert not met - {*range(10), 0.25, 0.5, 12, 100, 1000}


@pytest.mark.parametrize("key", ALL)
def test_every_number_has_a_meaning_and_a_source(key):
    value, about = ALL[key]
    assert about.meaning.endswith(".") and len(about.meaning.split()) <= 30
    assert isinstance(about.source, Measured | Convention | Numerical)
    assert all(dataclasses.astuple(about.source))
    for v in value if isinstance(value, tuple) else (value,):
        assert about.low <= v <= about.high


def test_every_number_is_used():
    code = "\n".join(p.read_text() for p in (*FILES, PACKAGE / "settings.py"))
    used = {node.attr for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute)}
    assert not {key for key in ALL if key.split(".")[1] not in used}


def test_what_is_set_holds_for_a_while_and_in_every_thread():
    with using({"evidence.tempering": 0.5, "search.beam": 2}):
        assert each(lambda _: settings.evidence.tempering, range(8)) == [0.5] * 8
        assert changed_settings() == {"evidence.tempering": 0.5, "search.beam": 2}
        with using({"evidence.tempering": Settings().evidence.tempering}):
            assert changed_settings() == {"search.beam": 2}
    assert settings.evidence == Settings().evidence and changed_settings() == {}
    with pytest.raises(ZeroDivisionError), using({"search.beam": 2}):
        raise ZeroDivisionError
    assert changed_settings() == {}


def test_diagnoses_in_two_threads_each_have_their_own_numbers():
    both_set = threading.Barrier(2)

    def tempering(value):
        with using({"evidence.tempering": value}):
            both_set.wait(60.0)
            return each(lambda _: settings.evidence.tempering, range(4))

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(tempering, [0.5, 0.25])) == [[0.5] * 4, [0.25] * 4]
    assert changed_settings() == {}


@pytest.mark.slow
def test_two_diagnoses_in_one_process_are_as_each_of_them_alone():
    flights = load_set(Path(ges.__file__).parent / "recordings" / "example")
    both_begun = threading.Barrier(2)

    def diagnosis(numbers, watch):
        with using(numbers):
            found = ges.diagnose(flights, names=["rotor_drag"], watch=watch)
            return repr(found.content())

    numbers = [{"noise.whitening": False}, {"evidence.tempering": 0.5}]
    alone = [diagnosis(n, lambda *_: None) for n in numbers]
    with ThreadPoolExecutor(2) as pool:
        # each waits once for the other, with its own numbers set
        waits = [lambda step, _: step == "located" and both_begun.wait(600.0)] * 2
        assert list(pool.map(diagnosis, numbers, waits)) == alone
    assert alone[0] != alone[1]


def test_numbers_are_read_as_what_they_are():
    read = parse(
        ["search.beam=5", "evidence.tempering=1", "noise.growths=0,1.5", "noise.whitening=false"]
    )
    assert read == {
        "search.beam": 5,
        "evidence.tempering": 1.0,
        "noise.growths": (0.0, 1.5),
        "noise.whitening": False,
    }


@pytest.mark.parametrize(
    ("pair", "said"),
    [
        ("evidence.temperng=0.5", "did you mean 'evidence.tempering'?"),
        ("evidence.tempering", "write KEY=VALUE"),
        ("evidence.tempering=half", "give a number, above 0 to 1"),
        ("evidence.tempering=nan", "give a number, above 0 to 1"),
        ("evidence.tempering=-1", "give a number, above 0 to 1"),
        ("numerics.wide_factor=inf", "give a number, above 0"),
        ("search.beam=2.5", "give a whole number, 1 or more"),
        ("noise.growths=1,x", "give numbers with commas between, 0 or more"),
        ("noise.whitening=perhaps", "give true or false"),
        ("statistics.acceptance_probability=1", "above 0 to below 1"),
    ],
)
def test_what_cannot_be_set_is_said_in_one_sentence(pair, said):
    with pytest.raises(UsageError) as caught:
        parse([pair])
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_the_command_refuses_what_cannot_be_set(tmp_path):
    from ges.commands.diagnose import command

    said = CliRunner().invoke(command, [str(tmp_path), "--out", str(tmp_path), "--set", "a=1"])
    assert isinstance(said.exception, UsageError)
    assert str(said.exception) == "unknown setting 'a'; 'ges settings' lists all that are known"


def test_an_ablation_has_a_folder_and_options_of_its_own():
    numbers = parse(["evidence.tempering=0.5", "noise.growths=0,1"])
    assert (
        method_folder("ges", numbers) == "diagnosed-evidence.tempering=0.5-noise.growths=(0.0,1.0)"
    )
    options = method_options("without-whitening", numbers)
    assert options["set"] == {"noise.whitening": False, **numbers}
    with pytest.raises(UsageError, match="has no settings"):
        method_options("stepwise", numbers)


def test_the_numbers_of_the_method_are_counted_on_the_page():
    counted = of_method(Settings())
    assert {"evidence.tempering", "prepare.pause_s"} <= set(counted)
    assert not {"noise.whitening", "numerics.tiny", "statistics.seed", "report.bins"} & set(counted)
    # one quantity a number: a share that eight rules read was counted once before
    assert len(counted) <= 45
    assert f"\n{len(counted)} of them are numbers of the method" in page_of.page()


def test_the_page_of_the_documentation_is_up_to_date():
    assert (ROOT / "docs" / "settings.md").read_text() == page_of.page() + "\n"
