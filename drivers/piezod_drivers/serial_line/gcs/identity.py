"""Who a PI controller says it is."""

from piezod.devices.interface import Identity

_UNKNOWN = "unknown"


def identity_of(told: bytes) -> Identity:
    """Read the reply to `*IDN?`: maker, model, serial number and firmware, apart by commas.

    What is missing is called unknown. PI writes in code page 1252; the maker may have commas of
    its own.
    """
    parts = [part.strip() for part in told.decode("cp1252", "replace").rsplit(",", 3)]
    if len(parts) < 4:
        model, *rest = (part for part in parts if part) if any(parts) else (_UNKNOWN,)
        parts = ["Physik Instrumente", model, *rest]
    parts += [""] * (4 - len(parts))
    return Identity(*(part or _UNKNOWN for part in parts))
