"""Metrics of a flight that was made up so that every number is known."""

import numpy as np
import pytest

from ges.simulator.flight import Record
from ges.study.fly.metrics import COLUMNS, NAMES, flight_metrics


@pytest.fixture
def record():
    n = 1000
    columns = {name: np.zeros(n) for name in COLUMNS}
    columns["t_s"] = 0.01 * np.arange(n)
    columns["agl_m"] = np.where(np.arange(n) < 250, 0.08, 0.25)
    columns["range_m"] = columns["agl_m"] + 0.01
    columns["range_m"][:5] = np.nan
    columns["gyro_x_rad_s"], columns["gyro_y_rad_s"] = np.full(n, 0.03), np.full(n, 0.04)
    columns["ge_factor"], columns["ge_estimate"] = np.full(n, 1.02), np.full(n, 1.01)
    columns["ge_shadow"] = np.where(np.arange(n) % 2, 1.05, 0.98)
    columns["contact"][:50] = 1.0
    return Record(columns, seed=1)


def test_every_metric(record):
    found = flight_metrics(record, agl_ref_m=0.22, low_clearance_m=0.1, restricted_m=0.15)
    assert tuple(found) == NAMES
    square = (245 * 0.13**2 + 750 * 0.04**2) / 995
    assert found["agl_rms_m"] == pytest.approx(np.sqrt(square))
    assert found["agl_rms_restricted_m"] == pytest.approx(0.04)
    assert found["gyro_rms_rad_s"] == pytest.approx(0.05)
    assert found["clearance_mean_m"] == pytest.approx(0.25 * 0.08 + 0.75 * 0.25)
    assert (found["clearance_p5_m"], found["clearance_min_m"]) == pytest.approx((0.08, 0.08))
    assert (found["low_clearance_s"], found["contact_s"]) == pytest.approx((2.5, 0.5))
    assert (found["estimate_mae"], found["network_mae"]) == pytest.approx((0.01, 0.035))


def test_a_network_that_did_not_run_has_no_error(record):
    record.columns["ge_shadow"] = np.full(1000, np.nan)
    assert np.isnan(flight_metrics(record, 0.22, 0.1, 0.15)["network_mae"])


def test_nothing_in_the_restricted_zone_is_no_number(record):
    assert np.isnan(flight_metrics(record, 0.22, 0.1, restricted_m=1.0)["agl_rms_restricted_m"])
