"""What matters at least, what is declared and contradicted, and what is left unexplained."""

import dataclasses
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from ges.diagnose.decide.accept import Accepted
from ges.diagnose.decide.contradicted import (
    contradicted_parameters,
    corrected_numbers,
    excused_effects,
)
from ges.diagnose.decide.explanation import Explanation, without_idle_rivals
from ges.diagnose.decide.rules import (
    RuleContext,
    apply_rules,
    best_of_its_family,
    best_rival,
    differs_from_neutral,
    open_names,
)
from ges.diagnose.estimate.fit import Fitted
from ges.diagnose.estimate.joint import JointFit
from ges.diagnose.locate.regimes import unexplained_structures
from ges.diagnose.locate.structure import Structure
from ges.diagnose.select.evidence import Posterior
from ges.diagnose.select.search import Hypothesis, SearchResult
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Considered, Decision, DecisionLog
from ges.diagnose.types.model import SPEED

from ..synthetic import MODEL, nuisance, rows_of, system_of

NAMES = ("force_x", "acc_x", "moment_y", "drive_1", "range")


def test_what_matters_at_least_is_a_share_of_each_channel_s_whole():
    share, told = settings.decide.least_thrust_share, system_of(NAMES, (), ()).least_rms
    force, moment = share * MODEL.weight_N, share * MODEL.weight_N / 4.0 * MODEL.arm_m
    np.testing.assert_allclose(
        told, [force, force, moment, 0.5 * share * 1000.0, settings.prepare.height_error_m]
    )


PRIOR_SDS = {"inertia.yy": 0.1, "cg_offset.x_m": 0.002, SPEED: 10.0}


def _declared(common, but=(), acting=1.0, more=MappingProxyType({})):
    sds = {**PRIOR_SDS, **more}
    columns = [nuisance(k, sd) for k, sd in sds.items()]
    rows = rows_of(np.zeros((5, 1)), [{0: np.full(5, acting)} for _ in sds])
    model = dataclasses.replace(MODEL, prior_sds=sds)
    joint = JointFit(*[np.zeros(0)] * 3, 0.0, common, dict.fromkeys(common, 0.01), ())
    return contradicted_parameters(joint, system_of(("force_z",), columns, [rows], model), but)


def test_numbers_far_beyond_their_doubt_are_told_the_farthest_first():
    told = _declared({"inertia.yy": 0.5, "cg_offset.x_m": 0.03, SPEED: 30.0})
    assert [(c.key, c.sds) for c in told] == [
        ("cg_offset.x_m", pytest.approx(15.0)),
        ("inertia.yy", pytest.approx(5.0)),
    ]
    trim, inertia = told
    assert trim.is_trim and "cg_offset.x_m moved by 15.0 times" in trim.sentence()
    assert not inertia.is_trim and inertia.effect == "inertia"
    assert "wrong about inertia_kg_m2.yy: these flights need +50 %, 5.0 times" in inertia.sentence()


def test_what_one_number_needs_more_of_the_other_needs_less_of():
    """Flights tell thrust over mass: a mass that is 12 % too low, or a thrust 11 % too high."""
    (thrust,) = _declared({"thrust_scale.scale": -0.11}, more={"thrust_scale.scale": 0.02})
    assert "need +12 % of mass_kg or -11 % of thrust_coefficient_N_s2" in thrust.sentence()


def test_what_hardly_shows_or_what_others_can_move_contradicts_nothing():
    assert _declared({"inertia.yy": 0.5}, but=("inertia",)) == []
    assert _declared({"inertia.yy": 0.5}, acting=1e-6) == []
    (speed,) = _declared({SPEED: 50.0})
    assert (
        speed.share == pytest.approx(0.05) and corrected_numbers(SPEED) == "max_rotor_speed_rad_s"
    )
    assert corrected_numbers("thrust_scale.scale") == "mass_kg or thrust_coefficient_N_s2"
    assert corrected_numbers("cg_offset.x_m") == "cg_offset.x_m"


