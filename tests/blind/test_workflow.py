"""The proof as a part of the workflow, with the four cases of ``config/tiny.yaml``."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from ges.blind.protocol.run import SIMPLE

ROOT = Path(__file__).resolve().parents[2]


def _snakemake(folder: Path, *more: str) -> subprocess.CompletedProcess:
    snakemake, tiny = Path(sys.executable).with_name("snakemake"), ROOT / "config" / "tiny.yaml"
    where = ["--snakefile", ROOT / "Snakefile", "--directory", folder, "--cores", "2"]
    command = [str(part) for part in (snakemake, "proof", *where, *more, "--configfile", tiny)]
    return subprocess.run(command, capture_output=True, text=True)


def test_proof_is_planned(tmp_path):
    """Cases are made once, diagnosed in as many jobs as the batches ask for, and scored once."""
    planned = _snakemake(tmp_path, "--dry-run", "--quiet", "rules")
    assert planned.returncode == 0, planned.stderr
    jobs = {
        line.split()[0]: line.split()[1]
        for line in (planned.stdout + planned.stderr).splitlines()
        if len(line.split()) == 2
    }
    assert (jobs["make_cases"], jobs["diagnose_batch"], jobs["score_proof"]) == ("1", "2", "1")


def test_worlds_are_planned(tmp_path):
    """Sets of other worlds are made once, diagnosed by the tool, and scored once; the simple
    baselines diagnose them where other methods are asked for at all.
    """
    for methods, diagnoses in (("[]", 1), ("[boosting]", 1 + len(SIMPLE))):
        more = f"proof={{methods: {methods}, worlds: {{every: 8, batches: 3}}}}"
        planned = _snakemake(tmp_path, "--dry-run", "--quiet", "rules", "--config", more)
        assert planned.returncode == 0, planned.stderr
        lines = [line.split() for line in (planned.stdout + planned.stderr).splitlines()]
        jobs = {words[0]: words[1] for words in lines if len(words) == 2}
        assert jobs["diagnose_worlds"] == str(3 * diagnoses)
        assert (jobs["make_worlds"], jobs["score_worlds"]) == ("1", "1")


@pytest.mark.slow
def test_four_cases_from_seal_to_scores(tmp_path):
    done = _snakemake(tmp_path)
    assert done.returncode == 0, done.stderr[-3000:]
    proof = tmp_path / "results" / "proof"
    cases = pd.read_csv(proof / "cases.csv")
    assert len(cases) == 4 and json.loads((proof / "scores.json").read_text())["cases"] == 4
    assert (cases["outcome"] != "failed").all()
    again = _snakemake(tmp_path, "--dry-run")
    assert "Nothing to be done" in again.stdout + again.stderr
