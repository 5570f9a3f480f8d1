"""Scores by world: what was reported, what any method could have detected, and simple baselines.

The baselines are cut at the false alarms of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ges.blind.limit import power
from ges.blind.protocol import seal
from ges.blind.protocol.run import OUT, SIMPLE, method_folder
from ges.blind.score.judge import acceptable, category_of, kind_of
from ges.blind.score.laws import law_scores, laws_of_sets
from ges.blind.score.modelled import modelled_of_sets, modelled_scores
from ges.blind.score.statistics import (
    calibration_error,
    proportion,
    reliability_table,
    score_row,
)
from ges.blind.score.verdicts import check_batches, read_verdict
from ges.files import read_kept, write_csv, write_json
from ges.study.figures import style

OUTCOMES = ("right", "acceptable", "partly", "wrong", "unknown", "failed")
HOME = "home"
FALSE_ALARM_RATE = 0.02
"""At which a method is held against what any method could tell: the aim for false alarms."""
SURE = 0.95
EDGES_NATS = (0.0, 3.0, 6.0, 12.0, 24.0, 60.0, 200.0, 1e3, 1e4, np.inf)
AIMS = {
    "false alarms": ("<=", 0.02),
    "wrong names": ("<=", 0.02),
    f"names of P >= {SURE} that are true": (">=", 0.93),
    "right or acceptable, of what any method could tell": (">=", 0.90),
    "cause in no library: unknown": (">=", 0.90),
    "laws with the right terms": (">=", 0.80),
    "share of the error that the truth removes, median": (">=", 0.90),
    "sets that are modelled": (">=", 0.80),
    "nulls that get no worse": (">=", 1.0),
}


@dataclass(frozen=True)
class Outcome:
    """What a method reported on one set.

    Attributes
    ----------
    case, world, category : of the set.
    outcome : one of :data:`OUTCOMES`.
    alarm : whether anything is reported; of a null only what is not true of it.
    named : true names that were reported.
    nats : detection limit by name, as a log likelihood ratio.
    stated : (probability, came true) of each name.
    rotors : number of the vehicle's rotors.
    """

    case: str
    world: str
    category: str
    outcome: str
    alarm: bool
    named: frozenset[str]
    nats: Mapping[str, float]
    stated: tuple[tuple[float, bool], ...]
    rotors: int = 4

    @property
    def null(self) -> bool:
        """Whether nothing is concealed."""
        return self.category == "null"

    @property
    def good(self) -> bool:
        """Whether it is right or as right as that."""
        return self.outcome in ("right", "acceptable")

    @property
    def tellable(self) -> float:
        """Probability that the most powerful test finds all of it; NaN without a limit."""
        if self.null or not self.nats:
            return np.nan
        # all are found together no more often than the one that shows least
        return float(min(power(np.array(list(self.nats.values())), FALSE_ALARM_RATE)))


def outcome_of(case: str, truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> Outcome:
    """Compare a diagnosis with the truth of a set.

    Parameters
    ----------
    case : name of the set.
    truth : its sealed truth.
    diagnosis : content of ``diagnosis.json``.
    """
    findings, verdict = diagnosis.get("findings", []), kind_of(diagnosis)
    right = acceptable(truth)
    true_names = frozenset().union(*right)
    named = _named(findings, verdict)
    nats = dict(truth.get("detectable", {}).get("without", {}))
    category = category_of(truth)
    outcome = _compare(category, verdict, named, findings, right, truth)
    # of a null only what is not true of it is an alarm
    quiet = verdict in ("nothing_proven", "failed")
    quiet = quiet or category == "null" and outcome == "acceptable"
    return Outcome(
        case,
        truth.get("situation", {}).get("world", HOME),
        category,
        outcome,
        not quiet,
        frozenset(named & {f["name"] for f in truth["findings"]}),
        nats,
        tuple((float(f["probability"]), f["name"] in true_names) for f in findings),
        int(truth.get("situation", {}).get("rotors", 4)),
    )


def _named(findings: Sequence[Mapping[str, Any]], verdict: str) -> frozenset[str]:
    """Return the names that are claimed; of an ambiguous answer those that are sure beside it."""
    return frozenset(
        f["name"] for f in findings if verdict != "ambiguous" or f["probability"] >= 0.9
    )


def _compare(
    category: str,
    verdict: str,
    named: frozenset[str],
    findings: Sequence[Mapping[str, Any]],
    right: Sequence[frozenset[str]],
    truth: Mapping[str, Any],
) -> str:
    true_names = frozenset().union(*right)
    if verdict == "failed":
        return "failed"
    # one false name, or a true one at a wrong place, spoils whatever else is right
    if named - true_names or _misplaced(truth, findings):
        return "wrong"
    if category == "unknown":
        # no name of the library is true here; what accounts for it as well follows the first
        if named and named in right[1:]:
            return "acceptable"
        return "right" if verdict == "unknown" else "partly"
    if category == "null":
        if verdict == "unknown":
            return "unknown"
        if verdict == "ambiguous":
            return "wrong"
        return "right" if not named else "acceptable" if named in right else "partly"
    offered = {f["name"] for f in findings}
    # effects that look alike in these flights: no more can be told than the true one among them
    if category == "confounded" and verdict == "ambiguous" and right[0] <= offered:
        return "right"
    if verdict not in ("ambiguous", "unknown") and named in right and _placed(truth, findings):
        return "right" if named == right[0] else "acceptable"
    return "unknown" if verdict == "unknown" and not named else "partly"


def _places(name: str, findings: Sequence[Mapping[str, Any]]) -> set[str]:
    """Return where a name is reported to act.

    It is the finding's ``place``, or all losses by rotor of at least half the largest.
    """
    places: set[str] = set()
    for finding in (f for f in findings if f["name"] == name):
        losses = {
            p.removeprefix("loss_"): v["value"]
            for p, v in finding.get("parameters", {}).items()
            if p.startswith("loss_") and isinstance(v, Mapping)
        }
        if finding.get("place"):
            places.add(finding["place"])
        elif losses:
            # a fit gives every rotor some loss: only what is large beside the largest is a claim
            most = max(losses.values())
            places |= {f"rotor {k}" for k, v in losses.items() if v >= 0.5 * most > 0.0}
    return places


def _true_places(truth: Mapping[str, Any]) -> dict[str, set[str]]:
    places: dict[str, set[str]] = {}
    for finding in truth["findings"]:
        if finding.get("place"):
            places.setdefault(finding["name"], set()).add(finding["place"])
    return places


def _misplaced(truth: Mapping[str, Any], findings: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether a true name is reported where it does not act."""
    return any(_places(name, findings) - where for name, where in _true_places(truth).items())


