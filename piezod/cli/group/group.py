"""`piezod group`: several stages as one."""

from typing import Annotated

import typer

from piezod.cli.exit_codes import FAILED
from piezod.cli.group.options import GroupArgument, GroupsOption, connect_group, print_answers
from piezod.cli.look.list_stages import print_stages
from piezod.cli.options import JsonOption
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
    with connect_group(name, groups) as group:
        print_answers(group.arm(shadow=shadow, confirm_output=confirm_output), _state, json=json)


def status(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """List the stages of a group as `piezod list` does.

    Exits with 1 if one of them does not run or does not answer.
    """
    with connect_group(name, groups) as group:
        found = list_stages(group.stages)
    print_stages(found, json=json)
    if any(each.status is None for each in found):
        raise typer.Exit(FAILED)


def hold(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """Hold the voltages of all stages.

    It reaches every stage, even if another one hangs, and needs no lease.
    """
    with connect_group(name, groups) as group:
        print_answers(group.hold(), _state, json=json)


def resume(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """Continue on all stages after a hold.

    If one stage refuses, the others hold.
    """
    with connect_group(name, groups) as group:
        print_answers(group.resume(), _state, json=json)


def disarm(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """Ramp to the safe voltages, then write nothing more.

    It reaches every stage, even if another one hangs, and needs no lease.
    """
    with connect_group(name, groups) as group:
        print_answers(group.disarm(), _state, json=json)


def stop(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """Ramp all stages to their safe voltages.

    It reaches every stage, even if another one hangs, and needs no lease.
    """
    with connect_group(name, groups) as group:
        print_answers(group.stop(), _state, json=json)


def estop(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """Stop all stages in an emergency.

    It reaches every stage, even if another one hangs, and needs no lease.
    """
    with connect_group(name, groups) as group:
        print_answers(group.estop(), _state, json=json)


def _state(answer: Answer) -> str:
    return answer.state
