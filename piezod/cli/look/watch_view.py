"""The view of telemetry in `piezod watch`, for terminals of 80 columns and more."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from piezod.cli.look.sparkline import SPAN_S, History, Sparkline
from piezod.cli.look.status import number
from piezod.config.states import State
from piezod.messages.answers import Fault
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry

Bounds: TypeAlias = tuple[float, float]

_STYLES: Final[Mapping[str, str]] = {
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
    """The ranges of the bars of an axis; None if unknown."""

    position_um: Bounds | None  #: Range of the command, in µm.
    drive_v: Bounds | None  #: Range of the drive voltage, in V.
    unit: str = "µm"  #: Unit of the positions; that of a user axis may be µrad.


def ranges_of(config: Mapping[str, Any]) -> dict[str, AxisRanges]:
    """Return the ranges of the axes of a daemon's configuration."""
    ranges = {}
    for name, axis in (config.get("axes", {}) | config.get("user_axes", {})).items():
        limits, command_um = axis.get("limits") or {}, axis.get("command_range_um")
        drive_v = limits.get("drive_min_v"), limits.get("drive_max_v")
        unit = axis.get("unit", "µm")
        ranges[name] = AxisRanges(_bounds(command_um), _bounds(drive_v), unit)
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


class AxisHistory:
    """The last half minute of an axis."""

    def __init__(self) -> None:
        self.error_um = History(max)
        """Largest error without its sign, in µm."""
        self.drive_v = History(lambda values: values[-1])

    def add(self, t_s: float, axis: AxisTelemetry) -> None:
        """Take the next interval."""
        self.error_um.add(t_s, _worst(axis.error_um))
        self.drive_v.add(t_s, axis.drive_v.last)


class WatchView:
    """The view of a stage, which follows its telemetry."""

    def __init__(self, name: str, ranges: Mapping[str, AxisRanges]) -> None:
        self._name, self._ranges = name, ranges
        self._rate, self._late_us = LoopRate(), History(max)
        self._skipped = History(max)
        self._axes: dict[str, AxisHistory] = {}

    def update(self, interval: Telemetry, faults: Sequence[Fault]) -> RenderableType:
        """Take the next interval, and return the view."""
        t_s = interval.t_s
        self._late_us.add(t_s, interval.late_max_us)
        self._skipped.add(t_s, interval.skipped_cycles)
        for name, axis in interval.axes.items():
            self._axes.setdefault(name, AxisHistory()).add(t_s, axis)
        head = self._head(interval), self._timing(interval)
        return Group(*head, *self._tables(interval), _faults(interval.faults, faults))

    def _head(self, interval: Telemetry) -> Text:
        state = Text(interval.state, _STYLES.get(interval.state, "bold yellow"))
        shadow = "   in shadow: nothing is written" if interval.shadow else ""
        return Text.assemble((self._name, "bold"), "   ", state, shadow)

    def _timing(self, interval: Telemetry) -> Text:
        late, skipped = self._late_us.range, self._skipped.range
        new = round(skipped[1] - skipped[0]) if skipped else 0
        worst = number(late[1] if late else None, 0)
        rate = number(self._rate.hz(interval), 0)
        cycles = f"{interval.skipped_cycles} skipped, {new} of them in the last {SPAN_S:.0f} s"
        style = "yellow" if new else "dim"
        return Text.assemble(f"{rate} Hz   late up to {worst} µs   ", (cycles, style))

    def _tables(self, interval: Telemetry) -> Iterator[Table]:
        for name, axis in interval.axes.items():
            table = Table.grid(padding=(0, 1), expand=True)
            table.add_column(width=9)
            table.add_column(width=12, justify="right")
            table.add_column(width=20, style="dim")
            table.add_column(ratio=1)
            ranges = self._ranges.get(name, AxisRanges(None, None))
            for row in _rows(name, axis, ranges, self._axes[name]):
                table.add_row(*row)
            yield table


def view_line(interval: Telemetry, ranges: Mapping[str, AxisRanges]) -> str:
    """Return the view of an interval as one line."""
    units = {name: ranges[name].unit if name in ranges else "µm" for name in interval.axes}
    axes = (
        f"{name}: {number(axis.position_um.last, 3)} {units[name]}, "
        f"error {number(axis.error_um.last, 3)} {units[name]}, {number(axis.drive_v.last, 2)} V"
        for name, axis in interval.axes.items()
    )
    faults = f"faults {', '.join(interval.faults)}" if interval.faults else ""
    return "; ".join(filter(None, (interval.state, *axes, faults)))


def _rows(
    name: str, axis: AxisTelemetry, ranges: AxisRanges, history: AxisHistory
) -> Iterator[Sequence[RenderableType]]:
    """Yield the lines of an axis: heading, position, error and drive."""
    yield "", "", "", ""
    arrived = Text("on target", "green") if axis.on_target else ""
    yield Text(name, "bold"), Text(axis.mode, "cyan"), arrived, Text(f"last {SPAN_S:.0f} s", "dim")
    position_um, error_um, drive_v = axis.position_um, axis.error_um, axis.drive_v
    unit = ranges.unit
    command = f"of {number(axis.command_um.last, 3)} {unit}"
    bar = _bar(position_um.last, ranges.position_um)
    yield "position", f"{number(position_um.last, 3)} {unit}", command, bar
    worst_um = history.error_um.range or (None, None)
    # From 0, because the sign is left out.
    line = Sparkline(history.error_um, low=0.0, style="yellow")
    worst = f"up to {number(worst_um[1], 3)} {unit}"
    yield "error", f"{number(error_um.last, 3)} {unit}", worst, line
    low_v, high_v = history.drive_v.range or (None, None)
    between = f"{number(low_v, 1)} to {number(high_v, 1)} V"
    lowest_v, highest_v = ranges.drive_v or (None, None)
    line = Sparkline(history.drive_v, lowest_v, highest_v, style="cyan")
    yield "drive", f"{number(drive_v.last, 2)} V", between, line


def _worst(error_um: Range) -> float | None:
    """Return the largest error without its sign; None if it is unknown."""
    found = [abs(each) for each in (error_um.min, error_um.max) if each is not None]
    return max(found, default=None)


def _bar(value: float | None, bounds: Bounds | None) -> RenderableType:
    """Return a bar that shows the share of a range."""
    if value is None or bounds is None:
        return ""
    low, high = bounds
    share = min(max((value - low) / (high - low), 0.0), 1.0)
    return ProgressBar(total=1.0, completed=share, finished_style="bar.complete")


def _faults(ids: Sequence[str], faults: Sequence[Fault]) -> Text:
    """Return the faults, with the remedies that are known, one per line."""
    if not ids:
        return Text("\nno fault", "dim")
    known = {fault.id: fault for fault in faults}
    text = Text()
    for each in ids:
        fault = known.get(each, Fault(id=each, remedy="`piezod faults` shows more"))
        gone = "" if fault.present else " (gone)"
        text.append(f"\n{' '.join((each, fault.name)).rstrip()}{gone}", "bold red")
        text.append(f": {fault.remedy}")
    return text
