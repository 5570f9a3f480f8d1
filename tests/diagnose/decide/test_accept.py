"""Rounds of the search: what they list, and what they leave."""

from types import SimpleNamespace

import pytest

from ges.diagnose.decide import accept as module
from ges.diagnose.types.decision import DecisionLog

from ..synthetic import MODEL


@pytest.fixture
def searched(monkeypatch):
    """Names of every search; the first fit leaves an inflow with nothing to do."""
    names: list[tuple[str, ...]] = []
    idle = iter([{"axial_inflow"}, set()])

    def search(regression, listed, base, only):
        names.append(tuple(c.name for c in listed))
        best = SimpleNamespace(names=names[-1])
        return regression, SimpleNamespace(best=best, inclusion=dict.fromkeys(names[-1], 0.95))

    candidates = [SimpleNamespace(name=n) for n in ("axial_inflow", "rotor_tilt")]
    monkeypatch.setattr(module, "candidates_of", lambda *a: candidates)
    monkeypatch.setattr(module, "_search_with_refined_load", search)
    monkeypatch.setattr(module, "entries", lambda *a: ())
    monkeypatch.setattr(module, "RuleContext", lambda *a: SimpleNamespace(alike=lambda n: ()))
    monkeypatch.setattr(module, "apply_rules", lambda rules, context, names, record: set(names))
    monkeypatch.setattr(module, "_contested_names", lambda *a: set())
    monkeypatch.setattr(module, "_probable_modifiers", lambda *a: {})
    monkeypatch.setattr(module, "_fit_significant", lambda *a: ((), None, next(idle)))
    monkeypatch.setattr(module, "open_names", lambda *a: ())
    return names


def test_what_does_nothing_once_fitted_is_searched_without(searched):
    """Its moment, whose coefficient is free, had taken what others explain."""
    start = SimpleNamespace(system=SimpleNamespace(recordings=[], model=MODEL))
    accepted = module.accept(start, DecisionLog())
    assert searched == [("axial_inflow", "rotor_tilt"), ("rotor_tilt",)]
    assert set(accepted.result.inclusion) == {"rotor_tilt"} and accepted.names == ()
