"""The records in EPICS, made by softioc."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from tempfile import NamedTemporaryFile
from typing import Any, Final

from epicscorelibs.ioc import dbCore
from softioc import builder, softioc
from softioc.asyncio_dispatcher import AsyncioDispatcher

from piezod.ioc.motor_fields import TYPE_NAME
from piezod.ioc.motor_record import MotorRecord, register_motors
from piezod.ioc.pending_write import address_of, fail_write
from piezod.ioc.readings import OK, REFUSED, Alarm, Reading
from piezod.ioc.stage import IocStage
from piezod.ioc.table import Kind, Record

_READ_ONLY: Final = "ASG(DEFAULT) { RULE(1, READ) }\n"
"""Access security of an IOC that clients may only read."""
_CONTROL: Final = "ASG(DEFAULT) { RULE(0, WRITE) RULE(1, READ) }\n"
"""With control: clients write values, which are of level 0; other fields are of level 1."""
_ABLE: Final = (
    'record(bo, "{}_able") '
    '{{ field(DISP, "1") field(PINI, "YES") field(DOL, "0") field(ZNAM, "Enable") }}\n'
)
"""Record beside a motor record that motor screens read: always enabled, and never written."""
_BUILDERS: Final[Mapping[Kind, Callable[..., Any]]] = {
    Kind.NUMBER: builder.aIn,
    Kind.COUNT: builder.longIn,
    Kind.FLAG: builder.boolIn,
    Kind.CHOICE: builder.mbbIn,
    Kind.WORD: builder.stringIn,
    Kind.TEXT: builder.longStringIn,
    Kind.ARRAY: builder.WaveformIn,
    Kind.COMMAND: builder.boolOut,
    Kind.SET_NUMBER: builder.aOut,
    Kind.SET_COUNT: builder.longOut,
    Kind.SET_CHOICE: builder.mbbOut,
    Kind.SET_TEXT: builder.stringOut,
    Kind.SET_ARRAY: builder.WaveformOut,
}
_WITH_DIGITS: Final = (Kind.NUMBER, Kind.SET_NUMBER, Kind.ARRAY, Kind.SET_ARRAY)
_WITH_UNIT: Final = (*_WITH_DIGITS, Kind.COUNT, Kind.SET_COUNT)
Act = Callable[[Any], Awaitable[bool]]
Check = Callable[[Any, Any], bool]


class SoftIoc:
    """The records of all stages in this process, of which there is one IOC.

    Args:
        stages: The stages.
        control: Whether clients may write.
    """

    def __init__(self, stages: Mapping[str, IocStage], *, control: bool) -> None:
        self._records: dict[str, Any] = {}
        register_motors()
        self.motors: dict[str, dict[str, MotorRecord]] = {}
        for key, stage in stages.items():
            self._add(key, stage)
        builder.LoadDatabase()
        self._load_motors()
        _set_access(_CONTROL if control else _READ_ONLY)

    def start(self) -> None:
        """Serve the records; the event loop must run."""
        softioc.iocInit(AsyncioDispatcher(asyncio.get_running_loop()))

    def set(self, name: str, reading: Reading) -> None:
        """Show a value."""
        severity, status = reading.alarm
        self._records[name].set(reading.value, severity=severity, alarm=status)

    def set_alarm(self, name: str, alarm: Alarm) -> None:
        """Change the alarm of a record that keeps its value."""
        self._records[name].set_alarm(alarm.severity, alarm.status)

    def get(self, name: str) -> object:
        """Return the value of a record that clients write."""
        value: object = self._records[name].get()
        return value

    def _add(self, key: str, stage: IocStage) -> None:
        names = stage.names
        for full, record in names.all():
            axis = full.removeprefix(names.prefix).removesuffix(record.name).rstrip(":")
            act, check = self._acting(full, stage, axis, record), _checking(full, stage, record)
            self._records[full] = _make(full, record, act, check)
        self.motors[key] = {
            axis: MotorRecord(names.motor(axis), _putting(stage, axis), names.units.get(axis, "um"))
            for axis in names.axes
        }

    def _acting(self, full: str, stage: IocStage, axis: str, record: Record) -> Act:
        """Return the function that a write to a record calls."""

        async def act(value: Any) -> bool:
            if record.kind is Kind.COMMAND and not value:
                return True
            accepted = await stage.writes.do(axis, record.name, value)
            # Without processing, which would be another write; its end shows the alarm.
            shown = 0 if record.kind is Kind.COMMAND else value
            severity, status = OK if accepted else REFUSED
            self._records[full].set(shown, process=False, severity=severity, alarm=status)
            if not accepted:
                fail_write(address_of(full))
            return accepted

        return act

    def _load_motors(self) -> None:
        with NamedTemporaryFile("w", suffix=".db") as file:
            for motors in self.motors.values():
                for axis, motor in motors.items():
                    file.write(f'record({TYPE_NAME}, "{motor.name}") {{ field(DESC, "{axis}") }}\n')
                    file.write(_ABLE.format(motor.name))
            file.flush()
            softioc.dbLoadDatabase(file.name)


def _set_access(rules: str) -> None:
    # EPICS reads the file when the IOC starts, and again on request.
    with NamedTemporaryFile("w", suffix=".acf", delete=False) as file:
        file.write(rules)
    if dbCore.asSetFilename(file.name.encode()):
        raise AssertionError(file.name)


def _putting(stage: IocStage, axis: str) -> Callable[[str, float], bool]:
    return lambda field, value: stage.writes.put(axis, field, value)


def _checking(full: str, stage: IocStage, record: Record) -> Check:
    """Return the function that looks at what a client writes to a record."""

    def check(_: Any, value: Any) -> bool:
        if why := record.why_not(value):
            fail_write(address_of(full))
            stage.writes.refuse(full, why)
        return not why

    return check


def _make(name: str, record: Record, act: Act, check: Check) -> Any:
    """Make one record."""
    kind = record.kind
    fields: dict[str, Any] = {"DESC": record.what}
    if kind in _WITH_UNIT:
        fields["EGU"] = record.unit
    if kind in _WITH_DIGITS:
        fields["PREC"] = record.digits
    if kind is Kind.NUMBER:
        fields["UDFS"] = "NO_ALARM"  # what may be unknown at a time is NaN without an alarm
    if kind is Kind.FLAG:
        fields |= dict(zip(("ZNAM", "ONAM"), record.choices, strict=True))
    if kind is Kind.COMMAND:
        fields |= {"ZNAM": "idle", "ONAM": "do"}
    if record.length:  # one more, so that what is too long is seen and refused, and not cut off
        fields["length"] = record.length + (kind is Kind.SET_ARRAY)
    if kind in {Kind.ARRAY, Kind.SET_ARRAY}:
        fields["datatype"] = float
    elif kind.is_set:
        fields["initial_value"] = record.start
    if kind.is_set:
        fields["validate"] = check
    if kind.is_set and not record.saved:
        fields |= {"on_update": act, "blocking": True, "always_update": True}
    options = record.choices if kind in {Kind.CHOICE, Kind.SET_CHOICE} else ()
    return _BUILDERS[kind](name, *options, **fields)
