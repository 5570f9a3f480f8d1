"""Files of a diagnosis: diagnosis.json, the fitted vehicle, residuals, figures and the report."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from ges.diagnose.report.drawing import Drawing
from ges.diagnose.report.figures import figures_of, traces_of
from ges.diagnose.report.page import CAPTIONS, render
from ges.diagnose.report.residuals import write_residuals
from ges.files import replacing_together, write_json, write_text
from ges.vehicle.file import save_vehicle

if TYPE_CHECKING:
    from ges.diagnose.report.diagnosis import Diagnosis

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
    figures = list(figures_of(diagnosis, traces)) if page else []
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
            write_text(new / REPORT, render(content, inside, traces))
        write_json(new / DIAGNOSIS, content)
        _remove_others(out, new)


def _remove_others(out: Path, new: Path) -> None:
    """Remove page and figures of an earlier diagnosis that the new one has not."""
    figures = [f"{name}.{ending}" for name in CAPTIONS for ending in ("png", "pdf")]
    for name in (REPORT, *figures):
        if not (new / name).exists():
            (out / name).unlink(missing_ok=True)
