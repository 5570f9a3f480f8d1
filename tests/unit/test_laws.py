"""Laws: read as they are written, refused with a sentence, flown to the same bits in any lane."""

import ctypes
import re
import subprocess

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ges.conventions import QUATERNION
from ges.errors import GesError, UsageError
from ges.simulator import effects, flight, laws
from ges.simulator.effects import Samples, sample_rows
from ges.simulator.parameters import parameters
from ges.simulator.terrain import Terrain
from ges.vehicle.file import Vehicle, parse_vehicle, vehicle_content
from ges.vehicle.law_export import law_as


def _term(channel):
    exponents = st.dictionaries(st.sampled_from(list(laws.groups())), st.integers(1, 3), max_size=3)
    metres = st.floats(-1e3, 1e3, allow_nan=False)
    place = st.tuples(metres, metres, st.floats(1e-3, 1e3))
    return st.builds(
        laws.Term.of,
        st.just(channel),
        st.sampled_from(laws.SCALES),
        exponents,
        exponents,
        st.one_of(st.just((0.0, 0.0, 0.0)), place),
    )


@given(st.data(), st.sampled_from(laws.CHANNELS))
def test_what_is_written_is_read_again(data, channel):
    form = data.draw(
        st.dictionaries(
            _term(channel), st.floats(-1e6, 1e6, allow_nan=False), min_size=1, max_size=4
        )
    )
    assert laws.parse(channel, laws.written(form)) == form


@pytest.mark.parametrize(
    ("channel", "text", "says"),
    [
        ("force_y", "0.1 m g L (V_x/v_h)", "not a force"),
        ("moment_x", "0.1 T (V_x/v_h)", "not a moment"),
        ("force_x", "0.12 V_x", "a term is a number"),
        ("force_x", "1 m g (V_w/v_h)", "did you mean"),
        ("force_q", "1 m g", "did you mean"),
        ("force_x", "", "a term is a number"),
        ("force_x", "1 m g 2 T", "a term is a number"),
        ("force_x", "1 m g (V_x/v_h) + 2 m g (V_x/v_h)", "twice"),
        ("force_x", "1 m g near(1 m, 2 m, 0 m)", "no width"),
        ("force_x", "1 m g near(1, 2, 3)", "a term is a number"),
    ],
)
def test_what_is_no_law_is_refused_in_a_sentence(channel, text, says):
    with pytest.raises(UsageError, match=says):
        laws.parse(channel, text)


def _samples(n=37, seed=0):
    rng = np.random.default_rng(seed)
    columns = {name: rng.normal(size=n) for name in sample_rows(4)}
    q = rng.normal(size=(n, 4))
    columns |= dict(zip(QUATERNION, (q / np.linalg.norm(q, axis=1)[:, None]).T, strict=True))
    columns |= {f"rotor_speed_{i}_rad_s": 500.0 + 50.0 * rng.normal(size=n) for i in range(1, 5)}
    columns |= {"t_s": 0.01 * np.arange(n), "battery_V": 15.0 + rng.normal(size=n)}
    return columns, Samples.from_columns(columns)


