"""Single numbers that loop and supervisor tell each other, by name.

Each is an aligned word of eight bytes with one writer. Reading and writing one is atomic, which
`struct.pack_into` is not: it clears the bytes before it sets them.
"""

from enum import IntEnum


class Word(IntEnum):
    """Place of each number in `SharedMap.words`; 0 until it is first written."""

    LOOP_PID = 0
    """Process id of the loop."""
    LOOP_BEAT_NS = 1
    """Instant of the newest cycle."""
    HEALTHY_CYCLES = 2
    """Cycles that ran on schedule to their end, whatever state or fault they report."""
    LOOP_STATE = 3
    """Place of the state in `config.states.State`."""
    SKIPPED_CYCLES = 4
    """Periods that were skipped."""
    SUPERVISOR_PID = 5
    """Process id of the supervisor."""
    SUPERVISOR_BEAT_NS = 6
    """Instant at which the supervisor last showed that it lives."""
    NEWEST_RECORD = 7
    """Sequence number of the newest record in the ring; they start at 1."""
    NEWEST_EVENT = 8
    """Sequence number of the newest event; they start at 1."""
    URGENT_POSTED = 9
    """Requests put into the urgent lane."""
    URGENT_TAKEN = 10
    """Requests taken out of it."""
    REQUESTS_POSTED = 11
    """Requests put into the ordinary lane."""
    REQUESTS_TAKEN = 12
    """Requests taken out of it."""
    REQUESTS_EXPIRED = 13
    """Requests that were not taken in time."""
    REPORT_BYTES = 14
    """Length of the report on the real-time set-up; 0 until it is complete."""
    MEASURED_RATE_HZ = 15
    """The rate that the cycle can keep, as measured before the first; 0 until then."""
    GC_COLLECTIONS = 16
    """Garbage collections since the loop is real-time."""
    MINOR_FAULTS = 17
    """Page faults without input since the loop is real-time."""
    MAJOR_FAULTS = 18
    """Page faults with input since the loop is real-time."""
    ALLOCATED_BLOCKS = 19
    """Blocks of memory that the loop's interpreter holds."""
    DEVICES_OPEN = 20
    """1 while the devices are open, 0 while they are absent."""
    UNCLEAN = 21
    """1 where the daemon before this one did not end properly; set before the loop starts."""
    LOOP_ASKABLE = 22
    """1 once the loop takes requests; before that it has touched no device."""
    NEWEST_REQUEST = 23
    """Number of the newest request; they start at 1."""
    ESTOP_ASKED = 24
    """Number of the newest emergency stop: a level, for which there is always room."""
    ESTOP_DONE = 25
    """Number of the newest emergency stop that was answered."""
