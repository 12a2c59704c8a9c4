"""The plan of a scan: where each axis is at each point of the device's clock."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from piezod.config.scan import (
    MODE_PERIODS,
    AnyScan,
    LineScan,
    RasterScan,
    SpanConfig,
    SpiralScan,
    StackScan,
)
from piezod.devices.bus.table_check import waits_problem, way_problem
from piezod.devices.player import EdgeWaits
from piezod.devices.scan_table import Mask
from piezod.errors import DataError
from piezod.experiment.scan.spiral import Spiral, closed_path
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S


class PlannedAxis(NamedTuple):
    """What a plan needs to know of an axis."""

    range_um: tuple[float, float]  #: Lowest and highest position that may be commanded, in µm.
    #: Frequency of its first mode, in Hz; None if it is unknown.
    mode_hz: float | None
    speed_um_per_s: float  #: Fastest motion that its slew limit allows, in µm/s.
    delay_s: float  #: Time from a voltage to its displacement, in s.


MOST_PATH_POINTS = 20_000
"""Most points of a spiral with its way back: those of a sweep in a request."""


class MarkedPositions(NamedTuple):
    """Positions of the fast axis at which a line pulses."""

    bit: int  #: The line, as a bit.
    along_um: FloatArray  #: (k,) the positions in the order of a forward sweep, in µm.
    backward: frozenset[bool]  #: Whether the sweeps that pulse go backward.
    by_device: bool  #: Whether the device compares its reading; else by time.


@dataclass(frozen=True, eq=False)
class ScanPlan:
    """The sweeps of a scan. A sweep has `points` points; the last ones are its turn."""

    axes: tuple[str, ...]  #: Names of the axes, the fastest first.
    interval_ns: int  #: Time between two points, in ns.
    points: int  #: Points of a sweep with its turn.
    active: int  #: Points of a sweep that count, a multiple of its pixels.
    pixels: int  #: Pixels of a sweep.
    #: (p · points, swept) position of the swept axes, the first ones, in p sweeps, which repeat.
    lines_um: FloatArray
    levels_um: FloatArray  #: (sweeps, axes) position of the other axes in each sweep, in µm.
    #: (points, axes) how far each axis has gone to its level of the next sweep, 0 to 1.
    blend: FloatArray
    rows: tuple[int, ...]  #: Row of the picture of each sweep.
    pulses: Mask  #: (points,) pulses of a sweep; empty for none.
    framed: int  #: Bit of the line that pulses with the first pixel of the frame.
    pause: int  #: Point of a sweep at which the fast axis stands still.
    #: Centres of the pixels along each axis, in µm; of a path those of all its pixels.
    centres_um: tuple[FloatArray, ...]
    pixel_um: FloatArray  #: (axes,) size of a pixel along each axis, in µm.
    sweeps_per_line: int = 1  #: Sweeps of a line.
    turns_back: bool = False  #: Whether every other sweep goes backward.
    #: Where the stored frame waits for edges, counted in points of all sweeps; None for nowhere.
    edges: EdgeWaits | None = None
    marked: MarkedPositions | None = None  #: Positions with pulses of their own.

    @property
    def sweeps_per_period(self) -> int:
        """Number of sweeps after which the line repeats."""
        return 2 if self.turns_back else 1

    @property
    def sweeps(self) -> int:
        """Number of sweeps."""
        return len(self.levels_um)

    @property
    def is_stack(self) -> bool:
        """Whether it is a stack: a pixel is a plane."""
        return self.swept == 0

    @property
    def swept(self) -> int:
        """Number of swept axes: 1 for lines, 2 for a path."""
        return int(self.lines_um.shape[1])

    @property
    def is_path(self) -> bool:
        """Whether two axes follow a path: its pixels are a list."""
        return self.swept > 1

    @property
    def steps(self) -> bool:
        """Whether an edge ends each plane."""
        return self.edges is not None and self.edges.first > 0

    @property
    def tail(self) -> int:
        """Points behind the stored frame, in which edges that are too many are counted."""
        return 2 * self.points if self.steps else 0

    @property
    def per_pixel(self) -> int:
        """Points of a pixel."""
        return self.active // self.pixels

    @property
    def duration_s(self) -> float:
        """Duration of the sweeps, in s."""
        return self.sweeps * self.points * self.interval_ns / NS_PER_S

    def backward(self, sweep: int) -> bool:
        """Return whether a sweep goes backward."""
        return self.turns_back and sweep % 2 == 1

    @property
    def n_rows(self) -> int:
        """Number of rows of the picture."""
        return self.rows[-1] + 1

    @property
    def high(self) -> int:
        """Points for which a pulse is high."""
        return max(1, self.per_pixel // 2)

    def pixel_means(self, values: FloatArray) -> FloatArray:
        """Return the mean over each pixel of values, shape (active, columns)."""
        return np.asarray(np.mean(values.reshape(self.pixels, self.per_pixel, -1), axis=1))

    def command_um(self, sweep: int) -> FloatArray:
        """Return the command of each axis at the points that count, shape (active, axes), in µm."""
        command = np.tile(self.levels_um[sweep], (self.active, 1))
        first = sweep % self.sweeps_per_period * self.points
        command[:, : self.swept] = self.lines_um[first : first + self.active]
        return command

    def positions_um(self, at: npt.NDArray[np.int64]) -> FloatArray:
        """Return the position of each axis at points, shape (n, axes), in µm.

        Args:
            at: (n,) indices of points of all sweeps; those below 0 lead to the first sweep.
        """
        sweep, point = at // self.points, at % self.points
        last = self.sweeps - 1
        here = self.levels_um[np.clip(sweep, 0, last)]
        after = self.levels_um[np.clip(sweep + 1, 0, last)]
        position_um = here + (after - here) * self.blend[point]
        position_um[:, : self.swept] = self.lines_um[at % len(self.lines_um)]
        return position_um


def plan_scan(scan: AnyScan, axes: Mapping[str, PlannedAxis]) -> ScanPlan:
    """Return the plan of a scan.

    Args:
        scan: The scan.
        axes: What is known of its axes, by name.

    Raises:
        DataError: If it leaves the range of an axis, is too fast for it, or turns above its mode;
            the text has a line for each problem.
    """
    match scan:
        case StackScan():
            plan = _stack(scan, axes)
        case SpiralScan():
            plan = _spiral(scan, axes)
        case _:
            plan = _swept(scan, axes)
    problems = [*_out_of_range(scan, plan, axes), *_too_fast(plan, axes)]
    if problems:
        raise DataError("\n".join(problems))
    return plan


def _swept(scan: RasterScan | LineScan, axes: Mapping[str, PlannedAxis]) -> ScanPlan:
    fast, points = scan.fast, max(2, round(scan.sweep_s * NS_PER_S / scan.interval_ns))
    active = int(points * (1.0 - scan.turn_share) / fast.pixels + 1e-9) * fast.pixels
    sweeps = np.arange(scan.lines * scan.sweeps_per_line)
    rows = sweeps // scan.sweeps_per_line
    levels = np.zeros((sweeps.size, len(scan.spans)))
    if isinstance(scan, RasterScan):
        levels[:, 1] = _centres(scan.slow)[rows]
    turns_back = scan.sweeps != "forward"
    line_um = (_there_and_back if turns_back else _with_flyback)(
        fast.from_um, fast.to_um, active, points
    )
    pulses, framed = _pulses(scan, points, active, fast.pixels)
    return ScanPlan(
        axes=tuple(span.axis for span in scan.spans),
        interval_ns=scan.interval_ns,
        points=points,
        active=active,
        pixels=fast.pixels,
        lines_um=line_um[:, None],
        levels_um=levels,
        blend=_blend(scan, points, active, axes),
        rows=tuple(rows.tolist()),
        pulses=pulses,
        framed=framed,
        # The fast axis stands still where it is furthest in the turn.
        pause=active + int(np.argmax(np.abs(line_um[active:points] - fast.from_um))),
        centres_um=tuple(map(_centres, scan.spans)),
        pixel_um=_pixels(scan),
        sweeps_per_line=scan.sweeps_per_line,
        turns_back=turns_back,
        edges=_edges_of(scan, points, active),
        marked=_marked(scan),
    )


def _marked(scan: RasterScan | LineScan) -> MarkedPositions | None:
    at = scan.pulses.at
    if at is None:
        return None
    ways = {"forward": {False}, "backward": {True}, "both": {False, True}}[at.way]
    along_um, by_device = np.array(at.along(scan.fast)), at.by == "device"
    return MarkedPositions(1 << (at.line - 1), along_um, frozenset(ways), by_device)


def _stack(scan: StackScan, axes: Mapping[str, PlannedAxis]) -> ScanPlan:
    span = scan.planes
    active = max(2, round(scan.plane_s * NS_PER_S / scan.interval_ns))
    points = active + max(2, round(scan.move_s * NS_PER_S / scan.interval_ns))
    pulses, framed = _pulses(scan, points, active, 1)
    return ScanPlan(
        axes=(span.axis,),
        interval_ns=scan.interval_ns,
        points=points,
        active=active,
        pixels=1,
        lines_um=np.empty((points, 0)),
        levels_um=_centres(span)[:, None],
        blend=_blend(scan, points, active, axes),
        rows=tuple(range(span.pixels)),
        pulses=pulses,
        framed=framed,
        pause=points,
        centres_um=(_centres(span),),
        pixel_um=_pixels(scan),
        edges=_edges_of(scan, points, active),
    )


def _spiral(scan: SpiralScan, axes: Mapping[str, PlannedAxis]) -> ScanPlan:
    interval_s, per_pixel = scan.interval_ns / NS_PER_S, scan.points_of_pixel
    modes_hz = [mode for span in scan.spans if (mode := axes[span.axis].mode_hz) is not None]
    # Half a turn is a turn of each axis.
    fastest_hz = min(modes_hz, default=np.inf) / (2.0 * MODE_PERIODS)
    path = Spiral(scan.x.pixels, per_pixel * interval_s, fastest_hz)
    pixels = max(1, round(path.duration_s / (per_pixel * interval_s)))
    active = pixels * per_pixel
    points = active + max(2, round(scan.back_s / interval_s))
    if points > MOST_PATH_POINTS:
        raise DataError(
            f"the spiral has {points} points of the table, allowed: {MOST_PATH_POINTS}: choose a "
            "longer interval, fewer pixels, or a shorter pixel_s"
        )
    middle_um = np.array([0.5 * (span.from_um + span.to_um) for span in scan.spans])
    size_um = np.array([(span.to_um - span.from_um) / span.pixels for span in scan.spans])
    lines_um = middle_um + size_um * closed_path(path.at, active, points, interval_s)
    pulses, framed = _pulses(scan, points, active, pixels)
    centres_um = np.mean(lines_um[:active].reshape(pixels, per_pixel, 2), axis=1)
    return ScanPlan(
        axes=tuple(span.axis for span in scan.spans),
        interval_ns=scan.interval_ns,
        points=points,
        active=active,
        pixels=pixels,
        lines_um=lines_um,
        levels_um=np.zeros((1, 2)),
        blend=_blend(scan, points, active, axes),
        rows=(0,),
        pulses=pulses,
        framed=framed,
        pause=points,
        centres_um=(centres_um[:, 0], centres_um[:, 1]),
        pixel_um=_pixels(scan),
        edges=_edges_of(scan, points, active),
    )


def check_device(scan: AnyScan, most_waits: int, pulses_at: Sequence[str]) -> None:
    """Refuse a scan that waits for edges, or pulses at positions, as its device cannot.

    Raises:
        DataError: If it does.
    """
    waits, at = _edges_of(scan, 1, 1), scan.pulses.at
    if at is not None and (why := way_problem(at.by, pulses_at)):
        raise DataError(f"pulses.at: {why}")
    if waits is not None and (why := waits_problem(waits, most_waits)):
        raise DataError(f"{'step' if waits.first else 'start'}: {why}")


def _edges_of(scan: AnyScan, points: int, active: int) -> EdgeWaits | None:
    within_ns = round(scan.within_s * NS_PER_S)
    if isinstance(scan, StackScan) and scan.step == "edge":
        return EdgeWaits(active, points, scan.planes.pixels, within_ns)
    return EdgeWaits(0, 1, 1, within_ns) if scan.start == "edge" else None


def _centres(span: SpanConfig) -> FloatArray:
    share = (np.arange(span.pixels) + 0.5) / span.pixels
    return np.asarray(span.from_um + (span.to_um - span.from_um) * share)


def _pixels(scan: AnyScan) -> FloatArray:
    return np.array([abs(span.to_um - span.from_um) / span.pixels for span in scan.spans])


def smooth_step(u: FloatArray) -> FloatArray:
    """Return a step from 0 to 1 at u from 0 to 1, whose speed and acceleration begin at 0."""
    inside = np.clip(u, 0.0, 1.0)
    return np.asarray(inside - np.sin(2.0 * np.pi * inside) / (2.0 * np.pi))


def _sweep(active: int) -> FloatArray:
    """Return the way along a sweep, 0 to 1: a pixel's points are about its centre."""
    return np.asarray((np.arange(active) + 0.5) / active)


