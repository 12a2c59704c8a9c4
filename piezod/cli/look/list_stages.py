"""`piezod list`: the stages of this machine."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, print_json
from piezod.client.listing import ListedStage, list_stages


def list_running(json: JsonOption = False) -> None:
    """List the running stages of this machine.

    Prints name, state, rate, processor, axes, holder of the lease and socket of each. A stage whose
    daemon does not answer within 2 s is listed with the reason.
    """
    print_stages(list_stages(), json=json)


def print_stages(stages: Sequence[ListedStage], *, json: bool) -> None:
    """Print a line for each stage, or one document."""
    console = new_console()
    if json:
        print_json({"stages": [_document(each) for each in stages]})
    elif stages:
        for line in _lines(stages):
            console.print(line, soft_wrap=True)
    else:
        console.print("no stage is running; `piezod run CONFIG` starts one")


def _document(listed: ListedStage) -> dict[str, Any]:
    status, socket = listed.status, listed.socket
    short = {"stage": listed.name, "socket": socket and str(socket), "why": listed.why}
    if status is None:
        return {**short, "state": None}
    return {
        **short,
        "state": status.state,
        "mode": status.mode,
        "axes": list(status.axes),
        "rate_hz": status.rate_hz,
        "processor": status.document.get("processor"),
        "lease": status.document.get("lease"),
        "faults": [fault.id for fault in status.faults],
    }


_HEADINGS: Final = (
    "stage", "state", "rate/Hz", "processor", "axes", "faults", "lease", "socket",
)  # fmt: skip


def _lines(stages: Sequence[ListedStage]) -> Iterator[str]:
    """Yield a line for each stage; a path is longer than a table on a console can show."""
    rows = [_HEADINGS, *map(_row, stages)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(map(str.ljust, row, widths)).rstrip()


def _row(listed: ListedStage) -> tuple[str, ...]:
    status, socket = listed.status, str(listed.socket or "–")
    if status is None:
        return (listed.name, "?", "–", "–", "–", "–", "–", f"{socket}  ! {listed.why}")
    return (
        listed.name,
        status.state,
        "–" if status.rate_hz is None else f"{status.rate_hz:g}",
        str(status.processor.number) if status.processor else "–",
        ",".join(status.axes),
        ",".join(fault.id for fault in status.faults) or "none",
        listed.lease_holder or "free",
        socket,
    )
