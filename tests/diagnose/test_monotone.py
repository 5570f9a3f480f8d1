"""More data or less noise never makes an answer worse: ten sets at four noise levels, two lengths.

Noise is the same draws, larger or smaller; a shorter flight is the beginning of a longer one.
"""

import numpy as np
import pytest

import ges
from ges.simulator import manoeuvres

from .conftest import NOISE, fly
from .test_planted import CUSHION, DRAG, LOGGED, LOW

PLANS = {
    "ordinary": ("height_staircase", "straight_runs", "climbs", "multisine"),
    "hover": ("height_staircase",) * 4,
}
SETS = {
    "nothing": ("ordinary", {}),
    "nothing, in hover": ("hover", {}),
    "rotor_drag": ("ordinary", {"rotor_drag": {"k_kg": 3e-5}}),
    "parasitic_drag": ("ordinary", {"parasitic_drag": {"area_m2": 0.02}}),
    "wind": ("ordinary", {**DRAG, "wind": {"east_m_s": 1.5, "north_m_s": 0.5}}),
    "ground_effect": ("low", CUSHION),
    "weak_rotor": ("ordinary", {"weak_rotor": {"loss_3": 0.1}}),
    "weak_rotor, in hover": ("hover", {"weak_rotor": {"loss_3": 0.1}}),
    "inertia": ("ordinary", {"inertia": {"xx": 0.5, "yy": 0.5, "zz": 0.5}}),
    "slung_load": ("ordinary", {"slung_load": {"mass_kg": 0.06, "length_m": 0.5}}),
}
NOISE_FACTORS = (0.1, 0.3, 1.0, 3.0)
LENGTHS_S = (10.0, 30.0)
ACCELEROMETER_M_S2, ROTOR_SPEED_RAD_S = 0.1, 2.0
"""Noise of what :data:`NOISE` has none for, at a factor of one."""


def _flights(vehicle, plan, effects, noise, length_s, monkeypatch):
    for name, sd in {**NOISE, "acc": ACCELEROMETER_M_S2, "rot": ROTOR_SPEED_RAD_S}.items():
        monkeypatch.setitem(NOISE, name, noise * sd)
    frames = []
    for seed, name in enumerate(PLANS.get(plan, PLANS["ordinary"]), 1):
        low = next((entry[1][1:] for entry in LOW if entry[0] == name), ()) if plan == "low" else ()
        table = manoeuvres.MENU[name](max(LENGTHS_S), *low)
        if plan == "hover":
            table = manoeuvres.MENU[name](max(LENGTHS_S), 1.4 + 0.05 * seed, 1.41 + 0.05 * seed)
        asked = manoeuvres.to_frame(table)
        frame = fly(vehicle, effects, table, seed, LOGGED)
        references = {
            c: np.interp(frame["t_s"], asked["t_s"], asked[c]) for c in manoeuvres.COLUMNS[10:]
        }
        # a shorter flight is the beginning of a longer one: whatever it shows, both show
        frames.append(frame.assign(**references)[frame["t_s"] <= length_s])
    return frames


def _rank(found, true):
    """-1 for a false name, 0 for nothing, 1 for a part of the truth or an open one, 2 for all."""
    named = {f.name for f in found.findings if not f.is_open}
    open_names = {f.name for f in found.findings if f.is_open}
    if named - true or open_names and not true:
        return -1
    return 2 if named == true else int(bool(named or open_names & true))


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_more_data_or_less_noise_never_makes_an_answer_worse(name, sheet, monkeypatch):
    plan, effects = SETS[name]
    vehicle, ranks = sheet(), np.zeros((len(LENGTHS_S), len(NOISE_FACTORS)), dtype=int)
    for i, length_s in enumerate(LENGTHS_S):
        for j, noise in enumerate(NOISE_FACTORS):
            with monkeypatch.context() as patch:
                flights = _flights(vehicle, plan, effects, noise, length_s, patch)
            ranks[i, j] = _rank(ges.diagnose(flights, vehicle, holdout=["flight4"]), set(effects))
    assert (ranks >= 0).all(), ranks
    assert (np.diff(ranks, axis=0) >= 0).all() and (np.diff(ranks, axis=1) <= 0).all(), ranks
