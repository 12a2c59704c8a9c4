"""The work of `piezod commission`."""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import typer

import piezod
from piezod.cli.devices.commission_steps import print_note, walk
from piezod.cli.devices.guardian import guardian
from piezod.cli.devices.owned_stage import owning
from piezod.cli.interrupt import unwinding
from piezod.cli.output import print_json
from piezod.cli.paths import check_writable
from piezod.commission.bench import OneAxis, one_axis
from piezod.commission.procedure import Findings, steps_of
from piezod.commission.profile import profile
from piezod.commission.sheet import Sheet, rows_of, write_sheet
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import stage_paths
from piezod.devices import registry
from piezod.records.new_name import new_folder

PROFILE_NAME: Final = "stage.yaml"


@dataclass(frozen=True)
class _Results:
    """Results of the steps done so far."""

    stage: DaemonConfig  #: Configuration of the stage.
    axis: str  #: Name of the axis.
    folder: Path  #: Folder for the files.
    findings: Findings = field(default_factory=Findings)  #: Results by step.
    not_done: list[str] = field(default_factory=list)  #: Names of the steps that were not done.

    def store(self, opened: OneAxis) -> Path:
        """Write sheet, configuration and data; return the path of the sheet."""
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
        rows = [row._asdict() for row in rows_of(self.findings)]
        print_json(
            {"axis": self.axis, "found": rows, "not_done": self.not_done, "sheet": str(sheet)}
        )


def run(
    config: Path,
    axis: str | None,
    out: Path | None,
    output_v: float,
    *,
    confirmed: bool,
    asking: bool,
    json: bool,
) -> None:
    """Measure an axis, and store and print the results.

    Args:
        config: Configuration of the stage.
        axis: Name of the axis; None for the only one.
        out: Folder for the results; None for the default.
        output_v: Voltage in force, in V, for an amplifier without read-back; NaN otherwise.
        confirmed: Whether the user has seen that the read-back is right.
        asking: Whether the user confirms each step.
        json: Whether one JSON document is printed.
    """
    stage = load_daemon(config, registry)
    name = _axis_of(stage, axis)
    default = Path(f"{stage_paths(config).name}-{name}-commissioned")
    with new_folder(out or default) as folder:
        check_writable(folder)
        results = _Results(stage, name, folder)
        _measure(config, results, output_v, confirmed=confirmed, asking=asking, json=json)


def _measure(
    config: Path,
    results: _Results,
    output_v: float,
    *,
    confirmed: bool,
    asking: bool,
    json: bool,
) -> None:
    """Do the steps and store their results, also those before an error."""
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


def _axis_of(stage: DaemonConfig, axis: str | None) -> str:
    known = ", ".join(stage.axes)
    if axis is None and len(stage.axes) > 1:
        raise typer.BadParameter(f"name one of the axes {known}", param_hint="--axis")
    name = axis or next(iter(stage.axes))
    if name not in stage.axes:
        raise typer.BadParameter(f"no such axis (got {name}), known: {known}", param_hint="--axis")
    return name


def _print_identities(opened: OneAxis) -> None:
    for name, identity in opened.identities.items():
        typer.echo(f"{name}: {', '.join(identity)}", err=True)
    typer.echo(f"voltage in force: {opened.session.drive_v:z.2f} V", err=True)
