"""What a stage goes on with by itself: ramps that arrive, drives that end, holds that expire."""

from collections.abc import Sequence
from math import isfinite

from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.control.faults.register import Detection
from piezod.control.faults.table import mask
from piezod.control.stage.record import StageEvent
from piezod.control.stage.stage import Stage
from piezod.control.stage.states import Event
from piezod.devices.interface import Sample
from piezod.units import s_to_ns

HOLD_NS = s_to_ns(2.0)
"""A fault may hold the stage so long; then it goes to the safe voltage."""
RAMP_GRACE_NS = s_to_ns(2.0)
"""A ramp has failed when it takes so much longer than it should."""
FIRST_TRY_NS, LAST_TRY_NS = s_to_ns(0.1), s_to_ns(2.0)
"""An amplifier that was lost is left alone for so long at first, and at most."""
STREAM_CYCLES, STREAM_NS = 5, s_to_ns(0.1)
"""A stream has stopped when nothing came for so many cycles and for so long."""

_FALLEN, _LOCAL = mask([Fault.A7, Fault.A9]), mask([Fault.A8])


def go_on(stage: Stage, t_ns: int, samples: Sequence[Sample], read_back_v: Sequence[float]) -> None:
    """Take the edges that time and the devices give; may be called in the loop.

    Args:
        stage: The stage.
        t_ns: Instant of the cycle.
        samples: What was measured.
        read_back_v: What the amplifiers tell, NaN where they do not.
    """
    match stage.state:
        case State.BOOT:
            _boot(stage, t_ns)
        case State.HOLD:
            _hold(stage, t_ns, read_back_v)
        case State.RUN:
            _follow_inputs(stage)
            _check_stream(stage, t_ns)
        case State.IDENT:
            _drive_on(stage, t_ns)
        case State.RAMP | State.ESTOP:
            _arrive(stage, t_ns, read_back_v)
        case State.BLIND:
            _reach(stage, t_ns, read_back_v)
        case _:
            pass
    if stage.state in {State.BOOT, State.SAFE, State.FAULT, State.BLIND}:
        _track(stage, read_back_v)
    if stage.zeroing is not None:
        _zero(stage, t_ns, samples)


def _boot(stage: Stage, t_ns: int) -> None:
    """Pass the self-test: configuration and devices were checked before the first cycle."""
    if stage.boundary.reads_back and not stage.output_known:
        stage.go(Event.FAULT_BLIND, t_ns)
        return
    stage.tested = not stage.register.blocking
    stage.go(Event.SELF_TEST_PASSED if stage.tested else Event.SELF_TEST_FAILED, t_ns)
    stage.tested = True


def _track(stage: Stage, read_back_v: Sequence[float]) -> None:
    """Have the axes follow what others may do to the output while we write nothing."""
    for axis, drive_v in zip(stage.axes, read_back_v, strict=True):
        if isfinite(drive_v):
            axis.track(drive_v)


