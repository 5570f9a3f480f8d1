"""What the page keeps in the folder that the user names: logs as they were dropped, and diagnoses.

Random ids name the folders. Of a client's file name the last part is kept, cleaned.

::

    logs/<id>/about.json         how the logs are to be read
    logs/<id>/doctor.json        answer of ``ges doctor``, until the files change
    logs/<id>/files/             the files
    diagnoses/<id>/about.json    what was asked for, and how it ended
    diagnoses/<id>/results/      ``--out`` of ``ges diagnose``
"""

from __future__ import annotations

import datetime
import re
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from ges.errors import GesError
from ges.files import read_kept, replacing, write_json
from ges.vehicle.load import YAML_ENDINGS

AS_THEY_ARE: Mapping[str, Any] = {"map": "", "pwm": None, "rotor_order": [], "part": None}
"""How logs are read where nothing is said of it."""
LONGEST_NAME = 60
"""Characters; in UTF-8 they are below the 255 bytes that file systems allow."""


def clean_name(given: str) -> str:
    """Clean a file name of folders, hidden names, leading dashes and characters of a shell.

    Parameters
    ----------
    given : name as the client sent it.

    Returns
    -------
    A name of at most :data:`LONGEST_NAME` characters, with its ending; ``log`` if nothing is left.

    Examples
    --------
    >>> clean_name("../my flight.ulg")
    'my_flight.ulg'
    """
    last = re.split(r"[/\\]", given)[-1]
    name = re.sub(r"[^\w.]+", "_", last).strip("._")
    # what is cut is the stem: readers go by the ending
    stem, dot, ending = name.rpartition(".")
    if not dot:
        return name[:LONGEST_NAME] or "log"
    ending = ending[:10]
    return f"{stem[: LONGEST_NAME - 1 - len(ending)]}.{ending}"


