"""Names that are taken back: each rule on answers made by hand."""

from types import SimpleNamespace

import pytest

from ges.diagnose.decide import withdraw
from ges.diagnose.types.decision import DecisionLog


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
    monkeypatch.setattr(withdraw, "size_of_contribution", lambda by, system: {})
    monkeypatch.setattr(
        withdraw,
        "without_name",
        lambda a, name: SimpleNamespace(names=tuple(n for n in a.names if n != name), rivals=()),
    )
    monkeypatch.setattr(withdraw, "explanation_of", lambda a, *_: _answer(a.names))
    record, start = DecisionLog(), SimpleNamespace(system=None)
    answer = _answer(("rotor_saturation", "rotor_drag"))
    told = withdraw._without_form_errors(answer, start, None, record)
    assert told.accepted.names == left
    assert [d.rule for d in record.of("rotor_saturation")] == [
        "not_form_of_unmeasured_thrust"
    ] * len(form)
    still_open = withdraw._without_form_errors(
        _answer(("rotor_saturation",), ("wind", "tether")), start, None, record
    )
    assert still_open.accepted.names == ("rotor_saturation",), "other names are open"
