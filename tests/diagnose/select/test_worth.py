"""What a row is worth: whole where rows are independent, a share where they repeat each other."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ges.diagnose.design.whiten import estimate
from ges.diagnose.select.evidence import make_board, whitened
from ges.diagnose.select.worth import worth_of_rows
from ges.diagnose.settings import settings, using

from ..synthetic import MODEL, WINDOW_S, amplitude, nuisance, rows_of, system_of

ROWS, FLIGHTS = 600, 4
COLUMNS = [
    amplitude("rotor_drag.k_kg", high=1e9),
    amplitude("axial_inflow.k_kg", high=1e9),
    amplitude("translational_lift.c", high=1e9),
    nuisance("thrust_scale.scale", 0.1),
]
EFFECTS = len(COLUMNS) - 1


def _slow(rng, count=ROWS, correlation=0.95):
    """Columns change as slowly as a vehicle does."""
    return lfilter([1.0], [1.0, -correlation], rng.standard_normal(count))


def _worth(made, names=("force_z",), chosen=(), unit=1.0, **numbers):
    """Of flights that ``made`` gives residuals (m, C) and a column of each effect for."""
    flights = []
    for seed in range(FLIGHTS):
        rng = np.random.default_rng(seed)
        x = [_slow(rng) for _ in COLUMNS]
        y = made(rng, x)
        acting = [dict.fromkeys(range(y.shape[1]), unit * column) for column in x]
        flights.append(rows_of(unit * y, acting))
    with using({"decide.least_force_share": 1e-9, **numbers}):
        return make_board(system_of(names, COLUMNS, flights), chosen).noise.worth


def _noise(rng, x):
    return rng.standard_normal((ROWS, 1))


def test_independent_rows_are_worth_nearly_all_of_one():
    (worth,) = _worth(_noise)
    assert 0.6 < worth <= 1.0


def test_what_two_sensors_of_one_force_say_counts_once():
    def twice(rng, x):
        return np.repeat(rng.standard_normal((ROWS, 1)), 2, axis=1)

    force, acc = _worth(twice, ("force_z", "acc_z"))
    assert force == acc and 0.3 < force < 0.55


def test_memory_that_the_filter_does_not_know_takes_worth_away():
    def remembering(rng, x):
        return lfilter([1.0], [1.0, -0.9], rng.standard_normal((ROWS, 1)), axis=0)

    (unfiltered,) = _worth(remembering, **{"noise.whitening": False})
    (filtered,) = _worth(remembering)
    # the variance of a sum of AR(1) noise is (1 + a) / (1 - a) = 19 times that of its terms
    assert unfiltered < 0.15 and filtered > 0.6


def test_a_chosen_effect_is_no_noise():
    def pushed(rng, x):
        return rng.standard_normal((ROWS, 1)) + 0.8 * np.abs(x[0])[:, None]

    def dragged(rng, x):
        return rng.standard_normal((ROWS, 1)) + 0.8 * x[0][:, None]

    plain = {"noise.whitening": False}
    assert _worth(dragged, **plain)[0] < 0.25 < 0.5 < _worth(dragged, chosen=[0], **plain)[0]
    # what has another form than the chosen one stays noise
    assert _worth(pushed, chosen=[0], **plain)[0] < 0.25


def test_where_nothing_acts_in_two_blocks_rows_count_in_full():
    flights = [rows_of(np.random.default_rng(0).standard_normal((20, 1)), [{}] * len(COLUMNS))]
    system = system_of(("force_z",), COLUMNS, flights)
    board = whitened(system, estimate(system))
    with using({"decide.least_force_share": 1e-9}):
        worth = worth_of_rows(system, board.noise, board.whites, board.prior.sd, ())
    assert worth == pytest.approx(1.0, abs=1e-6)


def test_evidence_rests_on_rows_as_they_are_worth_and_a_fit_on_rows_in_full():
    system = system_of(
        ("force_z",),
        COLUMNS,
        [
            rows_of(
                _noise(np.random.default_rng(s), []), [{0: _slow(np.random.default_rng(s + 9))}] * 4
            )
            for s in range(2)
        ],
    )
    board, plain = make_board(system), whitened(system, estimate(system))
    worth = board.noise.worth[0]
    assert worth < 1.0
    for white, before, gram in zip(board.whites, plain.whites, board.by_flight, strict=True):
        np.testing.assert_array_equal(white.parts[0].y, before.parts[0].y)
        assert gram.yy == pytest.approx(worth * before.parts[0].y @ before.parts[0].y)


def test_what_a_model_is_wrong_by_is_the_same_in_all_rows_of_a_block():
    """Noise of unit sd and a discrepancy of 0.2 N: 50 windows of 5 s, half overlapping, tell of its
    mean as much as noise of 1 + 50 0.2^2 times the variance would.
    """
    exact = _worth(_noise)[0]
    share = 0.2 / MODEL.weight_N
    wrong = _worth(_noise, **{"decide.least_force_share": share})[0]
    blocks = 2.0 * settings.statistics.block_s / WINDOW_S
    assert 1.0 / wrong - 1.0 / exact == pytest.approx(blocks * 0.2**2, rel=0.1)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_worth_knows_no_unit(unit):
    np.testing.assert_allclose(_worth(_noise), _worth(_noise, unit=unit), rtol=1e-3)
