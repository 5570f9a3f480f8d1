"""The command line: one verb, one module in ``ges.commands``, imported only when it is used."""

from __future__ import annotations

import contextlib
import importlib
import io
import keyword
import os
import pkgutil
import signal
import sys
from collections.abc import Iterator
from types import FrameType

import click

from ges import __version__, commands
from ges.errors import GesError, unknown_name
from ges.files import require_text

INTERRUPTED = 130
"""As shells have it: 128 and the number of the signal."""


class LazyGroup(click.Group):
    """A click group that imports a command only when it is used.

    Notes
    -----
    Each module of ``ges.commands`` is one command, its attribute ``command``. A module of a Python
    keyword ends with an underscore: ``import_``.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the modules of ``ges.commands``, sorted, without importing them."""
        return sorted(m.name.rstrip("_") for m in pkgutil.iter_modules(commands.__path__))

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import a command by name; None where there is no such command."""
        if name not in self.list_commands(ctx):
            return None
        module = name + "_" if keyword.iskeyword(name) else name
        return importlib.import_module(f"ges.commands.{module}").command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that was typed; an unknown one is told the nearest."""
        known, typed = self.list_commands(ctx), args[0]
        if typed not in known and not typed.startswith("-") and not ctx.resilient_parsing:
            raise unknown_name("command", typed, known)
        return super().resolve_command(ctx, args)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def cli() -> None:
    """Simulate multirotors near irregular ground, and diagnose why real flights differ."""


def main() -> None:
    """Run the command line, and end the process with its exit status.

    Errors are printed to stderr in one sentence, without a traceback.

    Raises
    ------
    SystemExit
        With 0 if it succeeded, 1 if it failed, 2 for wrong use, 130 if interrupted.
    """
    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # the same bytes whatever the number of cores, and in half the time
    # a terminal of another alphabet has a question mark for what it cannot show
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        with _interrupts_kept():
            for word in sys.argv[1:]:
                require_text(word)
            sys.exit(cli(standalone_mode=False))
    except GesError as error:
        click.echo(f"ges: {error}", err=True)
        sys.exit(error.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except click.Abort:
        click.echo("ges: interrupted; what was not finished is not there", err=True)
        sys.exit(INTERRUPTED)
    except OSError as error:
        # without a number of the system's it is no file's fault, but a mistake of the program
        if error.errno is None:
            raise
        file = f" {error.filename}" if error.filename else ""
        click.echo(f"ges: cannot read or write{file}: {os.strerror(error.errno)}", err=True)
        sys.exit(1)
    except MemoryError:
        click.echo("ges: this takes more memory than there is; give less of it at a time", err=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        module = (error.name or "ges").partition(".")[0]
        if module == "ges":
            raise
        from ges.extras import install_command_for

        click.echo(f"ges: {module} is not installed; run {install_command_for(module)}", err=True)
        sys.exit(1)


@contextlib.contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Make an interrupt ``click.Abort``, whatever error a library made of it."""
    interrupts = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)
        signal.default_int_handler(number, frame)

    # who has it ignored, as a shell of what runs in the background, is not interrupted
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    # compiled modules that are being imported make errors of their own of an interrupt
    except Exception as error:
        if interrupts:
            raise click.Abort from error
        raise