def _placed(truth: Mapping[str, Any], findings: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether every true name that was reported is placed everywhere where it acts."""
    named = {f["name"] for f in findings}
    return all(
        # a finding that states no place claims none, and is not held against it
        _places(name, findings) in (set(), where)
        for name, where in _true_places(truth).items()
        if name in named
    )


def at_same_alarms(
    truths: Mapping[str, Mapping], diagnoses: Mapping[str, Mapping], alarms: int
) -> dict[str, Mapping]:
    """Return a baseline's diagnoses cut at a threshold.

    The threshold lets it raise no more false alarms on the nulls than the tool did.

    Parameters
    ----------
    truths : by set.
    diagnoses : diagnoses by set, whose findings have a ``statistic``.
    alarms : false alarms of the tool on these nulls.
    """
    nulls = sorted(
        (
            max((f["statistic"] for f in diagnoses[n]["findings"]), default=-np.inf)
            for n, truth in truths.items()
            if category_of(truth) == "null"
        ),
        reverse=True,
    )
    # above the next largest statistic lie just as many nulls as are allowed, fewer in a tie
    least = nulls[alarms] if alarms < len(nulls) else -np.inf
    return {name: _above(diagnosis, least) for name, diagnosis in diagnoses.items()}


def _above(diagnosis: Mapping[str, Any], least: float) -> dict[str, Any]:
    kept = [f for f in diagnosis["findings"] if f["statistic"] > least]
    named = [f for f in kept if f["name"]]
    # a finding without a name says that something is there, not what
    verdict = "physics" if named else "unknown" if kept else "nothing_proven"
    if diagnosis["verdict"] == "failed":
        verdict = "failed"
    return {**diagnosis, "verdict": verdict, "findings": named}


def table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """Return the scores of every world, and of all worlds together.

    Returns
    -------
    A row a world: answers by kind, false alarms, sure names that are true, and sets that any method
    could have identified.
    """
    worlds = list(dict.fromkeys(a.world for a in outcomes))
    groups = {w: [a for a in outcomes if a.world == w] for w in worlds}
    if len(worlds) > 1:
        groups |= {"all": list(outcomes)}
    return pd.DataFrame([{"world": name} | _row(part) for name, part in groups.items()])


def by_rotors(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """Return the scores by the number of rotors.

    Returns
    -------
    Columns of :func:`table`, and the share of concealed sets that were answered well with its 95 %
    interval.
    """
    rows = []
    for rotors in sorted({a.rotors for a in outcomes}):
        part = [a for a in outcomes if a.rotors == rotors]
        share, low, high = proportion([a.good for a in part if not a.null])
        rows.append({"rotors": rotors} | _row(part) | {"good": share, "low": low, "high": high})
    return pd.DataFrame(rows)


def _row(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    nulls = [a for a in outcomes if a.null]
    concealed = [a for a in outcomes if not a.null]
    stated = [s for a in outcomes for s in a.stated]
    sure = [true for p, true in stated if p >= SURE]
    # a limit is known only where the maker knows the noise-free truth
    limited = [a for a in concealed if np.isfinite(a.tellable)]
    unlisted = [a for a in outcomes if a.category == "unknown"]
    row: dict[str, Any] = {"sets": len(outcomes), "concealed": len(concealed)}
    row |= {kind: sum(a.outcome == kind for a in concealed) for kind in OUTCOMES}
    row |= {
        "nulls": len(nulls),
        "false_alarms": sum(a.alarm for a in nulls),
        "detected": sum(a.alarm for a in concealed),
        "sure_names": len(sure),
        "sure_names_true": sum(sure),
        "tellable": sum(a.tellable for a in limited),
        "told": sum(a.good for a in limited),
        "strangers": len(unlisted),
        "strangers_unknown": sum(a.outcome in ("right", "acceptable") for a in unlisted),
    }
    if stated:
        row["calibration_error"] = calibration_error(np.array(stated, dtype=float))
    return row


def scores(outcomes: Sequence[Outcome]) -> dict[str, tuple[float, float, float, int]]:
    """Return each score over all sets.

    Returns
    -------
    Score, 95 % interval (low, high) and number of sets, by name. The score over what any method
    could tell is missing where no limit is known.
    """
    nulls = [a.alarm for a in outcomes if a.null]
    wrong = [a.outcome == "wrong" for a in outcomes]
    sure = [true for a in outcomes for p, true in a.stated if p >= SURE]
    unlisted = [a.good for a in outcomes if a.category == "unknown"]
    limited = [a for a in outcomes if np.isfinite(a.tellable)]
    could = sum(a.tellable for a in limited)
    # hits over what the best method finds on average; the interval is that of the hits alone
    share = np.array(proportion([a.good for a in limited])) * len(limited) / could if could else ()
    rows: dict[str, tuple] = {
        "false alarms": (*proportion(nulls), len(nulls)),
        "wrong names": (*proportion(wrong), len(wrong)),
        f"names of P >= {SURE} that are true": (*proportion(sure), len(sure)),
        "cause in no library: unknown": (*proportion(unlisted), len(unlisted)),
    }
    if could:
        name = "right or acceptable, of what any method could tell"
        rows[name] = (*map(float, share), len(limited))
    return rows


def power_table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """Return the share of true names that were reported, by their detection limit.

    Returns
    -------
    A row a bin of :data:`EDGES_NATS` that holds names. ``named`` has a 95 % interval;
    ``best_method`` is the mean power of the most powerful test.
    """
    rows = [(nats, n in a.named) for a in outcomes if not a.null for n, nats in a.nats.items()]
    values = np.array(rows, dtype=float).reshape(-1, 2)
    bins = []
    for low, high in zip(EDGES_NATS[:-1], EDGES_NATS[1:], strict=True):
        part = values[(values[:, 0] >= low) & (values[:, 0] < high)]
        if len(part):
            named = proportion(part[:, 1].astype(bool).tolist())
            best = float(power(part[:, 0], FALSE_ALARM_RATE).mean())
            # geometric mean, as nats are drawn on a logarithmic axis; the floor is for 0
            middle = float(np.exp(np.log(np.maximum(part[:, 0], 0.1)).mean()))
            bins.append((low, high, middle, len(part), *named, best))
    columns = ["from_nats", "to_nats", "middle_nats", "names", "named", "low", "high"]
    return pd.DataFrame(bins, columns=[*columns, "best_method"])


def skipped(folder: Path) -> pd.DataFrame:
    """Return the worlds and sets that could not be made.

    Parameters
    ----------
    folder : of the sets.

    Returns
    -------
    A row each: name and why.
    """
    about = seal.makers(folder)
    reasons = {**about.get("skipped", {}), **about.get("lost", {})}
    return pd.DataFrame(reasons.items(), columns=["world", "why"])


def made_of_worlds(folder: Path) -> bool:
    """Return whether a folder was made by ``ges blind worlds``."""
    return "worlds" in seal.makers(folder)


def score_worlds(folder: Path, out: Path, diagnosed: str = OUT) -> dict[str, Any]:
    """Score the sets of all worlds.

    Beside the tool stands every simple baseline that was run on them, cut at the false alarms of
    the tool.

    Parameters
    ----------
    folder : of sealed and diagnosed sets.
    out : folder for ``worlds.csv`` (by method and world), ``rotors.csv``, ``sets.csv``,
        ``power.csv``, ``skipped.csv``, ``reliability.csv``, ``modelled.csv``, ``laws.csv`` where
        a law is true, ``power.pdf``, ``power.png`` and ``scores.json``.
    diagnosed : folder of the tool's verdicts.

    Returns
    -------
    The content of ``scores.json``.

    Raises
    ------
    GesError
        For a set without a verdict, or a broken seal.
    """
    from ges.blind.score.figures import draw_power

    names = seal.cases(folder)
    seal.check(folder, list(seal.listed(folder)))
    truths = {n: seal.truth(folder, n) for n in names}
    diagnoses = _diagnoses(folder / diagnosed, names)
    tool = _outcomes(truths, diagnoses)
    # a baseline that alarms more often would find more: all are cut at the alarms of the tool
    alarms = sum(a.alarm for a in tool if a.null)
    by_method = {diagnosed.removeprefix(OUT).removeprefix("-") or "ges": tool}
    for baseline in (b for b in SIMPLE if (folder / method_folder(b)).is_dir()):
        claims = _diagnoses(folder / method_folder(baseline), names)
        by_method[baseline] = _outcomes(truths, at_same_alarms(truths, claims, alarms))
    powers = pd.concat(
        [power_table(outcomes).assign(method=m) for m, outcomes in by_method.items()]
    )
    tables = {
        "worlds": pd.concat([table(a).assign(method=m) for m, a in by_method.items()]),
        "rotors": by_rotors(tool),
        "sets": _set_table(tool, truths, folder / diagnosed),
        "power": powers,
        "skipped": skipped(folder),
        "reliability": reliability_table([s for a in tool for s in a.stated]),
    }
    for name, frame in tables.items():
        write_csv(out / f"{name}.csv", frame, digits=6)
    rows = [
        score_row(name, values, AIMS.get(name)) | {"method": m}
        for m, outcomes in by_method.items()
        for name, values in scores(outcomes).items()
    ]
    modelled = modelled_of_sets(folder, truths, diagnoses)
    laws = laws_of_sets(folder, truths, diagnoses)
    write_csv(out / "modelled.csv", pd.DataFrame(modelled), digits=6)
    if laws:
        write_csv(out / "laws.csv", pd.DataFrame(laws), digits=6)
    rows += [
        score_row(name, values, AIMS.get(name)) | {"method": "ges"}
        for name, values in (modelled_scores(modelled) | law_scores(laws)).items()
    ]
    report = {"schema": 1, "cases": len(names), "scores": rows}
    write_json(out / "scores.json", report)
    style.save(draw_power(powers), powers, out / "power.csv", out / "power.pdf", out / "power.png")
    return report


def _diagnoses(folder: Path, names: Sequence[str]) -> dict[str, dict]:
    return {n: read_verdict(folder / n) for n in names}


def _outcomes(truths: Mapping[str, Mapping], diagnoses: Mapping[str, Mapping]) -> list[Outcome]:
    return [outcome_of(n, truth, diagnoses[n]) for n, truth in truths.items()]


def _set_table(
    outcomes: Sequence[Outcome], truths: Mapping[str, Mapping], diagnosed: Path
) -> pd.DataFrame:
    """Return one row a set: what was concealed, what was reported, and the detection limit."""
    rows = []
    for a in outcomes:
        truth, diagnosis = truths[a.case], read_verdict(diagnosed / a.case)
        findings = diagnosis["findings"]
        rows.append(
            {
                "case": a.case,
                "world": a.world,
                "design": truth.get("situation", {}).get("design", ""),
                "category": a.category,
                "severity": truth.get("severity", ""),
                "truth": "+".join(sorted({f["name"] for f in truth["findings"]})),
                "verdict": diagnosis["verdict"],
                "named": "+".join(f["name"] for f in findings),
                "probabilities": " ".join(f"{f['probability']:.2f}" for f in findings),
                "answer": a.outcome,
                "least_nats": min(a.nats.values(), default=np.nan),
                "best_method": a.tellable,
                "rotor_speeds": truth.get("situation", {}).get("rotor_speeds"),
                "noise": truth.get("situation", {}).get("noise"),
                "rate_hz": truth.get("situation", {}).get("rate_hz"),
                "seconds": read_kept(diagnosed / a.case / "run.json", dict).get("seconds", np.nan),
            }
        )
    return pd.DataFrame(rows)


def score_batches(sums: Path, verdicts: list[Path], scores: Path) -> None:
    """Score what the workflow's batches diagnosed.

    Parameters
    ----------
    sums : list of hashes ``sealed/SHA256SUMS`` of the folder.
    verdicts : hashes of the diagnoses, by batch; the folder of each has the name of its method.
    scores : ``scores.json`` to be written; tables go beside it.

    Raises
    ------
    GesError
        When a verdict is not the one that its batch wrote.
    """
    folder = sums.parents[1]
    for path in verdicts:
        check_batches(folder, method_folder(path.parent.name), [path])
    score_worlds(folder, scores.parent)
