"""`piezod group`: several stages as one."""

from collections.abc import Callable, Mapping
from typing import Annotated, Final

import typer

from piezod.cli.exit_codes import FAILED
from piezod.cli.group.options import GroupArgument, GroupsOption, print_answers
from piezod.cli.look.list_stages import print_stages
from piezod.cli.options import JsonOption
from piezod.client import StageGroup
from piezod.client.listing import list_stages
from piezod.messages.answers import Answer


def arm(
    name: GroupArgument,
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Compute everything, write nothing.")
    ] = False,
    confirm_output: Annotated[
        bool,
        typer.Option(
            "--confirm-output",
            help="You have seen that all outputs are at their read-back, whatever contradicts it; "
            "without a read-back, that they are at the safe voltage.",
        ),
    ] = False,
    groups: GroupsOption = None,
    json: JsonOption = False,
) -> None:
    """Arm all stages of a group.

    If one stage refuses, those that were armed for it are disarmed again.
    """
    with StageGroup(name, file=groups) as group:
        print_answers(group.arm(shadow=shadow, confirm_output=confirm_output), _state, json=json)


def status(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """List the stages of a group as `piezod list` does.

    Exits with 1 if one of them does not run or does not answer.
    """
    with StageGroup(name, file=groups) as group:
        found = list_stages(group.stages)
    print_stages(found, json=json)
    if any(each.status is None for each in found):
        raise typer.Exit(FAILED)


def _plain(send: Callable[[StageGroup], Mapping[str, Answer]], text: str) -> Callable[..., None]:
    """Return the command of a request without arguments; the text is its help."""

    def command(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
        with StageGroup(name, file=groups) as group:
            print_answers(send(group), _state, json=json)

    command.__doc__ = text
    return command


def _state(answer: Answer) -> str:
    return answer.state


_REACHES: Final = "\n\nIt reaches every stage, even if another one hangs, and needs no lease."
hold = _plain(StageGroup.hold, f"Hold the voltages of all stages.{_REACHES}")
resume = _plain(
    StageGroup.resume,
    "Continue on all stages after a hold.\n\nIf one stage refuses, the others hold.",
)
disarm = _plain(StageGroup.disarm, f"Ramp to the safe voltages, then write nothing more.{_REACHES}")
stop = _plain(StageGroup.stop, f"Ramp all stages to their safe voltages.{_REACHES}")
estop = _plain(StageGroup.estop, f"Stop all stages in an emergency.{_REACHES}")
