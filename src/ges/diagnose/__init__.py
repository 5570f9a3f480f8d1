"""Diagnosis: where simulation and recording differ, which physics that is, and the proof.

``ges.diagnose(recordings, vehicle)`` runs :func:`ges.diagnose.pipeline.diagnose`. The rooms, from
the ground up: types, prepare, library, design, select, estimate, detectors, locate, decide, advise,
prove, report, calibrate.
"""

from __future__ import annotations

import sys
import types
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ges.diagnose.prepare.problem import Recordings
    from ges.diagnose.report.diagnosis import Diagnosis
    from ges.vehicle.file import Vehicle


class _Package(types.ModuleType):
    """The package can be called like the function it is named after."""

    def __call__(
        self, recordings: Recordings, vehicle: Vehicle | None = None, **options: Any
    ) -> Diagnosis:
        from ges.diagnose.pipeline import diagnose

        return diagnose(recordings, vehicle, **options)


sys.modules[__name__].__class__ = _Package
