"""`piezod goto` and `piezod wave`: movements."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file
from piezod.cli.stage_options import (
    AxisOption,
    SocketOption,
    StageOption,
    connect,
    print_answer,
)

if TYPE_CHECKING:
    from piezod.client import StageClient
    from piezod.client.calls import Waveforms
    from piezod.config.commands import WaveFile

Swing: TypeAlias = tuple[float, float, float]
"""Lowest and highest position in µm, frequency in Hz."""


def goto(  # noqa: PLR0913, PLR0917 - each argument is an option
    position_um: Annotated[float, typer.Argument(metavar="POSITION", help="Target, in µm.")],
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
    with connect(stage, socket) as client:
        if wait:
            arrival = client.goto_and_wait(
                position_um, axis=axis, speed_um_per_s=speed, timeout_s=timeout
            )
            print_answer(arrival, f"at {arrival.position_um:.3f} µm", json=json)
        else:
            answer = client.goto(position_um, axis=axis, speed_um_per_s=speed)
            print_answer(answer, f"going to {position_um:g} µm", json=json)


def wave(  # noqa: PLR0913, PLR0917 - likewise
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]",
            readable=False,
            callback=existing_file,
            help="YAML with `command_um`, as in a case of an experiment, and `duration_s`.",
        ),
    ] = None,
    sine: Annotated[
        Swing | None, typer.Option(metavar="LOW HIGH HZ", help="A sine between two positions, µm.")
    ] = None,
    triangle: Annotated[
        Swing | None,
        typer.Option(metavar="LOW HIGH HZ", help="A triangle between two positions, µm."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Duration, s; replaces that of FILE.")
    ] = None,
    axis: AxisOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Follow the waveform of a file, or a sine or triangle."""
    if [file, sine, triangle].count(None) != 2:
        raise typer.BadParameter("give one of FILE, --sine and --triangle")
    if file is None and duration is None:
        raise typer.BadParameter("--sine and --triangle need --duration")
    if file is not None and axis is not None:
        raise typer.BadParameter("--axis goes with --sine and --triangle, FILE names its axes")
    from piezod.config.commands import CommandPerAxis

    loaded = _load(file) if file else None
    with connect(stage, socket) as client:
        command_um = loaded.command_um if loaded else _swing(sine, triangle)
        if isinstance(command_um, CommandPerAxis):
            waveforms: Waveforms = command_um.axes
        else:
            waveforms = {axis or _only_axis(client): command_um}
        duration_s = duration or (loaded.duration_s if loaded else 0.0)
        answer = client.wave(waveforms, duration_s)
        warnings = _coarse(client, waveforms)
    for warning in warnings:
        from piezod.cli.output import error_console  # rich takes long to import

        error_console().print(f"! {warning}", style="yellow")
    print_answer(answer, f"following for {duration_s:g} s", json=json)


def _load(file: Path) -> "WaveFile":
    from piezod.config.commands import WaveFile
    from piezod.config.fields import Context
    from piezod.config.validate import validate
    from piezod.config.yaml_loader import load_yaml

    return validate(load_yaml(file), WaveFile, Context(file.parent))


def _swing(sine: Swing | None, triangle: Swing | None) -> dict[str, str | float]:
    low, high, frequency_hz = sine or triangle or (0.0, 0.0, 0.0)
    kind = "sine" if sine else "triangle"
    return {"kind": kind, "low": low, "high": high, "frequency_hz": frequency_hz}


def _coarse(client: "StageClient", waveforms: "Waveforms") -> list[str]:
    """Return the warnings about waveforms, which the stage has accepted."""
    from pydantic import TypeAdapter

    from piezod.config.combined_waveforms import WaveformConfig
    from piezod.config.frequencies import coarse

    adapter: TypeAdapter[WaveformConfig] = TypeAdapter(WaveformConfig)
    accepted = {axis: adapter.validate_python(each) for axis, each in waveforms.items()}
    rate_hz = client.config().get("rate_hz")
    return list(coarse(accepted, rate_hz)) if rate_hz else []


def _only_axis(client: "StageClient") -> str:
    axes = list(client.status().axes)
    if len(axes) != 1:
        raise typer.BadParameter(f"name one of the axes {', '.join(axes)} with --axis")
    return axes[0]