def _there_and_back(from_um: float, to_um: float, active: int, points: int) -> FloatArray:
    """Return a sweep and the one back. In the turns the acceleration is one smooth pulse."""
    turn = points - active
    # From the last point of a sweep to the first of the next one: turn + 1 intervals.
    u = np.arange(1, turn + 1) / (turn + 1)
    speed = (turn + 1) / active
    over = speed * (u - u**2 - (np.cos(2.0 * np.pi * u) - 1.0) / (2.0 * np.pi**2))
    way = _sweep(active)
    there = np.concatenate((way, way[-1] + over))
    return np.asarray(from_um + (to_um - from_um) * np.concatenate((there, 1.0 - there)))


def _with_flyback(from_um: float, to_um: float, active: int, points: int) -> FloatArray:
    """Return a sweep and its flyback, which begins and ends with the speed of the sweep."""
    turn = points - active
    u, way = np.arange(1, turn + 1) / (turn + 1), _sweep(active)
    on = (turn + 1) / active
    back = way[-1] + on * u - (1.0 - 1.0 / active + on) * smooth_step(u)
    return np.asarray(from_um + (to_um - from_um) * np.concatenate((way, back)))


def _blend(scan: AnyScan, points: int, active: int, axes: Mapping[str, PlannedAxis]) -> FloatArray:
    """Return how each axis goes to its next level: early by its delay, so that it moves then.

    An edge that ends a plane cannot be foreseen.
    """
    columns = []
    for span in scan.spans:
        steps = isinstance(scan, StackScan) and scan.step == "edge"
        delay_s = 0.0 if steps else axes[span.axis].delay_s
        early = round(delay_s * NS_PER_S / scan.interval_ns)
        u = (np.arange(points) + min(early, active) - active + 1) / (points - active + 1)
        columns.append(smooth_step(u))
    return np.stack(columns, axis=1)


