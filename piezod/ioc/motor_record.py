"""The records of the type `motor`: their fields, and what happens when a client writes one."""

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

from epicscorelibs.ioc import dbCore
from softioc import imports

from piezod.ioc.motor_fields import (
    DOUBLE,
    FIELDS,
    LONG,
    MENU,
    SHORT,
    STRING,
    STRING_BYTES,
    TYPE_NAME,
    derived,
)
from piezod.ioc.pending_write import fail_write, pending_write
from piezod.ioc.readings import DOWN, OK, Alarm
from piezod.ioc.record_type import register

_VALUE, _LOG = 1, 2
"""Masks of events."""
_REFUSED: Final = 1
_SETTINGS: Final = ("VAL", "TWV", "VELO")
_TARGETS: Final = ("VAL", "TWF", "TWR")
"""Fields whose writes begin a movement, and fail if it fails."""
_TYPES: Final[dict[str, Any]] = {
    DOUBLE: ctypes.c_double,
    SHORT: ctypes.c_int16,
    LONG: ctypes.c_int32,
    MENU: ctypes.c_uint16,
    STRING: ctypes.c_char * STRING_BYTES,
}
_FIELDS: Final = {field.name: field for field in FIELDS}
_POINTER = ctypes.c_void_p

for _name in ("recGblFwdLink", "recGblGetTimeStamp", "dbNotifyCompletion"):
    getattr(dbCore, _name).argtypes = (_POINTER,)
dbCore.recGblResetAlarms.argtypes = (_POINTER,)
dbCore.recGblSetSevr.argtypes = (_POINTER, ctypes.c_int, ctypes.c_int)
dbCore.db_post_events.argtypes = (_POINTER, _POINTER, ctypes.c_uint)

Put = Callable[[str, float], bool]
"""Gets the field and the value that a client writes; returns whether it is accepted. It is called
in a thread of EPICS, and must not wait."""


