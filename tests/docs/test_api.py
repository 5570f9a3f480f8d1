"""The entries of the page on Python say all that a caller needs; examples in docstrings run."""

import doctest
import importlib
import inspect
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

import ges

ROOT = Path(ges.__file__).parent
PAGE = Path(__file__).parents[2] / "docs/api.md"


def _entry(name: str) -> type:
    module, _, own = name.rpartition(".")
    return getattr(importlib.import_module(module), own)


ENTRIES = [_entry(name) for name in re.findall(r"^::: (\S+)$", PAGE.read_text(), flags=re.M)]


def _name(entry: type) -> str:
    return f"{entry.__module__}.{entry.__qualname__}"


def _section(doc: str, head: str) -> str:
    found = re.search(rf"^{head}\n-+\n(.*?)(?=^\w[\w ]*\n-+$|\Z)", doc, flags=re.M | re.S)
    return found[1] if found else ""


def _described(doc: str, head: str) -> set[str]:
    listed = re.findall(r"^(\w[\w, ]*) : ", _section(doc, head), flags=re.M)
    return {name.strip() for names in listed for name in names.split(",")}


@pytest.mark.parametrize("entry", ENTRIES, ids=_name)
def test_an_entry_describes_what_it_takes_and_gives(entry):
    doc = inspect.getdoc(entry) or ""
    if inspect.isclass(entry):
        fields = getattr(entry, "model_fields", getattr(entry, "__annotations__", {}))
        assert _described(doc, "Attributes") >= {f for f in fields if not f.startswith("_")}
    else:
        signature = inspect.signature(entry)
        assert _described(doc, "Parameters") == set(signature.parameters)
        assert bool(_section(doc, "Returns")) == (signature.return_annotation != "None")
    assert _section(doc, "Examples")


def _failures(examples: Iterable[doctest.DocTest]) -> int:
    runner = doctest.DocTestRunner(verbose=False)
    for test in examples:
        runner.run(test, clear_globs=False)
    return runner.failures


def test_examples_of_the_page_run_one_after_the_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    finder, names = doctest.DocTestFinder(recurse=False), {}
    ordered = [test for e in ENTRIES for test in finder.find(e, _name(e), globs=names)]
    for test in ordered:
        # what one defines the next may use
        test.globs = names
    assert not _failures(ordered)


@pytest.mark.parametrize(
    "path",
    sorted(p for p in ROOT.rglob("*.py") if ">>> " in p.read_text()),
    ids=lambda p: p.relative_to(ROOT).as_posix(),
)
def test_examples_elsewhere_run_alone(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")
    found = doctest.DocTestFinder().find(importlib.import_module(name), name)
    assert not _failures(test for test in found if test.name not in map(_name, ENTRIES))
