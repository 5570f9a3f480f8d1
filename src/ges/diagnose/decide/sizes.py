"""Size of an effect in the flights, relative to the practical significance threshold."""

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
    """Return whether an effect cannot be mistaken for the form error of a larger one.

    Parameters
    ----------
    name : of the effect.

    Notes
    -----
    A form error depends on the place alone. What acts through time or speed does not.
    """
    return "unlike_form_error" in effect_table.get(name).hints


def least_size(name: str, channel: str, model: Model) -> float:
    """Return the rms at which an effect matters in a channel.

    Parameters
    ----------
    name : of the effect.
    channel : of the rms.
    model : for the reference scale.

    Returns
    -------
    In the channel's unit.
    """
    share = 1.0 / settings.decide.form_margin if unlike_form_error(name) else 1.0
    return share * least_rms(block_of(channel), model.reference_scale(channel))


def least_sizes(system: System) -> np.ndarray:
    """Return the practical significance threshold of each main channel.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    (C,), rms over all windows, in the channels' units.
    """
    return np.array(
        [least_rms(block_of(name), system.model.reference_scale(name)) for name in system.main]
    )


def relative_sizes(regression: Regression, h: Hypothesis, names: set[str]) -> Mapping[str, float]:
    """Return the size of effects together, over the practical significance threshold.

    Parameters
    ----------
    regression, h : of the search.
    names : of the effects.

    Returns
    -------
    By block, of its greatest channel; an accelerometer counts as force.
    """
    system, contribution = regression.system, contribution_of(h.posterior, names, regression.system)
    with np.errstate(invalid="ignore"):
        share = np.sqrt(
            np.nanmean(
                np.where(np.isfinite(contribution).any(axis=0), contribution, 0.0) ** 2, axis=0
            )
        ) / least_sizes(system)
    blocks = np.array(["force" if block_of(n) == "acc" else block_of(n) for n in system.main])
    return {block: float(np.max(share[blocks == block])) for block in dict.fromkeys(blocks)}
