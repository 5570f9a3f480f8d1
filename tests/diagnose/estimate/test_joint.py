"""The joint fit against dense least squares, intervals by blocks, and numbers within bounds."""

import dataclasses
import math

import numpy as np
import pytest

from ges.diagnose.estimate.joint import (
    JointFit,
    correction_bounds,
    joint_fit,
    null_fit,
    only_in_air,
    raw_residuals,
    with_corrections,
    with_shared_speed,
    within_bounds,
)
from ges.diagnose.select.evidence import make_regression, whiten_system
from ges.diagnose.types.model import SPEED

from ..synthetic import MODEL, amplitude, nuisance, rows_of, system_of

ROWS, FLIGHTS = 240, 3
COMMON = nuisance("inertia.xx", 0.2, mean=0.05)
VARIES = nuisance("weak_rotor.loss_1", 0.3, flight_sd=0.1)
DRAG = amplitude("rotor_drag.k_kg", high=1e9)


def _system(
    columns=(DRAG, COMMON, VARIES), sizes=(0.7, -0.1, 0.2), own=0.0, model=MODEL, noise=None
):
    """Flights of noise of unit sd about columns times their sizes; the last one's also differs
    from flight to flight.
    """
    rng = np.random.default_rng(0)
    made = []
    for f in range(FLIGHTS):
        x = rng.standard_normal((len(columns), ROWS))
        y = noise[f] if noise is not None else rng.standard_normal(ROWS)
        y = y + sum(size * row for size, row in zip(sizes, x, strict=True))
        y = y + own * (f - 1) * x[-1]
        made.append(rows_of(y[:, None], [{0: row} for row in x]))
    return system_of(("force_z",), columns, made, model)


def _dense(regression, chosen, common, varies, prior_mean, prior_sd):
    """Design, residuals and priors of the whole fit, written out row by row."""
    columns = regression.system.columns
    size = len(chosen) + len(common) + FLIGHTS * len(varies)
    x, y = [], []
    for f, white in enumerate(regression.whites):
        (part,) = white.groups
        row = np.zeros((len(part.at), size))
        row[:, : len(chosen)] = part.of(chosen)[0].T
        row[:, len(chosen) : len(chosen) + len(common)] = part.of(common)[0].T
        start = len(chosen) + len(common) + f * len(varies)
        row[:, start : start + len(varies)] = part.of(varies)[0].T
        x.append(row)
        y.append(part.y[0])
    mean = [
        *prior_mean,
        *(columns[k].nuisance.mean for k in common),
        *[0.0] * FLIGHTS * len(varies),
    ]
    sd = [
        *prior_sd,
        *(columns[k].nuisance.sd for k in common),
        *[columns[k].nuisance.flight_sd for k in varies] * FLIGHTS,
    ]
    return np.concatenate(x), np.concatenate(y), np.array(mean), np.array(sd)


def test_the_joint_fit_is_least_squares_with_priors_over_all_rows():
    regression = make_regression(_system(own=0.15))
    joint = joint_fit(regression, [0], np.array([0.1]), np.array([0.5]))
    x, y, mean, sd = _dense(regression, [0], [1, 2], [2], [0.1], [0.5])
    inverse = np.linalg.inv(x.T @ x + np.diag(sd**-2))
    beta = inverse @ (x.T @ y + mean / sd**2)
    cost = ((y - x @ beta) ** 2).sum() + (((beta - mean) / sd) ** 2).sum()
    assert joint.chosen[0] == pytest.approx(beta[0])
    assert joint.row_covariance[0, 0] == pytest.approx(inverse[0, 0])
    assert joint.common == pytest.approx(
        {"inertia.xx": beta[1], "weak_rotor.loss_1": beta[2]}, rel=1e-6
    )
    assert joint.common_sd == pytest.approx(
        {"inertia.xx": inverse[1, 1] ** 0.5, "weak_rotor.loss_1": inverse[2, 2] ** 0.5}
    )
    assert [f["weak_rotor.loss_1"] for f in joint.by_flight] == pytest.approx(list(beta[3:]))
    assert joint.cost == pytest.approx(cost)


