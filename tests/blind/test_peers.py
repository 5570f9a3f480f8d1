"""Other people's simulators are timed beside ours, on a vehicle that all of them fly alike."""

import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from click.testing import CliRunner

from ges.blind.foreign import peers, worlds
from ges.commands.bench import command


def test_what_is_installed_is_timed_and_what_is_not_is_said(tmp_path, monkeypatch):
    stub = peers.Peer("stub", "json", lambda lift, steps, abreast: lambda: 0.0, 10, 2)
    ours = peers.Peer("ours", "ges", peers._ges, 100)
    away = peers.Peer("away", "no_such_simulator", stub.begin, 10)
    monkeypatch.setattr(peers, "PEERS", (ours, away, stub))
    monkeypatch.setattr(peers, "ProcessPoolExecutor", lambda *_: ThreadPoolExecutor(1))
    out = tmp_path / "bench.json"
    words = ["sim", "--peers", "--repeats", "1", "--out", str(out)]
    result = CliRunner().invoke(command, words)
    assert result.exit_code == 0, result.output
    assert "away is left out: no_such_simulator is not installed; pip install" in result.output
    first, second = json.loads(out.read_text())["cases"]
    assert (first["case"], first["over_ours"]) == ("ours", 1.0)
    assert (second["case"], second["abreast"]) == ("stub", 2)
    assert second["over_ours"] == second["steps_per_s"] / first["steps_per_s"]


def test_peers_are_of_simulators():
    result = CliRunner().invoke(command, ["diagnosis", "--peers"])
    assert result.exit_code and "it goes with 'ges bench sim'" in str(result.exception)


def _climb_m(lift, seconds):
    """Integrate the climb of a rigid body whose rotors reach their speed with a lag."""
    t = np.linspace(0.0, seconds, 100_001)
    speed = lift.asked_rad_s + (lift.hover_rad_s - lift.asked_rad_s) * np.exp(
        -t / lift.numbers["motor_time_constant_s"]
    )
    push = lift.numbers["gravity_m_s2"] * ((speed / lift.hover_rad_s) ** 2 - 1.0)
    return float(np.trapezoid(push * (seconds - t), t))


def _first_climb_m(begin, lift, abreast):
    return begin(lift, 500, abreast)()


@pytest.mark.parametrize("peer", peers.PEERS, ids=lambda p: p.name)
def test_every_simulator_flies_the_same_vehicle(peer):
    pytest.importorskip(peer.module, reason="the extra 'simulators' is not installed")
    lift, abreast = peers.lift_of(), min(peer.abreast, 2)
    spawn = multiprocessing.get_context("spawn")
    with worlds.environment_of(peer.environment), ProcessPoolExecutor(1, spawn) as pool:
        climb = pool.submit(_first_climb_m, peer.begin, lift, abreast).result()
    assert climb == pytest.approx(_climb_m(lift, 500 * peers.STEP_S), rel=0.01)
