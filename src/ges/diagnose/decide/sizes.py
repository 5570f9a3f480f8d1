"""Size of an effect in the flights, relative to the practical significance threshold."""

from __future__ import annotations

import numpy as np

from ges.diagnose.design.system import System
from ges.diagnose.prepare.channels import least_rms_in


def least_sizes(system: System) -> np.ndarray:
    """Return the practical significance threshold of each main channel.

    Parameters
    ----------
    system : of the flights.

    Returns
    -------
    (C,), rms over all windows, in the channels' units.
    """
    return np.array([least_rms_in(name, system.model) for name in system.main])
