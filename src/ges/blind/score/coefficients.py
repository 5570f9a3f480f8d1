"""Fitted coefficients against the oracle's: their errors, and whether their intervals hold it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ges.blind.score import opened, oracle
from ges.blind.score.heldout import reductions
from ges.blind.score.oracle import FREE, SHAPES, Oracle, Witness, is_load, rms
from ges.errors import GesError
from ges.simulator import effects as effect_table
from ges.vehicle.load import load_vehicle


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A diagnosis of one case beside the oracle.

    Attributes
    ----------
    best : the oracle.
    errors : by effect, distance from the oracle over its size; true loads are compared as one sum.
    intervals : how many 95 % intervals hold the oracle's value, and how many there are.
    over_limit : size of the effect over the stated detection limit; None where none is stated.
    reductions : of held-out errors, by diagnosis and by oracle, see :func:`heldout.reductions`.
    """

    best: Oracle
    errors: dict[str, float]
    intervals: tuple[int, int]
    over_limit: float | None
    reductions: dict[str, tuple[float, float]]


def compare(
    folder: Path, case: str, truth: Mapping, diagnoses: Sequence[tuple[Mapping, Path]]
) -> list[Comparison | None]:
    """Compare diagnoses of one case with the oracle, which is the same for all.

    Parameters
    ----------
    folder : of the cases.
    case, truth : name of the case and its truth.
    diagnoses : each diagnosis with the path of its fitted vehicle file.

    Returns
    -------
    A comparison a diagnosis; None for all where the maker kept no noise-free truth.
    """
    seen = oracle.witness(folder, case, truth)
    if seen is None:
        return [None] * len(diagnoses)
    case_truth = opened.open_case(folder, case, truth, seen)
    best, over_limit = case_truth.best, case_truth.over_limit
    claimed = [
        {f["name"]: f["parameters"] for f in diagnosis["findings"] if f["name"] in best.parameters}
        for diagnosis, _ in diagnoses
    ]
    return [
        Comparison(
            best,
            _errors(seen, best, named, fitted),
            _intervals(best, named),
            over_limit,
            reductions(diagnosis, case_truth.of_true_names),
        )
        for (diagnosis, fitted), named in zip(diagnoses, claimed, strict=True)
    ]


def _errors(
    seen: Witness, best: Oracle, claimed: Mapping[str, Mapping], fitted: Path
) -> dict[str, float]:
    """Return the error by effect.

    It is of the loads where the effect makes loads, so that the form chosen does not matter, else
    of the numbers.
    """
    wrenches = [n for n in best.parameters if is_load(n)]
    errors = {n: _relative(best.parameters[n], claimed[n]) for n in claimed if n not in wrenches}
    # true loads are compared as one sum, which means nothing while a part of it is unclaimed
    if wrenches and set(wrenches) <= set(claimed):
        errors["+".join(wrenches)] = _load_error(seen, best, wrenches, fitted)
    return {name: e for name, e in errors.items() if np.isfinite(e)}


def _load_error(seen: Witness, best: Oracle, names: list[str], fitted: Path) -> float:
    try:
        values = load_vehicle(fitted).effect_values()
    except GesError:
        return np.nan
    if not set(names) <= set(values):
        return np.nan
    # the same path for both, so that only the numbers differ
    right = seen.loads({n: {**effect_table.get(n).neutral(), **best.parameters[n]} for n in names})
    return rms(seen.loads({n: values[n] for n in names}) - right) / max(rms(right), 1e-12)


def _relative(right: Mapping[str, float], claimed: Mapping[str, Mapping]) -> float:
    shared = [p for p in right if p in claimed]
    whole = np.linalg.norm(list(right.values()))
    return (
        float(np.linalg.norm([claimed[p]["value"] - right[p] for p in shared]) / whole)
        if shared and whole > 0
        else np.nan
    )


def _intervals(best: Oracle, claimed: Mapping[str, Mapping]) -> tuple[int, int]:
    """Count the 95 % intervals that hold the oracle's value.

    Only parameters count that mean the same whatever the others are.
    """
    # beside a free shape (a decay, a length) an amplitude means another thing in every fit
    checks = [
        parameters[p]["ci95"][0] <= value <= parameters[p]["ci95"][1]
        for name, parameters in claimed.items()
        if not set(FREE.get(name, ())) & set(SHAPES)
        for p, value in best.parameters[name].items()
        if p in parameters and None not in parameters[p]["ci95"]
    ]
    return (sum(checks), len(checks))
