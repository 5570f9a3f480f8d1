"""Stated probabilities: the correction is found again, undone exactly, and never fitted to
evaluation cases.
"""

import json

import numpy as np
import pytest
from scipy.special import expit

from ges.blind.score.platt import fit, pairs
from ges.diagnose.select.probability import calibrated_probability, log_odds, uncalibrated_log_odds
from ges.diagnose.settings import settings
from ges.errors import GesError


def test_fit_finds_the_correction_that_was_made():
    rng = np.random.default_rng(4)
    most = settings.statistics.certain_log_odds
    odds = rng.uniform(-most, most, 20_000)
    offset, slope = fit(odds, (rng.random(20_000) < expit(-0.4 + 0.5 * odds)).astype(float))
    assert offset == pytest.approx(-0.4, abs=0.05) and slope == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("probability", [0.0, 0.02, 0.5, 0.93, 1.0])
def test_what_is_stated_leads_back_to_the_search(probability):
    assert 0.0 < calibrated_probability(probability) < 1.0
    assert uncalibrated_log_odds(calibrated_probability(probability)) == pytest.approx(
        log_odds(probability)
    )


@pytest.mark.parametrize("made", [{"seed": 1003}, None])
def test_nothing_is_fitted_to_evaluation_cases(tmp_path, made):
    (tmp_path / "sealed").mkdir()
    if made:
        (tmp_path / "sealed" / "made.json").write_text(json.dumps(made))
    with pytest.raises(GesError, match="for evaluation"):
        pairs([tmp_path])
