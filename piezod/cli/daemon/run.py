"""`piezod run`: the daemon of a stage, in the foreground."""

import faulthandler
from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.exit_codes import FAILED
from piezod.cli.options import ConfigArgument
from piezod.daemon.lock import Lock
from piezod.daemon.paths import stage_paths
from piezod.daemon.supervisor.signals import Signals, noted_signals


def run(
    config: ConfigArgument,
    strict_rt: Annotated[
        bool, typer.Option("--strict-rt", help="Refuse to arm if the loop is not real-time.")
    ] = False,
    require_device: Annotated[
        bool, typer.Option("--require-device", help="Exit with 69 if a device is absent.")
    ] = False,
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Compute everything, never write a voltage.")
    ] = False,
) -> None:
    """Run the daemon of a stage until Ctrl-C or SIGTERM.

    The name of the stage is that of the configuration file without the ending. Nothing is driven
    before `piezod arm`. At the end the voltage ramps to the safe voltage. Exits with 75 if a daemon
    of the stage runs already, with 1 if its loop ended by itself, and with 74 if the stage could
    not be ramped down then: the last lines say which voltage stays on which axis.
    """
    with noted_signals() as signals:  # first of all: from now on they request an orderly end
        in_order = _run(config, strict_rt, require_device, shadow, signals)
    if not in_order:
        raise typer.Exit(FAILED)


def _run(
    config: Path, strict_rt: bool, require_device: bool, shadow: bool, signals: Signals
) -> bool:
    faulthandler.enable(2)  # prints a traceback if systemd's watchdog ends the process
    paths = stage_paths(config)
    paths.make_folders()
    with Lock(paths.lock):
        # Imported after the lock: a refused second daemon must not load the machine beside a loop.
        from piezod.daemon.supervisor.run import run_stage
        from piezod.daemon.supervisor.terms import RunOptions

        options = RunOptions(strict_rt, require_device, shadow)
        return run_stage(config, options, paths, signals)
