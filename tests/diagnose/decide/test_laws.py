"""A law that trims would have to take back is none."""

from types import SimpleNamespace

import numpy as np
import pytest

from ges.diagnose.decide import laws


@pytest.mark.parametrize(("times", "overdone"), [(1.0, False), (1.9, False), (2.1, True)])
def test_a_law_leaves_no_more_within_flights_than_there_was(times, overdone, monkeypatch):
    """Whatever it is on average, which a trim may be."""
    rng = np.random.default_rng(0)
    left = [rng.standard_normal((40, 2)) for _ in range(3)]
    left[0][:5] = np.nan
    added = [times * (row - np.nanmean(row, axis=0)) + 50.0 for row in left]
    monkeypatch.setattr(laws, "_law_contribution", lambda channel, fitted, answer: added)
    system = SimpleNamespace(main=("force_x", "acc_z"))
    fitted = SimpleNamespace(regression=SimpleNamespace(system=system))
    answer = SimpleNamespace(last=SimpleNamespace(residuals_in_air=left))
    forms = {"force_z": (None, SimpleNamespace(channel="acc_z"))}
    assert laws._overdone(forms, fitted, answer) == ({"force_z"} if overdone else set())
