"""Other simulators' vehicles: read as they fly there, written so that they come back, never run."""

import math
import warnings

import numpy as np
import pytest

from ges.conventions import GRAVITY_M_S2
from ges.errors import GesError, UsageError
from ges.simulator import effects as effect_table
from ges.vehicle import formats, library
from ges.vehicle.file import Vehicle
from ges.vehicle.formats import neutral, rotorpy, sdf, sih, urdf
from ges.vehicle.load import load_vehicle
from ges.vehicle.propeller import Propeller

from . import models

FLYING = {
    "t_s": np.zeros(1),
    "p_z_m": np.array([50.0]),
    "v_x_m_s": np.array([3.0]),
    "v_y_m_s": np.array([-2.0]),
    "v_z_m_s": np.array([1.0]),
    **{f"rotor_speed_{i + 1}_rad_s": np.array([w]) for i, w in enumerate((610, 650, 590, 700.0))},
}


def _wrench(vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray]:
    samples = effect_table.Samples.from_columns(FLYING)
    said = effect_table.replay(vehicle.parameters(), samples, vehicle.effect_values())
    return said.force_N[0], said.moment_Nm[0]


@pytest.fixture
def gazebo(tmp_path):
    """Folder of Gazebo models as PX4 has it."""
    for name, text in (("iris", models.iris()), ("x500", models.x500())):
        (tmp_path / name).mkdir()
        (tmp_path / name / "model.sdf").write_text(text)
    (tmp_path / "x500_base").mkdir()
    (tmp_path / "x500_base" / "model.sdf").write_text(models.x500_base())
    return tmp_path


def _read(path, **more):
    return formats.read_model(path, formats.kind_of(path), **more)


def _written(tmp_path, vehicle, kind):
    ending = {"sdf": ".sdf", "rotorpy": ".py", "urdf": ".urdf", "sih": ".params"}[kind]
    path = tmp_path / f"back{ending}"
    path.write_text(formats.write_model(vehicle, kind).text)
    assert formats.kind_of(path) == kind
    return path


def test_gazebo_iris(gazebo):
    sheet = _read(gazebo / "iris" / "model.sdf")
    v = sheet.vehicle
    assert v.mass_kg.value == pytest.approx(1.5 + 0.015 + 0.01 + 4 * 0.005)
    assert v.thrust_coefficient_N_s2.value == 5.84e-6 and v.thrust_coefficient_N_s2.sd == 0
    assert v.torque_coefficient_Nm_s2.value == pytest.approx(5.84e-6 * 0.06)
    assert v.rotors[0].radius_m.value == 0.128
    assert [r.spin for r in v.rotors] == ["ccw", "ccw", "cw", "cw"]
    hubs = [(round(r.x_m.value, 6), round(r.y_m.value, 6)) for r in v.rotors]
    assert hubs == list(models.IRIS_HUBS)
    assert v.rotors[0].z_m.value == pytest.approx(0.023 * (1.545 - 0.02) / 1.545)
    assert v.effects["rotor_drag"]["k_kg"].value == 0.000175
    assert v.effects["motor_lag"]["down_s"].value == pytest.approx(0.0125)
    # the command map of its mavlink interface, 1000 u + 100 rad/s, at the hover command
    hover, c = v.hover_speed_rad_s(), v.effects["thrust_curve"]["c"].value
    u = (hover - 100) / 1000
    assert v.max_rotor_speed_rad_s.value * math.sqrt((1 - c) * u * u + c * u) == pytest.approx(
        hover
    )
    assert any("25 m/s" in remark for remark in sheet.remarks)


def test_gazebo_inertia_is_that_of_all_links(gazebo):
    """Parallel axes by hand: base and four rotors of the x500 about their common centre."""
    v = _read(gazebo / "x500" / "model.sdf").vehicle
    blade, mass = 0.0160769231, 2.0 + 4 * 0.0160769231
    centre = 4 * blade * 0.06 / mass
    ixx = 0.0216666667 + 2.0 * centre**2
    ixx += 4 * (3.84649105e-07 + blade * (0.174**2 + (0.06 - centre) ** 2))
    izz = 0.04 + 4 * (2.64985823e-05 + blade * 2 * 0.174**2)
    assert v.inertia_kg_m2.xx == pytest.approx(ixx, rel=1e-6)
    assert v.inertia_kg_m2.zz == pytest.approx(izz, rel=1e-6)


