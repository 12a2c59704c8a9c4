"""`piezod safe`: ramp a stage to its safe voltage without its daemon."""

from pathlib import Path
from typing import Annotated, Final

import typer

from piezod.cli.devices.owned_stage import LOCK_WAIT_S
from piezod.cli.options import ConfigArgument, JsonOption
from piezod.cli.output import print_json
from piezod.config.daemon import load_daemon
from piezod.daemon.lock import Lock, taken_within
from piezod.daemon.paths import StagePaths, stage_paths
from piezod.daemon.safe.ramp import AxisOutcome
from piezod.daemon.safe.rescue import Rescue
from piezod.devices import registry
from piezod.errors import ConfigError, StillDrivenError

_RUNS: Final = (
    "the daemon of this stage runs, as process {holder}: `piezod stop` ramps down; `kill {holder}` "
    "ramps down and ends it; `piezod safe` is for a stage without its daemon"
)


def safe(
    config: ConfigArgument,
    unless_clean: Annotated[
        bool,
        typer.Option("--unless-clean", help="Do nothing if the daemon ended in order."),
    ] = False,
    confirm_output: Annotated[
        bool,
        typer.Option(
            "--confirm-output",
            help="You have seen that the read-back is right, whatever was written last; without a "
            "read-back, that the output is at the safe voltage.",
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Ramp a stage to its safe voltage after its daemon has died.

    The ramp starts from the read-back voltage or, without a read-back, from the voltage that the
    daemon wrote last. If the two differ, nothing is written unless you confirm the read-back. The
    ramp waits up to 30 s for an output that does not follow. Nothing is written to another
    amplifier than the daemon's. Exits with 0 if all axes are at the safe voltage; otherwise with
    74, after a line for each other axis: UNKNOWN, the reason, and which voltage stays. Exits with
    75 if the daemon runs, or its loop process does not end.
    """
    paths = stage_paths(config)
    if unless_clean and not paths.running.exists():
        if json:
            _print_document({})
        else:
            typer.echo("the daemon ended in order: nothing to do")
        return
    paths.make_folders()
    _rescue(config, paths, confirmed=confirm_output, json=json)


def _rescue(config: Path, paths: StagePaths, *, confirmed: bool, json: bool) -> None:
    with taken_within(lambda: Lock(paths.lock, _RUNS), LOCK_WAIT_S):
        rescue = Rescue(_in_force(config, paths), paths)
        outcomes = rescue.ramp(confirmed=confirmed)
        if json:
            _print_document(outcomes)
        for line in () if json else rescue.reached(outcomes):
            typer.echo(line)
        if left := rescue.left(outcomes):
            raise StillDrivenError("\n".join(left))


def _in_force(config: Path, paths: StagePaths) -> Path:
    """Return the configuration that the dead daemon ran; the file may have changed since."""
    # The daemon keeps a copy of its accepted configuration, in one of two folders.
    copies = list(paths.runtime.glob(f"config-*/{config.stem}.yaml"))
    if config in copies or not copies or not paths.running.exists():
        return config
    copy = max(copies, key=lambda copy: copy.stat().st_mtime)
    try:
        load_daemon(copy, registry)
    except ConfigError:
        return config  # the daemon died while it wrote this copy
    return copy


def _print_document(outcomes: dict[str, AxisOutcome]) -> None:
    axes = {name: each._asdict() for name, each in outcomes.items()}
    print_json({"safe": not any(each.why for each in outcomes.values()), "axes": axes})