def _hold(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """Hold for a while; while somebody else drives the amplifier, write nothing, and follow."""
    boundary, before = stage.boundary, stage.boundary.withheld
    boundary.withheld = bool(stage.register.present & _LOCAL) and not boundary.shadow
    if boundary.withheld:
        stage.output_known &= boundary.reads_back
        _track(stage, read_back_v)
        stage.since_ns = t_ns
    elif before and not stage.output_known:
        stage.go(Event.FAULT_BLIND, t_ns)
    elif not stage.held_by_request and t_ns - stage.since_ns >= HOLD_NS:
        stage.go(Event.HOLD_EXPIRED, t_ns)


def _follow_inputs(stage: Stage) -> None:
    for i, axis in enumerate(stage.axes):
        if axis.follows_input:
            axis.command(stage.boundary.devices.commands()[i])


def _check_stream(stage: Stage, t_ns: int) -> None:
    quiet_ns = max(STREAM_CYCLES * stage.period_ns, STREAM_NS)
    for name, axis in zip(stage.names, stage.axes, strict=True):
        newest_ns = axis.commanded_ns if axis.follows_input else stage.stream_ns
        if axis.stream is None or t_ns - newest_ns <= quiet_ns:
            continue
        text = f"no setpoint for {quiet_ns / 1e6:g} ms: the stream has stopped"
        if axis.follows_input:
            low_um, high_um = axis.pace.low_um, axis.pace.high_um
            text = (
                f"the command input has told nothing from {low_um:g} to {high_um:g} µm for "
                f"{quiet_ns / 1e6:g} ms: it is not followed any more"
            )
        stage.note(StageEvent(t_ns, "warning", "stream", text, axis=name))
        stage.go(Event.HOLD, t_ns)
        stage.held_by_request = True
        return


def _reach(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """Take the amplifier over from what it reads back, after a while that grows with each spell.

    One that does not read back is taken over from the write that it acknowledged last, if there was
    one, if it would have told that it was restarted and has not, and if it holds its output by
    itself. If not, nobody knows where a ramp would begin.
    """
    wait_ns = min(FIRST_TRY_NS << min(stage.blind_spells - 1, 10), LAST_TRY_NS)
    if stage.register.unreachable or t_ns - stage.since_ns < wait_ns:
        return
    if stage.boundary.reads_back:
        if not all(map(isfinite, read_back_v)):
            return
        _track(stage, read_back_v)
    elif not _still_as_written(stage):
        stage.estop_pressed = False
        text = (
            "the amplifier answers again and does not tell its voltage: bring it to the safe one "
            "by hand, then `piezod reset` and `piezod arm --confirm-output`"
        )
        stage.note(StageEvent(t_ns, "warning", "output", text))
        stage.go(Event.OUTPUT_UNKNOWN, t_ns)
        return
    stage.output_known = True
    stage.go(Event.LINK_BACK, t_ns)


def _still_as_written(stage: Stage) -> bool:
    """Tell whether an amplifier that was lost still gives what it acknowledged last.

    One that does not tell a restart may have been without power meanwhile, and be at 0 V.
    """
    fallen = stage.register.latched & _FALLEN
    tells = stage.boundary.holds and stage.boundary.tells_restart
    return stage.known_when_lost and tells and not fallen


def _drive_on(stage: Stage, t_ns: int) -> None:
    if not all(axis.drive_ended(t_ns) for axis in stage.axes) or stage.next_step(t_ns):
        return
    stage.memory_known |= stage.conditions
    stage.go(Event.IDENTIFY_DONE, t_ns)


def _arrive(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    at_safe = all(
        axis.drive_ended(t_ns)
        and not abs(drive_v - axis.config.safe_v) > axis.live.limits.read_back_tolerance_v
        for axis, drive_v in zip(stage.axes, read_back_v, strict=True)  # NaN where there is none
    )
    overdue_cycles = -min(axis.ramp_cycles for axis in stage.axes)
    if not stage.boundary.active:  # its outputs were cut, and fall by themselves
        at_safe = True
    if at_safe and stage.estop_pressed:
        stage.estop_pressed = False
        stage.go(Event.ESTOP_RELEASED, t_ns)
    elif at_safe:
        stage.go(Event.AT_SAFE, t_ns)
    elif overdue_cycles * stage.period_ns > RAMP_GRACE_NS:
        stage.estop_pressed = False
        for i, (axis, drive_v) in enumerate(zip(stage.axes, read_back_v, strict=True)):
            tolerance_v = axis.live.limits.read_back_tolerance_v
            stage.found.append(Detection(Fault.A3, i, drive_v - axis.config.safe_v, tolerance_v))
        stage.go(Event.RAMP_TIMEOUT, t_ns)


def _zero(stage: Stage, t_ns: int, samples: Sequence[Sample]) -> None:
    zeroing = stage.zeroing
    if zeroing is None:
        return
    if stage.state not in {State.SAFE, State.READY} or t_ns > zeroing.until_ns:
        text = "the sensor was not zeroed: too few valid samples, or the stage did not stay at rest"
        stage.note(StageEvent(t_ns, "warning", "zero", text))
        stage.zeroing = None
    elif zeroing.take(samples):
        for i in zeroing.axes:
            stage.set_zero(i, stage.zero_um[i] + zeroing.mean_um(i))
            stage.axes[i].live.zero()
            text = f"sensor zeroed at {stage.zero_um[i]:.6g} µm"
            stage.note(StageEvent(t_ns, "info", "zero", text, axis=stage.names[i]))
        stage.zeroing = None
