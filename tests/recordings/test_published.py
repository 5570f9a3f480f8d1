"""``ges recordings``: what the package holds, what is fetched once, and a source that is silent."""

from __future__ import annotations

from importlib import resources

import pytest
from click.testing import CliRunner

from ges.cli import cli
from ges.errors import GesError
from ges.files import sha256
from ges.recordings import published


@pytest.mark.parametrize("name", published.SHIPPED)
def test_a_shipped_set_is_copied_whole(name, tmp_path):
    done = CliRunner().invoke(cli, ["recordings", "fetch", name, "--out", str(tmp_path)])
    assert done.exit_code == 0
    folder = resources.files("ges.recordings") / name
    there = {p.relative_to(folder) for p in folder.rglob("*") if p.is_file()}
    assert there == {
        p.relative_to(tmp_path / name) for p in (tmp_path / name).rglob("*") if p.is_file()
    }
    assert name in CliRunner().invoke(cli, ["recordings", "list"]).output


def test_a_file_as_published_is_not_fetched_again(tmp_path, monkeypatch):
    (tmp_path / "copies").mkdir()
    (tmp_path / "copies/log").write_bytes(b"a flight")
    source = published.Source(
        repository="nobody/nothing",
        commit="0" * 40,
        licence="MIT",
        about="",
        files={"log": ("there/log", sha256(tmp_path / "copies/log"))},
    )
    monkeypatch.setattr(published, "sources", lambda: {"one": source})
    (path,) = published.fetch("one", tmp_path / "out", tmp_path / "copies")
    before = path.stat().st_mtime_ns
    assert list(published.fetch("one", tmp_path / "out", None)) == [path]
    assert path.stat().st_mtime_ns == before
    # one that was changed since is
    path.write_bytes(b"another flight")
    list(published.fetch("one", tmp_path / "out", tmp_path / "copies"))
    assert path.read_bytes() == b"a flight"


def test_a_source_that_does_not_answer_is_given_up(tmp_path, monkeypatch):
    asked = []

    def silent(address, timeout):
        asked.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr("urllib.request.urlopen", silent)
    with pytest.raises(GesError, match="cannot fetch aurelappius"):
        list(published.fetch("appius-ground-effect", tmp_path, None, 0.5))
    assert asked == [0.5] and not list(tmp_path.rglob("*.csv"))
