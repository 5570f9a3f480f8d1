"""Logs that are told otherwise than they were flown: what is wrong is named, and mended."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.ndimage import gaussian_filter1d

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
from ges.vehicle.file import Quantity, Vehicle
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
    assert one[two[0]] == {two[1]: 1.0} and one[two[1]] == {two[0]: 1.0}


def _turned(frame: pd.DataFrame, columns, into_world: bool) -> pd.DataFrame:
    """Write a vector in the other frame than its columns say."""
    q = frame[list(QUATERNION)].to_numpy()
    w, *xyz = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    u = np.stack(xyz if into_world else [-x for x in xyz], axis=1)
    v = frame[list(columns)].to_numpy()
    t = 2.0 * np.cross(u, v)
    out = v + w[:, None] * t + np.cross(u, t)
    return frame.assign(**dict(zip(columns, out.T, strict=True)))


def _yawing(frame: pd.DataFrame) -> pd.DataFrame:
    """A body that turns about its thrust once in six seconds beside what it does."""
    heading = frame["t_s"].to_numpy() * 2.0 * np.pi / 6.0
    c, s = np.cos(heading), np.sin(heading)
    turned = {
        name: of
        for x, y, _ in (GYRO, ACCELEROMETER)
        for name, of in ((x, c * frame[x] + s * frame[y]), (y, c * frame[y] - s * frame[x]))
    }
    turned[GYRO[2]] = frame[GYRO[2]] + 2.0 * np.pi / 6.0
    w, x, y, z = frame[list(QUATERNION)].to_numpy().T
    c, s = np.cos(0.5 * heading), np.sin(0.5 * heading)
    q = (w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s)
    motors = [*SPEEDS, *COMMANDS]
    return frame.assign(**turned, **dict(zip(QUATERNION, q, strict=True))).drop(columns=motors)


@pytest.mark.parametrize(
    ("name", "columns", "into_world"),
    [
        ("gyro-world", GYRO, True),
        ("accelerometer-world", ACCELEROMETER, True),
        ("velocity-body", VELOCITY, False),
    ],
)
def test_vectors_of_the_other_frame(frames, name, columns, into_world):
    yawing = [_yawing(frame) for frame in frames]
    assert faults.find_faults(yawing, VEHICLE) == ([], 0.0)
    spoilt = [_turned(frame, columns, into_world) for frame in yawing]
    alike, log_odds = faults.find_faults(spoilt, VEHICLE)
    assert [f.name for f in alike] == [name] and log_odds > 20.0
    for told, flown in zip(spoilt, yawing, strict=True):
        mended = alike[0].mend(told)[list(columns)]
        np.testing.assert_allclose(mended, flown[list(columns)], atol=1e-9)


def test_an_imu_that_is_mounted_between_its_axes(frames):
    c = np.sqrt(0.5)
    spoilt = [
        frame.assign(
            **{
                name: of
                for x, y, _ in (GYRO, ACCELEROMETER)
                for name, of in (
                    (x, c * (frame[x] - frame[y])),
                    (y, c * (frame[x] + frame[y])),
                )
            }
        )
        for frame in frames
    ]
    alike, _ = faults.find_faults(spoilt, VEHICLE)
    assert alike[0].name == "imu-yaw+45" and "turned by +45 degrees" in alike[0].what
    for told, flown in zip(spoilt, frames, strict=True):
        pd.testing.assert_frame_equal(alike[0].mend(told), flown)


FOOT_M, RPM = 0.3048, np.pi / 30.0


@pytest.mark.parametrize(
    ("name", "columns", "unit"),
    [
        ("gyro-rev", GYRO, 2.0 * np.pi),
        ("accelerometer-ft", ACCELEROMETER, FOOT_M),
        ("world-ft", [*POSITION, *VELOCITY, *POSITION_REF], FOOT_M),
        ("rotor-speeds-rpm", SPEEDS, RPM),
        ("rotor-speeds-rev", SPEEDS, 2.0 * np.pi),
        ("rotor-speeds-double", SPEEDS, 0.5),
    ],
)
def test_streams_in_another_unit(frames, name, columns, unit):
    spoilt = [frame.assign(**{c: frame[c] / unit for c in columns}) for frame in frames]
    alike, log_odds = faults.find_faults(spoilt, VEHICLE)
    assert alike[0].name == name and log_odds > 10.0
    pd.testing.assert_frame_equal(alike[0].mend(spoilt[0]), frames[0])


@pytest.mark.parametrize(
    ("name", "columns", "unit"),
    [
        ("position-mm", POSITION, 1e-6),
        ("gyro-deg", GYRO, np.pi / 1800.0),
        ("accelerometer-g", ACCELEROMETER, 9.80665),
        ("rotor-speeds-rpm", SPEEDS, RPM),
    ],
)
def test_a_size_that_cannot_be_is_refused_with_what_reads_it(frames, name, columns, unit):
    """What is seen in one column alone is mended like what streams say of each other."""
    flown = frames[0]
    told = flown.assign(**{c: flown[c] / unit for c in columns})
    with pytest.raises(GesError, match=f"--mend {name} reads it so"):
        make_set(VEHICLE, [("f", told)])


def _with(**numbers) -> Vehicle:
    """The vehicle with numbers multiplied, and all of its rotors where they are of these."""
    rotor = {"x_m", "y_m"} & set(numbers)
    rotors = tuple(
        r.model_copy(update={n: Quantity(value=getattr(r, n).value * numbers[n]) for n in rotor})
        for r in VEHICLE.rotors
    )
    update: dict = {"rotors": rotors}
    for name in set(numbers) - rotor:
        if name == "inertia_kg_m2":
            scaled = {
                a: getattr(VEHICLE.inertia_kg_m2, a) * numbers[name] for a in ("xx", "yy", "zz")
            }
            update[name] = VEHICLE.inertia_kg_m2.model_copy(update=scaled)
        else:
            update[name] = Quantity(value=getattr(VEHICLE, name).value * numbers[name])
    return VEHICLE.model_copy(update=update)


@pytest.fixture(scope="module")
def shaken() -> list[pd.DataFrame]:
    """Unlike rotors turn a body as the numbers of its file say, logged at 200 Hz."""
    rng, t_s = np.random.default_rng(3), np.arange(0.0, 20.0, 0.005)
    more = gaussian_filter1d(rng.normal(size=(len(t_s), 4)), 20, axis=0)
    w = VEHICLE.hover_speed_rad_s() * np.sqrt(1.0 + more)
    thrust = VEHICLE.thrust_coefficient_N_s2.value * w**2
    torque = VEHICLE.torque_coefficient_Nm_s2.value * w**2
    x, y, spin = (VEHICLE.rotor_arrays()[name] for name in ("x_m", "y_m", "spin"))
    inertia = VEHICLE.inertia_kg_m2
    moments = np.stack([thrust @ y, -thrust @ x, -torque @ spin], axis=1)
    rates = np.cumsum(moments / [inertia.xx, inertia.yy, inertia.zz], axis=0) * 0.005
    force = np.stack([0.0 * t_s, 0.0 * t_s, thrust.sum(axis=1) / VEHICLE.mass_kg.value], axis=1)
    columns = {
        **dict(zip(GYRO, rates.T, strict=True)),
        **dict(zip(ACCELEROMETER, force.T, strict=True)),
        **dict(zip(SPEEDS, w.T, strict=True)),
        **dict(zip(COMMANDS, w.T / VEHICLE.max_rotor_speed_rad_s.value, strict=True)),
    }
    return [pd.DataFrame({"t_s": t_s, **columns})]


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("mass-N", {"mass_kg": 9.80665}),
        ("mass-oz", {"mass_kg": 1.0 / 0.0283495}),
        ("inertia-gm2", {"inertia_kg_m2": 1e3}),
        ("inertia-kgcm2", {"inertia_kg_m2": 1e4}),
        ("arms-in", {"x_m": 1.0 / 0.0254, "y_m": 1.0 / 0.0254}),
        ("thrust-rpm", {"thrust_coefficient_N_s2": RPM**2}),
        ("torque-rpm", {"torque_coefficient_Nm_s2": RPM**2}),
        (
            "thrust-torque-rpm",
            {"thrust_coefficient_N_s2": RPM**2, "torque_coefficient_Nm_s2": RPM**2},
        ),
        ("full-speed-rpm", {"max_rotor_speed_rad_s": 1.0 / RPM}),
    ],
)
def test_vehicle_files_in_another_unit(shaken, name, numbers):
    assert faults.find_faults(shaken, VEHICLE) == ([], 0.0)
    alike, log_odds = faults.find_faults(shaken, _with(**numbers))
    assert alike[0].name == f"file-{name}" and log_odds > 3.0
    said = faults.sentence(alike, log_odds)
    assert "in the vehicle file" in said and "correct the vehicle file" in said
    assert "--mend" not in said


def test_a_vehicle_that_stands_with_idle_rotors_is_not_weighed(shaken):
    """The ground carried it, and its mass was told to be a weight in newtons."""
    rng, (flown,) = np.random.default_rng(5), shaken
    idle = {name: 0.3 * flown[name] for name in (*SPEEDS, *COMMANDS)}
    rates = {name: rng.normal(0.0, 0.02, len(flown)) for name in GYRO}
    force = {
        name: rng.normal(g, 0.1, len(flown))
        for name, g in zip(ACCELEROMETER, (0.0, 0.0, 9.8), strict=True)
    }
    standing = flown.assign(**idle, **rates, **force)
    assert faults.find_faults([standing], VEHICLE) == ([], 0.0)


@pytest.mark.parametrize(
    "numbers",
    [
        {"mass_kg": 2.0},
        {"inertia_kg_m2": 2.0},
        {"thrust_coefficient_N_s2": 0.5},
        {"torque_coefficient_Nm_s2": 2.0},
        {"max_rotor_speed_rad_s": 1.5},
    ],
)
def test_numbers_that_are_wrong_by_no_unit_are_left_to_the_diagnosis(frames, shaken, numbers):
    for flights in (frames, shaken):
        assert faults.find_faults(flights, _with(**numbers)) == ([], 0.0)


def test_places_of_rotors_that_are_mirrored(frames):
    alike, log_odds = faults.find_faults(frames, _with(y_m=-1.0))
    assert alike[0].name == "file-arms-minus-y" and log_odds > 20.0


def test_places_of_rotors_in_a_cross_and_not_in_a_plus(frames):
    c = np.sqrt(0.5)
    plus = VEHICLE.model_copy(
        update={
            "rotors": tuple(
                r.model_copy(
                    update={
                        "x_m": Quantity(value=c * (r.x_m.value - r.y_m.value)),
                        "y_m": Quantity(value=c * (r.x_m.value + r.y_m.value)),
                    }
                )
                for r in VEHICLE.rotors
            )
        }
    )
    alike, log_odds = faults.find_faults(frames, plus)
    assert alike[0].name == "file-arms-yaw+45" and log_odds > 20.0


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
    assert "senses of all rotors are the wrong way round" in alike[0].what and log_odds > 20.0
    assert "correct the vehicle file" in faults.sentence(alike, log_odds)
    with pytest.raises(UsageError, match="file-spins"):
        make_set(VEHICLE, [("f", frames[0])], mends=["file-spins"])


def test_commands_from_minus_one_to_one(frames):
    told = frames[0].assign(**{u: 1.2 * frames[0][u] - 1.0 for u in COMMANDS})
    with pytest.raises(GesError, match=r"u_1 falls to -.*take \(u \+ 1\) / 2"):
        make_set(VEHICLE, [("f", told)])


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
