"""Which files a piece of the package depends on, read from its import statements."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]


def module_file(module: str) -> Path | None:
    """Find the file of a module of this package.

    Parameters
    ----------
    module : absolute name.

    Returns
    -------
    Path of the file; None where there is no such module.
    """
    parts = module.split(".")
    if parts[0] != PACKAGE.name:
        return None
    base = PACKAGE.joinpath(*parts[1:])
    files = [f for f in (base / "__init__.py", base.with_suffix(".py")) if f.is_file()]
    return files[0] if files else None


@functools.cache
def _imported(module: str) -> tuple[str, ...]:
    """List the names that a module imports, absolute.

    Of ``from x import y`` they are both x and x.y, one of which may be no module.
    """
    names: list[str] = []
    file = module_file(module)
    if file is None:
        return ()
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            # one dot is the package itself, each further one a level above
            up = (
                package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            )
            base = ".".join([*up, *([node.module] if node.module else [])])
            names += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return tuple(names)


@functools.cache
def sources(module: str) -> tuple[Path, ...]:
    """List the files of this package that importing a module can run, itself included.

    A workflow rule that names them as its input is run again when one of them changes, and only
    then.

    Parameters
    ----------
    module : absolute name.

    Returns
    -------
    Paths, sorted.
    """
    todo, files = [module], {}
    while todo:
        name = todo.pop()
        file = module_file(name)
        if file is not None and name not in files:
            files[name] = file
            # importing a module runs every package above it, too
            todo += [name.rpartition(".")[0], *_imported(name)]
    return tuple(sorted(files.values()))
