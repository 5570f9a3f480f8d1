"""The second author shares neither code nor form with the first generator or with the candidates,
and is right in the limits that theory knows.
"""

from __future__ import annotations

import ast
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from ges.blind import generator
from ges.blind import second as second_author
from ges.blind.generator import attached as first_attached
from ges.blind.generator import drive as first_drive
from ges.blind.second import air, attached, drive, ground, rotor

SECOND = sorted(Path(second_author.__file__).parent.glob("[!_]*.py"))
FIRST = sorted(Path(generator.__file__).parent.glob("[!_]*.py"))
ALLOWED = ("ges.blind.second", "ges.blind.noise")
X = np.linspace(0.6, 6.0, 60)
LEAST_UNLIKE = 0.01
"""Share of a form's rms that the nearest form of another author must leave."""


def _imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module or ''}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("path", SECOND, ids=lambda p: p.stem)
def test_second_author_imports_nobody_elses_physics(path):
    own = [i for i in _imports(path) if i.startswith("ges")]
    assert not [i for i in own if not f"{i}.".startswith(tuple(f"{a}." for a in ALLOWED))]
    assert not {"ctypes", "cffi", "importlib"} & {i.split(".")[0] for i in _imports(path)}


def test_first_generator_does_not_import_the_second():
    assert not [p for p in FIRST for i in _imports(p) if i.startswith("ges.blind.second")]


def _shapes(paths) -> dict[str, str]:
    """Bodies of functions without names and docstrings, by where they are."""
    shapes = {}
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                for part in (p for b in body for p in ast.walk(b)):
                    if isinstance(part, ast.Name):
                        part.id = "x"
                    if isinstance(part, ast.arg):
                        part.arg = "x"
                text = "".join(ast.dump(b) for b in body)
                if len(text) > 400:
                    shapes[text] = f"{path.stem}.{node.name}"
    return shapes


def test_no_function_has_the_shape_of_one_of_the_first_generator():
    first, second = _shapes(FIRST), _shapes(SECOND)
    assert len(first) > 50 and len(second) > 20
    shared = {second[s]: first[s] for s in second if s in first}
    assert not shared


def _unlike(curve: np.ndarray, form, start) -> float:
    """Share of a curve's rms that the best member of a family of forms leaves."""
    found = least_squares(lambda p: form(p) - curve, start, max_nfev=400)
    return float(np.sqrt(np.mean(found.fun**2) / np.mean(curve**2)))


def _ground_gain(gain: float = 0.1) -> np.ndarray:
    table = rotor.table_of(0.9, 0.0145).near_ground
    share = float(np.interp(-(1.0 + gain), -table, rotor.SHARES))
    blocked = (1.0 - share) / ground.blocked_share(np.array(1.0)) * ground.blocked_share(X)
    return rotor.near_ground_thrust(table[None], 1.0 - blocked[:, None])[:, 0] - 1.0


def _sanchez_cuevas(p):
    b, d = p[1], p[1] / np.sqrt(2.0)
    u = (0.25 / X) ** 2 + X / (d**2 + 4 * X**2) ** 1.5
    u = u + (0.5 + 2.0 * p[2]) * X / (b**2 + 4.0 * X**2) ** 1.5
    return p[0] * (1.0 / np.maximum(1.0 - u, 0.2) - 1.0)


CUSHIONS = {
    "Cheeseman and Bennett": (lambda p: p[0] / (1.0 - (0.25 / X) ** 2) - p[0], [1.0]),
    "Hayden": (
        lambda p: p[0] * (np.maximum(0.9926 + 0.0379 * (2 / X) ** 2, 1.0) ** (2 / 3) - 1.0),
        [1.0],
    ),
    "Sanchez-Cuevas": (_sanchez_cuevas, [1.0, 4.0, 0.5]),
    "exponential": (lambda p: p[0] * np.exp(-p[1] * X), [0.4, 1.5]),
    "rational": (lambda p: p[0] / (1.0 + (p[1] * X) ** 2), [0.4, 1.5]),
    "first generator's sources": (
        lambda p: p[0] * (v := (0.25 / X) ** 2 * p[1]) / (1.0 + v / 0.75),
        [1.0, 1.0],
    ),
}


@pytest.mark.parametrize("name", CUSHIONS)
def test_the_ground_effect_has_a_form_of_its_own(name):
    form, start = CUSHIONS[name]
    assert _unlike(_ground_gain(), form, start) > LEAST_UNLIKE


def test_fountain_has_a_form_of_its_own():
    h = np.linspace(0.05, 4.0, 80)
    curve = ground.fountain_share(h, 1.0)
    assert curve.max() == pytest.approx(1.0, abs=1e-3)
    assert _unlike(curve, lambda p: p[0] * np.exp(-((h / p[1]) ** 2)), [1.0, 1.0]) > LEAST_UNLIKE
    first = first_attached.fountain_share(h[:, None], 1.0, 1.0)[:, 0]
    assert _unlike(curve, lambda p: p[0] * np.interp(h * p[1], h, first), [1, 1]) > LEAST_UNLIKE


