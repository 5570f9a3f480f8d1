"""GES: simulation, control and diagnosis of multirotors near irregular ground."""

from __future__ import annotations

import importlib as _importlib
import pkgutil as _pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import types

__version__ = "0.1.0"


def __dir__() -> list[str]:
    """List the packages and modules of ges, without importing them."""
    return sorted(["__version__", *(m.name for m in _pkgutil.iter_modules(__path__))])


def __getattr__(name: str) -> types.ModuleType:
    """Import ``ges.diagnose`` and the other packages when they are first asked for."""
    if name.startswith("_"):
        raise AttributeError(name)
    try:
        return _importlib.import_module(f".{name}", __name__)
    except ModuleNotFoundError:
        raise AttributeError(f"module 'ges' has no attribute '{name}'") from None
