"""What `docs/faults.md` promises for each fault and condition, and within which time.

The table of the page is the promise. A proof is a test with the mark `fault`. The fixture
`reaction` takes the time that the proof has measured, and refuses a number of cycles beyond the
promise. `python -m tests.faults` runs all proofs, compares wall clocks too, and writes the measured
times into the table.
"""

import re
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

PROVED: Final = "fault"
REACTION: Final = "reaction"
"""Names of properties in the report of a test: an id that it proves, and a measured reaction."""
PAGE: Final = Path(__file__).parents[1] / "docs" / "faults.md"
ROW: Final = re.compile(
    r"^\| (?P<id>[A-Z]\d+) \| [^|]* \| (?P<what>[^|]*) "
    r"\| (?:(?P<limit>\d+) (?P<unit>cycles?|ms) \((?P<measured>\d*)\)[^|]*)?\|$",
    re.MULTILINE,
)
"""A row: `| S5 | noticed | done; what ends it | 4 cycles (3) |`, or without a bound."""


class Promise(NamedTuple):
    """A promised reaction, with its bound. Without a bound the proofs state no time."""

    what: str  #: The reaction, and what ends it.
    #: Largest number of cycles from the cause to the reaction. 1 is the first cycle that can see
    #: the cause. Measured in virtual time, at 1 kHz if a time decides the reaction.
    cycles: int | None = None
    #: Largest time from the cause to the reaction, in ms. Measured on a wall clock, with real
    #: processes.
    ms: int | None = None

    @property
    def limit(self) -> int | None:
        """The bound as a number; None without one."""
        return self.ms if self.cycles is None else self.cycles

    @property
    def bound(self) -> str:
        """The bound, for people; empty without one."""
        return "" if self.limit is None else f"{self.limit} {'ms' if self.ms else 'cycles'}"


def _promise(row: re.Match[str]) -> Promise:
    limit = None if row["limit"] is None else int(row["limit"])
    if row["unit"] == "ms":
        return Promise(row["what"], ms=limit)
    return Promise(row["what"], cycles=limit)


PROMISES: Final = MappingProxyType(
    {row["id"]: _promise(row) for row in ROW.finditer(PAGE.read_text(encoding="utf-8"))}
)
"""The promise for each id of the page, in the order of the page."""
