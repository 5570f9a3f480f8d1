"""Loads on threads: the pendulum that hangs below, and where a drawn one lay."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.conventions import BODY_RATE, VELOCITY, rotor_speed
from ges.diagnose.design.residual import evaluate
from ges.diagnose.design.system import build
from ges.diagnose.detectors.loads import DraggedLoad, outbound_direction, probable_load, refine_load
from ges.diagnose.library.candidates import Variant, amplitude_of
from ges.diagnose.select.evidence import Posterior
from ges.diagnose.select.search import Hypothesis, SearchResult
from ges.simulator.effects import get

from ..synthetic import MODEL, WINDOW_S, amplitude, hovering, times, windows_of

ROTOR_SPEED = rotor_speed(4)

THREADS = Variant(
    "slung_load", {"length_m": 0.5, "below_m": 20.0}, (amplitude_of("slung_load", "mass_kg"),)
)


def _shaken(duration_s=20.0, length_m=None, mass_kg=0.05):
    """A flight that leans to one side and back after two seconds; with the force of the
    load in its residual where one hangs.
    """
    t, gravity = times(duration_s), MODEL.number("gravity_m_s2")
    speed = 0.5 * np.exp(-(((t - 2.0) / 0.15) ** 2))
    push = np.gradient(speed, 0.01)
    lean = np.arctan2(push, gravity)
    rotors = MODEL.hover_rad_s * np.sqrt(np.hypot(push, gravity) / gravity)
    flight = hovering(
        duration_s,
        v_x_m_s=speed,
        p_x_m=np.cumsum(speed) * 0.01,
        q_w=np.cos(0.5 * lean),
        q_y=np.sin(0.5 * lean),
        omega_y_rad_s=np.gradient(lean, 0.01),
        **dict.fromkeys(ROTOR_SPEED, rotors),
    )
    if length_m is None:
        return flight
    load = {
        "slung_load": {"mass_kg": mass_kg, "length_m": length_m, "below_m": 20.0, "damping": 0.0}
    }
    said = evaluate(flight, windows_of(flight), MODEL, ("force_x",), load).output
    return flight, said.force_N


@pytest.mark.parametrize("length_m", [0.3, 0.8])
def test_a_load_swings_at_its_pendulum_s_frequency(length_m):
    """A light load below a vehicle that stands: 2 pi sqrt(L / g), by the zeros of its pull."""
    flight, force_N = _shaken(length_m=length_m, mass_kg=0.01)
    pull = force_N[400:, 0]
    rising = np.flatnonzero((pull[:-1] < 0.0) & (pull[1:] >= 0.0))
    period_s = float(np.mean(np.diff(rising))) * 0.01
    expected = 2.0 * np.pi * np.sqrt(length_m / MODEL.number("gravity_m_s2"))
    assert len(rising) >= 4 and period_s == pytest.approx(expected, rel=0.02)
    np.testing.assert_allclose(force_N[0, 2], MODEL.weight_N - 0.01 * 9.80665, atol=1e-3)


def test_a_thread_is_made_as_long_as_its_swing_says():
    """From the middle of a coarse grid to hundredths."""
    flight = _shaken(12.0)
    load = {"slung_load": {"mass_kg": 0.01, "length_m": 0.55, "below_m": 20.0}}
    # the recording of a vehicle with the load: its velocity shows the pull
    pull_N = evaluate(flight, windows_of(flight), MODEL, ("force_x",), load).output.force_N
    pull_N = pull_N - evaluate(flight, windows_of(flight), MODEL, ("force_x",)).output.force_N
    more = np.cumsum(pull_N, axis=0) * 0.01 / MODEL.number("mass_kg")
    columns = {name: flight.columns[name] + more[:, k] for k, name in enumerate(VELOCITY)}
    swung = flight.replace(columns={**flight.columns, **columns})
    rng = np.random.default_rng(0)
    sizes = {
        **dict.fromkeys(VELOCITY, 1e-3),
        **dict.fromkeys(BODY_RATE, 5e-3),
        **dict.fromkeys(ROTOR_SPEED, 0.5),
    }
    noisy = {n: swung.columns[n] + s * rng.standard_normal(1200) for n, s in sizes.items()}
    swung = swung.replace(columns={**swung.columns, **noisy})
    found = refine_load(build([swung], MODEL, [], length_s=WINDOW_S), THREADS)
    assert found.shape["length_m"] == pytest.approx(0.55, rel=0.03)
    assert found.shape["below_m"] == 20.0 and found.amplitudes == THREADS.amplitudes


@given(st.floats(0.1, 2.0), st.floats(-1.0, 1.0), st.floats(0.1, 2.0))
def test_another_thread_gets_taut_at_the_same_place(behind_m, ahead_m, other_m):
    load = DraggedLoad(behind_m, ahead_m)
    told = load.with_thread(other_m)
    assert told.behind_m == other_m
    assert told.ahead_m + told.behind_m == pytest.approx(load.ahead_m + load.behind_m)


def test_the_way_out_is_to_where_half_of_it_is_gone():
    t = times()
    there_and_back = 2.0 * np.sin(np.pi * t / 4.0)
    flight = hovering(p_x_m=5.0 + 0.6 * there_and_back, p_y_m=-3.0 + 0.8 * there_and_back)
    np.testing.assert_allclose(outbound_direction([flight]), [0.6, 0.8], atol=1e-6)
    east = hovering(p_x_m=t)
    np.testing.assert_allclose(
        outbound_direction([east, flight]), np.array([2.6, 0.8]) / np.hypot(2.6, 0.8), atol=0.01
    )
    assert np.linalg.norm(outbound_direction([hovering()])) == pytest.approx(1.0)


@pytest.mark.parametrize(("p", "likely"), [(0.0, False), (0.5, True)])
def test_only_a_load_that_is_not_out_of_the_question_is_made_sharper(p, likely):
    column = amplitude("slung_load.mass_kg")
    column = dataclasses.replace(column, variant=THREADS)
    regression = SimpleNamespace(
        system=SimpleNamespace(columns=[amplitude("rotor_drag.k_kg"), column])
    )
    best = Hypothesis(("rotor_drag", "slung_load"), (), SimpleNamespace(columns=(0, 1)), 1.0)
    found = SearchResult((best,), {"slung_load": p})
    assert probable_load(regression, found) is (THREADS if likely else None)
    assert (
        probable_load(regression, SearchResult((Hypothesis((), (), Posterior.empty(), 0.0),), {}))
        is None
    )
    assert get("slung_load").remembers_the_path
