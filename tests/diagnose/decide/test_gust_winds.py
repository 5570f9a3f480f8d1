"""Gusts leave flights mean winds: what they act through stands, the winds they may make do not."""

from types import SimpleNamespace

from ges.diagnose.decide import explanation
from ges.diagnose.types.decision import DecisionLog


def test_a_drag_that_gusts_act_through_stands_without_the_wind_that_they_may_make(monkeypatch):
    """With mean winds of each flight neither drag nor wind is certain, and without a drag there
    are no gusts: the drag is fitted again, alone.
    """
    asked = []

    def accept(system, record, only=None):
        asked.append(only)
        return SimpleNamespace(names=tuple(only or ()), fitted=None)

    gusts = SimpleNamespace(blow_in=lambda model, effects: model)
    monkeypatch.setattr(explanation, "accept", accept)
    monkeypatch.setattr(explanation, "_gusts", lambda a, *_: gusts if a.names else None)
    start = SimpleNamespace(
        system=SimpleNamespace(model=None),
        linearised_about=lambda model: SimpleNamespace(system=None),
    )
    before = SimpleNamespace(
        names=("rotor_drag", "wind", "cg_offset"), fit=SimpleNamespace(effects={})
    )
    _, again, still = explanation._accept_in_gusts(start, before, gusts, None, DecisionLog())
    assert asked == [None, ["rotor_drag", "cg_offset"]]
    assert again.names == ("rotor_drag", "cg_offset") and still is gusts
