"""Hubs and spins from what autopilots say."""

import itertools
import re

import numpy as np
import pytest

from ges.errors import GesError, UsageError
from ges.vehicle.airframe import from_layout, from_parameters
from ges.vehicle.layouts import LAYOUTS
from ges.vehicle.propeller import Propeller
from ges.vehicle.turning import moments

TEN_IN = Propeller.parse("10in")
PX4 = {
    "CA_AIRFRAME": 0,
    "CA_ROTOR_COUNT": 4,
    **{f"CA_ROTOR{i}_PX": x for i, x in enumerate((0.15, -0.15, 0.15, -0.15))},
    **{f"CA_ROTOR{i}_PY": y for i, y in enumerate((0.2, -0.2, -0.2, 0.2))},
    **{f"CA_ROTOR{i}_KM": k for i, k in enumerate((0.05, 0.05, -0.05, -0.05))},
}


def _corners(airframe):
    """Front or back, left or right, and spin of every rotor."""
    return [
        ("F" if r.x_m.value > 0 else "B") + ("L" if r.y_m.value > 0 else "R") + r.spin
        for r in airframe.rotors
    ]


def test_px4_hubs_are_forward_right_down():
    found = from_parameters("px4", {**PX4, "CA_ROTOR0_PZ": -0.04}, TEN_IN, None)
    assert _corners(found) == ["FRccw", "BLccw", "FLcw", "BRcw"]
    first = found.rotors[0]
    assert (first.x_m.value, first.y_m.value, first.z_m.value) == (0.15, -0.2, 0.04)
    assert first.x_m.sd > 0 and first.radius_m.value == pytest.approx(0.127)


def test_px4_before_control_allocation_goes_by_airframe():
    for number, corners in (
        (4001, ["FRccw", "BLccw", "FLcw", "BRcw"]),
        (4040, ["FRcw", "BLcw", "FLccw", "BRccw"]),
        (4900, ["FRccw", "BRcw", "BLccw", "FLcw"]),
    ):
        found = from_parameters("px4", {"SYS_AUTOSTART": number}, TEN_IN, None)
        assert _corners(found) == corners


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"CA_ROTOR_COUNT": 2}, "2 rotors"),
        ({"CA_AIRFRAME": 2}, "no multirotor"),
        ({**PX4, "CA_ROTOR1_AZ": 0.7}, "does not point up"),
        ({**PX4, "CA_ROTOR1_KM": 0.0}, "no spin"),
        ({**{k: 0.0 for k in PX4}, "CA_ROTOR_COUNT": 4}, "one place"),
        ({"SYS_AUTOSTART": 13014}, "not known to be a multirotor"),
        ({}, "SYS_AUTOSTART"),
    ],
)
def test_what_is_no_multirotor_is_refused(parameters, words):
    with pytest.raises(GesError, match=words):
        from_parameters("px4", parameters, TEN_IN, None)


def test_ardupilot_frames():
    for frame, corners in (
        ({"FRAME_CLASS": 1, "FRAME_TYPE": 1}, ["FRccw", "BLccw", "FLcw", "BRcw"]),
        ({"FRAME_CLASS": 1, "FRAME_TYPE": 12}, ["BRcw", "FRccw", "BLccw", "FLcw"]),
        ({"FRAME_CLASS": 1, "FRAME_TYPE": 13}, ["FRccw", "FLcw", "BLccw", "BRcw"]),
        ({"FRAME_CLASS": 1, "FRAME_TYPE": 14}, ["FRccw", "BRcw", "BLccw", "FLcw"]),
        ({"FRAME": 1}, ["FRccw", "BLccw", "FLcw", "BRcw"]),
    ):
        assert _corners(from_parameters("ardupilot", frame, TEN_IN, None)) == corners
    with pytest.raises(GesError, match="helicopter"):
        from_parameters("ardupilot", {"FRAME_CLASS": 6, "FRAME_TYPE": 1}, TEN_IN, None)
    with pytest.raises(UsageError, match="FRAME_TYPE 4"):
        from_parameters("ardupilot", {"FRAME_CLASS": 1, "FRAME_TYPE": 4}, TEN_IN, None)


def test_betaflight_and_its_reversed_props():
    props_in = from_parameters("betaflight", {}, TEN_IN, None)
    props_out = from_parameters("betaflight", {"yaw_motors_reversed": 1}, TEN_IN, None)
    assert _corners(props_in) == ["BRcw", "FRccw", "BLccw", "FLcw"]
    assert _corners(props_out) == ["BRccw", "FRcw", "BLcw", "FLccw"]


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_can_steer_all_axes(name):
    rotors = from_layout(name, TEN_IN, 0.5).rotors
    # a tricopter's tail has a servo in place of an axis of its own
    assert np.linalg.matrix_rank(moments(rotors)) == (2 if len(rotors) == 3 else 3)
    # every frame stands level on equal thrusts, and hubs one over the other turn against each other
    places = [(r.x_m.value, r.y_m.value) for r in rotors]
    np.testing.assert_allclose(np.mean(places, axis=0), 0.0, atol=2e-3)
    for (i, upper), (k, lower) in itertools.combinations(enumerate(rotors), 2):
        if np.allclose(places[i], places[k]):
            assert upper.spin != lower.spin and upper.z_m.value == -lower.z_m.value != 0.0


