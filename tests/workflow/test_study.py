"""The workflow itself, on a study of four short flights: what runs again, what a crash leaves, what
a leak does.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from ges.files import sha256
from ges.study import config

ROOT = Path(__file__).resolve().parents[2]
SMALL = {
    "seeds": {
        "train": {"first": 1, "count": 2},
        "validation": {"first": 241, "count": 1},
        "test": {"first": 271, "count": 1},
    },
    "data": {"duration_s": 6.0, "flights_per_batch": 2},
    "models": {
        "names": ["linear", "random_forest"],
        "validation_rows": 200,
        "test_rows": 200,
        "resamples": 20,
        "linear": {"train_rows": 300},
        "random_forest": {"train_rows": 300, "trees": 4},
    },
}
METRICS = [f"results/models/consistent/seedwise/{m}.metrics.json" for m in SMALL["models"]["names"]]
SNAKEMAKE = Path(sys.executable).with_name("snakemake")


def changed(values: dict[str, object]) -> dict:
    """The small study with values replaced, each under its dotted path."""
    study = SMALL
    for path, tree in values.items():
        for key in reversed(path.split(".")):
            tree = {key: tree}
        study = config.merged(study, tree)
    return study


def command(folder: Path, study: dict, *more: str) -> list[str]:
    file = folder / "study.yaml"
    file.write_text(yaml.safe_dump(study))
    return [
        str(SNAKEMAKE),
        "-s",
        str(ROOT / "Snakefile"),
        "--directory",
        str(folder),
        *more,
        "--configfile",
        str(file),
    ]


def run(folder: Path, study: dict, *more: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        command(folder, study, *more), capture_output=True, text=True, timeout=300
    )


def prepared(folder: Path) -> Path:
    """A working folder with the simulator in it, so that nothing is compiled."""
    (folder / "build").mkdir(parents=True)
    shutil.copy(ROOT / "build/libges.so", folder / "build/libges.so")
    return folder


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Path:
    """The small study, run on two cores; tests leave it as it is."""
    folder = prepared(tmp_path_factory.mktemp("study") / "run")
    done = run(folder, SMALL, "--cores", "2", *METRICS)
    assert done.returncode == 0, done.stderr
    return folder


def hashes(folder: Path) -> dict[str, str]:
    """Hash of every result; what a killed job had begun to write bears a name with a dot and is
    read by nothing.
    """
    kinds = ("results/data/**/*.parquet", "results/splits/*", "results/models/**/*.*")
    return {
        str(f.relative_to(folder)): sha256(f)
        for kind in kinds
        for f in folder.glob(kind)
        if f.name[0] != "."
    }


def would_run(folder: Path, study: dict, *targets: str) -> dict[str, int]:
    """Jobs a rule that a dry run names, of the metrics where no targets are given."""
    said = run(folder, study, "-n", *(targets or METRICS))
    assert said.returncode == 0, said.stderr
    stats = re.findall(r"^(\w+) +(\d+)$", said.stdout + said.stderr, flags=re.MULTILINE)
    return {rule: int(count) for rule, count in stats if rule != "total"}


def test_the_whole_study_is_planned(tmp_path):
    """Every file that a rule reads is in the checkout or made by another rule."""
    jobs = would_run(prepared(tmp_path / "run"), {}, "all")
    once = {"write_claims", "write_numbers", "render_paper", "write_manifest"}
    assert {rule: jobs.get(rule) for rule in once} == dict.fromkeys(once, 1)


@pytest.mark.parametrize(
    ("values", "jobs"),
    [
        ({"closed_loop.biases": [0.0], "data.flights_per_batch": 1, "models.mlp.epochs": 7}, {}),
        ({"models.random_forest.trees": 5}, {"train_model": 1}),
        ({"models.horizon_s": 0.2}, {"train_model": 2}),
        (
            {"simulator.controller.altitude_kp": 5.0},
            {"fly_batch_0": 1, "fly_batch_1": 1, "check_leakage": 1, "train_model": 2},
        ),
    ],
    ids=["nothing of it", "a model", "all models", "the flights"],
)
def test_a_changed_key_runs_its_dependents_and_nothing_else(finished, values, jobs):
    assert would_run(finished, changed(values)) == jobs


@pytest.mark.slow
def test_killed_and_resumed_with_other_batches_and_cores_gives_the_same_bytes(finished, tmp_path):
    folder, study = prepared(tmp_path / "run"), changed({"data.flights_per_batch": 3})
    with open(folder / "log", "w") as log:
        first = subprocess.Popen(
            command(folder, study, "--cores", "1", *METRICS),
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    until = time.monotonic() + 240
    while (
        not list(folder.glob("results/data/consistent/seed*.parquet"))
        and time.monotonic() < until
        and first.poll() is None
    ):
        time.sleep(0.05)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    assert not (folder / METRICS[-1]).exists(), "it was killed too late to show anything"
    assert run(folder, study, "--unlock").returncode == 0
    resumed = run(folder, study, "--cores", "1", *METRICS)
    assert resumed.returncode == 0, resumed.stderr
    assert hashes(folder) == hashes(finished)


def test_a_planted_leak_stops_the_run(finished, tmp_path):
    """The test flight replaced by a training flight, name and all: its ground gives it away."""
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    flights = folder / "results/data/consistent"
    shutil.copy(flights / "seed0001.parquet", flights / "seed0271.parquet")
    done = run(folder, SMALL, "--cores", "1", *METRICS)
    assert done.returncode != 0
    log = (folder / "results/logs/data/leakage_consistent.log").read_text()
    assert "leakage: seed0271.parquet is not the flight of its seed: it says seed 1" in log


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("models.sedd", 3, "unknown key 'models.sedd'; did you mean 'seed'?"),
        ("seeds.test.first", 2, "seed 2 is in both 'train' and 'test' (1 shared)"),
        (
            "simulator.vehicle.mass_kg",
            -1.0,
            "'simulator.vehicle.mass_kg' is -1.0; allowed is greater than 0",
        ),
    ],
)
def test_a_wrong_configuration_is_one_sentence(tmp_path, path, value, said):
    done = run(tmp_path, changed({path: value}), "-n", *METRICS)
    printed = done.stdout + done.stderr
    assert done.returncode != 0
    (sentence,) = (line for line in printed.splitlines() if line.startswith("configuration: "))
    assert said in sentence and "Traceback" not in printed


def elsewhere(finished: Path, folder: Path, profile: str) -> None:
    """The small study sent away by a profile gives the bytes of the local one."""
    done = run(
        prepared(folder),
        SMALL,
        "--workflow-profile",
        str(ROOT / "workflow/profiles" / profile),
        *METRICS,
    )
    assert done.returncode == 0, done.stderr
    assert hashes(folder) == hashes(finished)


@pytest.mark.slow
def test_jobs_sent_away_by_a_command_give_the_same_bytes(finished, tmp_path):
    elsewhere(finished, tmp_path / "run", "generic")


@pytest.mark.slow
def test_slurm_gives_the_same_bytes(finished, tmp_path):
    if (
        os.geteuid()
        or not shutil.which("slurmctld")
        or not shutil.which("munged")
        or Path("/etc/slurm/slurm.conf").exists()
    ):
        pytest.skip("needs root, slurm-wlm and munge, and no Slurm of the machine's own")
    script = ROOT / "tests/workflow/slurm.sh"
    try:
        subprocess.run([script, "start", tmp_path / "slurm"], check=True)
        elsewhere(finished, tmp_path / "run", "slurm")
    finally:
        subprocess.run([script, "stop", tmp_path / "slurm"], check=True)
