"""Damage real logs at random: whatever a reader meets, it reads the log or refuses it in one
sentence.

By hand, for minutes:  python tests/recordings/mutate.py --seconds 300 LOG...
"""

from __future__ import annotations

import argparse
import collections
import signal
import tempfile
import time
import traceback
import warnings
from pathlib import Path

import numpy as np

from ges.errors import GesError
from ges.recordings.consistency import agreements
from ges.recordings.readers import Options, open_log
from ges.recordings.recording import checked_frame

LONGEST_S = 60  # of one mutant; a reader that takes longer hangs
HEAD = 8192  # bytes in which formats define themselves


class Hang(BaseException):
    """A reader that does not end."""


def mutant(data: bytes, rng: np.random.Generator) -> bytes:
    """The log with bytes changed, cut out, doubled, or an end missing; half of the damage near the
    beginning, where formats define themselves.
    """
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        reach = min(len(out), HEAD) if rng.random() < 0.5 else len(out)
        at = int(rng.integers(0, max(1, reach)))
        length = int(rng.integers(1, 33))
        match int(rng.integers(0, 6)):
            case 0:
                out[at : at + length] = rng.bytes(length)
            case 1:
                del out[at : at + length]
            case 2:
                out[at:at] = out[at : at + length]
            case 3:
                out[at : at + length] = bytes([int(rng.choice([0, 255, 127, 128]))]) * length
            case 4 if at < len(out):
                out[at] ^= 1 << int(rng.integers(0, 8))
            case 5 if rng.random() < 0.3:
                del out[at:]
    return bytes(out)


def outcome(path: Path, options: Options) -> str:
    """``read``, ``refused``, or the traceback of what is no sentence."""
    previous = signal.signal(signal.SIGALRM, _hang)
    signal.alarm(LONGEST_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            frame = open_log(path, options).frame()
            checked_frame(path.stem, frame)
            agreements(frame)
    except GesError as error:
        return "refused" if "\n" not in str(error) else f"two lines: {error}"
    except (Exception, Hang):
        return traceback.format_exc()
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)
    return "read"


def _hang(*_) -> None:
    raise Hang(f"not done after {LONGEST_S} s")


def damage(
    log: Path, options: Options, seconds: float, seed: int = 1, size: int | None = None
) -> tuple[collections.Counter, int]:
    """Mutate one log for some seconds; outcomes by kind, and how many mutants there were.

    Parameters
    ----------
    size : take the first bytes of the log only, so that a mutant is read in no time.
    """
    data, rng = log.read_bytes()[:size], np.random.default_rng(seed)
    found: collections.Counter = collections.Counter()
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        while time.monotonic() < end or not found:
            path = Path(folder) / log.name
            path.write_bytes(mutant(data, rng))
            found[outcome(path, options)] += 1
    return found, found.total()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--size", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--map")
    given = parser.parse_args()
    for log in given.logs:
        options = Options(mapping=given.map)
        found, count = damage(log, options, given.seconds, given.seed, given.size)
        bad = {what: n for what, n in found.items() if what not in ("read", "refused")}
        print(
            f"{log.name}: {count} mutants, {found['read']} read, {found['refused']} refused,"
            f" {sum(bad.values())} no sentence",
            flush=True,
        )
        for what, n in collections.Counter(bad).most_common(8):
            print(f"--- {n} times\n{what}")


if __name__ == "__main__":
    main()
