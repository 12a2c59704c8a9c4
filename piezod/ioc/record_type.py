"""The record type `motor`, in the memory of EPICS.

EPICS base has no such type, and names with a dot cannot be names of records: clients read the part
behind the dot as the name of a field. A type is a definition (DBD), a function that places the
fields in a record, and a table of functions that EPICS calls. Here these functions are Python's,
through ctypes. The structures are those of `dbBase.h`, `dbAddr.h` and `recSup.h` of EPICS 7.
"""

import ctypes
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Final

from epicscorelibs import path
from epicscorelibs.ioc import dbCore, pdbbase
from softioc import imports

from piezod.ioc.motor_fields import FIELDS, SIZES, TYPE_NAME, definition

_SHORT, _INT, _LONG = ctypes.c_short, ctypes.c_int, ctypes.c_long
_TEXT, _POINTER = ctypes.c_char_p, ctypes.c_void_p


class FieldDescription(ctypes.Structure):
    """`dbFldDes`: what EPICS knows of a field."""

    _fields_ = (
        ("prompt", _TEXT),
        ("name", _TEXT),
        ("extra", _TEXT),
        ("record_type", _POINTER),
        ("index", _SHORT),
        ("special", _SHORT),
        ("field_type", _INT),
        ("flags", ctypes.c_uint),
        ("base", _INT),
        ("prompt_group", _SHORT),
        ("interest", _SHORT),
        ("as_level", _INT),
        ("initial", _TEXT),
        ("private", _POINTER),
        ("size", _SHORT),
        ("offset", ctypes.c_ushort),
    )


class _ListNode(ctypes.Structure):
    _fields_ = (("next", _POINTER), ("previous", _POINTER))


class _List(ctypes.Structure):
    _fields_ = (("node", _ListNode), ("count", _INT))


class _TypeDescription(ctypes.Structure):
    """`dbRecordType`."""

    _fields_ = (
        ("node", _ListNode),
        ("lists", _List * 4),
        ("name", _TEXT),
        ("field_count", _SHORT),
        ("other_counts", _SHORT * 3),
        ("links", _POINTER),
        ("sorted_names", _POINTER),
        ("sorted_indices", _POINTER),
        ("value_field", _POINTER),
        ("value_index", _SHORT),
        ("fields", ctypes.POINTER(ctypes.POINTER(FieldDescription))),
        ("functions", _POINTER),
        ("record_size", _INT),
    )


class Address(ctypes.Structure):
    """The first members of `dbAddr`: a field of a record."""

    _fields_ = (
        ("record", _POINTER),
        ("memory", _POINTER),
        ("field", ctypes.POINTER(FieldDescription)),
    )


_AddressPointer = ctypes.POINTER(Address)
_PairPointer = ctypes.POINTER(ctypes.c_double * 2)
_FUNCTIONS: Final[tuple[tuple[str, Any], ...]] = (
    ("report", _POINTER),
    ("init", _POINTER),
    ("init_record", ctypes.CFUNCTYPE(_LONG, _POINTER, _INT)),
    ("process", ctypes.CFUNCTYPE(_LONG, _POINTER)),
    ("special", ctypes.CFUNCTYPE(_LONG, _AddressPointer, _INT)),
    ("get_value", _POINTER),
    ("cvt_dbaddr", _POINTER),
    ("get_array_info", _POINTER),
    ("put_array_info", _POINTER),
    ("get_units", ctypes.CFUNCTYPE(_LONG, _AddressPointer, _POINTER)),
    ("get_precision", ctypes.CFUNCTYPE(_LONG, _AddressPointer, ctypes.POINTER(_LONG))),
    ("get_enum_str", _POINTER),
    ("get_enum_strs", _POINTER),
    ("put_enum_str", _POINTER),
    ("get_graphic_double", ctypes.CFUNCTYPE(_LONG, _AddressPointer, _PairPointer)),
    ("get_control_double", ctypes.CFUNCTYPE(_LONG, _AddressPointer, _PairPointer)),
    ("get_alarm_double", _POINTER),
)


class _Functions(ctypes.Structure):
    """`rset`, the record support entry table; functions that are NULL do nothing."""

    _fields_ = (("number", _LONG), *_FUNCTIONS)


_PlaceFields = ctypes.CFUNCTYPE(_INT, ctypes.POINTER(_TypeDescription))


class _Location(ctypes.Structure):
    """`recordTypeLocation`."""

    _fields_ = (("functions", ctypes.POINTER(_Functions)), ("place_fields", _PlaceFields))


_kept: Final[list[object]] = []
"""What EPICS keeps pointers to, until the end of the process."""


def register(functions: Mapping[str, Callable[..., int]]) -> None:
    """Make the record type known to EPICS; once, before records are loaded.

    Args:
        functions: Functions of the record type, by their names in `recSup.h`. They are called in
            threads of EPICS while the record is locked, and return 0, or an error status.
    """
    kinds = dict(_FUNCTIONS)
    table = _Functions(number=len(_FUNCTIONS))
    for name, function in functions.items():
        setattr(table, name, kinds[name](function))
    location = _Location(ctypes.pointer(table), _PlaceFields(_place_fields))
    names = (_TEXT * 1)(TYPE_NAME.encode())
    _kept.extend((table, location, names))
    with NamedTemporaryFile("w", suffix=".dbd") as file:
        file.write(definition())
        file.flush()
        imports.dbLoadDatabase(file.name, str(Path(path.base_path) / "dbd"), None)
    dbCore.registerRecordTypes(pdbbase, 1, names, ctypes.byref(location))


def _place_fields(description: Any) -> int:
    """Set size and offset of each field: first those that all record types have, then ours."""
    common: dict[str, tuple[int, int, int]] = imports.get_field_offsets("ai")
    at = common["VAL"][0]  # the first field of `ai` after the common ones
    sizes = {field.name: SIZES[field.kind] for field in FIELDS}
    for i in range(description[0].field_count):
        field = description[0].fields[i][0]
        name = field.name.decode()
        if name in sizes:
            field.size = sizes[name]
            alignment = min(field.size, ctypes.sizeof(ctypes.c_double))
            field.offset = at = -(-at // alignment) * alignment
            at += field.size
        else:
            field.offset, field.size, _ = common[name]
    alignment = ctypes.sizeof(ctypes.c_double)
    description[0].record_size = -(-at // alignment) * alignment
    return 0
