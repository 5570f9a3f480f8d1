"""Diagnosis: where simulation and recording differ, which physics that is, and how much better
flights never seen become.

``ges.diagnose(recordings, vehicle)`` runs the whole chain of
:func:`ges.diagnose.pipeline.diagnose`; the modules beside it are its steps: gate, system, evidence,
select, fit, locate, unknown, verify, report.
"""

from __future__ import annotations

import sys
import types
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ges.diagnose.prepare.problem import Recordings
    from ges.diagnose.types.diagnosis import Diagnosis
    from ges.vehicle.file import Vehicle


class _Package(types.ModuleType):
    """The package can be called like the function it is named after."""

    def __call__(
        self, recordings: Recordings, vehicle: Vehicle | None = None, **options: Any
    ) -> Diagnosis:
        from ges.diagnose.pipeline import diagnose

        return diagnose(recordings, vehicle, **options)


sys.modules[__name__].__class__ = _Package
