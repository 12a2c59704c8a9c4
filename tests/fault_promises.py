"""What `docs/faults.md` promises for each fault and condition, and within which time.

A proof is a test with the mark `fault`. The fixture `reaction` takes the time that the proof has
measured, and refuses a number of cycles beyond the promise. `python -m tests.faults` runs all
proofs, compares wall clocks too, and writes the table of the page.
"""

from types import MappingProxyType
from typing import Final, NamedTuple

PROVED: Final = "fault"
REACTION: Final = "reaction"
"""Names of properties in the report of a test: an id that it proves, and a measured reaction."""


class Promise(NamedTuple):
    """A promised reaction, with its bound. Without a bound the proofs state no time."""

    what: str  #: The reaction.
    #: Largest number of cycles from the cause to the reaction. 1 is the first cycle that can see
    #: the cause. Measured in virtual time, at 1 kHz if a time decides the reaction.
    cycles: int | None = None
    #: Largest time from the cause to the reaction, in ms. Measured on a wall clock, with real
    #: processes.
    ms: int | None = None

    @property
    def bound(self) -> str:
        """The bound, for people; empty without one."""
        limit = self.limit
        return "" if limit is None else in_words(limit, self.unit)

    @property
    def limit(self) -> int | None:
        """The bound as a number; None without one."""
        return self.ms if self.cycles is None else self.cycles

    @property
    def unit(self) -> str:
        """Unit of the bound."""
        return "ms" if self.cycles is None else "cycles"


def in_words(number: int, unit: str) -> str:
    """Return a time with its unit."""
    return "1 cycle" if (number, unit) == (1, "cycles") else f"{number} {unit}"


