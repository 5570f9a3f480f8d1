"""What a caller must know stands in the docstring: sections, shapes of arrays, units of numbers; in
short sentences.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from prose import docstring_sentences

import ges

ROOT = Path(ges.__file__).parent
ROOMS = ("blind", "diagnose", "recordings", "simulator", "study", "vehicle")
ROOMS_WITH_SECTIONS = (
    ".",
    "blind",
    "commands",
    "diagnose",
    "paper",
    "provenance",
    "recordings",
    "simulator",
    "study",
    "ui",
    "vehicle",
)
"""Folders of the package whose docstrings are complete; "." are its own modules."""
LEAST_SHARE = 0.8
LONGEST_SENTENCE_WORDS = 25
WITHOUT_SECTIONS = re.compile(r"\.(command|group)\b|\b(cached_)?property\b")
SECTION = re.compile(
    r"^(Parameters|Attributes|Returns|Yields|Raises|Notes|References|Examples)\n-{3,}$", re.M
)
DIMENSION = r"\d*\s?[A-Za-z_]\w*(?: [+*-] \w+)*|\d+"
SHAPE = re.compile(rf"\((?:{DIMENSION}),(?: (?:{DIMENSION}),?)*\)")
"""``(n,)``, ``(n, 3)``, ``(2 half + 1,)``: symbols and numbers, no words between."""
UNIT = re.compile(
    r"_(?:1_)?(?:kg|m|s|rad|N|Nm|V|A|Hz|us|radii|sds)\d?(?:_(?:m|s|rad)\d?)*$|_N_s2$|_kg_m2$"
)

PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+$|\Z)", re.M | re.S)
ENTRY = re.compile(r"^\*{0,2}(\w[\w, ]*) : ", re.M)


def _public(body: list[ast.stmt], of: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions of a module and methods of its classes whose names do not begin with ``_``."""
    for node in body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield of + node.name, node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public(node.body, f"{node.name}.")


def _arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[ast.arg]:
    a = function.args
    of_all = [*a.posonlyargs, *a.args, a.vararg, *a.kwonlyargs, a.kwarg]
    return [one for one in of_all if one is not None and one.arg not in ("self", "cls")]


def _takes_or_returns_arrays(function: ast.FunctionDef) -> bool:
    annotations = [*(a.annotation for a in _arguments(function)), function.returns]
    return any("np.ndarray" in ast.unparse(a) for a in annotations if a is not None)


FUNCTIONS = {
    f"{path.relative_to(ROOT)}:{name}": function
    for room in ROOMS
    for path in sorted((ROOT / room).rglob("*.py"))
    for name, function in _public(ast.parse(path.read_text(encoding="utf-8")).body)
    if _takes_or_returns_arrays(function)
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_of_arrays_names_a_shape(name):
    assert SHAPE.search(ast.get_docstring(FUNCTIONS[name]) or "")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_number_tells_its_unit_by_name_or_in_words(name):
    function = FUNCTIONS[name]
    words = set(re.findall(r"\w+", ast.get_docstring(function) or ""))
    numbers = [
        a.arg
        for a in _arguments(function)
        if a.annotation is not None and re.search(r"^float\b", ast.unparse(a.annotation))
    ]
    assert not [n for n in numbers if not UNIT.search(n) and n not in words]


def test_a_sentence_in_brackets_is_no_shape():
    assert SHAPE.search("rates (n, 3)") and SHAPE.search("weights (2 half + 1,)")
    assert not SHAPE.search("stopped for long (no row, or motion not logged)")
    assert not SHAPE.search("means (averages)")


def _files(room: str) -> list[Path]:
    return sorted((ROOT / room).glob("*.py" if room == "." else "**/*.py"))


def _counted(
    body: list[ast.stmt], of: str = ""
) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]]:
    """Public functions and classes, but for commands, whose docstring is their help, and
    properties, which take one line.
    """
    for node in body:
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        decorators = " ".join(map(ast.unparse, node.decorator_list))
        if node.name.startswith("_") or WITHOUT_SECTIONS.search(decorators):
            continue
        yield of + node.name, node
        if isinstance(node, ast.ClassDef):
            yield from _counted(node.body, f"{node.name}.")


@pytest.mark.parametrize("room", ROOMS_WITH_SECTIONS)
def test_most_public_functions_and_classes_have_sections(room):
    public = {
        f"{path.relative_to(ROOT)}:{name}": SECTION.search(ast.get_docstring(node) or "")
        for path in _files(room)
        if not re.match(r"_[a-z]", path.name)
        for name, node in _counted(ast.parse(path.read_text(encoding="utf-8")).body)
    }
    bare = [name for name, section in public.items() if not section]
    assert len(bare) <= (1.0 - LEAST_SHARE) * len(public), "\n".join(bare)


@pytest.mark.parametrize("room", ROOMS_WITH_SECTIONS)
def test_no_sentence_of_a_docstring_is_long(room):
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    long = [
        f"{path.relative_to(ROOT)}: {sentence}"
        for path in _files(room)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, kinds)
        for sentence in docstring_sentences(ast.get_docstring(node) or "")
        if len(sentence.split()) > LONGEST_SENTENCE_WORDS
    ]
    assert not long, "\n".join(long)


@pytest.mark.parametrize("room", ROOMS_WITH_SECTIONS)
def test_parameters_are_those_that_the_function_takes(room):
    wrong = []
    for path in _files(room):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            if section := PARAMETERS.search(ast.get_docstring(node) or ""):
                named = {n.strip() for names in ENTRY.findall(section[1]) for n in names.split(",")}
                if named != {a.arg for a in _arguments(node)}:
                    wrong.append(f"{path.relative_to(ROOT)}:{node.name}")
    assert not wrong, "\n".join(wrong)