def test_planted_sizes_come_back_within_their_intervals():
    joint = joint_fit(make_regression(_system(own=0.4)), [0])
    assert abs(joint.chosen[0] - 0.7) < 3.0 * joint.covariance[0, 0] ** 0.5
    assert abs(joint.common["inertia.xx"] + 0.1) < 3.0 * joint.common_sd["inertia.xx"]
    own = [f["weak_rotor.loss_1"] for f in joint.by_flight]
    assert own[0] < -0.1 and own[2] > 0.1 and abs(own[1]) < 0.15


def test_coefficients_may_differ_by_many_orders_in_their_units():
    plain = _system((DRAG, COMMON), (0.7, -0.1))
    unit = 1e-9
    rows = [
        dataclasses.replace(
            r, x=dataclasses.replace(r.x, values=((unit * r.x.values[0][0], r.x.values[0][1]),))
        )
        for r in plain.flights
    ]
    tiny = dataclasses.replace(plain, flights=tuple(rows))
    sds = np.array([1.0]), np.array([1.0 / unit])
    one, other = (
        joint_fit(make_regression(s), [0], np.zeros(1), sd)
        for s, sd in zip((plain, tiny), sds, strict=True)
    )
    assert other.chosen[0] * unit == pytest.approx(one.chosen[0], rel=1e-6)
    assert other.common == pytest.approx(one.common, rel=1e-6)


def test_a_number_that_a_candidate_frees_is_no_nuisance_beside_it():
    columns = (amplitude("inertia.xx"), COMMON)
    joint = joint_fit(make_regression(_system(columns, (0.5, 0.0))), [0])
    assert joint.common == {} and joint.chosen[0] == pytest.approx(0.5, abs=0.1)


def _alike(columns, sizes):
    """Flights without noise, and two columns with a correlation of .8."""
    rng = np.random.default_rng(1)
    first = rng.standard_normal((FLIGHTS, ROWS))
    second = 0.8 * first + 0.6 * rng.standard_normal((FLIGHTS, ROWS))
    rows = [
        rows_of((sizes[0] * a + sizes[1] * b)[:, None], [{0: a}, {0: b}])
        for a, b in zip(first, second, strict=True)
    ]
    return make_regression(system_of(("force_z",), columns, rows, MODEL))


def test_a_bounded_number_stays_at_its_bound_where_the_candidates_stand_still():
    regression = _alike((DRAG, nuisance("inertia.xx", 5.0)), (0.7, -1.5))
    joint = joint_fit(regression, [0])
    assert joint.common["inertia.xx"] == pytest.approx(-0.7)
    still = joint_fit(regression, [0], np.zeros(1), np.full(1, 1e-6))
    assert still.common["inertia.xx"] == pytest.approx(-0.7)
    assert joint.cost_without(1) == pytest.approx(still.cost, rel=1e-6)
    # as if the number were free, it would be another
    moved = joint.chosen[0] ** 2 / joint.row_covariance[0, 0]
    assert joint.cost + moved != pytest.approx(joint.cost_without(1), rel=1e-3)


def test_a_candidate_at_its_bound_leaves_the_rest_to_the_others():
    regression = _alike((DRAG, amplitude("translational_lift.c", high=1e9)), (0.7, 0.3))
    joint = joint_fit(regression, [0, 1])
    steps = joint.steps_within(np.array([[-math.inf, 0.2], [-math.inf, math.inf]]))
    a, b = (np.concatenate([w.groups[0].of([k])[0][0] for w in regression.whites]) for k in (0, 1))
    y = np.concatenate([w.groups[0].y[0] for w in regression.whites])
    assert steps[0] == pytest.approx(0.2)
    assert steps[1] == pytest.approx(b @ (y - 0.2 * a) / (b @ b), rel=1e-3)


