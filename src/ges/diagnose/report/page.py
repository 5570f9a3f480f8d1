"""The report: one self-contained HTML page of diagnosis.json, figures and signals over time."""

from __future__ import annotations

import base64
import functools
import hashlib
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

import jinja2
from markupsafe import Markup

from ges.diagnose.prove.traces import Trace
from ges.diagnose.report import blocks, equations
from ges.diagnose.report.charts import chart_data
from ges.diagnose.types import words

CAPTIONS: Mapping[str, str] = {
    "where": (
        "Where the recordings leave the recalibrated model: colour is the mean residual over its"
        " standard error in each bin of a condition; a dot marks bins off zero in a condition that"
        " predicts the channel in blocks of time left out."
    ),
    "parameters": (
        "Fitted parameters: the bar is the 95 % interval, the dot the value, grey the nominal"
        " value and two prior sds of the vehicle file, the dotted line zero; details list all."
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
    "over_time": (
        "Recorded and simulated signals of one flight, and recorded less simulated beside them;"
        " grey spans are left out. residuals.parquet has every flight."
    ),
}
VERDICTS: Mapping[str, str] = {
    "nothing_proven": "nothing proven",
    "parameter": "a nominal parameter is wrong",
    "sensor": "a sensor is wrong",
    "physics": "missing physics",
    "ambiguous": "more than one explanation",
    "law": "a law that no effect of the library has",
    "unknown": "unknown cause",
}
PARTS: Mapping[str, str] = {
    "fitted": "fitted",
    "held_out": "took no part",
    "left_out": "not used",
}


@functools.lru_cache
def _asset(name: str) -> Markup:
    """Return a file of the package, as it is."""
    # scripts and style sheets of the package go in as they are; all else is escaped
    return Markup(resources.files("ges.diagnose.report").joinpath(name).read_text("utf-8"))


@functools.lru_cache
def _hash_of(name: str) -> Markup:
    """Return a script of the package as a content security policy names it."""
    digest = hashlib.sha256(_asset(name).encode()).digest()
    return Markup(f"'sha256-{base64.b64encode(digest).decode()}'")


@functools.lru_cache(maxsize=1)
def environment() -> jinja2.Environment:
    """Return the templates of the pages, with the filters that they use.

    Notes
    -----
    Text is escaped. A key that a diagnosis lacks leaves its place empty.
    """
    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("ges.diagnose.report", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        # a key that a diagnosis does not have leaves its place empty, and is no error
        undefined=jinja2.ChainableUndefined,
    )
    templates.globals |= {
        "asset": _asset,
        "hash_of": _hash_of,
        "effect_equation": equations.effect_equation,
        "law_equation": equations.law_equation,
        "term_equation": equations.term_equation,
    }
    templates.filters.update(
        number=words.number_words,
        percent=words.percent_words,
        probability=words.probability_words,
        regime=words.regime_words,
        size_unit=words.size_unit,
        whole=words.whole_words,
        channel=words.channel_words,
        unit=words.unit_words,
        chance=words.chance_words,
        odds=words.odds_words,
        plain=words.plain,
        decision=blocks.decision_words,
        share=blocks.share_words,
    )
    return templates


def render(
    content: Mapping[str, Any],
    pictures: Mapping[str, bytes] | None = None,
    traces: Sequence[Trace] = (),
) -> str:
    """Return the page as text.

    Parameters
    ----------
    content : diagnosis.json (contract, schema 1).
    pictures : PNG bytes by place: any of :data:`CAPTIONS`.
    traces : recorded and simulated signals, one for each flight; without them the page has no
        charts.
    """
    fit, scale = content["fit"], content["data"].get("reference_scale", {})
    tables = {
        "errors": fit.get("channels") or {},
        "rollout": (fit.get("rollout") or {}).get("channels") or {},
        "closed_loop": (fit.get("closed_loop") or {}).get("channels") or {},
    }
    page = {
        **content,
        "verdict": VERDICTS[content["verdict"]],
        "parts": PARTS,
        "open": [f for f in content["findings"] if f["open"]],
        "located": dict(zip(("rows", "hidden"), blocks.located_rows(content), strict=True)),
        "scale": scale,
        "tables": {
            name: dict(zip(("rows", "small"), blocks.error_rows(table, scale), strict=True))
            for name, table in tables.items()
        },
        "remarks": blocks.remarks(content),
        "considered": blocks.considered_rows(content),
        "steps": blocks.next_steps(content),
        # flights from tables in memory have no file and no hash: no column for them
        "hashed": any(f.get("sha256") for f in content.get("origin", {}).get("flights", ())),
        "warnings": blocks.grouped_warnings(
            content["data"].get("warnings", ()), blocks.flight_names(content)
        ),
        "pictures": {
            # inside the page: it stays one file, whoever it is sent to
            name: {"data": base64.b64encode((pictures or {})[name]).decode(), "caption": caption}
            for name, caption in CAPTIONS.items()
            if name in (pictures or {})
        },
        "charts": chart_data(traces) if traces else None,
    }
    return environment().get_template("report.html.j2").render(page)