def test_what_stands_at_a_bound_of_the_library_is_no_wrong_number():
    """Something else drives it there, the other numbers of its effect, too."""
    assert _declared({"inertia.yy": 3.0}) == [] and _declared({"inertia.yy": -0.7}) == []
    assert len(_declared({"inertia.yy": 2.9})) == 1
    fast = {"motor_lag.up_s": -0.02}
    assert [c.key for c in _declared(fast, more={"motor_lag.up_s": 0.002})] == list(fast)


@pytest.mark.parametrize(
    ("up_s", "down_s", "wrong"),
    [(0.15, -0.05, False), (0.09, 0.08, True), (0.08, 0.07, False), (0.1, 0.0, False)],
)
def test_one_number_with_several_corrections_moves_by_their_mean(up_s, down_s, wrong):
    """A motor of PX4's SIH seemed to speed up late and slow down at once: its form is another."""
    lags = {"motor_lag.up_s": up_s, "motor_lag.down_s": down_s}
    told = _declared(lags, more=dict.fromkeys(lags, 0.02))
    assert {c.key for c in told} == (set(lags) if wrong else set())


def test_what_fell_in_a_full_fit_is_no_fault_of_the_file():
    record = DecisionLog()
    record.note("inertia", Decision("significant_when_fitted", False, "xx stands at its bound"))
    record.note("thrust_scale", Decision("significant_when_fitted", True, "9 sds from neutral"))
    record.note("motor_lag", Decision("probable", False, "posterior probability 0.1"))
    assert excused_effects(("wind",), record) == {"wind", "inertia"}


def _structure(channel="force_z", share=0.02, r2=0.5, **more):
    rms = share * MODEL.reference_scale(channel)
    return Structure(channel, ("climb_m_s",), (0.0,), (1.0,), r2, 0.002, rms, **more)


def test_left_over_is_one_structure_a_channel_the_one_that_predicts_most():
    weak, strong = _structure(r2=0.3), _structure(r2=0.6)
    turn = _structure("moment_x", r2=0.4)
    told = unexplained_structures([weak, turn, strong], MODEL)
    assert told == [strong, turn]
    size = _structure(r2=0.9, of_size=True)
    assert unexplained_structures([size, weak], MODEL) == [weak], "a mean speaks before a size"
    assert unexplained_structures([size], MODEL) == [size]
    assert unexplained_structures([_structure(share=1e-5)], MODEL) == []


def _search(evidence, inclusion=None):
    ranked = sorted(evidence.items(), key=lambda item: -item[1][0])
    listed = tuple(Hypothesis(n, (), Posterior.empty(), log, p) for n, (log, p) in ranked)
    return SearchResult(listed, inclusion or {n: 1.0 for names in evidence for n in names})


def test_names_replace_each_other_where_one_is_needed_and_neither_proven():
    sets = {("wind",): (5.0, 0.55), ("rotor_tilt",): (4.8, 0.44), (): (0.0, 0.001)}
    found = _search(sets, {"wind": 0.55, "rotor_tilt": 0.44})
    assert open_names(found, set(), set()) == ("wind", "rotor_tilt")
    assert open_names(found, {"wind"}, set()) == (), "one is proven"
    not_needed = _search({**sets, (): (5.0, 0.5)}, {"wind": 0.3, "rotor_tilt": 0.2})
    assert open_names(not_needed, set(), set()) == ()
    assert open_names(not_needed, set(), {"wind", "rotor_tilt"}) == ("wind", "rotor_tilt")


def test_open_names_are_as_many_as_hold_the_probability_of_an_acceptance():
    shares = {"wind": 0.5, "rotor_tilt": 0.42, "cg_offset": 0.15, "inertia": 0.11}
    found = _search({("wind",): (5.0, 0.55), (): (0.0, 0.001)}, shares)
    # of 1.18 nine tenths are 1.062
    assert open_names(found, set(), set()) == ("wind", "rotor_tilt", "cg_offset")
    assert open_names(found, set(), {"inertia", "wind"})[-1] == "inertia", "it is contested"


