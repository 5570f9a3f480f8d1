"""The next flight and the smallest effect that would have been seen, each held against simulated
flights.
"""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from ges.commands.diagnose import _flight_written
from ges.diagnose.advise.detect import (
    DetectedEffect,
    _detectable_size,
    _VariantEvidence,
    expected_evidence,
    smallest_detectable,
)
from ges.diagnose.advise.next_flight import separating_manoeuvre
from ges.diagnose.advise.recommend import (
    Option,
    Rival,
    as_rivals,
    open_sets,
    rank,
)
from ges.diagnose.design.system import build
from ges.diagnose.library.grids import library
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.select.evidence import Gram, make_regression, rms_of
from ges.diagnose.select.search import SearchResult, search
from ges.diagnose.select.stable import search_until_stable
from ges.diagnose.settings import settings
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres


@pytest.fixture(scope="module")
def judged(flown):
    """Flights of a vehicle with effects planted, as the search sees them: the regression and the
    candidates of these names.
    """

    def make(vehicle, effects: dict, tables: list[np.ndarray], names: tuple[str, ...]):
        model = from_vehicle(vehicle)
        frames = [flown(vehicle, effects, table, seed) for seed, table in enumerate(tables, 1)]
        listed = [c for name, c in library(model).items() if name in names]
        flights = list(pass_gate(frames, model).flights.values())
        system = build(flights, model, [v for c in listed for v in c.variants])
        return make_regression(system), listed

    return make


@pytest.fixture(scope="module")
def quad(sheet):
    """A well-known vehicle whose rotor drag is modelled, so that wind acts on it."""
    return sheet(
        mass_kg={"value": 1.0, "sd": 0.01},
        thrust_coefficient_N_s2={"value": 6e-6, "sd_rel": 0.01},
        torque_coefficient_Nm_s2=None,
        effects={"rotor_drag": {"k_kg": 6e-5}},
    )


def test_wind_and_tilted_attitude_are_told_apart_by_turning_round(quad, judged):
    """In hover at one heading both are a constant side force; a turn leaves one with the world and
    one with the body.
    """
    regression, listed = judged(
        quad, {"wind": {"east_m_s": 3.0}}, [manoeuvres.hover(15.0)] * 2, ("wind", "attitude_bias")
    )
    found = search(regression, listed, tuple(quad.effects))
    open_sets = [h for h in found.hypotheses if len(h.names) == 1]
    rivals = as_rivals(regression, open_sets)
    assert {r.names for r in rivals} == {("wind",), ("attitude_bias",)}
    ranked = {
        o.manoeuvre: o
        for o in rank(
            regression, regression.system.flights, rivals, plans=("hover", "climbs", "yaw_turn")
        )
    }
    assert abs(ranked["hover"].so_far) < 3.0
    assert next(iter(ranked)) == "yaw_turn"
    assert ranked["yaw_turn"].expected_log_odds > ranked["hover"].expected_log_odds + 10.0
    # a tilted attitude acts in what is recorded, not in how it flies
    settled = pytest.approx(settings.advise.settled_log_odds)
    assert ranked["climbs"].expected_log_odds == settled
    assert (
        set(ranked["yaw_turn"].separates) == {"wind", "attitude_bias"}
        and not ranked["yaw_turn"].stays_open
    )


def test_what_stays_open_is_told(quad, judged):
    """A turn tells wind from what is fixed in the body; tilted rotors and a tilted attitude stay
    alike.
    """
    names = ("wind", "attitude_bias", "rotor_tilt")
    regression, listed = judged(
        quad, {"wind": {"east_m_s": 3.0}}, [manoeuvres.hover(15.0)] * 2, names
    )
    single = [
        h for h in search(regression, listed, tuple(quad.effects)).hypotheses if len(h.names) == 1
    ]
    (option,) = rank(
        regression, regression.system.flights, as_rivals(regression, single), plans=("yaw_turn",)
    )
    assert set(option.stays_open) == {"attitude_bias", "rotor_tilt"}
    assert option.separates[0] == "wind" and option.separates[1] in option.stays_open