def test_groups_are_quantities_over_their_references():
    """Against the definitions of docs/laws.md, in other words than the simulator's."""
    columns, samples = _samples()
    p = {name: known.default for name, known in parameters().items()}
    weight = p["mass_kg"] * p["gravity_m_s2"]
    radius, arm = p["rotor_1_radius_m"], np.hypot(p["rotor_1_x_m"], p["rotor_1_y_m"])
    v_h = np.sqrt(weight / (2.0 * p["rho_kg_m3"] * 4.0 * np.pi * radius**2))
    speeds = np.array([columns[f"rotor_speed_{i}_rad_s"] for i in range(1, 5)])
    want = {
        "V_h/v_h": np.hypot(columns["v_x_m_s"], columns["v_y_m_s"]) / v_h,
        "v_z/v_h": columns["v_z_m_s"] / v_h,
        "q/w_g": columns["omega_y_rad_s"] / np.sqrt(p["gravity_m_s2"] / arm),
        "x/L": columns["p_x_m"] / arm,
        "w/w_h": speeds.mean(axis=0) / np.sqrt(weight / (4.0 * p["thrust_coefficient_N_s2"])),
        "U/U_0": columns["battery_V"] / p["battery_nominal_V"],
    }
    terms = [laws.Term.of("force_x", "m g", {name: 1}) for name in want]
    got = effects.evaluate_terms(terms, {}, samples, {}, Terrain.flat())
    for k, values in enumerate(want.values()):
        assert got[:, k] == pytest.approx(weight * values, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("channel", laws.CHANNELS)
def test_a_law_adds_its_terms_in_its_channel_alone(channel):
    _, samples = _samples()
    arm = " L" if channel.startswith("moment") else ""
    form = (
        f"0.3 T{arm} (V_y/v_h)|V_y/v_h| (R/h) - 0.02 m g{arm} (q/w_g)^2"
        f" + 0.1 m g{arm} (v_z/v_h) near(0.3 m, -0.5 m, 0.8 m)"
    )
    terms = laws.parse(channel, form)
    added = effects.evaluate("law", {t.key: c for t, c in terms.items()}, samples, {})
    wrench = np.hstack([added.force_N, added.moment_Nm])
    at = laws.CHANNELS.index(channel)
    want = effects.evaluate_terms(list(terms), {}, samples, {}, Terrain.flat()) @ list(
        terms.values()
    )
    assert wrench[:, at] == pytest.approx(want, rel=1e-9, abs=1e-9)
    assert not np.delete(wrench, at, axis=1).any()


def test_a_place_is_a_bell_about_it():
    columns, samples = _samples()
    (term,) = laws.parse("force_z", "1 m g near(0.3 m, -0.5 m, 0.8 m)")
    p = {name: known.default for name, known in parameters().items()}
    away = (columns["p_x_m"] - 0.3) ** 2 + (columns["p_y_m"] + 0.5) ** 2
    want = p["mass_kg"] * p["gravity_m_s2"] * np.exp(-away / (2.0 * 0.8**2))
    added = effects.evaluate("law", {term.key: 1.0}, samples, {}).force_N[:, 2]
    assert added == pytest.approx(want, rel=1e-9)
    assert effects.evaluate_terms([term], {}, samples, {}, Terrain.flat())[:, 0] == pytest.approx(
        want
    )
    assert term.needs == {"position"}


LAW = {
    "moment_x: m g L near(0.5 m, 0.1 m, 0.4 m)": 0.01,
    "force_y: m g (V_x/v_h)": 0.1,
    "force_z: T (R/h)^2": 0.05,
    "moment_z: m g L (r/w_g)": -0.01,
    "force_x: m g (U/U_0) |V_x/v_h|": -0.02,
}


def _flights():
    sag = {"battery_sag": {}}
    return [
        flight.Flight({"duration_s": 2.0, "seed": k}, {"law": LAW, **(sag if k % 2 else {})})
        for k in range(5)
    ]


def test_flights_with_laws_have_the_same_bits_in_any_lane():
    flown = [flight.fly(_flights(), lanes=lanes) for lanes in (1, 2, 4, 8)]
    for others in flown[1:]:
        for one, other in zip(flown[0], others, strict=True):
            assert all(np.array_equal(one[c], other[c], equal_nan=True) for c in one.columns)
    plain = flight.fly([flight.Flight({"duration_s": 2.0, "seed": 0})])[0]
    assert not np.array_equal(plain["p_y_m"], flown[0][0]["p_y_m"])


def test_more_terms_than_fit_are_refused():
    many = {laws.Term.of("force_x", "T", {"x/L": n, "y/L": 1}).key: 1.0 for n in range(1, 40)}
    with pytest.raises(Exception, match="39 terms; at most"):
        flight.fly([flight.Flight({}, {"law": many})])


SHEET = {
    "name": "plain",
    "mass_kg": 1.5,
    "rotors": [
        {"x_m": x, "y_m": y, "radius_m": 0.12, "spin": spin}
        for x, y, spin in ((1, 1, "cw"), (-1, 1, "ccw"), (-1, -1, "cw"), (1, -1, "ccw"))
    ],
    "thrust_coefficient_N_s2": 1e-5,
}


def test_a_vehicle_file_holds_laws_and_gives_them_back():
    written = [{"channel": "force_y", "form": "0.0975 m g (V_x/v_h)", "sd": [0.0002]}]
    vehicle = parse_vehicle({**SHEET, "laws": written})
    assert vehicle.effect_values()["law"] == {"force_y: m g (V_x/v_h)": 0.0975}
    assert vehicle_content(vehicle)["laws"] == written
    assert "laws" not in vehicle_content(parse_vehicle(SHEET))
    assert isinstance(vehicle, Vehicle)


@pytest.mark.parametrize(
    ("law", "says"),
    [
        ({"channel": "force_y", "form": "0.1 V_x"}, "laws.0: the law of force_y cannot be read"),
        ({"channel": "force_y", "form": "0.1 m g", "sd": [1, 2]}, "one for each"),
        ({"channel": "force_y", "form": "0.1 m g", "sd": [-1]}, "laws.0.sd.0"),
        ({"channel": "force_y", "from": "0.1 m g"}, "did you mean 'form'"),
    ],
)
def test_a_vehicle_file_with_a_wrong_law_is_refused_in_a_sentence(law, says):
    with pytest.raises(UsageError, match=says):
        parse_vehicle({**SHEET, "laws": [law]}, "vehicle.yaml")


def test_two_laws_of_one_channel_are_one_form():
    law = {"channel": "force_y", "form": "0.1 m g"}
    with pytest.raises(UsageError, match="more than one law"):
        parse_vehicle({**SHEET, "laws": [law, law]})


FORMS = {
    "force_y": "0.1 m g (V_x/v_h)|V_h/v_h| - 0.2 T (R/h)^2",
    "force_z": "-0.03 m g (V_h/v_h)^2 + 0.01 T (U/U_0) (v_z/v_h)",
    "moment_z": "0.02 T L (q/w_g)|q/w_g|^2 + 0.001 m g L (x/L) (w/w_h) near(0.2 m, 0.4 m, 0.9 m)",
}


def _state(columns, samples):
    """What a caller of an exported law knows, (n,) by symbol."""
    replayed = effects.replay({}, samples, {})
    k_t = parameters()["thrust_coefficient_N_s2"].default
    to_body = Rotation.from_quat(
        np.stack([columns[q] for q in QUATERNION], axis=1), scalar_first=True
    ).inv()
    v = to_body.apply(np.stack([columns[f"v_{a}_m_s"] for a in "xyz"], axis=1))
    speeds = np.array([columns[f"rotor_speed_{i}_rad_s"] for i in range(1, 5)])
    return {
        "T": k_t * (speeds**2).sum(axis=0),
        **dict(zip(("V_x", "V_y", "V_z"), v.T, strict=True)),
        "V_h": np.hypot(columns["v_x_m_s"], columns["v_y_m_s"]),
        "v_z": columns["v_z_m_s"],
        "q": columns["omega_y_rad_s"],
        "x": columns["p_x_m"],
        "y": columns["p_y_m"],
        "w": speeds.mean(axis=0),
        "U": columns["battery_V"],
        "h": np.mean([replayed[f"rotor_height_{i}_m"] for i in range(1, 5)], axis=0),
    }


@pytest.fixture(scope="module")
def exported():
    """A vehicle with laws, what the simulator makes of them, and the state, sample by sample."""
    defaults = {k: p.default for k, p in parameters().items()}
    rotors = [
        {f"{a}_m": defaults[f"rotor_{i}_{a}_m"] for a in "xyz"}
        | {"radius_m": defaults[f"rotor_{i}_radius_m"]}
        | {"spin": "ccw" if defaults[f"rotor_{i}_spin"] > 0 else "cw"}
        for i in range(1, 5)
    ]
    written = [{"channel": c, "form": form} for c, form in FORMS.items()]
    numbers = {k: defaults[k] for k in ("mass_kg", "thrust_coefficient_N_s2", "rho_kg_m3")}
    vehicle = parse_vehicle({"name": "test", **numbers, "rotors": rotors, "laws": written})
    columns, samples = _samples()
    added = effects.evaluate("law", vehicle.effect_values()["law"], samples, {})
    return vehicle, np.hstack([added.force_N, added.moment_Nm]), _state(columns, samples)


def _arguments(text, state):
    names = re.search(r"law\(([^)]*)\)", text)[1].replace("double ", "").split(", ")
    return [state[n] for n in names if n in state]


def test_an_exported_law_is_the_simulators_in_python(exported):
    vehicle, want, state = exported
    text, space = law_as(vehicle, "python"), {}
    exec(text, space)
    for sample, row in zip(zip(*_arguments(text, state), strict=True), want, strict=True):
        force, moment = space["law"](*sample)
        assert [*force, *moment] == pytest.approx(row, rel=1e-9, abs=1e-9)


def test_an_exported_law_is_the_simulators_in_c(exported, tmp_path):
    vehicle, want, state = exported
    text = law_as(vehicle, "c")
    source, built = tmp_path / "law.c", tmp_path / "law.so"
    source.write_text(text.replace("static void", "void"))
    subprocess.run(
        ["cc", "-Wall", "-Werror", "-shared", "-fPIC", "-o", built, source, "-lm"], check=True
    )
    law = ctypes.CDLL(str(built)).law
    for sample, row in zip(zip(*_arguments(text, state), strict=True), want, strict=True):
        force, moment = (ctypes.c_double * 3)(), (ctypes.c_double * 3)()
        law(*map(ctypes.c_double, sample), force, moment)
        assert [*force, *moment] == pytest.approx(row, rel=1e-9, abs=1e-9)


def test_a_vehicle_without_laws_has_none_to_export():
    with pytest.raises(GesError, match="has no laws"):
        law_as(parse_vehicle(SHEET), "python")
