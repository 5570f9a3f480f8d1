"""The real flights that the package ships, scored: what was done, and what was reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ges.blind.protocol import seal
from ges.blind.protocol.run import OUT
from ges.blind.score.by_world import outcome_of
from ges.blind.score.verdicts import check_batches, read_verdict
from ges.files import write_csv


def score_changes(sums: Path, verdicts: Sequence[Path], changes: Path, errors: Path) -> None:
    """Open the seal of :mod:`ges.blind.foreign.shipped` and score every diagnosis.

    Parameters
    ----------
    sums : list of hashes ``sealed/SHA256SUMS`` of the folder.
    verdicts : hashes of the diagnoses, by batch.
    changes : table of one row a set: what was done, what was named, whether that is right.
    errors : table of one row a set and channel, in N and N m. It holds the RMS error of windows on
        the held-out flights: as calibrated, recalibrated, and with what was named.

    Raises
    ------
    GesError
        For a broken seal, or a verdict that is not the one that its batch wrote.
    """
    folder = sums.parents[1]
    check_batches(folder, OUT, verdicts)
    seal.check(folder, list(seal.listed(folder)))
    pairs = [(n, seal.truth(folder, n), read_verdict(folder / OUT / n)) for n in seal.cases(folder)]
    # nothing before something, then as the flights are listed
    pairs.sort(key=lambda pair: (bool(pair[1]["findings"]), pair[1]["situation"]["design"]))
    write_csv(changes, pd.DataFrame([_change(*pair) for pair in pairs]), digits=6)
    write_csv(errors, pd.DataFrame([row for _, *pair in pairs for row in _errors(*pair)]), digits=6)


def _change(name: str, truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    findings = diagnosis["findings"]
    return {
        "done": truth["situation"]["design"],
        "truth": " and ".join(dict.fromkeys(f["name"] for f in truth["findings"])),
        "verdict": diagnosis["verdict"],
        "named": " and ".join(f"{f['name']} {f.get('place') or ''}".strip() for f in findings),
        "probability": min((f["probability"] for f in findings), default=None),
        "answer": outcome_of(name, truth, diagnosis).outcome,
        "sentence": diagnosis["sentence"],
    }


def _errors(truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "done": truth["situation"]["design"],
            "channel": channel,
            "as_given": error["before"],
            "recalibrated": error["recalibrated"],
            "named": error["after"] if diagnosis["findings"] else None,
        }
        for channel, error in diagnosis["fit"]["channels"].items()
    ]