def test_fading_in_forward_flight_has_a_form_of_its_own():
    speed = np.linspace(0.0, 12.0, 60)
    way, cosine = ground.wake_path(1.0, speed, 5.0, 2.0)
    curve = ground.blocked_share(way) * cosine
    assert curve[0] == pytest.approx(float(ground.blocked_share(np.array(1.0))))
    form = lambda p: p[0] / (1.0 + (p[1] * speed / 5.0) ** 2)  # noqa: E731
    assert _unlike(curve, form, [0.5, 1.0]) > LEAST_UNLIKE


def test_lift_and_drag_have_forms_of_their_own():
    """Translational lift is not c V^2 / (V^2 + v_h^2), and rotor drag not quite linear in speed."""
    table = rotor.table_of(0.6, 0.0145)
    induced = np.sqrt(0.0145 / 2.0)
    lift = rotor.look_up(table.thrust[None], rotor.EDGES[:, None], 0.0)[:, 0] - 1.0
    form = lambda p: p[0] * rotor.EDGES**2 / (rotor.EDGES**2 + induced**2)  # noqa: E731
    assert lift[-1] > 0.1 and _unlike(lift, form, [1.0]) > LEAST_UNLIKE
    drag = rotor.look_up(table.inplane[None], rotor.EDGES[:, None], 0.0)[:, 0]
    assert drag[-1] > 0.0 and _unlike(drag, lambda p: p[0] * rotor.EDGES, [0.01]) > LEAST_UNLIKE


def test_wind_grows_by_a_form_of_its_own():
    height = np.linspace(0.1, 4.0, 60)
    curve = air.profile(height)
    assert air.profile(np.array(2.0)) == pytest.approx(1.0)

    def logarithm(p):
        return p[0] * np.log(1.0 + height / np.exp(p[1]))

    assert _unlike(curve, logarithm, [0.2, -3.0]) > 0.5 * LEAST_UNLIKE
    assert _unlike(curve, lambda p: p[0] + 0.0 * height, [1.0]) > LEAST_UNLIKE


def test_drive_has_forms_of_its_own():
    u = np.linspace(0.3, 1.0, 60)
    square = drive.bent(u, 0.85) ** 2
    assert square[-1] == pytest.approx(1.0)
    assert _unlike(square, lambda p: (1 - p[0]) * u**2 + p[0] * u, [0.3]) > LEAST_UNLIKE
    droop = lambda p: (  # noqa: E731  the first generator's: duty (1 - r) x + r x^2
        ((np.sqrt((1 - p[0]) ** 2 + 4 * p[0] * u) - (1 - p[0])) / (2 * p[0])) ** 2
    )
    assert _unlike(square, droop, [0.3]) > LEAST_UNLIKE
    volt = np.linspace(0.7, 1.0, 60)
    speed = drive.speed_of_voltage(volt, 1.0) - 1.0
    linear = lambda p: p[0] * (volt / drive.NOMINAL - 1.0)  # noqa: E731
    assert _unlike(speed, linear, [1.0]) > LEAST_UNLIKE


def test_motor_answers_by_a_form_of_its_own_with_the_lag_that_is_declared():
    """A step: not an exponential, but the area over it is the lag."""
    w, rate, rows = np.zeros((1, 1)), np.zeros((1, 1)), []
    for _ in range(600):
        w, rate = drive.step_motor(w, rate, np.ones((1, 1)), 0.04, 1.0, 0.001)
        rows.append(float(w[0, 0]))
    curve, t = np.array(rows), np.arange(1, 601) * 0.001
    assert (1.0 - curve).sum() * 0.001 == pytest.approx(0.04, rel=0.04)
    assert _unlike(1.0 - curve, lambda p: np.exp(-t / p[0]), [0.04]) > 5 * LEAST_UNLIKE


def test_battery_rests_where_a_lithium_cell_does():
    """Chen and Rincon-Mora's full cell has 4.1 V and falls off below a tenth; under a steady
    current both relaxations add up to the resistance.
    """
    assert drive.open_circuit(np.array(1.0)) == pytest.approx(1.0, abs=0.002)
    assert drive.open_circuit(np.array(0.02)) < 0.82
    charge, relax = np.ones(1), np.zeros((2, 1))
    for _ in range(5000):
        charge, relax, volt = drive.step_battery(charge, relax, 1.0, 0.06, 0.0, 0.1)
    assert drive.open_circuit(charge) - volt == pytest.approx(0.06, rel=1e-3)
    first = np.array([first_drive.open_circuit(z) for z in np.linspace(0.05, 1.0, 40)])
    own = drive.open_circuit(np.linspace(0.05, 1.0, 40))
    assert np.abs(own - own.mean() - (first - first.mean())).max() > LEAST_UNLIKE


