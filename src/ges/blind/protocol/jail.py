"""A process that can read what it was given and nothing else, for good.

Two walls stand. The kernel's Landlock (Linux 5.13 or later, no privilege needed) also holds for C
code. An audit hook of the interpreter holds everywhere, and also stops the starting of other
programs.
"""

from __future__ import annotations

import ctypes
import os
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path

# Linux's own numbers of system calls, rights and an option of prctl: libc has no names for Landlock
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
NO_NEW_PRIVILEGES = 38
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1, 2, 4, 8
# REFER came with Landlock's version 2, TRUNCATE with 3, TCP (bind, connect) with 4
REFER, TRUNCATE = 1 << 13, 1 << 14
ON_FILES = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE
READ = EXECUTE | READ_FILE | READ_DIR
ALL_TCP = 3
SYSTEM = (
    "/usr/lib",
    "/lib",
    "/lib64",
    "/usr/share",
    "/usr/local/lib",
    "/etc",
    "/dev/null",
    "/dev/urandom",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/sys/devices/system/cpu",
)
OWN = Path(__file__).resolve().parents[3]
"""Where this package is imported from."""
FORBIDDEN = (
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.spawn",
    "socket.connect",
)
WATCHED = (
    "open",
    "os.listdir",
    "os.scandir",
    "os.chdir",
    "os.rename",
    "os.remove",
    "os.link",
    "os.symlink",
    "ctypes.dlopen",
)


class _Ruleset(ctypes.Structure):
    _fields_ = [("files", ctypes.c_uint64), ("net", ctypes.c_uint64)]


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = [("access", ctypes.c_uint64), ("fd", ctypes.c_int32)]


def interpreter() -> list[Path]:
    """Return what Python and its packages need to be read from.

    Returns
    -------
    Files and folders, without any that would show the generator of cases.
    """
    paths = sysconfig.get_paths()
    roots = {paths[k] for k in ("stdlib", "platstdlib", "purelib", "platlib")} | {
        os.path.join(sys.base_prefix, "lib"),
        *SYSTEM,
    }
    # paths of the interpreter, but none that would show the generator of cases
    roots |= {
        p
        for p in sys.path
        if p and os.path.isdir(p) and not (OWN.is_relative_to(Path(p).resolve()) or _other(p))
    }
    return sorted(Path(p).resolve() for p in roots if os.path.exists(p))


def _other(path: str) -> bool:
    """Whether the sources of another installation lie here, with its generator of cases."""
    return os.path.isdir(os.path.join(path, "ges", "blind"))


def package() -> list[Path]:
    """Return the readable part of this package.

    Returns
    -------
    Its files without the generator of cases, and the folder of the compiled simulator.
    """
    from ges.simulator._lib import library_path

    root = Path(__file__).resolve().parents[2]
    parts = [p for p in root.iterdir() if p.name not in ("blind", "__pycache__")]
    return [*sorted(parts), library_path().resolve().parent]


def lock_in(readable: Iterable[Path], writable: Iterable[Path]) -> bool:
    """Give up all other files for the rest of this process and its children.

    Parameters
    ----------
    readable : files and folders (with all in them) that may be read.
    writable : folders in which all may be done.

    Returns
    -------
    Whether the kernel enforces it; the interpreter's audit hook always does.

    Raises
    ------
    OSError
        When the kernel refuses a rule.
    """
    listed = Path(__file__).resolve().parents[2]
    readable = [Path(p).resolve() for p in readable]
    writable = [Path(p).resolve() for p in writable]
    kernel = _landlock(readable, writable, listed)
    _hook([str(p) for p in (*readable, *writable)], str(listed))
    return kernel


def _landlock(readable: list[Path], writable: list[Path], listed: Path) -> bool:
    if not sys.platform.startswith("linux"):
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    # the flag 1 asks which version the kernel has
    version = libc.syscall(CREATE_RULESET, None, 0, 1)
    if version < 1:
        return False
    # a right that this kernel does not know would make it refuse the whole set
    everything = (1 << 13) - 1 | (REFER if version >= 2 else 0) | (TRUNCATE if version >= 3 else 0)
    rules = _Ruleset(everything, ALL_TCP if version >= 4 else 0)
    ruleset = libc.syscall(CREATE_RULESET, ctypes.byref(rules), 16 if version >= 4 else 8, 0)
    # imports list the package's folder; what may be read in it has rules of its own
    for path, access in [
        *((p, READ) for p in readable),
        *((p, everything) for p in writable),
        (listed, READ_DIR),
    ]:
        _allow(libc, ruleset, path, access & everything)
    # without privilege the kernel locks only those who can gain no more of it
    locked = (
        libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0
        and libc.syscall(RESTRICT_SELF, ruleset, 0) == 0
    )
    os.close(ruleset)
    return locked


def _allow(libc: ctypes.CDLL, ruleset: int, path: Path, access: int) -> None:
    fd = os.open(path, os.O_PATH | os.O_CLOEXEC)
    # rights of folders on a file are refused
    rule = _Beneath(access if path.is_dir() else access & ON_FILES, fd)
    failed = libc.syscall(ADD_RULE, ruleset, 1, ctypes.byref(rule), 0)
    os.close(fd)
    if failed:
        raise OSError(ctypes.get_errno(), f"the kernel refuses a rule for {path}")


def _hook(allowed: list[str], listed: str) -> None:
    realpath, fspath, sep = os.path.realpath, os.fspath, os.sep

    def within(path: str) -> bool:
        return any(path == root or path.startswith(root + sep) for root in allowed)

    def guard(event: str, arguments: tuple) -> None:
        if event in FORBIDDEN or event.startswith(FORBIDDEN):
            raise PermissionError(f"a diagnosis under test may not do '{event}'")
        if (
            # a number is a file that is open already
            event not in WATCHED
            or not arguments
            or isinstance(arguments[0], int)
            or arguments[0] is None
        ):
            return
        path = realpath(os.fsdecode(fspath(arguments[0])))
        # a bare name is looked for among the system's libraries, by the loader
        if event == "ctypes.dlopen" and sep not in str(arguments[0]):
            return
        if not within(path) and not (event in ("os.listdir", "os.scandir") and path == listed):
            raise PermissionError(f"a diagnosis under test may not reach {path}")

    sys.addaudithook(guard)
