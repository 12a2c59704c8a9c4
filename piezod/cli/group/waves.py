"""`piezod group goto`, `group wave` and `group play`: movements of several stages."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias

import typer

from piezod.cli.group.options import (
    GroupArgument,
    GroupsOption,
    StartInOption,
)
from piezod.cli.input_file import load_file
from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, print_json
from piezod.cli.paths import existing_file
from piezod.client import StageGroup
from piezod.client.calls import Waveforms
from piezod.client.stage_group import GroupStart
from piezod.config.commands import Command, CommandPerAxis
from piezod.messages.groups import GroupPlayFile, GroupWaveFile

_START_IN_S: Final = 1.0
_WaitOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--wait",
        help="Return when all stages have arrived; if one cannot, the others hold, and the exit "
        "code is 1.",
    ),
]


def goto(
    name: GroupArgument,
    targets: Annotated[
        list[str],
        typer.Argument(metavar="STAGE[/AXIS]=UM...", help="Target of each stage or axis, in µm."),
    ],
    wait: _WaitOption = False,
    groups: GroupsOption = None,
    json: JsonOption = False,
) -> None:
    """Move stages to positions.

    If one stage refuses, the others hold.
    """
    with StageGroup(name, file=groups) as group:
        started = group.goto(_targets(group, targets))
        _print(group, started, "on its way", wait=wait, json=json)


def wave(
    name: GroupArgument,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            readable=False,
            callback=existing_file,
            help="YAML with `stages`, a waveform for each, and `duration_s`.",
        ),
    ],
    start_in: StartInOption = _START_IN_S,
    wait: _WaitOption = False,
    groups: GroupsOption = None,
    json: JsonOption = False,
) -> None:
    """Follow waveforms that begin together.

    They begin at the same instant, within a cycle of each loop. Each axis first moves to the start
    of its waveform. If one stage refuses, the others hold.
    """
    loaded = load_file(file, GroupWaveFile)
    with StageGroup(name, file=groups) as group:
        waveforms = {stage: _per_axis(group, stage, each) for stage, each in loaded.stages.items()}
        started = group.wave(waveforms, loaded.duration_s, start_in_s=start_in)
        done = f"following for {loaded.duration_s:g} s, from {started.start_s:.6f} s on"
        _print(group, started, done, wait=wait, json=json)


def play(
    name: GroupArgument,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            readable=False,
            callback=existing_file,
            help="YAML with `stages`, a table for each, as `POST /v1/play` takes it.",
        ),
    ],
    start_in: StartInOption = _START_IN_S,
    groups: GroupsOption = None,
    json: JsonOption = False,
) -> None:
    """Play tables that begin together.

    The devices are started at the same instant, and play by their own clocks. Each device must have
    its table before that. If one stage refuses, the others hold.
    """
    loaded = load_file(file, GroupPlayFile)
    without = {"kind", "start_s"}
    tables = {stage: each.model_dump(exclude=without) for stage, each in loaded.stages.items()}
    with StageGroup(name, file=groups) as group:
        started = group.play(tables, start_in_s=start_in)
        done = f"playing, from {started.start_s:.6f} s on"
        _print(group, started, done, wait=False, json=json)


def _per_axis(group: StageGroup, stage: str, command_um: Command) -> Waveforms:
    if isinstance(command_um, CommandPerAxis):
        return command_um.axes
    return {_only_axis(group, stage): command_um}


def _targets(group: StageGroup, texts: Iterable[str]) -> dict[str, dict[str, float]]:
    """Return the targets by stage and axis, in µm."""
    found: dict[str, dict[str, float]] = {}
    for text in texts:
        place, _, number = text.rpartition("=")
        stage, _, axis = place.partition("/")
        try:
            um = float(number)
        except ValueError as error:
            what = f"{text!r} is no target: write as in fast=5 or fast/x=5, in µm"
            raise typer.BadParameter(what) from error
        found.setdefault(stage, {})[axis or _only_axis(group, stage)] = um
    return found


def _only_axis(group: StageGroup, stage: str) -> str:
    axes = list(group.client(stage).status().axes)
    if len(axes) != 1:
        what = f"stage {stage} has the axes {', '.join(axes)}: name each (in a file in `axes:`)"
        raise typer.BadParameter(what)
    return axes[0]


def _print(group: StageGroup, started: GroupStart, done: str, *, wait: bool, json: bool) -> None:
    """Print what each stage does, or after a wait where it is."""
    arrived = group.wait(started) if wait else {}
    if json:
        stages: dict[str, Any] = {name: each.document for name, each in started.answers.items()}
        for name, arrivals in arrived.items():
            stages[name] = {"axes": {each.axis: each.document for each in arrivals}}
        print_json({"start_s": started.start_s, "stages": stages})
        return
    console = new_console()
    for stage in started.answers:
        where = (f"{each.axis} at {each.position_um:.3f} µm" for each in arrived.get(stage, ()))
        console.print(f"{stage}: {', '.join(where) or done}", soft_wrap=True)
