"""Verbs that take a stage into operation and out of it, or stop it."""

from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.stage_options import SocketOption, StageOption, connect, tell


def arm(
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Compute everything, write nothing.")
    ] = False,
    confirm_output: Annotated[
        bool,
        typer.Option(
            "--confirm-output",
            help="You have seen that the output is at the safe voltage: for an amplifier that does "
            "not read back.",
        ),
    ] = False,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Take over the voltage that is read back, and hold it."""
    with connect(stage, socket) as client:
        answer = client.arm(shadow=shadow, confirm_output=confirm_output)
    tell(answer, "armed, in shadow: nothing is written" if shadow else "armed", json=json)


def disarm(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Ramp to the safe voltage, and write nothing from then on."""
    with connect(stage, socket) as client:
        answer = client.disarm()
    tell(answer, "ramping to the safe voltage, then disarmed", json=json)


def hold(stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False) -> None:
    """Hold the voltage that is in force."""
    with connect(stage, socket) as client:
        answer = client.hold()
    tell(answer, "holding the voltage; `piezod resume` goes on", json=json)


def resume(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Go on after a hold, from where the stage is."""
    with connect(stage, socket) as client:
        answer = client.resume()
    tell(answer, "going on from where the stage is", json=json)


def stop(stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False) -> None:
    """Ramp to the safe voltage; needs no lease."""
    with connect(stage, socket) as client:
        answer = client.stop()
    tell(answer, "ramping to the safe voltage", json=json)


def estop(stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False) -> None:
    """Stop in an emergency; needs no lease.

    Ramps to the safe voltage or has the amplifier cut its output, as the configuration says.
    """
    with connect(stage, socket) as client:
        answer = client.estop()
    tell(answer, "emergency stop; `piezod reset` ends it", json=json)


def reset(
    engineer: Annotated[
        bool, typer.Option("--engineer", help="Reset also what only an engineer may.")
    ] = False,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Leave a fault or an emergency stop that is over."""
    with connect(stage, socket) as client:
        answer = client.reset(engineer=engineer)
    tell(answer, "reset; `piezod arm` comes next", json=json)
