"""What a node of CiA 401 has in its object dictionary, and under which identifiers it speaks.

After CANopenNode's demo device and the manuals of WAGO, Turck and others, all public; not confirmed
on hardware. Numbers go over the bus with the lowest byte first.
"""

from typing import Final

PROFILE: Final = 401
"""The low word of 0x1000."""

DEVICE_TYPE: Final = 0x1000
ERROR_REGISTER: Final = 0x1001
SYNC_ID: Final = 0x1005
NAME: Final = 0x1008
SOFTWARE: Final = 0x100A
CONSUMER_HEARTBEAT: Final = 0x1016
PRODUCER_HEARTBEAT: Final = 0x1017
IDENTITY: Final = 0x1018
ERROR_BEHAVIOUR: Final = 0x1029
RPDO: Final = 0x1400
RPDO_MAPPING: Final = 0x1600
"""Of the first one; the others follow."""
TPDO: Final = 0x1800
TPDO_MAPPING: Final = 0x1A00
INPUT: Final = 0x6401
"""Sub-index n: what input n reads, 16 bits."""
OUTPUT: Final = 0x6411
"""Likewise, what output n is set to."""
ERROR_MODE: Final = 0x6443
"""Sub-index n: 1 where output n takes its error value when the host is lost, 0 where it holds."""
ERROR_VALUE: Final = 0x6444

# Identifiers; where nothing else is said, the node's number is added.
NMT: Final = 0x000
SYNC: Final = 0x080
"""The same for all."""
EMERGENCY: Final = 0x080
SDO_ANSWER: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700

DISABLED: Final = 1 << 31
"""In the identifier of a PDO: it is not used."""
EVERY_SYNC: Final = 1
AT_ONCE: Final = 255
"""Transmission types."""

BOOTED: Final = 0
STOPPED: Final = 4
OPERATIONAL: Final = 5
PREOPERATIONAL: Final = 127
"""What a heartbeat says."""
START: Final = 1
STOP: Final = 2
PREPARE: Final = 128
RESET: Final = 129
RESET_COMMUNICATION: Final = 130
"""What the network's master says."""

WORD_BITS: Final = 16
MOST_WORDS: Final = 4
"""In a PDO."""


def mapped(index: int, number: int) -> int:
    """Return the entry of a mapping for an object of 16 bits."""
    return index << 16 | number << 8 | WORD_BITS
