"""What a newcomer tries first: the flights of a vehicle file, diagnosed with that file."""

import pandas as pd
import pytest
from click.testing import CliRunner

import ges
from ges.commands.simulate import command
from ges.vehicle.load import load_vehicle, vehicle_path

PLANS = ("straight_runs", "height_staircase", "multisine", "straight_runs")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hummingbird", "crazyflie-2.1"])
def test_flights_of_a_vehicle_file_agree_with_it(name, tmp_path):
    """Streams half a step apart made a torque coefficient of -68 % beside an inertia of -64 %."""
    frames = []
    for seed, plan in enumerate(PLANS, 1):
        out = tmp_path / f"{seed}.parquet"
        asked = [name, "--plan", plan, "--seed", str(seed), "--duration", "40", "--out", str(out)]
        flown = CliRunner().invoke(command, asked)
        assert flown.exit_code == 0, flown.output
        frames.append(pd.read_parquet(out))
    vehicle = load_vehicle(vehicle_path(name))
    found = ges.diagnose(frames, vehicle)
    assert (found.verdict, found.findings) == ("nothing_proven", ()), found.sentence
    for channel, errors in found.fit["channels"].items():
        if not channel.startswith(("force", "drive")):
            assert errors["recalibrated"] < 1.05 * errors["before"], channel
    # these read no noise: what numbers of the file leave of them is that of the other sensors
    least = 1e-3 * vehicle.mass_kg.value * 9.81
    forces = (e["recalibrated"] for c, e in found.fit["channels"].items() if c[:5] == "force")
    assert max(forces) < least
