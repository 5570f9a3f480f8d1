"""The full fit: sds of what is fitted, where it starts, how it steps, and what vehicles fly."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from ges.diagnose.estimate.fit import (
    Fitted,
    _refit_trims,
    _secant_share,
    fitted_model,
    starting_values,
)
from ges.diagnose.estimate.joint import JointFit, joint_fit
from ges.diagnose.library.candidates import Variant, amplitude_of
from ges.diagnose.select.evidence import Posterior, make_regression
from ges.diagnose.select.search import Hypothesis
from ges.diagnose.settings import settings

from ..synthetic import MODEL, amplitude, nuisance, rows_of, system_of

ROWS = 240
DRAG = amplitude("rotor_drag.k_kg", high=1e9)


def _fitted(regression, joint, value):
    free = (("rotor_drag", "k_kg"),)
    return Fitted({"rotor_drag": {"k_kg": value}}, free, joint.covariance, joint, joint, regression)


def test_the_size_of_a_physical_effect_is_no_better_known_than_its_form():
    regression = SimpleNamespace()
    effects = {"rotor_drag": {"k_kg": 2e-4}, "inertia": {"xx": 0.3}}
    free = (("rotor_drag", "k_kg"), ("inertia", "xx"))
    covariance = np.array([[1e-12, 5e-9], [5e-9, 1e-4]])
    fitted = Fitted(effects, free, covariance, None, None, regression)
    form = settings.estimate.form_error * 2e-4
    assert fitted.sd("rotor_drag", "k_kg") == pytest.approx(math.hypot(1e-6, form))
    assert fitted.sd("inertia", "xx") == pytest.approx(0.01), "a parameter has no form"
    assert fitted.correlation(*free) == pytest.approx(0.5)
    assert fitted.correlation(free[0], free[0]) == pytest.approx(1.0)
    plausible = 0.3
    expected = 0.3 / (0.01 * math.hypot(1.0, 0.01 / plausible))
    assert fitted.sds_from_neutral("inertia", "xx") == pytest.approx(expected)


def test_a_fitted_vehicle_has_its_effects_and_its_corrections():
    joint = JointFit(*[np.zeros(0)] * 3, 0.0, {"inertia.xx": 0.2}, {}, ())
    fitted = _fitted(None, dataclasses.replace(joint, covariance=np.eye(1)), 3e-4)
    told = fitted_model(MODEL, fitted)
    assert told.effects["rotor_drag"]["k_kg"] == 3e-4 and told.effects["inertia"]["xx"] == 0.2
    moved = MODEL.with_effects({"inertia": {"xx": 0.15, "yy": 0.0, "zz": 0.0}})
    there = dataclasses.replace(moved, corrections={"inertia.xx": 0.15})
    assert fitted_model(there, fitted).effects["inertia"]["xx"] == pytest.approx(0.2), "not twice"


def _start(variants_values, model=MODEL):
    """Values that a fit starts from, of variants of one amplitude with their coefficients."""
    columns = [
        dataclasses.replace(amplitude(f"{v.effect}.{v.amplitudes[0].parameter}"), variant=v)
        for v, _ in variants_values
    ]
    regression = SimpleNamespace(system=SimpleNamespace(columns=columns, model=model))
    mean = np.array([value for _, value in variants_values])
    found = Posterior(tuple(range(len(mean))), mean, np.eye(len(mean)), 0.0)
    return starting_values(regression, Hypothesis((), (), found, 0.0))


def _variant(effect, parameter, **more):
    return Variant(effect, more.pop("shape", {}), (amplitude_of(effect, parameter),), **more)


def test_a_fit_starts_from_the_search_within_bounds_and_from_what_the_file_has():
    shape = {"length_m": 0.4}
    (told,) = _start([(_variant("slung_load", "mass_kg", shape=shape), 0.2)]).values()
    assert told["mass_kg"] == 0.2 and told["length_m"] == 0.4
    assert _start([(_variant("rotor_drag", "k_kg"), 5.0)])["rotor_drag"]["k_kg"] == 0.01
    on = MODEL.with_effects({"rotor_drag": {"k_kg": 1e-3}})
    told = _start([(_variant("rotor_drag", "k_kg"), 2e-3)], on)
    assert told["rotor_drag"]["k_kg"] == pytest.approx(3e-3)


def test_a_wind_is_as_strong_as_the_drag_that_was_found_lets_it_be():
    """Product alone is known: half of the usual drag, twice the wind."""
    beside = {"rotor_drag": {"k_kg": 1e-4}}
    wind = _variant("wind", "east_m_s", given=beside)
    for found, factor in (
        (5e-5, 2.0),
        (2e-4, 0.5),
        (1e-6, 1.0 / settings.estimate.prerequisite_share_least),
    ):
        told = _start([(wind, 1.5), (_variant("rotor_drag", "k_kg"), found)])
        assert told["wind"]["east_m_s"] == pytest.approx(1.5 * factor)


def test_a_lag_is_not_what_a_lever_is_wrong_by():
    """A drag's small moment has its own coefficient in the fit; the vehicle then flies with the
    lever that it has. Of the rest trims take what they can, and nominal parameters none.
    """
    rng = np.random.default_rng(8)
    lag, trim = nuisance("motor_lag.up_s", 0.5), nuisance("weak_rotor.loss_1", 0.5)
    columns = (DRAG, amplitude("rotor_drag.k_kg", part="moment", high=1e9), lag, trim)
    flights = []
    for _ in range(2):
        push, moment, late, loss = rng.standard_normal((4, ROWS))
        late, loss = late + moment, loss + moment
        noise = 0.1 * rng.standard_normal((ROWS, 2))
        y = np.stack([0.5 * push, -0.4 * moment + 0.1 * late], axis=1) + noise
        flights.append(rows_of(y, [{0: push}, {1: moment}, {1: late}, {1: loss}]))
    regression = make_regression(system_of(("force_x", "moment_y"), columns, flights), [0, 1])
    apart = joint_fit(regression, [0, 1])
    told = _refit_trims(regression, [0, 1], apart, 1)
    assert told.common["motor_lag.up_s"] == pytest.approx(apart.common["motor_lag.up_s"], abs=0.02)
    assert told.common_sd["motor_lag.up_s"] == apart.common_sd["motor_lag.up_s"]
    assert told.common["weak_rotor.loss_1"] < apart.common["weak_rotor.loss_1"] - 0.05
    assert told.chosen == pytest.approx(apart.chosen[:1], abs=0.01)


@pytest.mark.parametrize("gain", [0.4, 1.0, 1.6])
def test_a_step_that_is_off_by_a_factor_is_so_once(gain):
    """Whole steps would go on by the share 1 - gain of the way, and circle beyond two."""
    at, share, before = np.array([3.0, -1.0]), 1.0, np.zeros(2)
    for _ in range(4):
        step = -gain * at
        share = _secant_share(share, before, step)
        at, before = at + share * step, step
    assert np.abs(at).max() < 1e-6


def test_a_share_grows_by_no_more_than_two():
    step = np.array([1.0, 0.5])
    assert _secant_share(0.5, step, step) == 1.0
