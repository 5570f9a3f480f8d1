"""The command line: every verb explains itself, and nothing ends in a traceback."""

import errno
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from ges import __version__
from ges.cli import INTERRUPTED, cli, main

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


def test_the_package_runs_as_a_module():
    words = [sys.executable, "-m", "ges", "--version"]
    result = subprocess.run(words, capture_output=True, text=True, cwd=ROOT)
    assert result.returncode == 0 and __version__ in result.stdout


def test_help_waits_for_no_package_that_it_does_not_need():
    code = "import sys; from ges.cli import cli; cli(['--help'], standalone_mode=False)"
    result = subprocess.run(
        [sys.executable, "-c", f"{code}; print(*sys.modules)"], capture_output=True, text=True
    )
    imported = set(result.stdout.splitlines()[-1].split())
    assert "ges.commands.simulate" in imported
    assert not imported & {"pandas", "scipy", "sklearn", "matplotlib", "torch"}


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (["diagnoze"], 2, "unknown command 'diagnoze'; did you mean 'diagnose'?"),
        (["nonsense"], 2, "unknown command 'nonsense'; known: bench, blind, "),
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
            ["simulate", "appius", "--set", "rotors=inf", "--out", "x"],
            2,
            "rotors is inf; allowed is 1 to 16",
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


@pytest.mark.parametrize("verb", ["diagnose", "import"])
def test_a_folder_that_cannot_be_written_is_said_before_the_work(verb, tmp_path):
    """Neither reads what it was given first: there is no such log."""
    taken = tmp_path / "report"
    taken.touch()
    more = ["--vehicle", "appius"] if verb == "import" else []
    source = tmp_path / "flight.csv"
    source.touch()
    told = run(verb, str(source), *more, "--out", str(taken))
    assert told.returncode == 1 and "Traceback" not in told.stderr
    assert f"cannot write into the folder {taken}: it is a file; name another" in told.stderr


def _entered(monkeypatch, failure):
    """Exit code and words of the entry point when a verb fails so."""

    def failing(**_):
        raise failure

    monkeypatch.setattr(type(cli), "__call__", lambda self, **words: failing(**words))
    with pytest.raises(SystemExit) as left:
        main()
    return left.value.code


def test_a_full_disk_is_one_sentence(monkeypatch, capsys):
    code = _entered(monkeypatch, OSError(errno.ENOSPC, "no matter", "out/residuals.parquet"))
    assert code == 1
    assert capsys.readouterr().err == (
        "ges: cannot read or write out/residuals.parquet: No space left on device\n"
    )


def test_a_mistake_of_the_program_stays_visible(monkeypatch):
    with pytest.raises(OSError, match="no number"):
        _entered(monkeypatch, OSError("no number"))


def test_an_interrupt_exits_as_shells_have_it(tmp_path):
    """In the middle of the work, and no part of a file stays."""
    words = [GES, "bench", "sim", "--duration", "1000"]
    child = subprocess.Popen(
        words,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=tmp_path,
        # a shell in the background starts its children deaf to it, and so these tests
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(3.0)
    child.send_signal(signal.SIGINT)
    _, told = child.communicate(timeout=60)
    assert child.returncode == INTERRUPTED and b"interrupted" in told, told
    assert b"Traceback" not in told and not list(tmp_path.iterdir())