class Kept:
    """One set of logs or one diagnosis.

    Attributes
    ----------
    id : its random name.
    path : its folder.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.id = path, path.name

    @property
    def about(self) -> dict[str, Any]:
        """Content of its ``about.json``; none where that is damaged or gone."""
        return read_kept(self.path / "about.json", dict)

    def note(self, **changed: Any) -> None:
        """Change entries of its ``about.json``.

        Parameters
        ----------
        **changed : new values by key; others stay.
        """
        write_json(self.path / "about.json", {**self.about, **changed})


class Logs(Kept):
    """Logs that were dropped together, with vehicle files and maps that came with them.

    Attributes
    ----------
    id, path : as of :class:`Kept`.
    """

    @property
    def files(self) -> Path:
        """Folder of the files."""
        return self.path / "files"

    def names(self) -> list[str]:
        """List the files to be read as logs, sorted: those that are not YAML."""
        return [n for n in self._all() if not n.lower().endswith(YAML_ENDINGS)]

    def yaml_names(self) -> list[str]:
        """List vehicle files and maps, sorted: those that are YAML."""
        return [n for n in self._all() if n.lower().endswith(YAML_ENDINGS)]

    def _all(self) -> list[str]:
        return sorted(p.name for p in self.files.iterdir() if not p.name.startswith("."))

    def add(self, given: str, content: BinaryIO) -> None:
        """Keep a file under its cleaned name, with a number added where that is taken.

        Parameters
        ----------
        given : name as the client sent it.
        content : open file, read to its end.

        Raises
        ------
        GesError
            When it cannot be written.
        """
        name = Path(clean_name(given))
        taken, number = set(self._all()), 2
        free = name.name
        # logs of two flights often have the same name
        while free in taken:
            free, number = f"{name.stem}_{number}{name.suffix}", number + 1
        try:
            # whole or not at all: an upload that breaks off leaves no half of a log
            with replacing(self.files / free) as new, new.open("xb") as file:
                shutil.copyfileobj(content, file)
        except OSError as error:
            raise GesError(f"cannot write {self.files / free}: {error.strerror}") from None
        self.forget_examined()

    def examined(self) -> list[dict[str, Any]] | None:
        """Read what ``ges doctor`` said of the files.

        Returns
        -------
        One mapping a file, see :func:`ges.examine.examine`; None if it was not asked since the last
        change.
        """
        return read_kept(self.path / "doctor.json", list) or None

    def keep_examined(self, examined: list[dict[str, Any]]) -> None:
        """Keep what ``ges doctor`` said.

        Parameters
        ----------
        examined : one mapping a file.
        """
        write_json(self.path / "doctor.json", examined)

    def forget_examined(self) -> None:
        """Remove the answer of ``ges doctor``, after files or their reading changed."""
        (self.path / "doctor.json").unlink(missing_ok=True)


class Diagnosed(Kept):
    """A diagnosis that was asked for.

    Attributes
    ----------
    id, path : as of :class:`Kept`.
    """

    @property
    def results(self) -> Path:
        """Folder that ``ges diagnose`` writes."""
        return self.path / "results"

    def names(self) -> list[str]:
        """List the files in :attr:`results` that are complete, sorted; empty before the first."""
        if not self.results.is_dir():
            return []
        return sorted(
            p.name for p in self.results.iterdir() if p.is_file() and not p.name.startswith(".")
        )

    def archive(self) -> Path:
        """Pack all files of :attr:`results` into one zip file, once.

        Returns
        -------
        Path of the zip file.
        """
        path = self.path / "results.zip"
        if not path.is_file():
            # make_archive adds an ending of its own
            with replacing(path) as new:
                Path(shutil.make_archive(str(new), "zip", self.results)).replace(new)
        return path


class Workspace:
    """The folder that the user names.

    Parameters
    ----------
    folder : made where it is missing.

    Raises
    ------
    GesError
        When it cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        try:
            for name in ("logs", "diagnoses"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise GesError(f"cannot make the folder {folder}: {error.strerror}") from None

    def new_logs(self) -> Logs:
        """Make an empty set of logs.

        Returns
        -------
        The set, read as :data:`AS_THEY_ARE`.
        """
        logs = Logs(self._new("logs", {"reading": AS_THEY_ARE}))
        logs.files.mkdir()
        return logs

    def new_diagnosis(self, asked: Mapping[str, Any]) -> Diagnosed:
        """Make a diagnosis that has not begun.

        Parameters
        ----------
        asked : first content of its ``about.json``.
        """
        return Diagnosed(self._new("diagnoses", asked))

    def _new(self, kind: str, about: Mapping[str, Any]) -> Path:
        path = self.folder / kind / secrets.token_hex(8)
        path.mkdir()
        now = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        write_json(path / "about.json", {"made": now, **about})
        return path

    def logs(self, key: str) -> Logs:
        """Find a set of logs.

        Parameters
        ----------
        key : its id, 16 hexadecimal digits.

        Raises
        ------
        KeyError
            When there is none.
        """
        return Logs(self._path("logs", key))

    def diagnosis(self, key: str) -> Diagnosed:
        """Find a diagnosis.

        Parameters
        ----------
        key : its id, 16 hexadecimal digits.

        Raises
        ------
        KeyError
            When there is none.
        """
        return Diagnosed(self._path("diagnoses", key))

    def _path(self, kind: str, key: str) -> Path:
        path = self.folder / kind / key
        # an address holds an id as it was made, or nothing: it becomes a path
        if not re.fullmatch("[0-9a-f]{16}", key) or not Kept(path).about:
            raise KeyError(key)
        return path

    def all_logs(self) -> list[Logs]:
        """List all sets of logs, the newest first."""
        return [Logs(p) for p in self._newest("logs")]

    def all_diagnoses(self) -> list[Diagnosed]:
        """List all diagnoses, the newest first."""
        return [Diagnosed(p) for p in self._newest("diagnoses")]

    def _newest(self, kind: str) -> list[Path]:
        made = {p: Kept(p).about.get("made", "") for p in (self.folder / kind).iterdir()}
        # what is damaged has no time
        return sorted(filter(made.get, made), key=lambda p: made[p], reverse=True)
