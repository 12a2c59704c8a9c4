"""What a stage does about faults, and by itself: ramps arrive, programs end, holds expire."""

from collections.abc import Sequence
from math import isfinite, nan
from typing import Final

from piezod.config.faults import Fault
from piezod.config.modes import SENSED, Mode
from piezod.config.states import State
from piezod.control.faults.cases import DOUBTING
from piezod.control.faults.detection import Detection, News
from piezod.control.faults.table import Reaction, ids, mask
from piezod.control.in_force import OUTPUT_WAIT_S
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.stage import Stage
from piezod.control.stage.states import Event, HoldCause
from piezod.control.stage.user_requests import run_users
from piezod.devices.interface import Sample
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S, s_to_ns

HOLD_NS = s_to_ns(2.0)
"""Duration of a HOLD that a fault caused, in ns; then the stage ramps to the safe voltage."""
RAMP_GRACE_NS = s_to_ns(2.0)
"""A ramp has failed if its end is not read back after this time, in ns."""
OUTPUT_WAIT_NS = s_to_ns(OUTPUT_WAIT_S)
STREAM_CYCLES, STREAM_NS = 5, s_to_ns(0.1)
"""A stream has stopped if no setpoint came for this many cycles and for this time."""

_OUTPUT_FELL: Final = (Fault.A7, Fault.A9)
_RUN: Final = State.RUN
_LOCAL_MODE: Final = mask([Fault.A8])
_WRITES_NOTHING: Final = frozenset(
    {State.BOOT, State.SAFE, State.FAULT, State.BLIND, State.STOPPING}
)
_DOUBTING = mask(DOUBTING)
_NO_REACTION: Final = Reaction.NONE
_OVERLOADED, _OSCILLATING = mask([Fault.A4]), mask([Fault.D6])
_EVENTS: Final = {
    Reaction.RAMP: Event.FAULT_RAMP,
    Reaction.BLIND: Event.FAULT_BLIND,
    Reaction.CUT: Event.FAULT_CUT,
}


def react(stage: Stage, reaction: Reaction, t_ns: int) -> None:
    """Report the changes of faults, and carry out the most severe reaction."""
    register = stage.register
    active_faults = register.present | register.latched
    if not (active_faults or register.news) and reaction is _NO_REACTION:
        return  # most cycles
    for news in register.news:
        if news.rule.reaction is not Reaction.NONE:  # such faults would flood the log
            stage.note(_fault_event(stage, t_ns, news))
    if active_faults or register.news:
        _halve_gains(stage, register.axes_of(Fault.D6) if active_faults & _OSCILLATING else 0)
        _doubt_samples(stage, active_faults & _DOUBTING)
    if reaction is Reaction.HOLD and not register.needs_person:
        stage.hold(HoldCause.LATENESS, t_ns)  # the mode stays: the stage will go on
        return
    degrades = active_faults and not register.adapt_allowed
    if degrades or reaction in {Reaction.DEGRADE, Reaction.HOLD}:
        for axis in stage.axes:
            if axis.mode in SENSED:
                axis.select(Mode.FEEDFORWARD)
    if reaction is Reaction.HOLD:
        stage.hold(HoldCause.FAULT, t_ns)
    event = _event_of(stage, reaction, t_ns)
    if event is not None:
        stage.go(event, t_ns)
    # A lost amplifier may have any voltage when it answers again.
    if event is Event.FAULT_BLIND:
        for watch in stage.watches:
            watch.amplifier.forget()


def _event_of(stage: Stage, reaction: Reaction, t_ns: int) -> Event | None:
    """Return the event of the reaction to a fault; cut the outputs if that is it."""
    event = _EVENTS.get(reaction)
    if event is Event.FAULT_CUT and not stage.cut(t_ns):
        return Event.FAULT_RAMP
    if event is Event.FAULT_BLIND:  # a ramp goes on without the axes that it leaves as they are
        left = sum(1 << i for i in stage.output.left)
        return event if stage.register.blind & ~left else None
    return event


def _halve_gains(stage: Stage, oscillating: int) -> None:
    """Halve the gains of the axes that oscillate (bits), until that fault is reset."""
    for i, axis in enumerate(stage.axes):
        axis.law.halve_gains(bool(oscillating >> i & 1))


def _doubt_samples(stage: Stage, active_faults: int) -> None:
    """Drop what was learned from samples that may have been wrong, and learn nothing from them."""
    doubted = 0
    for fault in ids(active_faults) if active_faults else ():
        doubted |= stage.register.axes_of(fault)
    for i, axis in enumerate(stage.axes):
        axis.law.doubt(bool(doubted >> i & 1))


