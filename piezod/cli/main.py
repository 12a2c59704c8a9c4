"""The `piezod` command: its subcommands, and the exit codes of errors.

The modules of the subcommands import heavy libraries inside functions, so that `--help` is quick.
"""

import atexit
import gc
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from io import TextIOWrapper
from typing import Annotated, Final

import typer

import piezod
from piezod.cli.check import check
from piezod.cli.client_verbs import add_client_verbs
from piezod.cli.commission import commission
from piezod.cli.demo import demo
from piezod.cli.drivers import drivers
from piezod.cli.emulate import emulate
from piezod.cli.exit_codes import exit_code, text_of
from piezod.cli.experiment import experiment
from piezod.cli.export import export
from piezod.cli.gcs import gcs
from piezod.cli.group import group_verbs
from piezod.cli.grouped_help import GroupedHelp
from piezod.cli.identify import identify
from piezod.cli.init import init
from piezod.cli.install_service import install_service
from piezod.cli.interrupt import INTERRUPTED, TEXT, Interrupted, interruptible
from piezod.cli.ioc import ioc
from piezod.cli.list_stages import list_running
from piezod.cli.play import play
from piezod.cli.plot import plot
from piezod.cli.probe import probe
from piezod.cli.replay import replay
from piezod.cli.response import response
from piezod.cli.run import run as run_daemon
from piezod.cli.safe import safe
from piezod.cli.web import web
from piezod.errors import PiezodError

# Plain help and plain tracebacks, because rich doubles the time that help takes.
app = typer.Typer(
    cls=GroupedHelp,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 ok, 2 usage or no such FILE, 69 device or daemon unavailable, 74 a "
    "stage is not at its safe voltage, 75 already running, 77 permission, 78 configuration, 130 "
    "interrupted, 1 anything else. Errors go to stderr; so does progress, on a terminal.",
)
OWN_VERBS: Final[Mapping[str, Sequence[Callable[..., None]]]] = {
    "Experiments and models": (demo, experiment, identify, response, play, check),
    "Recordings": (plot, export, replay),
    "Devices": (drivers, emulate, probe, commission),
    "Daemon of a stage": (init, run_daemon, safe, web, gcs, ioc, install_service),
}
"""Commands that need no running daemon, by their heading in help."""
_UTF8_MODE: Final = "PYTHONUTF8"
SEVERAL: Final = "Several stages"
"""Heading of the commands for all stages of this machine."""
for heading, verbs in OWN_VERBS.items():
    for verb in verbs:
        app.command(rich_help_panel=heading)(verb)
app.command("list", rich_help_panel=SEVERAL)(list_running)
app.add_typer(group_verbs(), name="group", rich_help_panel=SEVERAL)
add_client_verbs(app)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"piezod {piezod.__version__}")
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