def test_gazebo_includes_are_looked_up_beside_the_model_or_where_told(gazebo, tmp_path):
    lonely = tmp_path / "elsewhere" / "x500"
    lonely.mkdir(parents=True)
    (lonely / "model.sdf").write_text(models.x500())
    with pytest.raises(UsageError, match="--models"):
        _read(lonely / "model.sdf")
    assert _read(lonely / "model.sdf", models=[gazebo]).vehicle.name == "x500"


def test_gazebo_poses_turn_with_their_frames(gazebo):
    """The same iris, its base link turned by 90 degrees in the model: nothing changes."""
    text = models.iris().replace(
        "<link name='base_link'>",
        "<link name='base_link'><pose>1 2 3 0 0 1.5707963267948966</pose>",
    )
    path = gazebo / "iris" / "turned.sdf"
    path.write_text(
        text.replace("<model name='gps0'>", "<model name='gps0'><pose>1 2 3 0 0 0</pose>")
    )
    straight = _read(gazebo / "iris" / "model.sdf").vehicle
    turned = _read(path).vehicle
    assert np.allclose(turned.rotor_arrays()["x_m"], straight.rotor_arrays()["x_m"])
    assert np.allclose(turned.rotor_arrays()["y_m"], straight.rotor_arrays()["y_m"])
    assert turned.inertia_kg_m2.xx == pytest.approx(straight.inertia_kg_m2.xx)
    assert turned.inertia_kg_m2.yy == pytest.approx(straight.inertia_kg_m2.yy)


def test_rotorpy_hummingbird(tmp_path):
    path = tmp_path / "hummingbird_params.py"
    path.write_text(models.HUMMINGBIRD)
    v = _read(path).vehicle
    assert v.mass_kg.value == 0.5 and v.rotors[0].radius_m.value == 0.1
    assert v.rotors[0].x_m.value == pytest.approx(0.17 / math.sqrt(2))
    assert [r.spin for r in v.rotors] == ["cw", "ccw", "cw", "ccw"]


def test_rotorpy_gives_the_same_wrench_as_the_vehicle_read_from_it():
    multirotor = pytest.importorskip("rotorpy.vehicles.multirotor", reason="extra 'simulators'")
    from rotorpy.vehicles import crazyflie_params, hummingbird_params

    for params in (hummingbird_params.quad_params, crazyflie_params.quad_params):
        params = {**params, "k_h": 0.0}  # the one term whose form differs
        vehicle = rotorpy.from_parameters(params).vehicle
        theirs = multirotor.Multirotor(params)
        speeds = np.array([FLYING[f"rotor_speed_{i + 1}_rad_s"][0] for i in range(4)])
        air = np.array([FLYING[f"v_{axis}_m_s"][0] for axis in "xyz"])
        force, moment = theirs.compute_body_wrench(np.zeros(3), speeds, air)
        ours = _wrench(vehicle)
        assert np.allclose(ours[0], force, rtol=1e-6, atol=1e-9)
        assert np.allclose(ours[1], moment, rtol=1e-6, atol=1e-9)


def test_pybullet_crazyflie(tmp_path):
    path = tmp_path / "cf2x.urdf"
    path.write_text(models.cf2x())
    sheet = _read(path)
    v = sheet.vehicle
    hover_rpm = math.sqrt(0.027 * GRAVITY_M_S2 / (4 * 3.16e-10))
    assert v.hover_speed_rad_s() == pytest.approx(hover_rpm * math.pi / 30)
    top = v.max_rotor_speed_rad_s.value
    assert 4 * v.thrust_coefficient_N_s2.value * top**2 == pytest.approx(
        2.25 * 0.027 * GRAVITY_M_S2
    )
    # BaseAviary: z_torque = -t0 + t1 - t2 + t3, x_torque grows with propellers 0 and 1
    _, moment = _wrench(v)
    t = v.torque_coefficient_Nm_s2.value * np.array([610, 650, 590, 700.0]) ** 2
    assert moment[2] == pytest.approx(-t[0] + t[1] - t[2] + t[3])
    assert v.effects == {} and any("10.66" in r for r in sheet.remarks)


