"""`piezod goto`, `piezod path` and `piezod wave`: movements."""

import inspect
from collections.abc import Callable
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Final

import typer
from pydantic import TypeAdapter

from piezod.cli.input_file import load_file
from piezod.cli.options import JsonOption
from piezod.cli.output import error_console, print_json, print_warnings
from piezod.cli.paths import existing_file
from piezod.cli.stage_options import (
    AxisOption,
    SocketOption,
    StageOption,
    connect,
    print_answer,
)
from piezod.client import StageClient
from piezod.client.calls import Waveforms
from piezod.config.commands import CommandPerAxis, WaveFile
from piezod.config.frequencies import coarse
from piezod.config.waveforms.combined import WaveformConfig
from piezod.config.waveforms.swings import SWINGS

_SWING_OPTIONS: Final = ", ".join(f"--{kind}" for kind in SWINGS)


def goto(  # noqa: PLR0913, PLR0917 - each argument is an option
    positions: Annotated[
        list[str],
        typer.Argument(
            metavar="POSITION",
            help="Target, in µm; or AXIS=POSITION of each user axis, which then move on a straight "
            "line.",
        ),
    ],
    axis: AxisOption = None,
    speed: Annotated[
        float | None,
        typer.Option(metavar="UM_PER_S", help="Speed, µm/s; default: as configured."),
    ] = None,
    wait: Annotated[
        bool,
        typer.Option(
            "--wait",
            help="Return when the position has been within its tolerance for the settling time; "
            "exit with 1 if that does not happen.",
        ),
    ] = False,
    timeout: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=0.0,
            help="Longest time to wait, s; default: as long as the movement takes, and 30 s.",
        ),
    ] = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Start a movement to a position, and with --wait return at its end."""
    if "=" in positions[0]:
        if axis is not None:
            raise typer.BadParameter("--axis goes with one POSITION, AXIS=POSITION names its axis")
        path([",".join(positions)], speed, wait, timeout, stage, socket, json)
        return
    position_um = _number(positions[0])
    if len(positions) > 1:
        raise typer.BadParameter(f"one POSITION, or AXIS=POSITION (got {' '.join(positions)})")
    with connect(stage, socket) as client:
        if wait:
            arrival = client.goto_and_wait(
                position_um, axis=axis, speed_um_per_s=speed, timeout_s=timeout
            )
            print_answer(arrival, f"at {arrival.position_um:.3f} µm", json=json)
        else:
            answer = client.goto(position_um, axis=axis, speed_um_per_s=speed)
            print_answer(answer, f"going to {position_um:g} µm", json=json)


def path(
    points: Annotated[
        list[str],
        typer.Argument(metavar="POINT", help="Points, as in x=5,y=3; in the units of the axes."),
    ],
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="PER_S", help="Highest speed of an axis, in its unit/s; default: as configured."
        ),
    ] = None,
    wait: Annotated[
        bool, typer.Option("--wait", help="Return when all axes are on target, as for `goto`.")
    ] = False,
    timeout: Annotated[
        float | None, typer.Option(metavar="S", min=0.0, help="Longest time to wait, s.")
    ] = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Move user axes on straight lines from point to point."""
    given = [_point(each) for each in points]
    last = {name: at for point in given for name, at in point.items()}
    there = ", ".join(f"{name} {at:g}" for name, at in last.items())
    with connect(stage, socket) as client:
        if wait:
            arrivals = client.path_and_wait(given, speed_per_s=speed, timeout_s=timeout)
            text = ", ".join(f"{each.axis} {each.position_um:.3f}" for each in arrivals)
            if json:
                print_json({"arrivals": [each.document for each in arrivals]})
            else:
                print_answer(arrivals[0], f"at {text}", json=False)
        else:
            answer = client.path(given, speed_per_s=speed)
            print_answer(answer, f"going to {there}", json=json)


def _point(text: str) -> dict[str, float]:
    """Return the point of a text like x=5,y=3."""
    point: dict[str, float] = {}
    for part in text.split(","):
        name, found, number = part.partition("=")
        if not found or name in point:
            raise typer.BadParameter(f"a point is like x=5,y=3 (got {text!r})")
        point[name] = _number(number)
    return point


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"a position must be a number (got {text!r})") from None


def _with_swings(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for each swing, after its first argument."""
    given = inspect.signature(command)
    own = [each for each in given.parameters.values() if each.kind is not each.VAR_KEYWORD]
    signature = given.replace(parameters=[*own[:1], *map(_option, SWINGS), *own[1:]])
    command.__annotations__ = {each.name: each.annotation for each in signature.parameters.values()}
    vars(command)["__signature__"] = signature
    return command


def _option(kind: str) -> inspect.Parameter:
    numbers = SWINGS[kind]
    words = " ".join(each.key.upper() for each in numbers)
    option = typer.Option(metavar=words, help=f"A {kind} between two positions, µm.")
    values: Any = GenericAlias(tuple, (float,) * len(numbers))
    annotation = Annotated[values | None, option]
    return inspect.Parameter(
        kind, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation
    )


@_with_swings
def wave(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]",
            readable=False,
            callback=existing_file,
            help="YAML with `command_um`, as in a case of an experiment, and `duration_s`.",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Duration, s; replaces that of FILE.")
    ] = None,
    axis: AxisOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
    **swings: tuple[float, ...] | None,
) -> None:
    """Follow the waveform of a file, or a swing that a few numbers describe."""
    given = {kind: numbers for kind, numbers in swings.items() if numbers is not None}
    if (file is not None) + len(given) != 1:
        raise typer.BadParameter(f"give one of FILE, {_SWING_OPTIONS}")
    if file is None and duration is None:
        raise typer.BadParameter(f"{_SWING_OPTIONS} need --duration")
    if file is not None and axis is not None:
        raise typer.BadParameter(f"--axis goes with {_SWING_OPTIONS}, FILE names its axes")
    loaded = load_file(file, WaveFile) if file else None
    with connect(stage, socket) as client:
        command_um = loaded.command_um if loaded else _swing(*given.popitem())
        if isinstance(command_um, CommandPerAxis):
            waveforms: Waveforms = command_um.axes
        else:
            waveforms = {axis or _only_axis(client): command_um}
        duration_s = duration or (loaded.duration_s if loaded else 0.0)
        answer = client.wave(waveforms, duration_s)
        warnings = _coarse(client, waveforms)
    print_warnings(error_console(), warnings)
    print_answer(answer, f"following for {duration_s:g} s", json=json)


def _swing(kind: str, numbers: tuple[float, ...]) -> dict[str, str | float]:
    keys = (each.key for each in SWINGS[kind])
    return {"kind": kind, **dict(zip(keys, numbers, strict=True))}


def _coarse(client: StageClient, waveforms: Waveforms) -> list[str]:
    """Return the warnings about waveforms, which the stage has accepted."""
    adapter: TypeAdapter[WaveformConfig] = TypeAdapter(WaveformConfig)
    accepted = {axis: adapter.validate_python(each) for axis, each in waveforms.items()}
    rate_hz = client.config().get("rate_hz")
    return list(coarse(accepted, rate_hz)) if rate_hz else []


def _only_axis(client: StageClient) -> str:
    axes = list(client.status().axes)
    if len(axes) != 1:
        raise typer.BadParameter(f"name one of the axes {', '.join(axes)} with --axis")
    return axes[0]
