"""The result of a diagnosis, and its form as diagnosis.json."""

from __future__ import annotations

import base64
import dataclasses
import html
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ges.diagnose.types.decision import Considered
from ges.diagnose.types.finding import Finding, FittedParameter, json_values
from ges.vehicle.file import Vehicle

if TYPE_CHECKING:
    from ges.diagnose.report.plots import Plots


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis.

    Attributes
    ----------
    verdict : ``nothing_proven``, ``parameter``, ``sensor``, ``physics``, ``ambiguous``, ``law`` or
        ``unknown``.
    remark : what is to be said besides the sentence; '' for nothing.
    origin : ``vehicle``, ``flights`` with the part each took, and ``version``; of a run also file
        hashes and command.
    findings : causes: proven ones, the largest first, then settled and nominal parameters, then
        open ones.
    located : where the residual is largest: ``channel``, ``regime`` with its bounds,
        ``share_of_excess``, ``mean``, ``q_value``.
    laws : fitted laws: ``channel``, ``form``, ``terms`` with 95 % intervals, ``regime``, ``size``.
    unexplained : residual structure with neither cause nor law: ``channel``, ``regime``, ``r2``,
        ``q_value``, ``rms``.
    fit : errors on ``holdout_flights``. ``channels`` has rms ``before``, ``recalibrated`` and
        ``after``, and ``rollout`` the same of open-loop simulation.
    detectable : by effect the ``smallest`` size of ``parameter`` that these flights would show;
        None where they show none.
    next_flight : ``manoeuvre`` that separates what is open, and what it separates; empty where
        nothing is open.
    data : flights, seconds, channels, delays and instruments used, and ``warnings``.
    calibration : correction of each nominal parameter, with its 95 % interval and its stated sd.
    not_tested : by effect, what the recordings lack to test it.
    considered : every candidate with its posterior probability and the decisions about it.
    vehicle : vehicle file with corrections, findings and laws.
    sentence : the result in one sentence.
    workings : intermediate results, from which figures are drawn.

    Examples
    --------
    >>> found.verdict
    'physics'
    >>> errors = found.fit["channels"]["force_x_N"]
    >>> errors["after"] < 0.5 * errors["recalibrated"]
    True
    >>> "battery_sag" in found.not_tested  # no voltage was logged
    True
    >>> found.plot.located().get_xlabel()
    'speed forward, m/s'
    >>> found.save("saved")
    >>> Path("saved/report.html").exists()
    True
    """

    verdict: str
    remark: str
    origin: Mapping[str, Any]
    findings: tuple[Finding, ...]
    located: tuple[Mapping[str, Any], ...]
    laws: tuple[Mapping[str, Any], ...]
    unexplained: tuple[Mapping[str, Any], ...]
    fit: Mapping[str, Any]
    detectable: Mapping[str, Mapping[str, Any]]
    next_flight: Mapping[str, Any]
    data: Mapping[str, Any]
    calibration: Mapping[str, Mapping[str, Any]]
    not_tested: Mapping[str, str]
    considered: tuple[Considered, ...]
    vehicle: Vehicle
    sentence: str = ""
    workings: Any = dataclasses.field(default=None, repr=False)

    def __repr__(self) -> str:
        """Return verdict and names in one line; ``sentence`` and ``fit`` have the rest."""
        names = [f"{f.name} {f.place}".strip() for f in self.findings]
        names += [law["form"] for law in self.laws]
        return f"Diagnosis({self.verdict}: {', '.join(names) or 'no name'})"

    def _repr_html_(self) -> str:
        """Return verdict, sentence, findings and the picture of the largest residual."""
        rows = "".join(
            f"<tr><td>{html.escape(f.title)} {html.escape(f.place)}</td>"
            f"<td>{f.probability:.2f}</td><td>{html.escape(_numbers(f.parameters))}</td></tr>"
            for f in self.findings
        )
        head = "<tr><th>finding</th><th>probability</th><th>fitted, 95 % interval</th></tr>"
        sentence = f"<p><b>{html.escape(self.verdict)}</b>: {html.escape(self.sentence)}</p>"
        return sentence + (f"<table>{head}{rows}</table>" if rows else "") + self._best_picture()

    def _best_picture(self) -> str:
        """Return the picture that heads the page, as HTML; '' where there is none."""
        from ges.diagnose.report import figures, pictures
        from ges.diagnose.report.page import CAPTIONS

        if self.workings is None or not (drawn := figures.located(self)):
            return ""
        data = base64.b64encode(pictures.png(pictures.residual_against(*drawn))).decode()
        caption = f"<figcaption>{html.escape(CAPTIONS['located'])}</figcaption>"
        return f'<figure><img src="data:image/png;base64,{data}" width="700">{caption}</figure>'

    @property
    def plot(self) -> Plots:
        """The pictures of the page, each drawn on axes: ``found.plot.located()``."""
        from ges.diagnose.report.plots import Plots

        return Plots(self)

    def save(
        self, folder: Path | str, *, page: bool = True, vehicle_folder: Path | str = "."
    ) -> None:
        """Write the files of the diagnosis, as :func:`ges.diagnose.report.output.write_diagnosis`.

        Parameters
        ----------
        folder : folder for the files, made where it is missing.
        page : whether report.html and its figures are written.
        vehicle_folder : folder of the height map that the vehicle file names; it is copied.

        Raises
        ------
        OSError
            When a file cannot be read or written.
        """
        from ges.diagnose.report.output import write_diagnosis

        write_diagnosis(self, Path(folder), vehicle_folder, page=page)

    def content(self) -> dict[str, Any]:
        """Give the content of diagnosis.json.

        Returns
        -------
        A mapping of plain JSON values: six significant digits, None for a number that is not
        finite.
        """
        written = (f.name for f in dataclasses.fields(self))
        content = {n: getattr(self, n) for n in written if n not in ("vehicle", "workings")}
        content["findings"] = [f.content() for f in self.findings]
        content["considered"] = [c.content() for c in self.considered]
        return json_values({"schema": 1, **content})


def _numbers(parameters: Mapping[str, FittedParameter]) -> str:
    units = {name: "" if e.unit == "1" else f" {e.unit}" for name, e in parameters.items()}
    return "; ".join(
        f"{name} {e.value:.3g} [{e.ci95[0]:.3g}, {e.ci95[1]:.3g}]{units[name]}"
        for name, e in parameters.items()
    )
