"""Rooms of the diagnosis: arrows point downward, and no effect is named outside of detectors."""

import ast
from pathlib import Path

import pytest

import ges
from ges.simulator import effects

ROOT = Path(ges.__file__).parent / "diagnose"
ROOMS = (
    "types",
    "prepare",
    "library",
    "design",
    "select",
    "estimate",
    "detectors",
    "locate",
    "decide",
    "advise",
    "prove",
    "report",
    "calibrate",
)
"""From the ground floor up: a room imports from those before it."""
FILES = sorted(ROOT.rglob("*.py"))


def _room(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return parts[0] if len(parts) > 1 else ""


def test_every_folder_is_a_room():
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert folders == set(ROOMS)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_downward(path):
    room = _room(path)
    above = ROOMS[ROOMS.index(room) + 1 :] if room else ()
    imported = {
        node.module.split(".")[2]
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ges.diagnose.")
    }
    assert not imported & set(above)
    assert not room or "pipeline" not in imported


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_effect_is_named_outside_of_detectors(path):
    """What a search must know of an effect stands in its descriptor."""
    if _room(path) == "detectors":
        return
    named = {
        node.value
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert not {text for text in named if text.split(".")[0] in effects.table()}


SEE_HELD_OUT = {"", "prepare", "prove", "report"}
"""Rooms that may touch held-out flights: they are set aside, compared at the end, and drawn."""


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_what_decides_sees_no_flight_that_is_held_out(path):
    """Nor does what fits, searches or locates: ``Problem.held_out`` is read in few rooms."""
    touched = {
        node.attr
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
    }
    assert "held_out" not in touched or _room(path) in SEE_HELD_OUT


def test_the_pipeline_is_a_table_of_contents():
    """Docstrings aside."""
    text = (ROOT / "pipeline.py").read_text()
    parts = [
        ast.get_docstring(n, clean=False) or ""
        for n in ast.walk(ast.parse(text))
        if isinstance(n, ast.FunctionDef | ast.Module)
    ]
    assert len(text.splitlines()) - sum(len(p.splitlines()) for p in parts) <= 105
