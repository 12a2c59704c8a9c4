"""`piezod group`: several stages as one."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Final, NamedTuple

import typer

from piezod.cli.exit_codes import FAILED
from piezod.cli.group_options import (
    GroupArgument,
    GroupsOption,
    StartInOption,
    connect_group,
    print_answers,
)
from piezod.cli.group_waves import play, wave
from piezod.cli.options import JsonOption

if TYPE_CHECKING:
    from piezod.client import StageGroup
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
    from piezod.cli.list_stages import print_stages
    from piezod.client.listing import list_stages

    with connect_group(name, groups) as group:
        found = list_stages(group.stages)
    print_stages(found, json=json)
    if any(each.status is None for each in found):
        raise typer.Exit(FAILED)


def start_recording(
    name: GroupArgument,
    label: Annotated[
        str | None, typer.Argument(metavar="[LABEL]", help="Becomes part of the files' names.")
    ] = None,
    start_in: StartInOption = 1.0,
    groups: GroupsOption = None,
    json: JsonOption = False,
) -> None:
    """Start a recording of each stage; time 0 of all files is the same instant.

    If one stage refuses, the recordings that were started for it are ended again.
    """
    with connect_group(name, groups) as group:
        started = group.start_recording(label, start_in_s=start_in)
    print_answers(started, lambda each: f"recording {each.name}", json=json)


def stop_recording(
    name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False
) -> None:
    """End the recording of each stage."""
    with connect_group(name, groups) as group:
        ended = group.stop_recording()
    print_answers(ended, lambda each: f"recorded {each.records} cycles as {each.name}", json=json)


class _PlainVerb(NamedTuple):
    """A verb without options: what it does, and its help."""

    act: "Callable[[StageGroup], Mapping[str, Answer]]"
    help: str


_NEVER_BACK: Final = "It reaches every stage, even if another one hangs, and needs no lease."
_PLAIN: Final[Mapping[str, _PlainVerb]] = {
    "hold": _PlainVerb(
        lambda group: group.hold(), f"Hold the voltages of all stages.\n\n{_NEVER_BACK}"
    ),
    "resume": _PlainVerb(
        lambda group: group.resume(),
        "Continue on all stages after a hold.\n\nIf one stage refuses, the others hold.",
    ),
    "disarm": _PlainVerb(
        lambda group: group.disarm(),
        f"Ramp to the safe voltages, then write nothing more.\n\n{_NEVER_BACK}",
    ),
    "stop": _PlainVerb(
        lambda group: group.stop(),
        f"Ramp all stages to their safe voltages.\n\n{_NEVER_BACK}",
    ),
    "estop": _PlainVerb(
        lambda group: group.estop(),
        f"Stop all stages in an emergency.\n\n{_NEVER_BACK}",
    ),
}


def _plain(verb: _PlainVerb) -> Callable[..., None]:
    def send(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
        with connect_group(name, groups) as group:
            print_answers(verb.act(group), _state, json=json)

    return send


def _state(answer: "Answer") -> str:
    return answer.state


def group_verbs() -> typer.Typer:
    """Return the verbs for a group."""
    verbs = typer.Typer(
        no_args_is_help=True,
        rich_markup_mode=None,
        help="Operate several stages of this machine as one.\n\nA file names the stages of each "
        "group. A request that one stage refuses is taken back on the others.",
    )
    for function in (status, arm, wave, play):
        verbs.command()(function)
    for name, verb in _PLAIN.items():
        verbs.command(name, help=verb.help)(_plain(verb))
    record = typer.Typer(
        no_args_is_help=True, rich_markup_mode=None, help="Record all stages of a group."
    )
    record.command("start")(start_recording)
    record.command("stop")(stop_recording)
    verbs.add_typer(record, name="record")
    return verbs
