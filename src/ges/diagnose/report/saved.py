"""A saved diagnosis: diagnosis.json, read back and checked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field, ValidationError

from ges.errors import GesError

Interval = tuple[float | None, float | None]


class _Parameter(BaseModel):
    value: float
    ci95: Interval
    unit: str


class _Rival(BaseModel):
    name: str
    log_odds: float


class _Finding(BaseModel):
    name: str
    kind: Literal["physics", "parameter", "sensor"]
    probability: float | None
    equation: str
    parameters: dict[str, _Parameter]
    size: dict[str, Any]
    alternatives: list[_Rival]
    # with a default: what older versions did not write
    title: str = ""
    place: str = ""
    open: bool = False
    rival_law: dict[str, Any] = {}


class _Decision(BaseModel):
    rule: str
    passed: bool
    statistic: float | None = None
    threshold: float | None = None
    because: str = ""


class _Considered(BaseModel):
    name: str
    place: str = ""
    probability: float | None
    decisions: list[_Decision]


class _LawTerm(BaseModel):
    term: str
    coefficient: float
    ci95: Interval


class _LawInWords(BaseModel):
    channel: str
    form: str
    terms: list[_LawTerm]
    regime: dict[str, Any]
    size: dict[str, Any]
    reads_as: str


class _Errors(BaseModel):
    before: float
    recalibrated: float
    names_only: float | None = None
    after: float


class _ChannelErrors(_Errors):
    reduction_ci95: Interval


class _Rollout(BaseModel):
    horizon_s: float = 0.0
    channels: dict[str, _Errors] = {}


class _Fit(BaseModel):
    holdout_flights: list[str]
    channels: dict[str, _ChannelErrors]
    rollout: _Rollout


class _Correction(BaseModel):
    value: float
    ci95: Interval
    declared_sd: float | None


class _File(BaseModel):
    name: str = ""
    sha256: str | None = None


class _Origin(BaseModel):
    vehicle: _File = Field(default_factory=_File)
    flights: list[_File] = []


class _Detectable(BaseModel):
    parameter: str
    smallest: float | None
    unit: str = ""


class _Saved(BaseModel):
    """Keys of diagnosis.json that this version reads; others are kept and ignored."""

    version: Literal[1] = Field(alias="schema")
    verdict: Literal[
        "nothing_proven", "parameter", "sensor", "physics", "ambiguous", "law", "unknown"
    ]
    sentence: str
    findings: list[_Finding]
    located: list[dict[str, Any]]
    laws: list[_LawInWords] = []
    unexplained: list[dict[str, Any]]
    fit: _Fit
    detectable: dict[str, _Detectable]
    next_flight: dict[str, Any]
    data: dict[str, Any]
    calibration: dict[str, _Correction] = {}
    considered: list[_Considered] = []
    not_tested: dict[str, str] = {}
    origin: _Origin = Field(default_factory=_Origin)


def load_diagnosis(folder: str | Path) -> dict[str, Any]:
    """Read the diagnosis that was written into a folder.

    Parameters
    ----------
    folder : folder that ``ges diagnose --out`` wrote, or the path of a diagnosis.json.

    Returns
    -------
    The content of diagnosis.json, see :meth:`ges.diagnose.report.diagnosis.Diagnosis.content`.

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
        raise GesError(f"{path} is not JSON: {error}; diagnose the flights again") from None
    try:
        _Saved.model_validate(content)
    except ValidationError as error:
        # one sentence: the first alone
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "its top level"
        raise GesError(
            f"{path} is no diagnosis that this version reads ({place}: {first['msg'].lower()});"
            " diagnose the flights again"
        ) from None
    return content
