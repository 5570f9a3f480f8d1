"""What flights say of one that they are asked to predict, with a name and without it."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from ges.diagnose.decide import predict
from ges.diagnose.estimate.fit import Fitted, free_columns, joint_fit
from ges.diagnose.select.evidence import make_regression
from ges.diagnose.settings import settings
from ges.diagnose.types.decision import DecisionLog

from ..synthetic import MODEL, amplitude, nuisance, rows_of, system_of

ROWS = 300
NAME = ("rotor_drag", "k_kg")
DRAG = amplitude("rotor_drag.k_kg", high=1e9)
COMMON = nuisance("inertia.xx", 0.2, mean=0.05)


def _fitted(sizes, columns=(DRAG, COMMON)):
    """A fit of flights of noise about a column times each one's size, at the best value."""
    rng, flights = np.random.default_rng(3), []
    for size in sizes:
        x = rng.standard_normal((len(columns), ROWS))
        y = rng.standard_normal(ROWS) + size * x[0]
        flights.append(rows_of(y[:, None], [{0: row} for row in x]))
    regression = make_regression(system_of(("force_z",), columns, flights), [0])
    joint = joint_fit(regression, free_columns(regression.system))
    effects = {"rotor_drag": {"k_kg": float(joint.chosen[0])}}
    regression = _about(regression, float(joint.chosen[0]))
    return Fitted(effects, (NAME,), joint.covariance, joint, joint, regression)


def _about(regression, value):
    """The regression with its residuals as the fitted effect leaves them."""
    flights = tuple(
        dataclasses.replace(r, y=r.y - value * r.x.of(0, [0])) for r in regression.system.flights
    )
    return make_regression(dataclasses.replace(regression.system, flights=flights), [0])


def _gain(fitted, name="rotor_drag"):
    return predict.predictive_gain(fitted, name, "force_z").gain


def test_what_is_the_same_in_all_flights_predicts_each_of_them():
    gains = _gain(_fitted((0.6, 0.6, 0.6)))
    assert gains.shape == (3,) and np.all(gains > 5.0)


def test_what_only_one_flight_has_makes_the_others_no_likelier():
    gains = _gain(_fitted((1.2, 0.0, 0.0)))
    assert gains[0] > gains[1:].max() and np.all(gains[1:] < 0.0)


def test_what_turns_its_sign_makes_a_flight_certainly_less_likely():
    told = predict.predictive_gain(_fitted((0.9, 0.9, -0.9)), "rotor_drag", "force_z")
    assert told.gain[2] == told.worst < -settings.statistics.certain_log_odds
    assert told.growth[2] > 1.2


def test_the_density_of_a_flight_is_what_the_others_say_of_it():
    """One column without nuisances: the predictive density of a Gaussian regression, by hand."""
    fitted = _fitted((0.3, 0.5), (DRAG,))
    t, value = settings.evidence.tempering, fitted.effects["rotor_drag"]["k_kg"]
    prior = 1.0 / predict.wide_sds(fitted.regression, [0])[0] ** 2
    parts = [w.parts[0] for w in fitted.regression.whites]
    told = _gain(fitted)
    for left, other in ((0, 1), (1, 0)):
        x, y = parts[other].x[:, 0], parts[other].y
        precision = prior + t * x @ x
        mean = t * (x @ y) / precision
        x, y = parts[left].x[:, 0], parts[left].y
        after = precision + t * x @ x
        best = (precision * mean + t * x @ y) / after
        with_name = 0.5 * (np.log(precision / after) + best**2 * after - mean**2 * precision)
        # without it the residuals are those of the vehicle before the fit
        with_name -= 0.5 * t * y @ y
        without = -0.5 * t * ((y + value * x) ** 2).sum()
        assert told[left] == pytest.approx(with_name - without, rel=1e-6)


def test_one_flight_has_no_other_that_could_predict_it():
    told = predict.predictive_gain(_fitted((0.6,)), "rotor_drag", "force_z")
    assert told.gain.shape == (0,) and told.worst == 0.0