def test_the_best_rival_has_other_names_and_no_more_causes():
    found = _search(
        {("wind",): (9.0, 0.0), ("rotor_tilt", "tether"): (8.0, 0.0), ("cg_offset",): (5.0, 0.0)}
    )
    assert best_rival(found, "wind").names == ("cg_offset",)
    assert best_rival(_search({("wind",): (9.0, 1.0), (): (0.0, 0.0)}), "wind") is None


def test_of_a_family_the_better_goes_on_and_says_so_of_the_other():
    found = _search(
        {
            ("ground_effect", "fountain_lift"): (60.0, 1.0),
            ("ground_effect",): (50.0, 0.0),
            ("fountain_lift",): (30.0, 0.0),
        }
    )
    c = RuleContext(None, found, ("ground_effect", "fountain_lift"))
    assert best_of_its_family(c, "ground_effect").passed
    dropped = best_of_its_family(c, "fountain_lift")
    assert not dropped.passed and dropped.because == "ground_effect acts there, and better"


def test_each_rule_sees_those_alone_that_passed_the_ones_before_it():
    seen = []

    def short(context, name):
        seen.append(("short", context.passing))
        return Decision("short", len(name) < 5, "")

    def never(context, name):
        seen.append(("never", context.passing))
        return Decision("never", False, "")

    record = DecisionLog()
    context = RuleContext(None, None, ())
    assert apply_rules((short, never), context, ("wind", "tether"), record) == ()
    assert seen == [("short", ("wind", "tether"))] * 2 + [("never", ("wind",))]
    assert [d.rule for d in record.of("tether")] == ["short"]
    assert [d.rule for d in record.of("wind")] == ["short", "never"]


def test_a_record_keeps_the_last_word_of_each_rule_in_its_order():
    record = DecisionLog()
    for rule, passed in (("a", True), ("b", True), ("a", False)):
        record.note("wind", Decision(rule, passed, "x", 1.0, 2.0))
    assert [(d.rule, d.passed) for d in record.of("wind")] == [("b", True), ("a", False)]
    assert set(record.names) == {"wind"} and record.of("tether") == ()
    told = Considered("wind", "rotor 1", 0.5, record.of("wind")).content()
    assert told["decisions"][1] == {
        "rule": "a",
        "passed": False,
        "statistic": 1.0,
        "threshold": 2.0,
        "because": "x",
    }


@pytest.mark.parametrize(("k_kg", "acts"), [(2e-4, True), (5e-6, False)])
def test_an_effect_does_something_if_an_amplitude_is_beyond_its_sd(k_kg, acts):
    free = (("rotor_drag", "k_kg"),)
    fitted = Fitted({"rotor_drag": {"k_kg": k_kg}}, free, np.full((1, 1), 1e-10), None, None, None)
    assert differs_from_neutral(fitted, "rotor_drag") == acts


def test_modelled_is_all_that_is_fitted_what_a_name_acts_through_too():
    fitted = SimpleNamespace(effects={"rotor_drag": {}, "wind": {}})
    accepted = Accepted((), None, None, None, fitted, {}, ("wind", "rotor_tilt"))
    assert accepted.modelled == ("rotor_drag", "wind")
    assert dataclasses.replace(accepted, fitted=None).modelled == ()


@pytest.mark.parametrize(
    ("moved", "known", "contested", "open_still"),
    [
        (True, {}, (), False),
        (False, {}, (), True),
        (False, {"force_z": 0.1}, (), False),
        (False, {"force_z": 0.1}, ("tether",), True),
    ],
)
def test_rivals_go_where_a_shifted_balance_or_healthy_flights_explain_them(
    moved, known, contested, open_still
):
    found = _search({("wind",): (1.0, 1.0)})
    accepted = Accepted(("wind",), found, None, None, None, {}, ("tether",), frozenset(contested))
    last = type("Stage", (), {"model": MODEL})()
    declared = dataclasses.replace(MODEL, left_unexplained=known)
    told = without_idle_rivals(Explanation(accepted, None, last, [], {}), declared, moved)
    assert bool(told.accepted.rivals) == open_still and told.unexplained == []
