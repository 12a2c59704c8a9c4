"""One cycle of the loop, from the sample to the voltage.

`run_cycle` is the only place that knows the order: read, read back, screen, watch, faults, react,
reference, compensate, guard, write, record. Time is an argument, and a fault is a value.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import Final, Protocol

from piezod.config.drive_limits import DriveLimit
from piezod.config.faults import Fault
from piezod.config.modes import SENSED
from piezod.config.states import State
from piezod.control.faults.detection import Detection
from piezod.control.guard import Admitted, Guard
from piezod.control.law.axis import AxisOutput
from piezod.control.stage.boundary import DeviceBoundary
from piezod.control.stage.lines import StageLines
from piezod.control.stage.progress import advance, overloaded_axes, react
from piezod.control.stage.stage import DRIVEN, Stage
from piezod.control.stage.states import HoldCause
from piezod.control.watch.loop import CycleTiming, LoopWatch
from piezod.devices.interface import Sample
from piezod.devices.status import Flags
from piezod.telemetry.record import AxisRecord, CycleRecord, StageEvent
from piezod.units import NS_PER_S

PUNCTUAL: Final = CycleTiming(0, 0, 0, 0, 0)
"""The timing of a cycle in virtual time."""

_RUN: Final = State.RUN
_RANGE: Final = DriveLimit.RANGE
_SLEW: Final = DriveLimit.SLEW
_SENSED: Final = SENSED
_MEMORY_UNKNOWN: Final = Detection(Fault.D10)
_ESTOP: Final = Detection(Fault.E1)


class CycleAxis(Protocol):
    """Interface of an axis to the cycle: its reference and its control law. All real-time safe."""

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:
        """Take the sample of this cycle; return the voltage to write."""
        ...

    def applied(self, drive_v: float) -> None:
        """Take the voltage that is in force from now on, in V."""
        ...

    def record(
        self, sample: Sample, output: AxisOutput, drive_v: float, read_back_v: float
    ) -> AxisRecord:
        """Return the record of this axis."""
        ...


@dataclass
class CycleParts:
    """Everything that a cycle works on."""

    devices: DeviceBoundary  #: The sensors and amplifiers of all axes.
    axes: Sequence[CycleAxis]  #: The axes, in the order of the devices; the owner may replace them.
    guard: Guard  #: The last check before the write.
    period_s: float  #: Period of the loop, in s.
    #: The stage with faults and state; None without watches, as in an experiment in virtual time.
    stage: Stage | None = None
    loop_watch: LoopWatch | None = None  #: The watch of the loop; None likewise.
    #: Instant of the last write that the amplifiers took, in ns; long ago before the first.
    written_ns: float = -inf


def run_cycle(parts: CycleParts, t_ns: int, timing: CycleTiming = PUNCTUAL) -> CycleRecord:
    """Run one cycle. Real-time safe.

    Args:
        parts: Everything that the cycle works on.
        t_ns: Instant of the cycle, in ns.
        timing: Timing of the loop.
    """
    devices, axes, stage = parts.devices, parts.axes, parts.stage
    slew_halved: Sequence[int] = ()
    users = None if stage is None else stage.users
    # Read, read back. A driver that fails gives invalid samples and NaN.
    samples = readings = devices.read(t_ns)
    read_back_v = devices.read_back(t_ns)
    if users is not None:  # the displacement of each actuator, from the readings of all sensors
        samples = users.displacements(readings, t_ns)
    if stage is not None and parts.loop_watch is not None:
        loop_watch = parts.loop_watch
        read = (readings, samples)
        samples, slew_halved = _watch(stage, loop_watch, t_ns, read, read_back_v, timing)

    # Reference, compensate: the command of each axis, and the voltage that should follow it.
    outputs = [axis.update(t_ns, samples[i]) for i, axis in enumerate(axes)]
    asked_v = [output.drive_v for output in outputs]
    in_force_v = [output.in_force_v for output in outputs]
    planned_t_ns = min([output.t_ns for output in outputs])

    # Guard. After a late cycle less than a period may have passed since the last write.
    elapsed_s = min((t_ns - parts.written_ns) / NS_PER_S, parts.period_s)
    live_v, age_s = (None, None) if stage is None else stage.judge.live(read_back_v, t_ns)
    left = () if stage is None else stage.output.left
    sent_v = devices.sent_v
    admitted = parts.guard.admit(
        planned_t_ns, t_ns, asked_v, in_force_v, elapsed_s, sent_v, slew_halved, live_v, age_s, left
    )
    drive_v, held = admitted.drive_v, admitted.held
    written = _write(parts, admitted, t_ns)
    lines = None if stage is None else stage.lines()
    if lines is not None:
        devices.set_lines(t_ns)

    if admitted.range_limited or admitted.slew_limited:
        _mark_limited(outputs, admitted)
    records = [
        axis.record(samples[i], outputs[i], drive_v[i], read_back_v[i])
        for i, axis in enumerate(axes)
    ]
    if stage is None:
        return CycleRecord(t_ns, State.RUN, False, written, 0, 0, records)
    if users is not None:
        records += users.records(records, t_ns)
    _watch_write(stage, admitted, outputs, written)
    written &= not held
    written |= stage.state not in DRIVEN or devices.played  # without a write nothing has failed
    present, latched = stage.register.present, stage.register.latched
    high = 0 if lines is None else lines.mask
    fields = t_ns, stage.state, devices.shadow, written, present, latched, records, high
    return tuple.__new__(CycleRecord, fields)  # a call of the class takes three times as long


def _watch(
    stage: Stage,
    loop_watch: LoopWatch,
    t_ns: int,
    read: tuple[Sequence[Sample], Sequence[Sample]],
    read_back_v: Sequence[float],
    timing: CycleTiming,
) -> tuple[Sequence[Sample], Sequence[int]]:
    """Find faults and react; return the samples that may be used, and axes with half the slew.

    Args:
        stage: The stage.
        loop_watch: The watch of the loop.
        t_ns: Instant of the cycle, in ns.
        read: Readings of the sensors, and the displacements of the axes; the same without user
            axes.
        read_back_v: Voltage of each axis, in V; NaN if the amplifier does not report it.
        timing: Timing of the loop.
    """
    try:
        # Screen, watch: the samples that may be used, and the detected faults.
        detections = [*loop_watch.check(timing), *stage.take_reports()]
        usable = _watch_axes(stage, t_ns, read, read_back_v, timing, detections)
        _watch_stage(stage, t_ns, read_back_v, detections)
        # Faults: which are new, and the worst reaction to them.
        reaction = stage.register.update(detections, t_ns)
        # React: change the state, then take the edges that time and devices cause.
        react(stage, reaction, t_ns)
        advance(stage, t_ns, _shown(read, usable), read_back_v)
        if (lines := stage.lines()) is not None:
            _follow_lines(stage, lines, t_ns)
        return usable, overloaded_axes(stage)
    except Exception as error:  # noqa: BLE001 - a mistake here must not drop the voltage
        return _hold_after_crash(stage, t_ns, read[1], error), ()


def _follow_lines(stage: Stage, lines: StageLines, t_ns: int) -> None:
    """Let lines go on; hold if one is lost that the present motion uses."""
    if why := lines.advance(t_ns, running=stage.state is _RUN):
        stage.note(StageEvent(t_ns, "error", "line", why))
        stage.hold(HoldCause.FAULT, t_ns)


def _shown(
    read: tuple[Sequence[Sample], Sequence[Sample]], usable: Sequence[Sample]
) -> Sequence[Sample]:
    """Return what the sensors show, valid as the displacements are."""
    readings, samples = read
    if readings is samples:
        return usable
    pairs = zip(readings, usable, strict=True)
    return [Sample(shown.t_ns, shown.position_um, used.valid) for shown, used in pairs]


def _write(parts: CycleParts, admitted: Admitted, t_ns: int) -> bool:
    """Write the admitted voltages; return whether they were taken."""
    drive_v, held = admitted.drive_v, admitted.held
    if len(held) == len(parts.axes) or not parts.devices.write(drive_v, t_ns, held):
        return False
    parts.written_ns = float(t_ns)
    for i, axis in enumerate(parts.axes):
        if i not in held:
            axis.applied(drive_v[i])  # the hysteresis memory advances with the applied voltage
    return True


# ---------------------------------------------------------------------- screen, watch


def _watch_axes(
    stage: Stage,
    t_ns: int,
    read: tuple[Sequence[Sample], Sequence[Sample]],
    read_back_v: Sequence[float],
    timing: CycleTiming,
    detections: list[Detection],
) -> Sequence[Sample]:
    """Add the faults of all axes; return the samples that may be used."""
    readings, samples = read
    if timing.skipped:
        for axis, watch in zip(stage.axes, stage.watches, strict=True):
            axis.law.pause_learning()
            watch.amplifier.after_gap(timing.skipped)
    if not stage.boundary.active or stage.boundary.lent:
        return samples
    flags, n_axes = stage.boundary.status(t_ns), len(samples)
    usable = []
    for i, sample in enumerate(samples):
        sensor_flags, amplifier_flags = flags[i], flags[n_axes + i]
        usable.append(
            _watch_axis(
                stage,
                i,
                t_ns,
                sample,
                None if readings is samples else readings[i].position_um,
                sensor_flags,
                amplifier_flags,
                read_back_v[i],
                detections,
            )
        )
    return usable


def _watch_axis(
    stage: Stage,
    i: int,
    t_ns: int,
    sample: Sample,
    reading_um: float | None,
    sensor_flags: Flags,
    amplifier_flags: Flags,
    read_back_v: float,
    detections: list[Detection],
) -> Sample:
    """Add the faults of one axis; return the sample that may be used."""
    # After a play the stage is where a drive of the device has left it.
    state, boundary = stage.state, stage.boundary
    driven = state in DRIVEN and not boundary.returned
    axis, watch = stage.axes[i], stage.watches[i]
    closed = state is _RUN and axis.mode in _SENSED
    bus, sensor = watch.bus, watch.sensor
    if sensor_flags or amplifier_flags or bus.counting:  # most cycles: no flags, no counters
        detections += bus.check(sensor_flags, amplifier_flags)
    for detection in sensor.check(
        t_ns,
        sample,
        sensor_flags,
        axis.law.in_force_v,
        axis.command_um,
        driven=driven and not boundary.shadow,
        needed=closed,
        reading_um=reading_um,
    ):
        # Missing samples (S5) are the consequence of a bus fault, which is reported already.
        if detection.fault is not Fault.S5 or not bus.explains_silence:
            detections.append(detection)
    detections += watch.amplifier.check(read_back_v, amplifier_flags)
    usable = sensor.sample
    position_um = usable.position_um if usable.valid else nan
    if driven:
        stage.judge.see(i, position_um, read_back_v, t_ns)
    detections += watch.adaptation.check(
        axis.command_um, position_um, closed=closed, noise_um=sensor.noise_um
    )
    if axis.crash is not None:
        text = f"axis {axis.name}: {axis.crash!r}"
        detections.append(_crashed(stage, t_ns, Fault.P4, i, text))
        axis.crash = None
    return usable


def _watch_stage(
    stage: Stage, t_ns: int, read_back_v: Sequence[float], detections: list[Detection]
) -> None:
    """Add the faults of the stage as a whole."""
    boundary, driven = stage.boundary, stage.state in DRIVEN
    if not (boundary.shadow or boundary.played):
        silent = stage.output.take_read_back(read_back_v, driven=driven)
        if silent is not None:
            detections.append(silent)
    if boundary.crash is not None:
        text = f"a driver failed: {boundary.crash!r}"
        detections.append(_crashed(stage, t_ns, Fault.P3, -1, text))
        boundary.crash = None
    users = stage.users
    if users is not None and users.crash is not None:
        text = f"the user axes failed: {users.crash!r}"
        detections.append(_crashed(stage, t_ns, Fault.P4, -1, text))
        users.crash = None
    if stage.estop_pressed():
        detections.append(_ESTOP)
    if driven and not boundary.shadow:
        detections += stage.output.unverified
    if stage.memory_is_missing():
        detections.append(_MEMORY_UNKNOWN)


def _mark_limited(outputs: Sequence[AxisOutput], admitted: Admitted) -> None:
    """Note in the outputs what the guard limits, unless the law does."""
    for index, output in enumerate(outputs):
        if index in admitted.range_limited:
            output.limited = _RANGE
        elif index in admitted.slew_limited and output.limited is DriveLimit.NONE:
            output.limited = _SLEW


def _watch_write(
    stage: Stage, admitted: Admitted, outputs: Sequence[AxisOutput], written: bool
) -> None:
    """Report this write to the watches of the amplifiers, which compare it in the next cycle."""
    boundary = stage.boundary
    if stage.state not in DRIVEN or boundary.shadow or not boundary.writes:
        return
    drive_v, held, refused, waits = (
        admitted.drive_v,
        admitted.held,
        admitted.refused,
        admitted.waits,
    )
    for i, watch in enumerate(stage.watches):
        blocked = i in held and i not in refused
        if blocked or i in waits:
            stage.axes[i].wait(lost=blocked)
        if blocked:
            watch.amplifier.waited(stage.axes[i].law.in_force_v)
            continue
        limited = outputs[i].limited
        watch.amplifier.wrote(
            drive_v[i],
            taken=written,
            refused=i in refused,
            range_limited=limited is _RANGE,
            slew_limited=limited is _SLEW or i in waits,
        )


def _crashed(stage: Stage, t_ns: int, fault: Fault, axis: int, text: str) -> Detection:
    """Store an event of an exception; return its detection."""
    stage.note(StageEvent(t_ns, "error", "crash", text, fault))
    return Detection(fault, axis)


def _hold_after_crash(
    stage: Stage, t_ns: int, samples: Sequence[Sample], error: Exception
) -> Sequence[Sample]:
    """Hold the voltages of all axes after an exception in watching or reacting."""
    text = f"watching or reacting failed: {error!r}"
    stage.report(_crashed(stage, t_ns, Fault.P4, -1, text))
    for axis in stage.axes:
        axis.hold()
    return [Sample(sample.t_ns, nan, False) for sample in samples]
