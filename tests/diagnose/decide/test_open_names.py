"""Of names that are open those stay that do something in their full fit."""

import dataclasses
from types import SimpleNamespace

import pytest

from ges.diagnose.decide import explanation
from ges.diagnose.types.decision import Decision, DecisionLog


@dataclasses.dataclass(frozen=True)
class _Accepted:
    rivals: tuple[str, ...]
    alternatives: dict
    result: SimpleNamespace
    fitted: object = None

    def without_rivals(self):
        return dataclasses.replace(self, rivals=())


@dataclasses.dataclass(frozen=True)
class _Explanation:
    accepted: _Accepted
    gusts: object = None


# by name: share of the whole in its full fit, whether it stands at a bound
FITS = {"inertia": (0.1, False), "thrust_curve": (1e-12, False), "ceiling_effect": (0.2, True)}


@pytest.mark.parametrize(
    ("names", "open_names"),
    [
        (("thrust_curve", "ceiling_effect", "inertia"), ("inertia",)),
        (("inertia", "thrust_curve"), ("inertia",)),
        (("thrust_curve", "ceiling_effect"), ()),
        # what cannot be tested has no fit, and stays
        (("inertia", "thrust_curve", "slung_load"), ("inertia", "slung_load")),
    ],
)
def test_what_does_nothing_in_its_full_fit_is_not_open(monkeypatch, names, open_names):
    monkeypatch.setattr(explanation, "fit_alternatives", lambda accepted, record: accepted)
    monkeypatch.setattr(explanation, "explanation_of", lambda accepted, *_: _Explanation(accepted))
    monkeypatch.setattr(
        explanation,
        "parameters_at_bounds",
        lambda fitted: [(n, "p") for n in FITS if fitted == n and FITS[n][1]],
    )
    monkeypatch.setattr(
        explanation,
        "practically_significant",
        lambda fitted, names, *_: {
            n: Decision("practically_significant", FITS[n][0] > 1e-9, "") for n in names
        },
    )
    fits = {n: n for n in names if n in FITS}
    result = SimpleNamespace(inclusion=dict.fromkeys(names, 0.5))
    found = _Explanation(_Accepted(names, fits, result))
    start = SimpleNamespace(nominal=None, first=SimpleNamespace(model=None))
    record = DecisionLog()
    after = explanation.refit_with_open_names(found, start, None, record)
    assert after.accepted.rivals == open_names
    if open_names:
        assert after.accepted.fitted == "inertia" and set(after.accepted.alternatives) == {
            "inertia"
        }
    for name in set(fits) - set(open_names):
        assert any(d.rule == "open" and not d.passed for d in record.of(name))
