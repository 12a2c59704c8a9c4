"""The view of one interval of telemetry in `piezod watch`."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from rich import box
from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from piezod.cli.status import number
from piezod.client.telemetry import AxisTelemetry, Range, Telemetry
from piezod.config.states import State

Bounds: TypeAlias = tuple[float, float]

_BAR_WIDTH = 14
_STYLES: Mapping[str, str] = {
    State.RUN: "bold green",
    State.IDENT: "bold green",
    State.READY: "bold cyan",
    State.SAFE: "bold",
    State.BOOT: "bold",
    State.FAULT: "bold red",
    State.ESTOP: "bold red",
    State.BLIND: "bold red",
}


class AxisRanges(NamedTuple):
    """The ranges of the bars of an axis; None if unknown.

    Attributes:
        position_um: Range of the command, in µm.
        drive_v: Range of the drive voltage, in V.
    """

    position_um: Bounds | None
    drive_v: Bounds | None


def ranges_of(config: Mapping[str, Any]) -> dict[str, AxisRanges]:
    """Return the ranges of the axes of a daemon's configuration."""
    ranges = {}
    for name, axis in config.get("axes", {}).items():
        limits, command_um = axis.get("limits") or {}, axis.get("command_range_um")
        drive_v = limits.get("drive_min_v"), limits.get("drive_max_v")
        ranges[name] = AxisRanges(_bounds(command_um), _bounds(drive_v))
    return ranges


def _bounds(found: Sequence[float | None] | None) -> Bounds | None:
    low, high = found or (None, None)
    return None if low is None or high is None else (low, high)


class LoopRate:
    """Computes the rate of the loop from successive intervals."""

    def __init__(self) -> None:
        self._before_s: float | None = None

    def hz(self, interval: Telemetry) -> float | None:
        """Return the rate in an interval, in Hz; None for the first interval."""
        before_s, self._before_s = self._before_s, interval.t_s
        if before_s is None or interval.t_s <= before_s:
            return None
        return (interval.cycles + interval.lost) / (interval.t_s - before_s)


def view(
    interval: Telemetry, ranges: Mapping[str, AxisRanges], rate_hz: float | None
) -> RenderableType:
    """Return the view of an interval for a terminal.

    Args:
        interval: The interval.
        ranges: Ranges of the bars, by axis.
        rate_hz: Rate of the loop, in Hz; None if unknown.
    """
    state = Text(interval.state, _STYLES.get(interval.state, "bold yellow"))
    shadow = ", in shadow: nothing is written" if interval.shadow else ""
    loop = f"   {number(rate_hz, 0)} Hz, {interval.skipped_cycles} skipped cycles"
    return Group(Text.assemble(state, shadow, loop), _table(interval, ranges), _faults(interval))


def view_line(interval: Telemetry) -> str:
    """Return the view of an interval as one line."""
    axes = (
        f"{name}: {number(axis.position_um.last, 3)} µm, error {number(axis.error_um.last, 3)} µm, "
        f"{number(axis.drive_v.last, 2)} V"
        for name, axis in interval.axes.items()
    )
    faults = f"faults {', '.join(interval.faults)}" if interval.faults else ""
    return "; ".join(filter(None, (interval.state, *axes, faults)))


def _table(interval: Telemetry, ranges: Mapping[str, AxisRanges]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("axis")
    for heading in ("position/µm", "command/µm", "error/µm", "worst", "drive/V"):
        table.add_column(heading, justify="right")
    for name, axis in interval.axes.items():
        table.add_row(*_cells(name, axis, ranges.get(name, AxisRanges(None, None))))
    return table


def _cells(name: str, axis: AxisTelemetry, ranges: AxisRanges) -> Iterator[RenderableType]:
    yield f"{name}\n{axis.mode}"
    yield _with_bar(axis.position_um.last, 3, ranges.position_um)
    yield number(axis.command_um.last, 3)
    yield number(axis.error_um.last, 3)
    yield number(_worst(axis.error_um), 3)
    yield _with_bar(axis.drive_v.last, 2, ranges.drive_v)


def _worst(error_um: Range) -> float | None:
    found = [each for each in (error_um.min, error_um.max) if each is not None]
    return max(found, key=abs, default=None)


def _with_bar(value: float | None, decimals: int, bounds: Bounds | None) -> RenderableType:
    """Return a number above a bar that shows its share of the range."""
    text = Text(number(value, decimals), justify="right")
    if value is None or bounds is None:
        return text
    low, high = bounds
    share = min(max((value - low) / (high - low), 0.0), 1.0)
    bar = ProgressBar(total=1.0, completed=share, width=_BAR_WIDTH, finished_style="bar.complete")
    return Group(text, bar)


def _faults(interval: Telemetry) -> Text:
    if not interval.faults:
        return Text("no fault")
    return Text(f"faults {', '.join(interval.faults)}: `piezod faults` shows more", "bold red")
