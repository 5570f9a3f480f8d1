"""What an extra of this package installs, and the command that installs what is missing of it."""

from __future__ import annotations

import importlib.metadata
import shlex
from collections.abc import Iterator

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

_DISTRIBUTIONS = {"sklearn": "scikit-learn"}
"""Distributions that are called otherwise than their module."""


def install_command(extra: str) -> str:
    """Write the command that installs what is missing of an extra.

    It names the requirements themselves: another project has the name of this one on PyPI.

    Parameters
    ----------
    extra : name of the extra, as in pyproject.toml.

    Returns
    -------
    The command, quoted for a shell. It has all requirements where none is missing.
    """
    wanted = list(_requirements(extra))
    # without metadata this is the checkout itself, which nothing was installed from
    if not wanted:
        return f"pip install '.[{extra}]'"
    missing = [r for r in wanted if not _distribution(r.name)]
    return shlex.join(["pip", "install", *(f"{r.name}{r.specifier}" for r in missing or wanted)])


def install_command_for(module: str) -> str:
    """Write the command that installs a module, with what else is missing of its extra.

    Parameters
    ----------
    module : name to import, without its submodules.

    Returns
    -------
    The command, quoted for a shell.
    """
    name = canonicalize_name(_DISTRIBUTIONS.get(module, module))
    for extra in _extras():
        if name in {canonicalize_name(r.name) for r in _requirements(extra)}:
            return install_command(extra)
    return shlex.join(["pip", "install", name])


def _extras() -> list[str]:
    package = _distribution("ges")
    return package.metadata.get_all("Provides-Extra") or [] if package else []


def _requirements(extra: str) -> Iterator[Requirement]:
    package = _distribution("ges")
    for requirement in map(Requirement, package.requires or [] if package else []):
        marker = requirement.marker
        # what is required without the extra is no part of it
        if marker and marker.evaluate({"extra": extra}) and not marker.evaluate({"extra": ""}):
            yield requirement


def _distribution(name: str) -> importlib.metadata.Distribution | None:
    try:
        return importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return None
