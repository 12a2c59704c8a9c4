"""What a scan is: lines that sweep an axis, a raster of them, a stack of planes, or a spiral."""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, NamedTuple, TypeAlias

from pydantic import Field

from piezod.config.channels import LineCalibration
from piezod.config.document import Document, SourcePlace
from piezod.config.fields import BrokenRule, ConfigModel, Context, Quantity
from piezod.config.messages import suggest
from piezod.config.play import IntervalUs
from piezod.config.quantities import ModeName, Name, OneLine, PositionUm
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml
from piezod.errors import ConfigError, Problem

if TYPE_CHECKING:
    from piezod.config.axes import AxisConfig

KEY: Final = "scan"
MOST_PIXELS: Final = 10_000
"""Most pixels of a line, and most lines, repeats or planes."""
LEAST_SPAN_UM: Final = 1e-4
LEAST_APART: Final = 3
"""Fewest points of the table between pulses at two positions: each is high and low in between."""
MODE_PERIODS: Final = 2.0
"""A turn lasts at least this many periods of the first mode: above 1 / (half a turn) its spectrum
is that of a smooth pulse, which hardly excites anything."""

Count: TypeAlias = Annotated[int, Quantity(1, MOST_PIXELS)]
DeviceLine: TypeAlias = Annotated[int, Quantity(1, 8)]
PulseLine: TypeAlias = DeviceLine | Name


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