def _pulses(scan: AnyScan, points: int, active: int, pixels: int) -> tuple[Mask, int]:
    """Return the pulses of a sweep, and the bit of the frame."""
    numbers = scan.pulses.numbers
    if not numbers:
        return np.empty(0, np.uint8), 0
    mask, per_pixel = np.zeros(points, np.uint8), active // pixels
    high = max(1, per_pixel // 2)
    if pixel := numbers.get("pixel"):
        first_half = np.arange(active) % per_pixel < high
        mask[:active][first_half] |= np.uint8(1 << (pixel - 1))
    if line := numbers.get("line"):
        mask[:high] |= np.uint8(1 << (line - 1))
    return mask, 1 << (numbers["frame"] - 1) if "frame" in numbers else 0


def _out_of_range(scan: AnyScan, plan: ScanPlan, axes: Mapping[str, PlannedAxis]) -> Iterator[str]:
    for place, span in enumerate(scan.spans):
        low_um, high_um = axes[span.axis].range_um
        moved = (plan.lines_um if place < plan.swept else plan.levels_um)[:, place]
        lowest_um, highest_um = float(np.min(moved)), float(np.max(moved))
        if lowest_um < low_um - 1e-9 or highest_um > high_um + 1e-9:
            yield (
                f"axis {span.axis} would move from {lowest_um:.4g} to {highest_um:.4g} µm with its "
                f"turns, allowed range {low_um:.4g} to {high_um:.4g} µm: scan less, or shorten "
                "the turns (turn_share, back_s)"
            )


def _too_fast(plan: ScanPlan, axes: Mapping[str, PlannedAxis]) -> Iterator[str]:
    interval_s = plan.interval_ns / NS_PER_S
    turn_s = (plan.points - plan.active) * interval_s
    for place, name in enumerate(plan.axes):
        known = axes[name]
        swept = place < plan.swept
        steps = np.abs(np.diff(plan.levels_um[:, place]))
        if swept:
            line_um = plan.lines_um[:, place]
            speed = float(np.max(np.abs(np.diff(line_um, append=line_um[0]))))
        else:
            speed = float(np.max(steps, initial=0.0) * np.max(np.diff(plan.blend[:, place])))
        if speed / interval_s > known.speed_um_per_s:
            yield (
                f"axis {name} would move at {speed / interval_s:.4g} µm/s, allowed: "
                f"{known.speed_um_per_s:.4g} µm/s by its slew_v_per_s: scan more slowly, or less"
            )
        moves = swept or bool(np.any(steps > 0.0))
        if moves and known.mode_hz is not None and turn_s < MODE_PERIODS / known.mode_hz:
            yield (
                f"a turn of {1000.0 * turn_s:.3g} ms excites the first mode of axis {name}, "
                f"{known.mode_hz:.4g} Hz, allowed: at least "
                f"{1000.0 * MODE_PERIODS / known.mode_hz:.3g} ms: scan more slowly, or give the "
                "turns a larger share (turn_share, move_s, back_s)"
            )
