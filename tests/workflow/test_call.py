"""The script that every job runs, as Snakemake puts it together."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "workflow/scripts/call.py"
JOB = """
from types import SimpleNamespace
snakemake = SimpleNamespace(
    input={{}},
    output={{"out": {out!r}}},
    params={{"call": "job_of_test:work@state"}},
    log=[{log!r}],
    rule="work",
)
"""
WORK = '''
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

def work(out: Path) -> None:
    """Squares, made by processes that start anew."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, spawn) as pool:
        out.write_text(" ".join(map(str, pool.map(square, range(4)))))

def square(x: int) -> int:
    return x * x
'''


def test_a_job_may_start_processes(tmp_path):
    """They import the script again, and would call the function once more."""
    out, script = tmp_path / "out.txt", tmp_path / "job.py"
    (tmp_path / "job_of_test.py").write_text(WORK)
    preamble = JOB.format(out=str(out), log=str(tmp_path / "log"))
    script.write_text(preamble + SCRIPT.read_text())
    path = os.pathsep.join([str(tmp_path), *sys.path])
    done = subprocess.run(
        [sys.executable, script],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert out.read_text() == "0 1 4 9"
