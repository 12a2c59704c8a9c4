"""Carries out the requests that drive voltages, in state IDENT. Real-time safe."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from piezod.config.frequencies import too_fast
from piezod.control.reference.programs import VoltageProgram, conditioning
from piezod.control.stage.answer import Answer
from piezod.control.stage.common_start import start_ns, start_refusal
from piezod.control.stage.named import axes_behind, axes_named, axis_names, without_sensor
from piezod.control.stage.stage import Stage
from piezod.control.stage.states import Event
from piezod.devices.played_axis import AxisTable
from piezod.devices.player import Comparison, EdgeWaits
from piezod.devices.scan_table import ScanTable
from piezod.messages import requests
from piezod.units import NS_PER_S, s_to_ns


def condition(stage: Stage, request: requests.Condition, t_ns: int) -> Answer:
    """Condition the named axes."""
    axes, why = axes_behind(stage, request.axis)
    return Answer(False, why) if why else condition_axes(stage, axes, t_ns)


def condition_axes(stage: Stage, axes: Iterable[int], t_ns: int) -> Answer:
    """Drive the swings of some axes."""
    programs = {
        i: conditioning(stage.axes[i].config.conditioning, stage.axes[i].config.limits)
        for i in axes
    }
    return _start_ident(stage, programs, t_ns, conditions=len(programs) == len(stage.axes))


def identify(stage: Stage, request: requests.Identify, t_ns: int) -> Answer:
    """Drive the voltages of an identification, within the limits of each axis."""
    drives: dict[int, VoltageProgram] = {}
    for name, config in request.drive_v.items():
        axes, why = axes_named(stage, name)
        why = why or without_sensor(stage, axes, "the identification")
        if why:
            return Answer(False, why)
        limits = stage.axes[axes[0]].config.limits
        waveform = config.built(request.duration_s)
        if why := too_fast(waveform.highest_hz, NS_PER_S / stage.period_ns):
            return Answer(False, f"axis {name}: drive_v {why}")
        if waveform.low < limits.drive_min_v or waveform.high > limits.drive_max_v:
            return Answer(
                False,
                f"axis {name}: drive_v out of range (got {waveform.low:g} to {waveform.high:g} V), "
                f"allowed range {limits.drive_min_v:g} to {limits.drive_max_v:g} V",
            )
        drives[axes[0]] = VoltageProgram(waveform.value, request.duration_s)
    return _start_ident(stage, drives, t_ns, conditions=False)


def play(stage: Stage, request: requests.Play, t_ns: int) -> Answer:
    """Let the device of an axis play a table, within the limits of the axis."""
    axes, why = axes_named(stage, request.axis)
    if not why and len(axes) > 1:
        why = f"axis must be one of {axis_names(stage)}: a table is for one axis"
    if why:
        return Answer(False, why)
    axis = stage.axes[axes[0]]
    lead_in_v, period_v = np.array(request.lead_in_v), np.array(request.drive_v)
    begins_ns = start_ns(request.start_s)
    table = AxisTable(s_to_ns(request.interval_s), lead_in_v, period_v, request.cycles, begins_ns)
    why = stage.play().refusal(axes[0], axis, table)
    ramp_s = abs(table.first_v - axis.law.in_force_v) / axis.config.safety.ramp_v_per_s
    why = why or start_refusal(request.start_s, t_ns, ramp_s)
    why = why or stage.go(Event.IDENTIFY, t_ns)
    if why:
        return Answer(False, why)
    steps = (table.first_v, table, axis.config.limits.rest_v)
    stage.drive([{axes[0]: step} for step in steps], t_ns, conditions=False)
    return Answer(True)


def scan(stage: Stage, request: requests.Scan, t_ns: int) -> Answer:
    """Let the device of some axes play a scan, within the limits of each axis."""
    places = []
    for name in request.axes:
        axes, why = axes_named(stage, name)
        if why:
            return Answer(False, why)
        places += axes
    table, of = scan_table(request), [stage.axes[i] for i in places]
    why = stage.play().scan_refusal(places, of, table) or stage.go(Event.IDENTIFY, t_ns)
    if why:
        return Answer(False, why)
    rest_v = [axis.config.limits.rest_v for axis in of]
    firsts = dict(zip(places, table.first_v.tolist(), strict=True))
    steps = (firsts, dict.fromkeys(places, table), dict(zip(places, rest_v, strict=True)))
    stage.drive(steps, t_ns, conditions=False)
    return Answer(True)


def scan_table(request: requests.Scan) -> ScanTable:
    """Return the table of a request. Real-time safe."""
    curves, edges = tuple(request.axes.values()), None
    if (wanted := request.edges) is not None:
        within_ns = s_to_ns(wanted.within_s)
        edges = EdgeWaits(wanted.first, wanted.every, wanted.times, within_ns)

    compared = None
    if (own := request.compared) is not None:
        compared = Comparison(own.line, 0, own.first_um, own.last_um, own.step_um)

    def columns(name: str) -> npt.NDArray[np.float64]:
        return np.stack([np.asarray(getattr(each, name), np.float64) for each in curves], axis=1)

    return ScanTable(
        axes=tuple(request.axes),
        interval_ns=s_to_ns(request.interval_s),
        lead_in_v=columns("lead_in_v"),
        line_v=columns("line_v"),
        offset_v=columns("offset_v"),
        scale=columns("scale"),
        blend=columns("blend"),
        pulses=np.array(request.pulses, np.uint8),
        framed=request.frame_pulse,
        frame_points=request.frame_points,
        pause=request.pause,
        edges=edges,
        tail=0 if wanted is None else wanted.tail,
        compared=compared,
    )


def _start_ident(
    stage: Stage, drives: dict[int, VoltageProgram], t_ns: int, *, conditions: bool
) -> Answer:
    """Drive voltages in IDENT, with ramps from and to the rest voltage around them."""
    refusal = stage.go(Event.IDENTIFY, t_ns)
    if refusal:
        return Answer(False, refusal)
    to_rest = {i: stage.axes[i].config.limits.rest_v for i in drives}
    stage.drive([to_rest, drives, to_rest], t_ns, conditions=conditions)
    return Answer(True)
