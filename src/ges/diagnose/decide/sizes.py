"""How large an effect is in the flights, over what no model is right to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ges.diagnose.design.system import System
from ges.diagnose.locate.regimes import least_rms
from ges.diagnose.select.evidence import Regression, contribution_of
from ges.diagnose.select.search import Hypothesis
from ges.diagnose.settings import settings
from ges.diagnose.types.model import Model, block_of
from ges.simulator import effects as effect_table


def unlike_form_error(name: str) -> bool:
    """Whether an effect does not look like what the form of a larger one is wrong by: what a form
    is wrong by depends on the place alone, and what acts through time or speed does not.
    """
    return "unlike_form_error" in effect_table.get(name).hints


def least_size(name: str, channel: str, model: Model) -> float:
    """The least rms of an effect at which it matters in a channel, in the channel's unit."""
    share = 1.0 / settings.decide.form_margin if unlike_form_error(name) else 1.0
    return share * least_rms(block_of(channel), model.reference_scale(channel))


def least_sizes(system: System) -> np.ndarray:
    """What matters at least in each main channel, (C,), rms over all windows, in the channel's
    unit: no model is right to less.
    """
    return np.array(
        [least_rms(block_of(name), system.model.reference_scale(name)) for name in system.main]
    )


def shares_of(regression: Regression, h: Hypothesis, names: set[str]) -> Mapping[str, float]:
    """Rms of what effects add together by the search's coefficients, over the least that matters,
    in each block its greatest channel; an accelerometer shows forces.
    """
    system, added = regression.system, contribution_of(h.posterior, names, regression.system)
    with np.errstate(invalid="ignore"):
        share = np.sqrt(
            np.nanmean(np.where(np.isfinite(added).any(axis=0), added, 0.0) ** 2, axis=0)
        ) / least_sizes(system)
    blocks = np.array(["force" if block_of(n) == "acc" else block_of(n) for n in system.main])
    return {block: float(np.max(share[blocks == block])) for block in dict.fromkeys(blocks)}
