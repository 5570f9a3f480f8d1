"""The documentation site is built without a warning, with its notebook run; what its first pages
tell a reader to type exists.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
import yaml

from ges.cli import cli

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FIRST = sorted((DOCS / "first").glob("*.md"))


def commands(page: Path) -> list[list[str]]:
    """Words of each ``ges`` command in the code of a page."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page.read_text(), flags=re.M | re.S)
    lines = re.sub(r"\\\n", " ", "".join(blocks)).splitlines()
    return [re.split(r" [>#] ?|  +#", line)[0].split() for line in lines if line.startswith("ges ")]


@pytest.mark.parametrize("page", [DOCS / "index.md", *FIRST], ids=lambda p: p.name)
def test_commands_of_the_first_pages_have_their_verbs_and_options(page):
    assert commands(page)
    for _, verb, *words in commands(page):
        command = cli.get_command(None, verb)
        assert command, verb
        if isinstance(command, click.Group):
            command = command.get_command(None, words[0])
        known = {option for p in command.params for option in (*p.opts, *p.secondary_opts)}
        assert {w for w in words if w.startswith("--")} <= known, (verb, words)


def test_every_page_has_its_place():
    def files(entries):
        for entry in entries:
            for place in entry.values():
                yield from files(place) if isinstance(place, list) else [place]

    placed = sorted(files(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]))
    there = [*DOCS.rglob("*.md"), DOCS / "example.py"]
    assert placed == sorted(p.relative_to(DOCS).as_posix() for p in there)


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path):
    words = ["build", "--strict", "--site-dir", tmp_path / "site"]
    done = subprocess.run(
        [Path(sys.executable).parent / "mkdocs", *words],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    notebook = (tmp_path / "site" / "example" / "index.html").read_text()
    assert "Missing in the simulator: rotor drag" in notebook and "data:image/png" in notebook
    method = (tmp_path / "site" / "method" / "index.html").read_text()
    assert "<math" in method and "arithmatex" not in method
    api = (tmp_path / "site" / "api" / "index.html").read_text()
    assert "describe_log" in api and ":func:" not in api
