"""`piezod commission`: the first contact with an axis, step by step."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.commission_steps import walk
from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.owned_stage import owning
from piezod.cli.paths import check_writable, existing_file

if TYPE_CHECKING:
    from piezod.commission.bench import OneAxis
    from piezod.commission.procedure import Findings
    from piezod.config.daemon import DaemonConfig

PROFILE_NAME = "stage.yaml"


def commission(
    config: Annotated[
        Path,
        typer.Argument(
            metavar="CONFIG",
            help="Configuration of a daemon with the devices, and limits that the data sheets of "
            "amplifier and actuator allow.",
            readable=False,
            callback=existing_file,
        ),
    ],
    axis: Annotated[
        str | None, typer.Option(help="Name of the axis; needed where there are several.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder for sheet, configuration and data; AXIS-commissioned."
        ),
    ] = None,
    output_v: Annotated[
        float,
        typer.Option(
            help="Voltage in force, V, as its display shows: for an amplifier without read-back."
        ),
    ] = float("nan"),
    yes: Annotated[bool, typer.Option("--yes", help="Confirm every step beforehand.")] = False,
    json: JsonOption = False,
) -> None:
    """Get to know an axis: identity, noise, polarity, travel, delay, first resonance.

    Each step says which voltages it will drive and waits for a yes; it stays within the limits of
    the configuration, and goes back to the voltage found. Ctrl-C, a no, or anything that goes wrong
    ends it there. Leaves an acceptance sheet, a configuration for `piezod run`, and the data: of
    what was found until then.
    """
    from piezod.commission.bench import one_axis
    from piezod.commission.procedure import Findings, steps_of
    from piezod.config.daemon import load_daemon
    from piezod.devices import registry

    stage = load_daemon(config, registry)
    name = _axis_of(stage, axis)
    folder = out or Path(f"{name}-commissioned")
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder)
    findings, not_done = Findings(), list[str]()
    opened: OneAxis | None = None

    def leave(opened: "OneAxis") -> None:
        sheet = _write(folder, stage, name, findings, not_done, opened)
        _tell(name, findings, not_done, sheet, json=json)

    try:
        with owning(config), unwinding(), one_axis(stage, name, output_v) as opened:
            _tell_identities(opened)
            steps = steps_of(opened.session, findings)
            walk(opened.session, steps, not_done, asking=not yes)
    except BaseException:  # Ctrl-C too: what ended it is told, sheet or no sheet
        if opened is not None and findings.traces:
            try:
                leave(opened)
            except Exception as error:  # noqa: BLE001 - see above
                typer.echo(f"no sheet was written: {error}", err=True)
        raise
    leave(opened)


def _axis_of(stage: "DaemonConfig", axis: str | None) -> str:
    known = ", ".join(stage.axes)
    if axis is None and len(stage.axes) > 1:
        raise typer.BadParameter(f"say which axis: {known}", param_hint="--axis")
    name = axis or next(iter(stage.axes))
    if name not in stage.axes:
        raise typer.BadParameter(f"no such axis (got {name}), known: {known}", param_hint="--axis")
    return name


def _tell_identities(opened: "OneAxis") -> None:
    for name, identity in opened.identities.items():
        typer.echo(f"{name}: {', '.join(identity)}", err=True)
    typer.echo(f"in force: {opened.session.drive_v:z.2f} V", err=True)


def _tell(axis: str, findings: "Findings", not_done: list[str], sheet: Path, *, json: bool) -> None:
    if not json:
        typer.echo(f"Sheet: {sheet}")
        return
    from piezod.cli.output import print_json
    from piezod.commission.sheet import rows_of

    rows = [row._asdict() for row in rows_of(findings)]
    print_json({"axis": axis, "found": rows, "not_done": not_done, "sheet": str(sheet)})


def _write(
    folder: Path,
    stage: "DaemonConfig",
    axis: str,
    findings: "Findings",
    not_done: list[str],
    opened: "OneAxis",
) -> Path:
    from datetime import UTC, datetime

    import piezod
    from piezod.commission.profile import profile
    from piezod.commission.sheet import Sheet, write_sheet

    now = datetime.now(UTC)
    text = ""
    if findings.travel is not None:
        date = now.date().isoformat()
        text = profile(stage, axis, findings, dict(opened.identities), date)
    facts = {
        "commissioned": f"{now:%Y-%m-%d %H:%M} UTC",
        "rate": f"{stage.rate_hz:g} Hz",
        "found at": f"{opened.session.found_v:z.2f} V",
        "piezod": piezod.__version__,
    }
    return write_sheet(
        folder, Sheet(axis, facts, opened.identities, findings, not_done, PROFILE_NAME, text)
    )
