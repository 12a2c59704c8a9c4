"""A scan that the loop carries out: its sweeps are waveforms, and every cycle is a sample.

A request takes so many points only, so a long scan is a few waveforms, one after the other. Between
two of them the fast axis stands still, where it turns.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.scan import AnyScan, SpiralScan, StackScan
from piezod.config.waveforms.paths import Points
from piezod.devices.player import SeenEdge
from piezod.errors import DataError, DeviceError, RefusedError
from piezod.experiment.scan.edges import sweep_ns
from piezod.experiment.scan.loop_lines import PartLines, lines_of, pulse_notes
from piezod.experiment.scan.pixels import Int64Array, SweepSamples
from piezod.experiment.scan.plan import PlannedAxis, ScanPlan, plan_scan
from piezod.experiment.scan.run import (
    ScanResult,
    ScanSetting,
    Told,
    beside_of,
    scan_header,
    store_frame,
)
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S, s_to_ns

HOLD_S = 0.5
"""Time at the first position of each part, in s: the stage settles."""
PIECES = 50
"""Most straight pieces of a turn."""
MOST_POINTS = 9000
"""Most points of the waveforms of a part, so that they fit into a request."""
MOST_PART_S = 30.0
"""Longest time of the sweeps of a part, in s, if it has several: a file grows part by part."""
LEAST_CYCLES = 2
"""Fewest cycles of a pixel, of a held plane, and of the way to the next one."""


class ScanPart(NamedTuple):
    """Sweeps that are one waveform."""

    sweeps: range  #: Indices of the sweeps.
    first: int  #: Index of its first point, at which the fast axis stands still.
    end: int  #: Index of its last point, likewise.


class Cycles(NamedTuple):
    """The cycles since the begin of the waveforms of a part, n of them."""

    #: (n,) instant of each cycle since then, in s, increasing: time in which it waits is left out.
    t_s: FloatArray
    sample_s: FloatArray  #: (n, axes) instant of each sample since then, in s.
    position_um: FloatArray  #: (n, axes) measured displacement, in µm; NaN if it is not valid.
    true_um: FloatArray  #: (n, axes) true displacement, in µm; NaN if it is not known.
    late_ns: FloatArray  #: (n,) lateness of each cycle, in ns.
    #: Rising edges for which it waited, or that came too early, in ns since the begin.
    edges: tuple[SeenEdge, ...] = ()
    ended: bool = False  #: Whether it has ended because an edge did not come.
    pulses: Mapping[str, int] = MappingProxyType({})  #: Pulses of each line, by name.


class LoopStage(Protocol):
    """A stage whose loop scans; a virtual or a running one."""

    def begin(self) -> None:
        """Rest, zero the sensors, and select the mode.

        Raises:
            PiezodError: If that failed.
        """
        ...

    def follow(
        self, waveforms_um: Mapping[str, Points], duration_s: float, lines: PartLines
    ) -> Cycles:
        """Go to the start of waveforms and follow them; return the cycles since their begin.

        Args:
            waveforms_um: Position of each axis over time, in µm, in the order of the plan.
            duration_s: Duration of the waveforms, in s.
            lines: What lines do meanwhile.

        Raises:
            PiezodError: If the stage did not follow them to the end.
        """
        ...


@contextmanager
def or_by_loop() -> Iterator[None]:
    """Add to the refusal of a device that it need not play: the loop can scan, too."""
    try:
        yield
    except (DeviceError, RefusedError) as error:
        raise DataError(f"{error}; with `mode:` in `scan:` the loop scans instead") from error


def plan_by_loop(scan: AnyScan, axes: Mapping[str, PlannedAxis], period_ns: int) -> ScanPlan:
    """Return the plan of a scan whose points are the cycles of the loop.

    Args:
        scan: The scan.
        axes: What is known of its axes, by name.
        period_ns: Period of the loop, in ns.

    Raises:
        DataError: If a pixel is faster than the loop, planes that wait for edges are too many, or
            as `plan_scan`.
    """
    period_s = period_ns / NS_PER_S
    assert not isinstance(scan, SpiralScan)  # noqa: S101 - its rules refuse a mode
    if isinstance(scan, StackScan):
        times = {"plane_s": scan.plane_s, "move_s": scan.move_s}
    else:
        times = {"a pixel": scan.sweep_s * (1.0 - scan.turn_share) / scan.fast.pixels}
    for what, time_s in times.items():
        if time_s < (LEAST_CYCLES - 1e-9) * period_s:
            raise DataError(
                f"{what} lasts {1000.0 * time_s:.4g} ms, allowed: at least "
                f"{1000.0 * LEAST_CYCLES * period_s:.4g} ms, {LEAST_CYCLES} periods of the loop: "
                "scan more slowly, with fewer pixels, or raise rate_hz"
            )
    # The loop reads its commands ahead by the delay of each axis: the plan is not early by it.
    punctual = {name: axis._replace(delay_s=0.0) for name, axis in axes.items()}
    plan = plan_scan(scan.model_copy(update={"interval_us": period_ns / 1000.0}), punctual)
    if plan.steps and plan.sweeps > (most := _most_sweeps(plan)):
        raise DataError(
            f"a stack whose planes wait for edges is one request, of at most {most} planes (got "
            f"{plan.sweeps}): scan it in parts"
        )
    return plan


def run_by_loop(
    scan: AnyScan,
    plan: ScanPlan,
    axes: Sequence[AxisConfig],
    stage: LoopStage,
    setting: ScanSetting,
    told: Told,
) -> ScanResult:
    """Carry out a scan, and store it, part by part.

    Args:
        scan: The scan.
        plan: Its plan, of `plan_by_loop`.
        axes: Its axes, in the order of the plan.
        stage: The stage.
        setting: How it is run.
        told: Who is told what.

    Raises:
        PiezodError: If the stage did not follow the scan.
        OSError: If the file cannot be written.
    """
    if inputs := beside_of(axes):
        told.note(f"the loop does not read {', '.join(inputs)}: the picture shows the error")
    delays_s = np.array([axis.compensator.sensor_delay_s for axis in axes])
    header, tally = scan_header(scan, plan, (), setting), _Tally()
    stage.begin()
    if plan.edges is not None:
        within_s = plan.edges.within_ns / NS_PER_S
        told.note(f"the stage waits for edges of line {scan.edge}, {within_s:g} s for each")
    sweeps = _swept(scan, plan, stage, tally)
    edges, file = tally.edges, setting.file
    done = store_frame(sweeps, plan, delays_s, header, file, told, lambda: edges)
    told.frame(done)
    for note in pulse_notes(scan, plan, tally.pulses):
        told.note(note)
    if tally.worst_ns:
        told.note(
            f"its cycles were late by at most {tally.worst_ns / 1000:.4g} µs, "
            f"{tally.mean_ns / 1000:.4g} µs on the average"
        )
    return ScanResult(setting.file, plan, None, (done,))


class _Tally:
    """Lateness of the cycles of a scan, in ns, its edges, and its pulses."""

    def __init__(self) -> None:
        self.worst_ns, self._sum_ns, self._count = 0, 0.0, 0
        self.edges, self.pulses = list[SeenEdge](), Counter[str]()

    @property
    def mean_ns(self) -> float:
        return self._sum_ns / max(self._count, 1)

    def add(self, late_ns: Int64Array) -> None:
        self.worst_ns = max(self.worst_ns, int(late_ns.max()))
        self._sum_ns, self._count = self._sum_ns + float(late_ns.sum()), self._count + late_ns.size


def _swept(
    scan: AnyScan, plan: ScanPlan, stage: LoopStage, tally: _Tally
) -> Iterator[SweepSamples]:
    """Follow the parts of a scan; yield the samples of each sweep."""
    for part in parts_of(plan):
        waveforms, duration_s = waveforms_of(plan, part)
        zero_s = HOLD_S - part.first * plan.interval_ns / NS_PER_S
        cycles = stage.follow(waveforms, duration_s, lines_of(scan, plan, part.sweeps, zero_s))
        zero_ns = s_to_ns(zero_s)
        seen = (edge._replace(t_ns=edge.t_ns - zero_ns) for edge in cycles.edges)
        tally.edges += [edge for edge in seen if edge.used or edge.t_ns >= 0]
        tally.pulses.update(cycles.pulses)
        first_ns = sweep_ns(plan, tally.edges)
        for k in part.sweeps:
            end_s = zero_s + (k * plan.points + plan.active - 1.5) * plan.interval_ns / NS_PER_S
            if cycles.ended and cycles.t_s[-1] < end_s:
                return
            samples, late_ns = sweep_of(plan, part, cycles, k)
            tally.add(late_ns)
            yield samples._replace(first_ns=int(first_ns[k]))


def parts_of(plan: ScanPlan) -> Iterator[ScanPart]:
    """Yield the parts of a scan, in order."""
    sweep_s = plan.points * plan.interval_ns / NS_PER_S
    most = min(_most_sweeps(plan), max(1, int(MOST_PART_S / sweep_s)))
    if plan.steps:
        most = plan.sweeps  # between two parts nothing would wait
    for first in range(0, plan.sweeps, most):
        sweeps = range(first, min(first + most, plan.sweeps))
        end = (sweeps.stop - 1) * plan.points + plan.pause
        if sweeps.stop == plan.sweeps:
            end = sweeps.stop * plan.points - 1  # with all of the last turn
        yield ScanPart(sweeps, (first - 1) * plan.points + plan.pause, end)


def _most_sweeps(plan: ScanPlan) -> int:
    """Return how many sweeps fit into a request."""
    points = len(_corners(plan, range(1), 0, plan.points)) * len(plan.axes)
    return max(1, MOST_POINTS // points)


def waveforms_of(plan: ScanPlan, part: ScanPart) -> tuple[dict[str, Points], float]:
    """Return the waveform of each axis in a part, and their duration, in s."""
    end = part.end + plan.tail
    at = _corners(plan, range(part.sweeps.start - 1, part.sweeps.stop), part.first, end)
    position_um = plan.positions_um(at)
    t_s = HOLD_S + (at - part.first) * plan.interval_ns / NS_PER_S
    waveforms = {
        name: Points(
            kind="points",
            points=tuple(zip(np.round(t_s, 7).tolist(), np.round(line, 5).tolist(), strict=True)),
        )
        for name, line in zip(plan.axes, position_um.T, strict=True)
    }
    return waveforms, float(t_s[-1]) + plan.interval_ns / NS_PER_S


def _corners(plan: ScanPlan, sweeps: range, first: int, end: int) -> Int64Array:
    """Return the points from which to which a scan is straight, or nearly so in a turn."""
    turn = np.arange(plan.active, plan.points)
    own = np.concatenate(([0, plan.active - 1], turn[:: 1 + (turn.size - 1) // PIECES]))
    at = np.add.outer(np.array(sweeps) * plan.points, own).ravel()
    return np.unique(np.concatenate(([first], at[(at > first) & (at < end)], [end])))


def sweep_of(
    plan: ScanPlan, part: ScanPart, cycles: Cycles, sweep: int
) -> tuple[SweepSamples, Int64Array]:
    """Return the samples of a sweep of a part at the points of the plan, and their lateness.

    A cycle is a little late, and a skipped one is missing: values are taken between cycles by a
    line. The lateness of a point, in ns, is that of its cycle, or the time by which it is missing.
    """
    interval_s, first = plan.interval_ns / NS_PER_S, sweep * plan.points
    t_s = HOLD_S + (first - part.first + np.arange(plan.points)) * interval_s
    position_um, true_um = (
        np.stack(
            [
                np.interp(t_s, sample_s, column)
                for sample_s, column in zip(cycles.sample_s.T, values.T, strict=True)
            ],
            axis=1,
        )
        for values in (cycles.position_um, cycles.true_um)
    )
    cycle = np.searchsorted(cycles.t_s, t_s - 0.5 * interval_s)
    cycle = np.minimum(cycle, cycles.t_s.size - 1)
    missing = np.floor((cycles.t_s[cycle] - t_s) / interval_s + 0.5) * plan.interval_ns
    late_ns = np.round(cycles.late_ns[cycle] + np.maximum(missing, 0.0)).astype(np.int64)
    nothing = np.empty((plan.points, 0))
    first_ns = first * plan.interval_ns
    return SweepSamples(sweep, first_ns, position_um, true_um, nothing, late_ns), late_ns
