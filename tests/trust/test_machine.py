"""What a machine does to a program: full disks, kills, closed pipes, odd names. Each is done for
real; it ends well or in one sentence, and no part of a result is taken for a whole one.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import EXAMPLE, GES, contents, environment, one_sentence, run

from ges.blind.protocol.run import finished
from ges.conventions import MOST_NUMBERS
from ges.diagnose.report.saved import load_diagnosis
from ges.errors import GesError, UsageError
from ges.files import (
    NEW,
    read_kept,
    replacing_together,
    require_file,
    require_folder,
    require_text,
)
from ges.provenance.runs import load_manifest
from ges.recordings.readers import open_log
from ges.recordings.recording import load_set
from ges.ui.folder import Workspace

SHORT = ("simulate", EXAMPLE / "vehicle.yaml", "--duration", "1")


def limited(which: int, value: int):
    """A function that a child calls before it becomes ``ges``."""
    return lambda: resource.setrlimit(which, (value, value))


def full_at(kilobytes: int) -> dict:
    """Options of :func:`run` for a disk on which no file may get longer."""
    return {"preexec_fn": limited(resource.RLIMIT_FSIZE, 1000 * kilobytes)}


# A full disk.


def test_a_full_disk_names_the_file_and_leaves_no_part_of_it(tmp_path):
    out = tmp_path / "flight.parquet"
    said = one_sentence(run(*SHORT, "--out", out, **full_at(4)))
    assert said == f"ges: cannot read or write {out}: File too large"
    assert not list(tmp_path.iterdir())


def test_a_full_disk_leaves_no_half_of_a_set(tmp_path, small):
    """The vehicle and one flight would fit."""
    logs = sorted(small.glob("*.parquet"))
    words = ["import", *logs, "--vehicle", EXAMPLE / "vehicle.yaml", "--out", tmp_path / "set"]
    smallest = min(log.stat().st_size for log in logs)
    one_sentence(run(*words, **full_at(smallest // 1000 - 1)))
    assert not contents(tmp_path / "set")
    assert run(*words).returncode == 0
    assert len(load_set(tmp_path / "set").flights) == len(logs)


@pytest.mark.slow
@pytest.mark.parametrize("kilobytes", [4, 100, 1000])
def test_a_full_disk_keeps_the_diagnosis_that_was_there(tmp_path, small, known, kilobytes):
    """No figure fits, some do, or all but the page."""
    out = tmp_path / "out"
    out.mkdir()
    for name, data in known.items():
        (out / name).write_bytes(data)
    words = ["diagnose", small, "--out", out, "--set", "search.log_odds_offset=0.5"]
    assert "File too large" in one_sentence(run(*words, **full_at(kilobytes)))
    assert contents(out) == known


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount a file system")
def test_a_small_file_system(tmp_path, small):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", disk])
    if mounted.returncode:
        pytest.skip("no file system can be mounted here")
    try:
        said = one_sentence(run("diagnose", small, "--out", disk / "out"))
        assert "No space left on device" in said and not contents(disk / "out")
    finally:
        subprocess.run(["umount", disk], check=True)


# More than there is memory for.


@pytest.mark.parametrize(
    ("more", "code", "sentence"),
    [
        (["--duration", "1e6"], 2, "a manoeuvre lasts 191740 s at most"),
        (["--duration", "1000", "--set", "record_every=1", "--set", "dt_s=1e-5"], 1, "fly shorter"),
    ],
)
def test_a_flight_that_fits_into_no_memory_is_refused(tmp_path, more, code, sentence):
    words = [*SHORT[:2], *more, "--out", tmp_path / "flight.parquet"]
    assert sentence in one_sentence(run(*words), code)


def test_a_parquet_file_of_a_few_kilobytes_may_not_ask_for_gigabytes(tmp_path):
    """Of one value over and over: a thousandth of what it stands for, 8 bytes a number."""
    path, same = tmp_path / "flight.parquet", pa.array(np.zeros(2**19, dtype=np.int8))
    pq.write_table(pa.table({f"u_{k}": same for k in range(257)}), path, compression="zstd")
    assert MOST_NUMBERS < 2**19 * 257 and path.stat().st_size < MOST_NUMBERS / 200
    with pytest.raises(GesError, match="at most"):
        open_log(path)


# Places that cannot be written to.


@pytest.mark.parametrize(
    "words",
    [
        SHORT,
        ("calibrate", "missing"),
        ("compare", "missing", "missing", "--html"),
        ("diagnose", "missing", "--out", "new", "--write-flight"),
    ],
    ids=lambda words: words[0],
)
def test_a_file_that_cannot_be_written_is_said_before_the_work(tmp_path, words):
    """Before what does not exist is read."""
    (tmp_path / "taken").touch()
    (tmp_path / "folder").mkdir()
    option = () if words[-1].startswith("--") else ("--out",)
    for place, why in (("folder", "it is a folder"), ("taken/file", "taken: it is a file")):
        assert why in one_sentence(run(*words, *option, place, cwd=tmp_path))


REFUSED = "(Permission denied|Read-only file system)"


@pytest.fixture
def read_only(tmp_path):
    """A folder that nobody may write into; root may, unless its file system is read-only."""
    folder = tmp_path / "fixed"
    folder.mkdir()
    if os.geteuid():
        folder.chmod(0o555)
    elif subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", folder]).returncode:
        pytest.skip("no file system can be mounted here")
    yield folder
    if not os.geteuid():
        subprocess.run(["umount", folder], check=True)


def test_a_folder_that_is_read_only_is_said(read_only):
    for place, check in (("out", require_folder), ("flight.parquet", require_file)):
        with pytest.raises(GesError, match=f"{REFUSED} in .*fixed; name another"):
            check(read_only / place)
    said = one_sentence(run("diagnose", "missing", "--out", read_only / "out"))
    assert said.endswith("fixed; name another")


def test_a_file_system_that_takes_no_file_is_said_before_the_work():
    """Root may write by the permissions of /proc, and cannot."""
    said = one_sentence(run("diagnose", "missing", "--out", "/proc/xx"))
    assert "cannot write into the folder /proc/xx: " in said and said.endswith("name another")


def test_a_check_of_a_folder_leaves_nothing(tmp_path):
    require_folder(tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())


def test_a_diagnosis_does_not_go_into_a_recording_set(small):
    before = contents(small)
    said = one_sentence(run("diagnose", small, "--out", small))
    assert "a vehicle.yaml that no diagnosis wrote" in said and contents(small) == before


# Two writers, and writers that were killed.

WRITER = """
import sys, time
from pathlib import Path
from ges.files import replacing_together
for word in sys.argv[2:]:
    with replacing_together(Path(sys.argv[1]), last="z") as new:
        for name in "zabcdefgh":
            (new / name).write_text(word)
    print(word, flush=True)
