"""Files of a diagnosis: diagnosis.json, the fitted vehicle, residuals, figures and the report."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ges.diagnose.design.weak import blocks_of, make_windows
from ges.diagnose.locate.regimes import Cell
from ges.diagnose.prove.proof import Proof
from ges.diagnose.prove.traces import Trace, trace
from ges.diagnose.prove.verify import STAGES, horizon_times_s
from ges.diagnose.report.drawing import Drawing, Figure
from ges.diagnose.report.page import CAPTIONS, write_report
from ges.diagnose.report.residuals import write_residuals
from ges.diagnose.settings import settings
from ges.diagnose.types.diagnosis import Diagnosis
from ges.diagnose.types.words import channel_words, quantity_words, size_unit
from ges.files import replacing_together, write_json
from ges.simulator import effects as effect_table
from ges.vehicle.file import save_vehicle

DIAGNOSIS, REPORT = "diagnosis.json", "report.html"


def write_diagnosis(
    diagnosis: Diagnosis,
    out: Path,
    vehicle_folder: Path | str = ".",
    drawing: Drawing | None = None,
    page: bool = True,
) -> None:
    """Write the files of a diagnosis into a folder, all of them or none.

    They are diagnosis.json, vehicle.fitted.yaml and residuals.parquet; with ``page`` also
    report.html and its figures. Figures of an earlier diagnosis in the folder are removed.

    Parameters
    ----------
    diagnosis : the result, as :func:`~ges.diagnose.pipeline.diagnose` returns it.
    out : folder for the files, made where it is missing.
    vehicle_folder : folder of the height map that the vehicle file names; it is copied.
    drawing : figures that were begun before; by default all are drawn now.
    page : whether the page and its figures are written. If not, those of an earlier diagnosis are
        removed.

    Raises
    ------
    OSError
        When a file cannot be read or written.

    Examples
    --------
    >>> from ges.diagnose.report.output import write_diagnosis
    >>> write_diagnosis(found, Path("all"), page=False)
    >>> Path("all/diagnosis.json").exists()
    True
    """
    content, traces = diagnosis.content(), traces_of(diagnosis)
    drawing = drawing or Drawing()
    figures = list(_figures(diagnosis, content, traces)) if page else []
    # first: where other processes draw, they do so while the files below are written
    drawing.start(figures)
    with replacing_together(out, last=DIAGNOSIS) as new:
        # the fitted vehicle names its height map, and has to fly from this folder
        ground = diagnosis.vehicle.terrain.file
        if ground and Path(vehicle_folder).resolve() != out.resolve():
            shutil.copyfile(Path(vehicle_folder) / ground, new / ground)
        save_vehicle(diagnosis.vehicle, new / "vehicle.fitted.yaml")
        write_residuals(traces, new / "residuals.parquet")
        drawn = drawing.pictures(figures)
        for name, picture in drawn.items():
            for ending, data in picture.items():
                (new / f"{name}.{ending}").write_bytes(data)
        if page:
            inside = {name: picture["png"] for name, picture in drawn.items()}
            write_report(content, inside, traces, new / REPORT)
        write_json(new / DIAGNOSIS, content)
        _remove_others(out, new)


def traces_of(diagnosis: Diagnosis) -> list[Trace]:
    """Return recorded and simulated signals of every flight in use, by name.

    Parameters
    ----------
    diagnosis : with its workings.
    """
    workings = diagnosis.workings
    flights = {**workings.problem.fitted, **workings.problem.held_out}
    models = {stage: workings.models[stage] for stage in STAGES}
    return [
        trace(f, name, name in workings.problem.held_out, models, workings.length_s)
        for name, f in sorted(flights.items())
    ]


def _remove_others(out: Path, new: Path) -> None:
    """Remove page and figures of an earlier diagnosis that the new one has not."""
    figures = [f"{name}.{ending}" for name in CAPTIONS for ending in ("png", "pdf")]
    for name in (REPORT, *figures):
        if not (new / name).exists():
            (out / name).unlink(missing_ok=True)


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
    return [("where", "location_map", ([_cell(c) for c in cells],))] if news else []


def _figures(
    diagnosis: Diagnosis, content: Mapping[str, Any], traces: Sequence[Trace]
) -> Iterator[Figure]:
    """Return figures that this diagnosis has data for."""
    proof = diagnosis.workings.proof
    yield from map_figure(diagnosis.workings.cells)
    # a flight that took no part shows what a fit could not have bent
    yield "over_time", "over_time", (next((t for t in traces if t.held_out), traces[0]),)
    parameters = _parameters(content)
    if parameters:
        yield "parameters", "parameter_intervals", (parameters,)
    if proof.rollouts:
        yield (
            "rollout",
            "rollout_growth",
            (horizon_times_s(), proof.rollouts),
        )
    # bars are errors over that of the file as given: without a flight held out there is none
    if any(c["before"] for c in content["fit"]["channels"].values()):
        yield "held_out", "held_out_bars", (content["fit"]["channels"],)
        place = next(
            (item for item in content["located"] if item["channel"] in proof.channels), None
        )
        if place:
            yield "located", "residual_against", _residual_picture(place, proof)


def _cell(cell: Cell) -> dict[str, Any]:
    return {
        "channel": cell.channel,
        "regime": cell.regime,
        "low": cell.low,
        "high": cell.high,
        "mean": cell.mean,
        "sd": cell.sd,
        "q_value": cell.q_value,
    }


def _parameters(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return fitted parameters of the findings, then nominal ones that recalibration moved."""
    rows = [
        {"label": f"{f['name']}.{name}", **{k: p[k] for k in ("value", "ci95", "unit")}}
        for f in content["findings"]
        for name, p in f["parameters"].items()
    ]
    # corrections are counted from the vehicle file, so nominal values lie at zero
    for key, p in content["calibration"].items():
        if p["declared_sd"]:
            rows.append(
                {
                    "label": key,
                    "value": p["value"],
                    "ci95": p["ci95"],
                    "unit": _unit(key),
                    "declared": 0.0,
                    "declared_sd": p["declared_sd"],
                }
            )
    return rows


def _unit(key: str) -> str:
    effect, parameter = key.split(".")
    if effect == "vehicle":
        return "rad/s"
    return effect_table.get(effect).parameter(parameter).unit


def _residual_picture(place: Mapping[str, Any], proof: Proof) -> tuple:
    """Return the clearest location on held-out flights, with what the findings add."""
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
