"""Object dictionary indices, identifiers and codes of a CiA 401 node.

The sources are CANopenNode's demo device and the manuals of WAGO, Turck and others, all public; not
confirmed on hardware. Numbers are sent with the lowest byte first.
"""

from typing import Final

PROFILE: Final = 401
"""Low word of object 0x1000."""

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
"""Index for RPDO 1; RPDO n is at index + n - 1. Likewise for the others."""
TPDO: Final = 0x1800
TPDO_MAPPING: Final = 0x1A00
INPUT: Final = 0x6401
"""Sub-index n: the code of input n, 16 bits."""
OUTPUT: Final = 0x6411
"""Sub-index n: the code that output n is set to, 16 bits."""
ERROR_MODE: Final = 0x6443
"""Sub-index n: 1 if output n takes its error value when the host is lost, 0 if it holds."""
ERROR_VALUE: Final = 0x6444

# Identifiers of frames. The node number is added to each, except to NMT and SYNC.
NMT: Final = 0x000
SYNC: Final = 0x080
"""The same for all nodes; EMERGENCY has a node number of at least 1 added."""
EMERGENCY: Final = 0x080
SDO_ANSWER: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700

DISABLED: Final = 1 << 31
"""Bit in the identifier of a PDO: the PDO is not used."""
EVERY_SYNC: Final = 1
AT_ONCE: Final = 255
"""Transmission types of a PDO: with every SYNC, or immediately."""
ON_ARRIVAL: Final = frozenset({254, AT_ONCE})
"""Types of a receive PDO that takes effect as soon as it arrives."""

BOOTED: Final = 0
STOPPED: Final = 4
OPERATIONAL: Final = 5
PREOPERATIONAL: Final = 127
"""States of a node, as its heartbeat reports them."""
START: Final = 1
STOP: Final = 2
PREPARE: Final = 128
RESET: Final = 129
RESET_COMMUNICATION: Final = 130
"""Commands of the network master (NMT)."""

WORD_BITS: Final = 16
WORD_BYTES: Final = WORD_BITS // 8
SEGMENT_BYTES: Final = 7
"""Number of data bytes of a segment of an SDO transfer."""
MOST_WORDS: Final = 4
"""Highest number of words in a PDO."""


def mapped(index: int, number: int) -> int:
    """Return the mapping entry of a 16-bit object."""
    return index << 16 | number << 8 | WORD_BITS


def predefined(node: int) -> list[int]:
    """Return every identifier that CiA 301 predefines for a node: EMCY, PDOs, SDOs, heartbeat."""
    return [base + node for base in range(0x080, 0x800, 0x080)]