def test_next_flight_of_an_open_question_and_of_none(quad, judged):
    names = ("wind", "attitude_bias")
    regression, listed = judged(
        quad, {"wind": {"east_m_s": 3.0}}, [manoeuvres.hover(15.0)] * 2, names
    )
    found = search(regression, listed, tuple(quad.effects))
    assert {n for h in open_sets(found, ()) for n in h.names} == set(names), (
        "both explain the side force"
    )
    told = separating_manoeuvre(regression, regression.system.flights, found, ())
    assert (
        told["manoeuvre"] in manoeuvres.MENU and told["expected_log_odds"] > told["so_far_log_odds"]
    )
    assert set(names) <= set(told["separates"])
    certain = dataclasses.replace(found.hypotheses[0], probability=1.0)
    settled = SearchResult((certain,), {n: float(n in certain.names) for n in names})
    assert separating_manoeuvre(regression, regression.system.flights, settled, certain.names) == {}


@pytest.mark.parametrize(
    "expected, gain, flights",
    [(12.0, 11.0, 1), (1.2, 0.5, 3), (1.2, 0.01, None), (0.1, 0.06, None)],
    ids=["settled at once", "often enough", "no gain", "too often"],
)
def test_how_often_to_fly(expected, gain, flights):
    """1.2 and then 0.5 more a flight reach ln 9 = 2.2 with the third."""
    option = Option("hover", ("a", "b"), (), expected, 0.0, gain)
    assert option.flights == flights
    assert option.content()["manoeuvre"] == ("hover" if flights else None)
    assert (
        flights is None
        or expected + (flights - 1) * gain >= settings.statistics.acceptance_log_odds
    )


def test_what_the_recommended_flight_promises_it_keeps(quad, judged):
    """Fly the turn for real, the effect planted: the log odds must come out near what was
    expected.
    """
    names, plans = ("wind", "attitude_bias"), [manoeuvres.hover(15.0)] * 2
    regression, listed = judged(quad, {"wind": {"east_m_s": 3.0}}, plans, names)
    open_sets = [
        h for h in search(regression, listed, tuple(quad.effects)).hypotheses if len(h.names) == 1
    ]
    (option,) = rank(
        regression, regression.system.flights, as_rivals(regression, open_sets), plans=("yaw_turn",)
    )
    after, listed = judged(
        quad, {"wind": {"east_m_s": 3.0}}, [*plans, manoeuvres.yaw_turn(30.0)], names
    )
    _, judged, _ = search_until_stable(after, listed, tuple(quad.effects))
    found = {h.names: h.log_evidence for h in judged.hypotheses}
    assert found["wind",] - found["attitude_bias",] > 0.4 * option.expected_log_odds > 4.0


def test_more_thrust_and_ground_effect_are_told_apart_by_a_ladder_of_heights(quad, judged):
    low = manoeuvres.hover(15.0, 0.2)
    regression, _ = judged(quad, {}, [low] * 2, ("thrust_scale", "ground_effect"))
    columns = regression.system.columns
    chosen = {}
    for k, column in enumerate(columns):
        if column.variant is not None and regression.prior.sd[k] > 0:
            chosen.setdefault(column.variant.effect, k)
    rivals = [
        Rival(("thrust_scale",), {"thrust_scale": {"scale": 0.1}}, (chosen["thrust_scale"],)),
        Rival(
            ("ground_effect",),
            {"ground_effect": columns[chosen["ground_effect"]].variant.parameters({"c_a": 0.5})},
            (chosen["ground_effect"],),
        ),
    ]
    ranked = rank(
        regression,
        regression.system.flights,
        rivals,
        plans=("hover", "height_staircase", "yaw_turn"),
    )
    assert ranked[0].manoeuvre == "height_staircase"
    assert ranked[0].expected_log_odds > 4.0 > 2.0 > max(o.expected_log_odds for o in ranked[1:])


DRAG = (
    "rotor_drag",
    "parasitic_drag",
    "weak_rotor",
    "thrust_scale",
    "axial_inflow",
    "rotor_tilt",
    "cg_offset",
)


@pytest.fixture(scope="module")
def bare(quad):
    return quad.model_copy(update={"effects": {}})


