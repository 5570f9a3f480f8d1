"""What a caller must know of an array stands in the docstring: its shape, and units of numbers."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import ges

ROOT = Path(ges.__file__).parent
ROOMS = ("diagnose", "simulator")
DIMENSION = r"\d*\s?[A-Za-z_]\w*(?: [+*-] \w+)*|\d+"
SHAPE = re.compile(rf"\((?:{DIMENSION}),(?: (?:{DIMENSION}),?)*\)")
"""``(n,)``, ``(n, 3)``, ``(2 half + 1,)``: symbols and numbers, no words between."""
UNIT = re.compile(
    r"_(?:1_)?(?:kg|m|s|rad|N|Nm|V|A|Hz|us|radii|sds)\d?(?:_(?:m|s|rad)\d?)*$|_N_s2$|_kg_m2$"
)


def _public(body: list[ast.stmt], of: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions of a module and methods of its classes whose names do not begin with ``_``."""
    for node in body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield of + node.name, node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public(node.body, f"{node.name}.")


def _arguments(function: ast.FunctionDef) -> list[ast.arg]:
    return [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]


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
