"""What a scan is: lines that sweep an axis, a raster of them, or a stack of planes."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.document import Document, SourcePlace
from piezod.config.fields import BrokenRule, ConfigModel, Context, Quantity
from piezod.config.messages import suggest
from piezod.config.play import IntervalUs
from piezod.config.quantities import ModeName, Name, OneLine, PositionUm
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml
from piezod.errors import ConfigError, Problem

KEY: Final = "scan"
MOST_PIXELS: Final = 10_000
"""Most pixels of a line, and most lines, repeats or planes."""
LEAST_SPAN_UM: Final = 1e-4
MODE_PERIODS: Final = 2.0
"""A turn lasts at least this many periods of the first mode: above 1 / (half a turn) its spectrum
is that of a smooth pulse, which hardly excites anything."""

Count: TypeAlias = Annotated[int, Quantity(1, MOST_PIXELS)]
PulseLine: TypeAlias = Annotated[int, Quantity(1, 8)] | Name


class SpanConfig(ConfigModel):
    """The part of an axis that is scanned."""

    axis: Name = Field(description="Name of the axis.")
    from_um: PositionUm = Field(description="Outer edge of the first pixel, µm.")
    to_um: PositionUm = Field(description="Outer edge of the last pixel, µm.")
    pixels: Count = Field(description="Number of pixels, lines or planes.")

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if abs(self.to_um - self.from_um) < LEAST_SPAN_UM:
            yield (
                ("to_um",),
                f"must differ from from_um by {LEAST_SPAN_UM:g} µm or more (got {self.to_um:g} µm)",
            )


class PulsesConfig(ConfigModel):
    """Pulses in step with the motion, each on a line of its own.

    A line is the number of one of the device that plays the scan, or the name of one of the loop.
    """

    pixel: PulseLine | None = Field(
        default=None, description="Line that pulses at the lower edge of each pixel, or plane."
    )
    line: PulseLine | None = Field(
        default=None, description="Line that pulses at the first pixel of each sweep."
    )
    frame: PulseLine | None = Field(
        default=None, description="Line that pulses at the first pixel of the frame."
    )

    @property
    def given(self) -> dict[str, int | str]:
        """The lines that are given, by their key."""
        return self.model_dump(exclude_none=True)

    @property
    def numbers(self) -> dict[str, int]:
        """The lines of a device that plays, by their key."""
        return {key: line for key, line in self.given.items() if isinstance(line, int)}

    @property
    def highest(self) -> int:
        """Highest number of a line; 0 without one."""
        return max(self.numbers.values(), default=0)

    def _broken_rules(self) -> Iterator[BrokenRule]:
        used: dict[int | str, str] = {}
        for name, number in self.given.items():
            if number in used:
                yield (name,), f"line {number} is that of {used[number]}: each needs its own"
            used[number] = name


class _Scan(ConfigModel):
    """What all scans have."""

    title: OneLine = Field(default="", max_length=80, description="Title, for people.")
    interval_us: IntervalUs = Field(
        default=50.0, description="Time between two points of the device's table, µs."
    )
    passes: Annotated[int, Quantity(0, 20)] = Field(
        default=4, description="Largest number of corrections of the lines, and of the frame."
    )
    pulses: PulsesConfig = Field(default=PulsesConfig(), description="Pulses of the device.")
    mode: ModeName | None = Field(
        default=None,
        description="Mode in which the loop scans, at its own rate; default: a device plays the "
        "scan from a table.",
    )
    start: Literal["at once", "edge"] = Field(
        default="at once",
        description="edge: the stored frame starts at a rising edge of the device's trigger input, "
        "or of a line of the loop.",
    )
    within_s: Annotated[float, Quantity(0.01, 3600, "s")] = Field(
        default=10.0, description="Longest wait for an edge, s; the scan ends there without one."
    )

    edge: Name | None = Field(
        default=None, description="Line of the loop with these edges, in a scan with `mode`."
    )

    @property
    def waits(self) -> bool:
        """Whether it waits for edges."""
        return self.start == "edge"

    def _broken_rules(self) -> Iterator[BrokenRule]:
        by_loop = self.mode is not None
        for key, line in self.pulses.given.items():
            if isinstance(line, str) is not by_loop:
                what = "the name of an output in `lines:` of the stage" if by_loop else "a number"
                by = "the loop scans in mode" if by_loop else "a device plays a scan without `mode`"
                yield ("pulses", key), f"must be {what} (got {line}): {by}"
        if (self.edge is not None) is not (by_loop and self.waits):
            what = "nothing of the loop waits: leave it out"
            if self.edge is None:
                what = "name the line of the loop whose edges the scan waits for"
            yield ("edge",), what

    @property
    def interval_ns(self) -> int:
        """Time between two points of the table, in ns."""
        return round(1000.0 * self.interval_us)

    @property
    @abstractmethod
    def spans(self) -> tuple[SpanConfig, ...]:
        """The scanned axes, the fastest first."""


class _Swept(_Scan):
    """A scan whose lines sweep an axis."""

    fast: SpanConfig = Field(description="Axis that is swept in each line.")
    sweeps: Literal["forward", "snake", "both"] = Field(
        default="snake",
        description="forward: each line is swept forward, with a flyback; snake: every other line "
        "backward; both: each line forward, then backward.",
    )
    lines_per_s: Annotated[float, Quantity(1e-3, 1000, "lines/s")] = Field(
        description="Lines per second, turns included."
    )
    turn_share: Annotated[float, Quantity(0.02, 0.9)] = Field(
        default=0.2, description="Least share of a sweep's time that is for the turn after it."
    )

    @property
    def sweeps_per_line(self) -> int:
        """Number of sweeps of a line."""
        return 2 if self.sweeps == "both" else 1

    @property
    def sweep_s(self) -> float:
        """Time of a sweep with its turn, in s."""
        return 1.0 / (self.lines_per_s * self.sweeps_per_line)

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if self.mode is not None:
            return  # the loop has a clock of its own
        points = self.sweep_s * (1.0 - self.turn_share) / (1e-6 * self.interval_us)
        least = 2 if self.pulses.pixel is not None else 1
        if points < least * self.fast.pixels:
            slowest = 1e6 * (1.0 - self.turn_share) / self.sweeps_per_line
            slowest /= least * self.fast.pixels * self.interval_us
            with_pulses = ", two of which make a pulse" if least == 2 else ""
            yield (
                ("lines_per_s",),
                f"a pixel lasts {points / self.fast.pixels * self.interval_us:.4g} µs (got "
                f"{self.lines_per_s:g} lines/s), allowed: at least {least * self.interval_us:g} "
                f"µs, {least} points of the table{with_pulses}; at most {slowest:.4g} lines/s",
            )


class RasterScan(_Swept):
    """Lines of one axis, and another axis that steps from line to line."""

    kind: Literal["raster"] = "raster"
    slow: SpanConfig = Field(description="Axis that steps from line to line.")

    @property
    def spans(self) -> tuple[SpanConfig, ...]:
        """The scanned axes, the fastest first."""
        return self.fast, self.slow

    @property
    def lines(self) -> int:
        """Number of lines."""
        return self.slow.pixels

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if self.fast.axis == self.slow.axis:
            yield ("slow", "axis"), f"is the fast axis, too (got {self.slow.axis!r})"


class LineScan(_Swept):
    """The same line again and again."""

    kind: Literal["line"] = "line"
    repeats: Count = Field(description="How often the line is swept.")

    @property
    def spans(self) -> tuple[SpanConfig, ...]:
        """The scanned axes, the fastest first."""
        return (self.fast,)

    @property
    def lines(self) -> int:
        """Number of lines."""
        return self.repeats


class StackScan(_Scan):
    """Planes of one axis, one after the other: a z-stack."""

    kind: Literal["stack"] = "stack"
    planes: SpanConfig = Field(description="Axis that steps from plane to plane.")
    plane_s: Annotated[float, Quantity(1e-4, 3600, "s")] = Field(
        description="Time that a plane is held, s."
    )
    move_s: Annotated[float, Quantity(1e-4, 60, "s")] = Field(
        description="Time to go to the next plane and to settle there, s."
    )
    step: Literal["time", "edge"] = Field(
        default="time",
        description="edge: each rising edge of the device's trigger input, or of a line of the "
        "loop, ends a plane, and the stage goes to the next one; plane_s and move_s are the "
        "shortest times.",
    )

    @property
    def spans(self) -> tuple[SpanConfig, ...]:
        """The scanned axis."""
        return (self.planes,)

    @property
    def waits(self) -> bool:
        """Whether it waits for edges."""
        return "edge" in {self.start, self.step}

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if self.step == self.start == "edge":
            yield ("start",), "leave it out: with `step: edge` the first plane waits for an edge"
        if self.mode is not None:
            return
        least_s = 2e-6 * self.interval_us
        for key in ("plane_s", "move_s"):
            value_s = getattr(self, key)
            if value_s < least_s:
                yield (
                    (key,),
                    f"shorter than two points of the table (got {value_s:g} s), allowed: at least "
                    f"{least_s:g} s",
                )


AnyScan: TypeAlias = RasterScan | LineScan | StackScan
ScanConfig: TypeAlias = Annotated[AnyScan, Field(discriminator="kind")]


def broken_scan(
    scan: AnyScan, ranges: Mapping[str, tuple[float, float] | None]
) -> Iterator[BrokenRule]:
    """Yield what does not fit between a scan and the axes of a stage.

    Args:
        scan: The scan.
        ranges: Lowest and highest command of each axis that may be scanned, in its unit; None for
            an axis without limits of its own.
    """
    names = (
        ("fast", "slow")
        if len(scan.spans) == 2
        else (("planes",) if isinstance(scan, StackScan) else ("fast",))
    )
    for key, span in zip(names, scan.spans, strict=True):
        if span.axis not in ranges:
            yield (key, "axis"), f"no such axis, {suggest(span.axis, list(ranges), 'known')}"
        elif (allowed := ranges[span.axis]) is not None:
            yield from _outside(key, span, allowed)


def _outside(key: str, span: SpanConfig, allowed: tuple[float, float]) -> Iterator[BrokenRule]:
    margin = 1e-9 * (allowed[1] - allowed[0])
    for end in ("from_um", "to_um"):
        value_um = getattr(span, end)
        if not allowed[0] - margin <= value_um <= allowed[1] + margin:
            yield (
                (key, end),
                f"outside the range of axis {span.axis} (got {value_um:g}), allowed range "
                f"{allowed[0]:g} to {allowed[1]:g}",
            )


class _File(ConfigModel):
    scan: ScanConfig


def scan_from(data: Mapping[str, Any]) -> AnyScan:
    """Return the scan that the contents of `scan:` describe.

    Raises:
        ConfigError: If they are not valid.
    """
    document = Document("scan", {KEY: dict(data)}, {(): SourcePlace(0, 0)}, {})
    return validate(document, _File, Context()).scan


def load_scan(path: Path) -> AnyScan:
    """Return the `scan:` of a file: an experiment, or a file with that key alone.

    Raises:
        ConfigError: If the file cannot be read, or has no valid scan.
    """
    document = load_yaml(path)
    if KEY not in document.data:
        what = f"there is no `{KEY}:`, which describes lines, a raster or a stack"
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    data = {KEY: document.data[KEY]}
    only = Document(document.file, data, document.values, document.keys)
    return validate(only, _File, Context(path.parent)).scan
