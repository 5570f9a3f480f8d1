"""The interface of the compiled simulator with sanitizers: by Python, and by its own program."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import environment
from hypothesis import given
from hypothesis import strategies as st
from strategies import damaged_bytes, examples

HERE = Path(__file__).parent
SCRIPT = b"""\
columns t_s p_z_m
flight
duration_s = 0.02
mass_kg = 1.1
rotors = 6
control = 1
effect rotor_drag
effect.rotor_drag.k_kg = 1e-4
term 2 0 0.1 V_x R |V_x| near:1,2,0.5
flight
terrain_kind = 0
duration_s = 1e-2
"""


@pytest.mark.slow
def test_the_interface(sanitized, tmp_path):
    asan = subprocess.run(
        [os.environ.get("CC", "cc"), "-print-file-name=libasan.so"], capture_output=True, text=True
    )
    environ = environment(
        LD_PRELOAD=asan.stdout.strip(),
        ASAN_OPTIONS="detect_leaks=0:allocator_may_return_null=1",
        GES_LIBRARY=str(sanitized / "libges.so"),
    )
    last = tmp_path / "last.txt"
    told = subprocess.run(
        [sys.executable, HERE / "fuzz_library.py", last],
        capture_output=True,
        text=True,
        env=environ,
    )
    assert told.stdout.endswith("done\n"), f"{told.stderr[-4000:]}\nafter {last.read_text()[:2000]}"


LINES = st.sampled_from(
    [
        *("columns", "columns " + "p_z_m " * 300, "flight", "effect nothing", "effect.a", "= 1"),
        *("rotors = nan", "control = 1e300", "rotors = -1e9", "duration_s = 1e300", "dt_s = 0"),
        *("record_every = nan", "term 9 9 x", "term 2 0 nan " + "V_x " * 60, "inputs /dev/null"),
        *("seed = -1", "terrain_kind = 2", "term 1 0 1 |", "flight\n" * 30, "x" * 9000),
    ]
)


@pytest.mark.slow
@examples(400)
@given(damaged_bytes(SCRIPT), st.lists(LINES, max_size=3), st.integers(0, 14))
def test_the_program(sanitized, tmp_path_factory, damaged, more, place):
    script = tmp_path_factory.getbasetemp() / "flights.txt"
    lines = damaged.split(b"\n")
    lines[place:place] = [line.encode() for line in more]
    script.write_bytes(b"\n".join(lines))
    told = subprocess.run(
        [sanitized / "ges_sim", script, "--out", script.with_suffix(".raw")],
        capture_output=True,
        env=os.environ | {"ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1"},
        timeout=60,
    )
    assert told.returncode in (0, 1) and b"ERROR" not in told.stderr, told.stderr[-3000:]
    assert b"runtime error" not in told.stderr, told.stderr[-3000:]
    if told.returncode:
        assert told.stderr.startswith(b"ges_sim: "), told.stderr