"""


def writer(folder: Path, *words: str) -> subprocess.Popen:
    words = [sys.executable, "-c", WRITER, folder, *words]
    return subprocess.Popen(words, stdout=subprocess.PIPE, env=environment())


def test_a_folder_that_nothing_came_into_is_not_left(tmp_path):
    """An interrupt while the page was written left an empty one."""
    for folder, stays in ((tmp_path / "new", False), (tmp_path, True)):
        with pytest.raises(KeyboardInterrupt), replacing_together(folder, last="z") as new:
            (new / "a").write_text("half")
            raise KeyboardInterrupt
        assert folder.exists() == stays


def test_a_kill_leaves_files_of_one_writer_or_none_that_counts(tmp_path):
    """``z`` says that the others are whole."""
    draw, seen = random.Random(1), set()
    for _ in range(20):
        child = writer(tmp_path, *("one", "two") * 1000)
        assert child.stdout.readline()
        time.sleep(0.05 * draw.random())
        child.kill()
        child.communicate()
        found = contents_of(tmp_path)
        if "z" in found:
            assert len(set(found.values())) == 1 and len(found) == 9
        seen.add("z" in found)
    with replacing_together(tmp_path, last="z") as new:
        (new / "z").write_text("three")
    assert True in seen and not (tmp_path / NEW).exists()


def contents_of(folder: Path) -> dict[str, str]:
    return {p.name: p.read_text() for p in folder.iterdir() if p.is_file()}


def test_two_writers_do_not_mix(tmp_path):
    children = [writer(tmp_path, *[word] * 100) for word in ("one", "two")]
    for child in children:
        child.communicate(timeout=60)
    assert [child.returncode for child in children] == [0, 0]
    found = contents_of(tmp_path)
    assert len(set(found.values())) == 1 and len(found) == 9


def test_what_a_killed_import_left_is_no_flight(tmp_path, small):
    shutil.copytree(small, tmp_path / "set")
    (tmp_path / "set" / ".4711.runs_fast.parquet").write_bytes(b"PAR1")
    assert len(load_set(tmp_path / "set").flights) == 2


DAMAGED = ["", "{", "[1]", "null", '"text"', "\udcff", "[" * 5000]


@pytest.mark.parametrize("text", DAMAGED, ids=range(len(DAMAGED)))
def test_what_was_kept_and_is_damaged_is_made_again(tmp_path, text):
    kept = tmp_path / "run.json"
    kept.write_text(text, errors="surrogateescape")
    assert read_kept(kept, dict) == {} and not finished(tmp_path, "tool")
    with pytest.raises(GesError, match="manifest"):
        load_manifest(kept)
    with pytest.raises(GesError, match="diagnose the flights again|it is not text"):
        load_diagnosis(kept)


def test_a_folder_of_the_page_with_a_damaged_part(tmp_path):
    place = Workspace(tmp_path)
    good, bad = place.new_logs(), place.new_logs()
    (bad.path / "about.json").write_text("{")
    (good.path / "doctor.json").write_text("[{")
    assert [logs.id for logs in place.all_logs()] == [good.id] and good.examined() is None
    with pytest.raises(KeyError):
        place.logs(bad.id)


@pytest.mark.slow
def test_a_diagnosis_that_is_killed_at_any_moment(tmp_path, small, known):
    """What it draws with ends with it; done again, it is the same to the last byte.

    Killed between two renamings it leaves the folder of what is new, which the next run clears.
    """
    draw, out = random.Random(43), tmp_path / "out"
    words = [GES, "diagnose", small, "--out", "out"]
    for _ in range(8):
        child = subprocess.Popen(
            words, cwd=tmp_path, env=environment(OMP_NUM_THREADS="2"), stderr=subprocess.DEVNULL
        )
        time.sleep(draw.uniform(0.1, 8.0))
        child.kill()
        child.wait()
        placed = contents(out) if (out / "diagnosis.json").exists() else known
        assert {name: data for name, data in placed.items() if Path(name).parts[0] != NEW} == known
    assert run(*words[1:], cwd=tmp_path).returncode == 0
    assert contents(out) == known


# A person who stops it, and a reader who has seen enough.


@pytest.mark.slow
@pytest.mark.parametrize("cores", ["1", "2"])
def test_an_interrupt_of_a_diagnosis(tmp_path, small, cores):
    """At a terminal every process of the group is sent it: early, and once a stage has ended."""
    for stage in ("", "reading", "looking for physics"):
        child = subprocess.Popen(
            [GES, "diagnose", small, "--out", tmp_path / "out"],
            stderr=subprocess.PIPE,
            start_new_session=True,
            # a shell has what it starts in the background ignore interrupts
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
            env=environment(OMP_NUM_THREADS=cores),
        )
        if stage:
            assert any(line.startswith(stage.encode()) for line in child.stderr)
        else:
            # Python itself has started once the program imports; a busy machine takes its time
            maps, deadline = Path(f"/proc/{child.pid}/maps"), time.monotonic() + 60.0
            while "numpy" not in maps.read_text() and time.monotonic() < deadline:
                time.sleep(0.01)
        os.killpg(child.pid, signal.SIGINT)
        told = child.stderr.read()
        child.wait(timeout=60)
        assert child.returncode == 130 and b"Traceback" not in told
        assert told.endswith(b"ges: interrupted; what was not finished is not there\n")
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [("effects",), ("effects", "--markdown"), ("settings",)])
def test_a_reader_that_closes_the_pipe(words):
    child = subprocess.Popen(
        [GES, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()
    )
    child.stdout.readline()
    child.stdout.close()
    assert child.stderr.read() == b"" and child.wait(timeout=60) in (0, 1)


def test_a_full_disk_behind_standard_output():
    with open("/dev/full", "w") as full:
        told = run("effects", stdout=full, stderr=subprocess.PIPE, capture_output=False)
    assert "No space left on device" in one_sentence(told)


# Machines that are set up otherwise.


@pytest.mark.slow
def test_a_terminal_of_another_alphabet(tmp_path, known):
    """Units and exponents have letters that ASCII lacks."""
    (tmp_path / "diagnosis.json").write_bytes(known["diagnosis.json"])
    ascii_alone = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    for words in (["explain", "."], ["explain", ".", "rotor_drag"], ["compare", ".", "."]):
        told = run(*words, cwd=tmp_path, environ=ascii_alone)
        assert told.returncode == 0 and "rotor drag" in told.stdout, told.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "environ",
    [{"HOME": None}, {"HOME": "/nonexistent"}, {"LC_ALL": "C", "PYTHONUTF8": "0"}],
    ids=["no home", "missing home", "C"],
)
def test_a_diagnosis_without_a_home_or_a_language(tmp_path, small, known, environ):
    told = run("diagnose", small, "--out", "out", cwd=tmp_path, environ=environ)
    assert told.returncode == 0 and contents(tmp_path / "out") == known, told.stderr


@pytest.mark.slow
@pytest.mark.parametrize("cores", ["1", "2"])
def test_sixty_four_file_handles(tmp_path, small, known, cores):
    few = limited(resource.RLIMIT_NOFILE, 64)
    words = ["diagnose", small, "--out", "out"]
    told = run(*words, cwd=tmp_path, preexec_fn=few, environ={"OMP_NUM_THREADS": cores})
    assert told.returncode == 0 and contents(tmp_path / "out") == known, told.stderr


# Names.


@pytest.mark.parametrize("name", [b"new\nline", b"not utf8 \xff\xfe"])
def test_a_name_that_no_page_can_hold_is_refused(tmp_path, small, name):
    folder = tmp_path / "set"
    shutil.copytree(small, folder)
    log = os.fsencode(folder) + b"/" + name + b".parquet"
    (folder / "runs_fast.parquet").rename(os.fsdecode(log))
    for words in (["doctor", os.fsdecode(log)], ["diagnose", folder, "--out", tmp_path / "out"]):
        said = one_sentence(run(*words, errors="surrogateescape"), 2)
        assert "rename the file or folder" in said and said.isprintable()


@pytest.mark.parametrize("name", ["with spaces", "Flügel 飛行", "<script>alert(1)</script>", "-rf"])
def test_a_name_that_people_give_is_taken(name):
    require_text(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["with spaces", "Flügel\u3000飛行", "<script>alert(1)<"])
def test_a_diagnosis_of_flights_with_odd_names(tmp_path, small, name):
    folder = tmp_path / name
    folder.mkdir()
    for i, log in enumerate(sorted(small.glob("*.parquet"))):
        shutil.copyfile(log, folder / f"{name} {i}.parquet")
    shutil.copyfile(small / "vehicle.yaml", folder / "vehicle.yaml")
    told = run("diagnose", name, "--out", f"out {name}", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert "<script>alert" not in (tmp_path / f"out {name}" / "report.html").read_text()


@pytest.mark.parametrize("name", ["a\x00b", "a\nb", "a\udcff", "\x1b[2J", "\x9b31m"])
def test_letters_that_are_none(name):
    with pytest.raises(UsageError, match="rename"):
        require_text(name)
