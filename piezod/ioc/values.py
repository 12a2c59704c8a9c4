"""What the records show, from telemetry, status and recordings of a stage."""

from collections import deque
from collections.abc import Mapping
from math import nan
from typing import Any, Final

from piezod.config.states import State
from piezod.ioc.readings import FAULTY, OK, UNKNOWN, WARNING, Alarm, Reading
from piezod.ioc.table import FAULT_GROUPS, HISTORY, LONGEST_TEXT, LONGEST_WORD, STATES, recorded
from piezod.messages.answers import AXIS, STAGE, AxisStatus, Fault, Holder, Status
from piezod.messages.shown import NEEDED, ShownField
from piezod.messages.stores import Recordings
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry

HISTORY_S: Final = 1.0
_ALARMS_OF_STATES: Final = {
    State.FAULT: FAULTY,
    State.ESTOP: FAULTY,
    State.BLIND: FAULTY,
    State.HOLD: WARNING,
    State.RAMP: WARNING,
    State.STOPPING: WARNING,
}
_ALARMS: Final = {"error": FAULTY, "warning": WARNING, "info": OK}

Readings = Mapping[str, Reading]
"""Readings by the names of the table."""


def alarm_of_state(state: str) -> Alarm:
    """Return the alarm of a state; of one that this version does not know, that of a fault."""
    return _ALARMS_OF_STATES.get(State(state), OK) if state in STATES else FAULTY


def of_interval(interval: Telemetry) -> Readings:
    """Return the readings of the stage that an interval of telemetry has."""
    return _shown(interval, STAGE, live=True)


def of_axis(axis: AxisTelemetry | AxisStatus, *, has_sensor: bool) -> Readings:
    """Return the readings of an axis that only its telemetry, or only its status, has."""
    readings = _shown(axis, AXIS, live=isinstance(axis, AxisTelemetry))
    position = AXIS["position_um"].shown.record
    if position in readings and not has_sensor:
        readings[position] = readings[position]._replace(alarm=OK)
    return readings


def _shown(message: object, fields: Mapping[str, ShownField], *, live: bool) -> dict[str, Reading]:
    """Return the readings of the fields of a message that have a record.

    Args:
        message: A message.
        fields: The fields of its kind.
        live: Whether it is telemetry; the status leaves to it what both have.
    """
    return {
        field.shown.record: _reading(field, getattr(message, field.name))
        for field in recorded(fields)
        if field.live is live
    }


def _reading(field: ShownField, value: Any) -> Reading:
    value = value.last if isinstance(value, Range) else value
    if choices := field.choices:
        alarm = alarm_of_state(value) if choices == STATES else OK
        return Reading(choices.index(value) if value in choices else 0, alarm)
    if value is None:
        return Reading(nan, UNKNOWN if field.has(NEEDED) else OK)
    if isinstance(value, str | tuple):
        return Reading(text(field.text(value), LONGEST_WORD))
    return Reading(value)


def of_status(status: Status) -> Readings:
    """Return the readings of faults and lease, and of what telemetry does not have."""
    faults = sorted(status.faults, key=_seriousness)
    worst = f"{faults[0].id} {faults[0].name}: {faults[0].remedy}" if faults else ""
    groups = {
        f"FAULT:{name}": _ids([each for each in faults if each.id.startswith(letter)])
        for name, letter in FAULT_GROUPS.items()
    }
    holder = status.lease.holder if status.lease else Holder()
    return {
        **_shown(status, STAGE, live=False),
        "FAULTS": _ids(faults),
        "FAULT:COUNT": Reading(len(faults), _worst(faults)),
        "FAULT:TEXT": Reading(text(worst), _worst(faults)),
        **groups,
        "LEASE:HOLDER": Reading(text(f"{holder.user} {holder.client}".strip(), LONGEST_WORD)),
    }


def of_recordings(recordings: Recordings) -> Readings:
    """Return the readings of the recording that runs."""
    running = recordings.running
    lost = (running.lost or 0) if running else 0
    return {
        "REC:RUNNING": Reading(running is not None),
        "REC:NAME": Reading(text(running.name if running else "")),
        "REC:RECORDS": Reading((running.records or 0) if running else 0),
        "REC:LOST": Reading(lost, WARNING if lost else OK),
    }


class History:
    """The last second of an axis, at the rate of the telemetry."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float, float, float]] = deque(maxlen=HISTORY)

    def feed(self, t_s: float, axis: AxisTelemetry) -> None:
        """Take the newest interval."""
        values = (_last(axis.position_um), _last(axis.command_um), _last(axis.drive_v))
        self._points.append((t_s, *values))
        while self._points[0][0] <= t_s - HISTORY_S:
            self._points.popleft()

    def readings(self) -> Readings:
        """Return the readings of the history, oldest point first."""
        times, *others = zip(*self._points, strict=True) if self._points else ((), (), (), ())
        before_s = [t_s - times[-1] for t_s in times]
        names = ("HIST:POS", "HIST:CMD", "HIST:DRIVE")
        arrays = {name: Reading(list(array)) for name, array in zip(names, others, strict=True)}
        return {"HIST:TIME": Reading(before_s), **arrays}


def _last(range_: Range) -> float:
    return nan if range_.last is None else range_.last


def _seriousness(fault: Fault) -> tuple[int, bool]:
    """Return a key that sorts the most serious fault first, a present one before a latched one."""
    return -_ALARMS.get(fault.severity, FAULTY).severity, not fault.present


def _worst(faults: list[Fault]) -> Alarm:
    """Return the alarm of the most serious of some faults."""
    alarms = [_ALARMS.get(fault.severity, FAULTY) for fault in faults]
    return max(alarms, key=lambda alarm: alarm.severity, default=OK)


def _ids(faults: list[Fault]) -> Reading:
    return Reading(text(" ".join(fault.id for fault in faults), LONGEST_WORD), _worst(faults))


def text(words: str, longest: int = LONGEST_TEXT - 1) -> str:
    """Return a text that fits a record: ASCII, with three dots where it is too long."""
    words = words.replace("µ", "u").encode("ascii", "replace").decode()
    return words if len(words) <= longest else f"{words[: longest - 3]}..."
