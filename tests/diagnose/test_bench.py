"""How long a diagnosis takes is measured beside the simulation of the same flights."""

import json

import pytest
from click.testing import CliRunner

from ges.commands.bench import command


@pytest.mark.slow
def test_a_diagnosis_is_timed_against_simulating_its_flights(tmp_path):
    out = tmp_path / "bench.json"
    result = CliRunner().invoke(
        command, ["diagnosis", "--duration", "10", "--repeats", "1", "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert "x simulating the same flights" in result.output
    (case,) = json.loads(out.read_text())["cases"]
    assert case["flown_s"] == 50 and case["found"] == ["rotor_drag"] and case["report_s"] > 0
    assert case["times_simulation"] == case["diagnosis_s"] / case["simulation_s"] > 1