class MotorRecord:
    """One record.

    Args:
        name: Name of the record.
        put: Gets what clients write.
    """

    def __init__(self, name: str, put: Put, unit: str = "um") -> None:
        self.name, self._put, self.unit = name, put, unit
        self._values: dict[str, float | str] = {field.name: field.start for field in FIELDS}
        self._values["EGU"] = unit
        self._alarm: Alarm = DOWN
        self._accepted = True
        self._moving_write = 0
        """Write with completion that waits for the end of the movement; 0 if there is none."""
        self._written = ""
        self._target_write = 0
        """Write with completion that has begun the movement; 0 if there is none."""
        self._address = 0
        self._offsets: dict[str, int] = {}
        _BY_NAME[name] = self

    def get(self, field: str) -> float:
        """Return the value of a field that is a number."""
        return float(self._values[field])

    def set(self, alarm: Alarm | None = None, *, failed: bool = False, **values: float) -> None:
        """Change fields and alarm, and tell the clients that monitor them.

        Args:
            alarm: New alarm; None to keep the present one.
            failed: Whether the movement that ends with these values has failed.
            **values: New values of fields.
        """
        with self.locked():
            changed = self._change(values)
            if not changed and alarm in {None, self._alarm}:
                return
            self._alarm = alarm or self._alarm
            self._show(changed)
            if values.get("DMOV") and "DMOV" in changed:
                if failed and self._target_write == pending_write(self._address):
                    fail_write(self._address)
                self._complete()

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the record; a thread may lock it several times."""
        dbCore.dbScanLock(self._address)
        try:
            yield
        finally:
            dbCore.dbScanUnlock(self._address)

    def attach(self, address: int) -> None:
        """Take the memory of the record, and write the first values into it."""
        self._address = address
        places = imports.get_field_offsets(TYPE_NAME)
        self._offsets = {name: offset for name, (offset, _, _) in places.items()}
        for name, value in self._values.items():
            self._write(name, value)

    def take(self, name: str) -> None:
        """Take what a client has written to a field; put the old value back if it is refused."""
        if not pending_write(self._address):  # its client may have given it up
            self._moving_write = self._target_write = 0
        value = float(self._stored(name).value)
        self._written = name
        # Nothing derives from a value before it is accepted; a button is released at once.
        self._write(name, self._values[name])
        self._accepted = self._put(name, value)
        settled = {name: value} if self._accepted and name in _SETTINGS else {}
        self._show([name, *self._change(settled)])

    def process(self) -> bool:
        """End a write if no movement goes on; else the end of the movement ends it.

        Returns:
            Whether the write was accepted.
        """
        accepted, self._accepted = self._accepted, True
        write = pending_write(self._address)
        if accepted:
            self._moving_write = write
            if self._written in _TARGETS:
                self._target_write = write
            if self._values["DMOV"]:
                self._complete()
        elif write != self._moving_write:
            fail_write(self._address)
            dbCore.dbNotifyCompletion(self._address)
        return accepted

    def _complete(self) -> None:
        """End the write that waits for the end of the movement."""
        self._moving_write = self._target_write = 0
        dbCore.recGblFwdLink(self._address)

    def _change(self, values: Mapping[str, float]) -> list[str]:
        """Write fields, and those that follow from them; return the names of those that changed."""
        values = {**values, **derived({**self._values, **values})}
        changed = [name for name, value in values.items() if self._values[name] != value]
        for name in changed:
            self._write(name, values[name])
        return changed

    def _show(self, changed: Sequence[str]) -> None:
        """Set the alarm, and tell the clients that monitor fields."""
        dbCore.recGblGetTimeStamp(self._address)
        if self._alarm != OK:
            dbCore.recGblSetSevr(self._address, self._alarm.status, self._alarm.severity)
        alarmed = dbCore.recGblResetAlarms(self._address)
        posted = {*changed, "VAL", "RBV"} if alarmed else set(changed)
        for name in sorted(posted, key="DMOV".__eq__):  # last: clients look at the others then
            place = self._address + self._offsets[name]
            dbCore.db_post_events(self._address, place, alarmed | _VALUE | _LOG)

    def _write(self, name: str, value: float | str) -> None:
        """Write a field into the memory of the record."""
        self._values[name] = value
        self._stored(name).value = value.encode() if isinstance(value, str) else value

    def _stored(self, name: str) -> Any:
        """Return a field in the memory of the record."""
        return _TYPES[_FIELDS[name].kind].from_address(self._address + self._offsets[name])


_BY_NAME: Final[dict[str, MotorRecord]] = {}
_BY_ADDRESS: Final[dict[int, MotorRecord]] = {}


def register_motors() -> None:
    """Make the record type known to EPICS; before the records are loaded."""
    register(
        {
            "init_record": _init_record,
            "process": _process,
            "special": _special,
            "get_units": _get_units,
            "get_precision": _get_precision,
            "get_graphic_double": _get_limits,
            "get_control_double": _get_limits,
        }
    )


def _init_record(address: int, after: int) -> int:
    """Called twice for each record; its name is at the begin of its memory."""
    if not after:
        record = _BY_ADDRESS[address] = _BY_NAME[ctypes.string_at(address).decode()]
        record.attach(address)
    return 0


def _process(address: int) -> int:
    """Called after a write to a field that clients write, and after a write to PROC."""
    return 0 if _BY_ADDRESS[address].process() else _REFUSED


def _special(address: Any, after: int) -> int:
    """Called before and after a client has written a field; `_process` refuses the write.

    An error here would end the process if a write over PVA waits for completion: pvxs 1.5 lets it
    leave a callback of EPICS as an exception of C++.
    """
    if after:
        record, name = _target(address)
        record.take(name)
    return 0


def _get_units(address: Any, units: int) -> int:
    record, name = _target(address)
    unit = _FIELDS[name].unit
    if unit.startswith("um"):
        unit = record.unit + unit.removeprefix("um")
    text = unit.encode() + b"\0"
    ctypes.memmove(units, text, len(text))
    return 0


def _get_precision(address: Any, digits: Any) -> int:
    digits[0] = int(_target(address)[0].get("PREC"))
    return 0


def _get_limits(address: Any, limits: Any) -> int:
    """Return upper and lower limit of a field."""
    record, name = _target(address)
    if name in {"VELO", "VMAX"}:
        limits[0][0], limits[0][1] = record.get("VMAX"), 0.0
    else:
        limits[0][0], limits[0][1] = record.get("HLM"), record.get("LLM")
    return 0


def _target(address: Any) -> tuple[MotorRecord, str]:
    """Return the record and the name of the field of an address."""
    return _BY_ADDRESS[address[0].record], address[0].field[0].name.decode()
