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
METRICS = [
    f"results/models/consistent/seedwise/training1/{m}.metrics.json"
    for m in SMALL["models"]["names"]
]
SNAKEMAKE = Path(sys.executable).with_name("snakemake")


def nested(path: str, value: object) -> dict:
    """A configuration of one value, by its dotted key."""
    tree = value
    for key in reversed(path.split(".")):
        tree = {key: tree}
    return tree


def changed(values: dict[str, object]) -> dict:
    """The small study with values replaced, each under its dotted path."""
    study = SMALL
    for path, value in values.items():
        study = config.merged(study, nested(path, value))
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
        ({"data.flights_per_batch": 1}, {}),
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


@pytest.fixture(scope="session")
def touched(tmp_path_factory) -> tuple[Path, dict]:
    """Folder and configuration of the whole tiny study, every file empty and known as made."""
    folder, tiny = tmp_path_factory.mktemp("touched"), config.read(ROOT / "config/tiny.yaml")
    listed = run(folder, tiny, "all", "--summary")
    assert listed.returncode == 0, listed.stderr
    for line in listed.stdout.splitlines()[1:]:
        file = folder / line.partition("\t")[0]
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    done = run(folder, tiny, "all", "--touch", "--forceall", "--cores", "1")
    assert done.returncode == 0, done.stderr
    return folder, tiny


RERUN = {
    "closed_loop.modes": (
        ["analytical", "ml"],
        {
            "choose_gains": 1,
            "fly_comparison": 1,
            "fly_grid_cell": 4,
            "fly_worlds": 1,
            "fly_winner": 1,
        },
        26,
    ),
    "closed_loop.clamp_thresholds": (
        [0.01],
        {
            "choose_clamp": 1,
            "choose_gains": 1,
            "fly_comparison": 1,
            "fly_grid_cell": 4,
            "fly_worlds": 1,
            "fly_winner": 1,
        },
        27,
    ),
    "closed_loop.biases": ([0.0], {"fly_bias": 1, "fly_worlds": 1}, 15),
    "closed_loop.pulse.bias": (0.01, {"fly_ensemble": 1, "fly_profile": 1, "fly_pulse": 1}, 14),
    "closed_loop.pulse.start_s": (
        6.0,
        {"fly_ensemble": 1, "fly_profile": 1, "fly_pulse": 1, "fly_pulse_map": 1},
        16,
    ),
    "closed_loop.pulse_map.recovery_s": (9.0, {"fly_pulse_map": 1}, 12),
    "closed_loop.ensemble.steps": (4, {"fly_ensemble": 1}, 10),
    "closed_loop.profile_gains_m": ([0.2], {}, 4),
    "closed_loop.retune.phase_margin_deg": (31.0, {"choose_gains": 1, "fly_winner": 1}, 12),
    "closed_loop.pole_factors": ([1.0], {"write_poles": 1}, 12),
    "closed_loop.slope_exponents": ([1.0], {}, 12),
    "closed_loop.curvature_factors": ([1.0], {}, 12),
    "closed_loop.low_clearance_m": (
        0.09,
        {
            "choose_clamp": 1,
            "fly_bias": 1,
            "fly_causes": 1,
            "fly_ensemble": 1,
            "fly_network": 2,
            "fly_profile": 1,
            "fly_pulse": 1,
            "fly_pulse_map": 1,
            "choose_gains": 1,
            "fly_comparison": 1,
            "fly_grid_cell": 4,
            "fly_worlds": 1,
            "fly_winner": 1,
        },
        45,
    ),
    "models.mlp.epochs": (
        7,
        {
            "train_model": 4,
            "choose_clamp": 1,
            "fly_network": 2,
            "fly_pulse": 1,
            "choose_gains": 1,
            "fly_comparison": 1,
            "fly_grid_cell": 4,
            "fly_worlds": 1,
            "fly_winner": 1,
        },
        59,
    ),
    "seeds.closed_loop_small.count": (3, {"fly_comparison": 1}, 16),
    "seeds.closed_loop.count": (
        4,
        {
            "fly_bias": 1,
            "fly_causes": 1,
            "fly_comparison": 1,
            "fly_grid_cell": 4,
            "fly_network": 2,
            "fly_pulse": 1,
            "fly_pulse_map": 1,
            "fly_winner": 1,
            "fly_worlds": 1,
        },
        36,
    ),
}


@pytest.mark.parametrize(
    "path",
    [p if p == "closed_loop.biases" else pytest.param(p, marks=pytest.mark.slow) for p in RERUN],
)
def test_a_changed_key_runs_again_what_it_is_handed_to(touched, path):
    """Of the whole study: the jobs that fly, choose or train, and how many jobs in all."""
    folder, tiny = touched
    value, jobs, total = RERUN[path]
    again = would_run(folder, config.merged(tiny, nested(path, value)), "all")
    made = {
        rule: n
        for rule, n in again.items()
        if re.match("fly_|choose_|train_|profile_|write_poles", rule)
    }
    assert (made, sum(again.values())) == (jobs, total)


def test_every_key_of_the_closed_loop_is_looked_at():
    shared = set(config.Flights.model_fields)
    own = {path.split(".")[1] for path in RERUN if path.startswith("closed_loop.")}
    assert own | shared == set(config.ClosedLoop.model_fields)


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
