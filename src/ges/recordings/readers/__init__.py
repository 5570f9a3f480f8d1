"""Readers of flight logs, one file a format, and the choice of one by a log's first bytes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ges.errors import GesError, UsageError, unknown_name
from ges.recordings.readers.ardupilot import ArduPilot
from ges.recordings.readers.betaflight import Betaflight
from ges.recordings.readers.crazyflie import Crazyflie
from ges.recordings.readers.log import Log, Options, Reader, Stream
from ges.recordings.readers.matlab import Matlab
from ges.recordings.readers.px4 import Px4
from ges.recordings.readers.ros import Ros
from ges.recordings.readers.table import Table

__all__ = [
    "READERS",
    "Log",
    "Options",
    "Reader",
    "Stream",
    "find_logs",
    "flight_names",
    "is_log",
    "open_log",
    "reader_of",
]

READERS: tuple[Reader, ...] = (
    Px4(),
    ArduPilot(),
    Betaflight(),
    Crazyflie(),
    Ros(),
    Matlab(),
    Table(),
)
"""All readers, the most certain of their first bytes first; tables, which have none, last."""

_HEAD = 4096
_NO_OPTIONS = Options()


def reader_of(path: Path) -> Reader:
    """Choose the reader of a log by its first bytes.

    Parameters
    ----------
    path : the log; a folder for ROS 2 bags.

    Raises
    ------
    GesError
        When the file cannot be read, is empty, or is of no known format.
    """
    try:
        if path.is_dir():
            head = b""
        else:
            with path.open("rb") as file:
                head = file.read(_HEAD)
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror}") from None
    if not head and not path.is_dir():
        raise GesError(f"{path.name} is empty; take a fresh copy from the vehicle")
    for reader in READERS:
        if reader.sniff(head, path):
            return reader
    raise GesError(
        f"{path.name} is no flight log that is known here; known are "
        + ", ".join(reader.title for reader in READERS)
    )


def open_log(path: str | Path, options: Options = _NO_OPTIONS, kind: str = "auto") -> Log:
    """Read a flight log of any known format.

    Formats are PX4 ULog, ArduPilot DataFlash, Betaflight and INAV blackbox, Crazyflie micro-SD
    logs, ROS bags, MATLAB files, CSV and Parquet.

    Parameters
    ----------
    path : the log; a folder for ROS 2 bags.
    options : what the user states about the log.
    kind : name of a reader, as ``px4``; ``auto`` chooses by the first bytes.

    Returns
    -------
    The log, with streams at their own times; :meth:`Log.frame` brings them to one time axis.

    Raises
    ------
    GesError
        When no reader knows the file, or it cannot be read.
    UsageError
        When there is no reader of that name, or an option does not suit the log.

    Examples
    --------
    >>> from ges.recordings.readers import open_log
    >>> log = open_log(example / "runs_fast.parquet")
    >>> log.format, log.problem()
    ('table', '')
    """
    path = Path(path)
    if kind == "auto":
        reader = reader_of(path)
    else:
        known = {reader.name: reader for reader in READERS}
        if kind not in known:
            raise unknown_name("format", kind, known)
        reader = known[kind]
    try:
        return reader.read(path, options)
    except OSError as error:
        raise GesError(f"cannot read {path}: {error.strerror or error}") from None


def find_logs(sources: Sequence[Path]) -> list[Path]:
    """Find the logs that paths mean: themselves, or what is in a folder that is no log.

    Parameters
    ----------
    sources : files and folders. A ROS 2 bag is a folder and a log; of a recording set the flights
        are logs.

    Returns
    -------
    Paths in the order given, those of a folder sorted by name. Files of no known format are left
    out there.

    Raises
    ------
    GesError
        When a folder has no log.
    """
    logs: list[Path] = []
    for source in sources:
        inside = [source] if is_log(source) or not source.is_dir() else _logs_in(source)
        if not inside:
            raise GesError(
                f"the folder {source} holds no flight log, and no vehicle.yaml as a recording set"
                " does; name the folder that has the logs, or the logs themselves"
            )
        logs += inside
    return logs


def _logs_in(folder: Path) -> list[Path]:
    of_set = (folder / "vehicle.yaml").exists()
    paths = sorted(folder.glob("[!.]*.parquet" if of_set else "[!.]*"))
    return [path for path in paths if is_log(path)]


def is_log(path: Path) -> bool:
    """Tell whether a reader knows the first bytes of a file, or the files of a folder."""
    try:
        return bool(reader_of(path))
    except GesError:
        return False


def flight_names(sources: Sequence[Path]) -> dict[str, Path]:
    """Name flights after their logs: the file's stem, with the folder's name where stems are equal.

    Parameters
    ----------
    sources : paths of the logs.

    Returns
    -------
    Paths by name, in the order given.

    Raises
    ------
    UsageError
        When two flights would still have the same name.
    """
    for named in (lambda p: p.stem, lambda p: f"{p.parent.name}_{p.stem}"):
        names = {named(path): path for path in sources}
        if len(names) == len(sources):
            return names
    raise UsageError(
        "two of the files would become flights of the same name; rename one or import them apart"
    )
