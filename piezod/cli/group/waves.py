"""`piezod group wave` and `piezod group play`: movements that begin together."""

from pathlib import Path
from typing import Annotated, Final

import typer

from piezod.cli.group.options import (
    GroupArgument,
    GroupsOption,
    StartInOption,
    connect_group,
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
    groups: GroupsOption = None,
    json: JsonOption = False,
) -> None:
    """Follow waveforms that begin together.

    They begin at the same instant, within a cycle of each loop. Each axis first moves to the start
    of its waveform. If one stage refuses, the others hold.
    """
    loaded = load_file(file, GroupWaveFile)
    with connect_group(name, groups) as group:
        waveforms = {stage: _per_axis(group, stage, each) for stage, each in loaded.stages.items()}
        started = group.wave(waveforms, loaded.duration_s, start_in_s=start_in)
    _print(started, f"following for {loaded.duration_s:g} s", json=json)


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
    with connect_group(name, groups) as group:
        started = group.play(tables, start_in_s=start_in)
    _print(started, "playing", json=json)


def _per_axis(group: StageGroup, stage: str, command_um: Command) -> Waveforms:
    if isinstance(command_um, CommandPerAxis):
        return command_um.axes
    axes = list(group.client(stage).status().axes)
    if len(axes) != 1:
        what = f"stage {stage} has the axes {', '.join(axes)}: give it `axes:` with one for each"
        raise typer.BadParameter(what, param_hint="'FILE'")
    return {axes[0]: command_um}


def _print(started: GroupStart, done: str, *, json: bool) -> None:
    if json:
        answers = {stage: each.document for stage, each in started.answers.items()}
        print_json({"start_s": started.start_s, "stages": answers})
        return
    console = new_console()
    for stage in started.answers:
        console.print(f"{stage}: {done}, from {started.start_s:.6f} s on", soft_wrap=True)
