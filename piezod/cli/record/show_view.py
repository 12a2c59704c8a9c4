"""Text and document of `piezod record show`."""

from collections.abc import Iterator
from math import isnan
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from piezod.cli.output import new_table
from piezod.config.yaml_loader import parse_yaml
from piezod.records.recording.summary import Summary, UsedModel


def as_document(recording: Path, size_bytes: int, summary: Summary) -> dict[str, object]:
    """Return the document of `piezod record show --json`."""
    header = summary.header
    return {
        "recording": str(recording),
        "size_bytes": size_bytes,
        "title": header.title,
        "part": header.part,
        "started_at": header.started_at,
        "begin_s": summary.begin_s,
        "end_s": summary.end_s,
        "rate_hz": header.rate_hz,
        "axes": list(header.axes),
        "cycles": summary.cycles,
        "late": summary.late,
        "skipped": summary.skipped,
        "lost": summary.lost,
        "invalid_samples": summary.invalid,
        "states_s": summary.states,
        "errors": [each._asdict() for each in summary.errors],
        "faults": [each._asdict() for each in summary.faults],
        "configuration": header.configuration(),
        "models": [each._asdict() for each in summary.models],
        "events": [each._asdict() for each in summary.events],
    }


def print_summary(
    console: Console, recording: Path, size_bytes: int, summary: Summary, events: int
) -> None:
    """Print what is in a recording."""
    for name, text in _lines(recording, size_bytes, summary):
        console.print(f"{name:14} {text}", soft_wrap=True)
    if summary.errors:
        console.print(_error_table(summary))
    if summary.events and events:
        shown = summary.events[-events:]
        console.print(f"the last {len(shown)} of {len(summary.events)} events")
        for event in shown:
            at_s = (event.t_ns - summary.header.start_ns) / 1e9
            what = " ".join(filter(None, (event.kind, event.fault, event.axis)))
            console.print(f"{at_s:12.3f} s  {what}: {event.text}", soft_wrap=True)


def _lines(recording: Path, size_bytes: int, summary: Summary) -> Iterator[tuple[str, str]]:
    header = summary.header
    part = f", file {header.part} of it" if header.part > 1 else ""
    yield "recording", f"{recording}: {header.title}, {size_bytes / 1e6:.1f} MB{part}"
    yield "time 0", header.started_at
    if not summary.cycles:
        yield "cycles", "none"
        return
    duration_s = summary.end_s - summary.begin_s
    yield "time", f"{summary.begin_s:.3f} to {summary.end_s:.3f} s: {_duration(duration_s)}"
    yield (
        "cycles",
        (
            f"{summary.cycles} at {header.rate_hz:g} Hz; {summary.late} late, "
            f"{summary.skipped} periods skipped, {summary.lost} cycles lost"
        ),
    )
    invalid = (f"{axis}, {count} samples invalid" for axis, count in summary.invalid.items())
    yield "axes", "; ".join(invalid)
    yield "states", ", ".join(f"{name} {time_s:.1f} s" for name, time_s in summary.states.items())
    yield "configuration", _title(header.configuration())
    for model in summary.models:
        since = "" if isnan(model.since_s) else f", adopted at {model.since_s:.3f} s"
        yield f"model {model.axis}", f"{_model_text(model)}{since}"
    for fault in summary.faults:
        yield (
            f"fault {fault.fault}",
            (f"{fault.cycles} cycles, {fault.first_s:.3f} to {fault.last_s:.3f} s"),
        )
    if not summary.faults:
        yield "faults", "none"


def _duration(duration_s: float) -> str:
    minutes, seconds = divmod(duration_s, 60.0)
    if not minutes:
        return f"{seconds:.3f} s"
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours} h {minutes} min {seconds:.0f} s" if hours else f"{minutes} min {seconds:.0f} s"


def _title(document: dict[str, Any] | None) -> str:
    if document is None:
        return "not in the file"
    found = document.get("devices", {}).items()
    devices = ", ".join(f"{name} ({each.get('driver')})" for name, each in found)
    return "; ".join(filter(None, (document.get("title"), f"devices {devices}")))


def _model_text(model: UsedModel) -> str:
    document = parse_yaml(model.text, f"model of axis {model.axis} in the recording").data
    source = document.get("source")
    file = source.get("file") if isinstance(source, dict) else None
    return f"{document.get('method')} of {file}, {document.get('created_at')}"


def _error_table(summary: Summary) -> Table:
    right = ("time (s)", "rms error (µm)", "worst (µm)")
    table = new_table("axis", "in RUN, mode", right=right, no_wrap=True)
    for row in summary.errors:
        numbers = (f"{row.duration_s:.1f}", f"{row.rms_um:.4f}", f"{row.worst_um:.4f}")
        table.add_row(row.axis, row.mode, *numbers)
    return table
