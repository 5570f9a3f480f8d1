"""What a flight log holds, which effects it can show, and what to log next time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from ges.diagnose.library.requirements import unmet_reference, unmet_requirement
from ges.diagnose.prepare.align import grid_step_s, regrid
from ges.diagnose.prepare.gate import with_thrust_direction
from ges.diagnose.types.model import Model
from ges.recordings import faults
from ges.recordings.consistency import agreements
from ges.recordings.readers import READERS, Log, Options, open_log
from ges.recordings.readers.log import COLUMNS
from ges.simulator import effects

# A quadrotor's angular motion and motors are over within 50 ms, its path within 0.2 s: below these
# rates (Hz) a stream is worth a word.
WANTED_HZ = {
    "attitude": 50.0,
    "rates": 50.0,
    "acceleration": 50.0,
    "command": 50.0,
    "rotor_speed": 20.0,
    "position": 10.0,
    "velocity": 10.0,
    "battery": 1.0,
    "reference": 1.0,
    "range": 10.0,
}
_NEAR = 0.9  # of a rate
_AGAINST = -0.5  # correlation of what should agree


def examine(path: Path, options: Options, kind: str = "auto") -> dict[str, Any]:
    """Describe the streams of a log, and which effects a diagnosis could find in it.

    Parameters
    ----------
    path, options, kind : as of :func:`ges.recordings.readers.open_log`.

    Returns
    -------
    A mapping that can be written as JSON.

    - ``name``, ``format``, ``autopilot``: file name, reader, firmware.
    - ``seconds``: from the first sample of any stream to the last.
    - ``usable``, ``problem``: whether a diagnosis can use it; if not, why.
    - ``streams``: name, source, rate_hz, from_s, to_s and columns of each.
    - ``agreement``: correlation and ratio of quantities that two streams measure.
    - ``fault``: a likely error of units or axes, in one sentence; '' if there is none.
    - ``can_tell``: effects whose streams were logged. Which sizes of them the flights show, a
      diagnosis says.
    - ``cannot_tell``: what each of the other effects lacks.
    - ``switch_on``: by stream, how to log it or log it faster.
    - ``notes``: remarks of the reader.

    Raises
    ------
    GesError
        When the log cannot be read at all.
    """
    log = open_log(path, options, kind)
    problem = log.problem()
    report: dict[str, Any] = {
        "name": path.name,
        "format": log.format,
        "autopilot": log.autopilot,
        "seconds": _seconds(log),
        "usable": not problem,
        "problem": problem,
        "streams": [
            {
                "name": name,
                "source": stream.source,
                "rate_hz": round(stream.rate_hz, 1),
                # adding zero turns -0.0 into 0.0
                "from_s": round(stream.span_s[0], 2) + 0.0,
                "to_s": round(stream.span_s[1], 2),
                "columns": list(stream.columns),
            }
            for name, stream in sorted(log.streams.items(), key=_order)
        ],
        "agreement": [],
        "fault": "",
        "can_tell": [],
        "cannot_tell": {},
        "switch_on": _advice(log),
        "notes": list(log.notes),
    }
    if not problem:
        frame = log.frame()
        report["agreement"] = [
            {"what": a.what, "correlation": round(a.correlation, 3), "ratio": round(a.ratio, 3)}
            for a in agreements(frame)
        ]
        alike, log_odds = faults.find_faults([frame])
        report["fault"] = faults.sentence(alike, log_odds) if alike else ""
        report["can_tell"], report["cannot_tell"] = _effects(frame, log.unusable)
    return report


def _order(item: tuple[str, Any]) -> tuple[int, str]:
    names = list(COLUMNS)
    return (names.index(item[0]) if item[0] in names else len(names), item[0])


def _seconds(log: Log) -> float:
    spans = [stream.span_s for stream in log.streams.values()]
    return round(max(e for _, e in spans) - min(s for s, _ in spans), 2) if spans else 0.0


def _advice(log: Log) -> dict[str, str]:
    """Say what to switch on for streams that are missing or slow."""
    # in the words of the autopilot that wrote it
    advice = next(reader.advice for reader in READERS if reader.name == log.format)
    advised = {}
    for name, wanted_hz in WANTED_HZ.items():
        stream = log.streams.get(name)
        if name in advice and (stream is None or stream.rate_hz < _NEAR * wanted_hz):
            now = "not logged" if stream is None else f"{stream.rate_hz:.2g} Hz"
            advised[name] = f"{now}: {advice[name]}"
    return advised


def _effects(frame: pd.DataFrame, unusable: Mapping[str, str]) -> tuple[list[str], dict[str, str]]:
    """Split the effects into those with all their streams, and what each of the others lacks.

    ``unusable`` has the reasons why columns that are logged are not used.
    """
    # as a diagnosis prepares it; a vehicle of defaults will do, as streams are asked for
    flight = with_thrust_direction(regrid(frame, grid_step_s(frame)), frame)
    can, cannot = [], {}
    for name, effect in effects.table().items():
        if effect.modifies:
            continue
        needs = unmet_requirement(name, [flight], Model({})) or unmet_reference(name, [flight])
        if needs:
            why = {reason: None for column, reason in unusable.items() if column in needs}
            cannot[name] = "; ".join([needs, *why])
        else:
            can.append(name)
    return can, cannot


def sentences(report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Put the findings of :func:`examine` into sentences.

    Parameters
    ----------
    report : what :func:`examine` returns.

    Yields
    ------
    A sentence, and the colour that a terminal gives it; '' for none.
    """
    for note in report["notes"]:
        yield f"note: {note}", ""
    for pair in report["agreement"]:
        if pair["correlation"] < _AGAINST:
            yield f"{pair['what']} run against each other: one of them has the wrong sign", "red"
    if report["fault"]:
        yield report["fault"], "red"
    if not report["usable"]:
        yield f"cannot be diagnosed: {report['problem']}", "red"
    if report["can_tell"]:
        yield f"can be told if large enough: {', '.join(report['can_tell'])}", "green"
    reasons: dict[str, list[str]] = {}
    for name, why in report["cannot_tell"].items():
        reasons.setdefault(why, []).append(name)
    for why, names in reasons.items():
        yield f"cannot be told: {', '.join(names)} ({why})", "yellow"
    for name, what in report["switch_on"].items():
        yield f"next time, {name} ({what.replace(': ', '): ', 1)}", ""
