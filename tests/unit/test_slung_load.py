"""A load on a thread that is longer than the vehicle is high: it lies on the ground, and is dragged
where the thread is taut.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ges.simulator import effects
from ges.simulator import flight as sim
from ges.simulator.terrain import Terrain

QUIET = {
    "gyro_noise_rad_s": 0,
    "acc_noise_m_s2": 0,
    "range_noise_m": 0,
    "rpm_noise_rad_s": 0,
    "current_noise_A": 0,
}
LENGTH_M, HEIGHT_M, FRICTION, WEIGHT_N = 0.6, 0.5, 0.5, 0.1 * 9.80665


def dragged(
    x_m: np.ndarray, z_m: np.ndarray | float = HEIGHT_M, dt_s: float = 0.01, **more
) -> effects.Replay:
    """World force of a load of 0.1 kg on a thread of 0.6 m, along a level vehicle's path."""
    samples = {
        "t_s": np.arange(len(x_m)) * dt_s,
        "p_x_m": x_m,
        "p_z_m": np.broadcast_to(z_m, x_m.shape),
    }
    samples["v_x_m_s"] = np.gradient(x_m, dt_s)
    load = {"mass_kg": 0.1, "length_m": LENGTH_M, "friction": FRICTION, **more}
    return effects.evaluate(
        "slung_load", load, effects.Samples.from_columns(samples), {}, terrain=Terrain.flat()
    )


def test_a_load_on_the_ground_pulls_only_where_its_thread_is_taut():
    x = 0.5 * np.arange(0, 4, 0.01)
    force = dragged(x).force_N
    taut = np.sqrt(LENGTH_M**2 - HEIGHT_M**2)
    assert np.all(force[x < taut - 0.02] == 0.0) and np.all(force[x > taut + 0.02, 0] < 0.0)


def test_a_dragged_load_obeys_coulomb_and_the_geometry_of_its_thread():
    """T_x = mu (m g - T_z) along a thread that reaches sqrt(L^2 - h^2) ahead of the load; it bears
    less than the weight.
    """
    force = dragged(0.5 * np.arange(0, 4, 0.01)).force_N[-1]
    back, down = -force[0], -force[2]
    assert back == pytest.approx(FRICTION * (WEIGHT_N - down), rel=1e-6)
    assert back / down == pytest.approx(np.sqrt(LENGTH_M**2 - HEIGHT_M**2) / HEIGHT_M, rel=0.05)
    assert 0.0 < down < WEIGHT_N


def test_a_dragged_load_stays_behind_and_is_slack_on_the_way_back():
    out = 0.5 * np.arange(0, 4, 0.01)
    x = np.concatenate([out, out[::-1]])
    force, taut = dragged(x).force_N[len(out) :], np.sqrt(LENGTH_M**2 - HEIGHT_M**2)
    gone = out[-1] - out[::-1]
    assert np.all(force[(gone > 0.05) & (gone < 2 * taut - 0.03)] == 0.0), (
        "slack until it is as far on the other side"
    )
    assert np.all(force[gone > 2 * taut + 0.03, 0] > 0.0)


def test_the_first_place_of_a_load_says_when_its_thread_gets_taut():
    x = 0.5 * np.arange(0, 4, 0.01)
    first = [x[np.flatnonzero(dragged(x, start_x_m=s).force_N[:, 0])[0]] for s in (0.0, 0.2)]
    assert first[1] - first[0] == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("dt_s", [0.001, 0.005, 0.01])
def test_a_dragged_load_is_the_same_at_every_step(dt_s):
    path = 0.5 * np.arange(0, 4, 0.001)
    fine = dragged(path, dt_s=0.001).force_N
    every = round(dt_s / 0.001)
    coarse = dragged(path[::every], dt_s=dt_s).force_N
    assert np.abs(coarse - fine[::every])[30:].max() < 0.1 * WEIGHT_N
    assert np.abs(coarse[-1] - fine[-1]).max() < 0.01 * WEIGHT_N


def test_lifted_and_set_down_a_load_weighs_up_to_its_weight_without_a_jump():
    z = 0.4 + 0.1 * np.arange(0, 4, 0.01)
    down = -dragged(0.0 * z, z).force_N[:, 2]
    assert np.all(down[z < 0.99 * LENGTH_M] == 0.0) and np.all(down[z > LENGTH_M] == WEIGHT_N)
    assert np.all(np.diff(down) >= 0.0) and np.diff(down).max() < 0.2 * WEIGHT_N
    assert np.array_equal(down[::-1], -dragged(0.0 * z, z[::-1]).force_N[:, 2])


def test_a_load_over_ground_of_unknown_height_hangs_free():
    x = 0.5 * np.arange(0, 4, 0.01)
    assert np.all(dragged(x, np.nan * x).force_N[:, 2] != 0.0)


