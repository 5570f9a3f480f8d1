"""Instruments: what the references alone explain, and how much of a signal that is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ges.conventions import rotor_speed
from ges.diagnose.design.instruments import (
    directions,
    instrument_strength,
    instruments,
    project,
    replay_references,
    rotor_signals,
)
from ges.diagnose.prepare.align import streams
from ges.diagnose.types.keys import MarkedChannel

from ..synthetic import MODEL, NUMBERS, hovering, times, windows_of

ROTOR_SPEED = rotor_speed(4)

SEEDS = st.integers(min_value=0, max_value=2**31)


def _drawn(seed, rows=40, columns=3):
    return np.random.default_rng(seed).standard_normal((rows, columns))


@given(SEEDS)
def test_a_projection_projected_again_is_itself(seed):
    x, z = _drawn(seed), _drawn(seed + 1, columns=5)
    once = project(x, directions(z))
    np.testing.assert_allclose(project(once, directions(z)), once, atol=1e-10)
    np.testing.assert_allclose(z.T @ (x - once), 0.0, atol=1e-9)


@given(SEEDS, st.floats(1e-6, 1e6))
def test_a_projection_does_not_know_units_order_or_copies_of_instruments(seed, unit):
    x, z = _drawn(seed), _drawn(seed + 1)
    other = np.column_stack([unit * z[:, ::-1], z[:, 0], np.zeros(len(z))])
    np.testing.assert_allclose(project(x, directions(other)), project(x, directions(z)), atol=1e-8)


def test_no_instruments_explain_nothing():
    assert not project(_drawn(0), directions(np.zeros((40, 2)))).any()


BLOCKS = np.arange(400) // 20


def test_a_signal_predicts_itself_and_noise_predicts_nothing():
    signal, noise = _drawn(1, 400, 1)[:, 0], _drawn(2, 400, 3)
    assert instrument_strength(signal, signal[:, None], BLOCKS) > 0.98
    assert instrument_strength(signal, noise, BLOCKS) < 0.02
    assert instrument_strength(np.ones(400), noise, BLOCKS) == 0.0


@pytest.mark.parametrize("share", [0.25, 0.64])
def test_strength_is_the_share_of_the_variance(share):
    known, other = _drawn(3, 4000, 2).T
    signal = 5.0 + np.sqrt(share) * known + np.sqrt(1.0 - share) * other
    block = np.arange(4000) // 20
    assert instrument_strength(signal, known[:, None], block) == pytest.approx(share, abs=0.04)
    assert instrument_strength(1e3 * signal, 1e-3 * known[:, None], block) == pytest.approx(
        share, abs=0.04
    )


def test_what_fits_one_block_by_chance_is_no_strength():
    """As many instruments as rows of a block explain all of the blocks that they were fitted to."""
    signal, many = _drawn(4, 80, 1)[:, 0], _drawn(5, 80, 50)
    assert instrument_strength(signal, many, np.arange(80) // 5) < 0.1


def test_own_signals_are_thrust_and_moments_of_the_speeds():
    flight = hovering()
    speeds = flight.stack("rotor_speed")
    speeds[:, 0] *= 1.1
    windows = windows_of(flight, 1)
    told = rotor_signals(flight, windows, MODEL, speeds, ("force_z", "moment_x", "moment_y/1"))
    thrust = MODEL.weight_N * (3.0 + 1.21) / 4.0
    np.testing.assert_allclose(told["force_z"], thrust)
    more_N = 0.21 * MODEL.weight_N / 4.0
    np.testing.assert_allclose(told["moment_x"], -more_N * MODEL.number("rotor_1_x_m"), rtol=1e-6)
    assert set(told) == {"force_z", "moment_x", "moment_y/1"}
    slow = rotor_signals(flight, windows_of(flight), MODEL, speeds, ("moment_y", "moment_y/1"))
    assert set(slow) == {"moment_y"}, "no faster average of a slow stream"


def _following(z_m):
    """A flight that was asked to be at heights (n,)."""
    t = times(6.0)
    rate = np.gradient(z_m, t)
    asked = dict.fromkeys(streams(4)["reference"], 0.0) | {"p_ref_z_m": z_m, "v_ref_z_m_s": rate}
    return hovering(6.0, **asked)


def test_without_references_there_is_no_replay_and_no_instrument():
    flight = hovering()
    assert replay_references(flight, MODEL) is None
    told = instruments(flight, windows_of(flight), MODEL, ("force_z", "moment_x"))
    assert all(z.shape[1] == 1 and not z.any() for z in told.values())


def test_a_replay_stands_where_it_is_asked_to_and_bears_its_weight():
    said = replay_references(_following(np.full(600, 2.0)), MODEL)
    np.testing.assert_allclose(said["p_z_m"], 2.0, atol=5e-3)
    thrust = NUMBERS["thrust_coefficient_N_s2"] * sum(said[n] ** 2 for n in ROTOR_SPEED)
    np.testing.assert_allclose(thrust[-100:], MODEL.weight_N, rtol=2e-3)
    assert set(replay_references(_following(np.full(600, 2.0)), MODEL, ("u_1",))) == {*said, "u_1"}


def test_instruments_know_what_was_asked_and_nothing_of_the_recording():
    """Thrust as the references want it, each lag for itself, and without its mean."""
    flight = _following(1.5 + 0.3 * np.sin(3.0 * times(6.0)))
    loud = flight.replace(
        columns={**flight.columns, **{n: 2.0 * flight.columns[n] for n in ROTOR_SPEED}}
    )
    windows = windows_of(flight)
    z, same = (instruments(f, windows, MODEL, ("force_z", "range")) for f in (flight, loud))
    np.testing.assert_array_equal(z["force_z"], same["force_z"])
    np.testing.assert_allclose(z["force_z"].mean(axis=0), 0.0, atol=1e-9)
    assert z["force_z"].shape == (len(windows), 7) and not z["range"].any()
    wanted = -MODEL.number("mass_kg") * 0.3 * 9.0 * (windows.mean @ np.sin(3.0 * flight.t_s))
    assert np.corrcoef(z["force_z"][15:, 1], wanted[15:])[0, 1] > 0.95
    one, next_one = z["force_z"][15:-15, 1], z["force_z"][16:-14, 2]
    assert np.corrcoef(one, next_one)[0, 1] > 0.999, "each lag is half a window later"


def test_marks_are_what_stands_behind_the_channel():
    assert MarkedChannel.of("moment_x/2") == ("moment_x", "/2")
    assert MarkedChannel.of("force_z") == ("force_z", "")


def test_commands_far_from_a_window_are_instruments_of_its_drive():
    """What goes on is known from its neighbours, what differs from row to row is not."""
    t, rng = times(30.0), np.random.default_rng(2)
    windows, shares = windows_of(hovering(30.0)), []
    for u in (0.5 + 0.05 * np.sin(2.0 * t), 0.5 + 0.02 * rng.normal(size=len(t))):
        z = instruments(hovering(30.0, u_1=u), windows, MODEL, ("drive_1",))["drive_1"]
        shares.append(instrument_strength(windows.mean @ u, z, windows.center_s.astype(int) // 5))
    assert shares[0] > 0.95 and shares[1] < 0.1


def test_directions_are_found_where_divide_and_conquer_does_not_converge(monkeypatch):
    z = np.random.default_rng(3).normal(size=(50, 4))
    expected = directions(z)

    def fails(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    np.testing.assert_allclose(np.abs(directions(z).T @ expected), np.eye(4), atol=1e-9)
