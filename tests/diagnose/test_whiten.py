"""Noise: every row counts by what the rows before it do not predict, the first ones of a
run too.
"""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from ges.diagnose.design.noise import rows_followed, rows_in_run
from ges.diagnose.design.system import build
from ges.diagnose.design.weak import make_windows
from ges.diagnose.design.whiten import _innovations, _prediction_filter
from ges.diagnose.prepare.gate import pass_gate
from ges.diagnose.types.model import from_vehicle
from ges.simulator import manoeuvres

AR = np.array([0.6, -0.2, 0.15])


def _covariance(count: int) -> np.ndarray:
    """Of so many rows of the process that AR and innovations of unit sd make, from its impulse
    response.
    """
    response = lfilter([1.0], np.r_[1.0, -AR], np.r_[1.0, np.zeros(999)])
    return toeplitz([response[: 1000 - k] @ response[k:] for k in range(count)])


def test_innovations_of_a_whole_run_are_white():
    count, past = 8, np.arange(8)
    of = _innovations(past, past, _prediction_filter(AR)[None], np.ones((1, count)))
    filtering = of(np.eye(count)[None])[0].T
    np.testing.assert_allclose(
        filtering @ _covariance(count) @ filtering.T, np.eye(count), atol=1e-9
    )


def test_a_filter_whose_noise_would_grow_says_nothing_of_first_rows():
    assert _prediction_filter(np.array([1.1, 0.0, 0.0])).shape == (1, 4)


def test_the_past_ends_where_a_row_is_missing_or_follows_none():
    y = np.array([np.nan, 1.0, 1.0, 1.0, np.nan, 1.0, 1.0, 1.0])
    follows = np.array([False, True, True, True, True, True, True, False])
    assert rows_followed(y[:, None], rows_in_run(follows))[:, 0].tolist() == [
        -1,
        0,
        1,
        2,
        -1,
        0,
        1,
        0,
    ]


@pytest.fixture(scope="module")
def taking_off(flown, held_down, sheet, with_rates):
    """The system of a flight that pushes harder than ever in the air for two seconds without
    leaving the ground.
    """
    whole = flown(
        sheet(),
        {},
        manoeuvres.make("multisine", 30.0),
        1,
        (*with_rates, "u_1", "u_2", "u_3", "u_4"),
    )
    t = whole["t_s"].to_numpy()
    frame = held_down(whole, np.where(t < 2.0, 0.0, np.where(t < 4.0, 1.5, 1.0)))
    model = from_vehicle(sheet(motor_time_constant_s=0.02))
    return build([pass_gate([frame, frame], model).flights[0]], model, [])


def test_windows_on_the_ground_tell_of_the_drive_alone(taking_off):
    (rows,) = taking_off.flights
    told, drive = (
        np.isfinite(rows.y),
        np.array([name.startswith("drive") for name in taking_off.names]),
    )
    assert drive.any() and not drive.all() and (~rows.air).sum() > 10
    assert (
        told[:, drive].all() and told[rows.air].all() and not told[np.ix_(~rows.air, ~drive)].any()
    )
    alone = make_windows(rows.flight.t_s, rows.flight.flying, rows.windows.length_s)
    np.testing.assert_array_equal(rows.windows.select(rows.air).center, alone.center)


def test_what_a_drive_does_with_more_than_flights_ask_is_in_doubt_on_the_ground_alone(taking_off):
    (rows,) = taking_off.flights
    doubted = {taking_off.names[c]: part for c, part in rows.drive_error.items()}
    assert {"drive_1", "drive_2", "drive_3", "drive_4"} <= set(doubted)
    assert not any(part[rows.air].any() for part in doubted.values())
