"""Names that are taken back: each rule on answers made by hand."""

from types import SimpleNamespace

import pytest

from ges.diagnose.decide import withdraw
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import Record

MOST = settings.statistics.certain_sds


def _accepted(names, strained):
    """What is accepted, with the strain of its declared numbers in the place of its fit."""
    fitted = SimpleNamespace(apart=strained) if names else None
    system = SimpleNamespace(model=None)
    return SimpleNamespace(names=names, fitted=fitted, regression=SimpleNamespace(system=system))


@pytest.fixture
def strains(monkeypatch):
    """Sets of names with the strain of each; what a set has after one name less."""

    def put(by_names, without_name):
        monkeypatch.setattr(withdraw, "largest_correction_sds", lambda joint, system: joint)
        monkeypatch.setattr(
            withdraw, "correction_without_sds", lambda fitted, name: without_name[name]
        )

        def less(accepted, name):
            left = tuple(n for n in accepted.names if n != name)
            return _accepted(left, by_names.get(left, 0.0))

        monkeypatch.setattr(withdraw, "without", less)

    return put


def _left(names, strained, first=0.0):
    record = Record()
    return withdraw._without_conflict(_accepted(names, strained), first, record).names, record


def test_what_needs_numbers_within_their_doubt_stays(strains):
    strains({}, {})
    names, record = _left(("rotor_drag",), 0.9 * MOST)
    assert names == ("rotor_drag",) and not record.of("rotor_drag")


def test_the_worst_offender_goes_first_and_no_more_than_needed(strains):
    """Without the drag the numbers are at peace; the loss stays."""
    strains({("weak_rotor",): 1.0}, {"rotor_drag": 0.5, "weak_rotor": 6.0})
    names, record = _left(("rotor_drag", "weak_rotor"), 7.0)
    assert names == ("weak_rotor",)
    (decision,) = record.of("rotor_drag")
    assert not decision.passed and decision.rule == "within_declared_numbers"
    assert (decision.statistic, decision.threshold) == (7.0, MOST)
    assert "7 sds with it, 1 without" in decision.because


def test_a_name_without_which_the_numbers_are_as_strained_is_no_offender(strains):
    strains({(): 6.5}, {"rotor_drag": 6.5})
    names, record = _left(("rotor_drag",), 7.0, first=5.0)
    assert names == (), "relief from 7 to 5 sds is more than one"
    names, record = _left(("rotor_drag",), 7.0, first=6.5)
    assert names == ("rotor_drag",), "the file itself is nearly as strained"


def test_what_carries_another_is_not_taken_from_under_it(strains):
    strains({("ground_effect",): 6.9, (): 0.0}, {"ground_effect": 0.0, "ground_effect_lag": 5.0})
    names, record = _left(("ground_effect", "ground_effect_lag"), 8.0)
    assert record.of("ground_effect_lag") and names in ((), ("ground_effect",))
    assert [d.passed for d in record.of("ground_effect_lag")] == [False]


def _answer(names, rivals=()):
    accepted = SimpleNamespace(names=names, rivals=rivals)
    added = {name: name for name in names}
    return withdraw.Explanation(accepted, None, SimpleNamespace(joint=None), [], added)


@pytest.mark.parametrize(
    ("form", "left"),
    [((), ("rotor_saturation", "rotor_drag")), (("rotor_saturation",), ("rotor_drag",))],
)
def test_what_the_form_of_an_unmeasured_curve_makes_is_taken_back(form, left, monkeypatch):
    thrust = SimpleNamespace(is_form_error=lambda name, size: name in form)
    monkeypatch.setattr(withdraw, "unmeasured_thrust", lambda joint, system: thrust)
    monkeypatch.setattr(withdraw, "size_of", lambda by, system: {})
    monkeypatch.setattr(
        withdraw,
        "without",
        lambda a, name: SimpleNamespace(names=tuple(n for n in a.names if n != name), rivals=()),
    )
    monkeypatch.setattr(withdraw, "answer_of", lambda a, *_: _answer(a.names))
    record, start = Record(), SimpleNamespace(system=None)
    answer = _answer(("rotor_saturation", "rotor_drag"))
    told = withdraw._not_of_a_form(answer, start, None, record)
    assert told.accepted.names == left
    assert [d.rule for d in record.of("rotor_saturation")] == [
        "not_form_of_unmeasured_thrust"
    ] * len(form)
    still_open = withdraw._not_of_a_form(
        _answer(("rotor_saturation",), ("wind", "tether")), start, None, record
    )
    assert still_open.accepted.names == ("rotor_saturation",), "other names are open"
