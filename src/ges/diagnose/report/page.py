"""The report: one self-contained HTML page made of diagnosis.json and its pictures."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

from ges.diagnose.types.words import (
    bounds_words,
    chance_words,
    channel_words,
    number_words,
    odds_words,
    quantity_words,
    size_unit,
    unit_words,
)
from ges.diagnose.validate.verify import WORSE
from ges.files import write_text

CAPTIONS: Mapping[str, str] = {
    "where": (
        "Where the recordings leave the recalibrated model: colour is the mean residual over its"
        " standard error in each bin of a condition; a dot marks bins off zero in a condition that"
        " predicts the channel in blocks of time left out."
    ),
    "parameters": (
        "Fitted parameters: the bar is the 95 % interval, the dot the value, grey the number and"
        " doubt that the vehicle file declares, the dotted line zero; details list all."
    ),
    "located": (
        "The residual where it is largest, in windows of flights that took no part, and what the"
        " models add there."
    ),
    "held_out": (
        "Error on flights that took no part, each channel relative to the vehicle file as given;"
        " the whisker on the last bar is the 95 % interval of its reduction against the"
        " recalibrated model."
    ),
    "rollout": (
        "Open-loop simulation from recorded states: how the error grows, with 95 % bands over the"
        " starts."
    ),
}
VERDICTS: Mapping[str, str] = {
    "nothing_proven": "nothing proven",
    "parameter": "a declared parameter is wrong",
    "sensor": "a sensor is wrong",
    "physics": "missing physics",
    "ambiguous": "more than one explanation",
    "unknown": "unknown cause",
}
_KNOWN_DATA = frozenset(
    {"flights", "seconds_used", "left_out", "channels_used", "warnings", "window_s"}
)


def _percent(share: float | None) -> str:
    if share is None:
        return "not known"
    return f"{round(100.0 * share, 1) + 0.0:.{0 if abs(share) >= 0.0995 else 1}f} %".replace(
        "-", "−"
    )


def _probability(p: float | None) -> str:
    if p is None:
        return "not known"
    return "> 0.999" if p > 0.999 else f"{p:.3f}" if p > 0.99 else f"{p:.2f}"


def _regime(regime: Mapping[str, Any]) -> str:
    """Bounds of a regime in words: ``height over rotor radius 0.5 to 2``."""
    parts = []
    for name, (low, high) in regime.items():
        words, _, unit = quantity_words(name).partition(", ")
        parts.append(f"{words} {bounds_words(low, high, 3)}{' ' + unit if unit else ''}")
    return ", ".join(parts) or "everywhere"


def _whole(unit: str) -> str:
    """What a size is a share of, by its unit."""
    return {
        "N": "weight",
        "N m": "weight times arm",
        "rad/s": "full rotor speed",
        "m": "a rotor radius",
    }.get(unit, "the whole")


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("ges.diagnose.report", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.ChainableUndefined,
    )
    environment.filters.update(
        number=number_words,
        percent=_percent,
        probability=_probability,
        regime=_regime,
        size_unit=size_unit,
        whole=_whole,
        channel=channel_words,
        unit=unit_words,
        chance=chance_words,
        odds=odds_words,
        plain=lambda name: str(name).replace("_", " ").replace("+", " with "),
    )
    return environment


def _worse(content: Mapping[str, Any]) -> list[str]:
    """Channels that the findings make worse on flights that took no part, beyond doubt."""
    table = content["fit"].get("channels", {})
    return [
        name
        for name, c in table.items()
        if c["reduction_ci95"][1] is not None and c["reduction_ci95"][1] < -WORSE
    ]


def render(content: Mapping[str, Any], pictures: Mapping[str, bytes]) -> str:
    """The page as text.

    Parameters
    ----------
    content : diagnosis.json (contract, schema 1).
    pictures : PNG bytes by place: any of :data:`CAPTIONS`.
    """
    told = {
        name: {"data": base64.b64encode(pictures[name]).decode(), "caption": caption}
        for name, caption in CAPTIONS.items()
        if name in pictures
    }
    data = content["data"]
    other = {
        key: value
        for key, value in data.items()
        if key not in _KNOWN_DATA and isinstance(value, int | float | str)
    }
    page = {
        **content,
        "verdict": VERDICTS[content["verdict"]],
        "ambiguous": [f["name"] for f in content["findings"] if f["open"]],
        "worse": _worse(content),
        "other": other,
        "pictures": told,
    }
    return _environment().get_template("report.html.j2").render(page)


def write_report(
    content: Mapping[str, Any], pictures: Mapping[str, bytes], path: str | Path
) -> None:
    """Write the report, whole or not at all; parameters as :func:`render`."""
    write_text(path, render(content, pictures))
