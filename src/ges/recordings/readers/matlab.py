"""MATLAB .mat files (up to version 7), by scipy and a column map.

Names in the map are MATLAB's own: ``log.t``, ``log.position(:,1)``.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from ges.errors import GesError, UsageError
from ges.recordings.readers.log import Log, Options, Stream
from ges.recordings.readers.maps import ADVICE, convert
from ges.recordings.readers.table import map_for, streams_of

_MAGIC, _HDF5 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
_MOST_COLUMNS = 64


def _arrays(value: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """List the vectors of numbers in a variable, by the expression that gives them in MATLAB."""
    if isinstance(value, dict):
        for field, inner in value.items():
            if not field.startswith("__"):
                yield from _arrays(inner, f"{name}.{field}" if name else field)
        return
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iufb" or value.size < 2:
        return
    value = value.squeeze().astype(float)
    if value.ndim == 1:
        yield name, value
    elif value.ndim == 2 and min(value.shape) <= _MOST_COLUMNS:
        # samples lie along the longer side, whichever that is
        tall = value.shape[0] >= value.shape[1]
        for k, column in enumerate(value.T if tall else value, 1):
            yield f"{name}(:,{k})" if tall else f"{name}({k},:)", column


def _extract(path: str, out: str) -> None:
    """Write the vectors of a file, for :func:`_variables`."""
    arrays = dict(_arrays(loadmat(path, simplify_cells=True), ""))
    np.savez(out, np.array(list(arrays), dtype=str), *arrays.values())


def _variables(path: Path) -> dict[str, np.ndarray]:
    """Read the vectors of a file by their names in MATLAB, in a process of its own.

    A damaged file may crash scipy's reader, which no exception would report.
    """
    code = f"import sys; from {__name__} import _extract; _extract(*sys.argv[1:])"
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "variables.npz"
        run = subprocess.run(
            [sys.executable, "-c", code, str(path), str(out)], capture_output=True, text=True
        )
        if run.returncode or not out.exists():
            reason = run.stderr.strip().splitlines()[-1:] or ["the reader crashed"]
            raise GesError(
                f"{path.name} is damaged: it cannot be read as a MATLAB file ({reason[0][:200]})"
            )
        with np.load(out) as arrays:
            names, *values = (arrays[key] for key in arrays.files)
    return dict(zip(names.tolist(), values, strict=True))


class Matlab:
    """Reader of MATLAB .mat files.

    Attributes
    ----------
    name, title, advice : as of :class:`~ges.recordings.readers.log.Reader`.
    """

    name = "matlab"
    title = "MATLAB .mat by a column map"
    advice = ADVICE

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether the first bytes are MATLAB's."""
        return head.startswith((_MAGIC, _HDF5))

    def read(self, path: Path, options: Options) -> Log:
        """Read the streams of all layouts of the map that fit, each at its own times.

        Parameters
        ----------
        path : the file.
        options : ``mapping`` is used.

        Returns
        -------
        Streams in ENU and FLU; one that two layouts give is kept under two names.

        Raises
        ------
        GesError
            When the file is damaged or of version 7.3.
        UsageError
            When no map knows its variables, or those of a layout differ in length.
        """
        with path.open("rb") as file:
            if file.read(len(_HDF5)) == _HDF5:
                raise GesError(
                    f"{path.name} is of MATLAB's version 7.3, which is not read; save it again by"
                    " save(..., '-v7')"
                )
        arrays = _variables(path)
        mapping, chosen = map_for(list(arrays), options, path.name)
        streams: dict[str, Stream] = {}
        notes = [chosen] if chosen else []
        for layout in mapping.layouts:
            if (named := layout.named(arrays)) is None:
                continue
            sizes = {name: len(arrays[name]) for name in named}
            if len(set(sizes.values())) > 1:
                lengths = ", ".join(f"{name} {n}" for name, n in sizes.items())
                raise UsageError(
                    f"{path.name}: the variables of one layout must have as many samples as its"
                    f" time ({lengths}); give each time a layout of its own"
                )
            columns = {c.to: convert(arrays[name], c) for name, c in named.items()}
            more, dropped = streams_of(columns, layout, path.name, "variables")
            # a stream that two layouts give is kept under two names
            streams |= {n if n not in streams else f"{n} (2)": s for n, s in more.items()}
            notes += dropped
        if not streams:
            raise UsageError(
                f"{path.name} has not all variables of any layout of the map; it has"
                f" {', '.join(list(arrays)[:12]) or 'no vector of numbers'}"
            )
        return Log(path.stem, self.name, "", streams, {}, tuple(notes))
