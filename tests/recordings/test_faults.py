"""Logs that are told otherwise than they were flown: what is wrong is named, and mended."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from ges.cli import cli
from ges.conventions import (
    BODY_RATE,
    POSITION,
    POSITION_REF,
    QUATERNION,
    SPECIFIC_FORCE,
    VELOCITY,
    command,
    rotor_speed,
)
from ges.errors import GesError, UsageError
from ges.recordings import faults
from ges.recordings.recording import load_set, make_set
from ges.vehicle.load import load_vehicle

EXAMPLE = Path(str(resources.files("ges.recordings") / "example"))
VEHICLE = load_vehicle(EXAMPLE / "vehicle.yaml")


@pytest.fixture(scope="module")
def frames() -> list[pd.DataFrame]:
    return [f.frame for f in load_set(EXAMPLE).flights]


def _spoilt(frames, fault: faults.Fault) -> list[pd.DataFrame]:
    """Tables that this fault mends: its mend applied until it comes round, but once."""
    columns = list(frames[0].columns)
    numbers = pd.DataFrame({c: [float(i + 2)] for i, c in enumerate(columns)})
    mended = fault.mend(numbers).iloc[0]
    # a mend takes columns from others or scales them, so that it can be undone column by column
    spoilt = []
    for frame in frames:
        out = {}
        for column in columns:
            source = mended[column]
            other = [c for c in columns if abs(numbers[c][0]) == abs(source)]
            if other and other[0] != column:
                out[other[0]] = frame[column] * (1.0 if source > 0.0 else -1.0)
            else:
                out[column] = frame[column] / (source / numbers[column][0])
        spoilt.append(frame.assign(**out))
    return spoilt


OTHER_UNITS = (
    "gyro-deg",
    "position-ft",
    "position-cm",
    "velocity-cm",
    "velocity-kmh",
    "time-ms",
    "time-ns",
)
ORDERS = ("quaternion-xyzw", "quaternion-inverse", "motors-2341", "motors-2143", "motors-3412")
FRAMES = ("quaternion-ned", "world-minus-yz", "gyro-minus-yz", "accelerometer-minus-xyz")


def test_a_log_as_it_was_flown_is_believed(frames):
    assert faults.find_faults(frames, VEHICLE) == ([], 0.0)


@pytest.mark.parametrize("name", [*OTHER_UNITS, *ORDERS, *FRAMES])
def test_a_fault_is_named_and_its_mend_gives_the_log_back(frames, name):
    fault = faults.faults()[name]
    spoilt = _spoilt(frames, fault)
    for told, flown in zip(spoilt, frames, strict=True):
        pd.testing.assert_frame_equal(fault.mend(told), flown)
    alike, log_odds = faults.find_faults(spoilt, VEHICLE)
    assert name in [f.name for f in alike] and log_odds > 20.0
    said = faults.sentence(alike, log_odds)
    assert fault.what in said and f"--mend {name}" in said


GYRO, ACCELEROMETER = BODY_RATE, SPECIFIC_FORCE
SPEEDS, COMMANDS = rotor_speed(4), command(4)
EXCHANGED = {
    "velocity-yxz": [VELOCITY[:2]],
    "velocity-zyx": [VELOCITY[::2]],
    "position-yxz": [POSITION[:2]],
    "gyro-yxz": [GYRO[:2]],
    "gyro-xzy": [GYRO[1:]],
    "imu-yxz": [GYRO[:2], ACCELEROMETER[:2]],
    "accelerometer-yxz": [ACCELEROMETER[:2]],
    "quaternion-wyxz": [QUATERNION[1:3]],
    "world-yxz": [POSITION[:2], VELOCITY[:2], POSITION_REF[:2]],
    "commands-3214": [COMMANDS[::2]],
    "rotor-speeds-1432": [SPEEDS[1::2]],
    "motors-2134": [COMMANDS[:2], SPEEDS[:2]],
}


def _exchanged(frames, pairs) -> list[pd.DataFrame]:
    names = {one: other for a, b in pairs for one, other in ((a, b), (b, a))}
    return [frame.rename(columns=names)[frame.columns] for frame in frames]


@pytest.mark.parametrize("name", EXCHANGED)
def test_exchanged_columns_are_named_alone_and_changed_back(frames, name):
    told = _exchanged(frames, EXCHANGED[name])
    alike, log_odds = faults.find_faults(told, VEHICLE)
    assert [f.name for f in alike] == [name] and log_odds > 100.0
    for frame, flown in zip(told, frames, strict=True):
        pd.testing.assert_frame_equal(alike[0].mend(frame), flown)


@pytest.mark.parametrize("name", ["velocity-minus-x", "velocity-yxz-minus-x", "gyro-yzx"])
def test_axes_that_are_turned(frames, name):
    alike, log_odds = faults.find_faults(_spoilt(frames, faults.faults()[name]), VEHICLE)
    assert [f.name for f in alike] == [name] and log_odds > 100.0


@pytest.mark.parametrize(
    ("missing", "name", "other"),
    [
        ((QUATERNION, ACCELEROMETER), "velocity-yxz", "position-yxz"),
        ((QUATERNION,), "gyro-yxz", "motors-1243"),
        ((QUATERNION, GYRO), "commands-3214", "rotor-speeds-3214"),
    ],
)
def test_what_no_third_stream_decides_is_named_twice(frames, missing, name, other):
    """Without attitude nothing says which of two streams is the wrong one."""
    left_out = [column for stream in missing for column in stream]
    told = [frame.drop(columns=left_out) for frame in frames]
    assert faults.find_faults(told, VEHICLE) == ([], 0.0)
    alike, log_odds = faults.find_faults(_exchanged(told, EXCHANGED[name]), VEHICLE)
    assert {f.name for f in alike} == {name, other} and log_odds > 20.0
    said = faults.sentence(alike, log_odds)
    assert f"--mend {name}" in said and f"--mend {other}" in said and " or --mend " in said


def test_noise_speaks_for_no_fault(frames):
    """Streams that share nothing fit each other no better in another order."""
    rng = np.random.default_rng(1)
    noise = [
        frame.assign(**{c: rng.permutation(frame[c]) for c in frame if c != "t_s"})
        for frame in frames
    ]
    assert faults.find_faults(noise, VEHICLE) == ([], 0.0)


def test_two_of_more_motors_that_are_exchanged():
    one, two = faults.faults(12)["commands-2-1-3-4-5-6-7-8-9-10-11-12"].reading, command(12)
    assert one[two[0]] == (two[1], 1.0) and one[two[1]] == (two[0], 1.0)


def test_senses_of_rotation_that_are_the_wrong_way_round(frames):
    turned = VEHICLE.model_copy(
        update={
            "rotors": tuple(
                r.model_copy(update={"spin": "cw" if r.spin == "ccw" else "ccw"})
                for r in VEHICLE.rotors
            )
        }
    )
    alike, log_odds = faults.find_faults(frames, turned)
    assert "senses of all rotors the wrong way round" in alike[0].what and log_odds > 20.0
    assert "mend it" in faults.sentence(alike, log_odds)


def test_a_refused_set_is_diagnosed_as_it_was_flown(frames, tmp_path):
    """The sentence of the refusal holds the option, and with it the very same comes out."""
    names = [f.name for f in load_set(EXAMPLE).flights]
    for name, frame in zip(names, _spoilt(frames, faults.faults()["motors-2341"]), strict=True):
        (tmp_path / "set").mkdir(exist_ok=True)
        frame.to_parquet(tmp_path / "set" / f"{name}.parquet")
    (tmp_path / "set/vehicle.yaml").write_bytes((EXAMPLE / "vehicle.yaml").read_bytes())
    with pytest.raises(GesError, match="2 3 4 1.*--mend motors-2341"):
        load_set(tmp_path / "set")
    mended = load_set(tmp_path / "set", mends=["motors-2341"])
    for flight, flown in zip(mended.flights, frames, strict=True):
        pd.testing.assert_frame_equal(flight.frame, flown)
    assert mended.warnings[0].startswith("read with --mend motors-2341: commands and rotor speeds")


def test_a_mend_that_nobody_knows(frames):
    with pytest.raises(UsageError, match="quaternion-xyzw"):
        make_set(VEHICLE, [("f", frames[0])], mends=["quaternion-xyz"])
    done = CliRunner().invoke(cli, ["diagnose", "--help"])
    assert "--mend NAME" in done.output
