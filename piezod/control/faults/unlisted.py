"""Faults that the register never shows, and the gaps of others, with their reasons."""

from types import MappingProxyType
from typing import Final

from piezod.config.faults import Fault

NEVER_SHOWN: Final = MappingProxyType(
    {
        Fault.L9: "It is known before the first cycle and does not change: `piezod status` names "
        "each step that failed. `strict_rt` refuses to arm.",
        Fault.D3: "It cannot occur: if a learning step gives a model that cannot be inverted, the "
        "slopes of stops are raised to their smallest value, and a surface is corrected or the "
        "step taken back. A stage that follows worse with it has D1.",
        Fault.D4: "It is part of normal work: nothing is learned, and `piezod watch` and "
        "recordings show the gate of the axis (quiet).",
        Fault.D7: "As D4: the gate names the reason (invalid, late, limited, skipped, spike, "
        "noisy, stuck, repeated).",
        Fault.D9: "It cannot occur: a change of mode fades from one drive to the other, and the "
        "guard limits each step to the slew rate.",
    }
)
"""Why the register never has these faults. A reaction to them exists, and has its proofs."""

GAPS: Final = MappingProxyType(
    {
        Fault.S10: "Another calibration in the same device is not detected: no driver reads "
        "a checksum of it. Zero the sensor, and identify again, after a calibration.",
        Fault.A2: "A driver of a message bus or a library cannot see a part of a write: it is "
        "A1, A3 or B9 then.",
        Fault.B14: "It is detected when the port is opened. While the port is open, a program of "
        "root, or one that had the port before, is not seen: what it sends shows as B3, B4 or B5.",
        Fault.L8: "Only page faults of the loop are counted. The size of the process is not "
        "looked at: the loop locks its memory at the start and needs no more.",
    }
)
"""What is not detected of faults that the register has."""
