"""Single numbers in the shared memory, by name.

Each number is an aligned word of eight bytes with one writer. Reads and writes of a word are
atomic. `struct.pack_into` is not atomic, because it clears the bytes before it sets them.
"""

from enum import IntEnum
from typing import Final

from piezod.config.faults import Fault


class Word(IntEnum):
    """Index of each number in `SharedMap.words`; 0 until it is first written."""

    LOOP_PID = 0
    """Process id of the loop."""
    LOOP_BEAT_NS = 1
    """Instant of the newest cycle."""
    HEALTHY_CYCLES = 2
    """Cycles that ran on schedule to their end, in any state and with any fault."""
    LOOP_STATE = 3
    """Index of the state in `config.states.State`."""
    SKIPPED_CYCLES = 4
    """Number of skipped periods."""
    SUPERVISOR_PID = 5
    """Process id of the supervisor."""
    SUPERVISOR_BEAT_NS = 6
    """Instant of the last sign of life of the supervisor."""
    NEWEST_RECORD = 7
    """Sequence number of the newest record in the ring; the first is 1."""
    NEWEST_EVENT = 8
    """Sequence number of the newest event; the first is 1."""
    URGENT_POSTED = 9
    """Requests posted to the urgent lane."""
    URGENT_TAKEN = 10
    """Requests taken from the urgent lane."""
    REQUESTS_POSTED = 11
    """Requests posted to the ordinary lane."""
    REQUESTS_TAKEN = 12
    """Requests taken from the ordinary lane."""
    REQUESTS_EXPIRED = 13
    """Requests that expired before the loop took them."""
    REPORT_BYTES = 14
    """Length of the report on the real-time set-up, in bytes; 0 until it is complete."""
    MEASURED_RATE_HZ = 15
    """Highest rate that the cycle can keep, measured before the first cycle, in Hz; 0 until
    then."""
    GC_COLLECTIONS = 16
    """Garbage collections since the loop became real-time."""
    MINOR_FAULTS = 17
    """Minor page faults, without disk access, since the loop became real-time."""
    MAJOR_FAULTS = 18
    """Major page faults, with disk access, since the loop became real-time."""
    ALLOCATED_BLOCKS = 19
    """Memory blocks of the loop's interpreter."""
    DEVICES_OPEN = 20
    """1 while the devices are open, 0 while they are absent."""
    UNCLEAN = 21
    """1 if the previous daemon did not end cleanly, `HUNG` if its loop hung; set before the loop
    starts."""
    LOOP_ASKABLE = 22
    """1 when the loop takes requests; before that it has accessed no device."""
    NEWEST_REQUEST = 23
    """Number of the newest request; the first is 1."""
    ESTOP_ASKED = 24
    """Number of the newest emergency stop. It is a level, so there is always room for it."""
    ESTOP_DONE = 25
    """Number of the newest emergency stop that was answered."""
    SUPERVISOR_FAULTS = 26
    """Faults that the supervisor finds now, one bit for each entry of `SUPERVISOR_FAULTS`."""
    SUCCEEDS = 27
    """0 in the first loop of a daemon; 1 if the loop replaces another one, 2 if faults had stopped
    that one. See `telemetry.succession`."""
    LATCHED_LOW = 28
    """Latched faults of the loop before, bits 0 to 31."""
    LATCHED_MIDDLE = 29
    """Likewise, bits 32 to 63."""
    LATCHED_HIGH = 30
    """Likewise, from bit 64."""
    COMPILED_KERNELS = 31
    """Kernels whose compilation the loop process has begun."""


HUNG: Final = 2
"""Value of `Word.UNCLEAN` after a daemon that killed its loop because it hung."""

SUPERVISOR_FAULTS: Final = (Fault.D8, Fault.P6, Fault.P7, Fault.P11, Fault.P15)
"""Faults that only the supervisor can find, because the loop uses no disk and no log."""
