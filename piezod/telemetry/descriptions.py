"""What the fields of a record mean, for files that explain themselves."""

from typing import Final

from piezod.config.faults import Fault
from piezod.messages.documents import attributes
from piezod.telemetry.record import AxisRecord, CycleHeader

_MASK_BITS: Final = 64


def descriptions() -> dict[str, str]:
    """Return the description of each field of a record, as its declaration has it."""
    own = {"seq": "Number of the record since the start of the loop; a jump is a lost record."}
    return {**own, **attributes(CycleHeader), **attributes(AxisRecord)}


def mask_bits() -> dict[str, tuple[str, ...]]:
    """Return the fields that contain a bit mask of faults, each with the faults in order."""
    faults = tuple(Fault)
    halves = {"lo": faults[:_MASK_BITS], "hi": faults[_MASK_BITS:]}
    return {
        f"{mask}_{half}": bits for mask in ("present", "latched") for half, bits in halves.items()
    }
