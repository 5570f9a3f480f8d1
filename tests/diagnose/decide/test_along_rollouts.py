"""What is told stands in the fit that is told, which is the one along rollouts."""

from types import SimpleNamespace

import pytest

from ges.diagnose.decide import accept
from ges.diagnose.decide.accept import Accepted, confirm_along_rollouts, fit_along_rollouts
from ges.diagnose.types.decision import Decision, DecisionLog

VALUES = {"rotor_drag": {"k_kg": 1e-4}, "wind": {"east_m_s": 2.0}, "motor_lag": {"up_s": 0.5}}


@pytest.fixture
def accepted(monkeypatch):
    """Three names that were significant along the recorded path."""

    def polish(_, effects, free, *__, **___):
        return SimpleNamespace(effects=dict(effects), free=list(free))

    monkeypatch.setattr(accept, "polish", polish)
    monkeypatch.setattr(accept, "fitted_model", lambda *_: None)
    system = SimpleNamespace(model=SimpleNamespace(effects={}), recordings=[])
    free = [(e, p) for e, values in VALUES.items() for p in values]
    return Accepted(
        tuple(VALUES),
        None,
        None,
        system,
        polish(None, VALUES, free),
        dict.fromkeys(VALUES, 0.99),
        (),
    )


@pytest.mark.parametrize(
    ("failing", "idle", "left"),
    [
        ((), (), ("rotor_drag", "wind", "motor_lag")),
        (("motor_lag",), (), ("rotor_drag", "wind")),
        ((), ("motor_lag",), ("rotor_drag", "wind")),
        (("rotor_drag",), (), ("motor_lag",)),
        (tuple(VALUES), (), ()),
    ],
)
def test_a_name_that_fails_along_rollouts_is_taken_back(monkeypatch, accepted, failing, idle, left):
    """A lag that ran to its bound of half a second, 20 sds along the path, is 2.3 along rollouts.
    A wind goes with the drag that it acts through.
    """

    def significant(_, name):
        return Decision("significant_when_fitted", name not in failing, "as given")

    def practically_significant(_, names, *__):
        assert not set(names) & set(failing), "what is not significant is asked no more"
        return {n: Decision("practically_significant", n not in idle, "as given") for n in names}

    monkeypatch.setattr(accept, "significant", significant)
    monkeypatch.setattr(accept, "practically_significant", practically_significant)
    record = DecisionLog()
    refined = confirm_along_rollouts(accepted, None, None, record)
    assert refined.names == left and set(refined.probability) == set(left)
    assert refined.fitted is None if not left else set(refined.fitted.effects) == set(left)
    for name in (*failing, *idle):
        assert [d.passed for d in record.of(name)] == [False]
    kept = fit_along_rollouts(accepted)
    assert kept.names == tuple(VALUES), "what was asked for stays"
