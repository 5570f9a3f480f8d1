"""Diagnosis: where simulation and recording differ, which physics that is, and the proof.

``ges.diagnose(recordings, vehicle)`` runs :func:`ges.diagnose.pipeline.diagnose`. The rooms, from
the ground up: types, prepare, library, design, select, estimate, detectors, locate, decide, advise,
prove, report, calibrate.
"""

from __future__ import annotations

import inspect
import sys
import types
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ges.diagnose.prepare.problem import Recordings
    from ges.diagnose.report.diagnosis import Diagnosis
    from ges.vehicle.file import Vehicle

OF_LOGS = ("mass_kg", "prop", "wheelbase_m", "layout")
"""Fields of a request that ``ges.diagnose`` takes beside the path of a log."""


class _Package(types.ModuleType):
    # The package can be called, and read about, like the function it is named after.

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        from ges.diagnose.pipeline import diagnose

        return inspect.getdoc(diagnose) or ""

    def __call__(
        self,
        recordings: Recordings | str | Path | Sequence[str | Path],
        vehicle: Vehicle | str | Path | None = None,
        **options: Any,
    ) -> Diagnosis:
        from ges.diagnose.pipeline import diagnose
        from ges.diagnose.run import Request, gather_inputs

        given: Any = [recordings] if isinstance(recordings, str | Path) else recordings
        if isinstance(given, Sequence) and given and all(isinstance(p, str | Path) for p in given):
            of_logs = {name: options.pop(name) for name in OF_LOGS if name in options}
            request = Request([Path(path) for path in given], vehicle, **of_logs)
            given, vehicle = gather_inputs(request).recordings, None
        return diagnose(given, vehicle, **options)


sys.modules[__name__].__class__ = _Package
