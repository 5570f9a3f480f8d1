"""Manifests: what is recorded, compared, verified, exported."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from ges.commands.runs import command
from ges.errors import GesError, UsageError
from ges.provenance import runs
from ges.study import config

ROOT = Path(__file__).resolve().parents[2]
DEFAULT = config.read(ROOT / "config/default.yaml")


def write_run(folder: Path, seed: int, value: float) -> str:
    """A run of a study with another seed and another result, as the workflow's last rule
    writes it.
    """
    study = config.validate(config.merged(DEFAULT, {"models": {"seed": seed}}))
    for place in ("benchmarks", "logs"):
        (folder / f"results/{place}/data").mkdir(parents=True, exist_ok=True)
    for ended_s, job in ((101.5, "fly"), (102.5, "check")):
        measured = folder / f"results/benchmarks/data/{job}.tsv"
        measured.write_text("s\th:m:s\tmax_rss\tcpu_time\n1.5\t0:00:01\t20.5\t-\n")
        os.utime(measured, (ended_s, ended_s))
    (folder / "results/logs/data/fly.log").write_text(
        "INFO 0.75 s of processor time to start\nINFO 1.25 s of processor time in all\n"
    )
    (folder / "results/table1.csv").write_text(f"x\n{value}\n")
    (folder / "results/numbers.json").write_text(
        json.dumps({"rmse": {"value": value}, "name": {"value": "text"}})
    )
    code = runs.Code(commit="abc", modified=True, sha256="1" * 64)
    name = runs.run_id(study.model_dump(mode="json"), code.sha256)
    runs.write_manifest(
        made=[Path("results/table1.csv")],
        numbers=Path("results/numbers.json"),
        study=study,
        makers={"results/table1.csv": "make_table1"},
        read={"requirements.lock": "2" * 64},
        code=code,
        benchmarks=Path("results/benchmarks"),
        logs=Path("results/logs"),
        manifest=Path("results/runs") / name / "manifest.json",
    )
    return name


@pytest.fixture
def two(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return write_run(tmp_path, 1, 0.5), write_run(tmp_path, 2, 0.25)


def test_manifest_holds_what_it_promises(two):
    run = runs.find(Path("results"), two[1])
    assert run.metrics == {"rmse": 0.25} and run.timings["data/fly"].wall_s == 1.5
    assert run.timings["data/check"].cpu_s is None and run.timings["data/check"].started_s == 1.0
    assert run.seeds["validation"] == list(range(241, 271)) and run.config["models"]["seed"] == 2
    assert (
        run.environment.packages["numpy"]
        and run.outputs["results/table1.csv"].rule == "make_table1"
    )
    assert run.config_sha256 == runs.config_hash(run.config) and run.config_sha256.startswith(
        two[1].split("-")[0]
    )


def test_list_show_diff(two, runner):
    assert all(name in runner.invoke(command, ["list"]).output for name in two)
    shown = runner.invoke(command, ["show", two[0]]).output
    assert "rmse" in shown and "abc + changes" in shown
    assert json.loads(runner.invoke(command, ["show", two[0], "--json"]).output)["id"] == two[0]
    lines = runner.invoke(command, ["diff", *two]).output
    assert (
        "models.seed" in lines
        and "rmse" in lines
        and "table1.csv" in lines
        and "mass_kg" not in lines
    )
    assert runner.invoke(command, ["diff", two[0], two[0]]).output == "the same\n"


def test_cost_of_jobs_that_overlap(two, runner):
    """Two jobs of 1.5 s, the second begins 1 s after the first: 2.5 s in all, and for half a second
    the memory of both.
    """
    whole = runs.stages(runs.find(Path("results"), two[0]))["all"]
    assert whole == runs.Cost(jobs=2, wall_s=2.5, cpu_s=1.25, starting_cpu_s=0.75, peak_MiB=41.0)
    lines = runner.invoke(command, ["cost", two[0]]).output.splitlines()
    assert [line.split()[0] for line in lines] == ["stage", "data", "all"]


def test_verify_finds_what_changed(two, runner):
    done = runner.invoke(command, ["verify", two[1]])
    assert done.exit_code == 0 and "1 of 1" in done.output
    Path("results/table1.csv").write_text("x\n0.26\n")
    done = runner.invoke(command, ["verify", two[1]])
    assert done.exit_code == 1 and "changed: results/table1.csv" in done.output
    Path("results/table1.csv").unlink()
    assert "missing: results/table1.csv" in runner.invoke(command, ["verify", two[1]]).output


def test_unknown_and_broken_runs(two):
    with pytest.raises(UsageError, match="unknown run 'zzz'"):
        runs.find(Path("results"), "zzz")
    with pytest.raises(GesError, match="make all"):
        runs.find(Path("nowhere"), "latest")
    file = Path("results/runs") / two[0] / "manifest.json"
    content = json.loads(file.read_text())
    file.write_text(json.dumps({**content, "extra": 1}))
    with pytest.raises(GesError, match="extra"):
        runs.load_manifest(file)


def test_commit_of_a_checkout(tmp_path):
    assert runs.commit(tmp_path) == ("unknown", False)
    git = ["git", "-c", "user.name=n", "-c", "user.email=e@localhost"]
    for step in (["init", "-q"], ["add", "."], ["commit", "-qm", "first"]):
        (tmp_path / "a").write_text("1")
        subprocess.run([*git, *step], cwd=tmp_path, check=True)
    name, modified = runs.commit(tmp_path)
    assert len(name) == 10 and not modified
    (tmp_path / "a").write_text("2")
    assert runs.commit(tmp_path) == (name, True)


def test_export_without_mlflow_says_what_to_install(two, runner, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mlflow", None)
    done = runner.invoke(command, ["export", two[0], "--mlflow", "sqlite:///x.db"])
    assert isinstance(done.exception, GesError) and "pip install mlflow" in str(done.exception)


def test_export_into_mlflow_writes_a_run_once(two):
    mlflow = pytest.importorskip("mlflow", reason="the extra 'mlflow' is not installed")
    run = runs.find(Path("results"), two[0])
    first, second = (runs.export_mlflow(run, "runs.db", "ges") for _ in range(2))
    stored = mlflow.MlflowClient(f"sqlite:///{Path('runs.db').resolve()}").get_run(first)
    assert (
        first == second
        and stored.data.metrics["rmse"] == 0.5
        and stored.data.tags["commit"] == "abc"
    )


@pytest.fixture
def interface(two):
    """``mlflow ui`` over a store that two runs were exported into: its address."""
    pytest.importorskip("mlflow", reason="the extra 'mlflow' is not installed")
    for name in two:
        runs.export_mlflow(runs.find(Path("results"), name), "runs.db", "ges")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    store = f"sqlite:///{Path('runs.db').resolve()}"
    mlflow = [
        sys.executable,
        "-m",
        "mlflow",
        "ui",
        "--backend-store-uri",
        store,
        "--port",
        port,
        "--workers",
        "1",
    ]
    with open("ui.log", "w") as log:
        server = subprocess.Popen(mlflow, stdout=log, stderr=log, start_new_session=True)
    yield f"http://127.0.0.1:{port}"
    os.killpg(server.pid, signal.SIGTERM)
    server.wait(timeout=30)


def answer(address: str, asked: dict | None = None) -> bytes:
    """What a server says, which may still be starting."""
    body = None if asked is None else json.dumps(asked).encode()
    until = time.monotonic() + 120
    while True:
        try:
            request = urllib.request.Request(address, body, {"Content-Type": "application/json"})
            with urllib.request.urlopen(request, timeout=30) as reply:
                return reply.read()
        except urllib.error.URLError as error:
            if isinstance(error, urllib.error.HTTPError) or time.monotonic() > until:
                raise AssertionError(
                    f"{address}: {error}; the server says\n{Path('ui.log').read_text()[-2000:]}"
                ) from error
            time.sleep(0.2)


@pytest.mark.slow
def test_mlflow_shows_the_exported_runs(two, interface):
    """The page is served, and the interface it talks to finds both runs with their numbers, origin
    and configuration.
    """
    assert b"<title>MLflow</title>" in answer(f"{interface}/")
    api = f"{interface}/api/2.0/mlflow"
    experiment = json.loads(answer(f"{api}/experiments/get-by-name?experiment_name=ges"))[
        "experiment"
    ]["experiment_id"]
    found = json.loads(answer(f"{api}/runs/search", {"experiment_ids": [experiment]}))["runs"]
    data = {run["info"]["run_name"]: run["data"] for run in found}
    assert set(data) == set(two)
    metrics = {m["key"]: m["value"] for m in data[two[1]]["metrics"]}
    assert metrics["rmse"] == 0.25 and metrics["wall_s/data/fly"] == 1.5
    assert {"key": "commit", "value": "abc"} in data[two[1]]["tags"]
    assert {"key": "models.seed", "value": "2"} in data[two[1]]["params"]