def test_what_acts_through_a_name_goes_with_it():
    """A wind without the drag that it pushes on is nothing."""
    columns = (DRAG, amplitude("wind.east_m_s", high=1e9), COMMON)
    rng, flights = np.random.default_rng(4), []
    for _ in range(3):
        x = rng.standard_normal((3, ROWS))
        y = rng.standard_normal(ROWS) + 0.6 * x[1]
        flights.append(rows_of(y[:, None], [{0: row} for row in x]))
    regression = make_regression(system_of(("force_z",), columns, flights, MODEL), [0, 1])
    joint = joint_fit(regression, free_columns(regression.system))
    effects = {"rotor_drag": {"k_kg": 0.0}, "wind": {"east_m_s": 0.0, "north_m_s": 0.0}}
    free = (NAME, ("wind", "east_m_s"))
    fitted = Fitted(effects, free, joint.covariance, joint, joint, regression)
    drag, wind = (_gain(fitted, n) for n in ("rotor_drag", "wind"))
    assert np.all(wind > 5.0)
    assert np.all(np.abs(drag - wind) < 2.0)


def test_a_flight_that_is_predicted_better_speaks_for_a_name():
    """However little likelier the noise model finds it."""
    gain, growth = np.array([9.0, -20.0, -8.0]), np.array([0.5, 0.9, 1.1])
    assert predict.PredictiveGain(gain, growth).worst == -8.0
    assert predict.PredictiveGain(gain, 0.9 * np.ones(3)).worst == 0.0


def test_errors_of_a_flight_are_those_by_the_others_coefficients():
    """Noise of unit sd about 0.6, and about its opposite, with coefficients of 0.6 or none."""
    told = predict.predictive_gain(_fitted((0.6, 0.6, -0.6), (DRAG,)), "rotor_drag", "force_z")
    alone = math.sqrt(1.0 + 0.6**2)
    assert told.growth[2] == pytest.approx(math.sqrt(1.0 + 1.2**2) / alone, rel=0.1)
    assert told.growth[0] == pytest.approx(math.sqrt(1.0 + 0.6**2) / alone, rel=0.1)


@pytest.fixture
def worst(monkeypatch):
    """The flight that speaks loudest against each name, by the names that are accepted with it."""

    def put(by_names):
        monkeypatch.setattr(predict, "_worst", lambda names, name, _: by_names[names][name])

    monkeypatch.setattr(predict, "contributions", lambda fitted, names, _: dict.fromkeys(names))
    monkeypatch.setattr(
        predict, "size_of_contribution", lambda added, system: {"channel": "force_x"}
    )
    monkeypatch.setattr(
        predict, "without_name", lambda a, name: _accepted(tuple(n for n in a.names if n != name))
    )
    return put


def _accepted(names):
    regression = SimpleNamespace(system=SimpleNamespace(model=None))
    return SimpleNamespace(names=names, fitted=names or None, regression=regression)


def test_the_worst_goes_first_and_the_others_are_asked_again(worst):
    """Without the lag, which one flight denies, the drag predicts all of them."""
    both = ("rotor_drag", "motor_lag")
    worst({both: {"rotor_drag": -8.0, "motor_lag": -20.0}, both[:1]: {"rotor_drag": -1.0}})
    record = DecisionLog()
    assert predict.drop_unpredictive(_accepted(both), record).names == ("rotor_drag",)
    (drag,), (lag,) = record.of("rotor_drag"), record.of("motor_lag")
    assert drag.passed and drag.statistic == -1.0
    assert not lag.passed and lag.statistic == -20.0
    assert lag.threshold == -settings.statistics.certain_log_odds


def test_a_loss_that_may_be_chance_takes_nothing_away(worst):
    names = ("rotor_drag",)
    worst({names: {"rotor_drag": -0.9 * settings.statistics.certain_log_odds}})
    assert predict.drop_unpredictive(_accepted(names), DecisionLog()).names == names
