"""Reads DBC files by the cantools library."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from piezod_drivers.can_bus.dbc.codec import DbcMessage, DbcSignal
from piezod_drivers.can_bus.frame import MAX_DATA_BYTES

_UNITS: Final = {"um": "µm", "\u03bcm": "µm", "\u00c2\u00b5m": "µm"}
"""Spellings of micrometre in DBC files: without µ, with a Greek µ, in a wrong encoding."""


class DatabaseError(Exception):
    """Raised if a DBC file cannot be used; the text has the reason and the remedy."""


@lru_cache(maxsize=4)
def load(path: Path) -> Mapping[str, DbcMessage]:
    """Return the usable messages of a DBC file by name.

    CAN FD messages are left out, and signals that are multiplexed or floating point numbers.

    Raises:
        DatabaseError: If the file cannot be read, or cantools is not installed.
    """
    try:
        import cantools  # noqa: PLC0415 - only needed to read a DBC file
    except ImportError as error:
        what = f"the cantools library, which reads DBC files, is missing ({error})"
        raise DatabaseError(f'{what}: pip install "piezod[can]"') from error
    try:
        database = cantools.database.load_file(path)
    except Exception as error:
        # The parser raises errors of its own, and other errors for files that are not text.
        raise DatabaseError(f"{path} cannot be read: {error}") from error
    messages = getattr(database, "messages", [])
    return {one.name: _message(one) for one in messages if one.length <= MAX_DATA_BYTES}


def _message(one: Any) -> DbcMessage:  # cantools' messages
    signals = {
        signal.name: _signal(signal)
        for signal in one.signals
        if not (signal.is_float or signal.is_multiplexer or signal.multiplexer_ids)
    }
    return DbcMessage(one.name, one.frame_id, one.length, one.is_extended_frame, signals)


def _signal(one: Any) -> DbcSignal:  # cantools' signals
    return DbcSignal(
        one.name,
        one.start,
        one.length,
        one.byte_order == "big_endian",
        one.is_signed,
        float(one.scale),
        float(one.offset),
        None if one.minimum is None else float(one.minimum),
        None if one.maximum is None else float(one.maximum),
        _UNITS.get(one.unit or "", one.unit or ""),
    )
