"""How large an effect is in the flights, over what no model is right to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ges.diagnose.design.system import System
from ges.diagnose.select.evidence import Board, acts_of
from ges.diagnose.select.search import Hypothesis
from ges.diagnose.types.model import block_of
from ges.simulator import effects as effect_table

REACH_M = 10.0  # 2 cm of a rangefinder matter
LIGHTER = 0.4
"""Of the least, of what does not look like an error of a form."""
LEAST_SHARE = {"force": 0.002, "acc": 0.002, "moment": 0.0005, "drive": 0.0003, "range": 0.002}
"""Of weight, weight times arm, full speed or a rotor radius: no model is right to less."""


def unlike_form_error(name: str) -> bool:
    """Whether an effect does not look like what the form of a larger one is wrong by: what a form
    is wrong by depends on the place alone, and what acts through time or speed does not.
    """
    return "unlike_form_error" in effect_table.get(name).hints


def least_share(name: str, channel: str) -> float:
    """The least share of a channel's whole at which an effect matters."""
    return LEAST_SHARE[block_of(channel)] * (LIGHTER if unlike_form_error(name) else 1.0)


def least_sizes(system: System) -> np.ndarray:
    """What matters at least in each main channel, rms over all windows, in the channel's unit."""
    return np.array(
        [
            LEAST_SHARE[block_of(n)] * (REACH_M if n == "range" else system.model.whole(n))
            for n in system.main
        ]
    )


def shares_of(board: Board, h: Hypothesis, names: set[str]) -> Mapping[str, float]:
    """Rms of what effects add together by the search's coefficients, over the least that matters,
    in each block its greatest channel; an accelerometer shows forces.
    """
    system, added = board.system, acts_of(h.posterior, names, board.system)
    with np.errstate(invalid="ignore"):
        share = np.sqrt(
            np.nanmean(np.where(np.isfinite(added).any(axis=0), added, 0.0) ** 2, axis=0)
        ) / least_sizes(system)
    blocks = np.array(["force" if block_of(n) == "acc" else block_of(n) for n in system.main])
    return {block: float(np.max(share[blocks == block])) for block in dict.fromkeys(blocks)}
