"""GES: simulation, control and diagnosis of multirotors near irregular ground."""

import importlib
import types

__version__ = "0.1.0"


def __getattr__(name: str) -> types.ModuleType:
    """``ges.diagnose`` and the other packages, imported when they are first asked for."""
    if name.startswith("_"):
        raise AttributeError(name)
    try:
        return importlib.import_module(f".{name}", __name__)
    except ModuleNotFoundError:
        raise AttributeError(f"module 'ges' has no attribute '{name}'") from None
