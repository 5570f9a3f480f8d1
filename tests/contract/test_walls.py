"""The whole house: a package of ``ges`` imports from those below it and none from above, and no
modules import each other in a circle.
"""

import ast
import graphlib
from pathlib import Path

import pytest

import ges

ROOT = Path(ges.__file__).parent
FLOORS = (
    {"__init__", "conventions", "errors", "extras", "files", "plain_yaml", "threads"},
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
    {"__main__"},
)
"""From the ground up."""
FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}
FILES = sorted(ROOT.rglob("*.py"))


def _package(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def _module(path: Path) -> str:
    return ".".join(("ges", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(
        ".__init__"
    )


MODULES = {_module(p): p for p in FILES}


def _modules_imported(path: Path) -> set[str]:
    """Modules of ``ges`` that a file imports when it runs, within functions too."""
    found: set[str] = set()
    nodes = [ast.parse(path.read_text())]
    while nodes:
        node = nodes.pop()
        # two classes may name each other's types: that ties no module to another
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        nodes += ast.iter_child_nodes(node)
        if isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path} imports relatively"
            of = node.module
            found |= {n if (n := f"{of}.{a.name}") in MODULES else of for a in node.names}
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
    return found & MODULES.keys()


def _imported(path: Path) -> set[str]:
    """Packages of ``ges`` that a file imports."""
    return {m.split(".")[1] for m in _modules_imported(path) if "." in m}


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


def test_no_modules_import_each_other_in_a_circle():
    # CycleError names the modules
    graphlib.TopologicalSorter({m: _modules_imported(p) for m, p in MODULES.items()}).prepare()
