"""`piezod commission`: the first measurements of an axis, step by step."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from piezod.cli.devices.commission_steps import print_note, walk
from piezod.cli.devices.guardian import guardian
from piezod.cli.devices.owned_stage import owning
from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.paths import check_writable, existing_file

if TYPE_CHECKING:
    from piezod.commission.bench import OneAxis
    from piezod.commission.procedure import Findings
    from piezod.config.daemon import DaemonConfig

PROFILE_NAME = "stage.yaml"

ConfigArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="CONFIG",
        help="Configuration of the stage with the devices, and with limits that the data sheets of "
        "amplifier and actuator allow.",
        readable=False,
        callback=existing_file,
    ),
]
AxisOption: TypeAlias = Annotated[
    str | None, typer.Option(metavar="NAME", help="Axis; required if there are several.")
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder for sheet, configuration and data, with a number if there is one of that "
        "name. Default: STAGE-AXIS-commissioned, in the current folder.",
    ),
]
OutputOption: TypeAlias = Annotated[
    float,
    typer.Option(
        metavar="V",
        help="Voltage in force, in V, for an amplifier without read-back: read it from its "
        "display.",
        show_default=False,
    ),
]
ConfirmOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--confirm-output",
        help="You have seen that the read-back is right, whatever was written last.",
    ),
]
YesOption: TypeAlias = Annotated[bool, typer.Option("--yes", help="Confirm every step in advance.")]


def commission(
    config: ConfigArgument,
    axis: AxisOption = None,
    out: OutOption = None,
    output_v: OutputOption = float("nan"),
    confirm_output: ConfirmOption = False,
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Measure an axis: identity, noise, polarity, travel, delay, first mode.

    Each step announces the voltages that it drives and waits for a yes. It stays within the limits
    of the configuration and returns to the initial voltage. Ctrl-C, a no, or an error ends the
    procedure. The results so far are stored as an acceptance sheet, a configuration for `piezod
    run`, and the data. If the read-back contradicts the voltage that was written last, by whatever
    command, nothing is driven unless you confirm the read-back.
    """
    from piezod.config.daemon import load_daemon
    from piezod.daemon.paths import stage_paths
    from piezod.devices import registry
    from piezod.records.new_name import new_folder

    stage = load_daemon(config, registry)
    name = _axis_of(stage, axis)
    default = Path(f"{stage_paths(config).name}-{name}-commissioned")
    with new_folder(out or default) as folder:
        check_writable(folder)
        results = _Results(stage, name, folder)
        _measure(config, results, output_v, confirmed=confirm_output, asking=not yes, json=json)


def _measure(
    config: Path,
    results: "_Results",
    output_v: float,
    *,
    confirmed: bool,
    asking: bool,
    json: bool,
) -> None:
    """Do the steps and store their results, also those before an error."""
    from piezod.commission.bench import one_axis
    from piezod.commission.procedure import steps_of
    from piezod.daemon.output_notes import OutputNotes
    from piezod.daemon.paths import stage_paths

    stage, axis = results.stage, results.axis
    opened: OneAxis | None = None
    try:
        with (
            owning(config),
            unwinding(),
            guardian(config) as guard,
            one_axis(
                stage, axis, OutputNotes(stage, stage_paths(config)), output_v, confirmed=confirmed
            ) as opened,
        ):
            guard.watch(axis, opened)
            _print_identities(opened)
            steps = steps_of(opened.session, results.findings, print_note)
            walk(opened.session, steps, results.not_done, asking=asking)
    except BaseException:  # Ctrl-C too: its cause is reported, with or without a sheet
        if opened is not None and results.findings.traces:
            try:
                results.print(results.store(opened), json=json)
            except Exception as error:  # noqa: BLE001 - the first error must not be hidden
                typer.echo(f"no sheet was written: {error}", err=True)
        raise
    results.print(results.store(opened), json=json)


def _axis_of(stage: "DaemonConfig", axis: str | None) -> str:
    known = ", ".join(stage.axes)
    if axis is None and len(stage.axes) > 1:
        raise typer.BadParameter(f"name one of the axes {known}", param_hint="--axis")
    name = axis or next(iter(stage.axes))
    if name not in stage.axes:
        raise typer.BadParameter(f"no such axis (got {name}), known: {known}", param_hint="--axis")
    return name


def _print_identities(opened: "OneAxis") -> None:
    for name, identity in opened.identities.items():
        typer.echo(f"{name}: {', '.join(identity)}", err=True)
    typer.echo(f"voltage in force: {opened.session.drive_v:z.2f} V", err=True)


def _no_findings() -> "Findings":
    from piezod.commission.procedure import Findings

    return Findings()


@dataclass(frozen=True)
class _Results:
    """Results of the steps done so far."""

    stage: "DaemonConfig"  #: Configuration of the stage.
    axis: str  #: Name of the axis.
    folder: Path  #: Folder for the files.
    findings: "Findings" = field(default_factory=_no_findings)  #: Results by step.
    not_done: list[str] = field(default_factory=list)  #: Names of the steps that were not done.

    def store(self, opened: "OneAxis") -> Path:
        """Write sheet, configuration and data; return the path of the sheet."""
        from datetime import UTC, datetime

        import piezod
        from piezod.commission.profile import profile
        from piezod.commission.sheet import Sheet, write_sheet

        now = datetime.now(UTC)
        text = ""
        if self.findings.travel is not None:  # without it, the configuration has no range
            date = now.date().isoformat()
            text = profile(self.stage, self.axis, self.findings, dict(opened.identities), date)
        facts = {
            "commissioned": f"{now:%Y-%m-%d %H:%M} UTC",
            "rate": f"{self.stage.rate_hz:g} Hz",
            "found at": f"{opened.session.found_v:z.2f} V",
            "piezod": piezod.__version__,
        }
        sheet = Sheet(
            self.axis, facts, opened.identities, self.findings, self.not_done, PROFILE_NAME, text
        )
        return write_sheet(self.folder, sheet)

    def print(self, sheet: Path, *, json: bool) -> None:
        """Print the path of the sheet, or the document with all results."""
        if not json:
            typer.echo(f"Sheet: {sheet}")
            return
        from piezod.cli.output import print_json
        from piezod.commission.sheet import rows_of

        rows = [row._asdict() for row in rows_of(self.findings)]
        print_json(
            {"axis": self.axis, "found": rows, "not_done": self.not_done, "sheet": str(sheet)}
        )
