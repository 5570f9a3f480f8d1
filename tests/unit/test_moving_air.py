"""Gusts have the spectrum of their source, whatever the lanes and the step; the downwash has its
published values.
"""

import numpy as np
import pytest

from ges.simulator import effects
from ges.simulator import flight as sim
from ges.simulator.terrain import Terrain

FOOT_M = 0.3048
HEIGHT_FT, SPEED_M_S, STEP_S = 100.0, 20.0, 0.02
GUSTY = {"wind_20ft_m_s": 10.0}


def _winds(seeds, seconds=200.0):
    """Gusts that a vehicle meets at 100 ft and 20 m/s, (seeds, 3, n) m/s."""
    t = np.arange(0.0, seconds, STEP_S)
    samples = effects.Samples.from_columns(
        {
            "t_s": t,
            "p_z_m": np.full_like(t, HEIGHT_FT * FOOT_M),
            "v_x_m_s": np.full_like(t, SPEED_M_S),
        }
    )
    told = [effects.replay({}, samples, {"gusts": {**GUSTY, "seed": seed}}) for seed in seeds]
    return np.array([[r[f"wind_{a}_m_s"] for a in "xyz"] for r in told])


@pytest.fixture(scope="module")
def winds():
    return _winds(range(1, 41))


def test_gusts_have_the_standard_deviations_of_the_low_altitude_form(winds):
    sigma_w = 0.1 * GUSTY["wind_20ft_m_s"]
    sigma_u = sigma_w / (0.177 + 0.000823 * HEIGHT_FT) ** 0.4
    assert winds.std(axis=(0, 2)) == pytest.approx([sigma_u, sigma_u, sigma_w], rel=0.06)
    assert np.abs(winds[:, :, 0].std(axis=0) / [sigma_u, sigma_u, sigma_w] - 1.0).max() < 0.4, (
        "starts as it goes on"
    )


@pytest.mark.parametrize("frequency_hz", [0.05, 0.2, 1.0, 4.0])
def test_gusts_have_the_dryden_spectra(winds, frequency_hz):
    span = winds.shape[2] * STEP_S
    density = (np.abs(np.fft.rfft(winds, axis=2)) ** 2).mean(axis=0) * STEP_S**2 / span * 2.0
    f = np.fft.rfftfreq(winds.shape[2], STEP_S)
    band = (f > frequency_hz / 1.25) & (f < frequency_hz * 1.25)
    scale = FOOT_M * np.array([HEIGHT_FT / (0.177 + 0.000823 * HEIGHT_FT) ** 1.2, HEIGHT_FT])
    sigma_w = 0.1 * GUSTY["wind_20ft_m_s"]
    for axis, long in enumerate((scale[0], scale[0], scale[1])):
        sigma = sigma_w / ((0.177 + 0.000823 * HEIGHT_FT) ** 0.4 if axis < 2 else 1.0)
        x2 = (2 * np.pi * f[band] * long / SPEED_M_S) ** 2
        shape = 1 / (1 + x2) if axis == 0 else (0.5 + 1.5 * x2) / (1 + x2) ** 2
        expected = 4.0 * sigma**2 * long / SPEED_M_S * shape
        assert density[axis, band].mean() == pytest.approx(expected.mean(), rel=0.25)


def test_gusts_differ_by_seed_and_axis(winds):
    told = winds[:, :, ::50].reshape(-1, winds[:, :, ::50].shape[2])
    assert np.abs(np.corrcoef(told) - np.eye(len(told))).max() < 0.75


def test_the_same_gusts_blow_whatever_the_lanes_and_the_step():
    flights = [
        sim.Flight(
            {"seed": i, "duration_s": 3},
            {"gusts": {**GUSTY, "seed": i}, "rotor_drag": {}},
            Terrain.flat(),
        )
        for i in range(1, 10)
    ]
    told = [
        np.array([list(r.columns.values()) for r in sim.fly(flights, lanes=n)]).tobytes()
        for n in (0, 1, 2, 4, 8)
    ]
    assert len(set(told)) == 1
    ways = [
        sim.Flight({**flights[0].parameters, "integrator": i}, flights[0].effects, Terrain.flat())
        for i in (0, 1)
    ]
    euler, runge_kutta = sim.fly(ways, ("p_y_m",))
    assert np.abs(euler["p_y_m"]).max() > 0.01
    assert runge_kutta["p_y_m"] == pytest.approx(
        euler["p_y_m"], abs=0.02 * np.abs(euler["p_y_m"]).max()
    )


