"""``ges ui``: a local web page to drop flight logs on."""

from __future__ import annotations

import contextlib
import socket
import tempfile
from pathlib import Path

import click

from ges.commands import OPEN
from ges.commands.diagnose import at_a_display
from ges.errors import GesError

LOOPBACK = "127.0.0.1"


@click.command()
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Where logs and diagnoses are kept; made where it is not there.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8765,
    show_default=True,
    help="Port on 127.0.0.1; 0 takes one that is free.",
)
@click.option(
    "--limit",
    "limit_mb",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    metavar="MB",
    help="What the files of one upload may have together.",
)
@OPEN
def command(folder: Path, port: int, limit_mb: int, opened: bool | None) -> None:
    """Serve a page to drop flight logs on.

    It shows what is in them, which vehicle flew, the diagnosis as it goes on, and two of them side
    by side. Only this computer reaches it, it reaches no other, and what is dropped stays in the
    folder. Ctrl-C ends it.

    Example: ges ui --folder flights
    """
    import uvicorn

    from ges.ui.app import make_app

    app = make_app(folder, limit_mb)
    with _listening(port) as listener, tempfile.TemporaryDirectory(dir=folder) as parts:
        # An upload that is not complete lies in the user's folder, too.
        tempfile.tempdir = parts
        address = f"http://{LOOPBACK}:{listener.getsockname()[1]}/"
        click.echo(f"{address} keeps logs and diagnoses in {folder}; Ctrl-C ends it", err=True)
        if at_a_display() if opened is None else opened:
            click.launch(address)
        config = uvicorn.Config(
            app, log_level="warning", timeout_graceful_shutdown=1, server_header=False
        )
        # It raises Ctrl-C again once it has ended in good order.
        with contextlib.suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listener])


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise GesError(
            f"cannot listen on port {port}: {error.strerror}; take another with --port"
        ) from None
