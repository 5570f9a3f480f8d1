"""Frames of an SDFormat model: poses of its links, with models that it includes.

Frame semantics are those of SDFormat 1.7. The pose of a link is in the frame of its model, that of
a joint in its child link. The pose of a frame is in what it is attached to; ``relative_to`` names
another.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ges.errors import GesError, UsageError
from ges.vehicle.formats.neutral import number, parse_xml

MODEL = "__model__"
# models may include each other in circles
DEEPEST = 8
Finder = Callable[[str], Element]


@dataclasses.dataclass(frozen=True)
class Pose:
    """Place and attitude of one frame in another.

    Attributes
    ----------
    p : (3,) origin, m.
    r : rotation from the inner to the outer frame.
    """

    p: np.ndarray
    r: Rotation

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.p + self.r.apply(other.p), self.r * other.r)


ORIGIN = Pose(np.zeros(3), Rotation.identity())


def pose_of(element: Element | None, name: str) -> Pose:
    """Read the pose of a ``<pose>`` element.

    Parameters
    ----------
    element : the element; None or an empty one gives the origin.
    name : name of the file, for messages.

    Raises
    ------
    UsageError
        When it is no pose.
    """
    written = (element.text or "").strip() if element is not None else ""
    if element is None or not written:
        return ORIGIN
    values = [number(text, "a pose", name) for text in written.split()]
    if element.get("rotation_format") == "quat_xyzw" and len(values) == 7 and any(values[3:]):
        return Pose(np.array(values[:3]), Rotation.from_quat(values[3:]))
    if len(values) != 6:
        raise UsageError(f"{name}: the pose '{written[:60]}' is not x y z roll pitch yaw")
    degrees = element.get("degrees") in ("true", "1")
    return Pose(np.array(values[:3]), Rotation.from_euler("xyz", values[3:], degrees=degrees))


def model_of(root: Element, name: str) -> Element:
    """Find the first ``<model>`` of a file.

    Parameters
    ----------
    root : root element of the file.
    name : name of the file, for messages.

    Raises
    ------
    UsageError
        When there is none.
    """
    model = root if root.tag == "model" else root.find(".//model")
    if model is None:
        raise UsageError(f"{name} holds no <model>; give the vehicle's own model.sdf")
    return model


def finder(path: Path, models: Sequence[Path]) -> Finder:
    """Make a look-up of included models, in a few folders and nowhere else.

    Parameters
    ----------
    path : the including model; its folder and the one above are searched.
    models : more folders to search.

    Returns
    -------
    A function that gives the ``<model>`` of ``model://NAME``, or raises UsageError.
    """
    folders = (path.parent.parent, path.parent, *models)

    def find(uri: str) -> Element:
        # a plain name: no path leads out of the folders
        match = re.fullmatch(r"(?:model://)?([A-Za-z0-9][\w. -]{0,80})/?", uri)
        if not match:
            raise UsageError(
                f"{path.name} includes '{uri[:60]}'; only model://NAME is looked up, beside the"
                " model and in --models"
            )
        for folder in folders:
            for file in (folder / match[1] / "model.sdf", folder / match[1] / f"{match[1]}.sdf"):
                if file.is_file():
                    return model_of(parse_xml(file.read_bytes(), file.name), file.name)
        raise UsageError(
            f"{path.name} includes model://{match[1]}, which is not beside it; give the folder that"
            " holds it with --models"
        )

    return find


class Scope:
    """One model: its own elements, and the models inside of it by name.

    Parameters
    ----------
    model : the element ``<model>``.
    name : name of the file, for messages.
    find : look-up of included models.
    depth : how many models include this one.

    Raises
    ------
    GesError
        When models include each other more than 8 deep.
    """

    def __init__(self, model: Element, name: str, find: Finder, depth: int = 0) -> None:
        self.file = name
        self.own: list[Element] = []
        self.inner: dict[str, tuple[Element, Scope]] = {}
        self._take(model, find, depth)
        self._frames = {
            part.get("name", ""): part
            for part in self.own
            if part.tag in ("link", "joint", "frame")
        }
        self._resolved = {MODEL: ORIGIN}

    def _take(self, model: Element, find: Finder, depth: int) -> None:
        if depth > DEEPEST:
            raise GesError(f"{self.file} includes models more than {DEEPEST} deep; it is not read")
        for part in model:
            if part.tag not in ("include", "model"):
                self.own.append(part)
                continue
            included = part if part.tag == "model" else find((part.findtext("uri") or "").strip())
            # merged elements are this model's own, their frames too
            if part.get("merge") in ("true", "1"):
                self._take(included, find, depth + 1)
            else:
                name = part.findtext("name") or part.get("name") or included.get("name") or "model"
                self.inner[name] = (part, Scope(included, self.file, find, depth + 1))

    def frame(self, name: str, trail: tuple[str, ...] = ()) -> Pose:
        """Find the pose of a frame in the model's own.

        Parameters
        ----------
        name : name of a link, joint or frame; ``A::B`` is frame B of the inner model A.
        trail : frames that refer to this one, so that a circle is noticed.

        Raises
        ------
        UsageError
            When there is no such frame, or frames refer to each other in a circle.
        """
        if name not in self._resolved:
            if name in trail:
                raise UsageError(f"{self.file}: the frames {', '.join(trail)} form a circle")
            # frames are resolved on demand, as files name them before they define them
            self._resolved[name] = self._resolve(name, (*trail, name))
        return self._resolved[name]

    def _resolve(self, name: str, trail: tuple[str, ...]) -> Pose:
        # A::B is the frame B of the inner model A
        outer, _, rest = name.partition("::")
        if outer in self.inner:
            part, scope = self.inner[outer]
            return self._placed(part, MODEL, trail) @ (scope.frame(rest) if rest else ORIGIN)
        if name not in self._frames:
            raise UsageError(
                f"{self.file}: a pose refers to the frame '{name[:60]}', which is none"
            )
        part = self._frames[name]
        # what a pose counts from where it does not say
        base = {"joint": part.findtext("child"), "frame": part.get("attached_to")}.get(part.tag)
        return self._placed(part, (base or "").strip() or MODEL, trail)

    def _placed(self, part: Element, base: str, trail: tuple[str, ...]) -> Pose:
        pose = part.find("pose")
        named = pose.get("relative_to") if pose is not None else None
        return self.frame(named or base, trail) @ pose_of(pose, self.file)

    def links(self, outer: Pose = ORIGIN, prefix: str = "") -> Iterator[tuple[str, Pose, Element]]:
        """List all links, also those of inner models.

        Parameters
        ----------
        outer : pose of this model in the outermost.
        prefix : what the names of its links begin with.

        Yields
        ------
        Qualified name, pose in the outermost model, and element.
        """
        for part in self.own:
            if part.tag == "link":
                name = part.get("name", "")
                yield prefix + name, outer @ self.frame(name), part
        for name, (_, scope) in self.inner.items():
            yield from scope.links(outer @ self.frame(name), f"{prefix}{name}::")

    def elements(self, tag: str) -> Iterator[Element]:
        """List all elements of a kind, also those of inner models.

        Parameters
        ----------
        tag : kind of element.
        """
        yield from (part for part in self.own if part.tag == tag)
        for _, scope in self.inner.values():
            yield from scope.elements(tag)
