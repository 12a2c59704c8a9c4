"""The verbs that talk to a running daemon."""

from collections.abc import Callable

import typer

from piezod.cli.arm import arm, disarm, estop, hold, reset, resume, stop
from piezod.cli.modes import condition, mode, zero
from piezod.cli.motion import follow, goto, wave
from piezod.cli.params import params
from piezod.cli.record import record
from piezod.cli.reload import reload
from piezod.cli.status import faults, status
from piezod.cli.stream import stream
from piezod.cli.watch import watch


def add_client_verbs(app: typer.Typer) -> None:
    """Add them to the command, in the order in which help lists them."""
    _add(app, status, faults, watch, arm, disarm, mode)
    # A negative position begins with a dash, as options do.
    app.command(context_settings={"ignore_unknown_options": True})(goto)
    app.command(context_settings={"ignore_unknown_options": True})(wave)
    _add(app, stream, follow, hold, resume, condition, zero, stop, estop, reset)
    app.add_typer(params, name="params")
    app.add_typer(record, name="record")
    _add(app, reload)


def _add(app: typer.Typer, *verbs: Callable[..., None]) -> None:
    for verb in verbs:
        app.command()(verb)