def test_arms_are_those_given_or_those_that_the_propellers_need():
    given = from_layout("x", TEN_IN, 0.5)
    assert given.arm_m == pytest.approx(0.25, rel=1e-4)
    assert from_layout("x", TEN_IN, None).arm_m == pytest.approx(0.2425, rel=0.01)


def test_nominal_arms_are_scaled_and_touching_rotors_remarked():
    nominal = {k: 10 * v if k.endswith(("_PX", "_PY")) else v for k, v in PX4.items()}
    assert from_parameters("px4", nominal, TEN_IN, None).arm_m < 0.35
    assert from_parameters("px4", nominal, TEN_IN, 0.5).arm_m == pytest.approx(0.25, rel=1e-4)
    crowded = from_parameters("px4", PX4, Propeller.parse("15in"), None)
    assert "would touch" in crowded.remarks[0]
    assert not from_parameters("px4", PX4, TEN_IN, None).remarks


def test_a_log_without_parameters_asks_for_the_layout():
    with pytest.raises(UsageError, match="--frame"):
        from_parameters("table", {}, TEN_IN, None)
    with pytest.raises(UsageError, match="did you mean 'betaflight-x'"):
        from_layout("betaflightx", TEN_IN, None)


HEXA_MIX = """# diff all
mixer CUSTOM
mmix reset
mmix 0  1.000 -0.500  0.866025  1.000
mmix 1  1.000 -0.500 -0.866025  1.000
mmix 2  1.000  0.500  0.866025 -1.000
mmix 3  1.000  0.500 -0.866025 -1.000
mmix 4  1.000 -1.000  0.000 -1.000
mmix 5  1.000  1.000  0.000  1.000
"""


@pytest.fixture
def settings(tmp_path):
    def write(text):
        (tmp_path / "diff.txt").write_text(text)
        return str(tmp_path / "diff.txt")

    return write


def _mounted(airframe):
    return [(round(r.x_m.value, 3), round(r.y_m.value, 3), r.spin) for r in airframe.rotors]


@pytest.mark.parametrize("text", [HEXA_MIX, "mixer HEX6X\n"])
def test_a_mixer_in_settings_is_a_frame(settings, text):
    found = from_layout(settings(text), TEN_IN, 0.5)
    assert _mounted(found) == _mounted(from_layout("betaflight-hexa-x", TEN_IN, 0.5))
    assert "diff.txt" in found.source


def test_props_out_turn_the_mixer_of_settings(settings):
    spins = {
        line: [r.spin for r in from_layout(settings(f"mixer QUADX\n{line}\n"), TEN_IN, 0.5).rotors]
        for line in ("", "set yaw_motors_reversed = ON")
    }
    assert spins[""] == ["cw", "ccw", "ccw", "cw"]
    assert spins["set yaw_motors_reversed = ON"] == ["ccw", "cw", "cw", "ccw"]


def test_of_two_motors_at_one_place_the_first_is_the_upper_one(settings):
    rows = [(r, p, y) for y in (1, -1) for r, p in ((-1, 1), (-1, -1), (1, 1), (1, -1))]
    flip = {(-1, -1), (1, 1)}
    text = "".join(
        f"mmix {k} 1.0 {r} {p} {-y if (r, p) in flip else y}\n" for k, (r, p, y) in enumerate(rows)
    )
    rotors = from_layout(settings(text), TEN_IN, 0.5).rotors
    assert [r.z_m.value > 0 for r in rotors] == [True] * 4 + [False] * 4


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mixer AIRPLANE\n", "mixer AIRPLANE; --frame takes"),
        ("set dyn_lpf = 1\n", "no line 'mmix' and no line 'mixer'"),
        (
            HEXA_MIX.replace("1.000  1.000  0.000  1.000", "1.000 0.0 0.0 1.0"),
            "motor 6 has no part",
        ),
        (HEXA_MIX.replace("0.500  0.866025 -1.000", "0.500 0.866 0"), "motor 3 has no part in yaw"),
    ],
)
def test_settings_that_place_no_motors_are_refused(settings, text, said):
    with pytest.raises(GesError, match=re.escape(said)):
        from_layout(settings(text), TEN_IN, 0.5)