@pytest.fixture(scope="module")
def null(bare, judged):
    return judged(bare, {}, [manoeuvres.straight_runs(20.0), manoeuvres.climbs(40.0)], DRAG)


def _planted(regression, effect: str, size: float):
    """The same flights with an effect of this size in their residuals."""
    k = next(
        i
        for i, c in enumerate(regression.system.columns)
        if c.variant is not None and c.variant.effect == effect
    )
    flights = tuple(
        dataclasses.replace(r, y=r.y + r.weighted_columns({k: size}, len(regression.system.names)))
        for r in regression.system.flights
    )
    return make_regression(dataclasses.replace(regression.system, flights=flights))


@pytest.mark.parametrize("effect", ["rotor_drag", "axial_inflow"])
def test_what_is_called_detectable_is_found_and_much_less_is_not(null, effect):
    regression, listed = null
    smallest = smallest_detectable(regression)[effect]["smallest"]
    found = {
        f: search(_planted(regression, effect, f * smallest), listed).inclusion[effect]
        for f in (0.3, 2.0)
    }
    assert found[2.0] > 0.9 and found[0.3] < 0.5


def test_a_real_flight_with_the_effect_shows_it_too(bare, null, judged):
    smallest = smallest_detectable(null[0])["rotor_drag"]["smallest"]
    regression, listed = judged(
        bare, {"rotor_drag": {"k_kg": 3.0 * smallest}}, [manoeuvres.straight_runs(20.0)] * 2, DRAG
    )
    assert search(regression, listed).inclusion["rotor_drag"] > 0.9


def _with_information(regression, share: float):
    return dataclasses.replace(
        regression, by_flight=tuple(g.scale(share) for g in regression.by_flight)
    )


def test_more_noise_hides_more(null):
    regression, _ = null
    quiet, loud = (
        smallest_detectable(_with_information(regression, share))["rotor_drag"]["smallest"]
        for share in (1 / 16, 1 / 64)
    )
    assert 1.5 < loud / quiet < 2.5  # a quarter of the information: twice the noise


def test_no_quiet_makes_detectable_what_is_too_small_to_be_told(null):
    regression, _ = null
    k = next(
        i
        for i, c in enumerate(regression.system.columns)
        if c.variant is not None and c.variant.effect == "rotor_drag"
    )
    share = np.nanmax(rms_of(regression.system)[:, k] / regression.system.least_rms)
    clear, loud = (
        smallest_detectable(_with_information(regression, s))["rotor_drag"]["smallest"]
        for s in (1e8, 1 / 64)
    )
    assert clear * share == pytest.approx(1.0) and loud > 1.5 * clear


@pytest.mark.parametrize(("likeness", "hidden"), [(0.0, ""), (0.95, "axial_inflow")])
def test_at_its_limit_nine_of_ten_sets_of_flights_tell_an_effect_from_its_rival(likeness, hidden):
    rng, sd, n = np.random.default_rng(1), np.array([1.0, 1.0]), 400
    a, b = rng.normal(0.0, 1.0, (2, n))
    x = np.column_stack([a, likeness * a + np.sqrt(1.0 - likeness**2) * b])
    gram = Gram(
        settings.evidence.tempering * x.T @ x, np.zeros(2), 0.0, settings.evidence.tempering * n
    )
    gains = [expected_evidence(gram, [k], sd) for k in range(2)]
    names = ("rotor_drag", "axial_inflow")
    variants = [
        _VariantEvidence(name, (k,), gain, gain, cost)
        for k, (name, (gain, cost)) in enumerate(zip(names, gains, strict=True))
    ]
    size, by = _detectable_size(variants[0], 0, variants, np.log(9.0))
    right = settings.evidence.tempering * (size * x[:, :1] + rng.normal(0.0, 1.0, (n, 2000))).T @ x
    evidence = 0.5 * right**2 / (np.diag(gram.xx) + 1.0 / sd**2) - [cost for _, cost in gains]
    price = np.log(9.0) + np.log(0.5 / 0.3 * 2)
    told = np.minimum(evidence[:, 0] - price, evidence[:, 0] - evidence[:, 1] - np.log(9.0)) > 0.0
    assert by == hidden and np.mean(told) == pytest.approx(0.9, abs=0.03)