def test_sih_parameters_of_a_script_and_of_a_parameter_file(tmp_path):
    path = tmp_path / "10040_sihsim_quadx"
    path.write_text(models.SIH)
    v = _read(path).vehicle
    assert v.mass_kg.value == 1.2
    assert (v.rotors[0].x_m.value, v.rotors[0].y_m.value) == pytest.approx((0.2, -0.18))
    top = v.max_rotor_speed_rad_s.value
    assert v.thrust_coefficient_N_s2.value * top**2 == pytest.approx(6.0)
    assert v.torque_coefficient_Nm_s2.value * top**2 == pytest.approx(0.1)
    # sih.cpp: F = -SIH_KDV v; at hover thrust the same
    drag = v.effects["rotor_drag"]["k_kg"].value
    assert drag * 4 * v.hover_speed_rad_s() == pytest.approx(0.5)
    assert v.effects["thrust_curve"]["c"].value == 1.0


@pytest.mark.parametrize("kind", formats.WRITERS)
@pytest.mark.parametrize("name", library.names())
def test_every_vehicle_of_the_library_comes_back_from_every_format(name, kind, tmp_path):
    """Weight, hubs, spins, inertia, thrust, and the torque of each rotor survive."""
    start = load_vehicle(name)
    if len(start.rotors) != 4 and kind in ("urdf", "sih"):
        with pytest.raises(GesError, match="is no X quadrotor"):
            formats.write_model(start, kind)
        return
    back = _read(_written(tmp_path, start, kind)).vehicle
    a, b = neutral.plain(start), neutral.plain(back)
    order = _order(a, b)
    assert b.mass_kg == pytest.approx(a.mass_kg, rel=1e-6)
    assert b.inertia_kg_m2 == pytest.approx(a.inertia_kg_m2, rel=1e-6)
    flat = kind == "sih"
    assert np.allclose(
        b.hubs_m[:, : 2 if flat else 3],
        a.hubs_m[order][:, : 2 if flat else 3],
        atol=0.02 if flat else 1e-6,
    )
    if kind in ("sdf", "rotorpy"):
        assert np.array_equal(b.spin, a.spin[order])
    if kind != "sih":
        assert b.thrust_N_s2 == pytest.approx(a.thrust_N_s2[order], rel=1e-6)
    largest = [p.mean_thrust_N_s2 * p.top_speed_rad_s**2 for p in (a, b)]
    assert largest[1] == pytest.approx(largest[0], rel=1e-5)
    turning = [p.mean_torque_Nm_s2 / p.mean_thrust_N_s2 for p in (a, b)]
    assert turning[1] == pytest.approx(turning[0], rel=1e-5)


def _order(a: neutral.Plain, b: neutral.Plain) -> list[int]:
    """The rotor of ``a`` that each of ``b`` is, by its place."""
    gaps = np.linalg.norm(a.hubs_m[:, None] - b.hubs_m[None, :], axis=2)
    return [int(k) for k in np.argmin(gaps, axis=0)]


LEARNED = {
    "rotor_drag": {"k_kg": 9e-5},
    "axial_inflow": {"k_kg": 2e-4},
    "parasitic_drag": {"area_m2": 0.02, "vertical_ratio": 1.5},
    "ground_effect": {"amplitude": 2.0},
    "thrust_scale": {"scale": -0.1},
    "weak_rotor": {"loss_1": 0.0, "loss_2": 0.12, "loss_3": 0.0, "loss_4": 0.0},
    "cg_offset": {"x_m": 0.004, "y_m": -0.003},
    "motor_lag": {"up_s": 0.01, "down_s": 0.02},
    "torque_coefficient": {"scale": 0.3},
    "inertia": {"xx": 0.1, "yy": -0.1, "zz": 0.2},
}


@pytest.fixture
def fitted():
    """A vehicle into which a diagnosis wrote what it learned."""
    content = load_vehicle("gazebo-x500").model_dump()
    return Vehicle.model_validate({**content, "effects": LEARNED})


def _same(ours, theirs) -> bool:
    """Equal forces, and moments to a thousandth of weight times arm: a moved centre of mass turns
    corrections of thrust and drag too, which the effect leaves out as of second order.
    """
    return np.allclose(ours[0], theirs[0], rtol=1e-6) and np.allclose(
        ours[1], theirs[1], atol=1e-3 * 2.06 * GRAVITY_M_S2 * 0.246 * 2
    )


