"""The faults of `docs/faults.md` that the drivers for PI controllers detect."""

from typing import Final

from piezod.config.faults import Fault

SEES: Final = frozenset(
    {
        *(Fault.B1, Fault.B2, Fault.B3, Fault.B5, Fault.B6, Fault.B7, Fault.B10, Fault.B14),
        *(Fault.A1, Fault.A2, Fault.A3, Fault.A8, Fault.A12, Fault.A13, Fault.S10),
    }
)
"""For both generations: faults of the line, missing replies, reported errors, and the voltage."""
