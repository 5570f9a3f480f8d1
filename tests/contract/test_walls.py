"""The whole house: a package of ``ges`` imports from those below it, and none from above."""

import ast
from pathlib import Path

import pytest

import ges

ROOT = Path(ges.__file__).parent
FLOORS = (
    {"__init__", "conventions", "errors", "files", "plain_yaml", "threads"},
    {"simulator"},
    {"vehicle"},
    {"recordings"},
    {"diagnose"},
    {"examine"},
    {"study"},
    {"provenance"},
    {"blind", "paper"},
    {"ui"},
    {"commands"},
    {"cli"},
)
"""From the ground up."""
FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}
FILES = sorted(ROOT.rglob("*.py"))


def _package(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def _imported(path: Path) -> set[str]:
    """Packages of ``ges`` that a file imports, within functions too."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module]
            if node.module == "ges":
                names = [f"ges.{a.name}" for a in node.names]
        elif isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        else:
            continue
        found |= {n.split(".")[1] for n in names if n.startswith("ges.")}
    return found & FLOOR_OF.keys()


def test_every_package_has_a_floor():
    assert {_package(p) for p in FILES} == FLOOR_OF.keys()


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_downward(path):
    own = _package(path)
    if own == "__init__":
        return
    above = {n for n in _imported(path) if FLOOR_OF[n] > FLOOR_OF[own]}
    beside = {n for n in FLOORS[FLOOR_OF[own]] if FLOOR_OF[own] and n != own} & _imported(path)
    assert not above | beside