def test_what_was_learned_goes_into_a_gazebo_model(fitted, tmp_path):
    """Thrust scale, a weak rotor, drag, lag, torque, inertia and the centre of mass are in it."""
    back = _read(_written(tmp_path, fitted, "sdf")).vehicle
    shown = {k: v for k, v in LEARNED.items() if k not in ("axial_inflow", "parasitic_drag")}
    shown.pop("ground_effect")
    expected = _wrench(Vehicle.model_validate({**fitted.model_dump(), "effects": shown}))
    assert _same(_wrench(back), expected)
    plain = neutral.plain(back)
    assert (plain.lag_up_s, plain.lag_down_s) == pytest.approx((0.0225, 0.0325))
    assert back.inertia_kg_m2.xx == pytest.approx(1.1 * fitted.inertia_kg_m2.xx)


def test_what_was_learned_goes_into_rotorpy(fitted, tmp_path):
    effects = {k: v for k, v in LEARNED.items() if k not in ("ground_effect", "weak_rotor")}
    vehicle = Vehicle.model_validate({**fitted.model_dump(), "effects": effects})
    back = _read(_written(tmp_path, vehicle, "rotorpy")).vehicle
    assert _same(_wrench(back), _wrench(vehicle))


@pytest.mark.parametrize(("coupling", "said"), [(1.0, False), (0.3, True)])
def test_rotorpy_is_told_of_a_drag_by_axis(coupling, said, fitted):
    drag = {"parasitic_drag": {"area_m2": 0.02, "coupling": coupling}}
    vehicle = Vehicle.model_validate({**fitted.model_dump(), "effects": drag})
    export = formats.write_model(vehicle, "rotorpy")
    assert any("coupling 0.3" in r for r in export.remarks) == said


@pytest.mark.parametrize(
    ("name", "lever", "said"),
    [("rotorpy", 1.0, ""), ("rotorpy", 0.2, "at the hubs"), ("sdf", 0.0, "at the hubs")]
    + [("urdf", 0.0, ""), ("urdf", 1.0, "at the centre of mass")],
)
def test_others_are_told_where_their_rotor_drag_acts(name, lever, said, fitted):
    drag = {"rotor_drag": {"k_kg": 2e-5, "lever": lever}}
    vehicle = Vehicle.model_validate({**fitted.model_dump(), "effects": drag})
    remarks = formats.write_model(vehicle, name).remarks
    assert [f"acts {said}" in r for r in remarks if "rotor drag" in r] == [True] * bool(said)


def test_ground_effect_goes_into_pybullet_with_equal_gain_at_one_radius(fitted):
    text = formats.write_model(fitted, "urdf").text
    gain = float(text.split('gnd_eff_coeff="')[1].split('"')[0])
    assert gain / 16 == pytest.approx(2.0 * (1 / (1 - 1 / 16) - 1), rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "left_out"),
    [
        ("sdf", ["axial_inflow", "parasitic_drag", "ground_effect"]),
        ("rotorpy", ["ground_effect"]),
        ("urdf", ["parasitic_drag"]),
        ("sih", ["parasitic_drag", "ground_effect"]),
    ],
)
def test_what_a_format_cannot_express_is_said_there_and_in_the_file(fitted, kind, left_out):
    export = formats.write_model(fitted, kind)
    said = [r.split("has no ")[1].split(" ")[0] for r in export.remarks if "has no " in r]
    assert said == left_out
    flat = " ".join(export.text.replace("#", " ").split())
    for remark in export.remarks:
        assert " ".join(remark.replace("--", "- -").split()) in flat