def test_what_a_rival_hides_names_the_rival(null):
    regression, _ = null
    told = smallest_detectable(regression)
    assert set(told) <= set(DRAG) and {"rotor_drag", "thrust_scale"} <= set(told)
    columns = regression.system.columns
    drag = next(
        i
        for i, c in enumerate(columns)
        if c.variant is not None and c.variant.effect == "rotor_drag"
    )
    twin = [
        i
        for i, c in enumerate(columns)
        if c.variant is not None and c.key == "parasitic_drag.area_m2" and c.part == "force"
    ]
    same = np.arange(len(columns))
    same[twin] = drag

    def doubled(gram):
        return dataclasses.replace(gram, xx=gram.xx[np.ix_(same, same)], xy=gram.xy[same])

    sd = regression.prior.sd.copy()
    sd[twin] = sd[drag]
    twins = dataclasses.replace(
        regression,
        by_flight=tuple(doubled(g) for g in regression.by_flight),
        prior=dataclasses.replace(regression.prior, sd=sd),
    )
    hidden = smallest_detectable(twins)["rotor_drag"]
    assert hidden["smallest"] is None and hidden["limited_by"] == "parasitic_drag"
    variant = columns[twin[0]].variant
    far = {"parasitic_drag": DetectedEffect(variant, {"area_m2": np.inf})}
    beside = smallest_detectable(twins, far)
    assert (
        beside["parasitic_drag"]["smallest"] is None
        and beside["parasitic_drag"]["limited_by"] == "rotor_drag"
    )


def test_what_was_found_has_a_limit_too(null):
    """Beside what else was found, and the same as if it had not been found; what was found is
    seen, however small.
    """
    regression, _ = null
    before = smallest_detectable(regression)
    variant = next(
        c.variant
        for c in regression.system.columns
        if c.variant and c.variant.effect == "rotor_drag"
    )
    limit = before["rotor_drag"]["smallest"]
    for size in (3.0 * limit, 0.5 * limit):
        after = smallest_detectable(
            regression, {"rotor_drag": DetectedEffect(variant, {"k_kg": size})}
        )
        assert after["rotor_drag"]["smallest"] == pytest.approx(min(size, limit))
        assert after.keys() == before.keys()


def test_no_limit_is_more_than_the_vehicle_weighs(null):
    regression, _ = null
    rms = rms_of(_with_information(regression, 1e-12).system)
    told = smallest_detectable(_with_information(regression, 1e-12))
    for k, c in enumerate(regression.system.columns):
        if c.variant is None or (limit := told.get(c.variant.effect)) is None:
            continue
        if c.key.endswith(f".{limit['parameter']}") and limit["smallest"] is not None:
            forces = [n for n in regression.system.main if n.startswith("force")]
            at = [regression.system.main.index(n) for n in forces]
            assert (rms[at, k] * limit["smallest"]).max() <= regression.system.model.weight_N


def test_set_points_of_the_advised_flight_are_written(tmp_path):
    """The file holds what the simulator flew when it compared the explanations."""
    path = tmp_path / "next.csv"
    said = _flight_written({"manoeuvre": "yaw_turn", "separates": ["wind", "attitude_bias"]}, path)
    assert "yaw_turn" in said and "wind from attitude_bias" in said
    table = pd.read_csv(path)
    assert list(table.columns) == ["t_s", *manoeuvres.COLUMNS]
    assert table[list(manoeuvres.COLUMNS)].to_numpy() == pytest.approx(manoeuvres.make("yaw_turn"))


def test_what_the_advised_flight_needs_is_said(tmp_path):
    advised = {
        "manoeuvre": "hover",
        "preparation": "a new propeller on rotor 3",
        "separates": ["weak_rotor", "cg_offset"],
    }
    assert "(to be flown with a new propeller on rotor 3)" in _flight_written(
        advised, tmp_path / "next.csv"
    )


@pytest.mark.parametrize("advised", [{}, {"manoeuvre": None, "separates": ["a", "b"]}])
def test_no_file_where_no_flight_is_advised(tmp_path, advised):
    assert "nothing is open" in _flight_written(advised, tmp_path / "next.csv")
    assert not list(tmp_path.iterdir())
