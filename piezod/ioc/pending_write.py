"""Lets a write with completion fail, over CA and PVA.

EPICS keeps the request of the client in the record until it is complete, and tells the client its
status then. The structure is `processNotify` of `dbNotify.h` of EPICS 7.
"""

import ctypes
from typing import Any, Final

from epicscorelibs.ioc import dbCore
from softioc import imports

from piezod.ioc.record_type import Address

_ERROR: Final = 2
"""`notifyError`."""
_ADDRESS_BYTES: Final = 256
"""More than `dbAddr` has."""
_POINTER = ctypes.c_void_p


class _Notify(ctypes.Structure):
    _fields_ = (
        ("next", _POINTER),
        ("previous", _POINTER),
        ("is_listed", ctypes.c_int),
        ("private", _POINTER),
        ("status", ctypes.c_int),
        ("was_processed", ctypes.c_int),
    )


_common: Final[dict[str, Any]] = imports.get_field_offsets("ai")
_OFFSET: Final[int] = _common["PPN"][0]  # the same in records of all types
for _name in ("dbScanLock", "dbScanUnlock"):
    getattr(dbCore, _name).argtypes = (_POINTER,)


def address_of(name: str) -> int:
    """Return the address of a record."""
    place = ctypes.create_string_buffer(_ADDRESS_BYTES)
    if dbCore.dbNameToAddr(name.encode(), place):
        raise AssertionError(name)
    return Address.from_buffer(place).record or 0


def pending_write(record: int) -> int:
    """Return the address of the write that the record carries out; 0 if there is none.

    Args:
        record: Address of the record, which is locked.
    """
    address = _POINTER.from_address(record + _OFFSET).value or 0
    # A write that waits for its turn is not processed yet.
    return address if address and _Notify.from_address(address).was_processed else 0


def fail_write(record: int) -> None:
    """Let the write that the record carries out end with an error."""
    dbCore.dbScanLock(record)
    if address := pending_write(record):
        _Notify.from_address(address).status = _ERROR
    dbCore.dbScanUnlock(record)
