"""What a change of the code changes in verdicts: two folders of diagnoses of the same cases, key by
key.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ges.errors import UsageError


def changed_cases(before: Path, after: Path) -> dict[str, list[str]]:
    """Differences by case, for cases that have any; keys that only ``after`` has are no difference.

    Parameters
    ----------
    before, after : folders of verdicts as ``ges blind run`` writes them
        (``<case>/diagnosis.json``).

    Raises
    ------
    UsageError
        When ``before`` has no verdicts, or ``after`` lacks a case of it.
    """
    cases = sorted(p.parent.name for p in before.glob("*/diagnosis.json"))
    if not cases:
        raise UsageError(
            f"'{before}' has no <case>/diagnosis.json; name a folder that 'ges blind run' wrote"
        )
    missing = [c for c in cases if not (after / c / "diagnosis.json").is_file()]
    if missing:
        raise UsageError(
            f"'{after}' lacks {len(missing)} of {len(cases)} cases, {missing[0]} first; run 'ges"
            " blind run' again"
        )
    differences = {c: list(_differences(_read(before / c), _read(after / c))) for c in cases}
    return {c: changes for c, changes in differences.items() if changes}


def _read(verdict: Path) -> dict:
    return json.loads((verdict / "diagnosis.json").read_text())


def _differences(before: Any, after: Any, where: str = "") -> Iterator[str]:
    """Yield each place where the two differ, with both values.

    Numbers have to be equal to the last bit.
    """
    if isinstance(before, dict) and isinstance(after, dict):
        for key, value in before.items():
            if key not in after:
                yield f"{where}.{key} is gone"
            else:
                yield from _differences(value, after[key], f"{where}.{key}")
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for k, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from _differences(one, other, f"{where}[{k}]")
    # NaN differs from itself: two of them are no change
    elif before != after and not (before != before and after != after):
        yield f"{where}: {json.dumps(before)[:90]} -> {json.dumps(after)[:90]}"
