"""The linear model of the height loop answers a small pulse as the simulator in C does, and its
poles say the same.
"""

import dataclasses

import control
import numpy as np
import pandas as pd
import pytest

from ges.simulator import flight as sim
from ges.study import config
from ges.study.fly import poles

START_S, LENGTH_S, AFTER_S = 60.0, 0.1, 6.0


@pytest.fixture(scope="module")
def simulator(root):
    return config.load(root / "config/default.yaml").simulator


def _flown(simulator, at, mode, power, pulse, **parameters):
    """Change of height after a pulse of the estimate in the simulator, hovering settled over flat
    ground.
    """
    place, numbers = (
        poles.site(simulator, at.factor),
        {"mode": mode, "mapping": power - 1, "record_every": 1.0, **parameters},
    )
    numbers |= {
        "pulse": pulse,
        "pulse_start_s": START_S,
        "pulse_duration_s": LENGTH_S,
        "duration_s": START_S + AFTER_S,
    }
    flights = [
        place.flight(simulator, at.height_m, **{**numbers, "pulse": p}) for p in (0.0, pulse)
    ]
    plain, pulsed = sim.fly(flights, ("t_s", "p_z_m"))
    after = plain["t_s"] >= START_S
    return (pulsed["p_z_m"] - plain["p_z_m"])[after]


def _linear(simulator, at, mode, power, pulse):
    t = np.arange(round(AFTER_S / simulator.dt_s) + 1) * simulator.dt_s
    return control.forced_response(
        poles.estimate_response(simulator, at, mode, power), t, pulse * (t < LENGTH_S)
    ).outputs


@pytest.mark.parametrize(
    ("mode", "power", "factor"),
    [
        ("none", 1, 1.01),
        ("none", 1, 1.15),
        ("analytical", 1, 1.01),
        ("analytical", 1, 1.15),
        ("oracle", 1, 1.01),
        ("oracle", 1, 1.15),
        ("oracle", 2, 1.005),
    ],
)
def test_small_step_of_the_simulator(simulator, mode, power, factor):
    at, pulse = poles.trim(simulator, factor, mode), 1e-3
    flown, linear = (
        _flown(simulator, at, mode, power, pulse),
        _linear(simulator, at, mode, power, pulse),
    )
    assert np.abs(flown - linear).max() < 0.05 * np.abs(linear).max()


@pytest.mark.parametrize(
    ("factor", "mode"), [(0.95, "none"), (0.95, "analytical"), (0.95, "oracle"), (0.85, "oracle")]
)
def test_small_step_over_a_crest_where_the_loop_is_unstable(simulator, factor, mode):
    """Below 1 hover cannot settle: it begins in balance, with a bias that makes the estimate true
    there. Over the steepest crest it leaves the place of the linearisation by a millimetre within
    0.8 s, so half a second is compared.
    """
    at, pulse, end = poles.trim(simulator, factor, mode), 1e-4, 0.5
    speed = (
        simulator.vehicle.mass_kg
        * poles.gravity()
        / (4 * simulator.vehicle.thrust_coefficient_N_s2)
        / at.factor
    ) ** 0.5
    numbers = {f"start_rotor_speed_{i}_rad_s": speed for i in range(1, 5)} | {
        "bias": at.factor - at.estimate,
        "mode": mode,
    }
    numbers |= {
        "gear_height_m": 0.0,
        "pulse_start_s": 0.005,
        "pulse_duration_s": 0.05,
        "duration_s": end,
        "record_every": 1.0,
    }
    place = poles.site(simulator, factor)
    plain, pulsed = sim.fly(
        [place.flight(simulator, at.height_m, **numbers, pulse=p) for p in (0.0, pulse)],
        ("t_s", "p_z_m"),
    )
    t, balanced = plain["t_s"], dataclasses.replace(at, estimate=at.factor)
    kick = pulse * ((t >= 0.005) & (t < 0.0549))
    linear = control.forced_response(
        poles.estimate_response(simulator, balanced, mode, 1), t, kick
    ).outputs
    assert np.abs(pulsed["p_z_m"] - plain["p_z_m"] - linear).max() < 0.04 * np.abs(linear).max()
    assert poles.closed_loop_poles(simulator, at, mode, 1).real.max() > 0


def test_phase_margin_is_the_lag_that_the_loop_bears(simulator):
    """More delay in the loop than the margin allows makes it unstable, less does not; an unstable
    loop has none.
    """
    loop = poles.restoring(simulator, poles.FAR, "none", 1) / poles.S**2
    margin, crossover = control.margin(loop)[1], control.margin(loop)[3]
    assert poles.phase_margin_deg(simulator) == pytest.approx(margin)
    for share, stable in ((0.8, True), (1.2, False)):
        late = control.tf(*control.pade(share * np.radians(margin) / crossover, 3))
        assert (control.feedback(loop * late, 1).poles().real.max() < 0) == stable
    stiff = simulator.model_copy(
        update={"controller": simulator.controller.model_copy(update={"altitude_kp": 100.0})}
    )
    assert poles.phase_margin_deg(stiff) == 0.0


def test_comparison_would_see_another_lag(simulator):
    """The bound of the test above is tight enough to refuse a motor that is a fifth slower."""
    at = poles.trim(simulator, 1.01, "oracle")
    flown = _flown(
        simulator,
        at,
        "oracle",
        1,
        1e-3,
        motor_time_constant_s=1.2 * simulator.vehicle.motor_time_constant_s,
    )
    linear = _linear(simulator, at, "oracle", 1, 1e-3)
    assert np.abs(flown - linear).max() > 0.05 * np.abs(linear).max()


def test_poles_and_margins_agree_on_stability(simulator, tmp_path, root):
    study = config.load(root / "config/default.yaml")
    poles.write_poles(
        simulator, study.closed_loop.pole_factors, tmp_path / "poles.csv", tmp_path / "summary.csv"
    )
    table, summary = pd.read_csv(tmp_path / "poles.csv"), pd.read_csv(tmp_path / "summary.csv")
    greatest = table.groupby(["mode", "mapping", "factor_is", "factor"])["real_1_s"].max()
    assert (
        (greatest < 0).sort_index()
        == summary.set_index(list(greatest.index.names))["stable"].sort_index()
    ).all()
    assert len(summary) == 3 * 2 * 2 * len(study.closed_loop.pole_factors)


@pytest.mark.parametrize(("factor", "power", "stable"), [(1.15, 1, True), (1.15, 2, False)])
def test_the_simulator_diverges_where_a_pole_is_right_of_zero(simulator, factor, power, stable):
    """Hovering over flat ground with the oracle: 1/sqrt(f) holds the height, 1/f does not."""
    at = poles.trim(simulator, factor, "oracle")
    place = poles.site(simulator, factor)
    nudge = {"pulse": 0.01, "pulse_start_s": 0.5, "pulse_duration_s": 0.1, "gear_height_m": 0.0}
    flight = place.flight(
        simulator, at.height_m, mode="oracle", mapping=power - 1, duration_s=8.0, **nudge
    )
    away = np.abs(sim.fly([flight], ("agl_m",))[0]["agl_m"][-200:] - at.height_m).max()
    assert (away < 0.1 * at.height_m) == stable


def test_trim_says_which_factor_no_height_makes(simulator):
    with pytest.raises(poles.GesError, match="no height makes factor 1.9"):
        poles.trim(simulator, 1.9, "oracle")
