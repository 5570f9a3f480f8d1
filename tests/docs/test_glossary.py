"""Words of the field: those of the glossary, and none of those that are gone."""

import ast
import io
import re
import tokenize
from collections import Counter
from pathlib import Path

import pytest

import ges

ROOT = Path(__file__).parents[2]
PACKAGE = Path(ges.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
GONE = re.compile(
    r"foretell|foretold|untold|vouch|overtone|unrest|cushion|untrim"
    r"|(?<![a-z])(?:loose|boards?|strain(?:s|ed)?|twins)(?![a-z])",
    re.IGNORECASE,
)
"""Within words too, but for those that are parts of others: constraint, on-board."""
GONE_FROM_NAMES = re.compile(
    r"(?:^|_)(?:told|said|heard|lost|carriers?|cushions?|doubts?|answers?|answered|beside"
    r"|declared|found|strangers?)(?:_|$)",
    re.IGNORECASE,
)
"""Parts of names between underscores."""
OF_CONTRACT = frozenset({"declared_sd"})
GONE_FUNCTIONS = frozenset(
    {"along", "both", "centred", "composed", "excited", "explained", "judged", "remaining"}
    | {"searched", "stated"}
)
"""Participles without an object: a function says what it does to what."""


def gone(source: str) -> list[str]:
    """Words that are gone, in names, comments and docstrings."""
    kinds = (tokenize.NAME, tokenize.COMMENT, tokenize.STRING)
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return [m for t in tokens if t.type in kinds for m in GONE.findall(t.string)]


def gone_from_names(source: str) -> list[str]:
    """Names that have a part that is gone, and functions that are named by a participle alone."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    names = {t.string for t in tokens if t.type == tokenize.NAME} - OF_CONTRACT
    defined = {n.name for n in ast.walk(ast.parse(source)) if isinstance(n, ast.FunctionDef)}
    return sorted({n for n in names if GONE_FROM_NAMES.search(n)} | defined & GONE_FUNCTIONS)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_names_are_words_of_the_field(path):
    assert not gone_from_names(path.read_text())


@pytest.mark.parametrize("path", (PACKAGE / "diagnose").rglob("*.py"), ids=lambda p: p.stem)
def test_the_diagnosis_speaks_the_words_of_the_field(path):
    assert not gone(path.read_text())


def test_a_word_that_is_gone_is_found_in_names_and_docstrings():
    source = "def untold_thrust(board):\n    '''What flights foretell.'''\n"
    assert gone(source) == ["untold", "board", "foretell"]
    assert not gone("constraint = onboard\n")
    source = "def stated(told_N):\n    restated = 0\n"
    assert gone_from_names(source) == ["stated", "told_N"]


def test_words_that_are_gone_are_listed_with_those_that_replaced_them():
    listed = (ROOT / "docs/glossary.md").read_text().split("## Words that are gone")[1]
    assert all(word in listed for word in ("board", "foretell", "loose", "overtones", "strain"))
    assert all(word in listed for word in ("carrier", "cushion", "told", "twins", "composed"))
    assert all(word in listed for word in ("answer", "declared", "doubt", "found", "stranger"))


def _classes(folder: Path) -> Counter[str]:
    trees = (ast.parse(p.read_text()) for p in folder.rglob("*.py"))
    return Counter(n.name for t in trees for n in ast.walk(t) if isinstance(n, ast.ClassDef))


def test_a_class_has_a_name_of_its_own():
    package = Path(ges.__file__).parent
    assert not {name for name, n in _classes(package).items() if n > 1}
