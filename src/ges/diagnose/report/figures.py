"""What the pictures of a diagnosis show: the data of each, taken from its workings."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ges.diagnose.design.weak import blocks_of, make_windows
from ges.diagnose.locate.regimes import Cell
from ges.diagnose.prove.proof import Proof
from ges.diagnose.prove.traces import Trace, trace
from ges.diagnose.prove.verify import STAGES, horizon_times_s
from ges.diagnose.report.blocks import sds_moved
from ges.diagnose.report.drawing import Figure
from ges.diagnose.settings import settings
from ges.diagnose.types.finding import json_values
from ges.diagnose.types.keys import ParameterKey
from ges.diagnose.types.words import channel_words, quantity_words, size_unit
from ges.simulator import effects as effect_table
from ges.threads import each

if TYPE_CHECKING:
    from ges.diagnose.report.diagnosis import Diagnosis


def traces_of(diagnosis: Diagnosis) -> list[Trace]:
    """Return recorded and simulated signals of every flight in use, by name.

    Parameters
    ----------
    diagnosis : with its workings.
    """
    workings = diagnosis.workings
    flights = {**workings.problem.fitted, **workings.problem.held_out}
    models = {stage: workings.models[stage] for stage in STAGES}
    names = sorted(flights)
    return each(
        lambda n: trace(flights[n], n, n in workings.problem.held_out, models, workings.length_s),
        names,
    )


def map_figure(cells: Sequence[Cell]) -> list[Figure]:
    """Return the map of residuals over regimes, which can be drawn before the search.

    Parameters
    ----------
    cells : of the recalibrated stage.

    Returns
    -------
    One figure; none where it would show nothing but noise.
    """
    news = any(c.q_value <= settings.statistics.chance for c in cells)
    return [("where", "location_map", (list(map(dataclasses.asdict, cells)),))] if news else []


def figures_of(diagnosis: Diagnosis, traces: Sequence[Trace]) -> Iterator[Figure]:
    """Yield the figures of the page that this diagnosis has data for.

    Parameters
    ----------
    diagnosis : with its workings.
    traces : of :func:`traces_of`.
    """
    proof = diagnosis.workings.proof
    yield from map_figure(diagnosis.workings.cells)
    # a flight that took no part shows what a fit could not have bent
    yield "over_time", "over_time", (next((t for t in traces if t.held_out), traces[0]),)
    if rows := parameters(diagnosis):
        yield "parameters", "parameter_intervals", (rows,)
    if proof.rollouts:
        yield "rollout", "rollout_growth", (horizon_times_s(), proof.rollouts)
    if channels := held_out(diagnosis):
        yield "held_out", "held_out_bars", (channels,)
    if drawn := located(diagnosis):
        yield "located", "residual_against", drawn


def held_out(diagnosis: Diagnosis) -> Mapping[str, Mapping[str, Any]]:
    """Return errors on held-out flights by channel; empty where no flight was held out.

    Parameters
    ----------
    diagnosis : any.
    """
    channels = json_values(diagnosis.fit["channels"])
    # bars are errors over that of the file as given: without a flight held out there is none
    return channels if any(c["before"] for c in channels.values()) else {}


def parameters(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return fitted parameters of the findings, then nominal ones, the farthest moved first.

    Parameters
    ----------
    diagnosis : any.

    Returns
    -------
    Arguments of :func:`ges.diagnose.report.pictures.parameter_intervals`.
    """
    content = diagnosis.content()
    rows = [
        {"label": f"{f['name']}.{name}", **{k: p[k] for k in ("value", "ci95", "unit")}}
        for f in content["findings"]
        for name, p in f["parameters"].items()
    ]
    # corrections are counted from the vehicle file, so the nominal value lies at zero
    calibration = content["calibration"]
    return rows + [
        {
            "label": key,
            "nominal": 0.0,
            "unit": _unit(key),
            **{k: calibration[key][k] for k in ("value", "ci95", "prior_sd")},
        }
        for key in sds_moved(calibration)
    ]


def _unit(key: str) -> str:
    effect, parameter = ParameterKey.of(key)
    if effect == "vehicle":
        return "rad/s"
    return effect_table.get(effect).parameter(parameter).unit


def located(diagnosis: Diagnosis) -> tuple | None:
    """Return the clearest location on held-out flights, with what the findings add.

    Parameters
    ----------
    diagnosis : with its workings.

    Returns
    -------
    Arguments of :func:`ges.diagnose.report.pictures.residual_against`; None where no flight was
    held out or nothing is located.
    """
    proof = diagnosis.workings.proof
    place = next((item for item in diagnosis.located if item["channel"] in proof.channels), None)
    if not place or not held_out(diagnosis):
        return None
    regime, c = next(iter(place["regime"])), proof.channels.index(place["channel"])
    x, block = _regime_values(regime, proof)
    residuals = {
        stage: np.concatenate([e[:, c] for e in proof.errors[stage]])
        for stage in ("recalibrated", "after")
    }
    good = np.isfinite(residuals["recalibrated"]) & np.isfinite(x)
    # residual is recorded less model, so what the findings add is the difference of both;
    # the recalibrated model, whose own residual this is, adds nothing
    contribution = (residuals["recalibrated"] - residuals["after"])[good]
    curves = {"recalibrated": np.zeros(good.sum())} | (
        {"after": contribution} if contribution.any() else {}
    )
    words = f"{channel_words(place['channel'])}, {size_unit(place['channel'])}"
    return (
        x[good],
        residuals["recalibrated"][good],
        curves,
        block[good],
        quantity_words(regime),
        words,
    )


def _regime_values(regime: str, proof: Proof) -> tuple[np.ndarray, np.ndarray]:
    windows = [make_windows(f.t_s, f.flying, proof.length_s) for f in proof.flights]
    values = [
        t.get(regime, np.full(len(w), np.nan)) for t, w in zip(proof.regimes, windows, strict=True)
    ]
    blocks = blocks_of(
        [(w, f.t_s[0]) for f, w in zip(proof.flights, windows, strict=True)],
        settings.statistics.block_s,
    )
    return np.concatenate(values), np.concatenate(blocks)
