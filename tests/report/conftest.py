"""A diagnosis.json with something in every block, and signals over time."""

import copy

import numpy as np
import pytest
from diagnosis_content import CONTENT

from ges.diagnose.prove.traces import Span, Trace


@pytest.fixture
def content() -> dict:
    """A diagnosis.json of two flights with a finding, free to be changed."""
    return copy.deepcopy(CONTENT)


@pytest.fixture
def traces() -> list[Trace]:
    """Signals of two flights: a take-off and a flight, a sine that the models miss in part."""
    made = []
    for name, held_out, seconds in (("one <b>", False, 30.0), ("two", True, 20.0)):
        t = np.arange(0.1, seconds, 0.1)
        used, force = t > 5.0, np.sin(0.5 * t)
        recorded = np.stack([force, 14.0 + 0.1 * force], axis=1)
        simulated = {
            stage: np.where(used[:, None], recorded * [share, 1.0], np.nan)
            for stage, share in (("before", 0.0), ("recalibrated", 0.5), ("after", 0.9))
        }
        made.append(
            Trace(
                flight=name,
                held_out=held_out,
                t_s=t,
                used=used,
                channels=("force_x_N", "force_z_N"),
                ahead=frozenset(),
                recorded=recorded,
                simulated=simulated,
                left_out=(Span(0.0, 5.0, "on_ground"),),
            )
        )
    return made
