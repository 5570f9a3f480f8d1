"""A saved diagnosis: diagnosis.json, read back and checked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field, ValidationError

from ges.errors import GesError

Interval = tuple[float | None, float | None]
Regime = dict[str, tuple[float, float]]


class _Part(BaseModel, extra="allow"):
    """A part of diagnosis.json; keys that this version does not read are kept."""


class _Parameter(_Part):
    value: float
    ci95: Interval
    unit: str


# with a default: what some diagnoses, or those of older versions, do not write
class _Rival(_Part):
    name: str
    log_odds: float
    place: str = ""


class _Size(_Part):
    value: float | None = None
    unit: str = ""
    share_of_weight: float | None = None
    channel: str = ""
    force_per_speed_N_s_m: float | None = None


class _RivalLaw(_Part):
    channel: str
    form: str
    log_odds: float


class _Nothing(BaseModel, extra="forbid"):
    """An empty mapping."""


class _Finding(_Part):
    name: str
    kind: Literal["physics", "parameter", "sensor"]
    probability: float | None
    equation: str
    parameters: dict[str, _Parameter]
    size: _Size
    alternatives: list[_Rival]
    title: str = ""
    place: str = ""
    open: bool = False
    rival_law: _RivalLaw | _Nothing = _Nothing()


class _Decision(_Part):
    rule: str
    passed: bool
    statistic: float | None = None
    threshold: float | None = None
    because: str = ""


class _Considered(_Part):
    name: str
    place: str = ""
    probability: float | None
    decisions: list[_Decision]


class _Structure(_Part):
    channel: str
    regime: Regime


class _LawTerm(_Part):
    term: str
    coefficient: float
    ci95: Interval


class _LawInWords(_Structure):
    form: str
    terms: list[_LawTerm]
    size: _Size
    reads_as: str


class _Errors(_Part):
    before: float
    recalibrated: float
    after: float


class _ChannelErrors(_Errors):
    reduction_ci95: Interval


class _Rollout(_Part):
    horizon_s: float = 1.0
    channels: dict[str, _Errors] = {}


class _Fit(_Part):
    holdout_flights: list[str]
    channels: dict[str, _ChannelErrors]
    rollout: _Rollout


class _Correction(_Part):
    value: float
    ci95: Interval
    declared_sd: float | None
    prior_sd: float | None = None


class _File(_Part):
    name: str = ""
    sha256: str | None = None


class _Origin(_Part):
    vehicle: _File = _File()
    flights: list[_File] = []


class _Detectable(_Part):
    parameter: str
    smallest: float | None
    unit: str = ""
    limited_by: str = ""


class _Data(_Part):
    flights: int | None = None
    seconds_used: float | None = None
    reference_scale: dict[str, float] = {}


class _Saved(_Part):
    version: Literal[1] = Field(alias="schema")
    verdict: Literal[
        "nothing_proven", "parameter", "sensor", "physics", "ambiguous", "law", "unknown"
    ]
    sentence: str
    findings: list[_Finding]
    located: list[_Structure]
    laws: list[_LawInWords] = []
    unexplained: list[_Structure]
    fit: _Fit
    detectable: dict[str, _Detectable]
    next_flight: dict[str, Any]
    data: _Data
    calibration: dict[str, _Correction] = {}
    considered: list[_Considered] = []
    not_tested: dict[str, str] = {}
    origin: _Origin = _Origin()


def load_diagnosis(folder: str | Path) -> dict[str, Any]:
    """Read the diagnosis that was written into a folder.

    Parameters
    ----------
    folder : folder that ``ges diagnose --out`` wrote, or the path of a diagnosis.json.

    Returns
    -------
    The content of diagnosis.json, see :meth:`ges.diagnose.report.diagnosis.Diagnosis.content`. A
    key that older versions did not write is empty.

    Raises
    ------
    GesError
        When there is no file, it cannot be read, or its content is not a diagnosis.

    Examples
    --------
    >>> from ges.diagnose.report.saved import load_diagnosis
    >>> content = load_diagnosis("all")
    >>> [finding["name"] for finding in content["findings"]]
    ['rotor_drag', 'ground_effect']
    """
    path = Path(folder)
    path = path / "diagnosis.json" if path.is_dir() else path
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise GesError(
            f"there is no {path}; give the folder that 'ges diagnose --out' wrote"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise GesError(f"cannot read {path}: {reason}") from None
    try:
        content = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        if path.suffix != ".json":
            raise GesError(
                f"{path} is no diagnosis; give the folder that 'ges diagnose --out' wrote, or its"
                " diagnosis.json"
            ) from None
        raise GesError(f"{path} is not JSON: {error}; diagnose the flights again") from None
    try:
        saved = _Saved.model_validate(content)
    except ValidationError as error:
        # one sentence: the first alone
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "its top level"
        raise GesError(
            f"{path} is no diagnosis that this version reads ({place}: {first['msg'].lower()});"
            " diagnose the flights again"
        ) from None
    return saved.model_dump(mode="json", by_alias=True)
