"""Score of what was modelled: the share of the unseen error that the truth would remove.

With e the rms of a channel's residual on held-out flights::

    share = (e_recalibrated - e_after) / (e_recalibrated - e_true)

``e_true`` is that of the same diagnosis given the truth: its names in the library's forms, or its
law. The main channel is the one in which the truth removes the largest share of the error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ges.blind.score.heldout import diagnose_true_names
from ges.blind.score.judge import category_of
from ges.blind.score.laws import true_laws
from ges.blind.score.statistics import bootstrap, proportion
from ges.errors import GesError
from ges.recordings.recording import load_set

PROCESSES = 2
MOST = 0.8
"""Share of the error from which a set counts as modelled."""
WORSE = 0.01
"""Rise of the error over the recalibrated one from which a channel counts as worse."""


@dataclass(frozen=True)
class Modelled:
    """What a diagnosis removes of the error that the truth would remove.

    Attributes
    ----------
    case, category : of the set.
    channel : the main one; '' for a null.
    recalibrated, after, true : rms in the channel's unit.
    share : NaN for a null.
    worse : whether any channel is worse than recalibrated, beyond its interval.
    """

    case: str
    category: str
    channel: str
    recalibrated: float
    after: float
    true: float
    share: float
    worse: bool


def modelled(
    case: str,
    category: str,
    diagnosis: Mapping[str, Any],
    of_truth: Mapping[str, float],
) -> Modelled | None:
    """Compare a blind diagnosis with what the truth leaves.

    Parameters
    ----------
    case, category : of the set.
    diagnosis : content of ``diagnosis.json``.
    of_truth : of :func:`errors_of_truth`.

    Returns
    -------
    None where the truth removes nothing that the held-out flights could show.
    """
    channels = diagnosis.get("fit", {}).get("channels", {})
    worse = any(interval[1] < -WORSE for c in channels.values() if (interval := _interval(c)))
    if category == "null":
        return Modelled(case, category, "", np.nan, np.nan, np.nan, np.nan, worse)
    # a share: channels have no common unit
    removed = {
        name: 1.0 - error / channels[name]["recalibrated"]
        for name, error in of_truth.items()
        if channels.get(name, {}).get("recalibrated")
    }
    main = max(removed, key=lambda name: removed[name], default="")
    if not main or removed[main] <= WORSE:
        return None
    before, after = (channels[main][stage] for stage in ("recalibrated", "after"))
    share = (1.0 - after / before) / removed[main]
    return Modelled(case, category, main, before, after, of_truth[main], share, worse)


def _interval(channel: Mapping[str, Any]) -> Sequence[float]:
    return channel.get("reduction_ci95") or ()


def errors_of_truth(folder: Path, case: str, truth: Mapping[str, Any]) -> dict[str, float]:
    """Return the error that remains once the truth is known, by channel.

    Parameters
    ----------
    folder : of the sets.
    case, truth : name of the set and its truth.

    Returns
    -------
    Channels in which the truth lowers the error beyond its interval, of a law its own channel.
    Nothing for a null, and for a cause that neither names nor laws can write.
    """
    from ges.diagnose.pipeline import diagnose

    place = folder / "cases" / case
    if not truth.get("laws"):
        known = diagnose_true_names(place, [f["name"] for f in truth["findings"]])
        channels = known.get("fit", {}).get("channels", {})
        return {n: c["after"] for n, c in channels.items() if (_interval(c) or (0.0,))[0] > 0.0}
    recordings = load_set(place)
    vehicle = recordings.vehicle.model_copy(
        update={"laws": true_laws(truth["laws"], recordings.vehicle)}
    )
    try:
        channels = diagnose(recordings, vehicle, names=()).content()["fit"]["channels"]
    except GesError:
        return {}
    acts = tuple(law["channel"] for law in truth["laws"])
    return {n: c["recalibrated"] for n, c in channels.items() if n.startswith(acts)}


def modelled_of_sets(
    folder: Path, truths: Mapping[str, Mapping], diagnoses: Mapping[str, Mapping]
) -> list[Modelled]:
    """Return what was modelled of all sets in which held-out flights could show it.

    Parameters
    ----------
    folder : of the sets.
    truths, diagnoses : by set.
    """
    with ProcessPoolExecutor(PROCESSES) as pool:
        jobs = {n: pool.submit(errors_of_truth, folder, n, truths[n]) for n in truths}
        each = [
            modelled(n, category_of(truths[n]), diagnoses[n], job.result())
            for n, job in jobs.items()
        ]
    return [one for one in each if one]


def modelled_scores(
    outcomes: Sequence[Modelled],
) -> dict[str, tuple[float, float, float, int]]:
    """Return score, 95 % interval (low, high) and number of sets, by name."""
    shares = np.array([m.share for m in outcomes if m.channel])
    unharmed = [not m.worse for m in outcomes if not m.channel]
    median = (*bootstrap(shares, lambda s: float(np.median(s))), len(shares))
    return {
        "share of the error that the truth removes, median": median,
        "sets that are modelled": (*proportion((shares >= MOST).tolist()), len(shares)),
        "nulls that get no worse": (*proportion(unharmed), len(unharmed)),
    }