PROMISES: Final = MappingProxyType(
    {
        # Sensor.
        "S1": Promise("HOLD, from when the drive has moved by 2 %", cycles=20),
        "S2": Promise("HOLD", cycles=5),
        "S3": Promise("HOLD", cycles=4),
        "S4": Promise("sample dropped, nothing learned"),
        "S5": Promise("HOLD", cycles=4),
        "S6": Promise("WARN", cycles=25),
        "S7": Promise("HOLD", cycles=4),
        "S8": Promise("HOLD", cycles=4),
        "S9": Promise("HOLD, from when no loop of the model explains the position", cycles=40),
        "S10": Promise("RAMP; BLIND for an amplifier", cycles=1),
        "S11": Promise("HOLD", cycles=5),
        "S12": Promise("DEGRADE", cycles=1000),
        "S13": Promise("WARN", cycles=200),
        # Amplifier.
        "A1": Promise("BLIND", cycles=6),
        "A2": Promise("BLIND", cycles=5),
        "A3": Promise("HOLD", cycles=4),
        "A4": Promise("HOLD, half the slew rate", cycles=1),
        "A5": Promise("nothing written, HOLD", cycles=2),
        "A6": Promise(
            "WARN, from when the drive is limited: 21 cycles by its range, 101 by its slew rate",
            cycles=101,
        ),
        "A7": Promise("BLIND", cycles=1),
        "A8": Promise("HOLD without a write", cycles=1),
        "A9": Promise("BLIND", cycles=1),
        "A10": Promise("shown while armed"),
        "A11": Promise("CUT", cycles=2),
        "A12": Promise("CUT", cycles=2),
        "A13": Promise("CUT", cycles=2),
        # Bus, from when the driver reports it.
        "B1": Promise("BLIND", cycles=1),
        "B2": Promise("BLIND", cycles=1),
        "B3": Promise("HOLD", cycles=5),
        "B4": Promise("HOLD", cycles=5),
        "B5": Promise("HOLD", cycles=5),
        "B6": Promise("HOLD", cycles=5),
        "B7": Promise("HOLD", cycles=5),
        "B8": Promise("BLIND", cycles=1),
        "B9": Promise("BLIND", cycles=3),
        "B10": Promise("RAMP; HOLD for a wrong request, and if busy", cycles=5),
        "B11": Promise("HOLD", cycles=5),
        "B12": Promise("HOLD", cycles=2),
        "B13": Promise("BLIND", cycles=1),
        "B14": Promise("BLIND", cycles=1),
        "B15": Promise("BLIND, from when the call blocks; B15 shows after 250 ms", cycles=10),
        # Loop.
        "L1": Promise("counted", cycles=1),
        "L2": Promise("HOLD", cycles=5000),
        "L3": Promise("loop killed; then as P2", ms=2500),
        "L4": Promise("WARN, voltages unchanged", cycles=1),
        "L5": Promise("HOLD, from when the loop runs again", cycles=1),
        "L6": Promise("WARN"),
        "L7": Promise("WARN; DEGRADE with `strict_rt`", cycles=10_000),
        "L8": Promise("WARN"),
        "L9": Promise("shown in `piezod status`; `strict_rt` refuses to arm"),
        # Adaptation.
        "D1": Promise("DEGRADE", cycles=2000),
        "D2": Promise("DEGRADE", cycles=101),
        "D3": Promise("corrected or taken back in the same step"),
        "D4": Promise("nothing learned"),
        "D5": Promise("WARN, from when the model is at its bound", cycles=6100),
        "D6": Promise("WARN; DEGRADE 0.5 s later", cycles=600),
        "D7": Promise("nothing learned", cycles=1),
        "D8": Promise("older parameters, DEGRADE"),
        "D9": Promise("no step beyond the slew rate"),
        "D10": Promise("WARN; no adaptive mode", cycles=1),
        "D11": Promise("WARN, from when the model is at its bound", cycles=3600),
        # Process.
        "P1": Promise("RAMP, then exit code 0; the time beyond that of the ramp", ms=2000),
        "P2": Promise("first voltage of the ramp of `piezod safe`; reset needed", ms=3000),
        "P3": Promise("HOLD, or BLIND if writing fails", cycles=2),
        "P4": Promise("voltage held, HOLD", cycles=2),
        "P5": Promise("the service stays stopped"),
        "P6": Promise("recording closed, old parameters kept, WARN"),
        "P7": Promise("lost cycles counted, WARN"),
        "P8": Promise("old or new file, never a mixture"),
        "P9": Promise("exit code 75; nothing touched"),
        "P10": Promise("exit code 78; nothing touched"),
        "P11": Promise("shown; old configuration kept until a valid reload"),
        "P12": Promise("exit code 77, with the remedy"),
        "P13": Promise("newer version refused"),
        "P14": Promise("as P1"),
        "P15": Promise("ten lines of a kind in ten seconds, the others counted"),
        "E1": Promise("RAMP or CUT", cycles=2),
        "H1": Promise(
            "RAMP, then the end of the loop; from 3 s of silence on, from 1 s if its process ended",
            cycles=2,
        ),
        # Clients.
        "C1": Promise("refused"),
        "C2": Promise("refused, with little memory"),
        "C3": Promise("samples dropped; after 5 s without reading the connection closed", ms=6000),
        "C4": Promise("connection closed if a request takes 5 s to arrive", ms=6000),
        "C5": Promise(
            "refused beyond 50 requests/s of a client and 200/s of all; idle connections closed "
            "after 60 s, after 1 s if there are too many; a stop is still served"
        ),
        "C6": Promise("refused"),
        "C7": Promise("refused"),
        "C8": Promise("one has the lease; the other is refused"),
        "C9": Promise("HOLD", cycles=101),
        "C10": Promise("refused, not clamped"),
        "C11": Promise("refused"),
        "C12": Promise("refused"),
        "C13": Promise("refused, with the remedy"),
        "C14": Promise("refused"),
        "C15": Promise("stage stopped, recording ended"),
    }
)
"""The promise for each id of the page, in the order of `faults.md`."""
