"""How the result of an experiment is told: a table for people, a document for programs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from piezod.experiment.error_rows import error_rows
from piezod.experiment.outputs import DATA_NAME
from piezod.records.error_table import Cell, Row, error_table, verdict
from piezod.records.labels import metric_label, metric_number, metric_text
from piezod.records.recording import ExperimentResult, Identification
from piezod.records.reference import Reference

Key: TypeAlias = tuple[str, str]
"""Axis and case."""


def as_document(result: ExperimentResult, report: Path) -> dict[str, object]:
    """Return the document of `piezod experiment --json`.

    Args:
        result: The experiment.
        report: Path of the report.
    """
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
    """Print errors beside those of the reference, the models, warnings, and where the report is.

    Args:
        console: Where to.
        result: The experiment.
        reference: Errors to compare with, where there are any.
        report: Path of the report.
    """
    errors = error_table(result, reference)
    console.print(_table(result, errors, reference))
    console.print("Errors are those of the measured displacement, in % of its range.")
    if reference:
        console.print(verdict(errors, reference))
    for each in result.identifications:
        console.print(_model(each))
    for warning in result.warnings:
        console.print(f"! {warning}", style="yellow")
    console.print(f"Report: {report}", soft_wrap=True)


def _table(
    result: ExperimentResult, errors: Mapping[Key, Sequence[Row]], reference: Reference | None
) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    several_axes = len(result.axes) > 1
    for heading in ("axis", "case", "mode")[not several_axes :]:
        table.add_column(heading)
    for name in result.metric_names:
        table.add_column(metric_label(name).replace(" ", "\n"), justify="right")
    if reference:
        table.add_column(reference.label, justify="right")
    for key, rows in errors.items():
        for index, row in enumerate(rows):
            where = [part if index == 0 else "" for part in key[not several_axes :]]
            cells = [_number(cell) for cell in row.cells]
            theirs = [_theirs(row, reference)] if reference else []
            table.add_row(*where, row.mode, *cells, *theirs)
        table.add_section()
    return table


def _number(cell: Cell) -> Text:
    number = metric_number(cell.metric, cell.value)
    if cell.missed:
        return Text(f"▲ {number}", style="bold red")
    return Text(number, style="bold" if cell.best else "")


def _theirs(row: Row, reference: Reference) -> str:
    if row.reference is None:
        return ""
    return metric_number(reference.metrics[0], row.reference)


def _model(identification: Identification) -> str:
    errors = ", ".join(metric_text(*item) for item in identification.fit_errors.items())
    delay_s = float(identification.parameters["delay_s"])
    return (
        f"Model of axis {identification.axis} by {identification.method}, "
        f"{identification.title}: {errors}; delay {1000.0 * delay_s:.2g} ms."
    )