def test_blade_elements_agree_with_momentum_theory():
    """Heave damping of a hovering rotor: of C_T = s (theta/6 - lam/4) and 2 lam_i lam = C_T follows
    dC_T / d lam_c = -(s/8) / (1 + s / (16 lam)).
    """
    s, thrust = 0.6, 0.0145
    theta = rotor.pitch_of(s, thrust)
    hover, up = (rotor.coefficients(s, theta, 0.0, c)[0][0] for c in (0.0, 0.01))
    lam = np.sqrt(thrust / 2.0)
    area = 1.0 - rotor.ROOT**2
    slope = -(s * area / 8.0) / (1.0 + s * area / (16.0 * lam))
    assert hover == pytest.approx(thrust, rel=1e-3)
    assert (up - hover) / 0.01 == pytest.approx(slope, rel=0.06)


def test_ground_blocks_nothing_far_away_and_nearly_all_at_contact(monkeypatch):
    """Without fading it is the closed form of Knight and Hefner's cylinder."""
    assert ground.blocked_share(np.array(30.0)) < 1e-3
    assert ground.blocked_share(np.array(0.05)) > 0.9
    monkeypatch.setattr(ground, "FADING", 1e6)
    for x in (0.5, 1.0, 2.0):
        closed = 2.0 * x / np.sqrt(1.0 + x * x) - 2.0 * x / np.sqrt(1.0 + 4.0 * x * x)
        assert ground._cylinder(x) == pytest.approx(closed, rel=2e-3)


def test_gusts_have_unit_deviation_and_karman_s_slope():
    """Beyond their corner the power falls as f^-5/3, where Dryden's falls as f^-2."""
    from scipy.signal import welch

    rows = air.karman_gusts(400_000, 0.01, 2.5, np.random.default_rng(0))
    assert rows.std(axis=1) == pytest.approx(np.ones(3))
    f, density = welch(rows[0], fs=100.0, nperseg=40_000)
    band = (f > 0.15) & (f < 2.0)
    slope = np.polyfit(np.log(f[band]), np.log(density[band]), 1)[0]
    assert -1.95 < slope < -1.5


def test_a_weight_on_a_cord_hangs_where_it_should():
    """At rest it stretches the cord by an eighth and pulls with its weight."""
    p, v = np.zeros((3, 1)) + np.array([[0.0], [0.0], [5.0]]), np.zeros((3, 1))
    load, load_v = p - np.array([[0.0], [0.0], [0.4]]), np.zeros((3, 1))
    for _ in range(20_000):
        pull, load, load_v = attached.step_cord(load, load_v, p, v, np.array([0.1]), 0.4, 0.001)
    assert pull[2, 0] == pytest.approx(-0.1 * attached.G_M_S2, rel=1e-3)
    assert 5.0 - load[2, 0] == pytest.approx(0.4 * 1.12, rel=1e-3)


@pytest.fixture(scope="module")
def short_flights():
    """Three seconds of one set of each kind of part: (sorties, book)."""
    from ges.blind.foreign import second
    from ges.blind.foreign.sets import Place
    from ges.blind.second.flight import SecondSimulation

    names = ("rotor_drag", "wind", "ground_effect_lag", "slung_load", "inertia", "cg_offset")
    sorties = []
    for name in names:
        design = second.SecondDesign("s900", (name,), 2)
        place = Place(second.WORLD, design.key, "development", 3)
        _, flown = second._sorties(design, place)
        sorties.append(dataclasses.replace(flown[0], plan=flown[0].plan[:, :400]))
    return sorties, SecondSimulation(sorties).run()


def test_parts_are_all_that_separates_a_flight_from_a_plain_vehicle(short_flights):
    """Measured force less the parts is the plain thrust and the air's turbulence, for every set."""
    sorties, book = short_flights
    count: dict[str, int] = {}
    for f, sortie in enumerate(sorties):
        felt = book["specific_force"][:, :, f].astype(float) * sortie.true["mass"]
        thrust = sortie.true["thrust"] * (book["rotor_speed"][:, :, f].astype(float) ** 2).sum(1)
        for name in sortie.names:
            k = count.get(name, 0)
            count[name] = k + 1
            felt -= book[f"change/{name}"][:, :3, k]
        felt[:, 2] -= thrust
        left = np.sqrt(np.mean(felt**2, axis=0)) / (9.81 * sortie.true["mass"])
        if "cg_offset" not in sortie.names:
            assert left.max() < 0.02, sortie.names
    assert np.isfinite(book["p"]).all()


def test_sensors_sit_at_the_geometric_centre(short_flights):
    """With the centre of mass aside, the accelerometer feels the turning of its own place."""
    sorties, book = short_flights
    f = next(k for k, s in enumerate(sorties) if "cg_offset" in s.names)
    centre = np.array([sorties[f].numbers["cg_x_m"], sorties[f].numbers["cg_y_m"]])
    assert np.linalg.norm(centre) > 1e-3
    assert book["p"].shape[2] == len(sorties)
