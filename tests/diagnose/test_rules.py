"""The rules by which a name is told, each by itself, on sets of names and their evidence alone."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from ges.conventions import command
from ges.diagnose.decide import explanation, rules
from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.explanation import Explanation
from ges.diagnose.decide.rules import (
    SEARCH_RULES,
    RuleContext,
    apply_rules,
    distinguishable,
    has_its_prerequisite,
    parameters_at_bounds,
    practically_significant,
    probable,
    rivals_nearly_as_good,
    significant,
)
from ges.diagnose.design.system import build, residuals_with
from ges.diagnose.estimate.fit import Fitted
from ges.diagnose.prepare.channels import least_rms_in
from ges.diagnose.select.evidence import Posterior, make_regression
from ges.diagnose.select.search import Hypothesis, SearchResult, log_rarity
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Decision, DecisionLog
from ges.simulator import effects as effect_table

from .synthetic import MODEL, hovering, nuisance, rows_of, system_of

COLUMNS = (
    nuisance("motor_lag.up_s", 0.004),
    nuisance("ground_effect_moment.q", 0.25, mean=-0.35),
)
ROWS = dataclasses.replace(rows_of(np.zeros((3, 1)), [{}, {}]), flight=hovering())
BOARD = SimpleNamespace(system=system_of(("force_z",), COLUMNS, [ROWS]))
AS_GIVEN = SimpleNamespace(common={})


def _search(evidence: dict[tuple[str, ...], float]) -> SearchResult:
    ranked = sorted(evidence.items(), key=lambda item: -item[1])
    names = {n for told in evidence for n in told}
    return SearchResult(
        tuple(Hypothesis(told, (), Posterior.empty(), log) for told, log in ranked),
        dict.fromkeys(names, 1.0),
    )


def _weighed(found, names, effects=(), flights=()):
    model = SimpleNamespace(effects=dict.fromkeys(effects, {}))
    system = SimpleNamespace(model=model, flights=flights, recordings=[hovering()])
    regression = SimpleNamespace(system=system)
    return RuleContext(regression, found, tuple(names))


def _told(weighed, record=None) -> tuple[str, ...]:
    return apply_rules(SEARCH_RULES, weighed, weighed.passing, record or DecisionLog())


@pytest.mark.parametrize(("p", "best", "passed"), [(0.95, 1, 1), (0.85, 1, 0), (0.95, 0, 0)])
def test_a_name_has_to_be_probable_and_in_the_best_set(p, best, passed):
    found = _search({("rotor_drag",) if best else ("wind",): 1.0, ("weak_rotor",): 0.0})
    found = dataclasses.replace(found, inclusion={"rotor_drag": p})
    decision = probable(_weighed(found, ("rotor_drag",)), "rotor_drag")
    assert decision.passed == bool(passed) and decision.statistic == p
    assert (decision.rule, decision.threshold) == (
        "probable",
        settings.statistics.acceptance_probability,
    )


def test_every_decision_is_on_record_up_to_the_one_that_drops_a_name():
    found, record = _search({("rotor_drag",): 50.0, ("wind",): 49.0}), DecisionLog()
    weighed = _weighed(found, ("rotor_drag", "wind"))
    assert _told(weighed, record) == ()
    assert [d.rule for d in record.of("wind")] == ["probable"]
    drag = record.of("rotor_drag")
    assert [d.rule for d in drag][-1] == "distinguishable" and "wind" in drag[-1].because
    assert [d.passed for d in drag] == [True] * (len(drag) - 1) + [False]
    assert (
        drag[-1].statistic == pytest.approx(1.0)
        and drag[-1].threshold == settings.statistics.acceptance_log_odds
    )


def test_what_acts_through_another_needs_one_that_is_on():
    found = _search({("ground_effect_lag",): 50.0})
    for effects, passed in (((), False), (("ground_effect",), True)):
        weighed = _weighed(found, ("ground_effect_lag",), effects=effects)
        assert has_its_prerequisite(weighed, "ground_effect_lag").passed == passed


def test_a_set_that_adds_no_other_name_is_no_rival():
    found = _search({("rotor_drag", "wind"): 50.0, ("wind",): 49.9})
    weighed = _weighed(found, ("rotor_drag",))
    assert rivals_nearly_as_good(found, "rotor_drag") == ()
    assert distinguishable(weighed, "rotor_drag").passed


@pytest.mark.parametrize(("behind", "replaced"), [(1.0, ("parasitic_drag", "wind")), (3.0, ())])
def test_a_wind_through_a_drag_is_one_cause_that_may_replace_a_tilt(behind, replaced):
    found = _search({("rotor_tilt",): 20.0, ("parasitic_drag", "wind"): 20.0 - behind})
    assert rivals_nearly_as_good(found, "rotor_tilt") == replaced


@pytest.mark.parametrize(("behind", "replaced"), [(1.0, ("thrust_scale",)), (3.0, ())])
def test_a_declared_number_that_is_rarely_wrong_is_a_rival_where_the_flights_do_not_tell(
    behind, replaced
):
    found = _search(
        {("thrust_curve",): 20.0, ("thrust_scale",): 20.0 - behind + log_rarity(["thrust_scale"])}
    )
    assert rivals_nearly_as_good(found, "thrust_curve") == replaced


def test_one_of_a_family_is_contested_that_the_other_explains_as_well_alone():
    found = _search({("esc_delay", "motor_lag"): 20.0, ("motor_lag",): 15.0, ("esc_delay",): 13.5})
    assert rivals_nearly_as_good(found, "motor_lag") == ("esc_delay",)
    found = _search({("esc_delay", "motor_lag"): 20.0, ("motor_lag",): 15.0, ("esc_delay",): 5.0})
    assert rivals_nearly_as_good(found, "motor_lag") == ()


@pytest.mark.parametrize(
    ("name", "parameter", "value", "proven"),
    [
        ("motor_lag", "up_s", 0.015, False),
        ("motor_lag", "up_s", 0.017, True),
        ("ground_effect_moment", "q", -1.3, False),
        ("ground_effect_moment", "q", 0.6, False),
        ("ground_effect_moment", "q", 0.7, True),
        ("ground_effect_moment", "q", -1.4, True),
    ],
)
def test_what_is_within_four_prior_sds_does_not_stand_however_clear(name, parameter, value, proven):
    """A prior lies about what is usual."""
    effects = {name: {**effect_table.get(name).neutral(), parameter: value}}
    fitted = Fitted(effects, ((name, parameter),), 1e-7 * np.eye(1), AS_GIVEN, None, BOARD)
    assert significant(fitted, name).passed == proven


@pytest.mark.parametrize(("delay_s", "proven"), [(0.003, False), (0.03, True)])
def test_a_delay_has_its_prior_where_none_is_free(delay_s, proven):
    """Without logged rotor speeds no column is that of a delay within its prior."""
    effects, free = {"esc_delay": {"delay_s": delay_s}}, (("esc_delay", "delay_s"),)
    fitted = Fitted(effects, free, 1e-7 * np.eye(1), AS_GIVEN, None, BOARD)
    assert significant(fitted, "esc_delay").passed == proven


@pytest.mark.parametrize(
    ("delay_s", "lags_s", "proven"),
    [
        (0.03, (0.0, 0.0), True),
        (0.03, (-0.028, -0.028), False),
        (0.03, (-0.04, -0.04), False),
        (0.03, (0.02, 0.02), True),
        # a lag up without one down moves the mean by half of it
        (0.03, (-0.02, 0.0), True),
    ],
)
def test_a_delay_that_a_lag_undoes_is_the_shape_of_one_response(delay_s, lags_s, proven):
    """Flights determine how late a drive responds. What of it is delay and what lag is open within
    a row, and with a second pole.
    """
    free, lags = ("esc_delay", "delay_s"), dict(zip(("up_s", "down_s"), lags_s, strict=True))
    joint = SimpleNamespace(common={f"motor_lag.{name}": s for name, s in lags.items()})
    delay = {"esc_delay": {"delay_s": delay_s}}
    beside_a_nuisance = Fitted(delay, (free,), 1e-7 * np.eye(1), joint, None, BOARD)
    assert significant(beside_a_nuisance, "esc_delay").passed == proven
    both, fitted = {**delay, "motor_lag": lags}, (free, ("motor_lag", "up_s"))
    named = Fitted(both, fitted, 1e-7 * np.eye(2), AS_GIVEN, None, BOARD)
    assert significant(named, "esc_delay").passed == proven
    lag_s = lags_s[0] + (delay_s if lags_s[0] < 0 else 0.0)
    stands = np.sign(lag_s) == np.sign(lags_s[0]) and abs(lag_s) > 0.016
    assert significant(named, "motor_lag").passed == stands


@pytest.mark.parametrize(("sds", "proven"), [(4.4, False), (4.7, True)])
def test_a_number_of_the_file_has_to_be_certain(sds, proven):
    """Ten of them are free in every fit. A form error is part of the sd."""
    name, value = "motor_lag", 0.02
    effects = {name: {**effect_table.get(name).neutral(), "up_s": value}}
    covariance = (value / sds) ** 2 * np.eye(1)
    fitted = Fitted(effects, ((name, "up_s"),), covariance, AS_GIVEN, None, BOARD)
    share = fitted.sds_from_neutral(name, "up_s")
    assert share > 3.0 and (share > settings.statistics.certain_sds) == proven
    assert significant(fitted, name).passed == proven


def test_an_amplitude_is_as_clear_as_it_is_with_its_shape_held():
    """Amplitude and decay on a ridge: neither is known well, that something acts is certain."""
    covariance = np.array([[0.01, 0.0099], [0.0099, 0.01]])
    free = (("ground_effect", "c_a"), ("ground_effect", "decay"))
    fitted = Fitted(
        {"ground_effect": {"c_a": 0.2, "decay": 1.0}}, free, covariance, None, None, BOARD
    )
    assert fitted.sd("ground_effect", "c_a") > 0.1
    held = np.hypot(np.sqrt(0.01 - 0.0099**2 / 0.01), settings.estimate.form_error * 0.2)
    assert fitted.sds_from_neutral("ground_effect", "c_a") == pytest.approx(0.2 / held)


@pytest.mark.parametrize(("product_sd", "proven"), [(0.05, True), (0.5, False)])
def test_a_wind_and_its_drag_stand_together_where_their_product_is_clear(product_sd, proven):
    """Slow flights in a strong wind: drag and wind vary against each other by 40 %, what they make
    together is known.
    """
    drag, wind = np.array([0.4, -0.4, -0.4]), np.eye(3) * product_sd**2
    relative, size = np.outer(drag, drag) + wind, np.array([4e-5, 3.0, -5.0])
    effects = {
        "rotor_drag": {"k_kg": size[0]},
        "wind": {"east_m_s": size[1], "north_m_s": size[2], "roughness_m": 0.0},
    }
    free = (("rotor_drag", "k_kg"), ("wind", "east_m_s"), ("wind", "north_m_s"))
    fitted = Fitted(effects, free, relative * np.outer(size, size), None, None, BOARD)
    decisions = [significant(fitted, name).passed for name in ("wind", "rotor_drag")]
    assert decisions == [proven, proven]


@pytest.mark.parametrize(
    ("amplitude", "proven"), [(0.2, True), (0.08, True), (0.01, False), (2.0, False)]
)
def test_an_amplitude_stands_whose_size_its_shape_leaves_open(amplitude, proven):
    """Flights at one height tell that a gain acts there, and not how large it is at the ground.
    What ran to its bound is something else.
    """
    covariance = np.array([[0.01, 0.00999], [0.00999, 0.01]])
    free = (("ground_effect", "c_a"), ("ground_effect", "decay"))
    # at the bound of one the flights ask for more of both than bounds allow
    joint = SimpleNamespace(chosen=np.array([1.0, 0.5]) * (amplitude == 2.0))
    fitted = Fitted(
        {"ground_effect": {"c_a": amplitude, "decay": 0.3}}, free, covariance, joint, joint, BOARD
    )
    assert (fitted.sds_from_neutral("ground_effect", "c_a") > 3.0) == (amplitude > 0.01)
    assert significant(fitted, "ground_effect").passed == proven


@pytest.mark.parametrize(
    ("size", "rough", "blows"),
    [((0.2, 0.2), 0.0, 0), ((-0.25, 0.25), 0.0, 1), ((-0.25, 0.25), 0.03, 0)],
)
def test_air_that_hardly_moves_is_no_wind(size, rough, blows):
    """Of what blows at 10 m over rough ground less is left at 1.5 m."""
    effects = {"wind": {"east_m_s": size[0], "north_m_s": size[1], "roughness_m": rough}}
    fitted = Fitted(
        effects, (("wind", "east_m_s"), ("wind", "north_m_s")), 1e-4 * np.eye(2), None, None, BOARD
    )
    assert significant(fitted, "wind").passed == bool(blows)


@pytest.mark.parametrize(
    ("name", "channel", "made", "before", "after", "matters"),
    [
        ("ground_effect", "force_z", 4.0, 3.0, 0.5, True),
        ("ground_effect", "force_z", 1.001, 3.0, 0.5, True),
        ("ground_effect", "force_z", 0.9, 3.0, 0.5, False),
        ("ground_effect", "force_z", 4.0, 1.0, 0.5, False),
        ("ground_effect", "force_z", 4.0, 0.5, 0.5, False),
        ("ground_effect", "force_z", 0.0, 3.0, 0.5, False),
        # more than a name makes is nearer by something else
        ("rotor_saturation", "moment_y", 0.1, 9.0, 0.5, False),
        # of a range the threshold is a height
        ("rangefinder_bias", "range", 1.001, 3.0, 0.5, True),
        ("rangefinder_bias", "range", 0.9, 3.0, 0.5, False),
        ("rangefinder_bias", "range", 4.0, 1.0, 0.5, False),
        # a number of the file may be wrong by less, but not by nothing
        ("inertia", "moment_x", 4.0, 1.0, 0.5, True),
        ("torque_coefficient", "moment_z", 4.0, 0.5, 0.6, False),
    ],
)
def test_a_name_brings_flights_nearer_than_the_file_does(
    monkeypatch, name, channel, made, before, after, matters
):
    """In thresholds of its channel. Two wrong numbers may undo each other and explain nothing."""
    unit = np.tile([[-1.0], [1.0]], (250, 1)) * least_rms_in(channel, MODEL)
    system = system_of((channel,), (), ())
    fitted = SimpleNamespace(regression=SimpleNamespace(system=system), joint=None)
    for residuals in ("residuals_with", "_residuals_with_batteries"):
        monkeypatch.setattr(rules, residuals, lambda of, model: [before * unit])
    monkeypatch.setattr(rules, "raw_residuals", lambda system, joint: [after * unit])
    monkeypatch.setattr(rules, "contributions", lambda *_: {name: [made * unit]})
    (decision,) = practically_significant(fitted, (name,), MODEL, MODEL).values()
    assert decision.passed == matters, decision.because


@pytest.mark.parametrize(
    ("name", "channel", "passes"),
    [
        ("esc_delay", "drive_1", False),
        # recalibration moved the very number
        ("motor_lag", "drive_1", True),
        ("torque_coefficient", "moment_z", True),
    ],
)
def test_what_other_numbers_do_as_well_is_no_effect(monkeypatch, name, channel, passes):
    """A delay of 33 ms and a lag of -25 ms undid each other, where the lag alone was as good."""
    unit = np.tile([[-1.0], [1.0]], (250, 1)) * least_rms_in(channel, MODEL)
    system = system_of((channel,), (), ())
    fitted = SimpleNamespace(regression=SimpleNamespace(system=system), joint=None)
    recalibrated = MODEL.with_effects({"motor_lag": {"up_s": 0.01, "down_s": 0.01}})
    for residuals in ("residuals_with", "_residuals_with_batteries"):
        monkeypatch.setattr(
            rules,
            residuals,
            lambda of, model: [(2.0 if "motor_lag" in model.effects else 20.0) * unit],
        )
    monkeypatch.setattr(rules, "raw_residuals", lambda system, joint: [2.1 * unit])
    monkeypatch.setattr(rules, "contributions", lambda *_: {name: [10.0 * unit]})
    (decision,) = practically_significant(fitted, (name,), MODEL, recalibrated).values()
    assert decision.passed == passes, decision.because


@pytest.mark.parametrize(("sideways", "passes"), [(1.5, True), (0.5, False)])
def test_a_name_counts_in_the_channel_that_no_number_does_for_it(monkeypatch, sideways, passes):
    """The weight of a swinging load is a thrust that is too large, its swing is not."""
    channels = ("force_x", "force_z")
    least = np.array([least_rms_in(c, MODEL) for c in channels])
    unit = np.tile([[-1.0], [1.0]], (250, 1)) * least
    system = system_of(channels, (), ())
    fitted = SimpleNamespace(regression=SimpleNamespace(system=system), joint=None)
    for residuals in ("residuals_with", "_residuals_with_batteries"):
        monkeypatch.setattr(
            rules,
            residuals,
            lambda of, model: [unit * (3.0, 0.5 if model.mode == "recalibrated" else 30.0)],
        )
    monkeypatch.setattr(rules, "raw_residuals", lambda system, joint: [unit * (0.5, 0.5)])
    monkeypatch.setattr(
        rules, "contributions", lambda *_: {"slung_load": [unit * (sideways, 30.0)]}
    )
    nominal = SimpleNamespace(mode="given")
    recalibrated = SimpleNamespace(
        with_effect_of=lambda name, other: SimpleNamespace(mode="recalibrated")
    )
    (decision,) = practically_significant(fitted, ("slung_load",), nominal, recalibrated).values()
    assert decision.passed == passes, decision.because


def test_a_battery_s_level_in_each_flight_is_no_merit_of_a_name():
    """A level of each flight had made a delay nearer than recalibration without one."""
    u = MODEL.hover_rad_s / MODEL.number("max_rotor_speed_rad_s")
    flights = [hovering(**dict.fromkeys(command(4), u / share)) for share in (1.02, 0.98)]
    system = build(flights, MODEL, [])
    fitted = SimpleNamespace(regression=make_regression(system))
    drives = [c for c, name in enumerate(system.main) if name.startswith("drive")]
    before, left = (
        np.abs(np.concatenate([y[:, drives] for y in residuals])).max()
        for residuals in (
            residuals_with(system, MODEL),
            rules._residuals_with_batteries(fitted, MODEL),
        )
    )
    assert before > 0.015 * MODEL.hover_rad_s and left < 0.1 * before


def _balanced(monkeypatch, loss, mass, lost=("loss_3",), calibrated=True):
    """A search that names a weak rotor; what the balance says of it and of a mass at its hub."""
    columns = tuple(
        SimpleNamespace(key=f"weak_rotor.{p}", variant=SimpleNamespace(effect="weak_rotor"))
        for p in lost
    )
    monkeypatch.setattr(rules, "variant_of", lambda column: column.variant)
    causes = [
        (SimpleNamespace(distance_explained=loss), SimpleNamespace(distance_explained=mass))
    ] * 4
    monkeypatch.setattr(rules, "causes_of", lambda system: causes if calibrated else [])
    told = Posterior(
        tuple(range(len(lost))), np.zeros(len(lost)), np.eye(len(lost)), log_evidence=20.0
    )
    found = SearchResult((Hypothesis(("weak_rotor",), (), told, 20.0),), {"weak_rotor": 1.0})
    regression = SimpleNamespace(system=SimpleNamespace(columns=columns))
    return rules.separable_from_mass(RuleContext(regression, found, ("weak_rotor",)), "weak_rotor")


def test_a_weak_rotor_is_told_from_a_mass_at_its_hub_by_the_balance(monkeypatch):
    """At odds of 0.9, against a calibrated file, where one rotor lost thrust."""
    least = 2.0 * settings.statistics.acceptance_log_odds
    assert _balanced(monkeypatch, 30.0 + 1.01 * least, 30.0).passed
    alike = _balanced(monkeypatch, 30.0 + 0.99 * least, 30.0)
    assert not alike.passed and "mass at its hub" in alike.because
    assert _balanced(monkeypatch, 10.0, 30.0, lost=("loss_1", "loss_2")).passed
    assert _balanced(monkeypatch, 10.0, 30.0, calibrated=False).passed


def test_what_cannot_act_alone_is_no_rival_by_itself(monkeypatch):
    """A wind pushes through a drag: without one beside the name it stands for two causes."""
    seen = []
    monkeypatch.setattr(
        rules, "alike_of", lambda regression, best, name, rivals: seen.append(rivals) or ()
    )
    listed = tuple(SimpleNamespace(name=n) for n in ("wind", "wall_effect", "rotor_tilt"))
    for names in (("rotor_tilt",), ("rotor_drag", "rotor_tilt")):
        context = dataclasses.replace(_weighed(_search({names: 9.0}), names), listed=listed)
        assert context.alike("rotor_tilt") == ()
    alone, beside = ({e.name for e in rivals} for rivals in seen)
    assert "wind" not in alone and "wind" in beside and "wall_effect" in alone


def test_a_vehicle_of_unknown_attitude_may_lean_by_anything():
    """A roll of 0.2 rad puts its sine of the weight across the thrust axis."""
    leaning = hovering(q_w=np.cos(0.1), q_x=np.sin(0.1))
    level, rolled, unknown = (
        rules._lean(SimpleNamespace(recordings=[f]))
        for f in (hovering(), leaning, hovering(q_w=None, q_x=None, q_y=None, q_z=None))
    )
    assert level == 0.0 and rolled == pytest.approx(np.sin(0.2)) and unknown == np.inf


@pytest.mark.parametrize(
    ("tau_s", "more_s", "at_bound"),
    [(0.0, 0.0, False), (0.4, 0.0, False), (1.0, 0.1, True), (1.0, 0.0005, False)],
)
def test_what_flights_ask_for_beyond_a_bound_is_a_form_error(tau_s, more_s, at_bound):
    """As they do not where the optimum is beyond it by less than its sd."""
    free, joint = (("rangefinder_lag", "tau_s"),), SimpleNamespace(chosen=np.array([more_s]))
    fitted = Fitted(
        {"rangefinder_lag": {"tau_s": tau_s}}, free, 1e-6 * np.eye(1), joint, joint, BOARD
    )
    assert parameters_at_bounds(fitted) == (list(free) if at_bound else [])


@pytest.mark.parametrize(("x_m", "beyond"), [(0.05, False), (1.0, True)])
def test_a_mass_fixed_to_the_body_is_nearer_than_the_rotor_tips(x_m, beyond):
    """What undoes two weak rotors from a place 1 m away is no payload."""
    free = (("payload", "mass_kg"), ("payload", "x_m"))
    hull_m = BOARD.system.model.hull_m
    values = {"mass_kg": 0.01, "x_m": min(x_m, hull_m), "y_m": 0.0, "z_m": 0.0}
    fitted = Fitted({"payload": values}, free, 1e-6 * np.eye(2), None, None, BOARD)
    assert parameters_at_bounds(fitted) == ([free[1]] if beyond else [])
    assert significant(fitted, "payload").because == "x_m stands at its bound" or not beyond


@pytest.mark.parametrize(
    ("sizes", "bounds", "flown"),
    [
        ({"motor_lag": 0.0}, (), None),
        ({"motor_lag": 0.1}, (), "motor_lag"),
        ({"motor_lag": 0.1}, ("motor_lag",), None),
        ({"inertia": 0.1, "motor_lag": 0.1}, ("inertia",), "motor_lag"),
        ({"inertia": 0.1, "motor_lag": 0.0}, (), "inertia"),
        ({"inertia": 0.1, "slung_load": 0.1}, ("inertia",), "names alone"),
    ],
)
def test_what_stands_at_a_bound_or_makes_nothing_is_not_open(monkeypatch, sizes, bounds, flown):
    """Healthy hovers: one of two lags, one at its bound and one of no size, was open. And a thrust
    curve at its bound was flown: the unseen force along thrust was ten times worse.
    """
    fits = {n: SimpleNamespace(name=n) for n in sizes}
    result = SimpleNamespace(inclusion={"inertia": 0.5, "motor_lag": 0.3, "slung_load": 0.01})
    accepted = Accepted((), result, None, None, "names alone", {}, (*sizes, "esc_delay"))
    told = Explanation(accepted, None, None, [], {})
    monkeypatch.setattr(
        explanation,
        "fit_alternatives",
        lambda *_: dataclasses.replace(accepted, alternatives=fits),
    )
    monkeypatch.setattr(
        explanation,
        "parameters_at_bounds",
        lambda fit: [(fit.name, "up_s")] if fit.name in bounds else [],
    )
    monkeypatch.setattr(
        explanation,
        "practically_significant",
        lambda fit, *_: {fit.name: Decision("practically_significant", sizes[fit.name] > 0.0, "")},
    )
    monkeypatch.setattr(
        explanation,
        "explanation_of",
        lambda accepted, *_: SimpleNamespace(
            structures=[], last=SimpleNamespace(model=MODEL), accepted=accepted
        ),
    )
    start = SimpleNamespace(nominal=MODEL, first=SimpleNamespace(model=MODEL))
    found = explanation.refit_with_open_names(told, start, None, DecisionLog())
    does_something = [n for n in sizes if sizes[n] > 0.0 and n not in bounds]
    # what cannot be tested has no fit, and stays beside what does something
    assert found.accepted.rivals == ((*does_something, "esc_delay") if flown else ())
    if flown:
        assert found.accepted.fitted == fits.get(flown, flown)
