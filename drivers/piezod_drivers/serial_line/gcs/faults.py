"""The faults of `docs/faults.md` that the drivers for PI controllers detect."""

from typing import Final

from piezod.devices.interface import faults

SEES: Final = faults("A1 A2 A3 A8 A12 A13 B1 B2 B3 B5 B6 B7 B10 B14 S10")
"""For both generations: faults of the line, missing replies, reported errors, and the voltage."""