@pytest.mark.parametrize(
    ("above_m", "beside_m", "force_N"),
    [(1.0, 0.0, 0.0758400), (1.5, 0.1, 0.0250742), (2.0, 0.3, 0.00683408), (-1.0, 0.0, 0.0)],
)
def test_downwash_of_the_27_gram_vehicle(above_m, beside_m, force_N):
    samples = effects.Samples.from_columns(
        {"t_s": np.zeros(1), "p_x_m": np.full(1, beside_m), "p_z_m": np.full(1, 1.0)}
    )
    numbers = {f"rotor_{i}_radius_m": 0.0231348 for i in range(1, 5)}
    told = effects.evaluate("downwash", {"other_z_m": 1.0 + above_m}, samples, numbers)
    assert told.force_N[0] == pytest.approx([0.0, 0.0, -force_N], rel=1e-4)


@pytest.mark.parametrize("coupling", [0.0, 0.4, 1.0])
def test_a_drag_is_of_the_whole_speed_of_each_axis_alone_or_between(coupling):
    v = np.array([3.0, -2.0, 1.5])
    area_m2, ratio, rho = 0.03, 1.6, 1.225
    drag = {"area_m2": area_m2, "vertical_ratio": ratio, "coupling": coupling}
    columns = {f"v_{a}_m_s": np.full(2, x) for a, x in zip("xyz", v, strict=True)}
    samples = effects.Samples.from_columns({"t_s": np.array([0.0, 0.01]), **columns})
    with_it, without = (
        effects.replay({"rho_kg_m3": rho}, samples, on).force_N[0]
        for on in ({"parasitic_drag": drag}, {})
    )
    met = np.sqrt(v**2 + coupling * (v @ v - v**2))
    expected = -0.5 * rho * area_m2 * np.array([1.0, 1.0, ratio]) * met * v
    assert with_it - without == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("lever", [0.0, 0.3, 1.0])
def test_a_rotor_drag_turns_by_the_share_of_the_arms_at_which_it_acts(lever):
    """Rotors of different speeds above the centre of mass, in level flight. At a lever of none it
    is the drag that others lump at the centre.
    """
    v, k_kg = np.array([3.0, -2.0, 0.0]), 2e-5
    places = np.array([[0.1, -0.12, 0.03], [-0.1, 0.12, 0.03], [0.1, 0.12, 0.03]])
    places = np.vstack([places, [-0.1, -0.12, 0.03]])
    speeds = np.array([400.0, 500.0, 600.0, 450.0])
    numbers = {
        f"rotor_{i}_{axis}_m": float(x)
        for i, place in enumerate(places, 1)
        for axis, x in zip("xyz", place, strict=True)
    }
    columns = {f"v_{a}_m_s": np.full(2, x) for a, x in zip("xyz", v, strict=True)}
    columns |= {f"rotor_speed_{i}_rad_s": np.full(2, x) for i, x in enumerate(speeds, 1)}
    samples = effects.Samples.from_columns({"t_s": np.array([0.0, 0.01]), **columns})
    with_it, without = (
        effects.replay(numbers, samples, on)
        for on in ({"rotor_drag": {"k_kg": k_kg, "lever": lever}}, {})
    )
    forces = -k_kg * speeds[:, None] * v
    np.testing.assert_allclose(
        with_it.force_N[0] - without.force_N[0], forces.sum(axis=0), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(
        with_it.moment_Nm[0] - without.moment_Nm[0],
        lever * np.cross(places, forces).sum(axis=0),
        rtol=1e-9,
        atol=1e-12,
    )
