"""Carries out requests, or refuses them with a reason and a remedy."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from piezod.config.frequencies import too_fast
from piezod.config.modes import SENSED
from piezod.config.states import State
from piezod.config.waveforms.waveform import Waveform
from piezod.control.stage import user_requests
from piezod.control.stage.answer import Answer
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.common_start import start_ns, start_refusal
from piezod.control.stage.drive_requests import (
    condition,
    condition_axes,
    identify,
    play,
    scan,
)
from piezod.control.stage.named import (
    axes_behind,
    axes_named,
    axis_names,
    unknown_axis,
    without_sensor,
)
from piezod.control.stage.running import run_event, start_running
from piezod.control.stage.stage import Stage
from piezod.control.stage.states import Event, HoldCause
from piezod.control.stage.user_requests import movers
from piezod.errors import PiezodError
from piezod.messages import requests
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S, s_to_ns

AT_REST_PART = 0.01
"""A stage is at rest if its voltage is the rest voltage within this share of its range."""


def execute(stage: Stage, request: requests.Request, t_ns: int) -> Answer:
    """Carry out a request between two cycles. Real-time safe.

    Args:
        stage: The stage.
        request: The request; its numbers are finite and within their ranges.
        t_ns: Instant of the next cycle, or earlier, in ns.
    """
    return HANDLERS[type(request)](stage, request, t_ns)


# ---------------------------------------------------------------------- edges of the state machine


def _disarm(stage: Stage, _: requests.Disarm, t_ns: int) -> Answer:
    return _answer(stage.go(Event.DISARM, t_ns))


def _stop(stage: Stage, _: requests.Stop, t_ns: int) -> Answer:
    if stage.state is State.FAULT and stage.boundary.active:
        nothing = "nothing is driven in FAULT"
        if away := stage.away():
            return Answer(False, f"{nothing}, {away}: `piezod estop` ramps it down")
        if any(stage.boundary.reads_back) and not stage.output.known:
            why = f"{nothing}, and the voltage in force is unknown, because nothing is read back"
            return Answer(False, f"{why}: `piezod estop` ramps down when the amplifier answers")
    _note_delay(stage, "stop", t_ns)
    return _answer(stage.go(Event.STOP, t_ns))


def _hold(stage: Stage, _: requests.Hold, t_ns: int) -> Answer:
    return _answer(stage.hold(HoldCause.REQUEST, t_ns))


def _resume(stage: Stage, _: requests.Resume, t_ns: int) -> Answer:
    why = stage.refusal(Event.RESUME, t_ns) or stage.register.resume()
    return _answer(why or stage.go(Event.RESUME, t_ns))


def _reset(stage: Stage, request: requests.Reset, t_ns: int) -> Answer:
    why = stage.refusal(Event.RESET, t_ns) or stage.register.reset(request.engineer)
    if why:
        return Answer(False, why)
    if not stage.boundary.active:  # the outputs were cut
        stage.boundary.activate(t_ns)
    return _answer(stage.go(Event.RESET, t_ns))


def _estop(stage: Stage, _: requests.Estop, t_ns: int) -> Answer:
    _note_delay(stage, "estop", t_ns)
    return _answer(stage.press_estop(t_ns))


def _note_delay(stage: Stage, request: str, t_ns: int) -> None:
    """Note that a request to stop is carried out later, because nothing can be sent now."""
    if stage.state is State.BLIND:
        text = (
            "nothing can be sent to the amplifier: the stage aborts a play and ramps down when the "
            "amplifier answers; `piezod faults` shows the cause"
        )
        stage.note(StageEvent(t_ns, "warning", request, text))


def _shut_down(stage: Stage, _: requests.Shutdown, t_ns: int) -> Answer:
    return _answer(stage.shut_down(t_ns))


def _answer(refusal: str, motion: int = 0) -> Answer:
    return Answer(not refusal, refusal, 0 if refusal else motion)


def _arm(stage: Stage, request: requests.Arm, t_ns: int) -> Answer:
    if stage.state is not State.SAFE:
        refusal = stage.go(Event.ARM, t_ns)  # armed already, or refused
        if not refusal and request.shadow != stage.boundary.shadow:
            how = "in shadow" if stage.boundary.shadow else "and not in shadow"
            refusal = f"the stage is armed {how}: `piezod disarm` first"
        return _answer(refusal)
    stage.register.resume()  # faults that only held the stage, and are gone, end here
    stage.boundary.shadow = request.shadow
    stage.confirm_output(confirmed=request.confirm_output)
    refusal = stage.go(Event.ARM, t_ns)
    stage.confirm_output(confirmed=False)
    if refusal:
        stage.boundary.shadow = False
        return Answer(False, refusal)
    to_condition = [i for i, axis in enumerate(stage.axes) if axis.config.conditioning.on_arm]
    return condition_axes(stage, to_condition, t_ns) if to_condition else Answer(True)


# ---------------------------------------------------------------------- movements


def _select(stage: Stage, request: requests.SelectMode, t_ns: int) -> Answer:
    axes, why = axes_behind(stage, request.axis)
    if not why and request.mode in SENSED:
        why = without_sensor(stage, axes, f"mode {request.mode}")
    if not why:
        refusals = ((stage.axes[i].name, stage.axes[i].law.refusal(request.mode)) for i in axes)
        why = "; ".join(f"axis {name}: {refusal}" for name, refusal in refusals if refusal)
    if why:
        return Answer(False, why)
    if stage.state is not State.SAFE:  # in SAFE the mode is set for later
        refusal = stage.go(run_event(request.mode), t_ns)
        if refusal:
            return Answer(False, refusal)
    for i in axes:
        stage.axes[i].select(request.mode)
    return Answer(True)


def _goto(stage: Stage, request: requests.Goto, t_ns: int) -> Answer:
    users, why = movers(stage, (request.axis,))
    if why:
        return Answer(False, why)
    if users is not None:
        point = {request.axis or users.names[0]: request.position_um}
        return user_requests.path(stage, users, [point], request.speed_um_per_s, t_ns)
    axes, why = axes_named(stage, request.axis)
    if not why and len(axes) > 1:
        why = f"axis must be one of {axis_names(stage)}: a position is for one axis"
    if why:
        return Answer(False, why)
    axis, position_um = stage.axes[axes[0]], request.position_um
    speed_um_per_s, fastest_um_per_s = request.speed_um_per_s, axis.motion_limits.speed_um_per_s
    why = axis.motion_limits.refusal(position_um, position_um)
    if not why and speed_um_per_s is not None and speed_um_per_s > fastest_um_per_s:
        why = (
            f"speed out of range (got {speed_um_per_s:g} µm/s), allowed: at most "
            f"{fastest_um_per_s:g} µm/s, speed_um_per_s of the axis"
        )
    why = why or start_running(stage, t_ns)
    if why:
        return Answer(False, why)
    axis.go_to(position_um, request.speed_um_per_s, t_ns)
    return _started([axis], t_ns)


def _path(stage: Stage, request: requests.Path, t_ns: int) -> Answer:
    named = {name: None for point in request.points for name in point}
    users, why = movers(stage, named)
    if users is None and not why:
        unknown = [name for name in named if name not in {axis.name for axis in stage.axes}]
        why = "straight lines are for user axes, which `transform:` defines: use goto"
        why = unknown_axis(stage, unknown[0]) if unknown else why
    if users is None:
        return Answer(False, why)
    return user_requests.path(stage, users, request.points, request.speed_per_s, t_ns)


def _wave(stage: Stage, request: requests.Wave, t_ns: int) -> Answer:
    users, why = movers(stage, request.command_um)
    why = why or _line_refusal(stage, request, of_users=users is not None)
    if why:
        return Answer(False, why)
    if users is not None:
        return user_requests.wave(stage, users, request, t_ns)
    waveforms: dict[int, Waveform] = {}
    before_s = 0.0
    for name, config in request.command_um.items():
        axes, why = axes_named(stage, name)
        if why:
            return Answer(False, why)
        waveform = waveforms[axes[0]] = config.built(request.duration_s)
        axis = stage.axes[axes[0]]
        why = too_fast(waveform.highest_hz, NS_PER_S / stage.period_ns)
        why = why or axis.motion_limits.refusal(waveform.low, waveform.high)
        lead_in_s = axis.lead_in(waveform, t_ns).duration_s
        before_s = max(before_s, lead_in_s)
        if why := why or start_refusal(request.start_s, t_ns, lead_in_s):
            return Answer(False, why)
    if why := start_running(stage, t_ns):
        return Answer(False, why)
    begins_ns, clock = start_ns(request.start_s), None
    lines = stage.lines()
    if lines is not None and (request.pulses or request.edges):
        # All axes begin together, because the lines have one time.
        begins_ns = max(begins_ns, t_ns + s_to_ns(before_s))
        first = stage.axes[next(iter(waveforms))]
        clock = lines.begin(request, first, t_ns, begins_ns - t_ns)
    for i, waveform in waveforms.items():
        stage.axes[i].follow(waveform, request.duration_s, t_ns, begins_ns, clock)
    return _started([stage.axes[i] for i in waveforms], t_ns)


def _line_refusal(stage: Stage, request: requests.Wave, *, of_users: bool) -> str:
    """Return why a request cannot use lines; empty if it can, or uses none."""
    if not (request.pulses or request.edges):
        return ""
    lines = stage.lines()
    if lines is None:
        return "the stage has no lines: name digital channels in `lines:` of its configuration"
    if of_users:
        return "lines are in step with the axes of `axes:`, not with those of `transform:`"
    return lines.refusal(request)


def _stream(stage: Stage, request: requests.Stream, t_ns: int) -> Answer:
    users, why = movers(stage, request.axes)
    if why:
        return Answer(False, why)
    if users is not None:
        return user_requests.stream(stage, users, request.axes, t_ns)
    axes = {axis.name: axis for axis in stage.axes}
    unknown = [name for name in request.axes if name not in axes]
    why = unknown_axis(stage, unknown[0]) if unknown else start_running(stage, t_ns)
    if why:
        return Answer(False, why)
    for name in request.axes:
        axes[name].follow_stream(t_ns)
    return _started([axes[name] for name in request.axes], t_ns)


def _follow(stage: Stage, request: requests.Follow, t_ns: int) -> Answer:
    axes, why = axes_named(stage, request.axis)
    commanded = [i for i in axes if stage.axes[i].config.command_input is not None]
    if not (why or commanded):
        whose = request.axis or axis_names(stage)
        why = f"there is nothing to follow: the configuration has no `command_input` for {whose}"
    why = why or start_running(stage, t_ns)
    if why:
        return Answer(False, why)
    for i in commanded:
        stage.axes[i].follow_input(t_ns)
    return _started([stage.axes[i] for i in commanded], t_ns)


def _started(axes: Sequence[StageAxis], t_ns: int) -> Answer:
    """Return the answer to a request that has started a movement of these axes, at least one."""
    longest_s = max(axis.on_target_in_s(t_ns) for axis in axes)
    return Answer(True, motion=axes[0].motion, duration_s=longest_s)


# ---------------------------------------------------------------------- sensor and model


def _zero(stage: Stage, request: requests.Zero, t_ns: int) -> Answer:
    axes, why = axes_behind(stage, request.axis)
    if stage.users is not None and set(axes) & set(stage.users.at):
        axes = sorted({*axes, *stage.users.at})  # each actuator is measured by all their sensors
    why = why or without_sensor(stage, axes, "zeroing")
    if why:
        return Answer(False, why)
    if stage.state not in {State.SAFE, State.READY}:
        why = f"the stage is in {stage.state}; a sensor can be zeroed in SAFE or READY"
        return Answer(False, why)
    for i in axes:
        limits, in_force_v = stage.axes[i].config.limits, stage.axes[i].law.in_force_v
        if abs(in_force_v - limits.rest_v) > AT_REST_PART * (
            limits.drive_max_v - limits.drive_min_v
        ):
            return Answer(
                False,
                f"axis {stage.axes[i].name} is at {in_force_v:.3g} V; a sensor can be zeroed at "
                f"the rest voltage, {limits.rest_v:g} V: `piezod stop` ramps there",
            )
    stage.zero.begin(axes, stage.period_ns, t_ns)
    return Answer(True)


def _adopt(stage: Stage, request: requests.AdoptModel, _t_ns: int) -> Answer:
    axes, why = axes_named(stage, request.axis)
    if not why and len(axes) > 1:
        why = f"axis must be one of {axis_names(stage)}: a model is for one axis"
    if not why and stage.state not in {State.SAFE, State.FAULT}:
        why = (
            f"the stage is in {stage.state}; a model can be changed in SAFE: `piezod disarm` first"
        )
    if why:
        return Answer(False, why)
    index = axes[0]
    try:
        stage.replace_axis(index, request.model)
    except PiezodError as error:
        return Answer(False, str(error))
    if request.zero_um is not None:
        stage.zero.set_um(index, request.zero_um)
    return Answer(True)


HANDLERS: Final[Mapping[type[requests.Request], Callable[[Stage, Any, int], Answer]]] = {
    requests.Arm: _arm,
    requests.Disarm: _disarm,
    requests.SelectMode: _select,
    requests.Goto: _goto,
    requests.Path: _path,
    requests.Wave: _wave,
    requests.Stream: _stream,
    requests.Follow: _follow,
    requests.Condition: condition,
    requests.Identify: identify,
    requests.Play: play,
    requests.Scan: scan,
    requests.Zero: _zero,
    requests.AdoptModel: _adopt,
    requests.Hold: _hold,
    requests.Resume: _resume,
    requests.Stop: _stop,
    requests.Reset: _reset,
    requests.Estop: _estop,
    requests.Shutdown: _shut_down,
}
"""Handler of each kind of request."""
