"""A scan from its description to its file, on a stage that plays it, virtual or running."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from piezod.config.axes import AxisConfig
from piezod.config.scan import AnyScan, LineScan, RasterScan, StackScan
from piezod.control.law.dynamics import lowest_mode_hz
from piezod.control.law.model import StageModel
from piezod.control.law.response_files import response_model
from piezod.devices.player import SeenEdge
from piezod.errors import DeviceError, RefusedError
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.command import PeriodicCommand
from piezod.experiment.play.learn import LearnedPlay, PassReport, learn
from piezod.experiment.play.record import BadRecordError, Flaw
from piezod.experiment.play.stored import find_table, store_table
from piezod.experiment.play.task import KnownAxis, PlaySettings
from piezod.experiment.scan.edges import edge_notes, place_of
from piezod.experiment.scan.learn import FrameReport, ScanTask, learn_frame
from piezod.experiment.scan.pixels import ErrorCount, SweepPixels, SweepSamples, pixels_of
from piezod.experiment.scan.plan import PlannedAxis, ScanPlan
from piezod.experiment.scan.stage import ScanStage
from piezod.hysteresis.memory import FloatArray
from piezod.records.scan_file import ScanFile, ScanHeader, SweptPixels

SETTLE_S, RECORD_S = 2.0, 1.0
"""Time of the line before the periods that count, and of those, while it is learned alone."""


class Told(NamedTuple):
    """Who is told what, while a scan runs."""

    line: Callable[[PassReport], None]  #: After each play of the line alone.
    frame: Callable[[FrameReport], None]  #: After each frame.
    #: After each sweep of the frame that is stored, with the share that is done, and the number of
    #: rows of the picture.
    sweep: Callable[[SweptPixels, float, int], None]
    note: Callable[[str], None]  #: What to know, a sentence each.


@dataclass(frozen=True, eq=False)
class ScanResult:
    """A scan that was stored."""

    file: Path  #: The file.
    plan: ScanPlan  #: Its plan.
    #: The line learned alone; None for a stack, or if the device has no memory for it.
    line: LearnedPlay | None
    frames: tuple[FrameReport, ...]  #: All frames; the last one is stored.


class ScanSetting(NamedTuple):
    """How a scan is run."""

    file: Path  #: Path of the file to write; it must not exist.
    configuration: str  #: Text of the description, kept with the data.
    tables: Path | None = None  #: Folder of learned lines: where to look, and to store.
    #: Unit of user axes in another unit than µm, as in `{"rx": "urad"}`.
    units: Mapping[str, str] = {}


def planned_axis(config: AxisConfig, model: StageModel) -> PlannedAxis:
    """Return what a plan needs to know of an axis.

    Args:
        config: Its configuration, with the first mode of its model if it has none.
        model: Its model.
    """
    low_um, high_um = config.command_range_um or model.position_um
    per_um = model.position_um.width / model.drive_v.width
    return PlannedAxis(
        (max(low_um, model.position_um.low), min(high_um, model.position_um.high)),
        _mode_hz(config, model),
        config.limits.slew_v_per_s * per_um,
        model.delay_s,
    )


def beside_of(axes: Iterable[AxisConfig]) -> tuple[str, ...]:
    """Return the names of the inputs that are recorded beside the sensors of axes."""
    sensors = [axis.sensor for axis in axes if axis.sensor is not None]
    return tuple(dict.fromkeys(name for sensor in sensors for name in sensor.beside))


def with_measured_mode(planned: PlannedAxis, known: KnownAxis) -> PlannedAxis:
    """Return an axis with the lowest mode of its response, if that shows one."""
    mode_hz = lowest_mode_hz(known.response.model.resonances)
    return planned if mode_hz is None else planned._replace(mode_hz=mode_hz)


def _mode_hz(config: AxisConfig, model: StageModel) -> float | None:
    if config.response is not None:
        return lowest_mode_hz(response_model(config.response).resonances)
    mode = config.first_mode or model.mode
    return None if mode is None else mode.frequency_hz


def run_scan(  # noqa: PLR0913, PLR0917 - each is a part of its own
    scan: AnyScan,
    plan: ScanPlan,
    axes: Mapping[str, PlayingAxis],
    known: Mapping[str, KnownAxis],
    stage: ScanStage,
    inputs: tuple[str, ...],
    setting: ScanSetting,
    told: Told,
) -> ScanResult:
    """Learn a scan, play it, and store it, sweep by sweep.

    Args:
        scan: The scan.
        plan: Its plan.
        axes: Its axes, at rest, by name.
        known: What is known of each.
        stage: The stage.
        inputs: Names of the inputs beside.
        setting: How it is run.
        told: Who is told what.

    Raises:
        PiezodError: If a play fails, or its record cannot be used.
        OSError: If the file cannot be written.
    """
    line = None
    if not isinstance(scan, StackScan):
        line = _learned_line(scan, plan, axes[plan.axes[0]], known, told, setting.tables)
    task = ScanTask(
        plan,
        known,
        {name: axes[name].conditions.rest_v for name in plan.axes},
        plan.line_um if line is None else line.wanted_um,
        line is not None,
        scan.passes,
    )
    frames: list[FrameReport] = []

    def report(frame: FrameReport) -> None:
        frames.append(frame)
        told.frame(frame)

    table = learn_frame(stage, task, report)
    stage.rest()
    header = scan_header(scan, plan, inputs, setting)
    if plan.edges is not None:
        table = table._replace(edges=plan.edges, tail=plan.tail)
    sweeps, seen = stage.scan(table), lambda: stage.edges
    report(store_frame(sweeps, plan, task.sensor_delay_s, header, setting.file, told, seen))
    return ScanResult(setting.file, plan, line, tuple(frames))


def scan_header(
    scan: AnyScan, plan: ScanPlan, inputs: tuple[str, ...], setting: ScanSetting
) -> ScanHeader:
    """Return what the file of a scan says about it.

    Args:
        scan: The scan.
        plan: Its plan.
        inputs: Names of the inputs beside.
        setting: How it is run.
    """
    return ScanHeader(
        scan.title or "scan",
        datetime.now().astimezone().isoformat(timespec="seconds"),
        plan.axes,
        inputs,
        both_ways=plan.sweeps_per_line > 1,
        configuration=setting.configuration,
        by_loop=scan.mode is not None,
        edges=plan.edges is not None,
        units=setting.units,
    )


def _learned_line(
    scan: RasterScan | LineScan,
    plan: ScanPlan,
    axis: PlayingAxis,
    known: Mapping[str, KnownAxis],
    told: Told,
    tables: Path | None,
) -> LearnedPlay | None:
    """Learn the line; None if the device has no memory for that: the frames learn it then."""
    assert plan.line_um is not None  # noqa: S101 - a stack has no line
    fast = scan.fast
    name = f"line {fast.from_um:g} to {fast.to_um:g} um, {scan.lines_per_s:g} per s"
    command = PeriodicCommand(name, plan.line_um, plan.interval_ns)
    first_um: FloatArray | None = None
    if tables is not None:
        first_um, text = find_table(tables, axis.conditions, command)
        told.note(text)
    settings = PlaySettings(scan.passes, SETTLE_S, RECORD_S)
    task = known[plan.axes[0]].task(command, settings, first_um)
    try:
        learned = learn(axis.stage, task, told.line)
    except (BadRecordError, DeviceError, RefusedError) as error:
        if isinstance(error, BadRecordError) and error.flaw is not Flaw.SHORT:
            raise
        # An error of another cause comes again with the frame.
        told.note(f"the line is not learned alone, but in the frames: {error}")
        return None
    if tables is not None:
        told.note(f"stored as {store_table(tables, learned, axis.conditions)}")
    return learned


def store_frame(
    sweeps: Iterable[SweepSamples],
    plan: ScanPlan,
    sensor_delay_s: FloatArray,
    header: ScanHeader,
    file: Path,
    told: Told,
    edges: Callable[[], Sequence[SeenEdge]] = tuple,
) -> FrameReport:
    """Store a frame sweep by sweep, as it comes; return its errors.

    Args:
        sweeps: Samples of each sweep, in order.
        plan: The plan.
        sensor_delay_s: (axes,) delay of each sensor, in s.
        header: What the file says about the scan.
        file: Path of the file; it must not exist.
        told: Who is told what.
        edges: Returns the edges that were seen, for a plan that waits for some.

    Raises:
        PiezodError: If a sweep could not be had.
        OSError: If the file cannot be written.
    """
    measured, true = ErrorCount(plan), ErrorCount(plan)
    k = -1
    with ScanFile(file, header, plan.centres_um, plan.n_rows, plan.pixels) as written:
        try:
            for samples in sweeps:
                pixels = pixels_of(samples, plan, sensor_delay_s)
                k = pixels.sweep
                swept = _swept(pixels, plan)
                written.append(swept)
                measured.add(k, pixels.position_um)
                true.add(k, pixels.true_um)
                told.sweep(swept, (k + 1) / plan.sweeps, plan.n_rows)
        finally:
            if plan.edges is not None:
                _keep_edges(written, edges(), plan, told)
            if k + 1 < plan.sweeps:
                told.note(f"{k + 1} of {plan.sweeps} sweeps are stored in {file}")
    return FrameReport("stored", measured.errors, true.errors)


def _keep_edges(written: ScanFile, edges: Sequence[SeenEdge], plan: ScanPlan, told: Told) -> None:
    """Store the edges of a frame, and tell what is to be told of them."""
    written.add_edges([edge.t_ns for edge in edges], place_of(edges), [x.used for x in edges])
    for note in edge_notes(edges, plan.sweeps if plan.steps else 0):
        told.note(note)


def _swept(pixels: SweepPixels, plan: ScanPlan) -> SweptPixels:
    error_um = plan.pixel_means(plan.command_um(pixels.sweep)) - pixels.position_um
    return SweptPixels(
        plan.rows[pixels.sweep],
        plan.backward(pixels.sweep),
        pixels.position_um,
        error_um[:, 0],
        pixels.detected,
        pixels.dwell_s,
        pixels.first_ns,
        pixels.last_ns,
        pixels.late_ns,
    )