def overloaded_axes(stage: Stage) -> Sequence[int]:
    """Return the axes with an overloaded amplifier: their slew rate is halved."""
    if not stage.register.present & _OVERLOADED:
        return ()
    return [i for i, watch in enumerate(stage.watches) if watch.amplifier.overloaded]


def _fault_event(stage: Stage, t_ns: int, news: News) -> StageEvent:
    """Return the event of a fault that appeared, escalated or ended."""
    rule, detection, appeared = news
    axis = stage.axes[detection.axis].name if detection.axis >= 0 else ""
    text = f"{rule.name}; {rule.remedy}" if appeared else f"{rule.name}: gone"
    return StageEvent(
        t_ns,
        rule.severity if appeared else "info",
        "fault" if appeared else "fault-cleared",
        text,
        rule.id,
        axis,
        detection.measured,
        detection.limit,
    )


def advance(
    stage: Stage, t_ns: int, samples: Sequence[Sample], read_back_v: Sequence[float]
) -> None:
    """Take the edges of the state machine that time and the devices cause.

    Call once per cycle, after the reaction to faults. Real-time safe.

    Args:
        stage: The stage.
        t_ns: Instant of the cycle.
        samples: The samples that may be used.
        read_back_v: Voltage of each axis, in V; NaN if the amplifier does not report it.
    """
    if stage.boundary.played and _play_goes_on(stage, t_ns, read_back_v):
        return
    if stage.state is _RUN:  # most cycles
        _run(stage, t_ns)
    else:
        _advance_beside_run(stage, t_ns, read_back_v)
    if stage.state in _WRITES_NOTHING:
        stage.track(read_back_v)
    if stage.zero.runs:
        _zero(stage, t_ns, samples)