def test_over_a_pit_a_load_hangs_free():
    force = dragged(0.5 * np.arange(0, 4, 0.01), below_m=1.0).force_N
    assert np.allclose(force[:, 2], -WEIGHT_N, rtol=2e-4)


def test_a_flown_load_is_dragged_steadily():
    """In closed loop at coarse steps: the thread, stiff as it is, shakes nothing, and the tilt
    answers the pull.
    """
    numbers = {
        **QUIET,
        "agl_ref_m": HEIGHT_M,
        "cruise_m_s": 0.5,
        "mode": "none",
        "duration_s": 20,
        "dt_s": 0.005,
    }
    load = {"slung_load": {"mass_kg": 0.1, "length_m": LENGTH_M, "friction": FRICTION}}
    r = sim.fly([sim.Flight(numbers, load, Terrain.flat())])[0]
    tilt = 2.0 * np.arcsin(r["q_y"][r["t_s"] > 10])
    ahead = np.sqrt(LENGTH_M**2 - HEIGHT_M**2)
    back = FRICTION * WEIGHT_N * ahead / (ahead + FRICTION * HEIGHT_M)
    assert r.status == "ok" and tilt.std() < 1e-3
    assert np.tan(tilt.mean()) * (1.2 * 9.80665 + back * HEIGHT_M / ahead) == pytest.approx(
        back, rel=0.05
    )


def test_a_hanging_load_is_lifted_with_the_vehicle():
    """Climbing at a = 2 m/s^2 the thread bears m (g + a), and the load swings faster by sqrt(1 +
    a/g).
    """
    t, a = np.arange(0.0, 3.0, 0.005), 2.0
    samples = {
        "t_s": t,
        "p_x_m": 0.02 * (t > 0.5),
        "p_z_m": 5.0 + 0.5 * a * t**2,
        "v_x_m_s": 0.0 * t,
        "v_z_m_s": a * t,
    }
    load = {"mass_kg": 0.1, "length_m": LENGTH_M, "damping": 0.0, "below_m": 20.0}
    columns = effects.Samples.from_columns(samples)
    force = effects.evaluate("slung_load", load, columns, {}, terrain=Terrain.flat()).force_N
    assert force[t > 0.2, 2] == pytest.approx(-0.1 * (9.80665 + a), rel=0.005)
    pull = force[t > 0.6, 0]
    crossings = np.flatnonzero(np.diff(np.sign(pull)))
    half_period = np.mean(np.diff(t[t > 0.6][crossings]))
    assert half_period == pytest.approx(np.pi * np.sqrt(LENGTH_M / (9.80665 + a)), rel=0.02)


def test_the_air_brakes_a_hanging_load_behind_a_steady_flight():
    """At constant speed v the load trails, and the thread pulls back with its drag 2 z sqrt(g/L) m
    v.
    """
    t, v, damping = np.arange(0.0, 40.0, 0.01), 3.0, 0.1
    samples = {"t_s": t, "p_x_m": v * t, "p_z_m": 5.0 + 0.0 * t, "v_x_m_s": v + 0.0 * t}
    load = {"mass_kg": 0.1, "length_m": LENGTH_M, "damping": damping}
    columns = effects.Samples.from_columns(samples)
    force = effects.evaluate("slung_load", load, columns, {}, terrain=Terrain.flat()).force_N
    drag = 2.0 * damping * np.sqrt(9.80665 / LENGTH_M) * 0.1 * v
    assert force[t > 35.0, 0] == pytest.approx(-drag, rel=0.02)


def test_a_wide_swing_is_a_pendulums():
    """Let go at 50 degrees from an attachment at rest: the thread bears m (g cos(angle) + L
    rate^2).
    """
    t, start = np.arange(0.0, 4.0, 0.005), np.radians(50.0)
    swing = solve_ivp(
        lambda _, y: (y[1], -9.80665 / LENGTH_M * np.sin(y[0])),
        (0.0, 4.0),
        (start, 0.0),
        t_eval=t,
        rtol=1e-9,
    ).y
    load = {
        "mass_kg": 0.1,
        "length_m": LENGTH_M,
        "damping": 0.0,
        "below_m": 20.0,
        "start_x_m": LENGTH_M * np.sin(start),
    }
    samples = effects.Samples.from_columns({"t_s": t, "p_z_m": 5.0 + 0.0 * t})
    force = effects.evaluate("slung_load", load, samples, {}, terrain=Terrain.flat()).force_N
    bears = 0.1 * (9.80665 * np.cos(swing[0]) + LENGTH_M * swing[1] ** 2)
    np.testing.assert_allclose(force[:, 0], bears * np.sin(swing[0]), atol=0.02)
    np.testing.assert_allclose(force[:, 2], -bears * np.cos(swing[0]), atol=0.02)
