"""Compile the simulator into the wheel: ``make -C sim_c`` is the one way to compile it.

The library is loaded by ctypes and knows nothing of Python, and chooses the vector width of its
arithmetic when it is used: one wheel serves every Python 3 on every processor of a platform.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class SimulatorBuildHook(BuildHookInterface):
    """Adds ``ges/simulator/libges.so`` and the tag of the platform to a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile to ``build/``, unless a checkout is installed as it is: ``make build`` does that.

        Raises
        ------
        SystemExit
            When there is no make or no compiler, or it fails.
        """
        if version == "editable":
            return
        root = Path(self.root)
        library = root / "build" / "libges.so"
        compiler = os.environ.get("CC", "cc").split()[0]
        for program in ("make", compiler):
            if shutil.which(program) is None:
                raise SystemExit(
                    f"no '{program}' found to compile the simulator; install make and gcc or clang,"
                    " name another compiler by CC, or install a wheel, which needs none"
                )
        jobs = f"-j{os.cpu_count() or 1}"
        command = ["make", "--no-print-directory", "-C", str(root / "sim_c"), jobs]
        if subprocess.run(command).returncode != 0:
            raise SystemExit("the simulator does not compile; the compiler's message is above")
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform}"
        build_data["force_include"][str(library)] = "ges/simulator/libges.so"
