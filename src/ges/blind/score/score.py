"""Open the seal and score: rates with Clopper-Pearson intervals, medians and F1 with bootstrap
intervals, all 95 %.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd

from ges.blind.protocol import seal
from ges.blind.protocol.run import OUT, method_folder
from ges.blind.score.by_world import by_rotors, outcome_of, power_table
from ges.blind.score.coefficients import Comparison, compare
from ges.blind.score.judge import CATEGORIES, Judgement, judge
from ges.blind.score.statistics import (
    bootstrap,
    calibration_error,
    proportion,
    reliability_table,
    score_row,
)
from ges.blind.score.verdicts import check_batches, read_verdict
from ges.files import read_kept, write_csv, write_json

LIMIT_S = 10.0
PROCESSES = 2
# score: aim and its direction
AIMS = {
    "false alarms on nulls": ("<=", 0.02),
    "wrong name on singles": ("<=", 0.01),
    "singles exactly right": (">=", 0.90),
    "singles exactly right above the stated detection limit": (">=", 0.98),
    "pairs exactly right": (">=", 0.85),
    "out of library flagged": (">=", 0.95),
    "out of library falsely named": ("<=", 0.03),
    "location F1": (">=", 0.85),
    "coefficient error relative to the oracle, median": ("<=", 0.05),
    "intervals that hold the oracle": (">=", 0.85),
    "held-out reduction in closed loop, share of the oracle's": (">=", 0.90),
    "calibration error of stated probabilities": ("<=", 0.05),
    "seconds a case, 95 % quantile": ("<=", LIMIT_S),
}


def score_cases(folder: Path, out: Path | None = None, diagnosed: str = OUT) -> dict:
    """Score every case, and write tables and figures.

    Parameters
    ----------
    folder : of sealed and diagnosed cases.
    out : folder of tables and figures; by default ``scores`` in ``folder``.
    diagnosed : folder of the verdicts.

    Returns
    -------
    The content of ``scores.json``.

    Raises
    ------
    GesError
        For a case without a verdict, a broken seal, or files that are not what the contract states.
    """
    from ges.blind.score.figures import draw_all

    out = out or folder / "scores"
    names = seal.cases(folder)
    # all sealed files, not the truths alone: scores of changed recordings would prove nothing
    seal.check(folder, list(seal.listed(folder)))
    truths = {n: seal.truth(folder, n) for n in names}
    diagnoses = {n: read_verdict(folder / diagnosed / n) for n in names}
    judged = [judge(n, truths[n], diagnoses[n]) for n in names]
    compared = _against_oracle(folder, truths, {diagnosed: diagnoses})[diagnosed]
    table = _case_table(folder, diagnosed, judged, truths, compared)
    outcomes = [outcome_of(n, truths[n], diagnoses[n]) for n in names]
    scores = _summary(judged, table, {n: c for n, c in compared.items() if c})
    tables = {
        "cases": table,
        "scores": scores,
        "singles": _by_effect(judged),
        "confusion": confusion(judged),
        "categories": _outcomes(judged),
        "reliability": reliability_table([s for j in judged for s in j.stated]),
        "oracle": _reach(judged, compared),
        "power": power_table(outcomes),
        "rotors": by_rotors(outcomes),
    }
    for name, frame in tables.items():
        write_csv(out / f"{name}.csv", frame, digits=6)
    report = {
        "schema": 1,
        "cases": len(names),
        "scores": json.loads(scores.to_json(orient="records", double_precision=6)),
    }
    write_json(out / "scores.json", report)
    draw_all(out, tables)
    return report


def _against_oracle(
    folder: Path, truths: dict, diagnoses: dict[str, dict]
) -> dict[str, dict[str, Comparison | None]]:
    """Return comparisons by folder of verdicts and case, as ``diagnoses`` holds diagnoses.

    The oracle of a case is asked once.
    """
    pairs = {
        n: [
            (by_name[n], folder / d / n / "vehicle.fitted.yaml") for d, by_name in diagnoses.items()
        ]
        for n in truths
    }
    # all methods at once: the oracle's fit, most of the work, is the same for them
    with ProcessPoolExecutor(PROCESSES) as pool:
        jobs = {n: pool.submit(compare, folder, n, truths[n], pairs[n]) for n in truths}
        compared = {n: dict(zip(diagnoses, job.result(), strict=True)) for n, job in jobs.items()}
    return {d: {n: by[d] for n, by in compared.items()} for d in diagnoses}


def score_batches(sums: Path, verdicts: list[Path], scores: Path) -> None:
    """Score what the workflow's batches diagnosed.

    Parameters
    ----------
    sums : list of hashes ``sealed/SHA256SUMS`` of the folder.
    verdicts : hashes of the diagnoses, by batch.
    scores : ``scores.json`` to be written; tables and figures go beside it.

    Raises
    ------
    GesError
        When a verdict is not the one that its batch wrote.
    """
    folder = sums.parents[1]
    check_batches(folder, OUT, verdicts)
    score_cases(folder, scores.parent)


def compare_methods(sums: Path, verdicts: list[Path], methods: list[str], table: Path) -> None:
    """Write the scores of several methods on the same cases side by side.

    Parameters
    ----------
    sums : list of hashes ``sealed/SHA256SUMS`` of the folder.
    verdicts : hashes of the diagnoses, by batch; the folder of each has the name of its method.
    methods : to be compared.
    table : CSV of one row a score, with value and interval of each method.

    Raises
    ------
    GesError
        When a verdict is not the one that its batch wrote.
    """
    folder = sums.parents[1]
    names = seal.cases(folder)
    seal.check(folder, list(seal.listed(folder)))
    truths = {n: seal.truth(folder, n) for n in names}
    columns, diagnoses = {}, {}
    for method in methods:
        diagnosed = method_folder(method)
        check_batches(folder, diagnosed, [p for p in verdicts if p.parent.name == method])
        diagnoses[diagnosed] = {n: read_verdict(folder / diagnosed / n) for n in names}
    every = _against_oracle(folder, truths, diagnoses)
    for method in methods:
        diagnosed = method_folder(method)
        judged = [judge(n, truths[n], diagnoses[diagnosed][n]) for n in names]
        compared = every[diagnosed]
        cases = _case_table(folder, diagnosed, judged, truths, compared)
        scores = _summary(judged, cases, {n: c for n, c in compared.items() if c})
        columns[method] = scores.set_index("score")[["value", "low", "high"]]
    side_by_side = pd.concat(columns, axis=1)
    side_by_side.columns = [f"{method}_{part}" for method, part in side_by_side.columns]
    write_csv(table, side_by_side.reset_index(), digits=6)


def _case_table(
    folder: Path, diagnosed: str, judged: Sequence[Judgement], truths: dict, compared: dict
) -> pd.DataFrame:
    """Return one row a case.

    It holds what was concealed, what was reported, what came of it, the situation and the seconds.
    """
    rows = []
    for j in judged:
        ran = read_kept(folder / diagnosed / j.case / "run.json", dict)
        against = compared[j.case]
        # one number a case: no effect of it is further off
        worst = max(against.errors.values(), default=np.nan) if against else np.nan
        rows.append(
            {
                "case": j.case,
                "category": j.category,
                "severity": j.severity,
                "truth": "+".join(j.truth),
                "verdict": j.verdict,
                "claimed": "+".join(j.claimed),
                "offered": "+".join(j.offered),
                "outcome": j.outcome,
                "wrong": "+".join(j.wrong),
                "flagged": j.flagged,
                "located": j.located[0],
                "located_too_many": j.located[1],
                "located_missed": j.located[2],
                "reach": against.best.reach if against else np.nan,
                "coefficient_error": worst,
                "over_limit": against.over_limit if against else None,
                **truths[j.case].get("situation", {}),
                "seconds": ran.get("seconds"),
                "wall_s": ran.get("wall_s"),
            }
        )
    return pd.DataFrame(rows)


def _reach(judged: Sequence[Judgement], compared: dict) -> pd.DataFrame:
    """Return how far the library's forms reach, by effect.

    It is the share of a concealed effect that the form of that name explains at best.
    """
    of = [
        # companions come before what needs them: the last name is the concealed one
        (j.truth[-1], compared[j.case].best.reach)
        for j in judged
        if j.category in ("single", "parameter") and compared[j.case]
    ]
    frame = pd.DataFrame(of, columns=["effect", "reach"]).dropna()
    table = (
        frame.groupby("effect")["reach"].agg(n="count", median="median", lowest="min").reset_index()
    )
    return table.astype({"n": int})


def f1(counts: np.ndarray) -> float:
    """Return F1 = 2 found / (2 found + too many + missed).

    Parameters
    ----------
    counts : (n, 3) rows of found, too many, missed; NaN where all are 0.
    """
    right, many, missed = counts.sum(axis=0)
    return 2.0 * right / (2.0 * right + many + missed) if right + many + missed else np.nan


def _share(gains: np.ndarray) -> float:
    """Sum of the first column over that of the second."""
    return float(gains[:, 0].sum() / gains[:, 1].sum())


def _median_share(gains: np.ndarray) -> float:
    """Return the median of the first column over the second.

    One case that got much worse does not decide it.
    """
    return float(np.median(gains[:, 0] / gains[:, 1]))


def only_true(j: Judgement) -> bool | None:
    """Return whether all names of an answer are concealed ones.

    Returns
    -------
    None where it gives none or leaves some open.
    """
    return set(j.claimed) <= set(j.truth) if j.claimed and j.verdict != "ambiguous" else None


def _summary(
    judged: Sequence[Judgement], table: pd.DataFrame, compared: dict[str, Comparison]
) -> pd.DataFrame:
    """All scores with interval, number of cases, aim and whether it is met."""
    of = {c: [j for j in judged if j.category == c] for c in CATEGORIES}
    scores = {
        "false alarms on nulls": _rate(of["null"], lambda j: j.alarm),
        "nulls given a name": _rate(of["null"], lambda j: bool(j.claimed)),
        "wrong name on singles": _rate(of["single"], lambda j: bool(j.wrong)),
        "singles exactly right": _rate(of["single"], lambda j: j.exact),
        "singles with nothing said": _rate(of["single"], lambda j: j.outcome == "nothing"),
        "pairs exactly right": _rate(of["pair"], lambda j: j.exact),
        "pairs with true names only": _rate(of["pair"], lambda j: bool(j.claimed) and not j.wrong),
        "triples exactly right": _rate(of["triple"], lambda j: j.exact),
        "triples with true names only": _rate(
            of["triple"], lambda j: bool(j.claimed) and not j.wrong
        ),
        "parameter errors exactly right": _rate(of["parameter"], lambda j: j.exact),
        "sensor faults exactly right": _rate(of["sensor"], lambda j: j.exact),
        "out of library flagged": _rate(of["unknown"], lambda j: j.flagged or j.exact),
        "out of library falsely named": _rate(of["unknown"], lambda j: bool(j.wrong)),
        "confounded called ambiguous": _rate(of["confounded"], lambda j: j.exact),
        "confounded given the true name": _rate(of["confounded"], lambda j: only_true(j) is True),
        "confounded given another name": _rate(of["confounded"], lambda j: only_true(j) is False),
        "diagnosis failed": _rate(judged, lambda j: j.outcome == "failed"),
    }
    # (0, 0, 0) has nothing to find and found nothing: it says nothing of F1
    located = np.array([j.located for j in judged if sum(j.located)], dtype=float).reshape(-1, 3)
    stated = np.array([s for j in judged for s in j.stated], dtype=float).reshape(-1, 2)
    for category, limit in (("single", "limit"), ("pair", "limits"), ("triple", "limits")):
        # of several effects the least over its limit is told: at 1 or more all are above theirs
        above = [
            j
            for j in of[category]
            if j.case in compared and (compared[j.case].over_limit or 0.0) >= 1.0
        ]
        scores[f"{category}s exactly right above the stated detection {limit}"] = _rate(
            above, lambda j: j.exact
        )
    errors = np.array([e for c in compared.values() for e in c.errors.values()])
    scores["coefficient error relative to the oracle, median"] = (
        *bootstrap(errors, np.median),
        len(errors),
    )
    # (held, tried) of a case as so many hits and misses
    within = [k < c.intervals[0] for c in compared.values() for k in range(c.intervals[1])]
    scores["intervals that hold the oracle"] = (*proportion(within), len(within))
    for kind, words in (
        ("open_loop", "held-out reduction"),
        ("closed_loop", "held-out reduction in closed loop"),
    ):
        gains = np.array(
            [c.reductions[kind] for c in compared.values() if kind in c.reductions]
        ).reshape(-1, 2)
        scores[f"{words}, share of the oracle's"] = (*bootstrap(gains, _share), len(gains))
        scores[f"{words}, median share of a case"] = (*bootstrap(gains, _median_share), len(gains))
    seconds = table["seconds"].dropna().to_numpy(dtype=float)
    scores["location F1"] = (*bootstrap(located, f1), len(located))
    scores["calibration error of stated probabilities"] = (
        *bootstrap(stated, calibration_error),
        len(stated),
    )
    scores["seconds a case, median"] = (*bootstrap(seconds, np.median), len(seconds))
    scores["seconds a case, 95 % quantile"] = (
        *bootstrap(seconds, lambda s: float(np.quantile(s, 0.95))),
        len(seconds),
    )
    return pd.DataFrame(
        [score_row(name, values, AIMS.get(name)) for name, values in scores.items()]
    )


def _rate(
    judged: Sequence[Judgement], hit: Callable[[Judgement], bool]
) -> tuple[float, float, float, int]:
    return (*proportion([hit(j) for j in judged]), len(judged))


def _by_effect(judged: Sequence[Judgement]) -> pd.DataFrame:
    """Return the shares exactly right, wrong and silent by effect and severity.

    Only cases with one thing concealed count.
    """
    rows = []
    for category in ("single", "parameter", "sensor", "unknown"):
        of = [j for j in judged if j.category == category]
        for name in sorted({j.truth[-1] for j in of if j.truth}):
            for severity in ("weak", "medium", "strong"):
                here = [j for j in of if j.truth and j.truth[-1] == name and j.severity == severity]
                if here:
                    exact = proportion([j.exact for j in here])
                    nothing = np.mean([j.outcome == "nothing" for j in here])
                    wrong = np.mean([bool(j.wrong) for j in here])
                    rows.append((category, name, severity, len(here), *exact, nothing, wrong))
    return pd.DataFrame(
        rows,
        columns=["category", "effect", "severity", "n", "exact", "low", "high", "nothing", "wrong"],
    )


def confusion(judged: Sequence[Judgement]) -> pd.DataFrame:
    """Count the answers that cases with each concealed name got.

    Returns
    -------
    A row a pair of ``concealed`` and ``answer``, with the number of ``cases``. Where nothing has a
    name, the category stands for it.
    """
    rows = []
    for j in judged:
        truth = (
            j.truth if j.category in ("single", "parameter", "sensor", "unknown") else (j.category,)
        )
        claimed = j.claimed or (j.verdict,)
        true_names = set(j.truth) if j.category != "unknown" else set()
        concealed = truth[-1] if truth else j.category
        # true companions are no confusion
        rows += [
            (concealed, name) for name in claimed if name == concealed or name not in true_names
        ]
        if j.category in ("pair", "triple") and j.claimed and not j.wrong:
            rows.append((concealed, "true names"))
        elif (
            j.category not in ("pair", "triple")
            and j.claimed
            and not [n for n in claimed if n == concealed or n not in true_names]
        ):
            rows.append((concealed, "true companion only"))
    frame = pd.DataFrame(rows, columns=["concealed", "answer"])
    return frame.value_counts(sort=False).rename("cases").reset_index()


def _outcomes(judged: Sequence[Judgement]) -> pd.DataFrame:
    """Count of every outcome by category."""
    frame = pd.DataFrame([(j.category, j.outcome) for j in judged], columns=["category", "outcome"])
    return frame.value_counts(sort=False).rename("cases").reset_index()
