"""What falls in the full fit, what falls with it, and what is searched again."""

from types import SimpleNamespace

import pytest

from ges.diagnose.decide import accept
from ges.diagnose.decide.accept import _probable_without, _reformed, _too_many
from ges.diagnose.select.evidence import Posterior
from ges.diagnose.select.search import Hypothesis, _normalise
from ges.diagnose.types.decision import DecisionLog

CANCELLING = {
    (): 0.0,
    ("payload",): 3.0,
    ("weak_rotor",): 1.0,
    ("payload", "weak_rotor"): 3.5,
    ("payload", "thrust_scale", "weak_rotor"): 30.0,
}


def _result(evidence):
    return _normalise([Hypothesis(n, (), Posterior.empty(), e) for n, e in evidence.items()])


def test_hypotheses_without_names_are_as_if_these_had_never_been_candidates():
    rest = _result(CANCELLING).without({"thrust_scale"})
    assert sum(h.probability for h in rest.hypotheses) == pytest.approx(1.0)
    assert "thrust_scale" not in rest.inclusion and rest.best.names == ("payload", "weak_rotor")
    assert rest.inclusion["weak_rotor"] < 0.9


def test_a_name_that_was_probable_only_beside_what_undid_it_falls_with_it():
    """Two rotors of a healthy vehicle had lost 12 and 14 %, each 98 % sure: thrust, a load and a
    centre of gravity had undone losses of two thirds, and fell.
    """
    record, names = DecisionLog(), ("payload", "weak_rotor")
    left = _probable_without(_result(CANCELLING), names, {"thrust_scale"}, (), record)
    assert left == ("payload",)
    (decision,) = record.of("weak_rotor")
    assert not decision.passed and "without thrust_scale" in decision.because


def test_a_name_that_carries_its_evidence_stands_and_so_does_what_modifies_it():
    evidence = {(): 0.0, ("ground_effect",): 50.0, ("ground_effect", "payload"): 60.0}
    names = ("ground_effect", "ground_effect_lag")
    left = _probable_without(
        _result(evidence), names, {"payload"}, ("ground_effect_lag",), DecisionLog()
    )
    assert left == names


def test_a_set_that_no_search_evaluated_is_left_as_it_is():
    names = ("rotor_drag", "wind")
    evidence = {(): 0.0, ("rotor_drag",): 50.0, ("payload", "rotor_drag", "wind"): 60.0}
    assert _probable_without(_result(evidence), names, {"payload"}, (), DecisionLog()) == names


@pytest.mark.parametrize(
    ("names", "before", "reformed"),
    [
        (("rotor_drag", "payload"), None, ("rotor_drag", "payload")),
        (("parasitic_drag", "wind"), ("rotor_drag", "wind"), ("parasitic_drag", "wind")),
        (
            ("parasitic_drag", "wind", "rotor_tilt"),
            ("rotor_drag", "wind", "rotor_tilt"),
            ("parasitic_drag", "wind"),
        ),
        (
            ("ground_effect", "ceiling_effect", "ground_effect_forward_flight"),
            None,
            ("ground_effect", "ground_effect_forward_flight"),
        ),
    ],
)
def test_what_stood_beside_another_form_is_searched_again(names, before, reformed):
    """A ceiling of twelve times its usual gain stood beside a ground effect until that faded."""
    assert tuple(_reformed(names, before or names)) == reformed


@pytest.mark.parametrize(
    ("costs", "at_bound", "left_out"),
    [
        ({"rotor_tilt": 10.0, "wind": 900.0}, (), {"rotor_tilt"}),
        ({"rotor_tilt": 900.0, "wind": 10.0}, (), {"wind"}),
        ({"rotor_tilt": 10.0, "wind": 900.0}, ("rotor_tilt",), {"wind"}),
    ],
)
def test_of_two_that_undo_each_other_the_one_goes_that_is_needed_less(
    monkeypatch, costs, at_bound, left_out
):
    """A wind stood at its bound of 15 m/s against a tilt that undid it, and fell: the tilt was
    named with the other sign. A fit that stays at a bound without a name is none.
    """

    def polish(_, effects, free, fixed_noise):
        (missing,) = {*VALUES} - {*effects}
        assert fixed_noise == "the same" and [e for e, _ in free] == list(effects)
        cost = costs.get(missing, 0.0)
        return SimpleNamespace(joint=SimpleNamespace(cost=cost), missing=missing)

    monkeypatch.setattr(accept, "polish", polish)
    monkeypatch.setattr(accept, "parameters_at_bounds", lambda fitted: fitted.missing in at_bound)
    full = SimpleNamespace(
        effects=VALUES,
        free=[(e, p) for e, values in VALUES.items() for p in values],
        regression=SimpleNamespace(noise="the same"),
    )
    system = SimpleNamespace(model=SimpleNamespace(effects={}))
    # without its drag a wind has nothing to act through: that is never tried
    assert _too_many(full, {"wind"}, tuple(VALUES), system) == left_out
    assert _too_many(full, set(), tuple(VALUES), system) == set()


VALUES = {"rotor_drag": {"k_kg": 1e-4}, "wind": {"east_m_s": 15.0}, "rotor_tilt": {"x_rad": -0.17}}