HOSTILE = {
    "lol.sdf": '<!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><sdf><model>&b;</model></sdf>',
    "file.urdf": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>',
    "deep.sdf": "<sdf>" + "<model>" * 20000,
    "circle.sdf": models.iris().replace(
        "<pose relative_to='base_link'>0.13", "<pose relative_to='rotor_0'>0.13"
    ),
    "noframe.sdf": models.iris().replace("relative_to='base_link'", "relative_to='nowhere'"),
    "nan.sdf": models.iris().replace("5.84e-06", "nan"),
    "word.sdf": models.iris().replace("5.84e-06", "strong"),
    "massless.sdf": models.iris().replace("<mass>", "<mass>-"),
    "hexa.sdf": models.iris().replace("<motorNumber>3", "<motorNumber>2"),
    "path.sdf": models.x500().replace("model://x500_base", "model://../../etc"),
    "itself.sdf": models.x500().replace("model://x500_base", "model://self"),
    "pose.sdf": models.iris().replace("0.13 -0.22 0.023 0 -0 0", "0.13 -0.22"),
    "zero.urdf": models.cf2x().replace("kf='3.16e-10'", "kf='0'"),
    "no_props.urdf": models.cf2x().replace("prop3_link", "wing"),
    "plain.urdf": "<robot name='arm'><link name='base_link'/></robot>",
    "run.py": "import os\nos.system('touch /tmp/ges-was-here')\nquad_params = {'mass': open('x')}",
    "bomb.py": "quad_params = {'mass': 9**9**9**9, 'Ixx': 1}",
    "text.py": "quad_params = {'mass': 'a' * 10**10}",
    "list.py": "quad_params = {'mass': [0] * 10**10}",
    "broken.py": "quad_params = {",
    "none.py": "x = 3",
    "poor.py": "quad_params = {'mass': 1}",
    "deep.py": "quad_params = " + "(" * 5000 + ")" * 5000,
    "three.py": models.HUMMINGBIRD.replace("np.array([1,-1,1,-1])", "np.array([1,-1,1])"),
    "word.py": models.HUMMINGBIRD.replace("5.57e-06", "'much'"),
    "plane.params": "SIH_VEHICLE_TYPE 1\nSIH_MASS 1\n",
    "word.params": "SIH_MASS heavy\n",
    "zero.params": "SIH_MASS 0\n",
    "unknown.params": "SIH_FOO 1\n",
    "latin.params": "SIH_MASS 1 # caf\xe9\n".encode("latin-1"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_end_in_one_sentence(name, tmp_path):
    folder = tmp_path / "self"
    folder.mkdir()
    path = folder / name
    content = HOSTILE[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if name == "itself.sdf":
        (folder / "model.sdf").write_text(content)
    with warnings.catch_warnings(), pytest.raises(GesError) as caught:
        warnings.simplefilter("error")
        _read(path)
    said = str(caught.value)
    assert "\n" not in said and len(said) < 400
    assert not (tmp_path.parent / "ges-was-here").exists()


def test_a_python_file_is_never_run(tmp_path):
    trap = tmp_path / "trap"
    path = tmp_path / "evil_params.py"
    path.write_text(models.HUMMINGBIRD + f"\nopen({str(trap)!r}, 'w').write('ran')\n")
    assert _read(path).vehicle.mass_kg.value == 0.5
    assert not trap.exists()


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (lambda data, tmp: sdf.read(data, tmp / "iris.sdf"), models.iris()),
        (lambda data, _: urdf.read(data, "cf2x.urdf"), models.cf2x()),
        (lambda data, _: rotorpy.read(data, "hummingbird.py"), models.HUMMINGBIRD),
        (lambda data, _: sih.read(data, "sih.params"), models.SIH),
    ],
    ids=["sdf", "urdf", "rotorpy", "sih"],
)
def test_mutated_files_end_in_a_vehicle_or_a_sentence(read, text, tmp_path):
    """Bytes changed, dropped, doubled and swapped at random; GES_MUTANTS raises their number."""
    import os

    rng = np.random.default_rng(7)
    original = text.encode()
    for _ in range(int(os.environ.get("GES_MUTANTS", "150"))):
        data = bytearray(original)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(len(data)))
            match int(rng.integers(4)):
                case 0:
                    data[at] = int(rng.integers(256))
                case 1:
                    del data[at : at + int(rng.integers(1, 30))]
                case 2:
                    data[at:at] = data[at : at + int(rng.integers(1, 30))]
                case _:
                    other = int(rng.integers(len(data)))
                    data[at], data[other] = data[other], data[at]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SyntaxWarning)
                sheet = read(bytes(data), tmp_path)
        except GesError:
            continue
        assert sheet.to_yaml()


def test_radius_as_given_wins(tmp_path):
    path = tmp_path / "cf2x.urdf"
    path.write_text(models.cf2x())
    found = _read(path, prop=Propeller.parse("50mm")).vehicle
    assert found.rotors[0].radius_m.value == pytest.approx(0.025)
