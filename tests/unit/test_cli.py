"""The command line: every verb explains itself, and nothing ends in a traceback."""

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from ges.cli import cli

ROOT = Path(__file__).resolve().parents[2]
GES = Path(sys.executable).parent / "ges"
VERBS = cli.list_commands(None)


@pytest.mark.parametrize("verb", VERBS)
def test_help_shows_an_example(verb):
    result = CliRunner().invoke(cli, [verb, "--help"])
    assert result.exit_code == 0, result.output
    assert "Example" in result.output and f"ges {verb}" in result.output


@pytest.mark.parametrize("verb", ["simulate", "effects", "import", "bench"])
def test_fixed_verbs_are_there(verb):
    assert verb in VERBS


def run(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run([GES, *words], capture_output=True, text=True, cwd=ROOT)


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (["nonsense"], 2, "No such command"),
        (["effects", "rotor_drg"], 2, "did you mean 'rotor_drag'?"),
        (
            ["simulate", "missing.yaml", "--out", "x.parquet"],
            1,
            "cannot read the vehicle file missing.yaml",
        ),
        (
            ["simulate", "appius", "--plan", "climb", "--out", "x"],
            2,
            "did you mean 'climbs'?",
        ),
        (
            ["simulate", "appius", "--set", "dt_s=fast", "--out", "x"],
            2,
            "expected NAME=NUMBER",
        ),
        (
            ["simulate", "appius", "--set", "mass=1", "--out", "x"],
            2,
            "unknown parameter 'mass'",
        ),
        (
            ["simulate", "appius", "--set", "dt_s=-1", "--out", "x"],
            1,
            "dt_s is -1 s; allowed is",
        ),
    ],
)
def test_wrong_use_ends_in_a_sentence(words, code, sentence):
    result = run(*words)
    assert result.returncode == code
    assert sentence in result.stderr
    assert "Traceback" not in result.stderr


def test_missing_simulator_says_how_to_build_it(tmp_path):
    command = [GES, "effects"]
    environment = {"PATH": "/usr/bin:/bin", "GES_LIBRARY": str(tmp_path / "libges.so")}
    result = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (
        result.returncode == 1
        and "make build" in result.stderr
        and "Traceback" not in result.stderr
    )


def test_missing_compiler_is_named_before_anything_is_downloaded():
    result = subprocess.run(
        ["make", "CC=no-such-cc", "check-cc"], capture_output=True, text=True, cwd=ROOT
    )
    assert result.returncode == 2
    assert "no C compiler 'no-such-cc' found" in result.stderr


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("flight\nmass = 1\n", "unknown parameter"),
        ("mass_kg = 1\n", "say 'flight'"),
        ("flight\nmass_kg = heavy\n", "not a number"),
        ("flight\neffect nothing\n", "unknown effect"),
        ("columns nothing\nflight\n", "unknown column"),
        ("", "no flight"),
        ("flight\nmass_kg = -1\n", "mass_kg is -1 kg"),
    ],
)
def test_ges_sim_names_line_and_problem(tmp_path, text, sentence):
    script = tmp_path / "flights.txt"
    script.write_text(text)
    result = subprocess.run([ROOT / "build" / "ges_sim", script], capture_output=True, text=True)
    assert result.returncode == 1
    assert sentence in result.stderr
