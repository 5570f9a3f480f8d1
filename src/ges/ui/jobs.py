"""Commands of ``ges`` in child processes.

The page learns of a log or a diagnosis from the command line. A file that crashes the command
crashes nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import sys
import time
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ges.ui.folder import Diagnosed

GES = (sys.executable, "-P", "-c", "from ges.cli import main; main()")
"""The command line of this installation; -P, because a log could be called ``numpy.py``."""
LONGEST_COMMAND_S = 300.0
"""After which a verb that the page waits for is ended."""
_STEP = re.compile(r"(.+): (\d+\.\d) s")


@dataclass(frozen=True)
class Ended:
    """A command that has ended.

    Attributes
    ----------
    code : exit status.
    out, err : what it wrote to stdout and stderr.
    """

    code: int
    out: str
    err: str

    @property
    def problem(self) -> str:
        """One sentence on what went wrong, as the command wrote it."""
        lines = [line for line in self.err.splitlines() if line.strip()]
        # what GES and click say on purpose; the last line of a traceback where neither spoke
        errors = [line.removeprefix("ges: ") for line in lines if line.startswith("ges: ")]
        errors += [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
        if errors:
            return errors[-1]
        last = lines[-1] if lines else f"exit code {self.code}"
        return f"an internal error of GES, which is worth a report: {last}"


async def _start(words: Sequence[str], cwd: Path) -> asyncio.subprocess.Process:
    # Lines that are read here must not be wrapped for a terminal.
    quiet = {**os.environ, "COLUMNS": "10000", "NO_COLOR": "1"}
    pipe = asyncio.subprocess.PIPE
    return await asyncio.create_subprocess_exec(
        *GES,
        *words,
        cwd=cwd,
        env=quiet,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=pipe,
        stderr=pipe,
        # a group of its own, to be ended with all that it starts; lines may be long
        start_new_session=True,
        limit=2**20,
    )


async def _end(process: asyncio.subprocess.Process) -> None:
    """Kill a command with the processes that it started."""
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        await process.wait()


async def ask(words: Sequence[str], cwd: Path) -> Ended:
    """Run a command that takes little time.

    Parameters
    ----------
    words : command and arguments, without ``ges``.
    cwd : folder in which it runs.

    Returns
    -------
    What it wrote; after :data:`LONGEST_COMMAND_S` it is killed, with status 1.
    """
    process = await _start(words, cwd)
    try:
        out, err = await asyncio.wait_for(process.communicate(), LONGEST_COMMAND_S)
    except TimeoutError:
        return Ended(1, "", f"ges: no answer after {LONGEST_COMMAND_S:.0f} s; cut the log shorter")
    finally:
        await _end(process)
    return Ended(
        process.returncode or 0, out.decode(errors="replace"), err.decode(errors="replace")
    )


@dataclass
class Job:
    """A diagnosis that is running or was.

    Attributes
    ----------
    steps : ``what`` and ``seconds`` of each step that has ended.
    state : ``waiting``, ``running``, ``done``, ``failed`` or ``stopped``.
    problem : why it failed, one sentence; '' if it did not.
    news : notified when ``steps`` or ``state`` change.
    task : task that runs it; None before it is scheduled.
    """

    steps: list[dict[str, Any]] = field(default_factory=list)
    state: str = "waiting"
    problem: str = ""
    news: asyncio.Condition = field(default_factory=asyncio.Condition)
    task: asyncio.Task | None = None

    @property
    def over(self) -> bool:
        """Whether the diagnosis has ended, in whatever way."""
        return self.state not in ("waiting", "running")

    async def follow(self, first: int = 0) -> AsyncIterator[tuple[int, dict[str, Any]]]:
        """Wait for steps as they end.

        Parameters
        ----------
        first : number of the first step to give, from 0.

        Yields
        ------
        Number and content of each step, until the diagnosis is over.
        """
        while True:
            for number in range(first, len(self.steps)):
                yield number, self.steps[number]
            first = max(first, len(self.steps))
            if self.over:
                return
            async with self.news:
                while len(self.steps) <= first and not self.over:
                    await self.news.wait()


class Jobs:
    """Queue of diagnoses, one at a time, as each keeps a processor busy."""

    def __init__(self) -> None:
        self._jobs: dict[str, Job] = {}
        self._turn = asyncio.Semaphore(1)

    def get(self, key: str) -> Job | None:
        """Find the job of a diagnosis.

        Parameters
        ----------
        key : id of the diagnosis.

        Returns
        -------
        The job; None if it was not begun since the server started.
        """
        return self._jobs.get(key)

    def begin(self, diagnosis: Diagnosed, words: Sequence[str], cwd: Path) -> None:
        """Queue a diagnosis, to begin once those before it are over.

        Parameters
        ----------
        diagnosis : its ``about.json`` gets state, problem, steps and seconds at the end.
        words, cwd : as of :func:`ask`.
        """
        job = self._jobs[diagnosis.id] = Job()
        job.task = asyncio.create_task(self._work(job, diagnosis, words, cwd))

    async def stop(self, key: str) -> None:
        """Stop a diagnosis that is queued or running; nothing happens to others.

        Parameters
        ----------
        key : id of the diagnosis.
        """
        job = self._jobs.get(key)
        if job and job.task and not job.over:
            job.task.cancel()
            await asyncio.wait([job.task])

    async def close(self) -> None:
        """Stop all diagnoses that are queued or running."""
        for key in list(self._jobs):
            await self.stop(key)

    async def _work(self, job: Job, diagnosis: Diagnosed, words: Sequence[str], cwd: Path) -> None:
        state, began = "stopped", time.monotonic()
        try:
            async with self._turn:
                job.state, began = "running", time.monotonic()
                ended = await self._run(job, words, cwd)
            state = "failed" if ended.code else "done"
            job.problem = ended.problem if ended.code else ""
        finally:
            seconds = round(time.monotonic() - began, 1)
            # written down before the state changes: a page that reloads at the end reads it there
            diagnosis.note(state=state, problem=job.problem, steps=job.steps, seconds=seconds)
            async with job.news:
                job.state = state
                job.news.notify_all()

    async def _run(self, job: Job, words: Sequence[str], cwd: Path) -> Ended:
        process = await _start(words, cwd)
        assert process.stdout and process.stderr
        try:
            # read meanwhile: a pipe that nobody empties would hold the verb up
            out = asyncio.create_task(process.stdout.read())
            lines = []
            async for line in process.stderr:
                lines.append(line.decode(errors="replace").rstrip())
                # a line a step, as ges diagnose says it on stderr
                step = _STEP.fullmatch(lines[-1])
                if step:
                    async with job.news:
                        job.steps.append({"what": step[1], "seconds": float(step[2])})
                        job.news.notify_all()
            output = (await out).decode(errors="replace")
            return Ended(await process.wait(), output, "\n".join(lines))
        finally:
            await _end(process)
