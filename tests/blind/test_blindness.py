"""Every way to cheat that we could think of, tried in the very process that a diagnosis runs in."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

import ges
from ges.blind.protocol import jail, run, seal
from ges.errors import GesError
from ges.simulator._lib import library_path

KERNEL = textwrap.dedent("""
    import ctypes, sys
    sys.exit(0 if ctypes.CDLL(None).syscall(444, None, 0, 1) >= 1 else 1)
""")
LANDLOCK = subprocess.run([sys.executable, "-c", KERNEL]).returncode == 0
ROUTES = {
    "open": "open(target).read()",
    "os.open": "import os; os.read(os.open(target, os.O_RDONLY), 10)",
    "pathlib": "import pathlib; pathlib.Path(target).read_text()",
    "numpy": "import numpy; numpy.fromfile(target, dtype='u1')",
    "memory map": "import numpy; numpy.memmap(target)",
    "list the folder": "import os; os.listdir(os.path.dirname(target))",
    "walk": "import os; next(os.scandir(os.path.dirname(target)))",
    "another program": "import subprocess; subprocess.run(['/bin/cat', target], check=True)",
    "a shell": "import os; assert os.system('cat ' + target) == 0",
    "symbolic link": "import os; os.symlink(target, out + '/link'); open(out + '/link').read()",
    "generator's source": "import ges.blind.generator.grid",
    "seed in the tests": f"open({str(Path(__file__))!r}).read()",
    "parent's command line": "import os; open(f'/proc/{os.getppid()}/cmdline').read()",
    "parent's environment": "import os; open(f'/proc/{os.getppid()}/environ').read()",
    "own memory map of others": "import os; os.listdir('/proc')",
    "network": "import socket; socket.create_connection(('127.0.0.1', 9), 1)",
}
KERNEL_ROUTES = {
    "C library": (
        "import ctypes; c = ctypes.CDLL(None); c.fopen.restype = ctypes.c_void_p; assert"
        " c.fopen(target.encode(), b'r')"
    ),
    "Arrow in C++": "import pyarrow as pa; pa.OSFile(target).read()",
    "C++ listing": (
        "from pyarrow import fs;"
        " fs.LocalFileSystem().get_file_info(fs.FileSelector(target.rsplit('/', 1)[0]))"
    ),
}


def _locked(tmp_path: Path, code: str, target: str) -> subprocess.CompletedProcess:
    case, out = tmp_path / "case", tmp_path / "out"
    for folder in (case, out):
        folder.mkdir(exist_ok=True)
    program = textwrap.dedent(f"""
        import sys
        from pathlib import Path
        from ges.blind.protocol import jail
        target, out = {target!r}, {str(out)!r}
        jail.lock_in([Path({str(case)!r}), *jail.interpreter(), *jail.package()], [Path(out)])
        print("locked", flush=True)
    """)
    return subprocess.run(
        [sys.executable, "-I", "-c", program + code], capture_output=True, text=True, cwd=tmp_path
    )


@pytest.mark.parametrize("route", ROUTES)
def test_cheating_fails(tmp_path, route):
    secret = tmp_path / "sealed" / "truth.json"
    secret.parent.mkdir()
    secret.write_text('{"verdict": "physics"}')
    done = _locked(tmp_path, ROUTES[route], str(secret))
    assert "locked" in done.stdout, done.stderr
    assert done.returncode != 0
    last = done.stderr.splitlines()[-1]
    assert any(
        word in last
        for word in (
            "PermissionError",
            "ModuleNotFoundError",
            "ImportError",
            "a diagnosis under test",
        )
    ), last


@pytest.mark.skipif(
    not LANDLOCK, reason="this kernel has no Landlock; the interpreter's wall stands alone"
)
@pytest.mark.parametrize("route", KERNEL_ROUTES)
def test_cheating_in_compiled_code_fails(tmp_path, route):
    secret = tmp_path / "sealed" / "truth.json"
    secret.parent.mkdir()
    secret.write_text("{}")
    done = _locked(tmp_path, KERNEL_ROUTES[route], str(secret))
    assert "locked" in done.stdout and done.returncode != 0, done.stderr


def test_what_is_given_can_be_read(tmp_path):
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "a.txt").write_text("given")
    code = (
        f"assert open({str(tmp_path / 'case' / 'a.txt')!r}).read() == 'given'; open(out + '/b.txt',"
        " 'w').write('made')"
    )
    done = _locked(tmp_path, code, "")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "b.txt").read_text() == "made"


def test_copy_tells_nothing(tmp_path):
    """File names, times, metadata, vehicle name and stray files of a case do not reach the
    diagnosis.
    """
    case, given = tmp_path / "cut_propeller_rotor3", tmp_path / "given"
    case.mkdir()
    given.mkdir()
    table = pa.table({"t_s": [0.0, 0.1]}).replace_schema_metadata({"truth": "weak_rotor"})
    pq.write_table(table, case / "weak_rotor.parquet")
    pq.write_table(pa.table({"t_s": [0.0, 0.2]}), case / "healthy.parquet")
    (case / "notes.txt").write_text("rotor 3 is cut")
    (case / "vehicle.yaml").write_text(
        yaml.safe_dump({"name": "cut rotor 3", "terrain": {"kind": "flat", "z_m": 0.0}})
    )
    os.utime(case / "weak_rotor.parquet", (1e9, 1e9))
    run.anonymous(case, given)
    assert sorted(p.name for p in given.iterdir()) == [
        "flight_1.parquet",
        "flight_2.parquet",
        "vehicle.yaml",
    ]
    assert {p.stat().st_mtime for p in given.iterdir()} == {0.0}
    assert all(pq.read_schema(p).metadata is None for p in given.glob("*.parquet"))
    assert "cut" not in (given / "vehicle.yaml").read_text()


def test_process_is_told_nothing(tmp_path, monkeypatch):
    """Environment, arguments and working folder of the worker name neither the folder nor
    the case.
    """
    seen = {}

    def spy(command, **keywords):
        seen.update(command=command, **keywords)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setenv("PROOF_TRUTH", "weak_rotor")
    monkeypatch.setattr(run.subprocess, "run", spy)
    case = tmp_path / "proof" / "cases" / "telltale"
    case.mkdir(parents=True)
    (case / "vehicle.yaml").write_text("name: x\n")
    run._one(case, tmp_path / "proof" / "diagnosed" / "telltale", {}, "tool")
    told = json.dumps(
        [
            seen["command"],
            {k: v for k, v in seen["env"].items() if k != "GES_LIBRARY"},
            str(seen["cwd"]),
        ]
    )
    assert "telltale" not in told and "PROOF_TRUTH" not in told and str(tmp_path) not in told


def test_the_package_that_vouches_for_a_verdict_makes_it(tmp_path):
    """A copy of the sources beside an installation: its run must not be diagnosed by what is
    installed.
    """
    copy = tmp_path / "src" / "ges"
    shutil.copytree(
        Path(run.__file__).parents[2], copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    worker = copy / "blind" / "protocol" / "worker.py"
    worker.write_text(
        worker.read_text().replace("sys.exit(main(", "sys.exit('the copy' or main(", 1)
    )
    for name in ("given", "made", "home"):
        (tmp_path / name).mkdir()
    code = (
        "from pathlib import Path; from ges.blind.protocol import run;"
        " print(run._process(Path('given'), Path('made'), Path('home'), {}))"
    )
    env = {"PYTHONPATH": str(copy.parent), "GES_LIBRARY": str(library_path()), "PATH": os.defpath}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True
    )
    assert done.stdout.strip() == "the copy", done.stderr


def test_made_files_bear_no_time(proof):
    assert {p.stat().st_mtime for p in (proof / "cases").rglob("*")} == {0.0}


def test_planted_case_is_refused(proof, tmp_path):
    folder = _copy(proof, tmp_path)
    (folder / "cases" / "planted").mkdir()
    with pytest.raises(GesError, match="planted.*must be sealed before"):
        run.run_cases(folder)


def test_unsealed_folder_is_refused(proof, tmp_path):
    folder = _copy(proof, tmp_path)
    (folder / "sealed" / seal.SUMS).unlink()
    with pytest.raises(GesError, match="must be sealed before"):
        run.run_cases(folder)


def test_changed_recording_is_refused(proof, tmp_path):
    folder = _copy(proof, tmp_path)
    flight = next((folder / "cases").rglob("*.parquet"))
    flight.write_bytes(flight.read_bytes() + b"x")
    with pytest.raises(GesError, match="has changed since"):
        run.run_cases(folder)


def test_changed_truth_is_refused(proof, tmp_path):
    folder = _copy(proof, tmp_path)
    path = next((folder / "sealed").glob("0*.json"))
    path.write_text(path.read_text().replace("verdict", "Verdict"))
    with pytest.raises(GesError, match="has changed since"):
        seal.check(folder, list(seal.listed(folder)))


def test_folder_that_all_may_read_is_refused(monkeypatch, proof):
    monkeypatch.setattr(jail, "interpreter", lambda: [proof.resolve().parent])
    with pytest.raises(GesError, match="move the cases elsewhere"):
        run.run_cases(proof)


def test_diagnosis_does_not_import_the_generator():
    from ges.provenance.sources import sources

    root = Path(ges.__file__).parent
    assert not [p for p in sources("ges.diagnose.pipeline") if p.is_relative_to(root / "blind")]


def _copy(proof: Path, tmp_path: Path) -> Path:
    import shutil

    return Path(shutil.copytree(proof, tmp_path / "proof"))
