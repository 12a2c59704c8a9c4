"""`piezod run`: the daemon of a stage, in the foreground."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.exit_codes import FAILED
from piezod.cli.paths import existing_file

if TYPE_CHECKING:
    from piezod.daemon.supervisor.signals import Signals


def run(
    config: Annotated[
        Path,
        typer.Argument(
            metavar="CONFIG",
            help="Configuration of the stage, YAML; its name is that of the stage.",
            readable=False,
            callback=existing_file,
        ),
    ],
    strict_rt: Annotated[
        bool, typer.Option("--strict-rt", help="Refuse to arm where the loop is not real-time.")
    ] = False,
    require_device: Annotated[
        bool, typer.Option("--require-device", help="End with 69 where a device is absent.")
    ] = False,
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Compute everything, never write a voltage.")
    ] = False,
) -> None:
    """Run the daemon of a stage until Ctrl-C or SIGTERM.

    Nothing is driven before `piezod arm`. On the way out the voltage goes to the safe one. Exits
    with 75 where the stage has a daemon already, and with 1 where its loop ended by itself.
    """
    from piezod.daemon.supervisor.signals import noted_signals

    with noted_signals() as signals:  # before all else: from now on they mean an orderly end
        in_order = _run(config, strict_rt, require_device, shadow, signals)
    if not in_order:
        raise typer.Exit(FAILED)


def _run(
    config: Path, strict_rt: bool, require_device: bool, shadow: bool, signals: "Signals"
) -> bool:
    import faulthandler

    from piezod.daemon.lock import Lock
    from piezod.daemon.paths import stage_paths

    faulthandler.enable(2)  # says where we were when systemd's watchdog ends us
    paths = stage_paths(config)
    paths.make_folders()
    with Lock(paths.lock) as lock:
        # Imported only now: whoever comes second shall not keep the machine busy beside a loop.
        from piezod.daemon.supervisor.run import run_stage
        from piezod.daemon.supervisor.terms import RunOptions

        options = RunOptions(strict_rt, require_device, shadow)
        return run_stage(config, options, paths, lock, signals)
