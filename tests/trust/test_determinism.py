"""The same flights give the same bytes, whatever the machine is set to. Order and names of flights
are those of tests/diagnose/test_report.py, lanes and instructions of tests/unit/test_sim_bits.py.
"""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from command_line import contents, run

ELSEWHERE = {
    "OMP_NUM_THREADS": "2",
    "OPENBLAS_NUM_THREADS": "2",
    "PYTHONHASHSEED": "7",
    "TZ": "Asia/Kathmandu",
    "LC_ALL": "tr_TR.UTF-8",
    "LANG": "de_DE.UTF-8",
    "COLUMNS": "40",
}


@pytest.mark.slow
def test_cores_hash_seed_time_zone_and_language(tmp_path, small, known):
    told = run("diagnose", small, "--out", "out", cwd=tmp_path, environ=ELSEWHERE)
    assert told.returncode == 0 and contents(tmp_path / "out") == known


def numbers(tree: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """All that a tree holds, with its place."""
    if isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield from numbers(value, f"{place}.{key}")
    else:
        yield place, tree


@pytest.mark.slow
def test_linear_algebra_by_other_instructions(tmp_path, small, known):
    """The last digits may differ, and what is one but for them; no word does."""
    words = ["diagnose", small, "--out", "out", "--no-page"]
    told = run(*words, cwd=tmp_path, environ={"OPENBLAS_CORETYPE": "Nehalem"})
    assert told.returncode == 0
    made, before = (
        dict(numbers(json.loads(data)))
        for data in ((tmp_path / "out" / "diagnosis.json").read_bytes(), known["diagnosis.json"])
    )
    assert made.keys() == before.keys()
    for place, value in before.items():
        same = pytest.approx(value, rel=1e-5, abs=1e-9) if isinstance(value, float) else value
        assert made[place] == same, place
