"""Carries out the requests that move user axes, and watches their movements. Real-time safe."""

from collections.abc import Iterable, Mapping, Sequence

from piezod.config.frequencies import too_fast
from piezod.config.waveforms.waveform import Waveform
from piezod.control.reference.motion import Motion
from piezod.control.stage.answer import Answer
from piezod.control.stage.common_start import start_ns, start_refusal
from piezod.control.stage.running import start_running
from piezod.control.stage.stage import Stage
from piezod.control.stage.states import HoldCause
from piezod.control.stage.user_axes import UserAxes
from piezod.messages import requests
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S


def movers(stage: Stage, names: Iterable[str | None]) -> tuple[UserAxes | None, str]:
    """Return the user axes if a movement names them; or why it may not move what it names."""
    users, asked = stage.users, set(names)
    if users is None:
        return None, ""
    actuators = {axis.name for axis in users.actuators}
    if moved := sorted(name for name in asked if name in actuators):
        which = f"axis {', '.join(moved)} is moved by the user axes {', '.join(users.names)}"
        return None, f"{which}: move those"
    if None in asked and len(users.names) > 1:
        return None, f"axis must be one of {', '.join(users.names)}"
    of_users = asked & {*users.names, None}
    if of_users and of_users != asked:
        return None, "user axes and other axes do not move in one request: send two"
    return (users if of_users else None), ""


def path(
    stage: Stage,
    users: UserAxes,
    points: Sequence[Mapping[str, float]],
    speed_per_s: float | None,
    t_ns: int,
) -> Answer:
    """Move through points on straight lines; `speed_per_s` is the highest speed of each axis."""
    numbered = [{users.names.index(name): at for name, at in each.items()} for each in points]
    for i in sorted({i for point in numbered for i in point}):
        limits = users.limits(i)
        unit, named = users.units[i], [point[i] for point in numbered if i in point]
        refusals = (limits.refusal(at, at, unit) for at in named)
        why = next(filter(None, refusals), "")
        if not why and speed_per_s is not None and speed_per_s > limits.speed_um_per_s:
            why = (
                f"speed out of range (got {speed_per_s:g} {unit}/s), allowed: at most "
                f"{limits.speed_um_per_s:g} {unit}/s, speed_per_s of the axis"
            )
        if why:
            return Answer(False, f"axis {users.names[i]}: {why}")
    return _start(stage, users, users.line(numbered, speed_per_s, t_ns), t_ns)


def wave(stage: Stage, users: UserAxes, request: requests.Wave, t_ns: int) -> Answer:
    """Follow waveforms, which begin together."""
    waveforms: dict[int, Waveform] = {}
    for name, config in request.command_um.items():
        i = users.names.index(name)
        waveform = waveforms[i] = config.built(request.duration_s)
        why = too_fast(waveform.highest_hz, NS_PER_S / stage.period_ns)
        why = why or users.limits(i).refusal(waveform.low, waveform.high, users.units[i])
        if why:
            return Answer(False, f"axis {name}: {why}")
    if why := start_refusal(request.start_s, t_ns, users.lead_in_s(waveforms, t_ns)):
        return Answer(False, why)
    begins_ns = start_ns(request.start_s)
    motions = users.waves(waveforms, request.duration_s, t_ns, begins_ns)
    return _start(stage, users, motions, t_ns)


def stream(stage: Stage, users: UserAxes, names: Sequence[str], t_ns: int) -> Answer:
    """Follow the setpoints of a stream."""
    if why := start_running(stage, t_ns):
        return Answer(False, why)
    axes = [users.names.index(name) for name in names]
    users.follow_stream(axes, t_ns)
    return _answer(users, axes, t_ns)


def _start(stage: Stage, users: UserAxes, motions: dict[int, Motion], t_ns: int) -> Answer:
    why = users.refusal(motions, t_ns) or start_running(stage, t_ns)
    if why:
        return Answer(False, why)
    users.move(motions, t_ns)
    return _answer(users, list(motions), t_ns)


def _answer(users: UserAxes, axes: Sequence[int], t_ns: int) -> Answer:
    motion, duration_s = users.started(axes, t_ns)
    return Answer(True, motion=motion, duration_s=duration_s)


def run_users(stage: Stage, users: UserAxes, t_ns: int, quiet_ns: int) -> None:
    """Hold if a stream of setpoints has stopped; tell when a limit has stopped the user axes.

    Args:
        stage: The stage, in RUN.
        users: Its user axes.
        t_ns: Instant of the cycle, in ns.
        quiet_ns: A stream has stopped after this time without a setpoint, in ns.
    """
    if text := users.new_limit(t_ns):
        stage.note(StageEvent(t_ns, "warning", "limit", text))
    if users.streams and t_ns - users.commanded_ns > quiet_ns:
        text = f"no setpoint for {quiet_ns / 1e6:g} ms: the stream has stopped"
        stage.note(StageEvent(t_ns, "warning", "stream", text))
        stage.hold(HoldCause.REQUEST, t_ns)
