"""`piezod status` and `piezod faults`: the present state of a stage."""

from collections.abc import Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Final

import typer

from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, new_table, print_json
from piezod.cli.stage_options import SocketOption, StageOption, connect
from piezod.messages import answers
from piezod.messages.answers import STAGE, AxisStatus, Fault, Status
from piezod.messages.documents import Document
from piezod.messages.shown import COLUMN

if TYPE_CHECKING:
    from rich.table import Table


def status(
    stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
) -> None:
    """Print the state, a table of the axes, and the faults."""
    with closing(connect(stage, socket)) as client:  # without what only commands need
        found = client.status()
    if json:
        print_json(found.document)
        return
    console = new_console()
    console.print(_summary(found))
    console.print(axes_table(found))
    if devices := found.devices:
        console.print(_devices(devices))
    if found.processor is not None and found.processor.shared_with:
        console.print(
            f"Processor {found.processor.number} had {found.processor.shared_with + 1} loops when "
            "this one started: cycles may be late; docs/groups.md has the remedy."
        )
    if found.not_realtime:
        console.print(
            f"Not real-time: {', '.join(found.not_realtime)} not obtained; "
            "docs/stage.md has the reasons."
        )
    if found.faults:
        console.print(_faults(found.faults))


def faults(
    stage: StageOption = None,
    socket: SocketOption = None,
    undetected: Annotated[
        bool,
        typer.Option(
            "--undetected", help="Print what is never shown or only partly detected, and why."
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Print a table of the faults with their remedies."""
    if undetected:
        _undetected(json=json)
        return
    with closing(connect(stage, socket)) as client:
        found = client.faults()
    if json:
        print_json(found.document)
    else:
        new_console().print(_faults(found.faults) if found.faults else "no fault")


def _undetected(*, json: bool) -> None:
    """Print what the faults do not show; this needs no running stage."""
    # The tables are those of the control law, which a client of a stage does not need.
    from piezod.control.faults.table import FAULTS
    from piezod.control.faults.unlisted import GAPS, NEVER_SHOWN

    reasons = {"never_shown": dict(NEVER_SHOWN), "gaps": dict(GAPS)}
    if json:
        print_json(reasons)
        return
    names = {rule.id: rule.name for rule in FAULTS}
    console = new_console()
    for key, each in reasons.items():
        console.print(_HEADINGS[key])
        for fault, why in each.items():
            console.print(f"  {fault} {names[fault]}: {why}", soft_wrap=True)


_HEADINGS: Final = {"never_shown": "Never shown:", "gaps": "Partly detected:"}
"""Words for the keys of the reasons."""


def _summary(found: Status) -> str:
    shadow = "in shadow: nothing is written" if found.shadow else ""
    skipped = f"{found.skipped_cycles} skipped cycles" if found.skipped_cycles else ""
    processor = f"processor {found.processor.number}" if found.processor else ""
    columns = (
        f"{field.shown.words} {field.text(getattr(found, name))} {field.unit.sign}".rstrip()
        for name, field in STAGE.items()
        if field.has(COLUMN)
    )
    contour = "" if found.contour_um is None else f"contour error {found.contour_um:.3f}"
    parts = (found.state, shadow, *columns, contour, processor, skipped)
    text = ", ".join(filter(None, parts))
    return f"{found.stage}: {text}" if found.stage else text


def axes_table(found: Status) -> "Table":
    """Return the table of the axes of a stage."""
    table = new_table("axis", right=tuple(column.heading for column in answers.COLUMNS))
    table.add_column("")
    for name, axis in found.axes.items():
        named = name if axis.unit == "µm" else f"{name}, in {axis.unit}"
        shown = (column.text(getattr(axis, column.name)) for column in answers.COLUMNS)
        table.add_row(named, *shown, _remark(axis))
    return table


def _remark(axis: AxisStatus) -> str:
    limited = "" if axis.limited == "none" else f"drive limited: {axis.limited}"
    arrived = "on target" if axis.on_target else ""
    moved = f"moved by {axis.moved_by}" if axis.moved_by else ""
    return ", ".join(filter(None, (limited, arrived if axis.has_sensor else "no sensor", moved)))


def _devices(devices: Sequence[Document]) -> "Table":
    table = new_table("device", "", "used", right=("round trip/µs", "99 %/µs"))
    table.add_column("")
    for each in devices:
        who, took_us = each["identity"], each["round_trip_us"]
        able = [words for key, words in _ABLE.items() if each["capabilities"][key]]
        table.add_row(
            each["name"],
            " ".join((who["maker"], who["model"], who["serial"])),
            each["placement"],
            *(number(took_us[key], 0) for key in ("p50", "p99")),
            ", ".join(able),
        )
    return table


_ABLE: Final = {
    "read_back": "reads back",
    "holds": "holds",
    "enables": "enables",
    "soft_disable": "soft disable",
    "watchdog": "watchdog",
    "quality": "quality",
}
"""Capabilities of a device, and the words for them."""


def number(value: float | None, decimals: int) -> str:
    """Return a number as text; a dash if it is unknown."""
    return "–" if value is None else f"{value:.{decimals}f}"


def _faults(found: Sequence[Fault]) -> "Table":
    table = new_table("fault", "what", "", "remedy")
    for each in found:
        marks = ("present" if each.present else "", "latched" if each.latched else "")
        table.add_row(each.id, each.name, ", ".join(filter(None, marks)), each.remedy)
    return table
