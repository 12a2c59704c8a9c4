"""The `piezod` command: how it starts, and the exit codes of errors.

The subcommands stand in `piezod.cli.verbs`. A subcommand is imported when it runs.
"""

import atexit
import gc
import os
import signal
import sys
from io import TextIOWrapper
from typing import Annotated, Any, Final

import typer

import piezod
from piezod.cli.exit_codes import exit_code, text_of
from piezod.cli.interrupt import INTERRUPTED, TEXT, Interrupted, interruptible
from piezod.cli.lazy import Family, commands_of
from piezod.cli.verbs import FAMILIES, VERBS
from piezod.errors import PiezodError


class Program(Family):
    """All commands."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**{**attributes, "commands": commands_of(VERBS.values(), FAMILIES)})


# Plain help and plain tracebacks, because rich doubles the time that help takes.
app = typer.Typer(
    cls=Program,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 ok, 2 usage or no such FILE, 69 device or daemon unavailable, 74 a "
    "stage is not at its safe voltage, 75 already running, 77 permission, 78 configuration, 130 "
    "interrupted, 1 anything else. Errors go to stderr; so does progress, on a terminal.",
)
_UTF8_MODE: Final = "PYTHONUTF8"


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"piezod {piezod.__version__} ({piezod.build()})")
        raise typer.Exit


@app.callback()
def _piezod(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Drive a piezo stage along its command, with its hysteresis compensated."""


def _require_utf8() -> None:
    """Start this process again in Python's UTF-8 mode if its locale has only ASCII.

    Otherwise an umlaut in a path could neither be stored in a file nor be sent.
    """
    if sys.getfilesystemencoding() == "ascii" and os.environ.get(_UTF8_MODE) != "1":
        command = [sys.executable, *sys.orig_argv[1:]]
        os.execve(sys.executable, command, {**os.environ, _UTF8_MODE: "1"})  # noqa: S606 - itself


def run() -> None:
    """Run the command with the arguments of this process and exit; the entry point of `piezod`."""
    _require_utf8()
    # The matrices of a fit are small, and several threads would mostly wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Whatever the umask is, no other user may write what piezod makes.
    os.umask(os.umask(0o077) | 0o002)
    # pydantic would search all installed packages for plugins; our models need none.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # Otherwise Python visits every object once more at its end, a tenth of a short command.
    atexit.register(gc.freeze)
    # Bytes of a path that are not text are printed as "?".
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        with interruptible():
            app(prog_name="piezod")
    except Interrupted:
        # A second Ctrl-C would end the end of Python, with a traceback or by the signal.
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
        typer.echo(TEXT, err=True)
        sys.exit(INTERRUPTED)
    except (PiezodError, OSError) as error:
        typer.echo(text_of(error), err=True)
        sys.exit(exit_code(error))


if __name__ == "__main__":
    run()
