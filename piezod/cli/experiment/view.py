"""The output of `piezod experiment`: a table for people, a document for programs."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from piezod.cli.output import print_warnings
from piezod.experiment.error_rows import error_rows
from piezod.experiment.outputs import DATA_NAME
from piezod.records.error_table import ErrorCell, ErrorRow, error_table, groups, meaning, verdict
from piezod.records.experiment_result import ExperimentResult, Identification
from piezod.records.labels import metric_heading, metric_number, metric_text
from piezod.records.reference import Reference

_UNCERTAINTY: Final = "delay_uncertainty_ms"
Key: TypeAlias = tuple[str, str]
"""Axis and case."""


def as_document(result: ExperimentResult, report: Path) -> dict[str, object]:
    """Return the document of `piezod experiment --json`."""
    methods = {each.axis: each.method for each in result.identifications}
    return {
        "title": result.title,
        "seed": result.seed,
        "cases": error_rows(result),
        "model": {
            "method": ", ".join(dict.fromkeys(methods.values())),
            "axes": {
                each.axis: {
                    "method": each.method,
                    "source": each.title,
                    "delay_s": float(each.parameters["delay_s"]),
                    **each.fit_errors,
                }
                for each in result.identifications
            },
        },
        "warnings": result.warnings,
        "report": str(report),
        "data": str(report.with_name(DATA_NAME)),
    }


def print_result(
    console: Console, result: ExperimentResult, reference: Reference | None, report: Path
) -> None:
    """Print the errors beside the reference, the models, the warnings, and the report's path."""
    errors = error_table(result, reference)
    console.print(_table(result, errors, reference))
    console.print(meaning(result.metric_names))
    if reference:
        console.print(verdict(errors, reference))
    for each in result.identifications:
        console.print(_model(each))
    print_warnings(console, result.warnings)
    console.print(f"Report: {report}", soft_wrap=True)


def _table(
    result: ExperimentResult, errors: Mapping[Key, Sequence[ErrorRow]], reference: Reference | None
) -> Table:
    # All six errors must fit into 80 columns.
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("case")
    table.add_column("mode", no_wrap=True)
    for heading in _headings(result.metric_names):
        table.add_column(heading, justify="right", no_wrap=True)
    if reference:
        table.add_column(reference.label, justify="right")
    several_axes = len(result.axes) > 1
    for (axis, case), rows in errors.items():
        for index, row in enumerate(rows):
            where = f"{case}, axis {axis}" if several_axes else case
            cells = [_number(cell) for cell in row.cells]
            compared = [_reference(row, reference)] if reference else []
            table.add_row("" if index else where, row.mode, *cells, *compared)
        table.add_section()
    return table


def _headings(metrics: Sequence[str]) -> Iterator[str]:
    """Yield three lines each: the group above its first metric, and the metric."""
    for group, names in groups(metrics):
        for index, name in enumerate(names):
            heading = metric_heading(name).replace("nonlinearity", "nonlin- earity")
            words = heading.split(" ", maxsplit=1)
            yield "\n".join(("" if index else group, *[""] * (2 - len(words)), *words))


def _number(cell: ErrorCell) -> Text:
    number = metric_number(cell.metric, cell.value)
    if cell.missed:
        return Text(f"▲ {number}", style="bold red")
    return Text(number, style="bold" if cell.best else "")


def _reference(row: ErrorRow, reference: Reference) -> str:
    if row.reference is None:
        return ""
    return metric_number(reference.metrics[0], row.reference)


def _model(identification: Identification) -> str:
    errors = ", ".join(
        metric_text(*item) for item in identification.fit_errors.items() if item[0] != _UNCERTAINTY
    )
    delay_s = float(identification.parameters["delay_s"])
    uncertainty_ms = identification.fit_errors.get(_UNCERTAINTY)
    margin = "" if uncertainty_ms is None else f" ± {uncertainty_ms:.2g}"
    return (
        f"Model of axis {identification.axis} by {identification.method}, "
        f"{identification.title}: {errors}; delay {1000.0 * delay_s:.2g}{margin} ms."
    )