def _advance_beside_run(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """Take the edges of the states in which no reference is followed."""
    match stage.state:
        case State.BOOT:
            _boot(stage, t_ns, read_back_v)
        case State.HOLD:
            _hold(stage, t_ns, read_back_v)
        case State.IDENT:
            if stage.continue_drive(t_ns):
                _zero_at_known_rest(stage, t_ns)
        case State.RAMP | State.ESTOP:
            _settle_outputs(stage, t_ns, read_back_v)
            _finish_ramp(stage, t_ns, read_back_v)
        case State.BLIND:
            _take_over(stage, t_ns, read_back_v)
        case _:
            pass


def _play_goes_on(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> bool:
    """Return whether a play still has the devices, or has left voltages that nobody knows."""
    end = stage.play().advance(stage.axes, read_back_v)
    if end is None:
        return True
    if isinstance(end, Detection):
        stage.report(end)
        return True
    if end.failed:
        stage.note(StageEvent(t_ns, "warning", "play", f"the play failed: {end.failed}"))
    settles = _is_near_writes(stage, read_back_v)
    stage.judge.lose_sight(answered=end.commanded and not settles)
    unknown, _ = stage.judge.resync(read_back_v, t_ns, settles=settles)
    stage.resume_output(t_ns)
    if unknown:
        stage.go(Event.FAULT_BLIND, t_ns)
    return False


def _is_near_writes(stage: Stage, read_back_v: Sequence[float]) -> bool:
    """Return whether the outputs are where one cycle leads: an output may settle after a play."""
    period_s = stage.period_ns / NS_PER_S
    return not any(
        abs(drive_v - written_v) > axis.law.limits.reach_v(period_s)
        for axis, drive_v, written_v in zip(
            stage.axes, read_back_v, stage.boundary.written_v, strict=True
        )
    )


def _boot(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """End the self-test: configuration and devices were checked before the first cycle."""
    if stage.output.missing(read_back_v):
        stage.go(Event.FAULT_BLIND, t_ns)
    else:
        stage.track(read_back_v)  # a ramp that follows starts there
        stage.end_self_test(t_ns)
        for axis in () if stage.state is State.BOOT else stage.axes:
            if refusal := axis.law.refusal(Mode.TRIMMED):
                text = f"mode trimmed is not available: {refusal}"
                stage.note(StageEvent(t_ns, "info", "trim", text, axis=axis.name))


def _hold(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """Hold for a limited time. In local mode, write nothing and follow the read-back."""
    boundary, withheld_before = stage.boundary, stage.boundary.withheld
    boundary.withheld = bool(stage.register.present & _LOCAL_MODE) and not boundary.shadow
    if boundary.withheld:
        # Without a read-back the voltage that the local operator leaves is unknown.
        stage.output.know_unread(known=False, axes=stage.register.axes_of(Fault.A8))
        stage.track(read_back_v)
        stage.restart_hold(t_ns)
    elif withheld_before and not stage.output.known:
        stage.go(Event.FAULT_BLIND, t_ns)
    elif stage.hold_cause() is HoldCause.LATENESS:
        if not stage.register.stopping and not stage.go(Event.RESUME, t_ns):
            text = "the cycles are punctual again: the stage goes on"
            stage.note(StageEvent(t_ns, "info", "lateness", text))
    elif stage.hold_cause() is HoldCause.FAULT and stage.time_in_state_ns(t_ns) >= HOLD_NS:
        stage.go(Event.HOLD_EXPIRED, t_ns)


def _run(stage: Stage, t_ns: int) -> None:
    """Take the command inputs; hold if a stream of setpoints has stopped."""
    quiet_ns = max(STREAM_CYCLES * stage.period_ns, STREAM_NS)
    if stage.users is not None:
        run_users(stage, stage.users, t_ns, quiet_ns)
    for i, axis in enumerate(stage.axes):
        if axis.stream is None:  # only a stream follows the command input
            continue
        if axis.follows_input:
            axis.take_command(stage.boundary.devices.commands()[i])
        if t_ns - axis.commanded_ns <= quiet_ns:
            continue
        text = f"no setpoint for {quiet_ns / 1e6:g} ms: the stream has stopped"
        if axis.follows_input:
            low_um, high_um = axis.motion_limits.low_um, axis.motion_limits.high_um
            text = (
                f"the command input gave no value from {low_um:g} to {high_um:g} µm for "
                f"{quiet_ns / 1e6:g} ms: the axis stops following it"
            )
        stage.note(StageEvent(t_ns, "warning", "stream", text, axis=axis.name))
        # Like a requested hold, it does not expire: no fault is present, and `resume` continues.
        stage.hold(HoldCause.REQUEST, t_ns)
        return


def _take_over(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """Take over a lost amplifier from its read-back, after a pause that grows with each loss.

    If the read-back is unlike the last write, see `OutputJudge.resync`. An amplifier whose voltage
    stays unknown does not keep the others from their ramp, nor does one that stays silent: the ramp
    leaves it as it is.
    An amplifier without read-back is taken over from its last acknowledged write, if there was one,
    if it holds its output by itself, and if it reports restarts and has reported neither one nor
    local mode. Otherwise the start of a ramp is unknown.
    """
    if not stage.output.try_due(stage.time_in_state_ns(t_ns)):
        return
    lost = _silent_axes(stage, read_back_v)
    if lost and (len(lost) == len(stage.axes) or not stage.must_ramp(t_ns)):
        return
    for i, reads_back in enumerate(stage.boundary.reads_back):
        if not (i in lost or reads_back or _still_at_last_write(stage, i)):
            lost[i] = "the amplifier does not report its voltage"
            stage.boundary.took_over(i, nan)  # it tells nothing about the output any more
    unknown, others = stage.judge.resync(read_back_v, t_ns, lost=lost)
    if unknown:
        text = (
            f"the voltage of an amplifier is unknown, and stays: {unknown}; bring it to the safe "
            "voltage by hand, then `piezod reset` and `piezod arm --confirm-output`"
        )
        stage.note(StageEvent(t_ns, "error", "output", text))
    if unknown and not others:
        stage.release_estop()
        stage.go(Event.OUTPUT_UNKNOWN, t_ns)
        return
    stage.output.know(known=True)
    stage.output.left = lost
    stage.go(Event.LINK_BACK, t_ns)


def _silent_axes(stage: Stage, read_back_v: Sequence[float]) -> dict[int, str]:
    """Return all axes of the amplifiers that do not answer, and why they are not driven."""
    unreachable, amplifiers = stage.register.unreachable, stage.boundary.amplifiers
    silent = {
        amplifiers[i]
        for i, drive_v in enumerate(read_back_v)
        if unreachable >> i & 1 or stage.boundary.misses(i, drive_v)
    }
    why = "the amplifier does not answer"
    return {i: why for i, amplifier in enumerate(amplifiers) if amplifier in silent}


def _still_at_last_write(stage: Stage, index: int) -> bool:
    """Return whether a lost amplifier still outputs the last acknowledged voltage of an axis.

    An amplifier that does not report a restart may have been without power meanwhile, and be at 0
    V. In local mode a person may have set any voltage.
    """
    if any(stage.register.axes_of(fault) >> index & 1 for fault in _OUTPUT_FELL):
        return False
    if stage.watches[index].amplifier.reports_move:
        return False
    reports = stage.boundary.holds and stage.boundary.reports_restart
    return stage.output.was_known(index) and reports


def _settle_outputs(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """Find out which voltage is in force on an axis that waits for its output."""
    for i, axis in enumerate(stage.axes):
        if i in stage.output.left or not (axis.waits and isfinite(read_back_v[i])):
            continue
        if stage.judge.settle(i, read_back_v[i], t_ns, lost=axis.lost):
            axis.ramp_to(axis.config.safe_v)


def _finish_ramp(stage: Stage, t_ns: int, read_back_v: Sequence[float]) -> None:
    """End a ramp when each axis has reached the safe voltage, or takes too long."""
    if stage.boundary.active:  # outputs that were cut fall by themselves
        for i, drive_v in enumerate(read_back_v):
            if i not in stage.output.left and stage.boundary.misses(i, drive_v):
                return  # one that comes again decides; one that stays away is A1
    # Both must be at the safe voltage: the drive that was written, and the read-back if there is
    # one.
    away = [
        i
        for i, (axis, drive_v) in enumerate(zip(stage.axes, read_back_v, strict=True))
        if not axis.drive_ended(t_ns)
        or i in stage.output.left
        or abs(drive_v - axis.config.safe_v) > axis.law.limits.read_back_tolerance_v
    ]
    if not away or not stage.boundary.active:  # outputs that were cut fall by themselves
        stage.go(Event.ESTOP_RELEASED if stage.release_estop() else Event.AT_SAFE, t_ns)
    elif all(i in stage.output.left or _has_failed(stage, stage.axes[i]) for i in away):
        stage.release_estop()
        for i in away:
            _report_failed(stage, i, t_ns, read_back_v[i])
        stage.go(Event.RAMP_TIMEOUT, t_ns)


def _report_failed(stage: Stage, index: int, t_ns: int, drive_v: float) -> None:
    """Report that the voltage of an axis stays, with the numbers."""
    axis, left = stage.axes[index], stage.output.left.get(index, "")
    safe_v, tolerance_v = axis.config.safe_v, axis.law.limits.read_back_tolerance_v
    if not left:
        stage.report(Detection(Fault.A3, index, drive_v - safe_v, tolerance_v))
    why = left or stage.judge.told(index) or "the output does not follow its writes"
    text = f"the voltage stays: {drive_v:.4g} V read back, {axis.law.in_force_v:.4g} V written "
    text += f"last, safe voltage {safe_v:g} V: {why}; when the output follows again, "
    text += "`piezod estop` ramps it down"
    fault = "" if left else Fault.A3
    stage.note(StageEvent(t_ns, "error", "output", text, fault, axis.name))


def _has_failed(stage: Stage, axis: StageAxis) -> bool:
    """Return whether the ramp of an axis takes too long, or has waited too long for its output."""
    overdue_ns = -axis.ramp_cycles * stage.period_ns
    waited_ns = axis.waited_cycles * stage.period_ns
    return overdue_ns > RAMP_GRACE_NS or waited_ns > OUTPUT_WAIT_NS


def _zero_at_known_rest(stage: Stage, t_ns: int) -> None:
    """Zero each sensor whose rest depends on the past of the drive: only now that is known."""
    axes = [
        i
        for i, axis in enumerate(stage.axes)
        if axis.has_sensor and (axis.law.rests_inside or axis.law.compensator.rest_depends_on_path)
    ]
    if axes:
        stage.zero.begin(axes, stage.period_ns, t_ns)


def _zero(stage: Stage, t_ns: int, samples: Sequence[Sample]) -> None:
    at_rest = stage.state in {State.SAFE, State.READY}
    zeroed = stage.zero.advance(t_ns, samples, at_rest=at_rest)
    if zeroed is None:
        text = "the sensor was not zeroed: too few valid samples, or the stage did not stay at rest"
        stage.note(StageEvent(t_ns, "warning", "zero", text))
        return
    for i in zeroed:
        axis = stage.axes[i]
        axis.law.zero()
        stage.watches[i].sensor.zeroed()
        text = f"sensor zeroed at {stage.zero.um(i):.6g} µm"
        stage.note(StageEvent(t_ns, "info", "zero", text, axis=axis.name))