def test_corrections_are_counted_from_the_vehicle_file():
    moved = dataclasses.replace(MODEL, corrections={"inertia.xx": 0.4})
    here, there = (
        joint_fit(make_regression(_system((DRAG, COMMON), (0.0, 0.1), model=m)), [0])
        for m in (MODEL, moved)
    )
    assert there.common["inertia.xx"] == pytest.approx(here.common["inertia.xx"] + 0.4)


def test_intervals_are_wider_where_blocks_of_time_scatter_more_than_rows():
    """What is constant over a block and no noise of rows: as many pieces of news as blocks."""
    rng = np.random.default_rng(1)
    blocks = [np.repeat(rng.standard_normal(ROWS // 40), 40) for _ in range(FLIGHTS)]
    plain, blocky = _system((DRAG,), (0.7,)), _system((DRAG,), (0.7,), noise=blocks)
    ones = [
        dataclasses.replace(r, x=dataclasses.replace(r.x, values=((np.ones(ROWS),),)))
        for r in blocky.flights
    ]
    steady = dataclasses.replace(blocky, flights=tuple(ones))
    factors = []
    for system in (plain, steady):
        regression = make_regression(system)
        # noise as if every row were news of its own
        white = dataclasses.replace(
            regression.noise, ar=np.zeros((1, 3)), sd=np.ones(1), growth=np.zeros(1)
        )
        joint = joint_fit(whiten_system(system, white), [0])
        factors.append(math.sqrt(joint.covariance[0, 0] / joint.row_covariance[0, 0]))
        assert (joint.covariance >= joint.row_covariance).all()
    # a third wider than by rows, as of so few blocks Student's t is
    assert factors[0] < 1.6 and factors[1] > 2.5


def test_what_hangs_on_one_block_of_time_is_not_known():
    """The same column, spread over all blocks or gathered in one of them, fits as exactly."""
    everywhere = _system((DRAG,), (0.7,))
    first = np.arange(ROWS) < ROWS // 10
    gathered = [
        dataclasses.replace(r, x=dataclasses.replace(r.x, values=((r.x.values[0][0] * own,),)))
        for r, own in zip(everywhere.flights, (3.0 * first, 0.0 * first, 0.0 * first), strict=True)
    ]
    y = [
        r.y - 0.7 * r.x.of(0, [0]) + 0.7 * g.x.of(0, [0])
        for r, g in zip(everywhere.flights, gathered, strict=True)
    ]
    gathered = [dataclasses.replace(g, y=v) for g, v in zip(gathered, y, strict=True)]
    certain = []
    for system in (everywhere, dataclasses.replace(everywhere, flights=tuple(gathered))):
        joint = joint_fit(make_regression(system), [0])
        assert joint.chosen[0] == pytest.approx(0.7, abs=0.1)
        certain.append(joint.chosen[0] / joint.covariance[0, 0] ** 0.5)
    assert certain[0] > 10.0 and certain[1] < 1.5


def test_without_candidates_the_nuisances_do_their_best():
    system = _system((COMMON,), (0.3,))
    regression, joint = null_fit(system)
    assert joint.chosen.shape == (0,) and joint.covariance.shape == (0, 0)
    left = raw_residuals(system, joint)
    before = sum((r.y**2).sum() for r in system.flights)
    assert sum((e**2).sum() for e in left) < before
    for e, r in zip(left, system.flights, strict=True):
        expected = r.y[:, 0] - joint.common["inertia.xx"] * r.x.of(0, [0])[:, 0]
        np.testing.assert_allclose(e[:, 0], expected)
    assert regression.by_flight


def test_what_was_moved_before_is_in_the_residual_already():
    moved = dataclasses.replace(MODEL, corrections={"inertia.xx": 0.4})
    system = _system((COMMON,), (0.1,), model=moved)
    (first, *_) = raw_residuals(
        system, JointFit(*[np.zeros(0)] * 3, 0.0, {"inertia.xx": 0.5}, {}, ({},) * 3)
    )
    rows = system.flights[0]
    np.testing.assert_allclose(first[:, 0], rows.y[:, 0] - 0.1 * rows.x.of(0, [0])[:, 0])


def test_what_a_name_moves_is_in_the_residual_whole():
    """A sagging battery beside a wrong thrust scale seemed to leave two newtons."""
    moved = dataclasses.replace(MODEL, corrections={"inertia.xx": 0.4})
    system = _system((COMMON,), (0.1,), model=moved)
    without = JointFit(*[np.zeros(0)] * 3, 0.0, {}, {}, ({},) * 3)
    (first, *_) = raw_residuals(system, without)
    np.testing.assert_array_equal(first, system.flights[0].y[:, : len(system.main)])


def test_on_the_ground_nothing_is_left_in_the_air():
    air = np.array([True, False, True])
    system = system_of(("force_z",), (), [rows_of(np.ones((3, 1)), air=air)])
    (left,) = only_in_air([np.ones((3, 1))], system)
    assert np.isnan(left.ravel()).tolist() == [False, True, False]


def test_a_vehicle_takes_its_corrections_through_the_effects_that_make_them():
    told = with_corrections(MODEL, {SPEED: 25.0, "inertia.xx": 0.2, "thrust_scale.scale": -0.1})
    assert told.number("max_rotor_speed_rad_s") == 1025.0
    assert told.effects["inertia"] == {"xx": 0.2, "yy": 0.0, "zz": 0.0}
    assert told.effects["thrust_scale"] == {"scale": -0.1}
    again = with_corrections(told, {"inertia.xx": 0.1, "inertia.zz": 0.3})
    assert again.effects["inertia"] == pytest.approx({"xx": 0.3, "yy": 0.0, "zz": 0.3})
    assert MODEL.effects == {}, "a model is never changed"


def test_no_vehicle_is_beyond_the_bounds_of_the_library():
    assert (
        within_bounds("inertia", "xx", -3.0) == -0.7 and within_bounds("inertia", "xx", 0.1) == 0.1
    )
    assert (
        with_corrections(MODEL, {"esc_delay.delay_s": -0.01}).effects["esc_delay"]["delay_s"] == 0.0
    )
    on = MODEL.with_effects({"inertia": {"xx": 0.5}})
    assert correction_bounds("inertia.xx", on) == pytest.approx((-1.2, 2.5))
    assert correction_bounds("inertia.xx", MODEL) == pytest.approx((-0.7, 3.0))
    assert correction_bounds(SPEED, MODEL) == (-1000.0, math.inf)
    # no motor is faster than at once
    assert correction_bounds("motor_lag.up_s", MODEL) == pytest.approx((-0.02, 0.5))


def test_what_drives_have_in_the_mean_goes_to_the_speed_that_flights_share():
    """A sag counts by what it makes of the speed; a flight without a drive has no part in it."""
    load = "battery_sag.load_V"
    columns = [nuisance(SPEED, 30.0, 20.0), nuisance(load, 0.0, 0.5)]
    acting = {0: np.full(4, 0.8)}, {0: np.array([-20.0, -40.0, -30.0, -30.0])}
    flights = [rows_of(np.ones((4, 1)), of) for of in (acting, acting, ({}, {}))]
    system = system_of(("drive_1",), columns, flights)
    own = {SPEED: 6.0, load: 0.2}, {SPEED: 2.0, load: 0.4}, {SPEED: 0.0, load: 0.0}
    joint = JointFit(*[np.zeros(0)] * 3, 0.0, {SPEED: 10.0}, {SPEED: 1.0}, own)
    shared = with_shared_speed(joint, system)
    # means of 6 - .2 30 / .8 and 2 - .4 30 / .8
    assert shared.common[SPEED] == pytest.approx(10.0 - 7.25)
    assert [values[SPEED] for values in shared.by_flight] == pytest.approx([13.25, 9.25, 7.25])
    for before, after in zip(
        raw_residuals(system, joint), raw_residuals(system, shared), strict=True
    ):
        assert after == pytest.approx(before)
