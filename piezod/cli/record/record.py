"""`piezod record`: recordings of every cycle."""

import re
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Final, TypeAlias

import typer

from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, print_json, print_one
from piezod.cli.stage_options import SocketOption, StageOption, completion, connect, print_answer
from piezod.records import repair as repairs
from piezod.records.new_name import new_file

_names = completion(lambda client: [each.name for each in client.recordings().recordings])

NameArgument: TypeAlias = Annotated[
    str,
    typer.Argument(metavar="NAME", autocompletion=_names, help="Name in `piezod record list`."),
]

_LABEL: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")


def start(
    label: Annotated[
        str | None, typer.Argument(metavar="[LABEL]", help="Becomes part of the file's name.")
    ] = None,
    line: Annotated[
        str | None,
        typer.Option(
            metavar="LINE",
            help="Line of the stage whose rising edge starts it; its falling edge ends it.",
        ),
    ] = None,
    before_s: Annotated[
        float, typer.Option(help="Time before the edge that is recorded, too, s; at most 10.")
    ] = 0.0,
    duration_s: Annotated[
        float | None, typer.Option(help="Time from the edge to the end, s, in place of an edge.")
    ] = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Start a recording and print its name."""
    if line is None and (before_s or duration_s is not None):
        raise typer.BadParameter("is for a recording with --line", param_hint="'--before-s'")
    if label and not _LABEL.fullmatch(label):
        message = (
            f"may have up to 32 letters, digits, _ and -, the first a letter or digit (got {label})"
        )
        raise typer.BadParameter(message, param_hint="'LABEL'")
    with connect(stage, socket) as client:
        started = client.start_recording(label, line=line, before_s=before_s, duration_s=duration_s)
    waits = f" when line {line} rises" if started.armed else ""
    print_answer(started, f"recording {started.name}{waits}", json=json)


def stop(stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False) -> None:
    """End the recording and print its length and its losses."""
    with connect(stage, socket) as client:
        ended = client.stop_recording()
    lost = f"{ended.lost} were lost" if ended.lost else ""
    text = f"recorded {ended.records} cycles as {ended.name}"
    text += f" in {ended.files} files" if ended.files > 1 else ""
    print_answer(ended, "; ".join(filter(None, (text, lost, ended.why))), json=json)


def list_records(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Print the finished recordings and the one in progress."""
    with connect(stage, socket) as client:
        found = client.recordings()
    if json:
        print_json(found.document)
        return
    console = new_console()
    for each in found.recordings:
        kept = ", kept" if each.kept else ""
        console.print(f"{each.name}  {(each.size_bytes or 0) / 1e6:.1f} MB{kept}")
    if found.running:
        console.print(f"{found.running.name}  {found.running.records} cycles, in progress")
    elif not found.recordings:
        console.print("nothing is recorded")


def keep(
    name: NameArgument,
    undo: Annotated[bool, typer.Option("--undo", help="Remove the mark.")] = False,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Mark a recording as kept and print its name."""
    with connect(stage, socket) as client:
        marked = client.keep_recording(name, kept=not undo)
    print_answer(marked, f"{marked.name}: {'not kept' if undo else 'kept'}", json=json)


def get(
    name: NameArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File to write; default: NAME.h5 in the current folder, with a number if there is "
            "one of that name.",
        ),
    ] = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Copy the file of a recording and print its size."""
    wanted = Path(f"{name}.h5")
    with nullcontext(out) if out else new_file(wanted) as file, connect(stage, socket) as client:
        size_bytes = client.fetch_recording(name, file)
    document = {"name": name, "file": str(file), "size_bytes": size_bytes}
    print_one(document, f"{file}: {size_bytes} bytes", json=json)


def repair(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE…", help="Recordings or flight records.")
    ],
) -> None:
    """Make recordings open plainly whose daemon was killed.

    The daemon does this by itself at its next start, and no record in a file changes. This is for
    files that were copied before. Without it a viewer must open them in SWMR mode.
    """
    console = new_console()
    for file in files:
        done = "repaired" if repairs.repair(file) else "nothing to repair"
        console.print(f"{file}: {done}", soft_wrap=True)