class PositionsConfig(ConfigModel):
    """Positions at which a line pulses, each time that a sweep passes one."""

    line: DeviceLine = Field(description="Line that pulses.")
    positions_um: Annotated[tuple[PositionUm, ...], Field(max_length=MOST_PIXELS)] = Field(
        default=(), description="The positions, µm; or `step_um`."
    )
    step_um: Annotated[float, Quantity(LEAST_SPAN_UM, 1e5, "µm")] | None = Field(
        default=None, description="Distance between two positions, the first at from_um, µm."
    )
    from_um: PositionUm | None = Field(default=None, description="First one; default: of `fast`.")
    to_um: PositionUm | None = Field(default=None, description="Last one; default: of `fast`.")
    way: Literal["forward", "backward", "both"] = Field(
        default="both", description="Sweeps in which it pulses."
    )
    by: Literal["time", "device"] = Field(
        default="time",
        description="time: at the points at which the learned motion passes; device: the device "
        "compares its sensor, in one direction, with a step.",
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        given = (self.step_um is not None) + bool(self.positions_um)
        if given != 1:
            yield ("step_um",), "give either `step_um` or `positions_um`"
        elif self.positions_um and (self.from_um, self.to_um) != (None, None):
            yield ("from_um",), "belongs to `step_um`: leave it out with `positions_um`"
        if self.by == "device" and (self.way == "both" or self.step_um is None):
            yield ("by",), "a device compares one way, in even steps: give `way` and `step_um`"

    def along(self, swept: SpanConfig) -> tuple[float, ...]:
        """Return the positions in the order of a forward sweep, in µm."""
        first_um = swept.from_um if self.from_um is None else self.from_um
        last_um = swept.to_um if self.to_um is None else self.to_um
        back = swept.to_um < swept.from_um
        if self.step_um is None:
            return tuple(sorted(set(self.positions_um), reverse=back))
        steps = min(int(abs(last_um - first_um) / self.step_um + 1e-9), MOST_PIXELS)
        step_um = self.step_um if last_um > first_um else -self.step_um
        return tuple(sorted((first_um + k * step_um for k in range(steps + 1)), reverse=back))


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
    at: PositionsConfig | None = Field(
        default=None, description="Line that pulses where the fast axis passes positions."
    )

    @property
    def given(self) -> dict[str, int | str]:
        """The lines that are given, by their key."""
        at = None if self.at is None else self.at.line
        kinds = {"pixel": self.pixel, "line": self.line, "frame": self.frame, "at": at}
        return {key: line for key, line in kinds.items() if line is not None}

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

    span_keys: ClassVar[tuple[str, ...]]
    """Keys of the scanned axes, the fastest first."""

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
        if by_loop and self.pulses.at is not None:
            yield ("pulses", "at"), "belongs to a scan that a device plays: leave out `mode`"
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
    def spans(self) -> tuple[SpanConfig, ...]:
        """The scanned axes, the fastest first."""
        return tuple(getattr(self, key) for key in self.span_keys)


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
    @abstractmethod
    def lines(self) -> int:
        """Number of lines."""

    @property
    def sweep_s(self) -> float:
        """Time of a sweep with its turn, in s."""
        return 1.0 / (self.lines_per_s * self.sweeps_per_line)

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if self.mode is not None:
            return  # the loop has a clock of its own
        if self.pulses.at is not None:
            for key, what in self._broken_positions(self.pulses.at):
                yield ("pulses", "at", *key), what
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

    def _broken_positions(self, at: PositionsConfig) -> Iterator[BrokenRule]:
        """Yield why the device cannot pulse at positions, by the motion that it has learned."""
        fast, key = self.fast, "positions_um" if at.positions_um else "from_um"
        positions_um, ends_um = at.along(fast), sorted((fast.from_um, fast.to_um))
        if len(positions_um) > MOST_PIXELS:
            what = f"makes more than {MOST_PIXELS} positions (got {at.step_um or 0:g} µm)"
            yield ("step_um",), f"{what}: choose a longer one"
            return
        for value_um in positions_um:
            if not ends_um[0] - 1e-9 <= value_um <= ends_um[1] + 1e-9:
                what = f"outside the sweep (got {value_um:g} µm), allowed range {ends_um[0]:g} to"
                yield (key,), f"{what} {ends_um[1]:g} µm: that of `fast`"
                return
        if at.by == "device" and len(positions_um) < 2:
            yield ("by",), "a device compares even steps, this is one position: by time"
        if at.way == "backward" and self.sweeps == "forward":
            yield ("way",), "no sweep goes backward (got sweeps forward): choose snake or both"
        by_time, least = at.by == "time", 4 if self.sweeps == "snake" else 2
        if by_time and self.passes < 1:
            yield (), "the motion is not learned with `passes: 0`: pulses need 1 or more"
        if by_time and self.lines < least:
            what = f"the motion is the mean of its repeats, {self.lines} lines show none"
            yield (), f"{what}, allowed: at least {least} lines"
        least_um = min((abs(b - a) for a, b in pairwise(positions_um)), default=math.inf)
        speed = abs(fast.to_um - fast.from_um) / (self.sweep_s * (1.0 - self.turn_share))
        apart_us = 1e6 * least_um / speed
        if apart_us < LEAST_APART * self.interval_us:
            yield (
                ("step_um",) if at.step_um else (key,),
                f"positions {least_um:.4g} µm apart are passed within {apart_us:.4g} µs, allowed: "
                f"at least {LEAST_APART * self.interval_us:g} µs, {LEAST_APART} points of the "
                "table: sweep more slowly, or choose a shorter interval",
            )


class RasterScan(_Swept):
    """Lines of one axis, and another axis that steps from line to line."""

    kind: Literal["raster"] = "raster"
    slow: SpanConfig = Field(description="Axis that steps from line to line.")
    span_keys = ("fast", "slow")

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
    span_keys = ("fast",)

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
    span_keys = ("planes",)

    @property
    def waits(self) -> bool:
        """Whether it waits for edges."""
        return "edge" in {self.start, self.step}

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if self.pulses.at is not None:
            yield ("pulses", "at"), "a stack holds its planes: let each pulse (pixel)"
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


class SpiralScan(_Scan):
    """A spiral of two axes from the centre out, at a constant speed where the modes allow it."""

    kind: Literal["spiral"] = "spiral"
    x: SpanConfig = Field(description="First axis; `pixels` are those across the spiral.")
    y: SpanConfig = Field(description="Second axis, with as many pixels.")
    pixel_s: Annotated[float, Quantity(1e-5, 10, "s")] = Field(description="Time of a pixel, s.")
    back_s: Annotated[float, Quantity(1e-4, 60, "s")] = Field(
        default=0.1, description="Time of the way back to the centre, s."
    )
    span_keys = ("x", "y")

    @property
    def points_of_pixel(self) -> int:
        """Points of the table in a pixel."""
        return max(1, round(1e6 * self.pixel_s / self.interval_us))

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if self.x.axis == self.y.axis:
            yield ("y", "axis"), f"is the first axis, too (got {self.y.axis!r})"
        if self.x.pixels < 2:
            yield ("x", "pixels"), "a spiral has a turn or more: at least 2 (got 1)"
        if self.y.pixels != self.x.pixels:
            what = f"both axes have the same turns (got {self.y.pixels}), allowed: {self.x.pixels}"
            yield ("y", "pixels"), what
        if self.mode is not None:
            yield ("mode",), f"the loop scans lines, not spirals (got {self.mode}): leave it out"
        if self.pulses.at is not None:
            yield ("pulses", "at"), "a spiral sweeps no line: let each pixel pulse (pixel)"
        least_s = (2e-6 if self.pulses.pixel else 1e-6) * self.interval_us
        if self.pixel_s < least_s:
            yield ("pixel_s",), f"got {self.pixel_s:g} s, allowed: at least {least_s:g} s"


AnyScan: TypeAlias = RasterScan | LineScan | StackScan | SpiralScan
ScanConfig: TypeAlias = Annotated[AnyScan, Field(discriminator="kind")]


class ScannedAxis(NamedTuple):
    """What a scan has to know of an axis that it may sweep."""

    range_um: tuple[float, float] | None  #: Its commands, in its unit; None without own limits.
    calibrated: bool = False  #: Whether its sensor shows something else than its device reads.


def scanned(axis: "AxisConfig") -> ScannedAxis:
    """Return what a scan has to know of an axis."""
    sensor = axis.sensor
    calibrated = sensor and (sensor.calibration != LineCalibration() or sensor.light)
    return ScannedAxis(axis.command_range_um, bool(calibrated))


def broken_scan(scan: AnyScan, axes: Mapping[str, ScannedAxis]) -> Iterator[BrokenRule]:
    """Yield what does not fit between a scan and the axes of a stage, which have names."""
    for key, span in zip(scan.span_keys, scan.spans, strict=True):
        axis = axes.get(span.axis)
        if axis is None:
            yield (key, "axis"), f"no such axis, {suggest(span.axis, list(axes), 'known')}"
            continue
        if (allowed := axis.range_um) is not None:
            yield from _outside(key, span, allowed)
        at = scan.pulses.at
        if at and at.by == "device" and key == scan.span_keys[0] and axis.calibrated:
            what = f"a device compares its own reading, axis {span.axis} has a calibration: by time"
            yield ("pulses", "at", "by"), what


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
        what = f"there is no `{KEY}:`, which describes lines, a raster, a stack or a spiral"
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    data = {KEY: document.data[KEY]}
    only = Document(document.file, data, document.values, document.keys)
    return validate(only, _File, Context(path.parent)).scan
