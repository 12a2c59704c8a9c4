"""`piezod arm`, `piezod mode` and `piezod reset`: verbs with options or arguments of their own."""

from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.stage_options import AxesOption, SocketOption, StageOption, connect, print_answer
from piezod.config.modes import Mode


def arm(
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Compute everything, write nothing.")
    ] = False,
    confirm_output: Annotated[
        bool,
        typer.Option(
            "--confirm-output",
            help="You have seen that the output is at its read-back, whatever contradicts it; "
            "without a read-back, that it is at the safe voltage.",
        ),
    ] = False,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Arm the stage and print whether it is in shadow mode."""
    with connect(stage, socket) as client:
        answer = client.arm(shadow=shadow, confirm_output=confirm_output)
    print_answer(answer, "armed, in shadow: nothing is written" if shadow else "armed", json=json)


def mode(
    name: Annotated[Mode, typer.Argument(metavar="MODE", help=f"One of {', '.join(Mode)}.")],
    axis: AxesOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Select a mode and print its name."""
    with connect(stage, socket) as client:
        answer = client.mode(name, axis=axis)
    print_answer(answer, f"mode {name}", json=json)


def reset(
    engineer: Annotated[
        bool, typer.Option("--engineer", help="Also end the faults that only an engineer may end.")
    ] = False,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Reset the stage."""
    with connect(stage, socket) as client:
        answer = client.reset(engineer=engineer)
    print_answer(answer, "reset; `piezod arm` comes next", json=json)
