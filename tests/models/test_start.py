"""Flights of the data set lie over ground features."""

import dataclasses
from pathlib import Path

import numpy as np

from ges.study import config
from ges.study.datasets.flights import start_of
from ges.study.datasets.ground import ground_of

ROOT = Path(__file__).resolve().parents[2]
STUDY = config.load(ROOT / "config/default.yaml")
PUBLISHED = STUDY.data.plans["published"]


def feature_under(seed: int) -> float:
    """Greatest height or depth (m) of the features, without the roughness, along a flight."""
    terrain = ground_of(seed, STUDY.simulator.terrain)
    smooth = dataclasses.replace(terrain.shape, terrain_roughness_m=0.0)
    along = start_of(seed, PUBLISHED) + np.linspace(
        0.0, PUBLISHED.cruise_m_s * STUDY.data.duration_s, 200
    )
    ground = dataclasses.replace(terrain, shape=smooth).at(along, np.zeros_like(along))
    return float(np.abs(ground.height_m).max())


def test_most_flights_meet_a_feature():
    met = [feature_under(seed) > 0.005 for seed in STUDY.seeds.data()]
    assert np.mean(met) > 0.6


def test_flights_start_all_along_the_track():
    starts = [start_of(seed, PUBLISHED) for seed in STUDY.seeds.data()]
    share = np.histogram(starts, 3, (PUBLISHED.start_min_m, PUBLISHED.start_max_m))[0]
    assert share.min() > 0.25 * len(starts) and share.sum() == len(starts)
