"""The records of the type `motor`: their fields, and what happens when a client writes one."""

import ctypes
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from epicscorelibs.ioc import Com, dbCore
from softioc import imports

from piezod.ioc.motor_fields import DOUBLE, FIELDS, MENU, SHORT, STRING, STRING_BYTES, TYPE_NAME
from piezod.ioc.readings import DOWN, OK, Alarm
from piezod.ioc.record_type import register

_VALUE, _LOG = 1, 2
"""Masks of events."""
_REFUSED: Final = 1
_CA_THREAD: Final = b"CAS-client"
"""Name of the threads that serve Channel Access."""
_SETTINGS: Final = ("VAL", "TWV", "VELO")
_UNITS: Final = {"VELO": b"um/s", "VMAX": b"um/s", "ACCL": b"s"}
_MIRRORED: Final = {"VAL": "DVAL", "RBV": "DRBV", "HLM": "DHLM", "LLM": "DLLM"}
_TYPES: Final[dict[str, Any]] = {
    DOUBLE: ctypes.c_double,
    SHORT: ctypes.c_int16,
    MENU: ctypes.c_uint16,
    STRING: ctypes.c_char * STRING_BYTES,
}
_FIELDS: Final = {field.name: field for field in FIELDS}
_POINTER = ctypes.c_void_p

Com.epicsThreadGetNameSelf.restype = ctypes.c_char_p
for _name in ("dbScanLock", "dbScanUnlock", "recGblFwdLink", "recGblGetTimeStamp"):
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

    def __init__(self, name: str, put: Put) -> None:
        self.name, self._put = name, put
        self._values: dict[str, float | str] = {field.name: field.start for field in FIELDS}
        self._alarm: Alarm = DOWN
        self._accepted = True
        self._address = 0
        self._offsets: dict[str, int] = {}
        _BY_NAME[name] = self

    def get(self, field: str) -> float:
        """Return the value of a field that is a number."""
        return float(self._values[field])

    def set(self, alarm: Alarm | None = None, **values: float) -> None:
        """Change fields and alarm, and tell the clients that monitor them.

        Args:
            alarm: New alarm; None to keep the present one.
            **values: New values of fields.
        """
        with self.locked():
            changed = [name for name, value in values.items() if self._values[name] != value]
            if not changed and alarm in {None, self._alarm}:
                return
            self._alarm = alarm or self._alarm
            for name in changed:
                self._write(name, values[name])
            self._show(changed)
            if values.get("DMOV") and "DMOV" in changed:
                dbCore.recGblFwdLink(self._address)

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
        for field in FIELDS:
            self._write(field.name, field.start)

    def take(self, name: str) -> bool:
        """Take what a client has written to a field; put the old value back if it is refused."""
        self._accepted = True
        before, value = self._values[name], self._stored(name).value
        if _FIELDS[name].put:
            self._write(name, value if name in _SETTINGS else 0)  # a button is released at once
            if self._put(name, float(value)):
                return True
        self._write(name, before)
        self._accepted = False
        return False

    def process(self) -> bool:
        """Show a write, and end it if no movement goes on; else the end of the movement ends it.

        Returns:
            Whether the write was accepted.
        """
        accepted, self._accepted = self._accepted, True
        self._show(["VAL"])
        if self._values["DMOV"]:
            dbCore.recGblFwdLink(self._address)
        return accepted

    def _show(self, changed: Sequence[str]) -> None:
        """Set the alarm, and tell the clients that monitor fields."""
        dbCore.recGblGetTimeStamp(self._address)
        if self._alarm != OK:
            dbCore.recGblSetSevr(self._address, self._alarm.status, self._alarm.severity)
        alarmed = dbCore.recGblResetAlarms(self._address)
        posted = {*changed, *(_MIRRORED[name] for name in changed if name in _MIRRORED)}
        if alarmed:
            posted |= {"VAL", "RBV"}
        for name in sorted(posted, key="DMOV".__eq__):  # last: clients look at the others then
            place = self._address + self._offsets[name]
            dbCore.db_post_events(self._address, place, alarmed | _VALUE | _LOG)

    def _write(self, name: str, value: float | str) -> None:
        """Write a field, and the one that is always the same, into the memory of the record."""
        self._values[name] = value
        self._stored(name).value = value.encode() if isinstance(value, str) else value
        if name in _MIRRORED:
            self._stored(_MIRRORED[name]).value = value

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
    """Called before and after a client has written a field; an error refuses the write.

    Over PVA, `_process` reports the error. An error here would end the process if the write waits
    for completion: pvxs 1.5 lets it leave a callback of EPICS as an exception of C++.
    """
    record, name = _target(address)
    if after and not record.take(name) and Com.epicsThreadGetNameSelf() == _CA_THREAD:
        return _REFUSED
    return 0


def _get_units(address: Any, units: int) -> int:
    text = _UNITS.get(_target(address)[1], b"um") + b"\0"
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
