"""The web application behind ``ges ui``.

Pages are made by the server. One script does what a form cannot do. Steps of a diagnosis come as
server-sent events.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import tempfile
from collections.abc import AsyncIterator
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from starlette.applications import Starlette
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.body_limit import RequestBodyLimitMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    RedirectResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route

from ges import __version__
from ges.diagnose.report import compare
from ges.diagnose.report.page import VERDICTS
from ges.diagnose.report.saved import load_diagnosis
from ges.errors import GesError, UsageError
from ges.examine import sentences
from ges.recordings import published
from ges.recordings.readers import READERS
from ges.recordings.readers.maps import preset_names
from ges.ui import asking, guard
from ges.ui.folder import Diagnosed, Logs, Workspace
from ges.ui.jobs import Jobs, ask
from ges.vehicle import library
from ges.vehicle.layouts import LAYOUTS

MOST_FILES = 100
"""Files of one upload."""
RESULTS = {
    "report.html": "the page",
    "diagnosis.json": "the same for programs",
    "vehicle.fitted.yaml": "the vehicle with what was found, for ges simulate",
    "vehicle.yaml": "the vehicle as it was made from the log",
    "residuals.parquet": "recorded and simulated signals over time, for PlotJuggler and others",
}
"""What is in the files of a diagnosis that are not figures."""


@functools.lru_cache(maxsize=1)
def templates() -> jinja2.Environment:
    """Load the templates of the pages.

    Returns
    -------
    The environment, which is made once. A misspelt name in a template is an error.
    """
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("ges.ui"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        # a word that is misspelt in a template is an error, and not a gap on the page
        undefined=jinja2.StrictUndefined,
    )
    made.globals["version"] = __version__
    made.filters["when"] = lambda iso: f"{datetime.fromisoformat(iso):%d %B, %H:%M}"
    made.filters["kilobytes"] = lambda count: f"{max(count / 1e3, 1.0):,.0f} kB"
    return made


def page(template: str, status: int = 200, **content: Any) -> HTMLResponse:
    """Render one of the server's own pages.

    Parameters
    ----------
    template : name of the template.
    status : HTTP status.
    **content : values of the names in the template.
    """
    return HTMLResponse(templates().get_template(template).render(content), status)


def make_app(folder: Path, limit_mb: int) -> Starlette:
    """Make the application.

    Parameters
    ----------
    folder : folder for logs and diagnoses, made where it is missing.
    limit_mb : largest size of one upload, megabytes.

    Returns
    -------
    The application, which refuses foreign pages and large uploads.

    Raises
    ------
    GesError
        When the folder cannot be made.
    """
    pages = Pages(Workspace(folder), limit_mb * 1_000_000)
    return Starlette(
        routes=pages.routes(),
        middleware=[
            # the outermost first: what comes by a foreign name or page, or states that it is too
            # large, is not read; the last counts the bytes of what states nothing
            Middleware(TrustedHostMiddleware, allowed_hosts=guard.HOSTS, www_redirect=False),
            Middleware(guard.Guard, limit_bytes=pages.limit_bytes),
            Middleware(RequestBodyLimitMiddleware, max_body_size=pages.limit_bytes),
        ],
        exception_handlers={
            GesError: _refused,
            HTTPException: _refused,
            KeyError: _missing,
            Exception: _broken,
        },
        lifespan=pages.lifespan,
    )


async def _refused(_: Request, error: Exception) -> Response:
    """Show the one sentence of an error."""
    status = error.status_code if isinstance(error, HTTPException) else 400
    words = error.detail if isinstance(error, HTTPException) else str(error)
    return page("problem.html.j2", status, words=words)


async def _missing(_: Request, error: Exception) -> Response:
    return page(
        "problem.html.j2",
        404,
        words="There are no such logs and no such diagnosis in this folder; go back to the start.",
    )


async def _broken(_: Request, error: Exception) -> Response:
    words = f"An internal error of GES, which is worth a report: {error!r}"
    return page("problem.html.j2", 500, words=words)


class Pages:
    """Handlers of the server's addresses.

    A handler takes a request and returns a response. KeyError, for an unknown id or file, becomes a
    page with status 404; GesError one with status 400.

    Parameters
    ----------
    workspace : where logs and diagnoses are kept.
    limit_bytes : largest size of one upload.
    """

    def __init__(self, workspace: Workspace, limit_bytes: int) -> None:
        self.workspace, self.limit_bytes, self.jobs = workspace, limit_bytes, Jobs()
        # a page that is opened twice waits for the first answer, and does not ask again
        self._doctor = asyncio.Lock()

    def routes(self) -> list[Route]:
        """List the addresses and their handlers.

        Returns
        -------
        Routes; those that change something take POST alone.
        """
        post = functools.partial(Route, methods=["POST"])
        return [
            Route("/", self.start),
            Route("/static/{name}", self.static),
            post("/logs", self.drop),
            post("/example", self.example),
            Route("/logs/{id}", self.logs),
            post("/logs/{id}/files", self.drop_more),
            post("/logs/{id}/reading", self.reading),
            post("/logs/{id}/vehicle", self.vehicle),
            post("/logs/{id}/diagnose", self.diagnose),
            Route("/diagnoses/{id}", self.diagnosis),
            Route("/diagnoses/{id}/events", self.events),
            post("/diagnoses/{id}/stop", self.stop),
            Route("/diagnoses/{id}/report", self.report),
            Route("/diagnoses/{id}/results.zip", self.archive),
            Route("/diagnoses/{id}/results/{name}", self.result),
            Route("/compare", self.compare),
        ]

    @contextlib.asynccontextmanager
    async def lifespan(self, _: Starlette) -> AsyncIterator[None]:
        """Stop what is running when the server ends.

        Yields
        ------
        Once, while the server runs.
        """
        yield
        await self.jobs.close()

    # What was dropped.

    async def start(self, _: Request) -> Response:
        """Show the first page: a place to drop logs on, and what is there already."""
        return page(
            "start.html.j2",
            folder=self.workspace.folder,
            limit_bytes=self.limit_bytes,
            most_files=MOST_FILES,
            formats=[reader.title for reader in READERS],
            logs=self.workspace.all_logs(),
            diagnoses=[self._shown(d) for d in self.workspace.all_diagnoses()],
        )

    async def static(self, request: Request) -> Response:
        """Send the script or the style sheet.

        Raises
        ------
        KeyError
            When the address names another file.
        """
        name = request.path_params["name"]
        kinds = {"ui.js": "text/javascript", "ui.css": "text/css"}
        if name not in kinds:
            raise KeyError(name)
        text = resources.files("ges.ui").joinpath(name).read_text("utf-8")
        # one style sheet for the server's pages and for reports
        if name == "ui.css":
            style = resources.files("ges.diagnose.report").joinpath("page.css").read_text("utf-8")
            text = style + text
        return Response(text, media_type=kinds[name])

    async def drop(self, request: Request) -> Response:
        """Keep new logs, and go on to their page.

        Parameters
        ----------
        request : form field ``files``, at most :data:`MOST_FILES`.

        Raises
        ------
        UsageError
            When no file came, or all are empty.
        """
        files = await self._uploaded(request)
        return _see(await self._keep(self.workspace.new_logs(), files))

    async def drop_more(self, request: Request) -> Response:
        """Add files to logs that are there, and go on to their page.

        Parameters
        ----------
        request : ``id`` of the logs in the address, form field ``files``.

        Raises
        ------
        KeyError
            When there are no such logs.
        UsageError
            When no file came, or all are empty.
        """
        logs = self.workspace.logs(request.path_params["id"])
        return _see(await self._keep(logs, await self._uploaded(request)))

    async def _uploaded(self, request: Request) -> list[UploadFile]:
        form = await request.form(max_files=MOST_FILES, max_fields=10)
        given = [f for f in form.getlist("files") if isinstance(f, UploadFile)]
        # a field that is left empty comes as a file without a name
        files = [f for f in given if f.filename and f.size]
        if not files:
            empty = ", ".join(f.filename for f in given if f.filename)
            raise UsageError(
                f"{empty} is empty; take a fresh copy from the vehicle"
                if empty
                else "no file came with this; choose a log, or drop one on the page"
            )
        return files

    async def _keep(self, logs: Logs, files: list[UploadFile]) -> str:
        for file in files:
            # copying a large file would hold up all other pages
            await asyncio.to_thread(logs.add, file.filename or "", file.file)
        return f"/logs/{logs.id}"

    async def example(self, _: Request) -> Response:
        """Keep the flights that the package ships, and go on to their page."""
        logs = self.workspace.new_logs()
        with tempfile.TemporaryDirectory() as folder:
            for path in published.fetch("example", Path(folder), None):
                if path.suffix in (".parquet", ".yaml"):
                    with path.open("rb") as content:
                        logs.add(path.name, content)
        return _see(f"/logs/{logs.id}")

    async def logs(self, request: Request) -> Response:
        """Show what ``ges doctor`` says of logs, and a form for their vehicle.

        Parameters
        ----------
        request : ``id`` of the logs in the address.

        Raises
        ------
        KeyError
            When there are no such logs.
        """
        logs = self.workspace.logs(request.path_params["id"])
        examined = await self._examined(logs)
        return page(
            "logs.html.j2",
            logs=logs,
            about=logs.about,
            examined=[{**f, "sentences": list(sentences(f))} for f in examined],
            usable=[f["name"] for f in examined if f["usable"]],
            library=[(name, library.title(name)) for name in library.names()],
            layouts=list(LAYOUTS),
            presets=preset_names(),
            limit_bytes=self.limit_bytes,
            most_files=MOST_FILES,
            diagnoses=[
                self._shown(d) for d in self.workspace.all_diagnoses() if d.about["logs"] == logs.id
            ],
        )

    async def _examined(self, logs: Logs) -> list[dict[str, Any]]:
        async with self._doctor:
            examined = logs.examined()
            if examined is None:
                names = logs.names()
                words = ["doctor", "--json", *asking.reading(logs, rotor_order=False)]
                ended = await ask([*words, "--", *names], logs.files) if names else None
                examined = _parse_examined(ended.out, ended.problem, names) if ended else []
                logs.keep_examined(examined)
        return examined

    async def reading(self, request: Request) -> Response:
        """Keep how the logs are to be read, and go on to their page.

        Parameters
        ----------
        request : ``id`` of the logs in the address, form of :func:`ges.ui.asking.checked_reading`.

        Raises
        ------
        KeyError
            When there are no such logs.
        UsageError
            When the form has a wrong value.
        """
        logs = self.workspace.logs(request.path_params["id"])
        logs.note(reading=asking.checked_reading(logs, await request.form(max_files=0)))
        logs.forget_examined()
        return _see(f"/logs/{logs.id}")

    async def vehicle(self, request: Request) -> Response:
        """Show the vehicle file that the form describes.

        Parameters
        ----------
        request : ``id`` of the logs in the address, form of :func:`ges.ui.asking.vehicle_words`.

        Raises
        ------
        KeyError
            When there are no such logs.
        GesError
            When the vehicle cannot be made; the sentence is that of ``ges vehicle``.
        """
        logs = self.workspace.logs(request.path_params["id"])
        form = await request.form(max_files=0)
        words = asking.vehicle_words(logs, form, await self._examined(logs))
        ended = await ask(words, logs.files)
        if ended.code:
            raise GesError(ended.problem)
        notes = [line.removeprefix("note: ") for line in ended.err.splitlines()]
        return page("vehicle.html.j2", logs=logs, text=ended.out, notes=notes)

    # What was diagnosed.

    async def diagnose(self, request: Request) -> Response:
        """Begin a diagnosis, and go on to its page.

        Parameters
        ----------
        request : ``id`` of the logs in the address, form of :func:`ges.ui.asking.diagnose_words`.

        Raises
        ------
        KeyError
            When there are no such logs.
        UsageError
            When the form has a wrong value.
        """
        logs = self.workspace.logs(request.path_params["id"])
        form = await request.form(max_files=0)
        words, chosen, vehicle = asking.diagnose_words(logs, form, await self._examined(logs))
        diagnosis = self.workspace.new_diagnosis(
            {"logs": logs.id, "files": chosen, "vehicle": vehicle, "state": "running"}
        )
        out = f"../../../diagnoses/{diagnosis.id}/results"
        words = ["diagnose", "--no-open", *words, "--out", out, "--", *chosen]
        self.jobs.begin(diagnosis, words, logs.files)
        return _see(f"/diagnoses/{diagnosis.id}")

    async def diagnosis(self, request: Request) -> Response:
        """Show the steps of a diagnosis, or what it found.

        Parameters
        ----------
        request : ``id`` of the diagnosis in the address.

        Raises
        ------
        KeyError
            When there is no such diagnosis.
        """
        shown = self._shown(self.workspace.diagnosis(request.path_params["id"]))
        return page(
            "diagnosis.html.j2",
            **shown,
            results=RESULTS,
            others=[
                other
                for other in map(self._shown, self.workspace.all_diagnoses())
                if other["state"] == "done" and other["id"] != shown["id"]
            ],
        )

    async def events(self, request: Request) -> Response:
        """Send steps as server-sent events, from the first that the page does not show.

        Parameters
        ----------
        request : ``id`` of the diagnosis in the address. The last known step is the header
            ``last-event-id`` or the query ``last``.

        Raises
        ------
        KeyError
            When there is no such diagnosis.
        """
        key = self.workspace.diagnosis(request.path_params["id"]).id
        # a browser that lost the connection says which step it saw last
        last = request.headers.get("last-event-id") or request.query_params.get("last", "")
        first = int(last) + 1 if last.isdecimal() and len(last) < 10 else 0
        return StreamingResponse(self._events(key, first), media_type="text/event-stream")

    async def _events(self, key: str, first: int) -> AsyncIterator[str]:
        job = self.jobs.get(key)
        if job:
            async for number, step in job.follow(first):
                yield f"id: {number}\nevent: step\ndata: {json.dumps(step)}\n\n"
        yield "event: over\ndata: {}\n\n"

    async def stop(self, request: Request) -> Response:
        """Stop a diagnosis that is running, and go on to its page.

        Parameters
        ----------
        request : ``id`` of the diagnosis in the address.

        Raises
        ------
        KeyError
            When there is no such diagnosis.
        """
        key = self.workspace.diagnosis(request.path_params["id"]).id
        await self.jobs.stop(key)
        return _see(f"/diagnoses/{key}")

    async def report(self, request: Request) -> Response:
        """Show the report of a diagnosis, as a page of no origin.

        Parameters
        ----------
        request : ``id`` of the diagnosis in the address.

        Raises
        ------
        KeyError
            When there is no such diagnosis, or it has no report.
        """
        path = self._result(request, "report.html")
        # shown here, but as a page of no origin: its words may come from a hostile log
        return FileResponse(path, headers={"content-security-policy": guard.REPORTS})

    async def result(self, request: Request) -> Response:
        """Send a file of a diagnosis as a download.

        Parameters
        ----------
        request : ``id`` of the diagnosis and ``name`` of the file in the address.

        Raises
        ------
        KeyError
            When there is no such diagnosis or file.
        """
        path = self._result(request, request.path_params["name"])
        return FileResponse(path, filename=path.name)

    def _result(self, request: Request, name: str) -> Path:
        diagnosis = self.workspace.diagnosis(request.path_params["id"])
        # only what is listed: no name leads out of the folder
        if name not in diagnosis.names():
            raise KeyError(name)
        return diagnosis.results / name

    async def archive(self, request: Request) -> Response:
        """Send all files of a diagnosis as one zip file.

        Parameters
        ----------
        request : ``id`` of the diagnosis in the address.

        Raises
        ------
        KeyError
            When there is no such diagnosis, or it is not done.
        """
        diagnosis = self.workspace.diagnosis(request.path_params["id"])
        if self._shown(diagnosis)["state"] != "done":
            raise KeyError(diagnosis.id)
        path = await asyncio.to_thread(diagnosis.archive)
        return FileResponse(path, filename=f"ges-{diagnosis.id[:6]}.zip")

    async def compare(self, request: Request) -> Response:
        """Show two diagnoses side by side.

        Parameters
        ----------
        request : ids of both as the query ``with``.

        Raises
        ------
        KeyError
            When there is no such diagnosis.
        UsageError
            When not exactly two are chosen.
        """
        # one that was ticked twice would be compared with itself
        keys = list(dict.fromkeys(request.query_params.getlist("with")))
        if len(keys) != 2:
            raise UsageError(f"{len(keys)} diagnoses are chosen; choose two to compare them")
        both = [self.workspace.diagnosis(key) for key in keys]
        first, second = (load_diagnosis(d.results) for d in both)
        names = [_name(d.about) for d in both]
        names = names if names[0] != names[1] else [f"{n} ({i})" for i, n in enumerate(names, 1)]
        text = compare.as_html(compare.compare(first, second, names))
        return HTMLResponse(text, headers={"content-security-policy": guard.REPORTS})

    def _shown(self, diagnosis: Diagnosed) -> dict[str, Any]:
        """Collect what the pages say of a diagnosis."""
        about, job = diagnosis.about, self.jobs.get(diagnosis.id)
        # every key that a template asks for, as templates are strict
        shown: dict[str, Any] = {
            "id": diagnosis.id,
            "name": _name(about),
            "verdict": "",
            "sentence": "",
        }
        shown |= {"problem": "", "steps": [], "seconds": 0.0, **about}
        shown["sizes"] = {n: (diagnosis.results / n).stat().st_size for n in diagnosis.names()}
        if job and not job.over:
            shown |= {"state": job.state, "steps": list(job.steps)}
        # it is written down as under way, and this server has no job of it: one before began it
        elif about["state"] == "running":
            shown |= {"state": "stopped", "problem": "the server ended before it did"}
        elif about["state"] == "done":
            try:
                content = load_diagnosis(diagnosis.results)
            except GesError as error:
                return {**shown, "state": "failed", "problem": str(error)}
            shown |= {"verdict": VERDICTS[content["verdict"]], "sentence": content["sentence"]}
        return shown


def _see(address: str) -> RedirectResponse:
    """Go on to a page, by GET."""
    return RedirectResponse(address, 303)


def _name(about: dict[str, Any]) -> str:
    """Name a diagnosis after its flights and vehicle."""
    first, *others = about["files"]
    more = f" and {len(others)} more" if others else ""
    return f"{first}{more}, {about['vehicle']}"


def _parse_examined(text: str, problem: str, names: list[str]) -> list[dict[str, Any]]:
    """Read what ``ges doctor --json`` wrote; where it failed, that."""
    with contextlib.suppress(json.JSONDecodeError):
        return [{**asking.UNREAD, **examined} for examined in json.loads(text)]
    return [{**asking.UNREAD, "name": name, "problem": problem} for name in names]
